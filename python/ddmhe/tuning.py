"""Settings from the recording alone: `tune` tries many where the answer is known and picks one.

*Held-out quarters.* Each quarter of the recording is held out once; the estimator learns from the
rest (as two recordings, no window across the seam; the part before the quarter last, so that it
starts with a full window) and estimates the quarter from its outputs, brought to the online noise.
The score is the mean over the quarters of log(root mean square over states of rms error / spread);
states of one unit share a spread. Horizons beyond a quarter score alike: the window hardly moves.

*Rehearsals.* Quarters lie inside of the recorded region, and the estimator is to leave it. So a
quadratic surrogate of the recorded motion (`surrogate`) and others that fit as well are recorded
and run on for five times the recording, with its noise; the score is the mean log error over one,
two and five times T. They are used when the recording shows its whole state (small misfit of the
default rule) and the surrogate explains it.

*Beyond doubt or not at all.* What wins among a hundred settings looks better than it is. So the
parts that choose never judge: each quarter and each rehearsal is left out once, the best setting of
the others is picked (scores averaged over neighbouring regularisation weights: a minimum that its
neighbours do not share is luck), and its error on the part left out is compared with the default
rule's. The default rule is left only where these gains are there in every part, and their mean,
less one standard error, is more than MARGIN; quarters alone decide where there are no rehearsals,
else rehearsals decide and the quarters may not speak against it. A quarter taken out of the middle
costs more windows than its samples, long windows most. So what was picked is run once more on ends
of the recording, learnt from all before them, which took no part in the choice: they have to show
the same. Settings whose map from prior to estimate is unstable are refused. `make study-tuning`
compares the result with the best settings in hindsight.

*Promise.* The ends give the held-out error of each state; their scatter and the rehearsals give its
range."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.progress import Progress
from threadpoolctl import threadpool_limits

from ddmhe._core import (
    DdMhe,
    DdmheError,
    History,
    RankError,
    Ridge,
    ShapeError,
    Truncated,
    numbers,
    validate,
)
from ddmhe.checks import check_finite, check_flag, check_history, shown
from ddmhe.design.model import noise_levels
from ddmhe.recordings.units import shared
from ddmhe.surrogate import Surrogate

Array = NDArray[np.float64]

Fold = tuple[History, Array, Array, Array, list[int], Array]
"""Recording to learn from, prior, outputs to estimate from, true states, numbers of estimates per
error, spreads."""
_Score = tuple[list[float], float]
"""Mean squared relative errors of a fold's spans, spectral radius."""

__all__ = ["Tuning", "tune"]

QUARTERS = 4
ORIGINS = (0.6, 0.7, 0.8, 0.9)
"""Ends of the first parts of the recording that are learnt from, as shares of T, to judge what
follows them."""
RHO = 0.95
"""Discount of every candidate: anything from 0.9 to 0.97 does."""
HIDDEN = 1e-2
"""A default λ/μ above this (a third of the variance unexplained) means hidden states: other
settings are tried."""
HORIZONS = {False: (0.05, 0.1, 0.2), True: (0.13, 0.27, 0.4)}
"""Horizons to try as shares of T, without and with hidden states."""
LONGEST = 100
"""Longest horizon to try, as in the default rule: with RHO older samples weigh less than 0.6 %, and
the work grows with
the third power. The shares are of no longer a recording than the one that reaches it."""
MU = {False: (0.03, 0.3), True: (0.1, 1.0)}
"""μ to try, in units of the recording's spread."""
LAMBDA = tuple(10.0**k for k in range(-7, 0))
"""λ/μ to try."""
DRAWS = 8
"""Surrogates that are rehearsed: the best one and draws."""
TRIALS = 8
"""Attempts at a draw that stays in reach."""
SPANS = (1, 2, 5)
"""Spans of a rehearsal's error, in units of T."""
QUARTERS_WEIGHT = 0.3
"""Weight of the quarters' score beside the rehearsals'."""
EXPLAINED = 10.0
"""Largest mean squared residual, in units of the noise, of a surrogate that is rehearsed."""
GUARD = 1.005
"""Largest spectral radius of the map from prior to estimate."""
FEWEST = 10
"""Samples of a quarter below which it shows nothing beyond doubt."""
MARGIN = {"rehearsals": 0.3, "quarters": 0.5}
"""What the log error has to be smaller by than the default rule's, by what decides. On measured
pendulums
(T = 150) gains of a third that all four quarters shared were losses later."""

