"""Peak-to-peak design of the observer's gain: (41), (23), (42), and the exact vertex inequality;
proved before use.

With V = eᵀPe and e⁺ = (A - LC + J) e + G d, d = (w, v), G = [D1, -L D2], at every vertex J of
[j_lo, j_hi]

    V⁺ <= (1 - λ) V + γ (‖w‖² + ‖v‖²)                      (41)
    ‖S e‖² <= (μw + μv)(λ V + (μw - γ)‖w‖² + (μv - γ)‖v‖²)    (23)

give ‖S e_k‖² <= (μw + μv)(λ(1-λ)^k V_0 + μw ‖w‖² + μv ‖v‖²), (44) with S = I in the paper. By a
Schur complement (41) is affine in J, so its vertices suffice ("exact"). The paper's own inequality
("paper") carries f by a multiplier instead and gives up a little."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, InfeasibleError
from ddmhe.checks import check_kind, check_number, choice
from ddmhe.design.solver import solve
from ddmhe.interval.systems import System, matrix, radius_of

Array = NDArray[np.float64]
Lmi = Literal["paper", "exact"]

__all__ = ["ObserverDesign", "design_observer", "fixed_gain", "kalman_gain", "steady_gain"]

MARGIN = 1e-9
"""Relative margin of the strict inequalities, and inflation of γ after it was proved."""
MOST = 1024
"""Most vertices of [j_lo, j_hi] that are written out."""


@dataclass(frozen=True, eq=False)
class ObserverDesign:
    """A gain with its peak-to-peak bound.

    Examples
    --------
    >>> import ddmhe
    >>> design = ddmhe.interval.design_observer(ddmhe.interval.pendulum())
    >>> design.mu == design.mu_w + design.mu_v, design.verified
    (True, True)
    """

    gain: Array
    """L (n, p)"""
    P: Array
    """(n, n), symmetric positive definite"""
    lam: float
    """λ of (41)"""
    gamma: float
    """γ of (41), as proved for this P and L; infinite if not `verified`."""
    mu_w: float
    """μw of (23), as the semidefinite programme returned it, or γ where that is larger"""
    mu_v: float
    """μv of (23)"""
    verified: bool
    """Whether eigenvalues confirm (41) at every vertex and (23). Otherwise there is no peak-to-peak
    bound."""
    slack: float
    """Smallest eigenvalue left over all inequalities, relative to their size; not negative if
    verified."""
    weights: Array
    """Diagonal of S (n,): the bound is on ‖S e‖."""
    lmi: str
    """"paper", "exact" or "given gain"."""

    @property
    def mu(self) -> float:
        """μw + μv."""
        return self.mu_w + self.mu_v


def design_observer(
    system: System,
    lam: float | None = None,
    *,
    lmi: Lmi = "exact",
    weights: ArrayLike | None = None,
) -> ObserverDesign:
    """The gain that minimises μw + μv, and the proof of its bound.

    Parameters
    ----------
    system : System
        With finite j_lo and j_hi.
    lam : float in (0, 1), optional
        λ of (41); None searches for the one with the smallest μw + μv.
    lmi : "exact" or "paper"
        The vertex inequality, or (42) as printed (with U n×n).
    weights : array (n,), optional
        S: how much an error of each state counts, for states of different units. Default ones.

    Raises
    ------
    InfeasibleError
        No gain satisfies the inequalities: in words, what to change.
    DdmheError, ShapeError
        Wrong arguments, or more than 1024 vertices.

    Examples
    --------
    >>> import ddmhe
    >>> design = ddmhe.interval.design_observer(ddmhe.interval.pendulum())
    >>> design.verified, design.gain.shape
    (True, (2, 1))
    """
    if not isinstance(system, System):
        raise DdmheError(f"system: expected a ddmhe.interval.System, found {type(system).__name__}")
    choice("lmi", lmi, ("exact", "paper"))
    S = np.ones(system.n) if weights is None else matrix("weights", weights, (system.n,))
    if (S <= 0).any():
        raise DdmheError(f"weights: expected positive numbers, found {S.min()}")
    if not np.isfinite([system.j_lo, system.j_hi]).all():
        raise DdmheError("j_lo, j_hi: expected finite bounds for a design, found infinite ones")
    free = int((system.j_lo < system.j_hi).sum())
    if 1 << free > MOST:
        raise DdmheError(
            f"j_lo, j_hi: expected at most 10 entries that differ ({MOST} vertices), found {free}"
        )
    if lam is not None:
        check_number("lam", lam, "a number in (0, 1)", lambda v: 0 < v < 1)
        return _designed(system, float(lam), lmi, S)
    return _searched(system, lmi, S)


def fixed_gain(system: System, gain: ArrayLike) -> ObserverDesign:
    """A gain (n, p) of one's own without a peak-to-peak bound: zonotope and box stay guaranteed,
    whatever the gain.

    Examples
    --------
    >>> import ddmhe
    >>> design = ddmhe.interval.fixed_gain(ddmhe.interval.pendulum(), [[0.5], [0.5]])
    >>> design.verified
    False
    """
    check_kind("system", system, System, "a ddmhe.interval.System")
    L = matrix("gain", gain, (system.n, system.p))
    none = float("inf")
    return ObserverDesign(
        L, np.eye(system.n), 0.5, none, none, none, False, none, np.ones(system.n), "given gain"
    )


def kalman_gain(system: System, w_radius: ArrayLike, v_radius: ArrayLike) -> Array:
    """Gain (n, p) of the steady Kalman filter at the middle of [j_lo, j_hi], with the radii as
    standard deviations.

    Examples
    --------
    >>> import ddmhe
    >>> ddmhe.interval.kalman_gain(ddmhe.interval.pendulum(), w_radius=0.006, v_radius=0.01).shape
    (2, 1)
    """
    check_kind("system", system, System, "a ddmhe.interval.System")
    w = radius_of("w_radius", w_radius, system.D1.shape[1])
    v = radius_of("v_radius", v_radius, system.D2.shape[1])
    if not np.isfinite([system.j_lo, system.j_hi]).all():
        raise DdmheError("j_lo, j_hi: expected finite bounds for a gain, found infinite ones")
    middle = system.A + 0.5 * (system.j_lo + system.j_hi)
    return steady_gain(middle, system.C, w, v, system.D1, system.D2)


def steady_gain(
    A: Array, C: Array, w: Array, v: Array, D1: Array | None = None, D2: Array | None = None
) -> Array:
    """Predictor gain A P Cᵀ (C P Cᵀ + R)⁻¹; a small floor keeps the covariances regular."""
    Q = _covariance(np.eye(len(A)) if D1 is None else D1, w)
    R = _covariance(np.eye(len(C)) if D2 is None else D2, v)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            P = scipy.linalg.solve_discrete_are(A.T, C.T, Q, R)
            gain = np.asarray(A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + R))
    except (np.linalg.LinAlgError, ValueError) as e:
        raise DdmheError(
            f"gain: expected a system with a steady Kalman filter, found none ({e}); give a gain"
        ) from e
    if not np.isfinite(gain).all():
        raise DdmheError(
            "gain: expected a system with a steady Kalman filter, found one beyond floats; give a "
            "gain"
        )
    return gain


def _covariance(D: Array, radius: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        covariance: Array = D @ np.diag(radius**2) @ D.T
    floor = 1e-12 * max(float(np.trace(covariance)) / len(D), 1e-12)
    return np.asarray(covariance + floor * np.eye(len(D)))


def _searched(system: System, lmi: Lmi, S: Array) -> ObserverDesign:
    """The best λ: a coarse grid, then Brent's method about its best point."""
    found: dict[float, ObserverDesign] = {}

    def cost(lam: float) -> float:
        try:
            found[lam] = _designed(system, lam, lmi, S)
        except InfeasibleError:
            return np.inf
        return found[lam].mu

    grid = [0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85]
    costs = [cost(lam) for lam in grid]
    if not np.isfinite(costs).any():
        raise InfeasibleError(_advice("any λ", system))
    k = int(np.argmin(costs))
    ends = (
        grid[max(k - 1, 0)] if k else 1e-3,
        grid[min(k + 1, len(grid) - 1)] if k + 1 < len(grid) else 0.99,
    )
    scipy.optimize.minimize_scalar(
        cost, bounds=ends, method="bounded", options={"xatol": 1e-3, "maxiter": 12}
    )
    return min(found.values(), key=lambda design: design.mu)


