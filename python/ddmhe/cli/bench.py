"""``ddmhe bench``: what a step costs, on this machine, with this log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ddmhe import models, report
from ddmhe._core import DdMhe, History
from ddmhe.cases.satellite import DT, DURATION, T
from ddmhe.checks import word
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import reading_options
from ddmhe.cli.reading import read
from ddmhe.cli.settings import OF_ESTIMATOR, setting_options, settings_from_file, settings_of

Array = NDArray[np.float64]

__all__ = ["command"]


@click.command("bench", short_help="What a step costs on this machine with this log.")
@click.argument("log", required=False, type=click.Path(path_type=Path))
@reading_options(required=False)
@setting_options
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=20_000,
    show_default=True,
    help="Steps that are timed, at least; the log begins again where it ends.",
)
@answers
def command(
    answer: Answer, log: Path | None, config: Path | None, steps: int, **given: Any
) -> None:
    """What a step costs on this machine with this log and these settings: median, 99 %, longest.

    Without a LOG it is the demo's satellite. Steps are timed one by one as Python makes them,
    `step(y, u, out=x)`, and as `run` makes them, all in one call."""
    own = {key: given.pop(key) for key in OF_ESTIMATOR}
    from_file = settings_from_file(config, given)
    if log is None:
        recording = models.detumbling().simulate(DURATION, DT, noise=0.01)
        history, Y, U, title = recording.history(T), recording.y[T:], None, "the demo's satellite"
        settings: dict[str, Any] = {}
    else:
        for name in ("state", "output"):
            if not given[name]:
                raise click.UsageError(f"Missing option '--{name}'.")
        samples, split = read(answer, log, given)
        history, Y, U, title = split.history, split.Y, split.U, word(log.name)
        settings = settings_of(from_file, own, samples.names, split.goes_on)
    begin = time.perf_counter()
    with answer.working("preparing"):
        est = DdMhe(history, **settings)
    prepared = time.perf_counter() - begin
    seconds = _steps(answer, est, Y, U, steps)
    begin = time.perf_counter()
    est.reset()
    est.run(Y, U)
    in_run = (time.perf_counter() - begin) / len(Y)
    numbers = {
        "prepare_seconds": prepared,
        "steps": len(seconds),
        "step_seconds": dict(
            zip(("median", "p99", "max"), np.percentile(seconds, [50, 99, 100]), strict=True)
        ),
        "run_seconds_per_step": in_run,
        "dt": history.dt,
    }
    answer.show(
        report.table(f"A step on this machine: {title}", {"": _rows(history, est, numbers)})
    )
    answer.facts(**numbers)


def _steps(answer: Answer, est: DdMhe, Y: Array, U: Array | None, least: int) -> Array:
    """Wall time of each step, s: whole passes over the log, each from the start."""
    found: list[float] = []
    x = np.empty(est.n)
    clock = time.perf_counter_ns
    outputs, inputs = list(Y), [None] * len(Y) if U is None else list(U)
    with answer.working("stepping") as advance:
        while len(found) < least:
            est.reset()
            for y, u in zip(outputs, inputs, strict=True):
                begin = clock()
                est.step(y, u, out=x)
                found.append(1e-9 * (clock() - begin))
            advance(len(found), least)
    return np.array(found)


def _rows(h: History, est: DdMhe, numbers: dict[str, Any]) -> dict[str, str]:
    step = numbers["step_seconds"]
    return {
        "n, p, m; M": f"{h.n}, {h.p}, {h.m}; {est.horizon}",
        "preparing": _time(numbers["prepare_seconds"]),
        "steps timed": str(numbers["steps"]),
        "step, median": _time(step["median"]),
        "step, 99 %": _time(step["p99"]),
        "step, longest": _time(step["max"]),
        "step within a run, mean": _time(numbers["run_seconds_per_step"]),
        "sampling interval": _time(h.dt),
        "longest over interval": f"{step['max'] / h.dt:.2%}",
    }


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e6:.3g} us"