RANGE = {
    "lo": 0.7,
    "lo scatter": 0.5,
    "lo horizon": 2.0,
    "hi": 0.6,
    "hi scatter": 2.0,
    "hi horizon": 1.0,
    "rehearsed": 0.8,
}
"""Range of later errors in logs about the held-out one: constants, per standard deviation of the
held-out
ends about their trend, per horizon/T (long windows leave few of them when an end is left out: the
held-out error is too large, or too small where the long window fails later), and about the largest
error of the rehearsals but one. Chosen so that nine in ten errors of what they were shaped on lie
inside."""
CLEAN = 0.2
"""Smallest share of the held-out error that is left when the noise of the recorded states is taken
off: it is none of
the estimates'."""
ROUNDING = 1e-9
"""No score is smaller than this share of a state's spread, no range ends below this share of its
largest number."""


@dataclass(frozen=True, eq=False)
class Tuning:
    """The settings that were chosen and why; the estimator takes them as `DdMhe(h,
    **tuning.settings)`, and as
    `DdMhe(h, **tuning.settings, start=tuning.start)` for a run that goes on where the recording
    ends."""

    settings: dict[str, Any]
    """Keywords of DdMhe that hold for every start: none where the default rule is kept, else
    horizon, rho,
    mu, weights and space; and equilibrium where it was chosen."""
    score: float
    """Mean over the quarters of log(rms error / spread of the states): 0 is no better than their
    mean."""
    table: pd.DataFrame
    """One row per candidate, the chosen one first, then best first: its settings, its score, what
    it was ranked by, the
    error in each quarter relative to the spread, and the spectral radius."""
    words: str
    """How far the choice can be trusted; where the default rule is kept, that the recording cannot
    tell."""
    start: Literal["recording", "state"]
    """For a run that goes on where the recording ends: filled from there, which holds what the last
    recorded
    state holds and more."""
    candidates: list[dict[str, Any]]
    """Keywords of DdMhe of each row of the table."""
    warnings: list[str]
    """What an estimator with these settings says of them and of the recording."""
    promise: Array
    """Error of each state (n,), root mean square, in its unit: with `settings` and `start`, on ends
    of the
    recording that were not learnt from. NaN for a recording too short to hold ends out."""
    range: tuple[Array, Array]
    """(lo, hi), each (n,): where the rms error of each state is expected to stay in nine of ten
    runs as long
    as the recording; hi is infinite where nothing tells."""
    ratio: Array
    """`promise` over that of the default rule (n,); NaN where the recording cannot tell which is
    better for
    this state, 1 where the default rule was kept."""
    horizon: int
    """Horizon M in force, as `rho`, `mu` (in scaled units) and the trajectory space."""
    rho: float
    mu: float
    space: Any


@dataclass
class _Candidate:
    """One setting."""

    given: dict[str, Any]
    """Keywords of DdMhe; empty but for the options for the default rule."""
    horizon: int
    mu: float
    weight: float | None = None
    """λ/μ; None for a rank or the default rule."""
    radius: float = math.inf
    scores: Array | None = None
    """log(rms/spread) of each quarter."""
    rehearsals: Array | None = None
    """log(rms/spread) of each rehearsal, mean over its spans; None without."""
    rated: float = math.inf
    smoothed: Array | None = None
    """log(rms/spread) of each quarter and each rehearsal, mean over neighbouring weights; None for
    an unstable one."""

    @property
    def equilibrium(self) -> bool:
        """Whether the known rest is part of it."""
        return "equilibrium" in self.given

    @property
    def score(self) -> float:
        """Mean over the quarters."""
        return float(np.mean(self.scores)) if self.scores is not None else math.inf

    @property
    def rehearsed(self) -> float:
        """Mean over the rehearsals, NaN without."""
        return math.nan if self.rehearsals is None else float(np.mean(self.rehearsals))