def _designed(system: System, lam: float, lmi: Lmi, S: Array) -> ObserverDesign:
    """One semidefinite programme in the coordinates z = S x, and its proof."""
    import cvxpy as cp

    T, T_inv = np.diag(S), np.diag(1 / S)
    A, C, D1, D2 = T @ system.A @ T_inv, system.C @ T_inv, T @ system.D1, system.D2
    vertices = [T @ J @ T_inv for J in system.vertices()]
    n, p = D1.shape[0], len(C)
    n_w, n_v = D1.shape[1], D2.shape[1]
    P = cp.Variable((n, n), symmetric=True)
    W = cp.Variable((n, p))
    gamma, mu_w, mu_v = cp.Variable(), cp.Variable(), cp.Variable()
    I_w, I_v, I_n = np.eye(n_w), np.eye(n_v), np.eye(n)
    constraints: list[Any] = []
    if lmi == "exact":
        for J in vertices:
            lower = [
                [(lam - 1) * P],
                [np.zeros((n_w, n)), -gamma * I_w],
                [np.zeros((n_v, n)), np.zeros((n_v, n_w)), -gamma * I_v],
                [P @ (A + J) - W @ C, P @ D1, -W @ D2, -P],
            ]
            constraints.append(_symmetric(lower) << 0)
    else:
        U, a, b = cp.Variable((n, n)), cp.Variable(), cp.Variable()
        for J in vertices:
            lower = [
                [(lam - 1) * P + a * (J + J.T)],
                [-a * I_n, -b * I_n],
                [np.zeros((n_w, 2 * n)), -gamma * I_w],
                [np.zeros((n_v, 2 * n + n_w)), -gamma * I_v],
                [P @ A - W @ C, P, P @ D1, -W @ D2, -P],
                [U @ J, np.zeros((n, 2 * n + n_w + n_v)), b * I_n - U - U.T],
            ]
            constraints.append(_symmetric(lower) << 0)
    peak = [
        [lam * P],
        [np.zeros((n_w, n)), (mu_w - gamma) * I_w],
        [np.zeros((n_v, n)), np.zeros((n_v, n_w)), (mu_v - gamma) * I_v],
        [I_n, np.zeros((n, n_w)), np.zeros((n, n_v)), (mu_w + mu_v) * I_n],
    ]
    constraints.append(_symmetric(peak) >> 0)
    problem = cp.Problem(cp.Minimize(mu_w + mu_v), constraints)
    if not solve(problem) or P.value is None:
        raise InfeasibleError(_advice(f"λ = {lam:g}", system))
    P_z = 0.5 * (P.value + P.value.T)
    if np.linalg.eigvalsh(P_z)[0] <= 0:
        raise InfeasibleError(_advice(f"λ = {lam:g}", system))
    L_z = np.linalg.solve(P_z, W.value)
    proved = _smallest_gamma(A - L_z @ C, vertices, np.hstack([D1, -L_z @ D2]), P_z, lam)
    if proved is None:
        raise InfeasibleError(
            _advice(f"λ = {lam:g}", system) + " (the solver's answer does not pass the eigenvalues)"
        )
    bound, slack = proved
    mus = [max(float(mu.value), bound) for mu in (mu_w, mu_v)]
    # (23) by its Schur complement: λP >= I/(μw + μv), besides μw, μv >= γ
    least = (1 + MARGIN) / (lam * float(np.linalg.eigvalsh(P_z)[0]))
    if sum(mus) < least:
        mus = [mu * least / sum(mus) for mu in mus]
    return ObserverDesign(T_inv @ L_z, T @ P_z @ T, lam, bound, mus[0], mus[1], True, slack, S, lmi)


