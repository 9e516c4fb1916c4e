"""Every system that a noisy recording allows, as an ellipsoid of matrices.

With Z = [A e; C r], a recording D = [X1; Y0; X0; 1] (samples as columns) of x(k+1), y(k), x(k) and
1 obeys [I -Z](D - E) = 0 for its errors E. If EEᵀ ⪯ Θ = diag(Θ1, Θ0), then [I -Z](DDᵀ - Θ)[I -Z]ᵀ ⪯
0, a quadratic matrix inequality in Z as in van Waarde, Camlibel, Mesbahi 2022 (for measurement
errors: Bisoffi, Li, De Persis, Monshizadeh 2024). With D1 = [X1; Y0], D0 = [X0; 1], G = D0D0ᵀ - Θ0
≻ 0 and Z_c = D1D0ᵀG⁻¹, completing the square gives

    (Z - Z_c) G (Z - Z_c)ᵀ ⪯ Δ = Z_c G Z_cᵀ - D1D1ᵀ + Θ1.

Without e and r: K = [A; C] - [A_c; C_c] obeys K H Kᵀ ⪯ Δ, H the Schur complement of the ones row in
G."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError, History, RankError
from ddmhe.checks import check_history, check_kind, check_number, choice
from ddmhe.design.model import samples
from ddmhe.design.tol import HIDDEN, NONZERO, ON_BOUNDARY, UNEXPLAINED

Array = NDArray[np.float64]

__all__ = ["ConsistentSet", "RecordingNoise", "consistent_set"]


@dataclass(frozen=True)
class RecordingNoise:
    """How wrong the recording may be.

    "bounded": Euclidean norms that no sample's error exceeds. "gaussian": standard deviations per
    channel of white noise; what follows from them then holds with probability `confidence`."""

    x: float = 0.0
    """Errors of the recorded states, in their unit."""
    y: float = 0.0
    """Errors of the recorded outputs, in their unit."""
    w: float = 0.0
    """Process noise: what x(k+1) differs from A x(k) + e, in the states' unit."""
    kind: Literal["bounded", "gaussian"] = "bounded"
    confidence: float = 0.999

    def __post_init__(self) -> None:
        """Check the sizes."""
        for name in ("x", "y", "w"):
            check_number(
                "noise",
                getattr(self, name),
                f"a finite {name} of at least 0",
                lambda size: size >= 0,
            )
        choice("noise", self.kind, ("bounded", "gaussian"))
        check_number(
            "noise", self.confidence, "a confidence in (0, 1)", lambda value: 0 < value < 1
        )

    def energy(self, n: int, p: int, T: int) -> tuple[float, float, float]:
        """θ of the blocks x(k+1), y(k), x(k) with EEᵀ ⪯ diag(θ I) over T samples.

        Bounded: a column of k blocks b_i is outer-bounded by k diag(b_i b_iᵀ). Gaussian:
        consecutive samples share an error of the state, so even and odd samples are taken apart;
        each half is a standard Gaussian matrix (2n+p) x T/2 of norm at most √(T/2) + √(2n+p) + t
        with probability 1 - exp(-t²/2) (Davidson, Szarek 2001)."""
        if self.kind == "gaussian":
            t = math.sqrt(2 * math.log(2 / (1 - self.confidence)))
            norm = (math.sqrt(T + 1) + math.sqrt(2 * (2 * n + p)) + math.sqrt(2) * t) ** 2
            return norm * (self.x**2 + self.w**2), norm * self.y**2, norm * self.x**2
        bounds = (self.x + self.w, self.y, self.x)
        blocks = sum(b > 0 for b in bounds)
        return tuple(blocks * T * b**2 for b in bounds)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class ConsistentSet:
    """[A e; C r] = Z_c + Δ^½ Γ G^-½ for all ‖Γ‖ ≤ 1."""

    A: Array
    """Centre (n, n)."""
    e: Array
    C: Array
    r: Array
    root: Array
    """Δ^½ ((n+p), (n+p))."""
    metric: Array
    """G⁻¹ ((n+1), (n+1)); its leading block is H⁻¹."""

    @property
    def shape(self) -> Array:
        """H⁻¹ (n, n), for A and C alone."""
        return self.metric[:-1, :-1]

    def contains(self, A: Array, e: Array, C: Array, r: Array) -> bool:
        """Whether a system is one of them, up to rounding."""
        Z = np.block([[A - self.A, (e - self.e)[:, None]], [C - self.C, (r - self.r)[:, None]]])
        G = np.linalg.inv(self.metric)
        excess = Z @ G @ Z.T - self.root @ self.root.T
        size = max(float(np.linalg.norm(self.root, 2)) ** 2, NONZERO)
        return bool(np.linalg.eigvalsh(0.5 * (excess + excess.T))[-1] <= ON_BOUNDARY * size)


def consistent_set(history: History, noise: RecordingNoise) -> ConsistentSet:
    """The systems that a recording with errors of the stated size allows.

    Raises RankError when the noise hides the recorded motion (G is not positive definite) and
    DdmheError when no system fits, which means that the stated noise is smaller than the
    recording's."""
    check_history(history)
    check_kind("noise", noise, RecordingNoise, "a RecordingNoise")
    n, p = history.n, history.p
    X, Z = samples(history)
    mean_x, mean_z = X.mean(0), Z.mean(0)
    theta_1, theta_y, theta_0 = noise.energy(n, p, len(X) + len(history.recordings) - 1)
    # The ones row has no error, so that centring is exact: H, [A_c; C_c] and Δ follow from the
    # deviations alone.
    X, Z = X - mean_x, Z - mean_z
    H = X.T @ X - theta_0 * np.eye(n)
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= HIDDEN * max(float(np.trace(H)), theta_0):
        weakest = math.sqrt(max(float(np.linalg.eigvalsh(X.T @ X)[0]), 0.0) / len(X))
        hidden = math.sqrt(theta_0 / len(X))
        raise RankError(
            "noise: expected a recording that moves every direction of the state by more than its "
            f"errors, found {weakest:.3g} rms in the weakest one against {hidden:.3g}"
        )
    centre = np.linalg.solve(H, X.T @ Z).T  # (n+p) x n
    theta = np.concatenate([np.full(n, theta_1), np.full(p, theta_y)])
    delta = centre @ H @ centre.T - Z.T @ Z + np.diag(theta)
    values, vectors = np.linalg.eigh(0.5 * (delta + delta.T))
    rounding = UNEXPLAINED * float(np.trace(Z.T @ Z) + np.trace(centre @ H @ centre.T))
    if values[0] < -rounding:
        raise DdmheError(
            "noise: expected a size that the recording's errors do not exceed, found that no "
            "linear system explains the recording with it; state more, or allow for process noise w"
        )
    offset = mean_z - centre @ mean_x
    inverse = np.linalg.inv(H)
    inverse = 0.5 * (inverse + inverse.T)
    metric = np.block(
        [
            [inverse, -(inverse @ mean_x)[:, None]],
            [-(inverse @ mean_x)[None], mean_x @ inverse @ mean_x + 1 / len(X)],
        ]
    )
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return ConsistentSet(centre[:n], offset[:n], centre[n:], offset[n:], root, metric)