def tune(
    history: History,
    *,
    output_noise: ArrayLike | None = None,
    equilibrium: tuple[ArrayLike, ArrayLike] | None = None,
    progress: bool | Callable[[int, int], object] | None = None,
) -> Tuning:
    """Settings from the recording alone: the default rule's, unless it shows others to be better
    beyond doubt.

    Parameters
    ----------
    history : History
        One recording of at least 20 samples, or several, of which the longest is used to validate.
    output_noise : float or array (p,)
        Standard deviation of the online outputs' noise, in their unit. Default: that of the
        recorded ones.
    equilibrium : (x_e, y_e)
        A known rest; whether it helps is part of the choice.
    progress : bool or function
        A progress bar on stderr (default: if that is a terminal), or what is called with (parts
        done, parts in all).

    Raises
    ------
    RankError
        Too short a recording.
    DdmheError, ShapeError
        Wrong arguments.
    KeyboardInterrupt
        Within a second of Ctrl-C. Its attribute `finished` is the Tuning by the horizons that were
        scored in full by then, None if there are none.
    """
    check_history(history)
    if progress is not None and not callable(progress):
        check_flag("progress", progress)
    extra = _extra_noise(history, output_noise)
    if equilibrium is not None:
        _check_rest(history, equilibrium)
    longest = int(np.argmax([len(y) for _, y in history.recordings]))
    T = len(history.recordings[longest][1])
    if T < 20:
        raise RankError(
            "history: expected a recording of at least 20 samples to hold parts of it out, found "
            f"{T}"
        )
    search = _Search(history, longest)
    try:
        # threads of BLAS would only wait for each other
        with threadpool_limits(1), _shown(progress) as report:
            return search.through(extra, output_noise, equilibrium, report)
    except KeyboardInterrupt as e:
        e.finished = search.so_far(getattr(e, "finished", []))  # type: ignore[attr-defined]
        raise


class _Search:
    """One choice, and what an interrupt leaves of it."""

    def __init__(self, history: History, longest: int) -> None:
        self.history, self.longest = history, longest
        self.spread = _spread(history, longest)
        self.ends: list[Fold] = []
        self.rehearsals: list[Fold] = []
        self.order: list[_Candidate] = []
        """The default rule first, then horizon by horizon: what an interrupt leaves can be
        compared."""
        self.results: Sequence[_Score | None] = []
        """Of each candidate's jobs, in order, once all are there."""

    def through(
        self,
        extra: Array,
        output_noise: ArrayLike | None,
        equilibrium: tuple[ArrayLike, ArrayLike] | None,
        report: Callable[[int, int], object],
    ) -> Tuning:
        """All of it."""
        history, longest = self.history, self.longest
        candidates, reference = _candidates(
            history, len(history.recordings[longest][1]), equilibrium
        )
        self.order = sorted(candidates, key=lambda c: (c is not candidates[0], c.horizon))
        spread = self.spread
        self.ends = _origins(history, longest, extra, spread)
        last, none = (
            history.recordings[-1][0][-1],
            (np.zeros((0, history.p)), np.zeros((0, history.n))),
        )
        folds: list[Fold] = [
            (history, last, *none, [], spread),
            *_quarters(history, longest, extra, spread),
        ]
        parts = 0 if reference > HIDDEN else DRAWS
        if parts:
            total = parts + len(candidates) * (len(folds) + DRAWS)
            self.rehearsals = _rehearsals(
                history, longest, output_noise, equilibrium, spread, lambda d: report(d, total)
            )
            folds += self.rehearsals
        # A start from the recording's end saves the short windows: for the spectral radius and
        # where a fold continues its own recording.
        starts = ["state" if fold == 1 else "recording" for fold in range(len(folds))]
        jobs = [
            (fold, c.given | {"start": start})
            for c in self.order
            for fold, start in enumerate(starts)
        ]
        total = parts + len(jobs)
        self.results = validate(folds, jobs, lambda done: report(parts + done, total))
        report(total, total)
        ranked = _ranked(self.order, self.results)
        if not ranked:
            raise RankError(
                "history: expected a recording of which three quarters suffice for some setting, "
                "found none"
            )
        return _tuning(self, ranked, self.order[0])

    def so_far(self, found: Sequence[_Score | None]) -> Tuning | None:
        """The choice among the horizons of which every setting was scored; None without the default
        rule's score.

        `found` are the results by now if they are not all there.
        """
        order, results = self.order, self.results or found
        each = len(results) // len(order) if order else 0
        whole = [
            each > 0 and None not in results[k * each : (k + 1) * each] for k in range(len(order))
        ]
        if not (whole and whole[0]):
            return None
        cut = {c.horizon for c, scored in zip(order[1:], whole[1:], strict=True) if not scored}
        kept = [k for k, c in enumerate(order) if k == 0 or c.horizon not in cut]
        scores = [score for k in kept for score in results[k * each : (k + 1) * each]]
        ranked = _ranked([order[k] for k in kept], scores)
        if not ranked:
            return None
        self.rehearsals = []  # an interrupt has no time for them
        chosen = _tuning(self, ranked, order[0])
        words = f"Stopped: {len(kept)} of {len(order)} settings were scored. {chosen.words}"
        return replace(chosen, words=words)


