"""What a command is at while it takes long: a bar with the time left, on a terminal alone."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

__all__ = ["Advance", "working"]

AFTER = 1.0
"""Seconds of work without a bar: what is done sooner needs none."""
Advance = Callable[[float, float | None], None]
"""Takes how much is done, and of how much where that is known."""


@contextmanager
def working(what: str, shown: bool, timed: bool) -> Iterator[Advance]:
    """A piece of work; `timed`: say on stderr how long it took, `shown`: with a bar, if stderr is
    a terminal."""
    begin = time.perf_counter()
    with _bar(what) if shown and sys.stderr.isatty() else _nothing() as advance:
        yield advance
    if timed:
        print(f"ddmhe: {what}: {time.perf_counter() - begin:.3f} s", file=sys.stderr)


@contextmanager
def _nothing() -> Iterator[Advance]:
    yield lambda done, total: None


@contextmanager
def _bar(what: str) -> Iterator[Advance]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        _Left(),
        TimeElapsedColumn(),
    )
    progress = Progress(*columns, console=Console(stderr=True), transient=True)
    task = progress.add_task(what, total=None)
    timer = Timer(AFTER, progress.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda done, total: progress.update(task, completed=done, total=total)
    finally:
        timer.cancel()
        timer.join()  # else the bar might begin after its end
        progress.stop()


class _Left(TimeRemainingColumn):
    """The time left, in words."""

    def render(self, task: object) -> Text:
        """Empty while nothing tells it."""
        left = super().render(task)  # type: ignore[arg-type]
        return Text("") if "-" in left.plain else Text(f"{left.plain} left", style=left.style)
