"""The statements of Liu et al. 2026, Sections II-B, III-B and the appendix, each decided by a
computation.

The example against (25), (31) and (34) satisfies everything that the paper asks for, and the 6 ≤ μ
that its proof of (19) needs besides: A = [[1, 10], [0, 1]], C = 1000 I, L = -A/1000, so that A_L =
0; ρ = 0.05, μ = 6, M = 3, no noise, the prior is right, and one disturbance of size 1 enters x2. A
window that contains it is no trajectory of the noise-free system: the candidate of the proof of
Theorem 1 is not feasible for M ≥ 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import models
from ddmhe._core import DdMhe, Exact, History
from ddmhe.cases import satellite as case
from ddmhe.design import ioss, pole_placement, scalar_certificate
from ddmhe.reproduce.claims import Claim, cases, holds_if, verdict
from ddmhe.reproduce.tol import LEMMA_1, LINEAR_STEP, NO_COST

Array = NDArray[np.float64]

__all__ = ["LEFT", "Example", "claims", "lemma_1", "linearisation", "one_step", "region_sign"]


# --- Lemma 1


def lemma_1(count: int = 200, seed: int = 0, ones: bool = True) -> tuple[float, float]:
    """Both directions of Lemma 1 on random systems (6): the largest relative misfit of "only if"
    and of "if".

    "only if": distance of another trajectory from the range of (8). "if": by how much a random α
    with 1ᵀα = 1 leaves (6), with the recorded windows as data; without the row of `ones` α is any.
    """
    rng = np.random.default_rng(seed)
    only_if = if_ = 0.0
    for _ in range(count):
        n, p, L = int(rng.integers(1, 5)), int(rng.integers(1, 4)), int(rng.integers(1, 6))
        A = rng.standard_normal((n, n))
        A *= rng.uniform(0.7, 1.0) / np.abs(np.linalg.eigvals(A)).max()
        C, e, r = rng.standard_normal((p, n)), rng.standard_normal(n), rng.standard_normal(p)

        def trajectory(
            steps: int, A: Array = A, C: Array = C, e: Array = e, r: Array = r
        ) -> tuple[Array, Array]:
            x = [rng.standard_normal(len(e))]
            for _ in range(steps):
                x.append(A @ x[-1] + e)
            return np.array(x), np.array(x[:-1]) @ C.T + r

        x, y = trajectory(L + n + 3)
        columns = range(len(y) - L + 1)
        H = np.array(
            [np.concatenate([x[k : k + L + 1].ravel(), y[k : k + L].ravel()]) for k in columns]
        ).T
        if np.linalg.cond(np.vstack([x[: len(columns)].T, np.ones(len(columns))])) > 1e4:
            continue  # (7) holds, but not by enough for double precision to tell
        other = np.concatenate([part.ravel() for part in trajectory(L)])
        full, wanted = np.vstack([H, np.ones(len(columns))]), np.append(other, 1.0)
        alpha = np.linalg.lstsq(full, wanted, rcond=None)[0]
        only_if = max(
            only_if, float(np.linalg.norm(full @ alpha - wanted) / np.linalg.norm(wanted))
        )
        alpha = rng.standard_normal(len(columns))
        if ones:
            alpha += (1 - alpha.sum()) / len(alpha)
        window = H @ alpha
        states, outputs = (
            window[: (L + 1) * n].reshape(L + 1, n),
            window[(L + 1) * n :].reshape(L, p),
        )
        off = [states[1:] - states[:-1] @ A.T - e, outputs - states[:-1] @ C.T - r]
        if_ = max(if_, float(max(np.abs(each).max() for each in off) / np.abs(window).max()))
    return only_if, if_


# --- Proposition 1


def one_step(A: Array, C: Array, rho: float, mu: float) -> float:
    """Smallest eigenvalue of (19)'s right side minus its left side: (19) holds if and only if it is
    not negative.

    The quadratic form is in (x_Δ, e_Δ, w_Δ, r_Δ, v_Δ), which are free; y_Δ = C x_Δ + r_Δ + v_Δ.
    """
    n, p = A.shape[0], C.shape[0]
    ahead = np.hstack([A, np.eye(n), np.eye(n), np.zeros((n, 2 * p))])
    y = np.hstack([C, np.zeros((p, 2 * n)), np.eye(p), np.eye(p)])
    weights = np.diag(np.concatenate([np.full(n, rho), np.full(2 * n + 2 * p, mu)]))
    return float(np.linalg.eigvalsh(weights + mu * y.T @ y - ahead.T @ ahead)[0])


# --- Theorems 1 and 2


@dataclass(frozen=True, eq=False)
class Example:
    """The counterexample of the module's text."""

    A: Array
    C: Array
    gain: Array
    rho: float = 0.05
    mu: float = 6.0
    M: int = 3
    steps: int = 6
    """The error is judged at this time."""
    when: int = 4
    """w(when) = (0, 1), every other w is zero."""

    @classmethod
    def standard(cls) -> Example:
        """The one of the module's text."""
        A = np.array([[1.0, 10.0], [0.0, 1.0]])
        return cls(A, 1000 * np.eye(2), -A / 1000)

    def truth(self) -> Array:
        """x(0) to x(steps), (steps+1, 2)."""
        x = [np.zeros(2)]
        for k in range(self.steps):
            x.append(self.A @ x[-1] + np.array([0.0, float(k == self.when)]))
        return np.array(x)

    def history(self) -> History:
        """Two noise-free recordings that satisfy (7)."""
        parts = []
        for start in ([1.0, 0.2], [-1.0, 0.5]):
            x = [np.array(start)]
            for _ in range(8):
                x.append(self.A @ x[-1])
            parts.append(History(np.array(x), np.array(x[:-1]) @ self.C.T))
        return History.concat(parts)

    def allowed(self) -> tuple[float, float]:
        """What (25) and (34) allow for ‖x - x̂‖ at `steps`; the prior is exact before the
        disturbance, v = 0."""
        age = self.steps - 1 - self.when
        kappa = (4 * self.rho**self.M) ** (1 / self.M)
        return float(np.sqrt(self.rho**age * self.mu)), float(
            np.sqrt(kappa) ** age * np.sqrt(self.mu)
        )

    def run(self) -> tuple[float, float]:
        """‖x - x̂‖ at `steps`, and the optimal cost J* there; (31) has J = 0 on its right."""
        scalar_certificate(self.A, self.C, self.gain, self.rho, self.mu)  # raises unless (24) holds
        truth = self.truth()
        estimator = DdMhe(
            self.history(), self.M, self.rho, self.mu, x_prior=truth[0], space=Exact()
        )
        log = estimator.run(truth[:-1] @ self.C.T)
        return float(np.linalg.norm(log.x[-1] - truth[-1])), float(log.cost[-1])


