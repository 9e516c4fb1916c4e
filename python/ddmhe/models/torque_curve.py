"""Braking torque over slip speed, as it was measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, ShapeError
from ddmhe.checks import check_path, file_words, reason
from ddmhe.models.parameters import finite_numbers, set_field, shaped

Array = NDArray[np.float64]

__all__ = ["TorqueCurve"]


@dataclass(frozen=True, eq=False)
class TorqueCurve:
    """Braking torque over slip speed as a table; linear between its points, odd in the speed.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> curve = ddmhe.models.TorqueCurve(np.array([0.0, 10.0, 30.0]), np.array([0.0, 0.05, 0.08]))
    >>> ddmhe.models.SpinDown(torque_curve=curve).simulate(1.0, 0.02).y.shape
    (51, 1)
    """

    speed: Array
    """Slip speeds (K,), rad/s, from 0 upwards, strictly increasing."""
    torque: Array
    """Braking torques (K,), N·m, at least 0 and 0 at standstill."""

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        set_field(self, "speed", finite_numbers("speed", self.speed))
        set_field(self, "torque", shaped("torque", self.torque, self.speed.shape))
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
            raise DdmheError(
                f"path: expected a readable CSV file, found '{file_words(path)}' ({reason(e)})"
            ) from e
        missing = [
            c for c in ("slip_speed_rpm", "torque_N_m") if c not in (table.dtype.names or ())
        ]
        if missing:
            raise DdmheError(
                f"path: expected columns slip_speed_rpm and torque_N_m, '{file_words(path)}' lacks "
                f"{missing}"
            )
        return cls(table["slip_speed_rpm"] * (2 * math.pi / 60), table["torque_N_m"])

    def __call__(self, omega: ArrayLike) -> Array:
        """Torque against the motion, N·m, at speeds omega (any shape), rad/s; the last torque
        beyond the table."""
        omega = np.asarray(omega, dtype=np.float64)
        torque: Array = np.sign(omega) * np.interp(np.abs(omega), self.speed, self.torque)
        return torque
