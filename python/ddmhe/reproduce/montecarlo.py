"""Many noise seeds of one experiment, in parallel processes, and their median and 90 % band."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ddmhe._core import DdmheError, ShapeError
from ddmhe.reproduce.tol import BLOWN_UP, SAME_TIME

Array = NDArray[np.float64]
T = TypeVar("T")
Estimators = Mapping[str, Callable[[], Any]]

__all__ = [
    "ENDS",
    "Trial",
    "Trials",
    "estimates",
    "in_parallel",
    "percentiles",
    "run_grid",
    "run_trials",
]

BAND = (5.0, 50.0, 95.0)
"""Percentiles that are shown: the median and the ends of the 90 % band."""
ENDS = ("5 %", "median", "95 %")
"""Their names."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One noise seed."""

    t: Array
    """Times of the estimates (N,), s."""
    x: Array
    """True states (N, n)."""
    y: Array
    """Outputs that were estimated from (N, p)."""
    x_hat: dict[str, Array]
    """Estimates (N, n) of each estimator; NaN after one has failed."""
    history: tuple[Array, Array] | None = None
    """Times (T+1,), s, and recorded states (T+1, n) before the first estimate."""
    center: Array | None = None
    """x_c(t) (N, n), the centre of the box on x̂(t); only where a figure is to show it."""
    active: Array | None = None
    """Bounds of that box that were active at each step (N,)."""


@dataclass(frozen=True, eq=False)
class Trials:
    """All seeds of an experiment."""

    all: list[Trial]

    @property
    def names(self) -> list[str]:
        """The estimators."""
        return list(self.all[0].x_hat)

    @property
    def t(self) -> Array:
        """Times (N,), s."""
        return self.all[0].t

    def errors(self, name: str) -> Array:
        """‖x̂ - x‖ (seeds, N); infinite where the estimator has failed."""
        with np.errstate(over="ignore"):
            found = np.array(
                [np.linalg.norm(trial.x_hat[name] - trial.x, axis=1) for trial in self.all]
            )
        return np.where(np.isnan(found), np.inf, found)

    def band(self, name: str) -> Array:
        """Median and ends of the 90 % band of ‖x̂ - x‖ over the seeds: (3, N)."""
        return percentiles(self.errors(name))

    def rms(self, name: str, start: float = 0.0, end: float = np.inf) -> Array:
        """Root mean square of ‖x̂ - x‖ for start < t - t_0 <= end: (seeds,)."""
        first = self.t[0] - (self.t[1] - self.t[0])
        part = (self.t - first > start + SAME_TIME) & (self.t - first <= end + SAME_TIME)
        with np.errstate(over="ignore"):
            return np.asarray(np.sqrt(np.mean(self.errors(name)[:, part] ** 2, axis=1)))

    def scatter(self, name: str, start: float, end: float) -> Array:
        """Root mean square of x̂ - x about its own cubic trend for start < t - t_0 <= end:
        (seeds,).

        What noise does to an estimate, without the bias and the drift that its RMSE about the truth
        mixes in."""
        first = self.t[0] - (self.t[1] - self.t[0])
        part = (self.t - first > start + SAME_TIME) & (self.t - first <= end + SAME_TIME)
        trend = np.polynomial.legendre.legvander(np.linspace(-1, 1, int(part.sum())), 3)
        off = np.array([trial.x_hat[name][part] - trial.x[part] for trial in self.all])
        failed = ~(np.abs(off) < BLOWN_UP).all(axis=(1, 2))
        off[failed] = 0.0
        rest = off - trend @ (np.linalg.pinv(trend) @ off)
        return np.where(failed, np.inf, np.sqrt(np.mean(np.sum(rest**2, axis=2), axis=1)))


def percentiles(values: Array) -> Array:
    """BAND over the seeds, the first axis: (3, …). Nearest ranks, since an error may be
    infinite."""
    return np.asarray(np.percentile(values, BAND, axis=0, method="nearest"))