def _ranked(candidates: list[_Candidate], results: Sequence[_Score | None]) -> list[_Candidate]:
    """The candidates with their scores, best first; empty if none can be used."""
    each = len(results) // len(candidates)
    for k, c in enumerate(candidates):
        found = [score for score in results[k * each : (k + 1) * each] if score is not None]
        c.radius = found[0][1]
        errors = [_log(squares) for squares, _ in found[1:]]
        c.scores = np.array(errors[:QUARTERS])
        c.rehearsals = np.array(errors[QUARTERS:]) if errors[QUARTERS:] else None
    _rate(candidates)
    ranked = sorted(candidates, key=lambda c: c.rated)
    return ranked if math.isfinite(ranked[0].rated) else []


def _log(squares: list[float]) -> float:
    """Mean over spans of log(rms/spread); differences below ROUNDING are none."""
    return float(np.mean([0.5 * math.log(max(s, ROUNDING**2)) for s in squares]))


def _spread(history: History, longest: int) -> Array:
    """What errors of the states (n,) are relative to."""
    return _spreads(history.recordings[longest][0], history.x_units)


def _spreads(values: Array, units: list[str]) -> Array:
    """Standard deviation of each column, those of one unit pooled; 1 for one that never moved."""
    spread = np.sqrt(shared(np.var(values, axis=0), units))
    return np.where(spread > 0, spread, 1.0)


def _candidates(
    history: History, T: int, equilibrium: tuple[ArrayLike, ArrayLike] | None
) -> tuple[list[_Candidate], float]:
    """The default rule and a grid, with and without the equilibrium if it can be used; and the
    default rule's λ/μ."""
    default = DdMhe(history, start="recording")
    reference = max(default.ridge / default.mu, LAMBDA[0])
    hidden = reference > HIDDEN
    reach = min(T, LONGEST / max(HORIZONS[hidden]))
    horizons = sorted({max(2, round(share * reach)) for share in HORIZONS[hidden]})
    options: list[dict[str, Any]] = [{}]
    if equilibrium is not None:
        rest: dict[str, Any] = {"equilibrium": equilibrium}
        if not any("equilibrium" in w for w in DdMhe(history, start="recording", **rest).warnings):
            options.append(rest)
    found = []
    for option in options:
        found.append(_Candidate(option, default.horizon, default.mu))
        for M, level in product(horizons, MU[hidden]):
            given = option | {"horizon": M, "rho": RHO, "mu": level, "weights": "scaled"}
            for weight in LAMBDA:
                space = Ridge(float(f"{weight * level:.6g}"), normalised=True)
                found.append(_Candidate(given | {"space": space}, M, level, weight))
            if not hidden:
                for rank in range(history.n, history.n + 3):
                    found.append(_Candidate(given | {"space": Truncated(rank)}, M, level))
    return found, reference


def _like(history: History, x: Array, y: Array) -> History:
    """Another recording of the same channels."""
    return History(x, y, history.dt, x_units=history.x_units, y_units=history.y_units)


def _check_rest(history: History, equilibrium: Any) -> None:
    if not isinstance(equilibrium, tuple | list) or len(equilibrium) != 2:
        raise ShapeError(f"equilibrium: expected a pair (x_e, y_e), found {shown(equilibrium)}")
    for value, width in zip(equilibrium, (history.n, history.p), strict=True):
        rest = np.atleast_1d(numbers("equilibrium", value))
        check_finite("equilibrium", rest)
        if rest.shape != (width,):
            raise ShapeError(f"equilibrium: expected {width} numbers, found shape {rest.shape}")


def _extra_noise(history: History, output_noise: ArrayLike | None) -> Array:
    """Standard deviation (p,) to add to recorded outputs so that they are as noisy as the online
    ones."""
    if output_noise is None:
        return np.zeros(history.p)
    stated = numbers("output_noise", output_noise)
    if stated.shape not in ((), (history.p,)):
        raise ShapeError(
            f"output_noise: expected a number or {history.p} numbers, found shape {stated.shape}"
        )
    if not (np.isfinite(stated).all() and (stated >= 0).all()):
        raise DdmheError(
            f"output_noise: expected finite numbers of at least 0, found {shown(output_noise)}"
        )
    recorded = noise_levels(history)[1]
    return np.asarray(np.sqrt(np.maximum(stated**2 - recorded**2, 0.0)))