# --- the appendix


def region_sign(A: Array, radius: float, X: Array) -> tuple[float, float]:
    """Smallest and largest eigenvalue of (48)'s left side for the disc of (49): L = -r I, M = [[0,
    1], [0, 0]]."""
    block = np.block([[-radius * X, A @ X], [(A @ X).T, -radius * X]])
    values = np.linalg.eigvalsh(block)
    return float(values[0]), float(values[-1])


# --- the linearisation (5) along the 3-DOF motion


LEFT = (
    "s after the history",
    "largest w (deg/s per step)",
    "largest v (N m)",
    "(34) allows (deg/s)",
)
"""What `linearisation` gives."""


def linearisation(
    ends: tuple[float, ...] = (20.0, 40.0, 100.0, 180.0),
) -> list[tuple[float, float, float, float]]:
    """Per span after the history: its end, s, largest ‖w‖, deg/s, largest ‖v‖, N·m, and what (34)
    allows, deg/s.

    (5) is the linearisation of (4) at the last recorded state, w and v what it leaves along the
    noise-free motion. (34) with the printed ρ, μ and M, and an exact prior."""
    model = models.detumbling()
    x = model.simulate(case.HISTORY + ends[-1], case.DT).x[case.T :]

    def ahead(x: Array) -> Array:
        return np.asarray(x + case.DT * model.derivative(x))

    A, C = slope(ahead, x[0]), slope(model.output, x[0])
    off = x - x[0]
    w = np.linalg.norm(ahead(x) - ahead(x[0]) - off @ A.T, axis=1)
    v = np.linalg.norm(model.output(x) - model.output(x[0]) - off @ C.T, axis=1)
    root = np.sqrt((4 * case.PAPER["rho"] ** case.PAPER["horizon"]) ** (1 / case.PAPER["horizon"]))
    rows, allowed = [], 0.0
    for k in range(len(x) - 1):
        allowed = root * allowed + np.sqrt(case.PAPER["mu"]) * (w[k] + np.sqrt(2) * v[k])
        t = (k + 1) * case.DT
        for end in ends:
            if abs(t - end) < 0.5 * case.DT:
                rows.append(
                    (
                        end,
                        float(np.rad2deg(w[: k + 1].max())),
                        float(v[: k + 1].max()),
                        float(np.rad2deg(allowed)),
                    )
                )
    return rows


