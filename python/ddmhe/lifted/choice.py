"""Whether a lift is better than the affine estimator, and which: ends of the recording that are
held out decide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History, noise_levels
from ddmhe.lifted.filter import LiftedFilter
from ddmhe.lifted.model import Part, fit
from ddmhe.lifted.monomials import count
from ddmhe.lifted.tol import (
    CLOSE_TO_FLAT,
    DEGREES,
    FOLDS,
    GAIN_LEAST,
    HELD,
    MOST_FOLDS,
    MOST_MONOMIALS,
    RIDGES,
    UNCERTAIN,
    WINDOWS_EACH,
)

Array = NDArray[np.float64]

__all__ = ["Choice", "Fold", "Lift", "choose", "folds_of", "parts_of"]

WORST = 1e3
"""Error, in recorded spreads, of what cannot be computed."""


class Lift(NamedTuple):
    """Settings of a lift."""

    degree: int
    ridge: float


class Fold(NamedTuple):
    """What is learnt from, and a part of the recording that is held out."""

    history: History
    y: Array
    """Outputs (N, p) with as much noise as online ones."""
    u: Array
    x: Array
    """States (N, n) that are to be found."""
    x_start: Array | None
    """Where it begins (n,); None where it goes on from what is learnt."""


@dataclass(frozen=True, eq=False)
class Choice:
    """What held-out ends say."""

    best: Lift | None
    """The best lift; None where the recording is too short for any."""
    chosen: bool
    """Whether it is to be used."""
    gain: float
    """Mean logarithm of the affine estimator's error over its own."""
    promise: Array
    """Its rms errors (n,) in what was held out; NaN without a lift."""
    widening: Array
    """By how much (n,) its stated deviations are too small there: three of them, so widened, hold
    HELD of the errors."""


def parts_of(history: History) -> list[Part]:
    """The recordings with their inputs."""
    pairs = zip(history.recordings, history.inputs, strict=True)
    return [Part(x, y, u) for (x, y), u in pairs]


def folds_of(history: History, output_noise: Array | None) -> Iterator[Fold]:
    """The ends of one recording from FOLDS on; of several the longest in turn, each as a whole."""
    parts = parts_of(history)
    recorded = noise_levels(history)[1]
    extra = np.zeros(history.p)
    if output_noise is not None:
        extra = np.sqrt(np.maximum(output_noise**2 - recorded**2, 0.0))
    rng = np.random.default_rng(0)
    if len(parts) == 1:
        x, y, u = parts[0]
        noisy = y + extra * rng.standard_normal(y.shape)
        for a in (int(share * len(y)) for share in FOLDS):
            learnt = _history([Part(x[: a + 1], y[:a], u[:a])], history)
            yield Fold(learnt, noisy[a:], u[a:], x[a + 1 :], None)
        return
    longest = sorted(range(len(parts)), key=lambda k: -len(parts[k].y))
    for k in longest[:MOST_FOLDS]:
        x, y, u = parts[k]
        learnt = _history(parts[:k] + parts[k + 1 :], history)
        yield Fold(learnt, y + extra * rng.standard_normal(y.shape), u, x[1:], x[0])


def _history(parts: list[Part], like: History) -> History:
    """Recordings with the units of another."""
    units = {"x_units": like.x_units, "y_units": like.y_units}
    if like.m:
        units["u_units"] = like.u_units
    inputs = [part.u if like.m else None for part in parts]
    return History.concat(
        [
            History(part.x, part.y, like.dt, u, **units)
            for part, u in zip(parts, inputs, strict=True)
        ]
    )


def choose(history: History, output_noise: Array | None, affine: Callable[[Fold], Array]) -> Choice:
    """The lift whose mean logarithmic error over the held-out ends is least, taken where it is
    GAIN_LEAST below the affine estimator's, below it in each, and no more than half the spread.

    affine : estimates (N, n) that the affine estimator makes of a fold"""
    folds = list(folds_of(history, output_noise))
    spread = np.concatenate([x for x, _ in history.recordings]).std(axis=0) + CLOSE_TO_FLAT
    lifts = list(_worth_trying(history))
    if not lifts:
        return Choice(None, False, 0.0, np.full(history.n, np.nan), np.ones(history.n))

    def score(errors: list[Array]) -> Array:
        return np.array([_log_error(e / spread) for e in errors])

    held_out = {lift: [_errors(lift, fold, output_noise) for fold in folds] for lift in lifts}
    found = {lift: [errors for errors, _ in each] for lift, each in held_out.items()}
    best = min(lifts, key=lambda lift: float(score(found[lift]).mean()))
    plain = score([affine(fold) - fold.x for fold in folds])
    gain = plain - score(found[best])
    errors = np.exp(score(found[best]))
    chosen = bool(gain.mean() > GAIN_LEAST and gain.min() > 0 and errors.max() < UNCERTAIN)
    promise = np.sqrt(np.mean(np.concatenate(found[best]) ** 2, axis=0))
    deviations = np.concatenate([np.abs(errors) / std for errors, std in held_out[best]])
    widening = np.ones(history.n)
    if np.isfinite(deviations).all():
        widening = np.maximum(np.quantile(deviations, HELD, axis=0) / 3, 1.0)
    return Choice(best, chosen, float(gain.mean()), promise, widening)


def _worth_trying(history: History) -> Iterator[Lift]:
    """Lifts that the recording is long enough for, also without what is held out."""
    several = len(history.recordings) > 1
    longest = max(len(y) for _, y in history.recordings)
    samples = history.T - longest if several else FOLDS[0] * history.T
    for degree in DEGREES:
        K = count(history.n, degree) + history.m
        if K <= MOST_MONOMIALS and samples >= WINDOWS_EACH * K:
            yield from (Lift(degree, ridge) for ridge in RIDGES)


def _errors(lift: Lift, fold: Fold, output_noise: Array | None) -> tuple[Array, Array]:
    """Errors (N, n) of a lift over what was held out, and their stated deviations (N, n); NaN where
    they cannot be computed."""
    try:
        with np.errstate(all="ignore"):
            model = fit(parts_of(fold.history), noise_levels(fold.history), *lift, output_noise)
            filter = LiftedFilter(model, None)
            if fold.x_start is not None:
                filter.begin(fold.x_start, np.diag(model.x_noise**2))
            found, std = np.empty_like(fold.x), np.empty_like(fold.x)
            for k, (y, u) in enumerate(zip(fold.y, fold.u, strict=True)):
                filter.step(y, u)
                found[k], std[k] = filter.x, np.sqrt(np.diag(filter.P))
        return found - fold.x, std
    except np.linalg.LinAlgError:
        return np.full_like(fold.x, np.nan), np.full_like(fold.x, np.nan)


def _log_error(e: Array) -> float:
    """Logarithm of the rms of scaled errors."""
    rms = float(np.sqrt(np.mean(e**2)))
    return float(np.log(min(max(rms, 1e-6), WORST) if np.isfinite(rms) else WORST))
