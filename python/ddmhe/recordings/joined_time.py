"""Times that several columns hold together: a date and a time of the day, seconds and what is below
them, the parts of a date, a GPS week and the time in it. Each is joined to one column, and said."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date, timedelta
from decimal import Decimal, InvalidOperation
from typing import NamedTuple

import numpy as np

from ddmhe.checks import shown
from ddmhe.recordings.stamp_texts import has_fraction, is_stamp
from ddmhe.recordings.table import Table
from ddmhe.recordings.time_units import is_time_name

__all__ = ["with_joined_time"]

_JOINED = "time"
_WORDS = {
    "year": "year yr yyyy jahr",
    "month": "month mon monat",
    "day": "day dd tag",
    "doy": "doy dayofyear yday jday",
    "hour": "hour hours hr hh stunde",
    "minute": "minute minutes min mi",
    "second": "second seconds sec ss ssss sekunde",
    "sod": "sod secondofday secondsofday secofday",
    "ms": "ms msec msecs millisecond milliseconds millis",
    "us": "us usec usecs microsecond microseconds micros",
    "ns": "ns nsec nsecs nanosecond nanoseconds nanos nanosec nanosecs",
    "week": "week gpsweek gpswk wn gpswn",
    "date": "date datum yyyymmdd fecha",
}
_PARTS = {word: part for part, words in _WORDS.items() for word in words.split()}
_BELOW = {"ms": 3, "us": 6, "ns": 9}
"""Digits of a second's fraction."""
_LIMITS = {"month": (1, 12), "day": (1, 31), "doy": (1, 366), "hour": (0, 23), "minute": (0, 59)}
_OF_WEEK = re.compile(r"(gps)?(i?tow|sow|secondsofweek|secofweek|timeofweek)(?P<unit>ms|s|sec)?\Z")
_WEEK = 604_800
_SECONDS = re.compile(r"(?P<stem>.*?)(?P<word>secs?|seconds)\Z", re.IGNORECASE)
_CLOCK = re.compile(r"(\d{6})(?:\.(\d{1,9}))?\Z")


class Joined(NamedTuple):
    """What columns say together."""

    names: tuple[str, ...]
    cells: list[str]


def with_joined_time(table: Table, own: Sequence[str] = ()) -> Table:
    """The table with one column of times in the place of several, none of them among the columns
    `own`; as it is where there are none."""
    free = [n for n in table.header if table.header.count(n) == 1 and n not in own]
    rules: tuple[Callable[[Table, list[str]], Joined | None], ...] = (
        _date_and_clock, _calendar, _seconds_and_below, _stamps_and_below, _digits, _weeks,
    )  # fmt: skip
    found = next((joined for rule in rules if (joined := rule(table, free)) is not None), None)
    if found is None:
        return table
    name = _JOINED
    while name in table.header:
        name += "_"
    kept = [k for k, known in enumerate(table.header) if known not in found.names]
    header = [name, *(table.header[k] for k in kept)]
    columns = [found.cells, *(table.columns[k] for k in kept)]
    units = {k: v for k, v in table.units.items() if k not in found.names}
    *first, last = map(shown, found.names)
    told = f"time of columns {', '.join(first)} and {last}"
    made = replace(table, header=header, columns=columns, units=units, alone=False)
    return made.noted(told)


def _word(name: str) -> str:
    """A name without its unit in brackets, in small letters alone."""
    return re.sub(r"[^a-z]", "", re.sub(r"[\[(].*", "", name).lower())


def _parts(names: Sequence[str]) -> dict[str, str]:
    """Columns by the part of a time that their names say; none that two of them say."""
    letters = {"MM": "month", "mm": "minute"} if {"MM", "mm"} <= set(names) else {}
    known = [(letters.get(name) or _PARTS.get(_word(name)), name) for name in names]
    found = [(part, name) for part, name in known if part is not None]
    every = [part for part, _ in found]
    return {part: name for part, name in found if every.count(part) == 1}


def _numbers(table: Table, name: str) -> list[Decimal] | None:
    """The cells as exact numbers; None where one is none."""
    cells = table.column(name)
    texts = [repr(c) for c in cells.tolist()] if isinstance(cells, np.ndarray) else cells
    try:
        found = [Decimal(text.strip().replace(table.decimal, ".")) for text in texts]
    except InvalidOperation:
        return None
    return found if all(number.is_finite() for number in found) else None


