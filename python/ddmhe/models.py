"""The systems of the papers, for simulation: what an experiment would have recorded.

Each model is a frozen dataclass whose fields are its parameters (SI units); ``simulate`` makes a
`Recording`. The estimator never sees a model, only recordings.

- `detumbling`: 3-DOF eddy-current braking of a tumbling satellite, Liu et al. 2026, Section IV-B.
- `spin_down`: the single-axis bench, Liu et al. 2026, Section IV-A.
- `pendulum`: the planar pendulum of the interval paper, (60).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, ShapeError, numbers
from ddmhe.checks import check_finite, check_number, check_path, check_whole, choice

Array = NDArray[np.float64]

__all__ = [
    "Detumbling",
    "Pendulum",
    "Recording",
    "SpinDown",
    "TorqueCurve",
    "detumbling",
    "pendulum",
    "spin_down",
]


@dataclass(frozen=True, eq=False)
class Recording:
    """A simulated experiment of N steps; row k of every array belongs to time t[k] = k dt."""

    t: Array
    """Time (N+1,), s."""
    x: Array
    """True state (N+1, n)."""
    y: Array
    """Measured output (N+1, p), noise included."""
    x_recorded: Array
    """State as its sensor reads it (N+1, n): equal to x unless the model has a sensor that
    rounds."""
    x_units: tuple[str, ...] = ()
    """Units of the states (n)."""
    y_units: tuple[str, ...] = ()
    """Units of the outputs (p)."""

    def history(self, samples: int | None = None) -> History:
        """The first `samples` outputs (default all but the last) and the states as recorded, with
        their units."""
        T = len(self.y) - 1 if samples is None else samples
        check_whole("samples", T, 1, len(self.y) - 1)
        x_units, y_units = self.x_units or None, self.y_units or None
        return History(
            self.x_recorded[: T + 1], self.y[:T], float(self.t[1]), x_units=x_units, y_units=y_units
        )


MOST_STEPS = 100_000_000
"""Simulated steps that may fit into memory."""


class _Model:
    """A system dx/dt = derivative(x), y = output(x), started at `initial_state`."""

    x_units: ClassVar[tuple[str, ...]] = ()
    """Units of the states (n)."""
    y_units: ClassVar[tuple[str, ...]] = ()
    """Units of the outputs (p)."""

    @property
    def initial_state(self) -> Array:
        raise NotImplementedError

    def derivative(self, x: ArrayLike) -> Array:
        raise NotImplementedError

    def output(self, x: ArrayLike) -> Array:
        raise NotImplementedError

    def _as_recorded(self, x: Array, dt: float) -> Array:
        return x.copy()

    def simulate(
        self,
        duration: float,
        dt: float,
        noise: float = 0.0,
        seed: int = 0,
        integrator: str = "euler",
        *,
        disturbance: ArrayLike | None = None,
    ) -> Recording:
        """Simulate N = duration/dt steps from the initial state.

        Parameters
        ----------
        duration : float
            Simulated time, s; a multiple of dt.
        dt : float
            Sampling interval, s.
        noise : float
            Standard deviation of the white Gaussian noise on every output, in the output's unit.
        seed : int
            Seed of numpy's default_rng.
        integrator : "euler" or "accurate"
            Forward Euler with step dt, as in Liu et al. 2026, Eq. (4), or an eighth-order
            Runge-Kutta method (DOP853) at relative tolerance 2.3e-14, the smallest that it takes.
        disturbance : array (N, n)
            Process disturbance w of (5), in the state's unit: w(k) is added to the state at the end
            of step k.

        Raises
        ------
        DdmheError
            duration not a multiple of dt, dt or duration not positive, noise negative, an unknown
            integrator, or a motion that leaves all bounds (Euler with too large a dt).
        """
        steps = _steps(duration, dt)
        check_number("noise", noise, "a finite number of at least 0", lambda size: size >= 0)
        check_whole("seed", seed, 0)
        choice("integrator", integrator, _INTEGRATORS)
        t: Array = dt * np.arange(steps + 1, dtype=np.float64)
        w = (
            None
            if disturbance is None
            else _shaped("disturbance", disturbance, (steps, self.initial_state.size))
        )
        x = _INTEGRATORS[integrator](self, t, dt, w)
        if not np.isfinite(x).all():
            raise DdmheError(
                f"dt: expected one small enough, found that the {integrator!r} motion diverges at "
                f"{dt} s"
            )
        y = self.output(x)
        y += noise * np.random.default_rng(seed).standard_normal(y.shape)
        return Recording(t, x, y, self._as_recorded(x, dt), self.x_units, self.y_units)


@dataclass(frozen=True, eq=False)
class Detumbling(_Model):
    """Eddy-current de-tumbling of a satellite by a chaser with a magnet, Liu et al. 2026, Section
    IV-B.

    State: angular velocity of the target, rad/s (n = 3). Output: torque on the chaser, N·m (p = 3).
    Euler's equations (2) with the magnetic dipole model (39)-(41). Defaults are the paper's."""

    x_units: ClassVar[tuple[str, ...]] = ("rad/s",) * 3
    y_units: ClassVar[tuple[str, ...]] = ("N m",) * 3
    inertia: Array = field(default_factory=lambda: np.array([4513.2, 4138.1, 3282.5]))
    """Inertia of the target, kg·m²: (3,) principal moments or (3, 3) symmetric positive definite;
    kept as (3, 3)."""
    M_eff: Array = field(default_factory=lambda: 0.89e5 * np.diag([5.908, 5.908, 1.951]))
    """Effective magnetic tensor of the target (3, 3), S·m⁴."""
    omega_chaser: Array = field(default_factory=lambda: np.zeros(3))
    """Angular velocity of the chaser (3,), rad/s."""
    omega_0: Array = field(default_factory=lambda: np.deg2rad([14.364, 1.224, 3.4195]))
    """Angular velocity of the target at t = 0 (3,), rad/s."""
    B: Array = field(default_factory=lambda: 1e-4 * np.array([41.0, 51.0, -41.0]))
    """Magnetic flux density at the target (3,), T."""
    r: Array = field(default_factory=lambda: np.array([0.5, 1.0, 0.5]))
    """Position of the target seen from the chaser (3,), m."""
    Lambda: Array = field(
        default_factory=lambda: 1e-4 * np.array([[-23, -116, 8], [-116, -119, 49], [8, 49, 142.0]])
    )
    """Gradient of the flux density at the target (3, 3), T/m."""

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        inertia = _numbers("inertia", self.inertia)
        _set(self, "inertia", np.diag(inertia) if inertia.shape == (3,) else inertia)
        for name in ("inertia", "M_eff", "Lambda"):
            _set(self, name, _shaped(name, getattr(self, name), (3, 3)))
        for name in ("omega_chaser", "omega_0", "B", "r"):
            _set(self, name, _shaped(name, getattr(self, name), (3,)))
        symmetric = np.allclose(self.inertia, self.inertia.T, rtol=1e-12, atol=0)
        if not symmetric or np.linalg.eigvalsh(self.inertia).min() <= 0:
            raise DdmheError(
                "inertia: expected a symmetric positive definite matrix, found one that is not"
            )

    @property
    def initial_state(self) -> Array:
        """omega_0 (3,), rad/s."""
        return self.omega_0.copy()

    def torque(self, omega: ArrayLike) -> Array:
        """Torque on the target τ_t, Eq. (39): (…, 3) rad/s to (…, 3) N·m."""
        return _cross(self._moment(omega), self.B)

    def output(self, x: ArrayLike) -> Array:
        """Torque on the chaser τ_c = -τ_t - r × F_ct, Eqs. (40), (41): (…, 3) rad/s to (…, 3)
        N·m."""
        force = self._moment(x) @ self.Lambda.T
        return -self.torque(x) - _cross(self.r, force)

    def derivative(self, x: ArrayLike) -> Array:
        """Euler's equations, Eq. (2): (…, 3) rad/s to (…, 3) rad/s²."""
        omega = np.asarray(x, dtype=np.float64)
        torque = self.torque(omega) - _cross(omega, omega @ self.inertia.T)
        return np.asarray(
            np.linalg.solve(self.inertia, torque[..., None])[..., 0], dtype=np.float64
        )

    def _moment(self, omega: ArrayLike) -> Array:
        """Induced magnetic moment M_eff ((ω_t - ω_c) × B), A·m²."""
        slip = np.asarray(omega, dtype=np.float64) - self.omega_chaser
        return _cross(slip, self.B) @ self.M_eff.T


