"""Whether recorded outputs lag the recorded states, and by how many samples.

y(k+d) is fitted from the states x(k) and inputs u(k) by least squares, for every d of a range and
on the same samples k, and judged on samples that were held out. Where a recorded state says what an
output is, least is left unexplained at the output's lag. Other things have a curve over d of their
own, and are told apart:

- a linear motion that nothing disturbs is read out as well at any d. The curve is flat, and a lag
  does no harm there: outputs of later windows lag as recorded ones do.
- an output of what was not recorded follows the recorded states by a phase, as an angle follows its
  rate by a quarter of the period. Then there is a second valley, on the other side of d = 0.
- a filter between states and output is no lag: states of several samples then say more."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.checks import check_history, check_whole
from ddmhe.design.tol import (
    BEYOND_ZERO,
    DELAY_GAIN,
    EQUAL,
    EXPLAINED,
    FILTERED,
    READ_OUT_ROUNDING,
    ROUNDED_RANK,
    SECOND_VALLEY,
    SHARP,
)

Array = NDArray[np.float64]

__all__ = ["OutputDelay", "output_delay"]

BLOCKS = 5
"""Parts of the recording, each held out in turn; a lag must be better in all of them."""
LEAST_SAMPLES = 40
"""Fewest samples of a recording that tell a lag."""
BESIDE = 2
"""So many samples beside the lag a read-out is clearly worse."""
AROUND = ((1, 2), (5, 10))
"""Samples before and after k whose states are tried, too: a filter of a few samples, and of some
ten."""
MOST_PAIRS = 3000
"""So many samples say enough; more cost memory, 2D+1 times the recording."""
SHARE, MOST = 5, 60
"""Lags up to one SHARE-th of the shortest recording are tried, and up to MOST samples: samples at
its ends have no partner."""


@dataclass(frozen=True, eq=False)
class OutputDelay:
    """What a recording says of the lag of its outputs."""

    lags: NDArray[np.int64]
    """Lags d that were tried (2D+1,), samples, from -D to D; none where the recording is short."""
    unexplained: Array
    """Share of each output's variance that x(k) and u(k) leave of y(k+d), held out (p, 2D+1)."""
    samples: tuple[int | None, ...]
    """Lag of each of the p outputs in samples, negative where the output comes before the states; 0
    where a lag of 0 is as sure; None where the recording does not tell."""
    dt: float
    """Sampling interval, s."""

    @property
    def seconds(self) -> tuple[float | None, ...]:
        """The same in seconds."""
        return tuple(None if d is None else d * self.dt for d in self.samples)

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each output that surely lags or leads, its channel counted from 0."""
        return tuple(
            f"output {j} (counted from 0) {'lags' if d > 0 else 'leads'} the recorded states by "
            f"about {abs(d) * self.dt:.4g} s ({abs(d)} sample{'s' if abs(d) > 1 else ''})"
            for j, d in enumerate(self.samples)
            if d
        )


def output_delay(history: History, most: int | None = None) -> OutputDelay:
    """The lag of each recorded output behind the recorded states, where the recording tells it.

    most : largest lag D to try, samples; default and limit a fifth of the shortest recording, at
        most 60

    A lag is told where the read-out at the lag leaves less than two thirds of what it leaves at 0,
    in each of five parts of the recording; where what is left is less than 60 % of the output's
    variance; and where nothing else explains it (see above). Raises DdmheError for a wrong
    argument.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = np.random.default_rng(0).standard_normal((402, 1)).cumsum(0) * 0.1
    >>> late = np.vstack([x[:3] * 0, x[:398]])  # y(k) = x(k - 3)
    >>> ddmhe.design.output_delay(ddmhe.History(x, late, 0.01)).samples
    (3,)
    """
    history = check_history(history)
    if most is not None:
        check_whole("most", most, 1, MOST)
    shortest = min(len(y) for _, y in history.recordings)
    D = min(shortest // SHARE, MOST if most is None else most, MOST)
    if shortest < LEAST_SAMPLES:
        none = (None,) * history.p
        return OutputDelay(np.empty(0, dtype=np.int64), np.empty((history.p, 0)), none, history.dt)
    lags = np.arange(-D, D + 1)
    x, y = _paired(history, lags)
    left = _held_out(x[:, D], y)
    total = ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    share = left.sum(axis=0) / np.maximum(total, np.finfo(np.float64).tiny)
    share = np.where(total > 0, np.maximum(share, READ_OUT_ROUNDING), 1.0)  # (2D+1, p)
    found = []
    for j in range(history.p):
        d = _lag(lags, share[:, j], left[:, :, j])
        if d and share[D + d, j] > READ_OUT_ROUNDING:
            d = None if _is_filtered(d, D, x, y[:, :, j], left[:, :, j]) else d
        found.append(d)
    return OutputDelay(lags, share.T, tuple(found), history.dt)


def _paired(history: History, lags: NDArray[np.int64]) -> tuple[Array, Array]:
    """States and inputs [x(k+d) u(k+d)] and outputs y(k+d) for all lags d, (K, 2D+1, n+m) and
    (K, 2D+1, p): samples k of all recordings that have a partner at each d, every one or, where
    they are more than MOST_PAIRS, evenly spaced ones."""
    D = int(lags[-1])
    every = -(-sum(len(y) for _, y in history.recordings) // MOST_PAIRS)
    states, outputs = [], []
    inputs = history.inputs or [np.empty((len(y), 0)) for _, y in history.recordings]
    for (x, y), u in zip(history.recordings, inputs, strict=True):
        rows = np.arange(D, len(y) - D, every)[:, None] + lags
        states.append(np.hstack([x[: len(y)], u])[rows])
        outputs.append(y[rows])
    return np.concatenate(states), np.concatenate(outputs)


def _held_out(z: Array, y: Array) -> Array:
    """Sums of squares that an affine read-out of z (K, q) leaves of y (K, …), block by block held
    out: (BLOCKS, …)."""
    spread = z.std(axis=0)
    regressors = (z - z.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    regressors = np.hstack([regressors, np.ones((len(z), 1))])
    targets = y.reshape(len(y), -1)
    edges = np.linspace(0, len(y), BLOCKS + 1).astype(int)
    left = []
    for first, last in pairwise(edges):
        rest = np.r_[0:first, last : len(y)]
        read = np.linalg.lstsq(regressors[rest], targets[rest], rcond=ROUNDED_RANK)[0]
        left.append(((targets[first:last] - regressors[first:last] @ read) ** 2).sum(axis=0))
    return np.array(left).reshape(BLOCKS, *y.shape[1:])


def _lag(lags: NDArray[np.int64], share: Array, left: Array) -> int | None:
    """The lag of one output from its curve `share` (2D+1,) and the parts `left` (BLOCKS, 2D+1) of
    it; None where the curve does not tell."""
    zero = len(lags) // 2
    as_good = np.flatnonzero(share <= EQUAL * share.min())
    best = int(as_good[np.argmin(np.abs(lags[as_good]))])
    d = int(lags[best])
    if share[best] > EXPLAINED or abs(d) > lags[-1] - BESIDE:
        return None
    valley = np.sqrt(share[best] * (share[zero] if d else share.max()))
    deep = np.flatnonzero(share < valley)
    one_valley = deep.size > 0 and deep[-1] - deep[0] + 1 == deep.size
    inside = one_valley and deep[0] > 0 and deep[-1] < len(lags) - 1
    beside = min(share[best - BESIDE], share[best + BESIDE])
    if not inside or beside < SHARP * share[best]:
        return None
    if d == 0:
        return 0
    better = (left[:, best] < left[:, zero]).all() and share[zero] > DELAY_GAIN * share[best]
    second = min(BEYOND_ZERO * share[zero], SECOND_VALLEY * share[best])
    return d if better and share[lags * d < 0].min() > second else None


def _is_filtered(d: int, D: int, x: Array, y: Array, left: Array) -> bool:
    """Whether states of samples before and after k say clearly more of y(k+d) than those of k."""
    least = FILTERED * left[:, D + d].sum()
    for taps in AROUND:
        beside = [sign * min(tap, D) for tap in taps for sign in (-1, 1)]
        around = np.hstack([x[:, D + lag] for lag in (0, *beside)])
        if _held_out(around, y[:, D + d]).sum() < least:
            return True
    return False