def _quarters(history: History, longest: int, extra: Array, spread: Array) -> list[Fold]:
    """Each quarter of the longest recording held out once; what was recorded right before it comes
    last."""
    recordings = history.recordings
    x, y = recordings[longest]
    others = [_like(history, a, b) for i, (a, b) in enumerate(recordings) if i != longest]
    noisy = y + extra * np.random.default_rng(0).standard_normal(y.shape)
    T = len(y)
    folds = []
    for q in range(QUARTERS):
        a, z = q * T // QUARTERS, (q + 1) * T // QUARTERS
        rest = [_like(history, x[i : j + 1], y[i:j]) for i, j in ((z, T), (0, a)) if j - i >= 2]
        folds.append(
            (History.concat(others + rest), x[a], noisy[a:z], x[a + 1 : z + 1], [z - a], spread)
        )
    return folds


def _rehearsals(
    history: History,
    longest: int,
    output_noise: ArrayLike | None,
    rest: tuple[ArrayLike, ArrayLike] | None,
    spread: Array,
    report: Callable[[int], object],
) -> list[Fold]:
    """Recordings of surrogates and what follows them, with the recording's noise; none if no
    surrogate explains it."""
    x, y = history.recordings[longest]
    T, n = len(y), history.n
    # in units of the spreads, so that no channel's unit weighs
    scale = _spreads(y, history.y_units)
    known = None
    if rest is not None:
        known = (
            np.asarray(rest[0], dtype=np.float64).ravel() / spread,
            np.asarray(rest[1], dtype=np.float64).ravel() / scale,
        )
    surrogate = Surrogate(x / spread, y / scale, known)
    if not surrogate.misfit < EXPLAINED:
        return []
    noise_x, noise_y = _least_noise(surrogate, x / spread, y / scale)
    online = (
        noise_y
        if output_noise is None
        else float(np.sqrt(np.mean(np.square(np.asarray(output_noise) / scale))))
    )
    folds: list[Fold] = []
    for d in range(DRAWS):
        report(d)
        rng = np.random.default_rng(d)
        steps = (1 + max(SPANS)) * T
        motion, outputs = (
            _drawn_motion(surrogate, rng, steps) if d else surrogate.motion(surrogate.best, steps)
        )
        if len(outputs) < T + T // 4:
            continue
        recorded = motion[: T + 1] + noise_x * rng.standard_normal((T + 1, n))
        level = np.where(np.arange(len(outputs)) < T, noise_y, max(online, noise_y))
        noisy = scale * (outputs + level[:, None] * rng.standard_normal(outputs.shape))
        motion, recorded = spread * motion, spread * recorded
        spans = [min(span * T, len(outputs) - T) for span in SPANS]
        rehearsed = _like(history, recorded, noisy[:T])
        folds.append((rehearsed, recorded[T], noisy[T:], motion[T + 1 :], spans, spread))
    return folds


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


@contextmanager
def _shown(
    progress: bool | Callable[[int, int], object] | None,
) -> Iterator[Callable[[int, int], object]]:
    """What is told (parts done, parts in all): the caller's function, or a bar."""
    if callable(progress):
        yield progress
        return
    shown = sys.stderr.isatty() if progress is None else progress
    with Progress(console=Console(stderr=True), disable=not shown, transient=True) as bar:
        task = bar.add_task("tuning")
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _rate(candidates: list[_Candidate]) -> None:
    """Smoothed errors, and what candidates are ranked by; inf for unstable ones."""
    by_key = {
        (c.horizon, c.mu, c.weight, c.equilibrium): c for c in candidates if c.weight is not None
    }
    stable = [c for c in candidates if c.radius <= GUARD] or [
        c for c in candidates if math.isfinite(c.radius)
    ]
    for c in stable:
        near = [c]
        if c.weight is not None:
            k = LAMBDA.index(c.weight)
            near = [
                by_key[c.horizon, c.mu, w, c.equilibrium] for w in LAMBDA[max(k - 1, 0) : k + 2]
            ]
        near = [other for other in near if math.isfinite(other.score)] or [c]
        c.smoothed = np.mean([_errors(other) for other in near], axis=0)
        c.rated = _rating(c.smoothed)


def _errors(c: _Candidate) -> Array:
    """log(rms/spread) of the quarters and the rehearsals."""
    return np.concatenate([part for part in (c.scores, c.rehearsals) if part is not None])