@dataclass(frozen=True, eq=False)
class TorqueCurve:
    """Braking torque over slip speed as a table; linear between its points, odd in the speed."""

    speed: Array
    """Slip speeds (K,), rad/s, from 0 upwards, strictly increasing."""
    torque: Array
    """Braking torques (K,), N·m, at least 0 and 0 at standstill."""

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        _set(self, "speed", _numbers("speed", self.speed))
        _set(self, "torque", _shaped("torque", self.torque, self.speed.shape))
        if self.speed.ndim != 1 or self.speed.size < 2:
            raise ShapeError(
                f"speed: expected at least 2 speeds in a 1-D array, found shape {self.speed.shape}"
            )
        if self.speed[0] != 0 or (np.diff(self.speed) <= 0).any():
            raise DdmheError(
                "speed: expected speeds that start at 0 and strictly increase, found others"
            )
        if self.torque[0] != 0 or (self.torque < 0).any():
            raise DdmheError(
                "torque: expected braking torques of at least 0 that start at 0, found others"
            )

    @classmethod
    def from_csv(cls, path: str | Path) -> TorqueCurve:
        """Read columns ``slip_speed_rpm`` and ``torque_N_m`` (rpm, N·m); DdmheError if the file
        does not hold them."""
        check_path("path", path)
        try:
            table = np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8")
        except (OSError, ValueError, TypeError) as e:
            reason = " ".join(str(e).split())
            raise DdmheError(
                f"path: expected a readable CSV file, found {str(path)!r} ({reason})"
            ) from e
        missing = [
            c for c in ("slip_speed_rpm", "torque_N_m") if c not in (table.dtype.names or ())
        ]
        if missing:
            raise DdmheError(
                f"path: expected columns slip_speed_rpm and torque_N_m, {str(path)!r} lacks "
                f"{missing}"
            )
        return cls(table["slip_speed_rpm"] * (2 * math.pi / 60), table["torque_N_m"])

    def __call__(self, omega: ArrayLike) -> Array:
        """Torque against the motion, N·m, at speeds omega (any shape), rad/s; the last torque
        beyond the table."""
        omega = np.asarray(omega, dtype=np.float64)
        torque: Array = np.sign(omega) * np.interp(np.abs(omega), self.speed, self.torque)
        return torque


