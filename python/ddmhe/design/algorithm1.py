"""The whole of Liu et al. 2026 in one call: Algorithm 2's weights, (33)'s horizon, Algorithm 1's
estimator, and what of Theorem 2 holds for it.

Known by the paper's name for it: what `pole_placement` and `DdMhe` are called for what they do is
here put together. Where Algorithm 2 as printed, on the recording's dual data, gives no gain for
which (24) holds (its rank condition (44) fails on every exact recording), it is run on the
identified (A, C), which n + p experiments on the dual system would tell. Theorem 2 is for a
recording that is a trajectory of one affine system, a gain that satisfies (24) there, and 4ρ^M < 1
(33); then

    ‖e(t)‖ ≤ √κ^t ‖e(0)‖ + Σ √κ^{t-1-j} √μ (‖w(j)‖ + √2 ‖v(j)‖),  κ^M = 4ρ^M.    (34)

(34) as printed is too small where w acts; `Certificate.error_bound` has the form that holds. Known
inputs act on the estimate and on the true state alike: where their response is identified exactly,
as on an exact recording, all of this holds with them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ddmhe._core import (
    DdMhe,
    DdmheError,
    History,
    InfeasibleError,
    RankReport,
    check_settings,
    minimum_horizon,
)
from ddmhe.checks import check_history, check_number, check_whole
from ddmhe.design.certificate import Certificate
from ddmhe.design.certify import scalar_certificate
from ddmhe.design.model import AffineModel, identify, is_exact
from ddmhe.design.poles import PolePlacement, pole_placement
from ddmhe.design.regions import Region

__all__ = ["Algorithm1", "algorithm1"]

LEAST_MU = 6.0
"""μ0 is at least this: the proof of (19) needs 6 ≤ μ."""
WINDOWS = 4
"""A recording with fewer than this many windows for each of the n + 1 dimensions tells little."""
ROUNDED = 1e-9
"""ρ is this share below the one with 4ρ^M = 1."""
OWN = ("certificate", "weights")
"""Settings of an estimator that Algorithm 1 has made up its mind about."""


@dataclass(frozen=True, eq=False)
class Algorithm1:
    """The estimator of Algorithm 1 with the design behind it, and what is known of it."""

    design: PolePlacement
    """Algorithm 2's gain, ρ0 and μ0, which ρ and μ are chosen above."""
    printed: PolePlacement
    """Algorithm 2 on the recording's dual data; `design` itself unless that is of the identified
    (A, C)."""
    model: AffineModel
    """The identified system, which the verdicts rest on."""
    rho: float | None
    """ρ in (ρ0, 1); None where Algorithm 2 found no ρ0 < 1."""
    mu: float | None
    """μ > μ0, unit (unit of x / unit of y)²."""
    horizon: int | None
    """M with 4ρ^M < 1."""
    rank: RankReport | None
    """(7) for windows of M outputs."""
    exact: bool
    """Whether the recording is a trajectory of one affine system, to rounding."""
    certificate: Certificate | None
    """ρ and μ as a certificate where (24) holds in the identified system with them: its
    `error_bound` is (34) in the form that holds."""
    found: DdMhe | None
    """The estimator, or None."""

    @property
    def estimator(self) -> DdMhe:
        """Algorithm 1's estimator; InfeasibleError with `words` where Algorithm 2 left none."""
        if self.found is None:
            raise InfeasibleError(
                f"estimator: expected a feasible Algorithm 2, found: {self.words}"
            )
        return self.found

    @property
    def feasible(self) -> bool:
        """Whether Algorithm 2, as printed, gave ρ0 < 1, so that there is an estimator."""
        return self.found is not None

    @property
    def contraction(self) -> float:
        """√(4ρ^M), by which (34) shrinks errors over M samples; inf without an estimator."""
        if self.rho is None or self.horizon is None:
            return np.inf
        return float(np.sqrt(4 * self.rho**self.horizon))

    @property
    def holds(self) -> bool:
        """Whether Theorem 2 applies: an exact recording with (7), windows that are its
        trajectories, (24) in the identified system, (33)."""
        windows = self.found is not None and self.found.ridge == 0
        ranks = self.rank is not None and self.rank.satisfied
        return self.exact and windows and ranks and self.certificate is not None

    @property
    def words(self) -> str:
        """What was found and what of Theorem 2 holds for this recording, in sentences."""
        return " ".join([*self._origin(), self.design.words, *self._settings(), *self._verdict()])

    def _origin(self) -> Iterator[str]:
        if self.design is not self.printed:
            yield (
                "Algorithm 2 on the recording's dual data gives no gain for which (24) holds (rho0 "
                f"= {self.printed.rho0:.4g}); it was run on the identified (A, C) instead."
            )

    def _settings(self) -> Iterator[str]:
        if self.rho is None or self.rank is None:
            yield (
                "No rho in (rho0, 1) exists: Algorithm 1 has no weights. Use a weighted "
                "certificate (ddmhe.design.ioss), or the default rule (ddmhe.DdMhe(h))."
            )
            return
        yield (
            f"Algorithm 1 runs with rho = {self.rho:.6g}, mu = {self.mu:.6g}, M = {self.horizon}: "
            f"4 rho^M = {self.contraction**2:.4g} < 1, as (33) asks."
        )
        holds = "holds" if self.rank.satisfied else "fails"
        yield f"(7) {holds}: rank {self.rank.rank} of {self.rank.required}."

    def _verdict(self) -> Iterator[str]:
        if self.rho is None:
            return
        if self.holds:
            yield (
                "Theorem 2 applies, since the recording is a trajectory of one affine system and "
                f"(24) holds there: errors shrink by {self.contraction:.3g} over M samples where "
                "neither w nor v acts. (34) as printed is too small for w: certificate.error_bound "
                "is the form that holds, and with disturbance=(initial, w, v) every estimate "
                "carries its own bound."
            )
            return
        if not self.exact:
            yield (
                "The recording shows noise or curvature, so that its windows are trajectories of "
                "no affine system: Theorem 2 does not apply and no error bound follows. State the "
                "noise (ddmhe.design.ioss with noise=RecordingNoise) for one that does."
            )
        if self.certificate is None:
            yield (
                "(24) does not hold in the identified system with these weights: Theorem 2 does "
                "not apply. A weighted certificate (ddmhe.design.ioss) needs no (24)."
            )
        if self.exact and self.certificate is not None:
            yield (
                "The estimator's windows are not the recording's trajectories alone: Theorem 2 "
                "does not apply; it does with space=Exact()."
            )


