"""How far a campaign is: a bar on a terminal, lines of JSON for machines, else a line now and
then."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from ddmhe.cli.answer import Answer

if TYPE_CHECKING:
    from ddmhe.campaign import Progress as Stand

__all__ = ["length", "watching"]

EVERY = 10.0
"""Seconds between two lines where there is no terminal."""


@contextmanager
def watching(answer: Answer) -> Iterator[Callable[[Stand], None]]:
    """Takes the stand of a campaign, as often as it is told."""
    if answer.as_json:
        yield _line_of_json
    elif answer.quiet:
        yield lambda stand: None
    elif sys.stderr.isatty():
        with _bar() as tell:
            yield tell
    else:
        yield _lines()


def _words(stand: Stand) -> str:
    left = "" if math.isinf(stand.left) else f", {length(stand.left)} left"
    return (
        f"{stand.done} of {stand.total} cases, {stand.rate:.3g} a second, {stand.failed} "
        f"failed{left}"
    )


def _where(stand: Stand) -> str:
    return f"{stand.workers}; Dask's dashboard: {stand.dashboard}"


def _line_of_json(stand: Stand) -> None:
    left = None if math.isinf(stand.left) else stand.left
    told = {
        "event": "progress",
        "done": stand.done,
        "total": stand.total,
        "failed": stand.failed,
        "seconds": stand.seconds,
        "rate": stand.rate,
        "left_seconds": left,
        "dashboard": stand.dashboard,
        "workers": stand.workers,
    }
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()


def _lines() -> Callable[[Stand], None]:
    last = -math.inf

    def tell(stand: Stand) -> None:
        nonlocal last
        if last == -math.inf:
            print(f"ddmhe: {_where(stand)}", file=sys.stderr, flush=True)
        if time.monotonic() - last > EVERY or stand.done == stand.total:
            last = time.monotonic()
            print(f"ddmhe: {_words(stand)}", file=sys.stderr, flush=True)

    return tell


@contextmanager
def _bar() -> Iterator[Callable[[Stand], None]]:
    columns = (BarColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("")

        def tell(stand: Stand) -> None:
            if progress.tasks[0].total != stand.total:
                progress.console.print(_where(stand), markup=False, highlight=False)
            progress.update(
                task, total=stand.total, completed=stand.done, description=_words(stand)
            )

        yield tell


def length(seconds: float) -> str:
    """A length of time in words."""
    if seconds < 100:
        return f"{seconds:.2g} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
