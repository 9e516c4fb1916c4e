"""The inequality of a certificate and the semidefinite programme that proposes one; eigenvalues
have the last word.

For every [A; C] = [A_c; C_c] + Δ^½ Γ H^-½, ‖Γ‖ ≤ 1 (see `uncertainty`), the inequality (L) of
`certificate` is a quadratic one in (d, q, w) with q = Δ^½ s, ‖s‖² ≤ dᵀH⁻¹d. By the S-lemma,
lossless for one quadratic constraint, it holds for all of them if and only if

    Φ = FᵀPF - η E_dᵀPE_d - GᵀRG - E_wᵀQE_w + τ(E_dᵀH⁻¹E_d - E_sᵀE_s) ⪯ 0 for some τ ≥ 0,
    F = [A_c, [I 0]Δ^½, I],  G = [C_c, [0 I]Δ^½, 0]  on (d, s, w).

One implementation serves both: without uncertainty there is no s.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ddmhe.design.solver import solve
from ddmhe.design.tol import CONDITION, INFLATIONS, MARGINS, NONZERO, POSITIVE_R
from ddmhe.design.uncertainty import ConsistentSet

Array = NDArray[np.float64]

__all__ = [
    "best_gains",
    "condition_number",
    "dissipation",
    "extremes",
    "largest_eigenvalue",
    "root",
]


# --- the inequality


def _operators(system: ConsistentSet) -> tuple[Array, Array]:
    """[A_c, [I 0]Δ^½] and [C_c, [0 I]Δ^½]: next difference and output difference from (d, s)."""
    n = len(system.A)
    return np.hstack([system.A, system.root[:n]]), np.hstack([system.C, system.root[n:]])


def _storage(system: ConsistentSet, P: Any, R: Any, tau: Any, eta: float) -> Any:
    """S = -Φ restricted to w = 0; NumPy arrays or cvxpy expressions."""
    F, G = _operators(system)
    n, k = len(system.A), system.root.shape[1]
    E = np.eye(n, n + k)
    allowed = E.T @ system.shape @ E - np.diag([0.0] * n + [1.0] * k)
    S = eta * E.T @ P @ E + G.T @ R @ G - F.T @ P @ F
    return S - tau * allowed if k else S


def _inequality(system: ConsistentSet, P: Any, Q: Any, R: Any, tau: Any, eta: float) -> Any:
    """-Φ on (d, s, w): positive semidefinite if and only if (L) holds for every system of the
    set."""
    import cvxpy as cp

    F, _ = _operators(system)
    S, cross = _storage(system, P, R, tau, eta), -F.T @ P
    if isinstance(S, np.ndarray):
        return np.block([[S, cross], [cross.T, Q - P]])
    return cp.bmat([[S, cross], [cross.T, Q - P]])


def dissipation(A: Array, C: Array, P: Array, Q: Array, R: Array, eta: float) -> Array:
    """The matrix of (L)."""
    return np.block([[A.T @ P @ A - eta * P - C.T @ R @ C, A.T @ P], [P @ A, P - Q]])


def largest_eigenvalue(M: Array) -> float:
    """Of the symmetric part."""
    return float(np.linalg.eigvalsh(_symmetric(M))[-1])


# --- the design


def _transformed(system: ConsistentSet, T: Array, inverse: Array, c: float) -> ConsistentSet:
    """The set in coordinates d = T z, outputs divided by c."""
    left = scipy.linalg.block_diag(inverse, np.eye(len(system.C)) / c)
    n = len(T)
    metric = np.zeros_like(system.metric)
    metric[:n, :n] = T.T @ system.shape @ T
    return replace(
        system, A=inverse @ system.A @ T, C=system.C @ T / c, root=left @ system.root, metric=metric
    )


def _balance(system: ConsistentSet, eta: float) -> Array | None:
    """P₀ from the Riccati equation of the filter for (A/√η, C); it satisfies (L) itself, with R =
    ηI and some Q.

    Σ = P₀⁻¹ = Ā(P₀ + CᵀC)⁻¹Āᵀ + W with W ≻ 0 means AᵀP₀A ≺ η(P₀ + CᵀC). None when the equation has
    no solution."""
    scale = float(np.linalg.norm(system.C, 2)) or 1.0
    A, C = system.A / math.sqrt(eta), system.C / scale
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sigma = scipy.linalg.solve_discrete_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
            P = np.linalg.inv(sigma)
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = _symmetric(P)
    return P if np.isfinite(P).all() and np.linalg.eigvalsh(P)[0] > 0 else None


def best_gains(
    system: ConsistentSet, eta: float, condition: float | None, gains: tuple[float, float]
) -> tuple[Array, Array, Array, float, bool] | None:
    """(P, Q, R, residual, optimised) in the user's units, verified; None if none was found.

    Not optimised is the Riccati solution, which stands in where rounding refutes every solution of
    the programme."""
    P_0 = _balance(system, eta)
    if P_0 is None:
        return None
    scale = float(np.linalg.norm(system.C, 2)) or 1.0
    values, vectors = np.linalg.eigh(P_0)
    T = vectors / np.sqrt(values)  # TᵀP₀T = I
    inverse = np.linalg.inv(T)
    balanced = _transformed(system, T, inverse, scale)
    for margin in MARGINS:
        found = _programme(
            balanced, T, inverse, eta, condition, (gains[0], gains[1] / scale), margin
        )
        if found is None:
            break  # a larger margin asks for more
        P, R, tau = found
        verified = _verified(system, inverse.T @ P @ inverse, R / scale**2, tau, eta)
        if verified is not None and (
            condition is None or condition_number(verified[0]) <= condition * (1 + CONDITION)
        ):
            return *verified, True
    if system.root.shape[1]:
        return None
    verified = _verified(system, P_0, eta * np.eye(len(system.C)) / scale**2, 0.0, eta)
    if verified is None or (condition is not None and condition_number(verified[0]) > condition):
        return None
    return *verified, False


def _programme(
    system: ConsistentSet,
    T: Array,
    inverse: Array,
    eta: float,
    condition: float | None,
    gains: tuple[float, float],
    margin: float,
) -> tuple[Array, Array, float] | None:
    """P, R, τ of the programme in balanced coordinates; None unless the solver calls them (nearly)
    optimal."""
    import cvxpy as cp

    n, p = len(system.A), len(system.C)
    P, Q = cp.Variable((n, n), symmetric=True), cp.Variable((n, n), symmetric=True)
    R = cp.Variable((p, p), symmetric=True)
    tau = cp.Variable(nonneg=True)
    unit = T.T @ T  # P ⪰ I in the user's coordinates
    size = max(float(np.linalg.norm(unit, 2)), NONZERO)
    kept = n + system.root.shape[1]
    floor = margin * scipy.linalg.block_diag(np.eye(kept), np.zeros((n, n)))
    constraints = [
        _symmetric(_inequality(system, P, Q, R, tau, eta)) >> floor,
        R >> POSITIVE_R * np.eye(p),
        P >> unit / size,
    ]
    if condition is not None:
        constraints.append(P << condition * unit / size)
    weight = inverse @ inverse.T  # trace of the user's Q = trace of weight Q
    length = float(np.linalg.norm(weight, 2))
    cost = (
        gains[0] ** 2 * cp.trace(weight / length @ Q) / n
        + gains[1] ** 2 * cp.trace(R) * (1 / length) / n
    )
    problem = cp.Problem(cp.Minimize(cost), constraints)
    if not solve(problem) or P.value is None or R.value is None:
        return None
    return P.value * size, R.value * size, float(tau.value) * size if system.root.shape[1] else 0.0


def _symmetric(M: Any) -> Any:
    return 0.5 * (M + M.T)


def _verified(
    system: ConsistentSet, P: Array, R: Array, tau: float, eta: float
) -> tuple[Array, Array, Array, float] | None:
    """P, Q, R, residual with the inequality confirmed by eigenvalues in the user's units; None if
    they deny it.

    Q is computed anew: with S ≻ 0 the smallest Q is P + PF S⁻¹ FᵀP (Schur complement). A little
    more of Q keeps the eigenvalues away from zero by more than rounding."""
    P, R = _symmetric(P), _symmetric(R)
    smallest = float(np.linalg.eigvalsh(P)[0])
    if not smallest > 0 or not float(np.linalg.eigvalsh(R)[0]) > 0:
        return None
    P, R, tau = P / smallest, R / smallest, tau / smallest
    F, _ = _operators(system)
    S = _symmetric(_storage(system, P, R, tau, eta))
    if not float(np.linalg.eigvalsh(S)[0]) > 0:
        return None
    Q = _symmetric(P + P @ F @ np.linalg.solve(S, F.T @ P))
    for more in INFLATIONS:
        inflated = Q + more * np.eye(len(Q)) * float(np.trace(Q)) / len(Q)
        residual = -float(
            np.linalg.eigvalsh(_symmetric(_inequality(system, P, inflated, R, tau, eta)))[0]
        )
        if residual <= 0:
            return P, inflated, R, residual
    return None


def extremes(M: Array) -> tuple[float, float]:
    """Smallest and largest eigenvalue of a symmetric matrix."""
    values = np.linalg.eigvalsh(M)
    return float(values[0]), float(values[-1])


def condition_number(M: Array) -> float:
    """Of a symmetric positive definite matrix."""
    lo, hi = extremes(M)
    return hi / lo


def root(M: Array) -> Array:
    """U with UᵀU = M for a positive semidefinite M."""
    values, vectors = np.linalg.eigh(M)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T)
