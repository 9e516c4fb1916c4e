"""The settings that are tried: the default rule, fitted disturbances beside it and a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DEFAULT_RHO, DdMhe, DdmheError, Ridge, Truncated
from ddmhe.tuning.disturbance import stated_noise
from ddmhe.tuning.folds import Recorded

Array = NDArray[np.float64]

__all__ = ["LAMBDA", "Candidate", "candidates_for"]

HIDDEN = 1e-2
"""A default λ/μ above this (a third of the variance unexplained) means hidden states: other
settings are tried."""
HORIZONS = {False: (0.05, 0.1, 0.2), True: (0.13, 0.27, 0.4)}
"""Horizons to try as shares of T, without and with hidden states."""
LONGEST = 100
"""Longest horizon to try, as in the default rule: with the default discount older samples weigh
less than 0.6 %, and the work grows with the third power. The shares are of no longer a recording
than the one that reaches it."""
MU = {False: (0.03, 0.3), True: (0.1, 1.0)}
"""μ to try, in units of the recording's spread."""
LAMBDA = tuple(10.0**k for k in range(-7, 0))
"""λ/μ to try."""


_FITTED = {"scaled": "none", "recorded": "recorded"}
"""The disturbance that weights fit by themselves."""


@dataclass
class Candidate:
    """One setting."""

    given: dict[str, Any]
    """Keywords of DdMhe, which are scored; for the default rule those that name what it takes on
    the whole recording, lest it takes something else on parts of it."""
    horizon: int
    mu: float
    """In scaled units; NaN for the weights of the recording."""
    weight: float | None = None
    """λ/μ; None for a rank or the default rule."""
    default: bool = False
    """Whether it is the default rule, without or with the known rest."""
    stated: float | None = None
    """What the disturbance of the recording is divided by so that the outputs' noise is the stated
    one; None where it is not."""
    radius: float = math.inf
    scores: Array | None = None
    """log(rms/spread) of each quarter."""
    rehearsals: Array | None = None
    """log(rms/spread) of each rehearsal, mean over its spans; None without."""
    rated: float = math.inf
    smoothed: Array | None = None
    """log(rms/spread) of each quarter and each rehearsal, mean over neighbouring weights; None for
    an unstable one."""

    @property
    def equilibrium(self) -> bool:
        """Whether the known rest is part of it."""
        return "equilibrium" in self.given

    @property
    def settings(self) -> dict[str, Any]:
        """Keywords of DdMhe that mean the same: none where the default rule takes them by itself,
        but for the known rest."""
        kept = {key: value for key, value in self.given.items() if key == "equilibrium"}
        return kept if self.default else dict(self.given)

    @property
    def weights(self) -> str:
        """The cost is weighed by scales, or by the noise of the recording."""
        return str(self.given.get("weights", "scaled" if self.given else "recorded"))

    @property
    def disturbance(self) -> str:
        """Which disturbance is fitted, in words."""
        if self.stated is not None:
            return f"recorded / {self.stated:.3g}"
        return str(self.given.get("process_noise", _FITTED[self.weights]))

    @property
    def score(self) -> float:
        """Mean over the quarters."""
        return float(np.mean(self.scores)) if self.scores is not None else math.inf

    @property
    def rehearsed(self) -> float:
        """Mean over the rehearsals, NaN without."""
        return math.nan if self.rehearsals is None else float(np.mean(self.rehearsals))


def candidates_for(recorded: Recorded) -> tuple[list[Candidate], bool]:
    """The default rule, fitted disturbances beside it, and a grid, with and without the equilibrium
    if it can be used; and whether surrogates can stand in for the recorded motion.

    They cannot for hidden states, nor where the default rule takes the weights of the recording:
    there the motion is linear and noise drives it, while surrogates are curved, and nothing drives
    them: they prefer whatever trusts the outputs most."""
    history, equilibrium = recorded.history, recorded.equilibrium
    ridge = DdMhe(history, start="recording", weights="scaled")
    reference = max(ridge.ridge / ridge.mu, LAMBDA[0])
    hidden = reference > HIDDEN
    reach = min(len(recorded.y), LONGEST / max(HORIZONS[hidden]))
    horizons = sorted({max(2, round(share * reach)) for share in HORIZONS[hidden]})
    options: list[dict[str, Any]] = [{}]
    found = _beside(recorded, ridge)
    if equilibrium is not None:
        rest: dict[str, Any] = {"equilibrium": equilibrium}
        if not any("equilibrium" in w for w in DdMhe(history, start="recording", **rest).warnings):
            options.append(rest)
            found.append(Candidate(rest, ridge.horizon, ridge.mu, default=True))
    for option in options:
        for M, level in product(horizons, MU[hidden]):
            given = option | {"horizon": M, "rho": DEFAULT_RHO, "mu": level, "weights": "scaled"}
            for weight in LAMBDA:
                space = Ridge(float(f"{weight * level:.6g}"), normalised=True)
                found.append(Candidate(given | {"space": space}, M, level, weight))
            if not hidden:
                for rank in range(history.n, history.n + 3):
                    found.append(Candidate(given | {"space": Truncated(rank)}, M, level))
    return found, not hidden and found[0].weights == "scaled"


def _beside(recorded: Recorded, ridge: DdMhe) -> list[Candidate]:
    """The default rule first, then what differs from it in weights and disturbance alone.

    The weights of the recording are tried where the default rule takes them, and nowhere else: what
    it refuses them for, a curved motion or a state that x does not hold, is hardly seen inside of
    the recording."""
    default = DdMhe(recorded.history, start="recording")
    scaled: list[dict[str, Any]] = [
        {"weights": "scaled"} | fitted
        for fitted in ({}, {"process_noise": "recorded"}, {"process_noise": "residual"})
    ]
    forms = [Candidate(given, ridge.horizon, ridge.mu) for given in scaled]
    if default.weights == "recorded":
        weights: dict[str, Any] = {"weights": "recorded"}
        own = [Candidate(_named(recorded, weights), default.horizon, math.nan)]
        stated = stated_noise(recorded)
        if stated is not None:
            Q, times = stated
            given = weights | {"process_noise": Q}
            own.append(Candidate(given, default.horizon, math.nan, stated=times))
        given = weights | {"process_noise": "residual"}
        own.append(Candidate(given, default.horizon, math.nan))
        forms = own + forms
    forms[0].default = True
    return forms


def _named(recorded: Recorded, weights: dict[str, Any]) -> dict[str, Any]:
    """These weights; nothing where the default rule alone takes them: they cannot be asked for by
    name of states that show no disturbance."""
    try:
        DdMhe(recorded.history, start="recording", **weights)
    except DdmheError:
        return {}
    return weights