@dataclass(frozen=True, eq=False)
class SpinDown(_Model):
    """Single-axis bench: a freely spinning metal target braked by a magnet, Liu et al. 2026,
    Section IV-A.

    State: spin speed, rad/s (n = 1). Output: eddy torque at the transducer, N·m (p = 1).
    inertia dω/dt = -(eddy(ω) + viscous ω + coulomb tanh(ω/coulomb_speed)).

    The paper prints none of these numbers. The defaults are a plausible hand-sized bench: about 290
    rpm, 0.15 N·m of eddy torque, a decay time of 1 s, so that the speed falls by 40 % in the
    paper's 0.5 s of history."""

    x_units: ClassVar[tuple[str, ...]] = ("rad/s",)
    y_units: ClassVar[tuple[str, ...]] = ("N m",)
    inertia: float = 5e-3
    """Inertia of the target, kg·m²."""
    eddy: float = 5e-3
    """Linear eddy-current damping, N·m·s; unused if torque_curve is given."""
    viscous: float = 2e-4
    """Viscous bearing friction, N·m·s."""
    coulomb: float = 2e-3
    """Coulomb bearing friction, N·m."""
    coulomb_speed: float = 0.05
    """Speed over which the Coulomb friction changes its sign, rad/s: keeps the motion smooth at
    standstill."""
    omega_0: float = 30.0
    """Spin speed at t = 0, rad/s."""
    torque_curve: TorqueCurve | None = None
    """Eddy torque over speed, in place of the linear law; must reach omega_0."""
    torque_bias: float = 0.0
    """Constant error of the torque transducer, N·m."""
    encoder_counts: int | None = None
    """Counts per revolution of the encoder: x_recorded is rounded to one count per sample. None: no
    rounding."""

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        for name in ("inertia", "coulomb_speed"):
            _scalar(self, name, above=0)
        for name in ("eddy", "viscous", "coulomb"):
            _scalar(self, name, at_least=0)
        for name in ("omega_0", "torque_bias"):
            _scalar(self, name)
        counts = self.encoder_counts
        if counts is not None:
            check_whole("encoder_counts", counts)
        curve = self.torque_curve
        if curve is not None and not isinstance(curve, TorqueCurve):
            raise DdmheError(
                f"torque_curve: expected a TorqueCurve or None, found {type(curve).__name__}"
            )
        if curve is not None and abs(self.omega_0) > curve.speed[-1]:
            limits = f"up to omega_0 = {self.omega_0:g} rad/s, found up to {curve.speed[-1]:g}"
            raise DdmheError(f"torque_curve: expected speeds {limits}")

    @property
    def initial_state(self) -> Array:
        """omega_0 (1,), rad/s."""
        return np.array([self.omega_0])

    def torque(self, omega: ArrayLike) -> Array:
        """Eddy torque against the motion, rad/s to N·m, any shape."""
        if self.torque_curve is not None:
            return self.torque_curve(omega)
        return self.eddy * np.asarray(omega, dtype=np.float64)

    def output(self, x: ArrayLike) -> Array:
        """Transducer reading, eddy torque plus bias: (…, 1) rad/s to (…, 1) N·m."""
        return self.torque(x) + self.torque_bias

    def derivative(self, x: ArrayLike) -> Array:
        """Spin acceleration: (…, 1) rad/s to (…, 1) rad/s²."""
        omega = np.asarray(x, dtype=np.float64)
        friction = self.viscous * omega + self.coulomb * np.tanh(omega / self.coulomb_speed)
        return -(self.torque(omega) + friction) / self.inertia

    def _as_recorded(self, x: Array, dt: float) -> Array:
        if self.encoder_counts is None:
            return x.copy()
        resolution = 2 * math.pi / (self.encoder_counts * dt)
        return resolution * np.round(x / resolution)


