"""Systems x(k+1) = A x + B u + f(x) + D1 w, y = C x + r + D2 v with Df(x) in [j_lo, j_hi], (13),
(14)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe import models
from ddmhe._core import DdmheError, Dynamics, NotFiniteError, ShapeError, numbers
from ddmhe.checks import check_kind, check_number

Array = NDArray[np.float64]
Function = Callable[[Array], ArrayLike]
Jacobian = Callable[[Array, Array], tuple[ArrayLike, ArrayLike]]

__all__ = ["System", "detumbling", "linear", "matrix", "pendulum", "radius_of", "van_der_pol"]

SLACK = 1e-13
"""Relative rounding error that is granted to f and jacobian given as Python functions."""


def matrix(name: str, value: ArrayLike, shape: tuple[int, ...], finite: bool = True) -> Array:
    """A float array of the shape, -1 for any length; an error that names the argument otherwise."""
    array = numbers(name, value)
    wanted = f"({', '.join('any' if s < 0 else str(s) for s in shape)})"
    if array.ndim != len(shape) or any(
        s >= 0 and s != found for s, found in zip(shape, array.shape, strict=True)
    ):
        raise ShapeError(f"{name}: expected an array of shape {wanted}, found {array.shape}")
    if np.isnan(array).any() or (finite and not np.isfinite(array).all()):
        raise NotFiniteError(
            f"{name}: expected finite numbers, found {array[~np.isfinite(array)][0]}"
        )
    return array


def radius_of(name: str, value: ArrayLike, length: int) -> Array:
    """(length,) radii from as many, or from one that serves all; DdmheError unless they are at
    least 0."""
    given = numbers(name, value)
    array = matrix(name, np.full(length, given) if given.ndim == 0 else given, (length,))
    if (array < 0).any():
        raise DdmheError(f"{name}: expected radii of at least 0, found {array.min()}")
    return array


@dataclass(frozen=True, eq=False)
class System:
    """What is known of a system: (13) and (14).

    x(k+1) = A x + B u + f(x) + D1 w, y = C x + r + D2 v. The bounds
    |w| <= w_radius, |v| <= v_radius are the observer's.

    Raises
    ------
    ShapeError, NotFiniteError, DdmheError
        Shapes that do not fit, NaN, j_lo above j_hi, f or jacobian not callable.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> dt = 0.05
    >>> system = ddmhe.interval.System(
    ...     A=[[1.0, dt], [0.0, 1.0]],
    ...     C=[[1.0, 0.0]],
    ...     D1=np.eye(2),
    ...     D2=[[1.0]],
    ...     f=lambda x: np.array([0.0, -dt * np.sin(x[0])]),
    ...     jacobian=lambda lo, hi: ([[0, 0], [-dt, 0]], [[0, 0], [dt, 0]]),
    ...     j_lo=[[0, 0], [-dt, 0]],
    ...     j_hi=[[0, 0], [dt, 0]],
    ... )
    >>> system.n, system.p
    (2, 1)
    """

    A: Array
    """(n, n)"""
    C: Array
    """(p, n)"""
    D1: Array
    """(n, n_w)"""
    D2: Array
    """(p, n_v)"""
    f: Function | None
    """f(x) -> (n,), x (n,): accurate to 1e-13 of each value. None: no nonlinear part."""
    jacobian: Jacobian | None
    """jacobian(lo, hi) -> (J_lo, J_hi), (n, n) each: must enclose Df over the box, to 1e-13 of each
    value."""
    j_lo: Array
    """(n, n): lower bounds of Df wherever the state may be."""
    j_hi: Array
    """(n, n): upper bounds of Df."""
    B: Array | None = None
    """(n, n_u), or None without input."""
    r: Array | None = field(default=None, kw_only=True)
    """Offset of the output (p,), or None for zero."""
    dynamics: Dynamics = field(default=None, kw_only=True, repr=False)  # type: ignore[assignment]
    """How the core computes f itself; None: it calls f and jacobian."""

    def __post_init__(self) -> None:
        """Check everything once."""
        A = matrix("A", self.A, (-1, -1))
        n = len(A)
        if n == 0:
            raise ShapeError("A: expected at least one state, found none")
        A = matrix("A", A, (n, n))
        C = matrix("C", self.C, (-1, n))
        p = len(C)
        if p == 0:
            raise ShapeError("C: expected at least one output, found none")
        parts: dict[str, Any] = {"A": A, "C": C}
        parts["D1"] = matrix("D1", self.D1, (n, -1))
        parts["D2"] = matrix("D2", self.D2, (p, -1))
        parts["B"] = None if self.B is None else matrix("B", self.B, (n, -1))
        parts["r"] = None if self.r is None else matrix("r", self.r, (p,))
        parts["j_lo"], parts["j_hi"] = (
            matrix(k, getattr(self, k), (n, n), finite=False) for k in ("j_lo", "j_hi")
        )
        if (parts["j_lo"] > parts["j_hi"]).any():
            i, j = np.argwhere(parts["j_lo"] > parts["j_hi"])[0]
            found = f"{parts['j_lo'][i, j]} and {parts['j_hi'][i, j]} in row {i}, column {j}"
            raise DdmheError(f"j_lo: expected numbers not above those of j_hi, found {found}")
        for name, value in parts.items():
            object.__setattr__(self, name, value)
        if (self.f is None) != (self.jacobian is None):
            raise DdmheError("f, jacobian: expected both or neither, found one")
        for name in ("f", "jacobian"):
            if getattr(self, name) is not None and not callable(getattr(self, name)):
                raise DdmheError(
                    f"{name}: expected a function, found {type(getattr(self, name)).__name__}"
                )
        if self.dynamics is None:
            own = self.f is not None
            found = Dynamics.python(self.f, self.jacobian, SLACK) if own else Dynamics.linear()
            object.__setattr__(self, "dynamics", found)
        elif not isinstance(self.dynamics, Dynamics):
            given = type(self.dynamics).__name__
            raise DdmheError(f"dynamics: expected a Dynamics of the core, found {given}")

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.C)

    @property
    def offset(self) -> Array:
        """Offset of the output (p,), zero if not given."""
        return np.zeros(self.p) if self.r is None else self.r

    def vertices(self) -> list[Array]:
        """Every vertex of [j_lo, j_hi], (n, n) each; entries with equal ends do not multiply."""
        free = np.argwhere(self.j_lo < self.j_hi)
        found = []
        for bits in range(1 << len(free)):
            J = self.j_lo.copy()
            for k, (i, j) in enumerate(free):
                if bits >> k & 1:
                    J[i, j] = self.j_hi[i, j]
            found.append(J)
        return found


# f and Df are methods of a plain object: these pickle, nested functions do not.


@dataclass(frozen=True)
class _Damping:
    """f = (0, -weight x1² x2)."""

    weight: float

    def f(self, x: Array) -> Array:
        return np.array([0.0, -self.weight * x[0] ** 2 * x[1]])

    def jacobian(self, lo: Array, hi: Array) -> tuple[Array, Array]:
        products = [a * b for a in (lo[0], hi[0]) for b in (lo[1], hi[1])]
        squares = [lo[0] ** 2, hi[0] ** 2]
        least = 0.0 if lo[0] <= 0 <= hi[0] else min(squares)
        J_lo, J_hi = np.zeros((2, 2)), np.zeros((2, 2))
        J_lo[1] = -self.weight * np.array([2 * max(products), max(squares)])
        J_hi[1] = -self.weight * np.array([2 * min(products), least])
        return J_lo, J_hi


def pendulum(model: models.Pendulum | None = None, dt: float = models.Pendulum.paper_dt) -> System:
    """The pendulum (60): x1⁺ = x1 + dt x2 + w1, x2⁺ = x2 - dt stiffness sin x1 + w2, y = x1 + 0.1
    v.

    Examples
    --------
    >>> import ddmhe
    >>> ddmhe.interval.pendulum().n
    2
    """
    model = (
        models.pendulum()
        if model is None
        else check_kind("model", model, models.Pendulum, "a Pendulum")
    )
    check_number("dt", dt, "a positive number of seconds", lambda seconds: seconds > 0)
    gain = dt * model.stiffness
    A = np.array([[1.0, dt], [0.0, 1.0]])
    bound = np.array([[0.0, 0.0], [gain, 0.0]])

    C, D2, f = np.array([[1.0, 0.0]]), np.array([[0.1]]), Dynamics.pendulum(gain)
    return System(A, C, np.eye(2), D2, f.f, f.jacobian, -bound, bound, dynamics=f)


def linear(
    A_lo: ArrayLike,
    A_hi: ArrayLike,
    C: ArrayLike,
    D1: ArrayLike,
    D2: ArrayLike,
    B: ArrayLike | None = None,
    *,
    C_radius: ArrayLike | None = None,
) -> System:
    """A linear system whose constant matrix is only known to lie in [A_lo, A_hi] (Remark 2); C ±
    C_radius likewise.

    Examples
    --------
    >>> import ddmhe
    >>> system = ddmhe.interval.linear([[0.85]], [[0.95]], C=[[1.0]], D1=[[1.0]], D2=[[1.0]])
    >>> ddmhe.interval.design_observer(system).verified
    True
    """
    lo, hi = matrix("A_lo", A_lo, (-1, -1)), matrix("A_hi", A_hi, (-1, -1))
    n = len(lo)
    lo, hi = matrix("A_lo", lo, (n, n)), matrix("A_hi", hi, (n, n))
    if (lo > hi).any():
        raise DdmheError("A_lo: expected numbers not above those of A_hi, found some above")
    middle = 0.5 * (lo + hi)
    radius = np.nextafter(np.maximum(hi - middle, middle - lo), np.inf) * (hi > lo)
    C = matrix("C", C, (-1, n))
    C_rad = np.zeros_like(C) if C_radius is None else matrix("C_radius", C_radius, C.shape)
    if (C_rad < 0).any():
        raise DdmheError(f"C_radius: expected radii of at least 0, found {C_rad.min()}")
    rows = [_axes(row) for row in (*radius, *C_rad)]
    f = Dynamics.uncertain(rows, [0.0] * n)
    D1, D2 = matrix("D1", D1, (n, -1)), matrix("D2", D2, (len(C), -1))
    B = None if B is None else matrix("B", B, (n, -1))
    return System(middle, C, D1, D2, None, None, -radius, radius, B, dynamics=f)


def _axes(radius: Array) -> list[float]:
    """Generators, n+1 numbers each, of a row known entry by entry: no offset."""
    n = len(radius)
    used = [j for j in range(n) if radius[j] > 0]
    found = np.zeros((len(used), n + 1))
    found[range(len(used)), used] = radius[used]
    return [float(v) for v in found.ravel()]


def detumbling(
    model: models.Detumbling | None = None,
    dt: float = 0.1,
    rate_bound: float = 0.3,
    uncertainty: float = 0.02,
) -> System:
    """The 3-DOF target of Liu et al. 2026, IV-B, known within bounds: inertia ratios and torque
    matrices ± uncertainty.

    x(k+1) = x + dt (a1 x2 x3, a2 x3 x1, a3 x1 x2) + dt N x + w, y = G x + v: forward Euler as in
    their (4), the rate of the chaser zero. Bounds: a_i = (J2-J3)/J1 …, every entry of N = J⁻¹
    ∂τ_t/∂ω and of G = ∂τ_c/∂ω within a relative `uncertainty`; |x_i| <= rate_bound (rad/s) wherever
    the target may be.

    Examples
    --------
    >>> import ddmhe
    >>> system = ddmhe.interval.detumbling()
    >>> system.n, system.p
    (3, 3)
    """
    model = (
        models.detumbling()
        if model is None
        else check_kind("model", model, models.Detumbling, "a Detumbling")
    )
    check_number("dt", dt, "a positive number of seconds", lambda seconds: seconds > 0)
    check_number("uncertainty", uncertainty, "a number in [0, 1)", lambda share: 0 <= share < 1)
    check_number("rate_bound", rate_bound, "a positive number of rad/s", lambda rate: rate > 0)
    J = np.diag(model.inertia)
    if np.any(model.inertia != np.diag(J)) or np.any(model.omega_chaser != 0):
        raise DdmheError("model: expected principal axes and a chaser at rest, found others")
    ratios = dt * (np.roll(J, -1) - np.roll(J, -2)) / J
    N = dt * (np.linalg.inv(model.inertia) @ np.array([model.torque(e) for e in np.eye(3)]).T)
    G = np.array([model.output(e) for e in np.eye(3)]).T
    d_ratios, d_N, d_G = (uncertainty * np.abs(v) for v in (ratios, N, G))
    # Df entry (i, j) is ratio_i times the third rate, plus what N may be off by
    off = np.abs(ratios) + d_ratios
    bound = off[:, None] * rate_bound * (1 - np.eye(3)) + d_N
    bound = np.nextafter(bound, np.inf) * (bound > 0)

    f = Dynamics.euler(
        (ratios - d_ratios, ratios + d_ratios), (-d_N.ravel(), d_N.ravel()), d_G.ravel()
    )
    eye = np.eye(3)
    return System(eye + N, G, eye, eye, f.f, f.jacobian, -bound, bound, dynamics=f)


def van_der_pol(dt: float = 0.05, mu: float = 1.0, bound: float = 3.0) -> System:
    """Van der Pol's oscillator by forward Euler, y = x1 + v; |x_i| <= bound wherever the state may
    be.

    x1⁺ = x1 + dt x2 + w1, x2⁺ = x2 + dt (mu (1 - x1²) x2 - x1) + w2, written as A x + f(x) with
    A = I + dt [[0, 1], [-1, mu]] and f = (0, -dt mu x1² x2).

    Examples
    --------
    >>> import ddmhe
    >>> ddmhe.interval.design_observer(ddmhe.interval.van_der_pol(), lam=0.5).verified
    True
    """
    check_number("dt", dt, "a positive number of seconds", lambda seconds: seconds > 0)
    check_number("mu", mu, "a finite number", lambda _: True)
    check_number("bound", bound, "a positive number", lambda size: size > 0)
    A = np.eye(2) + dt * np.array([[0.0, 1.0], [-1.0, mu]])
    box, motion = np.full(2, bound), _Damping(dt * mu)
    J_lo, J_hi = motion.jacobian(-box, box)
    pad = 1e-12 * np.abs(J_hi - J_lo)
    return System(
        A,
        np.array([[1.0, 0.0]]),
        np.eye(2),
        np.eye(1),
        motion.f,
        motion.jacobian,
        J_lo - pad,
        J_hi + pad,
    )
