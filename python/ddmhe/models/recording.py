"""A simulated experiment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.checks import check_whole

Array = NDArray[np.float64]

__all__ = ["Recording"]


@dataclass(frozen=True, eq=False)
class Recording:
    """A simulated experiment of N steps; row k of every array belongs to time t[k] = k dt.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
    >>> record.history(200).x_units
    ['rad/s', 'rad/s', 'rad/s']
    """

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