@dataclass(frozen=True, eq=False)
class Pendulum(_Model):
    """Planar pendulum of the interval paper, (60): with dt = 0.065 s forward Euler gives exactly
    its matrices.

    State: angle (rad) and rate (rad/s), n = 2. Output: angle, rad (p = 1). x1⁺ = x1 + dt x2,
    x2⁺ = x2 - dt stiffness sin x1.
    """

    x_units: ClassVar[tuple[str, ...]] = ("rad", "rad/s")
    y_units: ClassVar[tuple[str, ...]] = ("rad",)
    paper_dt: ClassVar[float] = 0.065
    """Sampling interval of the paper, s."""

    stiffness: float = 1.0
    """Gravity over length, 1/s²."""
    x_0: Array = field(default_factory=lambda: np.array([1.0, 0.0]))
    """Angle (rad) and rate (rad/s) at t = 0 (2,)."""

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        _scalar(self, "stiffness", above=0)
        _set(self, "x_0", _shaped("x_0", self.x_0, (2,)))

    @property
    def initial_state(self) -> Array:
        """x_0 (2,): angle, rad, and rate, rad/s."""
        return self.x_0.copy()

    def torque(self, angle: ArrayLike) -> Array:
        """Restoring torque per inertia, -stiffness sin(angle), 1/s²: angle of any shape, rad."""
        return -self.stiffness * np.sin(np.asarray(angle, dtype=np.float64))

    def output(self, x: ArrayLike) -> Array:
        """Angle: (…, 2) to (…, 1) rad."""
        return np.asarray(x, dtype=np.float64)[..., :1].copy()

    def derivative(self, x: ArrayLike) -> Array:
        """Rate and angular acceleration: (…, 2) to (…, 2)."""
        x = np.asarray(x, dtype=np.float64)
        return np.stack([x[..., 1], self.torque(x[..., 0])], axis=-1)