def _whole(table: Table, name: str, low: int, high: int) -> list[int] | None:
    """The cells as whole numbers from low to high; None where one is none."""
    found = _numbers(table, name)
    if found is None or not all(low <= n <= high and n == int(n) for n in found):
        return None
    return [int(n) for n in found]


def _texts(table: Table, names: Sequence[str], fits: Callable[[str], bool]) -> dict[str, list[str]]:
    """Columns of texts whose first cell fits."""
    columns = {name: table.column(name) for name in names}
    return {
        name: [cell.strip() for cell in column]
        for name, column in columns.items()
        if not isinstance(column, np.ndarray) and len(column) and fits(column[0].strip())
    }


def _other_clock(table: Table, names: Sequence[str], parts: Sequence[str]) -> bool:
    """Whether a column beside these is called a time."""
    return any(is_time_name(name) and name not in parts for name in names)


def _date_and_clock(table: Table, names: list[str]) -> Joined | None:
    texts = _texts(table, names, lambda cell: is_stamp(cell) or is_stamp(f"{cell} 00:00:00"))
    clocks = [name for name, cells in texts.items() if is_stamp(f"2000-01-01 {cells[0]}")]
    dates = [n for n, cells in texts.items() if ":" not in cells[0] and n not in clocks]
    if len(dates) != 1 or len(clocks) != 1:
        return None
    pair = zip(texts[dates[0]], texts[clocks[0]], strict=True)
    return Joined((dates[0], clocks[0]), [f"{day} {clock}" for day, clock in pair])


def _digits(table: Table, names: list[str]) -> Joined | None:
    """20240501 beside 115958.02 or 115958020."""
    day = _parts(names).get("date")
    clocks = [n for n in names if n != day and (is_time_name(n) or _word(n).startswith("hhmmss"))]
    if day is None or len(clocks) != 1:
        return None
    texts = _texts(table, [day, *clocks], bool)
    if day not in texts or clocks[0] not in texts:
        return None
    days = texts[day]
    if not all(re.fullmatch(r"(19|20)\d{6}", cell) for cell in days):
        return None
    whole = max(len(cell.partition(".")[0]) for cell in texts[clocks[0]])
    width = 6 if whole == 6 else 9
    filled = [
        cell.zfill(width + len(cell) - len(cell.partition(".")[0])) for cell in texts[clocks[0]]
    ]
    if width == 9:
        filled = [f"{cell[:6]}.{cell[6:]}" for cell in filled]
    found = [_CLOCK.match(cell) for cell in filled]
    clock = [_clock(match[1], match[2]) for match in found if match is not None]
    if whole < 6 or len(clock) < len(days) or None in clock:
        return None
    if all(cell is not None and cell[6:8] == "00" for cell in clock):
        return None  # steps of whole hundreds are as likely no times of the day
    joined = zip(days, clock, strict=True)
    return Joined((day, clocks[0]), [f"{d[:4]}-{d[4:6]}-{d[6:]} {c}" for d, c in joined])


def _clock(digits: str, fraction: str | None) -> str | None:
    """Six digits as a time of the day; None where they are none."""
    hours, minutes, seconds = digits[:2], digits[2:4], digits[4:]
    if int(hours) > 23 or int(minutes) > 59 or int(seconds) > 59:
        return None
    return f"{hours}:{minutes}:{seconds}" + (f".{fraction}" if fraction else "")


def _seconds_and_below(table: Table, names: list[str]) -> Joined | None:
    """As messages of ROS hold a stamp: whole seconds, and what is below one second."""
    for name in names:
        found = _SECONDS.match(name)
        if found is None or (found["stem"] and found["stem"][-1].isalnum()):
            continue
        for unit, digits in _BELOW.items():
            beside = [
                n for n in names for word in _WORDS[unit].split() if n == found["stem"] + word
            ]
            if len(beside) != 1:
                continue
            seconds = _whole(table, name, 0, 10**12)
            below = _whole(table, beside[0], 0, 10**digits - 1)
            if seconds is not None and below is not None:
                pairs = zip(seconds, below, strict=True)
                return Joined((name, beside[0]), [f"{s}.{b:0{digits}d}" for s, b in pairs])
    return None


