"""An affine model from a recording: the bridge from data to designs that need (A, C), and to
python-control.

Known inputs are regressors beside the states, z(k) = [x(k); u(k); 1]. They carry no error: least
squares on [x; u; 1] at once and least squares on x alone of what u and 1 leave give the same A and
C (Frisch, Waugh 1933), and where errors of x count, u is taken off first as the mean is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, RankError, ShapeError, noise_levels
from ddmhe.checks import array, check_finite, check_flag, check_history, check_whole, choice
from ddmhe.design.tol import EXACT_CHANNEL, PBH, TRAJECTORY

if TYPE_CHECKING:
    from collections.abc import Callable

Array = NDArray[np.float64]
Method = Literal["least squares", "total least squares", "given"]

__all__ = [
    "AffineModel",
    "check_span",
    "given_model",
    "identify",
    "is_exact",
    "is_observable",
    "recorded_noise",
    "samples",
    "slopes",
    "unobservable_modes",
]

MOST_STEPS = 10_000_000
"""Simulated steps that fit into memory."""
FIFTH_DIFFERENCE = 252.0
"""Variance of Δ⁵ of white noise of variance 1: 1 + 25 + 100 + 100 + 25 + 1."""


@dataclass(frozen=True, eq=False)
class AffineModel:
    """x(k+1) = A x(k) + B u(k) + e + w(k), y(k) = C x(k) + D u(k) + r + v(k), with what the
    recording says of its accuracy.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
    >>> model = ddmhe.design.identify(record.history(200))
    >>> model.A.shape, model.C.shape, model.samples
    ((3, 3), (3, 3), 200)
    >>> bool(np.abs(np.linalg.eigvals(model.A)).max() < 1.01)
    True
    """

    A: Array
    """(n, n)"""
    B: Array
    """(n, m); (n, 0) without inputs, as python-control has it."""
    e: Array
    """(n,)"""
    C: Array
    """(p, n)"""
    D: Array
    """(p, m); (p, 0) without inputs."""
    r: Array
    """(p,)"""
    dt: float
    """Sampling interval, s."""
    residual: Array
    """Covariance ((n+p), (n+p)) of [x(k+1) - A x(k) - B u(k) - e; y(k) - C x(k) - D u(k) - r], with
    the degrees of freedom taken off."""
    gram: Array
    """Σ_k [x(k); u(k); 1][x(k); u(k); 1]ᵀ (n+m+1, n+m+1)."""
    samples: int
    """Number of samples k behind it."""
    method: Method = "least squares"

    @property
    def covariance(self) -> Array:
        """Covariance of the least-squares estimate of [A B e; C D r], row after row: residual ⊗
        gram⁻¹.

        Shape ((n+p)(n+m+1), (n+p)(n+m+1)). It holds for noise that enters as w and v; errors of the
        recorded states also bias the estimate towards zero, which no covariance shows."""
        return np.kron(self.residual, np.linalg.pinv(self.gram, hermitian=True))

    @property
    def standard_errors(self) -> tuple[Array, Array]:
        """Standard errors of the entries of A (n, n) and of C (p, n)."""
        n = len(self.e)
        deviation = self._deviations()[:, :n]
        return deviation[:n], deviation[n:]

    @property
    def input_standard_errors(self) -> tuple[Array, Array]:
        """Standard errors of the entries of B (n, m) and of D (p, m)."""
        n = len(self.e)
        deviation = self._deviations()[:, n:-1]
        return deviation[:n], deviation[n:]

    def _deviations(self) -> Array:
        """Standard errors of [A B e; C D r]."""
        deviations = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return deviations.reshape(len(self.e) + len(self.r), -1)

    @property
    def observable(self) -> bool:
        """Whether (A, C) is observable; see `is_observable`."""
        return is_observable(self.A, self.C)

    def simulate(
        self, x_0: ArrayLike, steps: int, u: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """States (steps+1, n) and outputs (steps, p) from x_0 (n,) under the inputs u (steps, m),
        without noise."""
        check_whole("steps", steps, 0, MOST_STEPS)
        inputs = self._inputs(steps, u)
        x = np.empty((steps + 1, len(self.e)))
        x[0] = array("x_0", x_0, (len(self.e),))
        check_finite("x_0", x[0])
        for k in range(steps):
            x[k + 1] = self.A @ x[k] + self.e
            if inputs is not None:
                x[k + 1] += self.B @ inputs[k]
        y = x[:-1] @ self.C.T + self.r
        return x, y if inputs is None else y + inputs @ self.D.T

    def _inputs(self, steps: int, u: ArrayLike | None) -> Array | None:
        m = self.B.shape[1]
        if (m > 0) != (u is not None):
            expected = f"inputs ({steps}, {m})" if m else "none for a model without inputs"
            raise ShapeError(f"u: expected {expected}, found {'none' if m else 'some'}")
        if u is None:
            return None
        inputs = array("u", u, (steps, m))
        check_finite("u", inputs)
        return inputs

    def to_control(self, offsets: bool | None = None) -> Any:
        """The model as a discrete `control.StateSpace` (python-control, `pip install control`).

        A StateSpace has no offsets. With `offsets` they are the effect of one more input, the
        last, that is constantly 1: its columns are e in B and r in D. Without them the StateSpace
        has the model's m inputs and no others, as a controller's design wants it, and describes
        deviations from a motion of the model: from a rest x_e = A x_e + B u_e + e, y_e = C x_e +
        D u_e + r where there is one. Default: with them for a model without inputs, which a
        StateSpace could not simulate, and without them for one with inputs.

        Raises ImportError without python-control."""
        control = _control("to_control")
        if offsets is not None:
            check_flag("offsets", offsets)
        if offsets if offsets is not None else not self.B.shape[1]:
            B, D = np.column_stack([self.B, self.e]), np.column_stack([self.D, self.r])
            return control.ss(self.A, B, self.C, D, self.dt)
        return control.ss(self.A, self.B, self.C, self.D, self.dt)

    @classmethod
    def from_control(cls, sys: Any) -> AffineModel:
        """The model of a discrete `control.StateSpace`, all its inputs known: its A, B, C, D and
        dt (1 s where it is discrete without one), with offsets of zero.

        Nothing is known of its accuracy: `residual` is zero. Raises DdmheError for anything but a
        discrete StateSpace with finite entries, a state and an output, ImportError without
        python-control."""
        control = _control("from_control")
        if not isinstance(sys, control.StateSpace):
            raise DdmheError(f"sys: expected a control.StateSpace, found a {type(sys).__name__}")
        if sys.dt is None or not sys.dt > 0:
            found = "one without a time base" if sys.dt is None else "a continuous one"
            raise DdmheError(
                f"sys: expected a discrete control.StateSpace, found {found}; give dt with it, or "
                "sample it (control.sample_system)"
            )
        if not sys.nstates or not sys.noutputs:
            raise ShapeError(
                "sys: expected at least one state and one output, found "
                f"{sys.nstates} and {sys.noutputs}"
            )
        matrices = [np.array(M, dtype=np.float64) for M in (sys.A, sys.B, sys.C, sys.D)]
        for name, M in zip("ABCD", matrices, strict=True):
            check_finite(f"sys.{name}", M)
        A, B, C, D = matrices
        return given_model(A, C, B, D, dt=float(sys.dt))


def given_model(
    A: Array, C: Array, B: Array | None = None, D: Array | None = None, dt: float = 1.0
) -> AffineModel:
    """A known linear system as a model: no offsets, no residual."""
    n, p = len(A), len(C)
    B, D = np.zeros((n, 0)) if B is None else B, np.zeros((p, 0)) if D is None else D
    width = n + B.shape[1] + 1
    offsets, residual = (np.zeros(n), np.zeros(p)), np.zeros((n + p, n + p))
    return AffineModel(
        A, B, offsets[0], C, D, offsets[1], dt, residual, np.eye(width), 0, method="given"
    )


def _control(caller: str) -> Any:
    """The package control, or ImportError in one sentence."""
    try:
        import control
    except ImportError:
        raise ImportError(
            f"{caller}: expected the package control, found none (pip install control)"
        ) from None
    return control


def identify(history: History, method: Method = "least squares") -> AffineModel:
    """Fit x(k+1) = A x(k) + B u(k) + e, y(k) = C x(k) + D u(k) + r to a recording; without inputs
    B and D have no columns.

    Parameters
    ----------
    history : History
        One or several recordings; no sample pair crosses a seam.
    method : "least squares" or "total least squares"
        Least squares takes the recorded x(k) as exact, right for noise that drives the system or
        sits on y. Total least squares also allows errors of x(k): each channel is scaled by its
        noise (from fifth differences) first. Inputs are exact in both.

    Raises
    ------
    RankError
        Fewer than n + m + 1 samples, or states and inputs that do not span n + m directions about
        their mean: A and B would not be unique.
    DdmheError
        An unknown method.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = np.zeros((41, 1))
    >>> for k in range(40):
    ...     x[k + 1] = 0.9 * x[k] + 1.0
    >>> model = ddmhe.design.identify(ddmhe.History(x, 2.0 * x[:40], 0.1))
    >>> model.A.round(6), model.e.round(6), model.C.round(6)
    (array([[0.9]]), array([1.]), array([[2.]]))
    """
    check_history(history)
    choice("method", method, _METHODS)
    n, m = history.n, history.m
    regressor, target = samples(history)
    mean_x, mean_z = regressor.mean(0), target.mean(0)
    X, Z = regressor - mean_x, target - mean_z
    needed = n + m + 1 if method == "least squares" else 2 * n + m + history.p + 1
    if len(X) < needed:
        raise RankError(f"history: expected at least {needed} outputs for {method}, found {len(X)}")
    check_span(X, np.abs(regressor).max(axis=0), n)
    theta = _METHODS[method](X, Z, history)  # (n+m, n+p): Z ≈ X theta
    offset = mean_z - mean_x @ theta
    freedom = len(X) - n - m - 1
    residual = Z - X @ theta
    covariance = (
        residual.T @ residual / freedom if freedom > 0 else np.zeros((Z.shape[1], Z.shape[1]))
    )
    extended = np.column_stack([regressor, np.ones(len(regressor))])
    return AffineModel(
        A=theta[:n, :n].T.copy(),
        B=theta[n:, :n].T.copy(),
        e=offset[:n],
        C=theta[:n, n:].T.copy(),
        D=theta[n:, n:].T.copy(),
        r=offset[n:],
        dt=history.dt,
        residual=covariance,
        gram=extended.T @ extended,
        samples=len(X),
        method=method,
    )


def samples(history: History) -> tuple[Array, Array]:
    """Regressors [x(k), u(k)] (K, n+m) and targets [x(k+1), y(k)] (K, n+p) of all recordings."""
    parts = [(x[:-1], np.hstack([x[1:], y])) for x, y in history.recordings]
    X, Z = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    return (np.hstack([X, np.concatenate(history.inputs)]) if history.m else X), Z


def slopes(U: Array, X: Array) -> Array:
    """S (m, k) of least ‖X - U S‖ for U (K, m) and X (K, k), of least norm in units of U's columns
    where these are dependent."""
    size = np.linalg.norm(U, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.lstsq(U / size, X, rcond=None)[0] / size[:, None])


def is_exact(history: History, theta: Array, offset: Array) -> bool:
    """Whether the recording is a trajectory of [x(k+1); y(k)] = theta [x(k); u(k)] + offset to
    rounding, with a sample to spare."""
    X, Z = samples(history)
    residual = Z - X @ theta.T - offset
    size = np.abs(Z).max(axis=0) + np.abs(theta) @ np.abs(X).max(axis=0)
    spare = len(X) > history.n + history.m + 1
    return spare and bool((np.abs(residual) <= TRAJECTORY * size).all())


def is_observable(A: Array, C: Array) -> bool:
    """Popov-Belevitch-Hautus test: [λI - A; C] has rank n at every eigenvalue λ of A.

    A is balanced by a diagonal scaling of the states and the rows of C are brought to one size, so
    that units do not decide."""
    return len(unobservable_modes(A, C)) == 0


def unobservable_modes(A: Array, C: Array) -> NDArray[np.complex128]:
    """Eigenvalues of A at which [λI - A; C] loses rank (relative tolerance PBH)."""
    n = len(A)
    balanced, (units, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    A, C = np.asarray(balanced), C * units
    rows: Array = np.asarray(np.linalg.norm(C, axis=1, keepdims=True))
    scale = max(float(np.linalg.norm(A, 2)), 1.0)
    C = np.asarray(C / np.where(rows > 0, rows, 1.0) * scale, dtype=np.float64)
    values = np.linalg.eigvals(A)
    lost = [
        np.linalg.svd(np.vstack([z * np.eye(n) - A, C]), compute_uv=False)[-1] <= PBH * scale
        for z in values
    ]
    return np.asarray(values[np.array(lost, dtype=bool)], dtype=np.complex128)


def check_span(X: Array, magnitude: Array, n: int) -> None:
    """RankError unless the centred states and inputs (K, n+m) span n + m directions above
    rounding."""
    scaled = X / np.where(magnitude > 0, magnitude, 1.0)
    rank = _rank(scaled[:, :n])
    if rank < n:
        raise RankError(
            f"history: expected states that span n = {n} directions about their mean, "
            f"found {rank}: some combination of the states never changes"
        )
    for j in range(n, X.shape[1]):
        if np.ptp(scaled[:, j]) <= 4 * np.finfo(float).eps:
            raise RankError(
                f"history: expected inputs that change, found input {j - n} (counted from 0) "
                "constant: its effect is unknown; leave it out of the recording"
            )
    rank = _rank(scaled)
    if rank < X.shape[1]:
        raise RankError(
            f"history: expected states and inputs that span n + m = {X.shape[1]} directions about "
            f"their means, found {rank}: u follows the state, or inputs move together, so that "
            "their effects cannot be told apart"
        )


def _rank(X: Array) -> int:
    """Directions of X (K, k) above rounding, its entries up to 1 before the mean was taken off."""
    sigma = np.linalg.svd(X, compute_uv=False)
    floor = np.finfo(float).eps * len(X) ** 0.5 * max(float(sigma[0]), 1.0)
    return int(np.sum(sigma > floor)) if len(sigma) else 0


def _least_squares(X: Array, Z: Array, history: History) -> Array:
    scale = np.linalg.norm(X, axis=0)
    solution = np.linalg.lstsq(X / scale, Z, rcond=None)[0]
    return np.asarray(solution / scale[:, None])


def _total_least_squares(X: Array, Z: Array, history: History) -> Array:
    """From the null space of the scaled, centred [X Z]; centring has taken care of the exact ones
    column, and what the exact inputs explain is taken off too (Golub, Hoffman, Stewart 1987)."""
    n = history.n
    X, U = X[:, :n], X[:, n:]
    noise_x, noise_y = recorded_noise(history)
    noise = np.concatenate([noise_x, noise_x, noise_y])
    both = np.hstack([X, Z])
    both = both - U @ slopes(U, both) if history.m else both
    spread = both.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    scale = np.maximum(noise, EXACT_CHANNEL * spread)
    V = np.linalg.svd(both / scale, full_matrices=True)[2].T
    V12, V22 = V[:n, n:], V[n:, n:]
    theta = -np.linalg.lstsq(V22.T, V12.T, rcond=None)[0].T
    of_x = np.asarray(scale[:n, None] ** -1 * theta * scale[None, n:])
    return np.vstack([of_x, slopes(U, Z - X @ of_x)]) if history.m else of_x


def recorded_noise(history: History) -> tuple[Array, Array]:
    """Noise of each channel of x and of y, from fifth differences.

    Δ⁵x(k) = (A - I)⁵ x(k) + Σ_j c_j u(k+j), j = 0 … 4, and Δ⁵y(k) up to j = 5: what inputs make of
    a fifth difference is a combination of those six, and is taken off before its size is read."""
    if not history.m:
        return noise_levels(history)
    n, p, m = history.n, history.p, history.m
    differences, inputs = [np.zeros((0, n + p))], [np.zeros((0, 6 * m))]
    for (x, y), u in zip(history.recordings, history.inputs, strict=True):
        if len(y) > 5:
            differences.append(np.diff(np.hstack([x[:-1], y]), 5, axis=0))
            inputs.append(np.hstack([u[j : len(u) - 5 + j] for j in range(6)]))
    left, U = np.concatenate(differences), np.concatenate(inputs)
    left = left - U @ slopes(U, left)
    freedom = len(left) - 6 * m
    if freedom < 1:
        return np.zeros(n), np.zeros(p)
    level = np.sqrt((left**2).sum(axis=0) / freedom / FIFTH_DIFFERENCE)
    return level[:n], level[n:]


_METHODS: dict[str, Callable[[Array, Array, History], Array]] = {
    "least squares": _least_squares,
    "total least squares": _total_least_squares,
}
