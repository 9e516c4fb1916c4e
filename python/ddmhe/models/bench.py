"""The single-axis bench: a spinning target braked by a magnet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError
from ddmhe.checks import check_whole
from ddmhe.models.parameters import scalar
from ddmhe.models.system import Model
from ddmhe.models.torque_curve import TorqueCurve

Array = NDArray[np.float64]

__all__ = ["SpinDown"]


@dataclass(frozen=True, eq=False)
class SpinDown(Model):
    """Single-axis bench: a freely spinning metal target braked by a magnet, Liu et al. 2026,
    Section IV-A.

    State: spin speed, rad/s (n = 1). Output: eddy torque at the transducer, N·m (p = 1).
    inertia dω/dt = -(eddy(ω) + viscous ω + coulomb tanh(ω/coulomb_speed)).

    The paper prints none of these numbers. The defaults are a plausible hand-sized bench: about 290
    rpm, 0.15 N·m of eddy torque, a decay time of 1 s, so that the speed falls by 40 % in the
    paper's 0.5 s of history.

    Examples
    --------
    >>> import ddmhe
    >>> bench = ddmhe.models.SpinDown(omega_0=20.0, encoder_counts=4096)
    >>> bench.simulate(duration=1.0, dt=0.02).x[0]
    array([20.])
    """

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
            scalar(self, name, above=0)
        for name in ("eddy", "viscous", "coulomb"):
            scalar(self, name, at_least=0)
        for name in ("omega_0", "torque_bias"):
            scalar(self, name)
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
