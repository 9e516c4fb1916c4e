"""Stability certificates: P, Q, R and η for which the estimation error is known to shrink, verified
by eigenvalues.

For the difference d of two trajectories, d⁺ = A d - w, the inequality

    ‖d⁺‖²_P ≤ η‖d‖²_P + ‖w‖²_Q + ‖C d‖²_R    ⟺    [[AᵀPA - ηP - CᵀRC, AᵀP], [PA, P - Q]] ⪯ 0
    (L)

makes ‖d‖²_P an incremental input/output-to-state Lyapunov function (Schiller, Muntwiler, Köhler,
Zeilinger, Müller 2023). It exists for every observable pair and every η in (0, 1), also where (24)
of Liu et al. 2026 is impossible."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from ddmhe._core import DdmheError, History, InfeasibleError, ShapeError, minimum_horizon
from ddmhe.checks import array, check_finite, check_kind, check_number, check_whole, shown
from ddmhe.design.arguments import recording_or_system, system
from ddmhe.design.dissipation import (
    best_gains,
    condition_number,
    dissipation,
    extremes,
    largest_eigenvalue,
    root,
)
from ddmhe.design.model import identify, samples, unobservable_modes
from ddmhe.design.uncertainty import ConsistentSet, RecordingNoise, consistent_set

Array = NDArray[np.float64]

__all__ = ["Certificate", "Uncertainty", "ioss", "scalar_certificate"]

MOST_STEPS = 10_000_000
"""Steps whose bounds fit into memory."""
TRAJECTORY = 1e3 * float(np.finfo(float).eps)
"""A recording counts as exact when every sample misses the model by less than this share of the
numbers added up."""
ETA = 0.95
"""Discount that is designed for when neither `eta` nor `condition` is given."""


@dataclass(frozen=True)
class Uncertainty:
    """‖ΔA x + Δe‖_Q ≤ w q(x), ‖ΔC x + Δr‖_R ≤ v q(x), q(x)² = [x; 1]ᵀ metric [x; 1], for every
    consistent system."""

    metric: Array
    w: float
    v: float


@dataclass(frozen=True, eq=False)
class Certificate:
    """P, Q, R, η that satisfy (L), in the user's units; the estimator takes it as `DdMhe(h,
    certificate=c)`."""

    P: Array
    """(n, n), P ⪰ I: ‖d‖ ≤ ‖d‖_P."""
    Q: Array
    """(n, n)"""
    R: Array
    """(p, p)"""
    eta: float
    """Discount per sample, in (0, 1)."""
    residual: float
    """Largest eigenvalue of (L), or of Φ for a robust certificate; at most 0."""
    A: Array | None = None
    """(n, n) of the model, the centre of the consistent ones; None for a certificate read from a
    file without it."""
    C: Array | None = None
    """(p, n)"""
    e: Array | None = None
    """Offsets (n,), where known; the error bound then accounts for windows that are not the model's
    trajectories.
    Without them there is a bound only over a recording that is a trajectory of (A, C)."""
    r: Array | None = None
    """(p,)"""
    growth: float | None = None
    """At least ‖A d‖_P/‖d‖_P for all d and all consistent A."""
    uncertainty: Uncertainty | None = None
    """For a robust certificate: how far the true system may be from the model."""
    noise: RecordingNoise | None = None
    """The noise for which a robust certificate was made."""
    optimised: bool = True
    """Whether `ioss` found it by its programme: False is the Riccati solution, valid but larger
    than it need be."""
    identified: bool = False
    """Whether the model was fitted to a noisy (or curved) recording without a statement of its
    noise: how far the true
    system is from it, nobody knows, and no error bound follows."""

    @property
    def condition(self) -> float:
        """Cond P: the squared ratio of the longest and the shortest axis of ‖d‖_P = 1."""
        return condition_number(self.P)

    @property
    def horizon(self) -> int:
        """Smallest M with 4 η^M < 1."""
        return minimum_horizon(self.eta)

    def verify(self, A: ArrayLike, C: ArrayLike) -> float:
        """Largest eigenvalue of (L) for a system (A, C): it satisfies the inequality when this is
        at most 0."""
        A, C = system(A, C)
        _matching(self.P, A, self.R, C)
        return largest_eigenvalue(dissipation(A, C, self.P, self.Q, self.R, self.eta))

    def error_bound(self, steps: int, horizon: int, initial: float, w: float, v: float) -> Array:
        """Bounds (steps+1,) on ‖x̂(t) - x(t)‖, t = 0 … steps, known before the first measurement.

        The weighted form of (34) for ‖x̄(0) - x(0)‖ ≤ initial, ‖w(t)‖ ≤ w, ‖v(t)‖ ≤ v, without
        constraints or with constraints that the true trajectory satisfies, for an estimator whose
        windows are trajectories of a certified system; those of a noisy recording are not, and only
        `Estimate.bound` accounts for that. The estimate compares with the trajectory from the true
        x(t-M) without w, whose outputs are off by v + Cδ, δ = Σ Aⁱw; each bound is the minimum over
        K > 1 of

            K(2η^M E² + Σ η^{j-1}(‖v + Cδ‖_R)²) + 2K/(2K-1) η^M E² + K/(K-1) Σ η^{j-1} V² + Σ
            η^{j-1} W².

        (34) as printed is too small: it has √μ‖w‖ where w(t-1), which no output up to t-1 shows,
        needs ‖w‖."""
        if self.identified:
            raise DdmheError(
                "certificate: expected one of a known system or with the recording's noise stated, "
                "found one whose model was fitted to a noisy recording"
            )
        for name, value in (("initial", initial), ("w", w), ("v", v)):
            check_number(name, value, "a finite number of at least 0", lambda size: size >= 0)
        for name, count in (("steps", steps), ("horizon", horizon)):
            check_whole(name, count, most=MOST_STEPS)
        largest_P, largest_Q, largest_R = (
            math.sqrt(extremes(M)[1]) for M in (self.P, self.Q, self.R)
        )
        V, W = largest_R * v, largest_Q * w
        drift = np.concatenate([[0.0], np.cumsum(self._gains(min(horizon, steps)))]) * w
        weighted = [largest_P * initial]
        for t in range(1, steps + 1):
            m = min(t, horizon)
            discount = self.eta ** np.arange(m - 1, -1, -1.0)
            candidate = float(discount @ (V + drift[:m]) ** 2)
            total = float(discount.sum())
            weighted.append(
                _least_bound(
                    self.eta**m * weighted[t - m] ** 2, candidate, total * V**2, total * W**2
                )
            )
        bounds = np.array(weighted) / math.sqrt(extremes(self.P)[0])
        bounds[0] = initial
        return bounds

    def _gains(self, count: int) -> Array:
        """At least ‖R^½ C Aⁱ‖, i = 0 … count-1, for every certified system."""
        if self.A is None or self.C is None:
            raise DdmheError("certificate: expected one with its model (A, C), found one without")
        root_R = scipy.linalg.cholesky(self.R)
        if self.uncertainty is None:
            powers = [np.eye(len(self.A))]
            for _ in range(count - 1):
                powers.append(self.A @ powers[-1])
            return np.array([np.linalg.norm(root_R @ self.C @ power, 2) for power in powers])
        # ‖C d‖²_R ≤ ‖A d‖²_P + … is no bound; over the set only norms are left: ‖C d‖_R ≤ (‖C_c‖ +
        # spread)‖d‖_P.
        if self.growth is None:
            raise DdmheError("certificate: expected one with its growth, found one without")
        inverse = scipy.linalg.solve_triangular(scipy.linalg.cholesky(self.P), np.eye(len(self.P)))
        spread = self.uncertainty.v * np.linalg.norm(
            root(self.uncertainty.metric[:-1, :-1]) @ inverse, 2
        )
        gain = np.linalg.norm(root_R @ self.C @ inverse, 2) + spread
        largest = math.sqrt(extremes(self.P)[1])
        return np.asarray(gain * self.growth ** np.arange(count) * largest)

    @property
    def words(self) -> str:
        """What is certified, for which systems, and what it asks of the estimator."""
        if self.noise is not None:
            noise = self.noise
            chance = f", with probability {noise.confidence:g}," if noise.kind == "gaussian" else ""
            scope = (
                f"every system that the recording allows{chance} with {noise.kind} noise of "
                f"{noise.x:g} on the states, {noise.y:g} on the outputs and {noise.w:g} on the "
                "motion"
            )
        elif self.uncertainty is not None:
            scope = "every system consistent with the recording that it was made from"
        else:
            scope = (
                "the one system (A, C) that was given or identified, and no other that a noisy "
                "recording allows (state its noise for that)"
            )
        if self.identified:
            scope += ", so that no error bound follows"
        best = (
            ""
            if self.optimised
            else " Rounding refuted the smaller weights that were tried: not the best gains."
        )
        return (
            f"Certified for {scope}: discount {self.eta:.6g} per sample, cond P = "
            f"{self.condition:.4g}, largest eigenvalue of the inequality {self.residual:.3g}. "
            f"Estimation errors shrink with a horizon of at least {self.horizon}.{best}"
        )


def ioss(
    history: History | None = None,
    eta: float | None = None,
    *,
    A: ArrayLike | None = None,
    C: ArrayLike | None = None,
    e: ArrayLike | None = None,
    r: ArrayLike | None = None,
    condition: float | None = None,
    noise: RecordingNoise | None = None,
    gains: tuple[float, float] | None = None,
) -> Certificate:
    """Design a stability certificate from a recording, or from (A, C).

    Minimises w² trace Q + v² trace R subject to (L) and P ⪰ I; with `noise`, to (L) for every
    system that the recording allows.

    Parameters
    ----------
    history : History
        A recording; its affine least-squares model is certified, or with `noise` every system
        consistent with it.
    eta : float in (0, 1)
        Discount per sample. Default: the smallest that `condition` allows, or 0.95.
    A, C : arrays (n, n), (p, n)
        A known system instead of a recording.
    e, r : arrays (n,), (p,)
        Its offsets, x(t+1) = A x + e, y = C x + r; zeros for a linear system. P, Q and R do not
        depend on them, but the error bound of an estimator over a noisy recording does.
    condition : float > 1
        Upper bound on cond P.
    noise : RecordingNoise
        Errors of the recording.
    gains : (w, v)
        Relative sizes of w and v in what is minimised. Default (1, ‖C‖): an output error as large
        as a unit of state.

    Raises
    ------
    InfeasibleError
        No certificate exists or none was found: unobservable modes that η does not cover, η too
        small for `condition`, noise that allows for systems that cannot be certified together.
    DdmheError, ShapeError, NotFiniteError, RankError
        Wrong arguments; a recording that does not determine (A, C).
    """
    if eta is not None:
        check_number("eta", eta, "a number in (0, 1)", lambda value: 0 < value < 1)
    if condition is not None:
        check_number("condition", condition, "a number above 1", lambda value: value > 1)
    if noise is not None:
        check_kind("noise", noise, RecordingNoise, "a RecordingNoise")
    allowed = _resolve(history, A, C, noise)
    if (e is None) != (r is None) or (e is not None and history is not None):
        raise DdmheError("e, r: expected both with A and C, or neither, found otherwise")
    known = None if e is None or r is None else _offsets(allowed, e, r)
    if gains is None:
        gains = (1.0, max(float(np.linalg.norm(allowed.C, 2)), 1e-300))
    if not isinstance(gains, tuple | list) or len(gains) != 2:
        raise DdmheError(f"gains: expected two positive numbers (w, v), found {shown(gains)}")
    for gain in gains:
        check_number("gains", gain, "two positive numbers (w, v)", lambda value: value > 0)
    if eta is None:
        eta = ETA if condition is None else _smallest_eta(allowed, condition)
    found = best_gains(allowed, eta, condition, gains)
    if found is None:
        raise InfeasibleError(_why_not(allowed, eta, condition, gains, noise))
    certificate = _certificate(allowed, *found, eta=eta, noise=noise, offsets=history is not None)
    if known is not None:
        return replace(certificate, e=known[0], r=known[1])
    return replace(
        certificate,
        identified=history is not None and noise is None and not _is_exact(history, allowed),
    )


def scalar_certificate(
    A: ArrayLike,
    C: ArrayLike,
    gain: ArrayLike,
    rho: float,
    mu: float,
    *,
    e: ArrayLike | None = None,
    r: ArrayLike | None = None,
) -> Certificate:
    """The scalar weights of (17) as a certificate, P = I, R = μI, Q = 3I, η = ρ, if `gain` L (n, p)
    satisfies (24).

    e, r are the offsets of the system, as in `ioss`.

    ‖A_L d - w + L(v - v̂)‖² ≤ 3‖A_L d‖² + 3‖w‖² + 3‖L(v - v̂)‖² with 6‖A_L‖² ≤ ρ, 6‖L‖² ≤ μ gives
    (L)."""
    A, C = system(A, C)
    L = array("gain", gain, (len(A), len(C)))
    check_finite("gain", L)
    check_number("rho", rho, "a number in (0, 1)", lambda value: 0 < value < 1)
    check_number("mu", mu, "a positive number", lambda value: value > 0)
    rho_0, mu_0 = 6 * np.linalg.norm(A + L @ C, 2) ** 2, 6 * np.linalg.norm(L, 2) ** 2
    if not rho_0 <= rho < 1:
        raise InfeasibleError(
            f"rho: expected a number in [{rho_0:.4g}, 1), which (24) asks for, found {rho}"
        )
    if not mu_0 <= mu:
        raise InfeasibleError(f"mu: expected at least {mu_0:.4g}, which (24) asks for, found {mu}")
    P, Q, R = np.eye(len(A)), 3.0 * np.eye(len(A)), mu * np.eye(len(C))
    residual = largest_eigenvalue(dissipation(A, C, P, Q, R, rho))
    if residual > 0:
        raise InfeasibleError(
            "gain: expected one for which the inequality holds, found its eigenvalue "
            f"{residual:.3g}"
        )
    if (e is None) != (r is None):
        raise DdmheError("e, r: expected both or neither, found one")
    certificate = Certificate(P, Q, R, rho, residual, A, C, growth=float(np.linalg.norm(A, 2)))
    if e is None or r is None:
        return certificate
    return replace(certificate, e=_vector("e", e, len(A)), r=_vector("r", r, len(C)))


# --- the system and its uncertainty


def _resolve(
    history: History | None, A: ArrayLike | None, C: ArrayLike | None, noise: RecordingNoise | None
) -> ConsistentSet:
    """The set of systems to certify; a single one has a root without columns."""
    given = recording_or_system(history, A, C)
    if isinstance(given, History):
        if noise is not None:
            return consistent_set(given, noise)
        model = identify(given)
        A_, e, C_, r = model.A, model.e, model.C, model.r
    else:
        if noise is not None:
            raise DdmheError("noise: expected a recording that it belongs to, found A and C")
        A_, C_ = given
        e, r = np.zeros(len(A_)), np.zeros(len(C_))
    n, p = len(A_), len(C_)
    return ConsistentSet(A_, e, C_, r, root=np.zeros((n + p, 0)), metric=np.zeros((n + 1, n + 1)))


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    vector = array(name, value, (size,))
    check_finite(name, vector)
    return vector


def _offsets(allowed: ConsistentSet, e: ArrayLike, r: ArrayLike) -> tuple[Array, Array]:
    return _vector("e", e, len(allowed.A)), _vector("r", r, len(allowed.C))


def _is_exact(history: History, model: ConsistentSet) -> bool:
    """Whether the recording is a trajectory of the model to rounding, with a sample to spare."""
    X, Z = samples(history)
    theta = np.vstack([model.A, model.C])
    residual = Z - X @ theta.T - np.concatenate([model.e, model.r])
    size = np.abs(Z).max(axis=0) + np.abs(theta) @ np.abs(X).max(axis=0)
    return len(X) > history.n + 1 and bool((np.abs(residual) <= TRAJECTORY * size).all())


def _matching(P: Array, A: Array, R: Array, C: Array) -> None:
    if P.shape != A.shape or len(R) != len(C):
        raise ShapeError(
            f"A, C: expected n = {len(P)}, p = {len(R)}, found n = {len(A)}, p = {len(C)}"
        )


def _certificate(
    allowed: ConsistentSet,
    P: Array,
    Q: Array,
    R: Array,
    residual: float,
    optimised: bool,
    *,
    eta: float,
    noise: RecordingNoise | None,
    offsets: bool,
) -> Certificate:
    n = len(P)
    root_P, root_Q, root_R = (scipy.linalg.cholesky(M) for M in (P, Q, R))
    inverse = scipy.linalg.solve_triangular(root_P, np.eye(n))
    growth = float(np.linalg.norm(root_P @ allowed.A @ inverse, 2))
    uncertainty = None
    if noise is not None:
        spread = float(
            np.linalg.norm(root_P @ allowed.root[:n], 2)
            * np.linalg.norm(root(allowed.shape) @ inverse, 2)
        )
        growth += spread
        w, v = (
            float(np.linalg.norm(U @ q, 2))
            for U, q in ((root_Q, allowed.root[:n]), (root_R, allowed.root[n:]))
        )
        uncertainty = Uncertainty(allowed.metric, w, v)
    e, r = (allowed.e, allowed.r) if offsets else (None, None)
    return Certificate(
        P, Q, R, eta, residual, allowed.A, allowed.C, e, r, growth, uncertainty, noise, optimised
    )


def _smallest_eta(allowed: ConsistentSet, condition: float) -> float:
    """Smallest η, to 1e-3, at which cond P ≤ condition is possible: bisection."""
    lo, hi = 0.0, 1.0 - 1e-4
    if best_gains(allowed, hi, condition, (1.0, 1.0)) is None:
        raise InfeasibleError(
            f"condition: expected a bound on cond P that some eta below {hi} can meet, found "
            f"{condition:g}"
        )
    while hi - lo > 1e-3:
        middle = 0.5 * (lo + hi)
        lo, hi = (
            (lo, middle) if best_gains(allowed, middle, condition, (1.0, 1.0)) else (middle, hi)
        )
    return hi


def _why_not(
    allowed: ConsistentSet,
    eta: float,
    condition: float | None,
    gains: tuple[float, float],
    noise: RecordingNoise | None,
) -> str:
    """Why there is no certificate, in words."""
    modes = unobservable_modes(allowed.A, allowed.C)
    slow = max((abs(z) for z in modes), default=0.0)
    if slow**2 >= eta:
        if slow >= 1:
            return (
                f"A, C: expected a detectable pair, found a mode of magnitude {slow:.6g} that no "
                "output shows: no certificate exists"
            )
        return (
            f"eta: expected more than {slow**2:.6g}, the square of the unobservable mode "
            f"{slow:.6g}, found {eta:g}"
        )
    if noise is not None:
        share = _certifiable_share(allowed, eta, condition, gains)
        return (
            f"noise: expected a size that leaves systems which one certificate with eta = {eta:g} "
            f"can cover, found a set of consistent systems that would have to be {share:.2g} times "
            "as wide; state less noise, record more motion or raise eta"
        )
    if condition is not None:
        return f"eta: expected a larger one for cond P of at most {condition:g}, found {eta:g}"
    return (
        "A, C: expected a pair whose certificate survives rounding, found one too badly observable "
        f"at eta = {eta:g}"
    )


def _certifiable_share(
    allowed: ConsistentSet, eta: float, condition: float | None, gains: tuple[float, float]
) -> float:
    """Largest width that can be certified, relative to the set's own about its centre: to 10 %, at
    least 1e-3."""
    lo, hi = math.log(1e-3), 0.0
    while hi - lo > 0.1:
        middle = 0.5 * (lo + hi)
        narrower = replace(allowed, root=math.exp(middle) * allowed.root)
        lo, hi = (
            (lo, middle) if best_gains(narrower, eta, condition, gains) is None else (middle, hi)
        )
    return math.exp(lo)


# --- small mathematics


def _least_bound(prior: float, candidate: float, noise: float, motion: float) -> float:
    """√ of min over K > 1 of K(2 prior + candidate) + 2K/(2K-1) prior + K/(K-1) noise + motion."""

    def bound(log_excess: float) -> float:
        excess = math.exp(log_excess)
        K = 1.0 + excess
        return (
            K * (2 * prior + candidate) + 2 * K / (2 * K - 1) * prior + K / excess * noise + motion
        )

    best = minimize_scalar(bound, bounds=(-30.0, 30.0), method="bounded")
    return math.sqrt(min(bound(float(best.x)), bound(-30.0)))
