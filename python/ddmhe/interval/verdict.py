"""What bounds say: their width against the range that the recording already covers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError
from ddmhe.interval.systems import matrix

Array = NDArray[np.float64]

__all__ = ["Verdict", "judge"]

WIDE = 0.5
"""Bounds whose median width is more than this share of the recorded range count as saying
nothing."""
GROWN = 1.5
"""A last width this many times the first counts as grown."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """Width of bounds against the recorded range, a state each.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> t, bound = np.arange(100.0), np.full((100, 1), 0.1)
    >>> verdict = ddmhe.interval.judge(-bound, bound, ([-1.0], [1.0]), t, ["speed"])
    >>> print(verdict.words)
    speed 0.1 of the recorded range
    """

    names: tuple[str, ...]
    """n names."""
    share: Array
    """Median full width over the recorded range (n,); infinite without a bound."""
    grows: Array
    """Time from which on a growing width stays above the recorded range, s (n,); NaN: there is
    none."""
    unbounded: Array
    """Time from which on there is no finite bound, s (n,); NaN: there is to the end."""

    @property
    def useful(self) -> bool:
        """Whether every state's median width is at most half of its recorded range."""
        return bool((self.share <= WIDE).all())

    @property
    def words(self) -> str:
        """One clause a state."""
        return "; ".join(self._clause(i) for i in range(len(self.names)))

    def _clause(self, i: int) -> str:
        share = self.share[i]
        if share >= 1:
            size = (
                f"median width {share:.3g} of it"
                if share < 1e3
                else "median width above 1000 of it"
            )
            text = f"{self.names[i]} says nothing beyond the recorded range ({size})"
        elif share > WIDE:
            text = f"{self.names[i]} says little: median width {share:.3g} of the recorded range"
        else:
            text = f"{self.names[i]} {share:.3g} of the recorded range"
        if np.isfinite(self.grows[i]):
            text += f", grows beyond it from {self.grows[i]:.4g} s on"
        if np.isfinite(self.unbounded[i]):
            text += f", no bound from {self.unbounded[i]:.4g} s on"
        return text


def judge(
    lower: ArrayLike,
    upper: ArrayLike,
    recorded: tuple[ArrayLike, ArrayLike],
    t: ArrayLike,
    names: Sequence[str],
) -> Verdict:
    """Compare bounds (N, n) at times t (N,), s, with the recorded range (least (n,), largest (n,)).

    Raises
    ------
    ShapeError, NotFiniteError, DdmheError
        Shapes that do not fit, no rows, a recorded range of width zero.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> t = np.arange(100.0)
    >>> verdict = ddmhe.interval.judge(
    ...     np.full((100, 1), -0.1), np.full((100, 1), 0.1), ([-1.0], [1.0]), t, ["speed"]
    ... )
    >>> verdict.share  # of the recorded range that the bounds are wide
    array([0.1])
    """
    t = matrix("t", t, (-1,))
    names = tuple(names)
    shape = len(t), len(names)
    if len(t) == 0:
        raise DdmheError("t: expected at least one sample, found none")
    lower, upper = (
        matrix("lower", lower, shape, finite=False),
        matrix("upper", upper, shape, finite=False),
    )
    low, high = (matrix("recorded", side, shape[1:]) for side in recorded)
    reach = high - low
    if not (reach > 0).all():
        raise DdmheError(f"recorded: expected states that moved, found a range of {reach.min():g}")
    with np.errstate(over="ignore"):
        width = upper - lower
    share = np.median(width, axis=0) / reach
    growing = ~(width[-1] < GROWN * width[0])
    grows = np.where(
        growing, [_for_good(t, width[:, i] > reach[i]) for i in range(shape[1])], np.nan
    )
    unbounded = np.array([_for_good(t, ~np.isfinite(width[:, i])) for i in range(shape[1])])
    return Verdict(names, share, grows, unbounded)


def _for_good(t: Array, holds: NDArray[np.bool_]) -> float:
    """When a statement begins to hold to the end; NaN if it does not at the end."""
    if not holds[-1]:
        return float("nan")
    return float(t[0 if holds.all() else np.flatnonzero(~holds)[-1] + 1])
