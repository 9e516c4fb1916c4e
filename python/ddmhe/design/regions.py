"""LMI regions of the complex plane: {z : L + z M + z̄ Mᵀ ≺ 0} (Chilali, Gahinet 1996; Liu et al.
2026, Definition 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import check_flag, check_number

Array = NDArray[np.float64]

__all__ = ["Cone", "Disc", "HalfPlane", "Region"]


@dataclass(frozen=True)
class Disc:
    """|z - centre| < radius, the centre on the real axis. With centre 0 this is the disc of
    (54).

    Examples
    --------
    >>> import ddmhe
    >>> left, middle = ddmhe.design.Disc(0.9).matrices()
    >>> left.shape
    (2, 2)
    """

    radius: float
    centre: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        check_number("radius", self.radius, "a positive number", lambda radius: radius > 0)
        check_number("centre", self.centre, "a finite number", lambda _: True)

    def matrices(self) -> tuple[Array, Array]:
        """L and M."""
        q, r = -self.centre, self.radius
        return np.array([[-r, q], [q, -r]]), np.array([[0.0, 1.0], [0.0, 0.0]])


@dataclass(frozen=True)
class HalfPlane:
    """Re z < bound (or Re z > bound with `right`).

    Examples
    --------
    >>> import ddmhe
    >>> region = ddmhe.design.HalfPlane(0.7)
    >>> placed = ddmhe.design.pole_placement(A=[[0.9]], C=[[1.0]], region=region)
    >>> bool(placed.poles.real.max() < 0.7)
    True
    """

    bound: float
    right: bool = False

    def __post_init__(self) -> None:
        """Check the fields."""
        check_number("bound", self.bound, "a finite number", lambda _: True)
        check_flag("right", self.right)

    def matrices(self) -> tuple[Array, Array]:
        """L and M."""
        sign = -1.0 if self.right else 1.0
        return np.array([[-2.0 * sign * self.bound]]), np.array([[sign]])


@dataclass(frozen=True)
class Cone:
    """|arg(z - apex)| < angle about the positive real axis, or about the negative one without
    `right`; angle in rad.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> region = ddmhe.design.Cone(np.pi / 4)  # damped more than 45 degrees
    >>> placed = ddmhe.design.pole_placement(A=[[0.9]], C=[[1.0]], region=region)
    >>> bool(abs(np.angle(placed.poles)).max() < np.pi / 4)
    True
    """

    angle: float
    apex: float = 0.0
    right: bool = True

    def __post_init__(self) -> None:
        """Check the fields."""
        check_number(
            "angle", self.angle, "an angle in (0, pi/2)", lambda angle: 0 < angle < math.pi / 2
        )
        check_number("apex", self.apex, "a finite number", lambda _: True)
        check_flag("right", self.right)

    def matrices(self) -> tuple[Array, Array]:
        """L and M of sin(angle)·(-|Re|) + cos(angle)·|Im| < 0, turned to the side that is meant."""
        s, c, sign = math.sin(self.angle), math.cos(self.angle), -1.0 if self.right else 1.0
        M = np.array([[sign * s, c], [-c, sign * s]])
        return -sign * 2.0 * s * self.apex * np.eye(2), M


Region = Disc | HalfPlane | Cone
