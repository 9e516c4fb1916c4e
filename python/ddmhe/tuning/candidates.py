"""The settings that are tried: the default rule and a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DEFAULT_RHO, DdMhe, Ridge, Truncated
from ddmhe.tuning.folds import Recorded

Array = NDArray[np.float64]

__all__ = ["HIDDEN", "LAMBDA", "Candidate", "candidates_for"]

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


@dataclass
class Candidate:
    """One setting."""

    given: dict[str, Any]
    """Keywords of DdMhe; empty but for the options for the default rule."""
    horizon: int
    mu: float
    weight: float | None = None
    """λ/μ; None for a rank or the default rule."""
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
    def score(self) -> float:
        """Mean over the quarters."""
        return float(np.mean(self.scores)) if self.scores is not None else math.inf

    @property
    def rehearsed(self) -> float:
        """Mean over the rehearsals, NaN without."""
        return math.nan if self.rehearsals is None else float(np.mean(self.rehearsals))


def candidates_for(recorded: Recorded) -> tuple[list[Candidate], float]:
    """The default rule and a grid, with and without the equilibrium if it can be used; and the
    default rule's λ/μ."""
    history, equilibrium = recorded.history, recorded.equilibrium
    default = DdMhe(history, start="recording")
    reference = max(default.ridge / default.mu, LAMBDA[0])
    hidden = reference > HIDDEN
    reach = min(len(recorded.y), LONGEST / max(HORIZONS[hidden]))
    horizons = sorted({max(2, round(share * reach)) for share in HORIZONS[hidden]})
    options: list[dict[str, Any]] = [{}]
    if equilibrium is not None:
        rest: dict[str, Any] = {"equilibrium": equilibrium}
        if not any("equilibrium" in w for w in DdMhe(history, start="recording", **rest).warnings):
            options.append(rest)
    found = []
    for option in options:
        found.append(Candidate(option, default.horizon, default.mu))
        for M, level in product(horizons, MU[hidden]):
            given = option | {"horizon": M, "rho": DEFAULT_RHO, "mu": level, "weights": "scaled"}
            for weight in LAMBDA:
                space = Ridge(float(f"{weight * level:.6g}"), normalised=True)
                found.append(Candidate(given | {"space": space}, M, level, weight))
            if not hidden:
                for rank in range(history.n, history.n + 3):
                    found.append(Candidate(given | {"space": Truncated(rank)}, M, level))
    return found, reference