def _stamps_and_below(table: Table, names: list[str]) -> Joined | None:
    """Dates or times of the day to whole seconds, and milliseconds beside them."""
    parts = _parts(names)
    units = [unit for unit in _BELOW if unit in parts]
    if len(units) != 1:
        return None
    beside, digits = parts[units[0]], _BELOW[units[0]]
    others = [name for name in names if name != beside]
    texts = _texts(table, others, lambda cell: is_stamp(cell) and ":" in cell)
    stamps = list(texts)
    below = _whole(table, beside, 0, 10**digits - 1)
    if len(stamps) != 1 or below is None or any(map(has_fraction, texts[stamps[0]])):
        return None
    pairs = zip(texts[stamps[0]], below, strict=True)
    joined = [re.sub(r"(:\d\d:\d\d)", rf"\g<1>.{b:0{digits}d}", s, count=1) for s, b in pairs]
    return Joined((stamps[0], beside), joined) if all(map(is_stamp, joined[:3])) else None


def _calendar(table: Table, names: list[str]) -> Joined | None:
    """Year, month, day or day of the year, hour, minute, second or second of the day, and what is
    below a second."""
    parts = _parts(names)
    days = next(
        (c for c in (("year", "month", "day"), ("year", "doy")) if set(c) <= set(parts)), ()
    )
    clock = ("sod",) if "sod" in parts else ("hour", "minute", "second")
    below = tuple(unit for unit in _BELOW if unit in parts)
    if not set(clock) <= set(parts) or len(below) > 1 or (clock == ("sod",) and not days):
        return None
    used = tuple(parts[part] for part in (*days, *clock, *below))
    if _other_clock(table, names, used):
        return None
    limits = {**_LIMITS, "year": (1970, 2199)}
    whole = {p: _whole(table, parts[p], *limits[p]) for p in (*days, *clock[:-1])}
    whole |= {p: _whole(table, parts[p], 0, 10 ** _BELOW[p] - 1) for p in below}
    last = _numbers(table, parts[clock[-1]])
    if last is None or not all(
        0 <= v < (86_400 if days and clock == ("sod",) else 60) for v in last
    ):
        return None
    if None in whole.values() or (below and any(v != int(v) for v in last)):
        return None
    rows = [{p: v[k] for p, v in whole.items() if v is not None} for k in range(len(last))]
    try:
        cells = [_iso(row, v, below) for row, v in zip(rows, last, strict=True)]
    except ValueError:  # there is no such day
        return None
    return Joined(used, cells)


def _iso(row: dict[str, int], seconds: Decimal, below: tuple[str, ...]) -> str:
    for unit in below:
        seconds += Decimal(row[unit]).scaleb(-_BELOW[unit])
    seconds += 3600 * row.get("hour", 0) + 60 * row.get("minute", 0)
    ns = int((seconds * 10**9).to_integral_value())
    clock = f"{ns // 3_600_000_000_000:02d}:{ns // 60_000_000_000 % 60:02d}"
    clock += f":{ns // 10**9 % 60:02d}.{ns % 10**9:09d}"
    if "year" not in row:
        return clock
    if "doy" in row:
        return f"{date(row['year'], 1, 1) + timedelta(days=row['doy'] - 1)} {clock}"
    return f"{date(row['year'], row['month'], row['day'])} {clock}"


def _weeks(table: Table, names: list[str]) -> Joined | None:
    """A GPS week and the time in it, as a date in GPS's time."""
    week = _parts(names).get("week")
    found = [(n, match) for n in names if (match := _OF_WEEK.match(_word(n))) is not None]
    if week is None or len(found) != 1 or _other_clock(table, names, (week, found[0][0])):
        return None
    name, match = found[0]
    weeks, times = _whole(table, week, 0, 10_000), _numbers(table, name)
    if weeks is None or times is None:
        return None
    stated = table.unit(name) or match["unit"] or ("ms" if match[2] == "itow" else "")
    whole = all(v == int(v) for v in times)
    if not stated and whole and max(times) < _WEEK:
        return None  # seconds, or milliseconds of the week's first minutes
    ms = stated == "ms" or (not stated and max(times) >= _WEEK)
    seconds = [v / 1000 if ms else v for v in times]
    if not all(0 <= v < _WEEK for v in seconds):
        return None
    cells = []
    for number, of_week in zip(weeks, seconds, strict=True):
        day, of_day = divmod(of_week, 86_400)
        begin = date(1980, 1, 6) + timedelta(weeks=number, days=int(day))
        row = {"year": begin.year, "month": begin.month, "day": begin.day}
        cells.append(_iso(row, of_day, ()))
    return Joined((week, name), cells)