def slope(f: Any, x: Array) -> Array:
    """Jacobian of f (m, n) at x (n,) by central differences; exact to rounding for a quadratic
    f."""
    h = LINEAR_STEP * float(np.linalg.norm(x))
    return np.array([(f(x + step) - f(x - step)) / (2 * h) for step in h * np.eye(len(x))]).T


# --- the verdicts


def claims(clean: History) -> list[Claim]:
    """Verdicts on Lemma 1 to Lemma 3 of the paper; `clean` is the 3-DOF recording without noise."""
    return [_lemma_1(), *_proposition_1(clean), *_theorems(clean), _lemma_3()]


def _lemma_1() -> Claim:
    only_if, if_ = lemma_1()
    return Claim(
        "II-B, Lemma 1",
        "With (7) and T ≥ L + n, data are a trajectory of (6) if and only if some α satisfies (8)",
        "",
        f'largest relative misfit over 200 random systems: "only if" {only_if:.1e}, "if" {if_:.1e}',
        holds_if(max(only_if, if_) < LEMMA_1),
        "criterion: 1e-8. It speaks of noise-free data of an affine system; (16) uses it for "
        "neither",
    )


def _proposition_1(clean: History) -> list[Claim]:
    A, C = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    double = one_step(A, C, 0.999, 1e9)
    scalar = np.array([[0.9]]), np.array([[100.0]])
    scalar_certificate(*scalar, [[-0.009]], 0.1, 1e-3)  # raises unless (24) holds
    short, enough = one_step(*scalar, 0.1, 1e-3), one_step(*scalar, 0.1, 6.0)
    bound = pole_placement(clean).lower_bound
    return [
        Claim(
            "III-B, Proposition 1",
            "For every observable (A, C) some ρ in (0, 1) and μ > 0 satisfy (19)",
            "",
            "A = [[1, 1], [0, 1]], C = [1, 0], ρ = 0.999, μ = 1e9: smallest eigenvalue of right "
            f"minus left {double:.3g}",
            holds_if(double >= 0),
            "observability does not give a contraction in one step in the Euclidean norm: x_Δ = "
            "(0, 1) has y_Δ = 0 and ‖x_Δ(t+1)‖² = 2. It holds where C has rank n, and in a "
            "weighted norm for every observable pair",
        ),
        Claim(
            "III-B, (23), (24)",
            "(24) makes (19) hold",
            "6 λmax(LᵀL) ≤ μ",
            "A = 0.9, C = 100, L = -0.009, ρ = 0.1 satisfy (24) with μ = 1e-3: smallest eigenvalue "
            f"{short:.3g}; with μ = 6: {enough:.3g}",
            "holds with …" if short < 0 <= enough else holds_if(short >= 0),
            "with 6 ≤ μ, which (23) uses for ‖e_Δ‖² and ‖w_Δ‖² and (24) leaves out: no gain "
            "multiplies them",
        ),
        Claim(
            "III-B, after (24)",
            "ρ can be set as any small value, at the price of a larger μ",
            "",
            f"3-DOF: ρ ≥ {bound:.4g} for every gain; A = [[1, 10], [0, 1]], C = 1000 I: ρ → 0 with "
            f"μ = 6e-6 λmax(AAᵀ) = {6e-6 * np.linalg.norm(Example.standard().A, 2) ** 2:.2g}",
            "holds with …" if bound > 0 else "holds",
            "with C of rank n. On the kernel of C no gain acts, so ρ ≥ 6 max ‖A b‖² over unit b "
            "with C b = 0; and where C has rank n, L = -A C⁺ gives ρ = 0 at a bounded μ",
        ),
    ]