def _rating(errors: Array, without: int = -1) -> float:
    """What is small for a good setting: the mean over the rehearsals, and with less weight over the
    quarters."""
    kept = np.arange(len(errors)) != without
    quarters, rehearsals = kept[:QUARTERS], kept[QUARTERS:]
    rated = float(np.mean(errors[:QUARTERS][quarters]))
    return (
        QUARTERS_WEIGHT * rated + float(np.mean(errors[QUARTERS:][rehearsals]))
        if rehearsals.any()
        else rated
    )


@dataclass(frozen=True)
class _Verdict:
    """What is chosen, and the evidence for leaving the default rule."""

    chosen: _Candidate
    quarters: Array
    """log(rms/default's rms) of each quarter of the setting that is best on the other parts; NaN if
    nothing
    compares."""
    rehearsals: Array | None
    """The same of each rehearsal."""
    refused: bool = False
    """Whether the ends of the recording did not show what the other parts did."""


def _verdict(ranked: list[_Candidate], default: _Candidate) -> _Verdict:
    """The best setting if it is better than the default rule beyond doubt, else the default
    rule."""
    usable = [c for c in ranked if math.isfinite(c.rated)]
    if (
        default not in usable or default.smoothed is None
    ):  # too short a recording for it to be held out
        return _Verdict(default, np.full(QUARTERS, math.nan), None)
    gains = np.array([c.smoothed for c in usable]) - default.smoothed
    best = int(np.argmin([_rating(g) for g in gains]))
    # the part that judges takes no part in the choice
    nested = np.array(
        [
            gains[np.argmin([_rating(g, part) for g in gains]), part]
            for part in range(gains.shape[1])
        ]
    )
    quarters, rehearsals = nested[:QUARTERS], nested[QUARTERS:]
    own_quarters, own_rehearsals = gains[best, :QUARTERS], gains[best, QUARTERS:]
    if len(rehearsals) == 0:
        sure = all(_clear(g, MARGIN["quarters"]) for g in (quarters, own_quarters))
    else:
        lost = any(_mean_less_error(g) > 0 for g in (quarters, own_quarters))
        sure = (
            all(_clear(g, MARGIN["rehearsals"]) for g in (rehearsals, own_rehearsals)) and not lost
        )
    return _Verdict(
        usable[best] if sure else default, quarters, rehearsals if len(rehearsals) else None
    )


def _mean_less_error(values: Array) -> float:
    """Mean less one standard error."""
    return float(np.mean(values) - np.std(values, ddof=1) / math.sqrt(len(values)))


def _clear(gains: Array, margin: float) -> bool:
    """Whether the error is smaller in every part, and by `margin` in the mean within one standard
    error."""
    return bool((gains < 0).all()) and _mean_less_error(-gains) > margin


def _origins(history: History, longest: int, extra: Array, spread: Array) -> list[Fold]:
    """What follows first parts of the longest recording, learnt from them and from the other
    recordings."""
    recordings = history.recordings
    x, y = recordings[longest]
    others = [_like(history, a, b) for i, (a, b) in enumerate(recordings) if i != longest]
    noisy = y + extra * np.random.default_rng(1).standard_normal(y.shape)
    folds = []
    for share in ORIGINS:
        k = int(share * len(y))
        learnt = History.concat([*others, _like(history, x[: k + 1], y[:k])])
        folds.append((learnt, x[k], noisy[k:], x[k + 1 :], [len(y) - k], spread))
    return folds


def _ends_agree(
    ends: list[Fold], given: dict[str, Any], default: dict[str, Any], alone: bool
) -> bool:
    """Whether settings are better on the ends, too: clearly if quarters `alone` decide, else no
    worse."""
    jobs = [
        (i, each | {"start": "recording"}) for each in (given, default) for i in range(len(ends))
    ]
    found = np.array(
        [_log(squares) for squares, _ in (score for score in validate(ends, jobs) if score)]
    )
    ours, theirs = found.reshape(2, len(ends))
    if not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        return False
    return (
        _clear(ours - theirs, MARGIN["quarters"]) if alone else _mean_less_error(ours - theirs) <= 0
    )


