"""Settings from the recording alone: `tune` tries many where the answer is known and picks one.

*Held-out quarters.* Each quarter of the recording is held out once; the estimator learns from the rest (as two
recordings, no window across the seam; the part before the quarter last, so that it starts with a full window) and
estimates the quarter from its outputs, brought to the online noise. The score is the mean over the quarters of
log(root mean square over states of rms error / spread); states of one unit share a spread. Horizons beyond a quarter
score alike: the window hardly moves.

*Rehearsals.* Quarters lie inside of the recorded region, and the estimator is to leave it. So a quadratic surrogate
of the recorded motion (`surrogate`) and others that fit as well are recorded and run on for five times
the recording, with its noise; the score is the mean log error over one, two and five times T. They are used when the
recording shows its whole state (small misfit of the default rule) and the surrogate explains it.

*Selection.* Scores are averaged over neighbouring regularisation weights: a minimum that its neighbours do not share is
luck. Settings whose map from prior to estimate is unstable are refused. Without rehearsals the quarters alone decide,
pulled towards the default rule's weight and long horizons (BIAS). A start from the recording's end is judged
by rolling origins, where it can be used. `make study-tuning` compares the result with the best settings in hindsight.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.progress import Progress
from threadpoolctl import threadpool_limits

from ddmhe._core import DdMhe, DdmheError, History, RankError, Ridge, ShapeError, Truncated, numbers, validate
from ddmhe.arguments import check_finite, check_flag, check_history, shown
from ddmhe.design.model import noise_levels
from ddmhe.surrogate import Surrogate
from ddmhe.units import shared

Array = NDArray[np.float64]

Fold = tuple[History, Array, Array, Array, list[int], Array]
"""Recording to learn from, prior, outputs to estimate from, true states, numbers of estimates per error, spreads."""
_Score = tuple[list[float], float]
"""Mean squared relative errors of a fold's spans, spectral radius."""

__all__ = ["Tuning", "tune"]

QUARTERS = 4
ORIGINS = (0.4, 0.55, 0.7)
"""Ends of the first parts of the recording from which a start is judged, as shares of T."""
RHO = 0.95
"""Discount of every candidate: anything from 0.9 to 0.97 does."""
HIDDEN = 1e-2
"""A default λ/μ above this (a third of the variance unexplained) means hidden states: other settings are tried."""
HORIZONS = {False: (0.05, 0.1, 0.2), True: (0.13, 0.27, 0.4)}
"""Horizons to try as shares of T, without and with hidden states."""
LONGEST = 100
"""Longest horizon to try, as in the default rule: with RHO older samples weigh less than 0.6 %, and the work grows with
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
BIAS = {"horizon": 0.1, "lambda": 0.1, "rank": 0.1, "equilibrium": 0.1, "recording": 0.2}
"""In units of the score: per halving of the horizon, per decade between λ and the default rule's, for a cut at a
rank; in favour of the equilibrium and of a start from the recording's end."""


@dataclass(frozen=True, eq=False)
class Tuning:
    """The settings that were chosen and why; the estimator takes them as `DdMhe(h, **tuning.settings)`, and as
    `DdMhe(h, **tuning.settings, start=tuning.start)` for a run that goes on where the recording ends."""

    settings: dict[str, Any]
    """Keywords of DdMhe: horizon, rho, mu, weights, space, and equilibrium where it was chosen. They hold for every
    start."""
    score: float
    """Mean over the quarters of log(rms error / spread of the states): 0 is no better than their mean."""
    table: pd.DataFrame
    """One row per candidate, best first: its settings, its score, what it was ranked by, the error in each quarter
    relative to the spread, and the spectral radius."""
    words: str
    """How far the choice can be trusted."""
    start: Literal["recording", "state"]
    """For a run that goes on where the recording ends: whether it does better with its window filled from there or with
    one that grows from the last recorded state."""
    candidates: list[dict[str, Any]]
    """Keywords of DdMhe of each row of the table."""
    warnings: list[str] = field(default_factory=list)
    """What an estimator with these settings says of them and of the recording."""

    @property
    def horizon(self) -> int:
        """Horizon M."""
        return int(self.settings["horizon"])

    @property
    def rho(self) -> float:
        """Discount."""
        return float(self.settings["rho"])

    @property
    def mu(self) -> float:
        """Weight on the fitted noise, in scaled units."""
        return float(self.settings["mu"])

    @property
    def space(self) -> Any:
        """The trajectory space."""
        return self.settings["space"]


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
    rehearsed: float = math.nan
    """Mean log(rms/spread) over rehearsals and spans, NaN without."""
    rated: float = math.inf

    @property
    def equilibrium(self) -> bool:
        """Whether the known rest is part of it."""
        return "equilibrium" in self.given

    @property
    def score(self) -> float:
        """Mean over the quarters."""
        return float(np.mean(self.scores)) if self.scores is not None else math.inf