def detumbling(**overrides: Any) -> Detumbling:
    """The 3-DOF case of Liu et al. 2026, Section IV-B, with any field of `Detumbling`
    overridden."""
    return _build(Detumbling, overrides)


def spin_down(**overrides: Any) -> SpinDown:
    """The single-axis bench of Liu et al. 2026, Section IV-A, with any field of `SpinDown`
    overridden."""
    return _build(SpinDown, overrides)


def pendulum(**overrides: Any) -> Pendulum:
    """The pendulum of the interval paper, (60), with any field of `Pendulum` overridden."""
    return _build(Pendulum, overrides)


_M = TypeVar("_M", Detumbling, SpinDown, Pendulum)


def _build(model: type[_M], overrides: dict[str, Any]) -> _M:
    known = [f.name for f in fields(model)]
    unknown = [name for name in overrides if name not in known]
    if unknown:
        raise DdmheError(
            f"{unknown[0]}: expected a parameter of {model.__name__}: {', '.join(known)}"
        )
    return model(**overrides)


def _steps(duration: float, dt: float) -> int:
    for name, value in (("dt", dt), ("duration", duration)):
        check_number(name, value, "a positive number of seconds", lambda seconds: seconds > 0)
    if not duration / dt <= MOST_STEPS:
        raise DdmheError(
            f"duration: expected at most {MOST_STEPS} steps of dt = {dt} s, found {duration} s"
        )
    steps = round(duration / dt)
    if abs(steps * dt - duration) > 1e-9 * duration:
        raise DdmheError(f"duration: expected a multiple of dt = {dt} s, found {duration} s")
    return steps


def _euler(model: _Model, t: Array, dt: float, w: Array | None) -> Array:
    """Forward Euler x(k+1) = x(k) + dt f(x(k)), Liu et al. 2026, Eq. (4)."""
    x = np.empty((t.size, model.initial_state.size))
    x[0] = model.initial_state
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(t.size - 1):
            x[k + 1] = x[k] + dt * model.derivative(x[k]) + (0.0 if w is None else w[k])
    return x


def _accurate(model: _Model, t: Array, dt: float, w: Array | None) -> Array:
    from scipy.integrate import solve_ivp

    def motion(x_0: Array, times: Array) -> Array:
        found = solve_ivp(
            lambda _, x: model.derivative(x),
            (0.0, times[-1]),
            x_0,
            "DOP853",
            t_eval=times,
            rtol=2.3e-14,
            atol=1e-16,
        ).y.T
        return np.asarray(np.vstack([found, np.full((len(times) - len(found), len(x_0)), np.nan)]))

    if w is None:
        return motion(model.initial_state, t)
    x = np.vstack([model.initial_state, np.empty_like(w)])
    for k in range(len(w)):
        x[k + 1] = motion(x[k], np.array([0.0, dt]))[-1] + w[k]
    return x


_INTEGRATORS = {"euler": _euler, "accurate": _accurate}


def _cross(a: Array, b: Array) -> Array:
    """a × b of (…, 3), one of them perhaps (3,).

    Written out: numpy.cross takes eight times as long for one vector, and an integrator asks for
    one at a time."""
    (a_1, a_2, a_3), (b_1, b_2, b_3) = a.T, b.T
    product = np.array([a_2 * b_3 - a_3 * b_2, a_3 * b_1 - a_1 * b_3, a_1 * b_2 - a_2 * b_1])
    return np.ascontiguousarray(product.T)


def _numbers(name: str, value: ArrayLike) -> Array:
    found = numbers(name, value)
    check_finite(name, found)
    return found


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = _numbers(name, value)
    if array.shape != shape:
        raise ShapeError(f"{name}: expected shape {shape}, found {array.shape}")
    return array


def _scalar(
    model: object, name: str, above: float = -math.inf, at_least: float = -math.inf
) -> None:
    value = float(_shaped(name, getattr(model, name), ()))
    if value <= above or value < at_least:
        limit = f"above {above:g}" if value <= above else f"of at least {at_least:g}"
        raise DdmheError(f"{name}: expected a number {limit}, found {value:g}")
    _set(model, name, value)


def _set(model: object, name: str, value: Array | float) -> None:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    object.__setattr__(model, name, value)
