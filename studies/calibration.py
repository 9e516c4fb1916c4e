"""What one run said of itself beside what was so, and what many runs add up to."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

import ddmhe
from ddmhe import Reason
from noisy_systems import Log

DOUBTS = Reason.NOVEL | Reason.UNCERTAIN | Reason.STUCK
"""What takes trust away."""
WINDOW = 50
"""Samples over which an estimate is called good or bad."""
SPANS = ((0, 20), (20, 50), (50, 100), (100, 200), (200, 400), (400, 1000))
"""Samples after the recording, by which consistency is told."""
EDGES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, np.inf)
"""Bins of the stated deviation, in units of the recorded spread."""


@dataclass(frozen=True, eq=False)
class Run:
    """N estimates of n states whose truth is known."""

    error: np.ndarray
    """(N, n)"""
    std: np.ndarray
    """Stated (N, n)."""
    nees: np.ndarray
    """eᵀΣ⁻¹e / n (N,)."""
    nis: np.ndarray
    """Mean over the channels of the squared innovation over its stated variance (N,); NaN where no
    output came."""
    reasons: np.ndarray
    """(N,)"""
    spread: np.ndarray
    """Of the recorded states (n,)."""
    promise: np.ndarray
    """Promised rms (n,), NaN where nothing could be held out."""
    warned: tuple[str, ...]
    """What was said at construction."""
    truth: np.ndarray
    """(N, n)"""
    weights: str

    def share(self, reason: Reason) -> float:
        """Of the steps with one of the reasons."""
        return float(np.mean(self.reasons & reason != 0))

    def within(self, bars: float) -> float:
        """Share of the errors within so many stated deviations."""
        return float(np.mean(np.abs(self.error) <= bars * self.std))

    @cached_property
    def ratio(self) -> float:
        """Median over the states of the stated rms deviation over the rms error."""
        said, so = (np.sqrt(np.mean(v**2, axis=0)) for v in (self.std, self.error))
        return float(np.median(said / np.maximum(so, 1e-300)))

    @cached_property
    def nrmse(self) -> float:
        """Root mean square over the states of rms error over the spread of the truth."""
        relative = np.sqrt(np.mean(self.error**2, axis=0)) / self.truth.std(axis=0)
        return float(np.sqrt(np.mean(relative**2)))

    @cached_property
    def bad(self) -> np.ndarray:
        """Whether each whole window of WINDOW samples has a state off by more than half of its
        recorded spread and three times its promise."""
        limit = np.fmax(0.5 * self.spread, 3 * self.promise)
        return (np.sqrt((self._windows(self.error) ** 2).mean(axis=1)) > limit).any(axis=1)

    def told(self, reason: Reason) -> np.ndarray:
        """Whether half the steps of each whole window, or more, have one of the reasons."""
        return self._windows(self.reasons & reason != 0).mean(axis=1) >= 0.5

    def _windows(self, values: np.ndarray) -> np.ndarray:
        whole = len(values) // WINDOW * WINDOW
        return values[:whole].reshape(-1, WINDOW, *values.shape[1:])


def run_of(log: Log, U=None, x_start=None, **settings) -> Run:
    """One run, from the recording's end on or from a given state."""
    est = ddmhe.DdMhe(log.history, **settings)
    if x_start is not None:
        est.reset(x_start)
    warned = tuple(est.warnings)
    found = est.run(log.Y) if U is None else est.run(log.Y, U)
    return judged(est, found, log, warned)


def judged(est, found, log: Log, warned=()) -> Run:
    """A run against its truth; rows without truth are left out."""
    error = found.x - log.truth
    known = np.isfinite(error).all(axis=1)
    error, std, Sigma = error[known], found.std[known], found.covariance[known]
    size = np.maximum(std, 1e-300)
    correlation = Sigma / (size[:, :, None] * size[:, None, :])
    z = error / size
    nees = np.einsum("ti,tij,tj->t", z, np.linalg.pinv(correlation, hermitian=True), z)
    told = found.evidence
    with np.errstate(divide="ignore", invalid="ignore"):
        nis = np.mean((told.innovation / told.innovation_std)[known] ** 2, axis=1)
    recorded = np.vstack([x for x, _ in log.history.recordings])
    n = error.shape[1]
    promise = np.full(n, np.nan) if est.promise is None else np.asarray(est.promise)
    return Run(
        error,
        std,
        nees / n,
        np.where(np.isfinite(nis), nis, np.nan),
        found.reasons[known],
        recorded.std(axis=0),
        promise,
        warned,
        log.truth[known],
        est.weights,
    )


def cannot_promise(run: Run) -> bool:
    """Whether it was said at construction that a state cannot be promised."""
    return any("cannot promise" in sentence for sentence in run.warned)


COVERAGE = ("runs", "3 sd (worst)", "2 sd", "sd/rms", "NEES/n", "NIS/p", "novel", "uncertain")


def coverage(name: str, runs: Sequence[Run]) -> list[str]:
    """One line of a table of coverage: means over the runs, medians of the last-named ratios."""
    inside = np.array([run.within(3) for run in runs])
    nees = np.array([run.nees.mean() for run in runs])
    nis = np.array([np.nanmean(run.nis) for run in runs])
    return [
        name,
        str(len(runs)),
        f"{inside.mean():.4f} ({inside.min():.3f})",
        f"{np.mean([run.within(2) for run in runs]):.3f}",
        f"{np.median([run.ratio for run in runs]):.2f}",
        f"{short(np.mean(nees))} ({short(np.median(nees))})",
        short(np.median(nis)),
        f"{np.mean([run.share(Reason.NOVEL) for run in runs]):.4f}",
        f"{np.mean([run.share(Reason.UNCERTAIN) for run in runs]):.4f}",
    ]


def short(number: float) -> str:
    """Two digits behind the point, or a power of ten."""
    if not np.isfinite(number):
        return "–"
    return f"{number:.2f}" if abs(number) < 100 else f"{number:.0e}"


def by_span(name: str, runs: Sequence[Run]) -> list[str]:
    """Median over the runs of NEES/n and NIS/p, and the share within 3 sd, span by span."""
    cells = [name]
    for first, last in SPANS:
        parts = [run for run in runs if len(run.error) >= last]
        if not parts:
            cells.append("–")
            continue
        nees = np.median([run.nees[first:last].mean() for run in parts])
        nis = np.median([np.nanmean(run.nis[first:last]) for run in parts])
        inside = np.mean(
            [np.mean(np.abs(run.error[first:last]) <= 3 * run.std[first:last]) for run in parts]
        )
        cells.append(f"{short(nees)} · {short(nis)} · {inside:.3f}")
    return cells


def reliability(runs: Iterable[Run]) -> list[tuple[int, float, float]]:
    """In bins of the stated deviation over the recorded spread: how many, the rms stated deviation,
    and the rms error; NaN where there are fewer than 50."""
    said, so = [], []
    for run in runs:
        said.append((run.std / run.spread).ravel())
        so.append((run.error / run.spread).ravel())
    stated, error = np.concatenate(said), np.concatenate(so)
    rows = []
    for low, high in pairwise(EDGES):
        inside = (stated >= low) & (stated < high)
        count = int(inside.sum())
        if count < 50:
            rows.append((count, np.nan, np.nan))
        else:
            rms = (float(np.sqrt(np.mean(v[inside] ** 2))) for v in (stated, error))
            rows.append((count, *rms))
    return rows
