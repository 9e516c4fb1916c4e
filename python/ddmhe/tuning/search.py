"""The search: what is tried, scored and chosen, and what an interrupt leaves of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.progress import Progress
from threadpoolctl import threadpool_limits

from ddmhe._core import DdmheError, History, RankError, check_settings, validate
from ddmhe.checks import check_flag, check_history
from ddmhe.tuning.arguments import extra_noise
from ddmhe.tuning.candidates import Candidate, candidates_for
from ddmhe.tuning.folds import Fold, Recorded, ends_of, quarters, whole
from ddmhe.tuning.rehearsals import DRAWS, rehearsals_of
from ddmhe.tuning.result import Standing, Tuning, tuning_of
from ddmhe.tuning.score import Score, ranking

Array = NDArray[np.float64]

__all__ = ["tune"]

HURRY = 0.1
"""Seconds that estimators on ends of the recording may take if an interrupt is to wait for some."""
SHORTEST = 20
"""Fewest samples of a recording of which parts can be held out."""


def tune(
    history: History,
    *,
    output_noise: ArrayLike | None = None,
    equilibrium: tuple[ArrayLike, ...] | None = None,
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
    equilibrium : (x_e, y_e), or (x_e, y_e, u_e) with inputs
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

    Examples
    --------
    >>> import ddmhe
    >>> history = ddmhe.models.spin_down().simulate(1.0, 0.02, noise=0.001).history(40)
    >>> tuning = ddmhe.tune(history)
    >>> tuning.promise.shape  # rms error to expect of each state
    (1,)
    >>> estimator = ddmhe.DdMhe(history, **tuning.settings, start=tuning.start)
    """
    check_history(history)
    if progress is not None and not callable(progress):
        check_flag("progress", progress)
    extra = extra_noise(history, output_noise)
    check_settings({"equilibrium": equilibrium}, history)
    longest = int(np.argmax([len(y) for _, y in history.recordings]))
    T = len(history.recordings[longest][1])
    if T < SHORTEST:
        raise RankError(
            f"history: expected a recording of at least {SHORTEST} samples to hold "
            f"parts of it out, found {T}"
        )
    search = Search(Recorded(history, longest, extra, output_noise, equilibrium))
    try:
        # threads of BLAS would only wait for each other
        with threadpool_limits(1), _shown(progress) as report:
            return search.through(report)
    except KeyboardInterrupt as e:
        e.finished = search.so_far(getattr(e, "finished", []))  # type: ignore[attr-defined]
        raise


class Search:
    """One choice, and what an interrupt leaves of it."""

    def __init__(self, recorded: Recorded) -> None:
        self.recorded = recorded
        self.ends: list[Fold] = []
        self.rehearsals: list[Fold] = []
        self.order: list[Candidate] = []
        """The default rule first, then horizon by horizon: what an interrupt leaves can be
        compared."""
        self.results: Sequence[Score | None] = []
        """Of each candidate's jobs, in order, once all are there."""
        self.standing: Standing | None = None
        """The default rule's, where that takes long."""

    def through(self, report: Callable[[int, int], object]) -> Tuning:
        """All of it; `report` is told (parts done, parts in all)."""
        candidates, rehearsed = candidates_for(self.recorded)
        self.order = sorted(candidates, key=lambda c: (c is not candidates[0], c.horizon))
        self.ends = ends_of(self.recorded)
        folds = [whole(self.recorded), *quarters(self.recorded)]
        parts = DRAWS if rehearsed else 0
        if parts:
            total = parts + len(candidates) * (len(folds) + DRAWS)
            self.rehearsals = rehearsals_of(self.recorded, lambda done: report(done, total))
            folds += self.rehearsals
        self._stand(candidates[0])
        jobs = self._jobs(len(folds))
        total = parts + len(jobs)
        self.results = validate(folds, jobs, lambda done: report(parts + done, total))
        report(total, total)
        ranked = ranking(self.order, self.results)
        if not ranked:
            raise RankError(
                "history: expected a recording of which three quarters suffice for some setting, "
                "found none"
            )
        return tuning_of(self.recorded, self.ends, self.rehearsals, ranked, self.order[0])

    def _stand(self, default: Candidate) -> None:
        """Keeps the default rule's standing for an interrupt that has no time for others."""
        begin = time.perf_counter()
        with suppress(DdmheError):  # one too short a recording is told of by its scores
            standing = Standing.of(self.recorded.history, self.ends, [], default.given)
            if time.perf_counter() - begin > HURRY:
                self.standing = standing

    def _jobs(self, folds: int) -> list[tuple[int, dict[str, Any]]]:
        """(fold, keywords of DdMhe), fold by fold for each candidate.

        A start from the recording's end saves the short windows: for the spectral radius and where
        a fold continues its own recording. The first quarter has nothing before it."""
        starts = ["state" if fold == 1 else "recording" for fold in range(folds)]
        return [
            (fold, c.given | {"start": start})
            for c in self.order
            for fold, start in enumerate(starts)
        ]

    def so_far(self, found: Sequence[Score | None]) -> Tuning | None:
        """The choice among the horizons of which every setting was scored; None without the default
        rule's score.

        `found` are the results by now if they are not all there.
        """
        order, results = self.order, self.results or found
        each = len(results) // len(order) if order else 0
        scored = [
            each > 0 and None not in results[k * each : (k + 1) * each] for k in range(len(order))
        ]
        if not (scored and scored[0]):
            return None
        cut = {c.horizon for c, there in zip(order[1:], scored[1:], strict=True) if not there}
        kept = [k for k, c in enumerate(order) if k == 0 or c.horizon not in cut]
        scores = [score for k in kept for score in results[k * each : (k + 1) * each]]
        ranked = ranking([order[k] for k in kept], scores)
        if not ranked:
            return None
        # an interrupt has no time for rehearsals
        chosen = tuning_of(self.recorded, self.ends, [], ranked, order[0], self.standing)
        words = f"Stopped: {len(kept)} of {len(order)} settings were scored. {chosen.words}"
        return replace(chosen, words=words)


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