def _symmetric(lower: list[list[Any]]) -> Any:
    """The symmetric block matrix whose lower triangle is given; a block may span several columns of
    zeros."""
    import cvxpy as cp

    rows = [cp.hstack(row) for row in lower]
    size = sum(row.shape[0] for row in rows)
    padded = [_widened(row, size) for row in rows]
    whole = cp.vstack(padded)
    mask = np.zeros((size, size))
    at = 0
    for row in rows:
        mask[at : at + row.shape[0], at : at + row.shape[0]] = (
            0.5  # diagonal blocks stand once, are symmetric
        )
        mask[at : at + row.shape[0], :at] = 1.0
        at += row.shape[0]
    half = cp.multiply(mask, whole)
    return half + half.T


def _widened(row: Any, size: int) -> Any:
    import cvxpy as cp

    missing = size - row.shape[1]
    return cp.hstack([row, np.zeros((row.shape[0], missing))]) if missing else row


def _smallest_gamma(
    closed: Array, vertices: list[Array], G: Array, P: Array, lam: float
) -> tuple[float, float] | None:
    """The smallest γ, slightly inflated, for which eigenvalues confirm (41) at every vertex, and
    what they leave.

    Bisection on γ with P and L fixed: [[(1-λ)P, 0], [0, γI]] - [A_i, G]ᵀ P [A_i, G] >= 0. None if
    no γ will do."""
    n, m = G.shape
    root = scipy.linalg.cholesky(P, lower=False)

    def slack(gamma: float) -> float:
        worst = np.inf
        for J in vertices:
            map_ = np.hstack([root @ (closed + J), root @ G])
            left = scipy.linalg.block_diag((1 - lam) * P, gamma * np.eye(m)) - map_.T @ map_
            # congruence with the size of each variable: the sign stays, the scale is one
            scale = np.concatenate([1 / np.sqrt(np.diag(P)), np.full(m, 1 / np.sqrt(gamma))])
            worst = min(worst, float(np.linalg.eigvalsh(scale[:, None] * left * scale)[0]))
        return float(worst - 100 * (n + m) * np.finfo(float).eps)

    low, high = 0.0, max(float(np.trace(G.T @ P @ G)), 1e-300)
    for _ in range(200):
        if slack(high) >= 0:
            break
        low, high = high, 2 * high
        if not np.isfinite(high):
            return None
    else:
        return None
    while high - low > MARGIN * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if slack(middle) >= 0 else (middle, high)
    high *= 1 + MARGIN
    return high, slack(high)


def _advice(at: str, system: System) -> str:
    free = int((system.j_lo < system.j_hi).sum())
    return (
        f"lam: expected a gain that satisfies (41) at all {1 << free} vertices of [j_lo, j_hi], "
        f"found none for {at}; "
        "a smaller λ, narrower j_lo and j_hi, or another output may help; `fixed_gain` needs no "
        "such proof"
    )
