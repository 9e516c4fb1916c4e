"""Rehearsals: recordings of surrogates and what follows them, beyond the recorded region."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddmhe.tuning.folds import Fold, Recorded, known, like, spreads
from ddmhe.tuning.surrogate import Surrogate, continued

Array = NDArray[np.float64]

__all__ = ["DRAWS", "SPANS", "rehearsals_of"]

DRAWS = 8
"""Surrogates that are rehearsed: the best one and draws."""
TRIALS = 8
"""Attempts at a draw that stays in reach."""
SPANS = (1, 2, 5)
"""Spans of a rehearsal's error, in units of T."""
EXPLAINED = 10.0
"""Largest mean squared residual, in units of the noise, of a surrogate that is rehearsed."""


def rehearsals_of(recorded: Recorded, report: Callable[[int], object]) -> list[Fold]:
    """Recordings of surrogates and what follows them, with the recording's noise; none if no
    surrogate explains it. `report` is told how many are done."""
    # in units of the spreads, so that no channel's unit weighs
    scale = spreads(recorded.y, recorded.history.y_units)
    x, y = recorded.x / recorded.spread, recorded.y / scale
    surrogate = Surrogate(x, y, _known_rest(recorded, scale), recorded.u)
    if not surrogate.misfit < EXPLAINED:
        return []
    noise = _least_noise(surrogate, x, y)
    stated = recorded.output_noise
    online = (
        noise[1]
        if stated is None
        else float(np.sqrt(np.mean(np.square(np.asarray(stated) / scale))))
    )
    steps = (1 + max(SPANS)) * len(y)
    folds: list[Fold] = []
    for d in range(DRAWS):
        report(d)
        rng = np.random.default_rng(d)
        drawn = (
            _drawn_motion(surrogate, rng, steps) if d else surrogate.motion(surrogate.best, steps)
        )
        if len(drawn[1]) >= len(y) + len(y) // 4:
            folds.append(_rehearsal(recorded, drawn, scale, (*noise, online), rng))
    return folds


def _known_rest(recorded: Recorded, scale: Array) -> tuple[Array, ...] | None:
    """The rest in units of the spreads, u_e in its own."""
    if recorded.equilibrium is None:
        return None
    x_e, y_e, *u_e = (np.asarray(value, dtype=np.float64).ravel() for value in recorded.equilibrium)
    return (x_e / recorded.spread, y_e / scale, *u_e)


def _rehearsal(
    recorded: Recorded,
    drawn: tuple[Array, Array],
    scale: Array,
    noise: tuple[float, float, float],
    rng: np.random.Generator,
) -> Fold:
    """A drawn motion with noise: of the recorded states, the recorded outputs, the online
    outputs."""
    motion, outputs = drawn
    T, spread = len(recorded.y), recorded.spread
    noise_x, noise_y, online = noise
    noisy_x = motion[: T + 1] + noise_x * rng.standard_normal((T + 1, motion.shape[1]))
    level = np.where(np.arange(len(outputs)) < T, noise_y, max(online, noise_y))
    noisy_y = scale * (outputs + level[:, None] * rng.standard_normal(outputs.shape))
    truth, x = spread * motion, spread * noisy_x
    spans = [min(span * T, len(outputs) - T) for span in SPANS]
    u = continued(recorded.u, len(outputs))
    learnt = like(recorded.history, x, noisy_y[:T], u[:T])
    return Fold(learnt, x[T], noisy_y[T:], known(u[T:]), truth[T + 1 :], spans, spread)


def _least_noise(surrogate: Surrogate, x: Array, y: Array) -> tuple[float, float]:
    """Noise of x and y: no more than the best motion leaves unexplained, for fast motions look like
    noise, too."""
    motion, outputs = surrogate.motion(surrogate.best, len(y))
    if len(outputs) < len(y):
        return surrogate.noise_x, surrogate.noise_y
    left = (float(np.sqrt(np.mean((a - b) ** 2))) for a, b in ((motion, x), (outputs, y)))
    return min(surrogate.noise_x, next(left)), min(surrogate.noise_y, next(left))


def _drawn_motion(
    surrogate: Surrogate, rng: np.random.Generator, steps: int
) -> tuple[Array, Array]:
    """Of the first of TRIALS draws whose motion stays in reach, or else of the one that does so
    longest."""
    longest = surrogate.motion(surrogate.draw(rng), steps)
    for _ in range(TRIALS - 1):
        if len(longest[1]) == steps:
            break
        longest = max(
            longest, surrogate.motion(surrogate.draw(rng), steps), key=lambda found: len(found[1])
        )
    return longest