def algorithm1(
    history: History,
    radius: float = 0.9,
    *,
    rho: float | None = None,
    mu: float | None = None,
    horizon: int | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    region: Region | None = None,
    disturbance: tuple[float, float, float] | None = None,
    **settings: Any,
) -> Algorithm1:
    """Algorithm 2 for ρ0 and μ0, then ρ > ρ0, μ > μ0 and M with 4ρ^M < 1, then `DdMhe` with them.

    Parameters
    ----------
    history : History
        The recording, with its known inputs where it has them.
    radius, Q, R, region
        Of `pole_placement`.
    rho : float in (ρ0, 1)
        Default: halfway from ρ0 to 1, from the larger ρ0 where it is below 1 as printed and in the
        identified system; less where (33) would ask for a horizon of which the recording has
        fewer than 4 (n + 1) windows.
    mu : float above μ0
        Default: 2 max(μ0, 6), as the proof of (19) needs 6 ≤ μ. A larger μ trusts outputs more.
    horizon : int
        Default: the smallest M with 4ρ^M < 1, which is also the least that is taken.
    disturbance : (initial, w, v)
        Bounds on the norms of the initial error, of w and of v; where Theorem 2 applies each
        estimate then carries a bound on its error.
    settings
        Other keywords of `DdMhe`: x_prior, x_bounds, space, …

    Where Algorithm 2 finds no ρ0 < 1 the result has no estimator, and its words say so.

    Raises
    ------
    InfeasibleError
        (A, C) is unobservable.
    RankError, DdmheError, ShapeError, NotFiniteError
        Wrong arguments; a recording too short for the horizon.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = np.zeros((61, 1))
    >>> for k in range(60):
    ...     x[k + 1] = 0.9 * x[k] + 1.0
    >>> found = ddmhe.design.algorithm1(ddmhe.History(x, 2.0 * x[:60], 0.1))
    >>> 4 * found.rho**found.horizon < 1
    True
    """
    check_history(history)
    for name in OWN:
        if name in settings:
            raise DdmheError(f"{name}: expected none beside Algorithm 1's own rho and mu, found it")
    given = {"rho": rho, "mu": mu, "horizon": horizon, **settings}
    check_settings({name: value for name, value in given.items() if value is not None}, history)
    printed = pole_placement(history, radius, Q=Q, R=R, region=region)
    model = identify(history)
    design = _design(printed, model, {"radius": radius, "Q": Q, "R": R, "region": region})
    theta = np.block([[model.A, model.B], [model.C, model.D]])
    exact = is_exact(history, theta, np.concatenate([model.e, model.r]))
    if not design.feasible:
        return Algorithm1(design, printed, model, None, None, None, None, exact, None, None)
    rho, mu, horizon = _weights(design, history, rho, mu, horizon)
    certificate = _certificate(design, model, rho, mu, exact)
    if certificate is not None and disturbance is not None:
        settings |= {"certificate": certificate, "disturbance": disturbance}
    else:
        settings |= {"rho": rho, "mu": mu}
    estimator = DdMhe(history, horizon, **settings)
    rank = history.rank(horizon)
    return Algorithm1(design, printed, model, rho, mu, horizon, rank, exact, certificate, estimator)


