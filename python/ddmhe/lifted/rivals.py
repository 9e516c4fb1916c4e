"""Which of two estimators predicts the newest outputs better."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.lifted.tol import BEHIND, RIVAL_LEAST, RIVAL_RATE

Array = NDArray[np.float64]

__all__ = ["Rivals"]


class Rivals(NamedTuple):
    """Moving means of the squared innovations of both, and what follows from them."""

    lifted: float = 0.0
    affine: float = 0.0
    samples: int = 0
    """How many that were compared."""
    behind: bool = False
    """Whether the lift has fallen behind, and not caught up since."""

    def after(self, lifted: Array, affine: Array, scale: Array) -> Rivals:
        """With one more innovation (p,) of each; entries that one of them lacks say nothing."""
        known = np.isfinite(lifted) & np.isfinite(affine)
        if not known.any():
            return self
        samples = self.samples + 1
        rate = max(RIVAL_RATE, 1 / samples)
        squares = [float(np.mean((v[known] / scale[known]) ** 2)) for v in (lifted, affine)]
        mine = self.lifted + rate * (squares[0] - self.lifted)
        other = self.affine + rate * (squares[1] - self.affine)
        least = 1.0 if self.behind else BEHIND
        behind = samples >= RIVAL_LEAST and mine > least * other
        return Rivals(mine, other, samples, behind)