def _theorems(clean: History) -> list[Claim]:
    example = Example.standard()
    error, cost = example.run()
    one, two = example.allowed()
    words = "A = [[1, 10], [0, 1]], C = 1000 I, A_L = 0, ρ = 0.05, μ = 6, M = 3, only w(4) = (0, 1)"
    certificate = ioss(clean, 0.95)
    rows = linearisation()
    initial = float(np.rad2deg(np.linalg.norm(models.detumbling().omega_0)))
    covered = {f"{end:g} s": allowed < initial for end, _, _, allowed in rows}
    spans = "/".join(f"{end:g}" for end, *_ in rows)
    return [
        Claim(
            "III-B, (31)",
            "The true trajectory without w and v is feasible, so that J* ≤ J(x(t-M), v)",
            "",
            f"{words}: J* = {cost:.3g} at t = 6 where J(x(3), 0) = 0",
            holds_if(cost <= NO_COST),
            "taking each w off its own state leaves no trajectory: the next state still carries A "
            "w. Feasible for w = 0 or M = 1 only",
        ),
        Claim(
            "III-B, Theorem 1, (25)",
            "The error never exceeds (25)",
            "",
            f"{words}: error {error:.3g} at t = 6 where (25) allows {one:.2g}",
            holds_if(error <= one),
            "a consequence of (31); (24), Assumptions 1 and 2 and 6 ≤ μ are satisfied. For μ < 6 "
            "there is a second reason: w(t-1) is in no output up to t-1, so it counts fully, not "
            "times √μ",
        ),
        Claim(
            "III-B, Theorem 2, (34)",
            "The error never exceeds (34)",
            "",
            f"{words}: error {error:.3g} at t = 6 where (34) allows {two:.2g}, κ = (4ρ^M)^(1/M) "
            "per step",
            holds_if(error <= two),
            "follows from (25); 4ρ^M = 5e-4 < 1. Certificate.error_bound is corrected",
        ),
        Claim(
            "III-B, Theorem 2 with IV-B",
            "The error of the 3-DOF case is stable",
            "",
            f"weighted certificate: η = 0.95, cond P = {certificate.condition:.3g}, horizon "
            f"{certificate.horizon}",
            "holds with …" if certificate.residual <= 0 else "does not hold",
            "not by (24), which is impossible there, but with weights P, Q, R (Schiller et al. "
            "2023)",
        ),
        Claim(
            "I, (5) with IV-B",
            "By local linear approximation the stability covers the nonlinear system",
            "",
            f"{spans} s after the history: ‖w‖ up to {'/'.join(f'{w:.2g}' for _, w, _, _ in rows)} "
            f"deg/s a step, ‖v‖ up to {max(v for _, _, v, _ in rows):.1g} N·m; (34) then allows "
            f"{'/'.join(f'{allowed:.3g}' for *_, allowed in rows)} deg/s{cases(covered)}",
            verdict(covered),
            f"criterion: what (34) allows stays below the initial {initial:.3g} deg/s. Linearised "
            "at the last recorded state, printed ρ, μ and M, as if (24) held; the torque is linear "
            "in the rate, so v is rounding",
        ),
    ]


def _lemma_3() -> Claim:
    A = np.array([[0.5, 0.2], [0.0, -0.3]])
    low, high = region_sign(A, 0.9, np.eye(2))
    return Claim(
        "A-B1, Lemma 3, (48)",
        "Poles in the region if and only if (48) ≻ 0 for some X ≻ 0",
        "≻ 0",
        f"poles 0.5, -0.3 in the disc of radius 0.9, X = I: eigenvalues of (48) from {low:.2g} to "
        f"{high:.2g}",
        "holds with …" if high < 0 else holds_if(low > 0),
        "with ≺ 0, as (47) and (49) have it: the block -r X on the diagonal is never positive",
    )
