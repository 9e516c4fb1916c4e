"""Stability certificates: P, Q, R and η for which the estimation error is known to shrink, verified
by eigenvalues.

For the difference d of two trajectories, d⁺ = A d - w, the inequality

    ‖d⁺‖²_P ≤ η‖d‖²_P + ‖w‖²_Q + ‖C d‖²_R    ⟺    [[AᵀPA - ηP - CᵀRC, AᵀP], [PA, P - Q]] ⪯ 0
    (L)

makes ‖d‖²_P an incremental input/output-to-state Lyapunov function (Schiller, Muntwiler, Köhler,
Zeilinger, Müller 2023). It exists for every observable pair and every η in (0, 1), also where (24)
of Liu et al. 2026 is impossible. Known inputs are the same in both trajectories and leave the
difference: (L) knows nothing of B and D, and an error bound only through the windows' residuals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from ddmhe._core import DdmheError, ShapeError, minimum_horizon
from ddmhe.checks import check_number, check_whole
from ddmhe.design.arguments import system
from ddmhe.design.dissipation import (
    condition_number,
    dissipation,
    extremes,
    largest_eigenvalue,
    root,
)
from ddmhe.design.uncertainty import RecordingNoise

Array = NDArray[np.float64]

__all__ = ["Certificate", "Uncertainty"]

MOST_STEPS = 10_000_000
"""Steps whose bounds fit into memory."""


@dataclass(frozen=True)
class Uncertainty:
    """‖ΔA x + ΔB u + Δe‖_Q ≤ w q, ‖ΔC x + ΔD u + Δr‖_R ≤ v q, q² = [x; u; 1]ᵀ metric [x; u; 1], for
    every consistent system."""

    metric: Array
    """(n+m+1, n+m+1)"""
    w: float
    v: float


@dataclass(frozen=True, eq=False)
class Certificate:
    """P, Q, R, η that satisfy (L), in the user's units; the estimator takes it as `DdMhe(h,
    certificate=c)`.

    Examples
    --------
    >>> import ddmhe
    >>> history = ddmhe.models.spin_down().simulate(4.0, 0.02).history(150)
    >>> certificate = ddmhe.design.ioss(history, eta=0.95)
    >>> certificate.eta, certificate.residual <= 0
    (0.95, True)
    >>> estimator = ddmhe.DdMhe(history, certificate=certificate)
    """

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
    B: Array | None = None
    """(n, m) of the model; None without inputs. An estimator over a recording with inputs asks for
    B and D beside A and C."""
    D: Array | None = None
    """(p, m)"""

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
        n = len(self.P)
        inverse = scipy.linalg.solve_triangular(scipy.linalg.cholesky(self.P), np.eye(n))
        spread = self.uncertainty.v * np.linalg.norm(
            root(self.uncertainty.metric[:n, :n]) @ inverse, 2
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


def _matching(P: Array, A: Array, R: Array, C: Array) -> None:
    if P.shape != A.shape or len(R) != len(C):
        raise ShapeError(
            f"A, C: expected n = {len(P)}, p = {len(R)}, found n = {len(A)}, p = {len(C)}"
        )


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
