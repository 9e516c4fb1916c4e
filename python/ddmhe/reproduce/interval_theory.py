"""The statements of the interval paper's Sections 2 and 3 and of its appendix, each decided by a
computation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddmhe.reproduce.claims import Claim, holds_if
from ddmhe.reproduce.tol import NO_MISFIT

Array = NDArray[np.float64]

__all__ = [
    "claims",
    "equality",
    "from_norm",
    "mean_value_point",
    "reduced_as_printed",
    "worst_single_step",
]


def equality(pairs: int = 1000, seed: int = 0) -> tuple[float, float]:
    """(15), (16) for the pendulum's f: largest |left - right| and how far J leaves [J̲, J̄], over
    random pairs a, b.

    J = ∫ Df(b + s(a-b)) ds gives Δf = J(a-b), so both hold with equality, whatever the sign of a
    and b."""
    rng = np.random.default_rng(seed)
    apart, outside = 0.0, 0.0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for _ in range(pairs):
        a, b = rng.uniform(-np.pi, np.pi, (2, 2))
        d = a - b
        delta = np.array([0.0, -0.065 * (np.sin(a[0]) - np.sin(b[0]))])
        mean = 0.5 * float(weights @ np.cos(b[0] + 0.5 * (nodes + 1) * d[0]))
        J = np.array([[0.0, 0.0], [-0.065 * mean, 0.0]])
        apart = max(apart, abs(delta @ d - d @ J @ d), abs(delta @ delta - d @ J.T @ J @ d))
        outside = max(outside, abs(J[1, 0]) - 0.065)
    return apart, outside


def worst_single_step(lam: float = 0.9) -> tuple[float, float, float]:
    """‖e‖² for Ã = 0, D1 = I (n = 2), no v, |w| ≤ 1, and what (24) allows with w̄ᵀw̄ and with max
    w̄² in its place.

    P = γI with γ = μw = μv = 1/√(2λ) satisfies (22) and (23) for f = 0; V0 = 0.
    """
    gamma = 1 / np.sqrt(2 * lam)
    mu = 2 * gamma
    w = np.ones(2)
    return float(w @ w), float(mu * gamma * (w @ w)), float(mu * gamma * w.max() ** 2)


def from_norm(phi: float) -> float:
    """The largest |e(i)| that ‖e‖₂ ≤ φ², (43) as printed, allows; it concludes |e(i)| ≤ φ."""
    return phi**2


def mean_value_point(points: int = 100_000) -> float:
    """(51) for f(x) = (cos x1, sin x1) from x̂ = 0 to x = (2π, 0): smallest ‖Δf - Df(x')(x - x̂)‖
    over x' between."""
    s = np.linspace(0, 2 * np.pi, points)
    slope = 2 * np.pi * np.stack([-np.sin(s), np.cos(s)])  # Df(x')(x - x̂); Δf = 0
    return float(np.linalg.norm(slope, axis=0).min())


def reduced_as_printed(M: Array, q: int) -> Array:
    """↓q of the appendix as printed, without absolute values: (n, m) to (n, q)."""
    n = len(M)
    ordered = M[:, np.argsort(-np.linalg.norm(M, axis=0), kind="stable")]
    return np.hstack([ordered[:, : q - n], np.diag(ordered[:, q - n :].sum(axis=1))])


def claims(phi: float) -> list[Claim]:
    """Verdicts; `phi` is the φ0 that the example prints."""
    apart, outside = equality()
    square, sum_allows, max_allows = worst_single_step()
    allowed = from_norm(phi)
    missed = mean_value_point()
    M = np.array([[2.0, 1.0, -1.0]])
    printed, true = float(np.abs(reduced_as_printed(M, 2)).sum()), float(np.abs(M).sum())
    return [
        Claim(
            "Interval paper, 2.2, (15), (16)",
            "Some J in [J̲, J̄] satisfies both inequalities",
            "",
            f"J = ∫Df: both with equality to {apart:.0e} over 1000 pairs of the pendulum, J at "
            f"most {max(outside, 0.0):.0e} outside",
            holds_if(apart < 1e-12 and outside < 1e-15),
            "with equality, so the relaxation by a, b and U in (22) is not needed: an inequality "
            "affine in J at the vertices",
        ),
        Claim(
            "Interval paper, 3.1, (24)",
            "‖e_k‖² ≤ μ(λ(1-λ)^k V0 + μw w̄² + μv v̄²)",
            "w̄², v̄²",
            f"Ã = 0, λ = 0.9, w̄ = (1, 1): ‖e‖² = {square:.3g}; w̄² as w̄ᵀw̄ allows "
            f"{sum_allows:.3g}, as (max w̄)² {max_allows:.3g}",
            "holds with …" if max_allows < square <= sum_allows else holds_if(square <= max_allows),
            "with w̄ᵀw̄ and v̄ᵀv̄, as (38) has it: w̄ is a vector; and with V0 at its largest over "
            "the initial box, since e0 is unknown",
        ),
        Claim(
            "Interval paper, 3.1, (43)",
            "‖e_k‖₂ ≤ φ_k² gives |e_k(i)| ≤ φ_k",
            "φ_k²",
            f"φ0 = {phi:g}: e = ({allowed:.4g}, 0) satisfies the left side",
            "holds with …" if allowed > phi else "holds",
            "with ‖e_k‖₂² on the left; as printed it fails wherever φ_k > 1",
        ),
        Claim(
            "Interval paper, 3.2, (51)",
            "f(x) = f(x̂) + Df(x')(x - x̂) for one point x' between",
            "",
            f"f(x) = (cos x1, sin x1) over 2π: misses by at least {missed:.3g} for every x'",
            "holds with …" if missed > NO_MISFIT else "holds",
            "with a point of its own for every row of f. The zonotope (53) to (55) encloses row by "
            "row, so it stands; the pendulum's f has one row",
        ),
        Claim(
            "Interval paper, 2.1, (4), and its appendix",
            "⟨p, M⟩ ⊆ ⟨p, ↓q(M)⟩",
            "M²(i,i) = Σ_j M(i,j)",
            f"M = [2, 1, -1], q = 2: radius {printed:g} instead of {true:g}",
            "holds with …" if printed < true else "holds",
            "with |M(i,j)| in the sum: columns of unlike sign cancel without",
        ),
    ]
