"""The planar pendulum of the interval paper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe.models.parameters import scalar, set_field, shaped
from ddmhe.models.system import Model

Array = NDArray[np.float64]

__all__ = ["Pendulum"]


@dataclass(frozen=True, eq=False)
class Pendulum(Model):
    """Planar pendulum of the interval paper, (60): with dt = 0.065 s forward Euler gives exactly
    its matrices.

    State: angle (rad) and rate (rad/s), n = 2. Output: angle, rad (p = 1). x1⁺ = x1 + dt x2,
    x2⁺ = x2 - dt stiffness sin x1.

    Examples
    --------
    >>> import ddmhe
    >>> ddmhe.models.Pendulum().simulate(duration=1.0, dt=0.05).y.shape
    (21, 1)
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
        scalar(self, "stiffness", above=0)
        set_field(self, "x_0", shaped("x_0", self.x_0, (2,)))

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