def _rms(fold: Fold, given: dict[str, Any]) -> Array:
    """Error of each state over each span of a fold (spans, n), in its unit; NaN where the fold is
    too short."""
    history, _, outputs, truth, spans, _ = fold
    try:
        estimates = DdMhe(history, **given, start="recording").run(outputs).x
    except DdmheError:
        return np.full((len(spans), history.n), math.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (estimates - truth) ** 2
        found = np.sqrt([squares[:span].mean(axis=0) for span in spans])
    return np.where(np.isfinite(found), found, math.inf)


@dataclass(frozen=True)
class _Promise:
    """What settings do on the ends of the recording that they have not seen, and where later errors
    are expected."""

    parts: Array
    """Error of each end and state (K, n)."""
    held_out: Array
    """Root mean square over the ends (n,)."""
    lo: Array
    hi: Array


def _scatter(logs: Array) -> Array:
    """Standard deviation of each column (K, n) about its line: longer recordings are expected to do
    better."""
    K = len(logs)
    trend = np.vander(np.arange(K), 2 if K > 2 else 1)
    residuals = logs - trend @ (np.linalg.pinv(trend) @ logs)
    found = np.sqrt(np.sum(residuals**2, axis=0) / (K - trend.shape[1]))
    return np.where(np.isfinite(found), found, 0.0)


def _promise(
    history: History, ends: list[Fold], rehearsals: list[Fold], given: dict[str, Any], horizon: int
) -> _Promise:
    """Held-out errors with their range (see RANGE); NaN, 0 and infinity where no end can be held
    out."""
    n = history.n
    parts = np.array([_rms(fold, given)[0] for fold in ends])
    parts = parts[~np.isnan(parts).any(axis=1)]
    if len(parts) < 2:
        return _Promise(parts, np.full(n, math.nan), np.zeros(n), np.full(n, math.inf))
    T = max(len(y) for _, y in history.recordings)
    size = np.max([np.abs(x).max(axis=0) for x, _ in history.recordings], axis=0)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        held_out = np.sqrt(np.mean(parts**2, axis=0))
        scatter = _scatter(np.log(np.maximum(parts, ROUNDING * size + 1e-300)))
        noise, typical = noise_levels(history)[0], np.exp(np.mean(np.log(parts), axis=0))
        clean = np.sqrt(np.maximum(typical**2 - noise**2, (CLEAN * typical) ** 2))
        share = min(horizon / T, 1.0)
        lo = clean * np.exp(
            -RANGE["lo"] - RANGE["lo scatter"] * scatter - RANGE["lo horizon"] * share
        )
        hi = held_out * np.exp(
            RANGE["hi"] + RANGE["hi scatter"] * scatter + RANGE["hi horizon"] * share
        )
        if rehearsals:
            worst = np.nan_to_num(
                [_rms(fold, given).max(axis=0) for fold in rehearsals], posinf=math.inf
            )
            hi = np.maximum(hi, math.exp(RANGE["rehearsed"]) * np.sort(worst, axis=0)[-2:][0])
    lo = np.where(np.isfinite(held_out), lo, 0.0)
    return _Promise(parts, held_out, lo, np.maximum(hi, ROUNDING * size))


def _tuning(search: _Search, ranked: list[_Candidate], default: _Candidate) -> Tuning:
    """The result for what was scored."""
    history = search.history
    T = len(history.recordings[search.longest][1])
    # without a quarter there are next to no windows longer than half: what was held out is another
    # rule
    short = T < QUARTERS * FEWEST or (default.rehearsals is None and 2 * default.horizon > T)
    verdict = (
        _Verdict(default, np.full(QUARTERS, math.nan), None) if short else _verdict(ranked, default)
    )
    alone = verdict.rehearsals is None
    if verdict.chosen is not default and not _ends_agree(
        search.ends, verdict.chosen.given, default.given, alone
    ):
        verdict = replace(verdict, chosen=default, refused=True)
    best = verdict.chosen
    est = DdMhe(history, start="recording", **best.given)  # without the short windows: sooner there
    settings = dict(best.given)
    if "horizon" in settings:
        settings |= {
            "horizon": est.horizon,
            "rho": est.rho,
            "mu": est.mu,
            "weights": "scaled",
            "space": est.space,
        }
    promise = _promise(history, search.ends, search.rehearsals, settings, est.horizon)
    ratio = np.ones(history.n)
    if best is not default:
        ratio = _ratio(promise, _promise(history, search.ends, [], default.given, default.horizon))
    rows = [best, *(c for c in ranked if c is not best)]
    words = _words(rows, default, verdict, promise, search.spread)
    return Tuning(
        settings=settings,
        score=best.score,
        table=_table(rows),
        words=words,
        start="recording",
        candidates=[c.given for c in rows],
        warnings=est.warnings,
        promise=promise.held_out,
        range=(promise.lo, promise.hi),
        ratio=ratio,
        horizon=est.horizon,
        rho=est.rho,
        mu=est.mu,
        space=est.space,
    )


def _ratio(chosen: _Promise, default: _Promise) -> Array:
    """Error over the default rule's, state by state; NaN where the ends disagree on which is
    better."""
    if chosen.parts.shape != default.parts.shape or len(chosen.parts) < 2:
        return np.full(len(chosen.held_out), math.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        better = (chosen.parts < default.parts).all(axis=0) | (chosen.parts > default.parts).all(
            axis=0
        )
        return np.where(better, chosen.held_out / default.held_out, math.nan)


def _table(ranked: list[_Candidate]) -> pd.DataFrame:
    rows = []
    for c in ranked:
        quarters = {
            f"quarter {q + 1}": math.exp(v)
            for q, v in enumerate(c.scores if c.scores is not None else [])
        }
        rows.append(
            {
                "horizon": c.horizon,
                "mu": c.mu,
                "space": str(c.given.get("space", "auto")),
                "lambda/mu": math.nan if c.weight is None else c.weight,
                "equilibrium": c.equilibrium,
                "score": c.score,
                "rehearsed": c.rehearsed,
                "rated": c.rated,
                **quarters,
                "spectral radius": c.radius,
            }
        )
    return pd.DataFrame(rows)


def _words(
    rows: list[_Candidate], default: _Candidate, verdict: _Verdict, promise: _Promise, spread: Array
) -> str:
    """How far the choice can be trusted; `rows` begin with the chosen one."""
    best = verdict.chosen
    parts = [_decision(verdict, best is not default, len(rows) - 1)]
    scores = best.scores if best.scores is not None else np.full(1, math.inf)
    if np.isfinite(scores).all():
        parts.append(
            f"On held-out quarters of the recording the error is {math.exp(best.score):.3g} of the "
            f"states' spread, from {math.exp(scores.min()):.3g} to {math.exp(scores.max()):.3g}."
        )
        if best.score > -0.3:
            parts.append(
                "That is little better than the mean of the states: the quarters hardly tell the "
                "states apart."
            )
    else:
        parts.append("The recording is too short for held-out quarters.")
    if math.isfinite(best.rehearsed):
        parts.append(
            f"On {DRAWS} rehearsals of a quadratic surrogate, up to {max(SPANS)} times as long as "
            f"the recording, the error is {math.exp(best.rehearsed):.3g} of the spread: trust it "
            "as far as the motion stays smooth and second-order."
        )
    else:
        parts.append("Nothing here tests motion outside of the recorded region.")
    if best.equilibrium:
        parts.append("The known rest was chosen.")
    return " ".join([*parts, _expected(promise, spread)])


def _decision(verdict: _Verdict, moved: bool, others: int) -> str:
    """Whether the default rule was left, and what for."""
    judges = verdict.quarters if verdict.rehearsals is None else verdict.rehearsals
    name = "quarters" if verdict.rehearsals is None else "rehearsals"
    if not np.isfinite(judges).all():
        return (
            "The default rule is kept, the recording cannot tell that another setting is better: "
            "it is too short, or the default's windows are too long, for parts to be held out."
        )
    mean, low, high = (math.exp(min(v, 40.0)) for v in (judges.mean(), judges.min(), judges.max()))
    seen = (
        f"of {others} other settings the best by all other parts has {mean:.2g} times the default "
        f"rule's error in the {name} left out, from {low:.2g} to {high:.2g}"
    )
    if moved:
        return f"The default rule was left: {seen}; the ends of the recording show the same."
    kept = "The default rule is kept, the recording cannot tell that another setting is better"
    if verdict.refused:
        return f"{kept}: {seen}, but the ends of the recording do not show the same."
    asked = (
        f"below {math.exp(-MARGIN[name]):.2g} within a standard error, and below 1 in every part"
    )
    if verdict.rehearsals is not None:
        asked += ", without a loss in the quarters"
    return f"{kept}: {seen}; asked is {asked}."


def _expected(promise: _Promise, spread: Array) -> str:
    """The promise in words, in units of the spread since states have theirs."""
    if np.isnan(promise.held_out).any():
        return "No promise: the recording is too short to hold out its end."
    lo, hi = (float(v) for v in (np.min(promise.lo / spread), np.max(promise.hi / spread)))
    held = float(np.sqrt(np.mean((promise.held_out / spread) ** 2)))
    words = (
        f"On ends of the recording that were not learnt from, the error is {held:.3g} of the "
        f"spread; in runs as long as the recording it is expected between {lo:.2g} and {hi:.2g} of "
        "it, state by state in nine of ten."
    )
    if hi > 1.0:
        words += " That range reaches beyond the spread of a state: of such a state the recording promises nothing."
    return words
