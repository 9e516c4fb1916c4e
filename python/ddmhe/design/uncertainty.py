"""Every system that a noisy recording allows, as an ellipsoid of matrices.

With Z = [A e; C r], a recording D = [X1; Y0; X0; 1] (samples as columns) of x(k+1), y(k), x(k) and
1 obeys [I -Z](D - E) = 0 for its errors E. If EEᵀ ⪯ Θ = diag(Θ1, Θ0), then [I -Z](DDᵀ - Θ)[I -Z]ᵀ ⪯
0, a quadratic matrix inequality in Z as in van Waarde, Camlibel, Mesbahi 2022 (for measurement
errors: Bisoffi, Li, De Persis, Monshizadeh 2024). With D1 = [X1; Y0], D0 = [X0; 1], G = D0D0ᵀ - Θ0
≻ 0 and Z_c = D1D0ᵀG⁻¹, completing the square gives

    (Z - Z_c) G (Z - Z_c)ᵀ ⪯ Δ = Z_c G Z_cᵀ - D1D1ᵀ + Θ1.

Without e and r: K = [A; C] - [A_c; C_c] obeys K H Kᵀ ⪯ Δ, H the Schur complement of the ones row in
G.

Known inputs u(k) join the ones row: Z = [A B e; C D r], D0 = [X0; U0; 1], and U0 has no error, so
that Θ0 = diag(θ I, 0, 0). With D_u = [U0; 1] and what D_u leaves of X0 and D1 after least squares,
X̃ = X0 - F D_u and D̃1, completing the square over [B e; D r] first gives

    H = X̃X̃ᵀ - θ I,  [A_c; C_c] = D̃1X̃ᵀH⁻¹,  Δ = [A_c; C_c] H [A_c; C_c]ᵀ - D̃1D̃1ᵀ + Θ1,
    G⁻¹ = [I -F]ᵀ H⁻¹ [I -F] + diag(0, (D_uD_uᵀ)⁻¹) over [x; u; 1],

the formulas without inputs with everything centred about u and 1 in the place of 1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError, History, RankError
from ddmhe.checks import check_history, check_kind, check_number, choice
from ddmhe.design.model import check_span, samples, slopes
from ddmhe.design.tol import HIDDEN, NONZERO, ON_BOUNDARY, UNEXPLAINED

Array = NDArray[np.float64]

__all__ = ["ConsistentSet", "RecordingNoise", "consistent_set"]


@dataclass(frozen=True)
class RecordingNoise:
    """How wrong the recording may be; its known inputs are exact.

    "bounded": Euclidean norms that no sample's error exceeds. "gaussian": standard deviations per
    channel of white noise; what follows from them then holds with probability `confidence`.

    Examples
    --------
    >>> import ddmhe
    >>> noise = ddmhe.design.RecordingNoise(x=1e-4, y=0.01, kind="gaussian")
    >>> noise.confidence
    0.999
    """

    x: float = 0.0
    """Errors of the recorded states, in their unit."""
    y: float = 0.0
    """Errors of the recorded outputs, in their unit."""
    w: float = 0.0
    """Process noise: what x(k+1) differs from A x(k) + B u(k) + e, in the states' unit."""
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
    """[A B e; C D r] = Z_c + Δ^½ Γ G^-½ for all ‖Γ‖ ≤ 1."""

    A: Array
    """Centre (n, n)."""
    B: Array
    """(n, m)"""
    e: Array
    C: Array
    D: Array
    """(p, m)"""
    r: Array
    root: Array
    """Δ^½ ((n+p), (n+p))."""
    metric: Array
    """G⁻¹ ((n+m+1), (n+m+1)) over [x; u; 1]; its leading block is H⁻¹."""

    @property
    def shape(self) -> Array:
        """H⁻¹ (n, n), for A and C alone."""
        n = len(self.A)
        return self.metric[:n, :n]

    def contains(
        self,
        A: Array,
        e: Array,
        C: Array,
        r: Array,
        B: Array | None = None,
        D: Array | None = None,
    ) -> bool:
        """Whether a system is one of them, up to rounding; B and D with inputs."""
        if self.B.shape[1] and (B is None or D is None):
            raise DdmheError("B, D: expected both, for a recording with inputs, found none or one")
        of_inputs = [[], []] if B is None or D is None else [[B - self.B], [D - self.D]]
        Z = np.block(
            [
                [A - self.A, *of_inputs[0], (e - self.e)[:, None]],
                [C - self.C, *of_inputs[1], (r - self.r)[:, None]],
            ]
        )
        G = np.linalg.inv(self.metric)
        excess = Z @ G @ Z.T - self.root @ self.root.T
        size = max(float(np.linalg.norm(self.root, 2)) ** 2, NONZERO)
        return bool(np.linalg.eigvalsh(0.5 * (excess + excess.T))[-1] <= ON_BOUNDARY * size)


