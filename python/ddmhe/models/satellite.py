"""The tumbling satellite: eddy-current braking in three degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError
from ddmhe.models.parameters import finite_numbers, set_field, shaped
from ddmhe.models.system import Model
from ddmhe.tol import SYMMETRIC

Array = NDArray[np.float64]

__all__ = ["Detumbling"]


@dataclass(frozen=True, eq=False)
class Detumbling(Model):
    """Eddy-current de-tumbling of a satellite by a chaser with a magnet, Liu et al. 2026, Section
    IV-B.

    State: angular velocity of the target, rad/s (n = 3). Output: torque on the chaser, N·m (p = 3).
    Euler's equations (2) with the magnetic dipole model (39)-(41). Defaults are the paper's.

    Examples
    --------
    >>> import ddmhe
    >>> slow = ddmhe.models.Detumbling(omega_0=[0.05, 0.0, 0.02])
    >>> slow.simulate(duration=10.0, dt=0.1).x[0]
    array([0.05, 0.  , 0.02])
    """

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
        inertia = finite_numbers("inertia", self.inertia)
        set_field(self, "inertia", np.diag(inertia) if inertia.shape == (3,) else inertia)
        for name in ("inertia", "M_eff", "Lambda"):
            set_field(self, name, shaped(name, getattr(self, name), (3, 3)))
        for name in ("omega_chaser", "omega_0", "B", "r"):
            set_field(self, name, shaped(name, getattr(self, name), (3,)))
        symmetric = np.allclose(self.inertia, self.inertia.T, rtol=SYMMETRIC, atol=0)
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


def _cross(a: Array, b: Array) -> Array:
    """a × b of (…, 3), one of them perhaps (3,).

    Written out: numpy.cross takes eight times as long for one vector, and an integrator asks for
    one at a time."""
    (a_1, a_2, a_3), (b_1, b_2, b_3) = a.T, b.T
    product = np.array([a_2 * b_3 - a_3 * b_2, a_3 * b_1 - a_1 * b_3, a_1 * b_2 - a_2 * b_1])
    return np.ascontiguousarray(product.T)
