"""A run over a log in pieces: the same numbers, with word on how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from ddmhe._core import Log
from ddmhe.cli.answer import Answer

__all__ = ["run"]

FIRST = 4096
"""Steps of the first piece."""
PIECE = 0.2
"""Seconds that a piece is to take."""


def run(answer: Answer, estimates: Callable[[slice], Log], count: int) -> Log:
    """The estimates of so many samples, which are made one piece after the other; after an
    interrupt those made by then, and a KeyboardInterrupt where there is none."""
    logs: list[Log] = []
    with answer.working("estimating") as advance:
        done, rows = 0, FIRST
        while done < count or not logs:
            advance(done, count)
            piece = slice(done, done + rows)
            begin = time.perf_counter()
            try:
                logs.append(estimates(piece))
            except KeyboardInterrupt as e:
                logs.append(e.finished)  # type: ignore[attr-defined]
                break
            done += len(logs[-1].x)
            rows = max(int(rows * PIECE / max(time.perf_counter() - begin, 1e-6)), 1)
    log = logs[0] if len(logs) == 1 else _joined(logs)
    if count > 0 and len(log.x) == 0:
        raise KeyboardInterrupt
    return log


def _joined(parts: list[Any]) -> Any:
    """Objects that are made of columns, one behind the other."""
    if is_dataclass(parts[0]) and not isinstance(parts[0], type):
        names = [field.name for field in fields(parts[0])]
        return replace(
            parts[0], **{name: _column([getattr(part, name) for part in parts]) for name in names}
        )
    make = parts[0].__reduce__()[0]
    columns = zip(*(part.__reduce__()[1] for part in parts), strict=True)
    return make(*(_column(list(column)) for column in columns))


def _column(parts: list[Any]) -> Any:
    first = parts[0]
    if first is None or isinstance(first, str | int | float):
        return first  # the same of all, and when the first begins
    if isinstance(first, tuple):
        return tuple(_column(list(column)) for column in zip(*parts, strict=True))
    return np.concatenate(parts) if isinstance(first, np.ndarray) else _joined(parts)