def consistent_set(history: History, noise: RecordingNoise) -> ConsistentSet:
    """The systems that a recording with errors of the stated size allows.

    Raises RankError when the noise hides the recorded motion (G is not positive definite) and
    DdmheError when no system fits, which means that the stated noise is smaller than the
    recording's.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> rng = np.random.default_rng(0)
    >>> x = rng.uniform(-1, 1, (41, 1))
    >>> w = 1e-3 * rng.uniform(-1, 1, (40, 1))
    >>> for k in range(40):
    ...     x[k + 1] = 0.5 * x[k] + w[k]
    >>> allowed = ddmhe.design.consistent_set(
    ...     ddmhe.History(x, x[:40], 0.1), ddmhe.design.RecordingNoise(w=1e-3)
    ... )
    >>> bool(abs(allowed.A - 0.5).max() < 0.01)  # the middle of the set
    True
    """
    check_history(history)
    check_kind("noise", noise, RecordingNoise, "a RecordingNoise")
    n, p = history.n, history.p
    rows = _Deviations.of(history)
    K, X, Z = len(rows.X), rows.X, rows.Z
    theta_1, theta_y, theta_0 = noise.energy(n, p, K + len(history.recordings) - 1)
    H = X.T @ X - theta_0 * np.eye(n)
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= HIDDEN * max(float(np.trace(H)), theta_0):
        weakest = math.sqrt(max(float(np.linalg.eigvalsh(X.T @ X)[0]), 0.0) / K)
        hidden = math.sqrt(theta_0 / K)
        raise RankError(
            "noise: expected a recording that moves every direction of the state by more than its "
            f"errors, found {weakest:.3g} rms in the weakest one against {hidden:.3g}"
        )
    centre: Array = np.asarray(np.linalg.solve(H, X.T @ Z).T, np.float64)  # (n+p) x n
    theta = np.concatenate([np.full(n, theta_1), np.full(p, theta_y)])
    delta = centre @ H @ centre.T - Z.T @ Z + np.diag(theta)
    values, vectors = np.linalg.eigh(0.5 * (delta + delta.T))
    rounding = UNEXPLAINED * (rows.size + float(np.trace(centre @ H @ centre.T)))
    if values[0] < -rounding:
        raise DdmheError(
            "noise: expected a size that the recording's errors do not exceed, found that no "
            "linear system explains the recording with it; state more, or allow for process noise w"
        )
    of_inputs, offset = rows.others(centre)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    inverse = np.linalg.inv(H)
    metric = rows.metric(0.5 * (inverse + inverse.T))
    (A, B, e), (C, D, r) = (
        (centre[part], of_inputs[part], offset[part]) for part in (slice(n), slice(n, None))
    )
    return ConsistentSet(A, B, e, C, D, r, root, metric)


@dataclass(frozen=True, eq=False)
class _Deviations:
    """What the rows without error, u and 1, leave of x(k) and of [x(k+1); y(k)] (samples are rows),
    X = x - mean - (u - mean) F, Z likewise with G."""

    X: Array
    """(K, n)"""
    Z: Array
    """(K, n+p)"""
    U: Array
    """(K, m), about its mean"""
    means: tuple[Array, Array, Array]
    """Of x, u and [x(k+1); y(k)]."""
    slopes: tuple[Array, Array]
    """F (m, n) and G (m, n+p)."""
    size: float
    """Σ Z² before the inputs were taken off."""

    @classmethod
    def of(cls, history: History) -> _Deviations:
        n, m = history.n, history.m
        regressors, Z = samples(history)
        mean, mean_z = regressors.mean(0), Z.mean(0)
        both, Z = regressors - mean, Z - mean_z
        X, U, size = both[:, :n], both[:, n:], float(np.trace(Z.T @ Z))
        means = (mean[:n], mean[n:], mean_z)
        if not m:
            return cls(X, Z, U, means, (np.zeros((0, n)), np.zeros((0, Z.shape[1]))), size)
        check_span(both, np.abs(regressors).max(axis=0), n)
        F, G = slopes(U, X), slopes(U, Z)
        return cls(X - U @ F, Z - U @ G, U, means, (F, G), size)

    def others(self, centre: Array) -> tuple[Array, Array]:
        """[B; D] (n+p, m) and [e; r] (n+p,) beside [A; C] = centre (n+p, n)."""
        (mean_x, mean_u, mean_z), (F, G) = self.means, self.slopes
        of_inputs = G.T - centre @ F.T
        offset = mean_z - centre @ mean_x
        return of_inputs, offset - of_inputs @ mean_u if len(mean_u) else offset

    def metric(self, inverse: Array) -> Array:
        """G⁻¹ from H⁻¹ (n, n)."""
        (mean_x, mean_u, _), (F, _) = self.means, self.slopes
        known = np.array([[1 / len(self.X)]])  # (D_u D_uᵀ)⁻¹
        if not len(mean_u):
            return _bordered(inverse, mean_x[:, None], known)
        of_inputs = np.linalg.inv(self.U.T @ self.U)
        known = _bordered(0.5 * (of_inputs + of_inputs.T), mean_u[:, None], known)
        return _bordered(inverse, np.column_stack([F.T, mean_x - mean_u @ F]), known)


def _bordered(inverse: Array, F: Array, rest: Array) -> Array:
    """[I -F]ᵀ inverse [I -F] + diag(0, rest)."""
    cross = inverse @ F
    return np.block([[inverse, -cross], [-cross.T, F.T @ cross + rest]])