def tune(
    history: History,
    *,
    output_noise: ArrayLike | None = None,
    equilibrium: tuple[ArrayLike, ArrayLike] | None = None,
    progress: bool | Callable[[int, int], object] | None = None,
) -> Tuning:
    """Choose horizon, ρ, μ, trajectory space and options from the recording alone.

    Parameters
    ----------
    history : History
        One recording of at least 20 samples, or several, of which the longest is used to validate.
    output_noise : float or array (p,)
        Standard deviation of the online outputs' noise, in their unit. Default: that of the recorded ones.
    equilibrium : (x_e, y_e)
        A known rest; whether it helps is part of the choice.
    progress : bool or function
        A progress bar on stderr (default: if that is a terminal), or what is called with (parts done, parts in all).

    Raises
    ------
    RankError
        Too short a recording.
    DdmheError, ShapeError
        Wrong arguments.
    KeyboardInterrupt
        Within a second of Ctrl-C. Its attribute `finished` is the Tuning by the horizons that were scored in full by
        then, None if there are none.
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
        raise RankError(f"history: expected a recording of at least 20 samples to hold parts of it out, found {T}")
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
        self.order: list[_Candidate] = []
        """The default rule first, then horizon by horizon: what an interrupt leaves can be compared."""
        self.reference = math.nan
        """The default rule's λ/μ."""
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
        candidates, self.reference = _candidates(history, len(history.recordings[longest][1]), equilibrium)
        self.order = sorted(candidates, key=lambda c: (c is not candidates[0], c.horizon))
        spread = _spread(history, longest)
        last, none = history.recordings[-1][0][-1], (np.zeros((0, history.p)), np.zeros((0, history.n)))
        folds: list[Fold] = [(history, last, *none, [], spread), *_quarters(history, longest, extra, spread)]
        parts = 0 if self.reference > HIDDEN else DRAWS
        if parts:
            total = parts + len(candidates) * (len(folds) + DRAWS)
            folds += _rehearsals(history, longest, output_noise, equilibrium, spread, lambda d: report(d, total))
        # A start from the recording's end saves the short windows: for the spectral radius and where a fold
        # continues its own recording.
        starts = ["state" if fold == 1 else "recording" for fold in range(len(folds))]
        jobs = [(fold, c.given | {"start": start}) for c in self.order for fold, start in enumerate(starts)]
        total = parts + len(jobs)
        self.results = validate(folds, jobs, lambda done: report(parts + done, total))
        report(total, total)
        ranked = _ranked(self.order, self.results, self.reference)
        if not ranked:
            raise RankError(
                "history: expected a recording of which three quarters suffice for some setting, found none"
            )
        return _tuning(history, ranked, _start(history, longest, ranked[0], extra), self.order[0])

    def so_far(self, found: Sequence[_Score | None]) -> Tuning | None:
        """The choice among the horizons of which every setting was scored; None without the default rule's score.

        `found` are the results by now if they are not all there.
        """
        order, results = self.order, self.results or found
        each = len(results) // len(order) if order else 0
        whole = [each > 0 and None not in results[k * each : (k + 1) * each] for k in range(len(order))]
        if not (whole and whole[0]):
            return None
        cut = {c.horizon for c, scored in zip(order[1:], whole[1:], strict=True) if not scored}
        kept = [k for k, c in enumerate(order) if k == 0 or c.horizon not in cut]
        scores = [score for k in kept for score in results[k * each : (k + 1) * each]]
        ranked = _ranked([order[k] for k in kept], scores, self.reference)
        if not ranked:
            return None
        chosen = _tuning(self.history, ranked, "recording", order[0])
        words = f"Stopped: {len(kept)} of {len(order)} settings were scored. {chosen.words}"
        return replace(chosen, words=words)


def _ranked(candidates: list[_Candidate], results: Sequence[_Score | None], reference: float) -> list[_Candidate]:
    """The candidates with their scores, best first; empty if none can be used."""
    each = len(results) // len(candidates)
    for k, c in enumerate(candidates):
        found = [score for score in results[k * each : (k + 1) * each] if score is not None]
        c.radius = found[0][1]
        errors = [_log(squares) for squares, _ in found[1:]]
        c.scores = np.array(errors[:QUARTERS])
        c.rehearsed = float(np.mean(errors[QUARTERS:])) if errors[QUARTERS:] else math.nan
    _rate(candidates, reference)
    ranked = sorted(candidates, key=lambda c: c.rated)
    return ranked if math.isfinite(ranked[0].rated) else []


