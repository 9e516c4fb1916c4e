"""Texts that tell a time, to whole nanoseconds: ISO dates and others, times of the day, epoch
seconds with a fraction."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DAY",
    "Unclear",
    "epoch_texts",
    "first_unread",
    "is_of_day",
    "is_stamp",
    "stamp_texts",
    "written_like",
]

SECOND = 10**9
DAY = 86_400 * SECOND
"""Nanoseconds."""
_DATE = r"""(?:(?P<Y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})
    |(?P<a>\d{1,2})(?P<mark>[-/.])(?P<b>\d{1,2})[-/.](?P<c>\d{4})
    |(?P<compact>\d{8}(?=[T ]))
    |(?P<day>\d{1,2})[-/.\s](?P<month>[A-Za-z]{3})[a-z]*\.?[-/.,\s]\s?(?P<year>\d{4})
    |(?P<month2>[A-Za-z]{3})[a-z]*\.?\s+(?P<day2>\d{1,2}),?\s+(?P<year2>\d{4}))"""
_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec".split()  # noqa: SIM905
_CLOCK = r"""(?P<H>\d{1,3}):(?P<M>\d{2})(?::(?P<S>\d{2}))?
    (?:(?:[.,]|(?<=:\d\d:\d\d):(?=\d{3}(?!\d)))(?P<f>\d{1,9}))?\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d{2}(?::?\d{2})?)?"""
_COMPACT = r"(?P<H2>\d{2})(?P<M2>\d{2})(?P<S2>\d{2})(?:[.,](?P<f2>\d{1,9}))?(?P<zone2>Z)?"
_STAMP = re.compile(
    rf"(?:{_DATE}(?:[T,\s]\s*(?:{_CLOCK}|{_COMPACT}))?|{_CLOCK.replace('?P<', '?P<only_')})\Z",
    re.VERBOSE,
)
_EPOCH = re.compile(r"(\d{9,11})(?:[.,](\d{1,9}))?\Z")


class Unclear(ValueError):
    """A date may be read in two ways."""


def is_stamp(text: str) -> bool:
    """Whether a text tells a date or a time of the day."""
    return _STAMP.match(text.strip()) is not None


def is_of_day(text: str) -> bool:
    """Whether a text tells a time of the day, without a date."""
    match = _STAMP.match(text.strip())
    return match is not None and match["only_H"] is not None


def stamp_texts(texts: Sequence[str]) -> NDArray[np.int64] | None:
    """Times (N,) of texts, ns since 1970 or since midnight; None where one of them is no time.

    A time of the day that falls by more than half a day goes on with the next day. Unclear is
    raised for dates like 5/6/2024 that change."""
    found = [_STAMP.match(text.strip()) for text in texts]
    if not all(found):
        return None
    parts = [match.groupdict() for match in found if match is not None]
    first = _day_first(parts)
    try:
        times = np.array([_time(part, first) for part in parts], dtype=np.int64)
    except (ValueError, OverflowError):
        return None
    if parts[0]["only_H"] is not None:
        falls = np.diff(times) < -DAY // 2
        times[1:] += DAY * np.cumsum(falls)
    return times


def first_unread(texts: Sequence[str]) -> int:
    """The first row whose text is no time, of texts that are not all times."""
    for row, text in enumerate(texts):
        match = _STAMP.match(text.strip())
        try:
            if match is None:
                return row
            _time(match.groupdict(), _day_first([match.groupdict()]))
        except ValueError:
            return row
    return 0


def epoch_texts(texts: Sequence[str]) -> NDArray[np.int64] | None:
    """Seconds since 1970 with a fraction, as whole nanoseconds (N,): more digits than a float64
    has; None where a text is none."""
    if not texts or _EPOCH.match(texts[0].strip()) is None:
        return None
    found = [_EPOCH.match(text.strip()) for text in texts]
    if not all(found):
        return None
    pairs = (match.groups() for match in found if match is not None)
    return np.array(
        [int(s) * SECOND + int((f or "").ljust(9, "0")) for s, f in pairs], dtype=np.int64
    )


def written_like(text: str, ns: int) -> str:
    """A time in ns as the text is written: its kind of date, its digits, its zone."""
    match = _STAMP.match(text.strip())
    if match is None:  # epoch seconds
        mark = "," if "," in text else "."
        return f"{ns // SECOND}{mark}{ns % SECOND:09d}"
    part = match.groupdict()
    needed = len(f"{ns % SECOND:09d}".rstrip("0"))
    digits = max(needed, len(part["f"] or part["f2"] or part["only_f"] or ""))
    moment = ns if part["only_H"] is not None else ns + _zone(part)
    stamp = np.datetime64(moment, "ns")
    iso = np.datetime_as_string(stamp, unit="ns")[: 19 + (digits + 1 if digits else 0)]
    if part["only_H"] is not None:
        return str(iso[11:])
    return str(iso) + (part["zone"] or part["zone2"] or "")


def _day_first(parts: Sequence[dict[str, str | None]]) -> bool:
    """Whether dates like 5/6/2024 begin with the day."""
    dates = {(p["a"], p["b"], p["mark"]) for p in parts if p["a"] is not None}
    if any(mark == "." for _, _, mark in dates) or any(int(a or 0) > 12 for a, _, _ in dates):
        return True
    if any(int(b or 0) > 12 for _, b, _ in dates) or len(dates) < 2:
        return False
    raise Unclear


def _time(part: dict[str, str | None], day_first: bool) -> int:
    if part["only_H"] is not None:
        return _clock({k[5:]: v for k, v in part.items() if k.startswith("only_")})
    numbers: tuple[str | None, ...]
    if part["Y"] is not None:
        numbers = part["Y"], part["m"], part["d"]
    elif part["month"] is not None:
        numbers = part["year"], _month(part["month"]), part["day"]
    elif part["month2"] is not None:
        numbers = part["year2"], _month(part["month2"]), part["day2"]
    elif part["compact"] is not None:
        numbers = part["compact"][:4], part["compact"][4:6], part["compact"][6:]
    else:
        day, month = (part["a"], part["b"]) if day_first else (part["b"], part["a"])
        numbers = part["c"], month, day
    days = _days(*(int(n or 0) for n in numbers))
    if part["H2"] is not None:
        return days * DAY + _clock({k[:-1]: v for k, v in part.items() if k.endswith("2")})
    return days * DAY + (0 if part["H"] is None else _clock(part) - _zone(part))


def _month(name: str) -> str:
    """The number of a month; ValueError for a name that is not English."""
    return str(_MONTHS.index(name.lower()) + 1)


@lru_cache(maxsize=64)
def _days(year: int, month: int, day: int) -> int:
    return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()


def _clock(part: dict[str, str | None]) -> int:
    """Nanoseconds since midnight; hours and minutes with a fraction are minutes and seconds."""
    hours, minutes, seconds = int(part["H"] or 0), int(part["M"] or 0), part["S"]
    fraction = int((part["f"] or "0").ljust(9, "0"))
    if seconds is None and part["f"] is not None:
        return (60 * hours + minutes) * SECOND + fraction
    if part.get("half"):
        hours = hours % 12 + (12 if str(part["half"]).lower() == "pm" else 0)
    if minutes > 59 or int(seconds or 0) > 60:
        raise ValueError
    return (3600 * hours + 60 * minutes + int(seconds or 0)) * SECOND + fraction


def _zone(part: dict[str, str | None]) -> int:
    """What a zone is ahead of UTC, ns."""
    zone = part["zone"] or ""
    if zone in ("", "Z", "UTC"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    ahead = (3600 * int(digits[:2]) + 60 * int(digits[2:])) * SECOND
    return ahead if zone[0] == "+" else -ahead
