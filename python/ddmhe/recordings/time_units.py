"""Units of time: what words say them, and what values do."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.errors import LogError

__all__ = ["PER_SECOND", "checked_unit", "epoch_unit", "is_time_name", "unit_in_name", "unit_word"]

PER_SECOND = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0, "min": 1 / 60, "h": 1 / 3600}
PER_SECOND["days"] = 1 / 86400
"""How many of a unit one second has."""
_WORDS = {
    "ns": "ns nsec nsecs nano nanos nanosec nanosecs nanosecond nanoseconds",
    "us": "us µs μs usec usecs micro micros microsec microsecond microseconds",
    "ms": "ms msec msecs milli millis millisec millisecond milliseconds",
    "s": "s sec secs second seconds sekunde sekunden",
    "min": "min mins minute minutes",
    "h": "h hr hrs hour hours",
    "days": "d day days",
}
_UNITS = {word: unit for unit, words in _WORDS.items() for word in words.split()}
_ALONE = frozenset(word for word in _UNITS if len(word) > 1) - {"min", "mins"}
"""Units that, alone, are a time column's name."""
_NAMES = frozenset(
    """time times timestamp timestamps stamp datetime date clock zeit zeitstempel uhrzeit
    temps tiempo ts utc epoch elapsed timeus timems""".split()  # noqa: SIM905
)
_EPOCH = (0.8e9, 4.2e9)
"""Seconds since 1970 from 1995 to 2103."""
_SERIALS = ((35_000, 75_000), (728_000, 768_000))
"""Days as spreadsheets and MATLAB count them, from 1995 to 2105."""
SHORTEST = 1e-5
"""Steps below this many seconds are none of a log whose times look like serial days."""


def unit_word(text: str) -> str | None:
    """The unit of time that a text says."""
    words = text.strip().strip("[]()").strip().lower()
    return _UNITS.get(words.partition(" since ")[0])


def checked_unit(option: str, unit: Any) -> str:
    """A unit that is named; LogError for others."""
    found = unit_word(unit) if isinstance(unit, str) else None
    if found is None:
        raise LogError(
            f"{option}: expected one of {', '.join(reversed(PER_SECOND))}, found {shown(unit)}"
        )
    return found


def _tokens(name: str) -> list[str]:
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [token for token in re.split(r"[^0-9A-Za-zµμ]+", split) if token]


def is_time_name(name: str) -> bool:
    """Whether a column's name says that it holds times."""
    tokens = _tokens(name)
    if not tokens:
        return False
    lower = [token.lower() for token in tokens]
    if tokens[0] == "t" and (len(tokens) == 1 or (len(tokens) == 2 and lower[1] in _UNITS)):
        return True
    return bool(_NAMES & set(lower)) or (len(lower) == 1 and lower[0] in _ALONE)


def unit_in_name(name: str) -> str | None:
    """The unit of time that a column's name ends with."""
    last = (_tokens(name) or [""])[-1].lower()
    if last in ("timeus", "timems"):
        return last[-2:]
    return _UNITS.get(last)


def epoch_unit(values: NDArray[Any]) -> str | None:
    """The unit in which values (N,) are times since 1970, or serial days; None where they are
    not."""
    low, high = float(values.min()), float(values.max())
    for unit in ("s", "ms", "us", "ns"):
        if _EPOCH[0] * PER_SECOND[unit] <= low <= high <= _EPOCH[1] * PER_SECOND[unit]:
            return unit
    step = float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 1.0
    if any(a <= low <= high <= b for a, b in _SERIALS) and 0 < step < SHORTEST:
        return "days"
    return None