def _log(squares: list[float]) -> float:
    """Mean over spans of log(rms/spread), not below -40."""
    return float(np.mean([max(0.5 * math.log(s), -40.0) if s > 0 else -40.0 for s in squares]))


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
    """The default rule and a grid, with and without the equilibrium if it can be used; and the default rule's λ/μ."""
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
    """Standard deviation (p,) to add to recorded outputs so that they are as noisy as the online ones."""
    if output_noise is None:
        return np.zeros(history.p)
    stated = numbers("output_noise", output_noise)
    if stated.shape not in ((), (history.p,)):
        raise ShapeError(f"output_noise: expected a number or {history.p} numbers, found shape {stated.shape}")
    if not (np.isfinite(stated).all() and (stated >= 0).all()):
        raise DdmheError(f"output_noise: expected finite numbers of at least 0, found {shown(output_noise)}")
    recorded = noise_levels(history)[1]
    return np.asarray(np.sqrt(np.maximum(stated**2 - recorded**2, 0.0)))


def _quarters(history: History, longest: int, extra: Array, spread: Array) -> list[Fold]:
    """Each quarter of the longest recording held out once; what was recorded right before it comes last."""
    recordings = history.recordings
    x, y = recordings[longest]
    others = [_like(history, a, b) for i, (a, b) in enumerate(recordings) if i != longest]
    noisy = y + extra * np.random.default_rng(0).standard_normal(y.shape)
    T = len(y)
    folds = []
    for q in range(QUARTERS):
        a, z = q * T // QUARTERS, (q + 1) * T // QUARTERS
        rest = [_like(history, x[i : j + 1], y[i:j]) for i, j in ((z, T), (0, a)) if j - i >= 2]
        folds.append((History.concat(others + rest), x[a], noisy[a:z], x[a + 1 : z + 1], [z - a], spread))
    return folds


def _rehearsals(
    history: History,
    longest: int,
    output_noise: ArrayLike | None,
    rest: tuple[ArrayLike, ArrayLike] | None,
    spread: Array,
    report: Callable[[int], object],
) -> list[Fold]:
    """Recordings of surrogates and what follows them, with the recording's noise; none if no surrogate explains it."""
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
    online = (
        surrogate.noise_y
        if output_noise is None
        else float(np.sqrt(np.mean(np.square(np.asarray(output_noise) / scale))))
    )
    folds: list[Fold] = []
    for d in range(DRAWS):
        report(d)
        rng = np.random.default_rng(d)
        steps = (1 + max(SPANS)) * T
        motion, outputs = _drawn_motion(surrogate, rng, steps) if d else surrogate.motion(surrogate.best, steps)
        if len(outputs) < T + T // 4:
            continue
        recorded = motion[: T + 1] + surrogate.noise_x * rng.standard_normal((T + 1, n))
        level = np.where(np.arange(len(outputs)) < T, surrogate.noise_y, max(online, surrogate.noise_y))
        noisy = scale * (outputs + level[:, None] * rng.standard_normal(outputs.shape))
        motion, recorded = spread * motion, spread * recorded
        spans = [min(span * T, len(outputs) - T) for span in SPANS]
        rehearsed = _like(history, recorded, noisy[:T])
        folds.append((rehearsed, recorded[T], noisy[T:], motion[T + 1 :], spans, spread))
    return folds


def _drawn_motion(surrogate: Surrogate, rng: np.random.Generator, steps: int) -> tuple[Array, Array]:
    """Of the first of TRIALS draws whose motion stays in reach, or else of the one that does so longest."""
    longest = surrogate.motion(surrogate.draw(rng), steps)
    for _ in range(TRIALS - 1):
        if len(longest[1]) == steps:
            break
        longest = max(longest, surrogate.motion(surrogate.draw(rng), steps), key=lambda found: len(found[1]))
    return longest


@contextmanager
def _shown(progress: bool | Callable[[int, int], object] | None) -> Iterator[Callable[[int, int], object]]:
    """What is told (parts done, parts in all): the caller's function, or a bar."""
    if callable(progress):
        yield progress
        return
    shown = sys.stderr.isatty() if progress is None else progress
    with Progress(console=Console(stderr=True), disable=not shown, transient=True) as bar:
        task = bar.add_task("tuning")
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _rate(candidates: list[_Candidate], reference: float) -> None:
    """What candidates are ranked by: smoothed scores with the biases, inf for unstable ones."""
    longest = max(c.horizon for c in candidates)
    rehearsed = math.isfinite(candidates[0].rehearsed)
    by_key = {(c.horizon, c.mu, c.weight, c.equilibrium): c for c in candidates if c.weight is not None}
    stable = [c for c in candidates if c.radius <= GUARD] or [c for c in candidates if math.isfinite(c.radius)]
    for c in stable:
        near = [c]
        if c.weight is not None:
            k = LAMBDA.index(c.weight)
            near = [by_key[c.horizon, c.mu, w, c.equilibrium] for w in LAMBDA[max(k - 1, 0) : k + 2]]
        near = [other for other in near if math.isfinite(other.score)] or [c]
        c.rated = float(np.mean([other.score for other in near]))
        if rehearsed:
            c.rated = QUARTERS_WEIGHT * c.rated + float(np.mean([other.rehearsed for other in near]))
        else:
            c.rated += _bias(c, longest, reference)