def _design(printed: PolePlacement, model: AffineModel, given: dict[str, Any]) -> PolePlacement:
    """Algorithm 2 as printed, or on the identified (A, C) where only that satisfies (24).

    A C whose rank is noise would let any gain pass there: the bound that C's standard errors leave
    has to be below 1."""
    if (printed.feasible and printed.certified) or printed.lower_bound >= 1:
        return printed
    other = pole_placement(A=model.A, C=model.C, **given)
    return other if other.feasible and other.certified else printed


def _weights(
    design: PolePlacement,
    history: History,
    rho: float | None,
    mu: float | None,
    horizon: int | None,
) -> tuple[float, float, int]:
    """ρ, μ and M, checked or chosen."""
    if rho is None:
        rho = _rho(design, history)
    check_number(
        "rho", rho, f"a number in (rho0, 1) = ({design.rho0:.6g}, 1)", lambda v: design.rho0 < v < 1
    )
    if mu is None:
        mu = 2.0 * max(design.mu0, LEAST_MU)
    check_number("mu", mu, f"a number above mu0 = {design.mu0:.6g}", lambda v: v > design.mu0)
    least = minimum_horizon(rho)
    if horizon is None:
        horizon = least
    check_whole("horizon", horizon, least, expected=f"at least {least}, for which 4 rho^M < 1 (33)")
    return float(rho), float(mu), int(horizon)


def _rho(design: PolePlacement, history: History) -> float:
    """Halfway from ρ0 to 1, or what the longest horizon with enough windows allows."""
    rho_0 = max(design.rho0, design.rho0_identified if design.certified else 0.0)
    lengths = [len(y) for _, y in history.recordings]

    def enough(M: int) -> bool:
        return sum(max(T - M + 1, 0) for T in lengths) >= WINDOWS * (history.n + 1)

    rho = 0.5 * (1.0 + rho_0)
    if not enough(minimum_horizon(rho)):
        longest = max((M for M in range(1, max(lengths) + 1) if enough(M)), default=1)
        shorter = 0.25 ** (1 / longest) * (1 - ROUNDED)
        rho = shorter if shorter > rho_0 else rho
    return rho


def _certificate(
    design: PolePlacement, model: AffineModel, rho: float, mu: float, exact: bool
) -> Certificate | None:
    """ρ and μ as a certificate of the identified system; None where (24) does not hold there."""
    if design.gain is None:
        return None
    inputs = {"B": model.B, "D": model.D} if model.B.shape[1] else {}
    try:
        made = scalar_certificate(
            model.A, model.C, design.gain, rho, mu, e=model.e, r=model.r, **inputs
        )
    except InfeasibleError:
        return None
    return replace(made, identified=not exact)