def estimates(estimators: Estimators, Y: Array, n: int) -> dict[str, Array]:
    """x̂ (N, n) of each estimator over outputs Y (N, p); NaN for one whose numbers have left all
    bounds.

    Whatever else an estimator raises, at construction or in a run, is an error here, too.
    """
    found = {}
    for name, make in estimators.items():
        estimator = make()
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found[name] = np.asarray(estimator.run(Y).x)
        except (np.linalg.LinAlgError, OverflowError, FloatingPointError):
            found[name] = np.full((len(Y), n), np.nan)
        if found[name].shape != (len(Y), n):
            raise ShapeError(
                f"{name}: expected estimates of shape {(len(Y), n)}, found {found[name].shape}"
            )
    return found


def run_trials(
    trial: Callable[..., Trial], seeds: Sequence[int], advance: Callable[[], None], **given: Any
) -> Trials:
    """`trial(seed, **given)` for every seed, on all cores; `advance` is called after each."""
    return Trials(in_parallel(trial, seeds, advance, **given))


def run_grid(
    trial: Callable[..., Trial],
    seeds: Sequence[int],
    advance: Callable[[], None],
    settings: Sequence[Mapping[str, Any]],
) -> list[Trials]:
    """`trial(seed, **given)` for every seed and every one of the settings, through one pool: Trials
    of each setting."""
    jobs = [(trial, seed, given) for given in settings for seed in seeds]
    found = in_parallel(_grid_job, jobs, advance)
    return [Trials(found[k * len(seeds) : (k + 1) * len(seeds)]) for k in range(len(settings))]


def _grid_job(job: tuple[Callable[..., Trial], int, Mapping[str, Any]]) -> Trial:
    trial, seed, given = job
    return trial(seed, **given)


def in_parallel(
    function: Callable[..., T], jobs: Sequence[Any], advance: Callable[[], None], **given: Any
) -> list[T]:
    """`function(job, **given)` for every job, in processes on all cores; `advance` is called after
    each.

    The processes are not forked from this one, whose threads they would lack. An exception, Ctrl-C
    above all, ends them at once; a KeyboardInterrupt has the results by then as its `finished`.

    Raises
    ------
    DdmheError
        A process was killed.
    """
    others = set(multiprocessing.active_children())
    workers = max(1, min(os.cpu_count() or 1, len(jobs)))
    pool = ProcessPoolExecutor(workers, _context(), initializer=_start_worker)
    found = []
    try:
        for future in _submitted(pool, function, jobs, given):
            found.append(future.result())
            advance()
    except BrokenProcessPool as e:
        # one that was being started while the pool broke is in no list of the pool's
        _terminate(others)
        raise DdmheError(
            f"workers: expected {workers} processes that finish their jobs, found one that was "
            f"killed after {len(found)} of {len(jobs)} jobs (by hand, or by the system for want "
            "of memory)"
        ) from e
    except BaseException as e:
        if isinstance(e, KeyboardInterrupt):
            e.finished = found  # type: ignore[attr-defined]
        pool.shutdown(wait=False, cancel_futures=True)
        _terminate(others)
        raise
    finally:
        pool.shutdown()
    return found


def _submitted(
    pool: ProcessPoolExecutor,
    function: Callable[..., T],
    jobs: Sequence[Any],
    given: Mapping[str, Any],
) -> list[Future[T]]:
    """The jobs' futures. A worker that starts while the pool breaks finds its pipe closed, an
    OSError; submitting once more tells whether that was why: BrokenProcessPool."""
    try:
        return [pool.submit(function, job, **given) for job in jobs]
    except OSError:
        pool.submit(function, jobs[0], **given)
        raise


def _terminate(others: set[Any]) -> None:
    """Ends the child processes that were not there before: `others` live on."""
    for child in set(multiprocessing.active_children()) - others:
        child.terminate()


def _context() -> Any:
    """How worker processes start where the platform leaves a choice: from a clean process, never a
    copy of this one."""
    methods = multiprocessing.get_all_start_methods()
    return multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")


def _start_worker() -> None:
    """The processes share the cores: no threads inside of them. Ctrl-C is the parent's to act
    on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["RAYON_NUM_THREADS"] = "1"
    threadpool_limits(1)