def _bias(c: _Candidate, longest: int, reference: float) -> float:
    """What quarters alone do not tell: the pull towards long horizons and the default rule's weight."""
    bias = BIAS["horizon"] * math.log2(longest / c.horizon) - BIAS["equilibrium"] * c.equilibrium
    if c.weight is not None:
        return bias + BIAS["lambda"] * abs(math.log10(c.weight / reference))
    return bias + BIAS["rank"] * isinstance(c.given.get("space"), Truncated)


def _start(history: History, longest: int, best: _Candidate, extra: Array) -> Literal["recording", "state"]:
    """Which start does better where both can be used: right behind parts of the recording."""
    x, y = history.recordings[longest]
    noisy = y + extra * np.random.default_rng(1).standard_normal(y.shape)
    folds, spread = [], _spread(history, longest)
    for share in ORIGINS:
        k = int(share * len(y))
        folds.append((_like(history, x[: k + 1], y[:k]), x[k], noisy[k:], x[k + 1 :], [len(y) - k], spread))
    jobs = [(i, best.given | {"start": start}) for start in ("state", "recording") for i in range(len(folds))]
    found = [score for score in validate(folds, jobs) if score is not None]
    errors = np.array([squares[0] for squares, _ in found]).reshape(2, len(folds))
    usable = np.isfinite(errors).all(axis=0)
    if not usable.any():
        return "recording"
    grown, filled = 0.5 * np.log(np.maximum(errors[:, usable], 1e-300)).mean(axis=1)
    return "recording" if filled - BIAS["recording"] <= grown else "state"


def _tuning(
    history: History, ranked: list[_Candidate], start: Literal["recording", "state"], default: _Candidate
) -> Tuning:
    best = ranked[0]
    est = DdMhe(history, start="recording", **best.given)  # without the short windows: sooner there
    settings: dict[str, Any] = {"horizon": est.horizon, "rho": est.rho, "mu": est.mu, "weights": "scaled"}
    settings["space"] = est.space
    if best.equilibrium:
        settings["equilibrium"] = best.given["equilibrium"]
    candidates = [c.given for c in ranked]
    return Tuning(settings, best.score, _table(ranked), _words(ranked, default), start, candidates, est.warnings)


def _table(ranked: list[_Candidate]) -> pd.DataFrame:
    rows = []
    for c in ranked:
        quarters = {f"quarter {q + 1}": math.exp(v) for q, v in enumerate(c.scores if c.scores is not None else [])}
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


def _words(ranked: list[_Candidate], default: _Candidate) -> str:
    """How far the choice can be trusted."""
    best = ranked[0]
    scores = best.scores if best.scores is not None else np.zeros(1)
    error = float(scores.std(ddof=1)) / math.sqrt(len(scores))
    rivals = sum(c.score <= best.score + error for c in ranked)
    factor = math.exp(float(scores.max() - scores.min()))
    against = math.exp(best.score - default.score) if math.isfinite(default.score) else 0.0
    parts = [
        f"On held-out quarters of the recording the error is {math.exp(best.score):.3g} of the states' spread, "
        f"{against:.2g} times the default rule's. The quarters differ by a factor of {factor:.2g}, and {rivals} of "
        f"{len(ranked)} settings are within one standard error: the choice among them is not certain."
    ]
    if best.score > -0.3:
        parts.append("That is little better than the mean of the states: the outputs hardly tell the states apart.")
    if math.isfinite(best.rehearsed):
        parts.append(
            f"On {DRAWS} rehearsals of a quadratic surrogate, up to {max(SPANS)} times as long as the recording, the "
            f"error is {math.exp(best.rehearsed):.3g} of the spread "
            f"({math.exp(best.rehearsed - default.rehearsed):.2g} times the default rule's): trust it as far as the "
            "motion stays smooth and second-order."
        )
    else:
        parts.append("Nothing here tests motion outside of the recorded region.")
    if best.equilibrium:
        parts.append("The known rest was chosen.")
    return " ".join(parts)
