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
    "has_fraction",
    "is_of_day",
    "is_stamp",
    "stamp_texts",
    "written_like",
]

SECOND = 10**9
DAY = 86_400 * SECOND
"""Nanoseconds."""
_DATE = r"""(?:(?P<Y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})
    |(?P<a>\d{1,2})(?P<mark>[-/.])(?P<b>\d{1,2})[-/.](?P<c>\d{4}|\d{2}(?!\d))
    |(?P<compact>\d{8}(?=[T ]))
    |(?P<day>\d{1,2})[-/.\s]?(?P<month>(?!day)[A-Za-z]{3})[a-z]*\.?[-/.,\s]?\s?(?P<year>\d{4}|\d{2}(?!\d))
    |(?P<month2>[A-Za-z]{3})[a-z]*\.?\s+(?P<day2>\d{1,2}),?\s+(?P<year2>\d{4}))"""
_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec".split()  # noqa: SIM905
_CLOCK = r"""(?P<H>\d{1,3}):(?P<M>\d{2})(?::(?P<S>\d{2}))?
    (?:(?:[.,]|(?<=:\d\d:\d\d):(?=\d{3}(?!\d)))(?P<f>\d{1,9}))?\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|GMT|(?:UTC|GMT)?[+-]\d{2}(?::?\d{2})?)?(?:\[[\w/+-]+\])?"""
_DAY_OF_YEAR = r"(?P<doy>\d{3}(?=:\d\d:\d\d:\d\d(?:\.|\Z))|\d{1,3}(?=:\d\d:\d\d:\d\d\.)):"
_DAYS = r"(?P<days>\d{1,6})\s+days?,?\s+"
_DOTS = r"(?P<H3>\d{1,2})\.(?P<M3>\d{2})\.(?P<S3>\d{2})(?:[.,](?P<f3>\d{1,9}))?"
_COMPACT = r"(?P<H2>\d{2})(?P<M2>\d{2})(?P<S2>\d{2})(?:[.,](?P<f2>\d{1,9}))?(?P<zone2>Z)?"
_ALONE = _CLOCK.replace("?P<", "?P<only_")
_STAMP = re.compile(
    rf"(?:{_DATE}(?:[T,:_\s]\s*(?:{_CLOCK}|{_COMPACT}|{_DOTS}))?|(?:{_DAY_OF_YEAR}|{_DAYS})?{_ALONE})\Z",
    re.VERBOSE,
)
_LETTERS = re.compile(r"(\d{1,2})h(\d{2})m(\d{2}(?:[.,]\d{1,9})?)s?\Z")
_EPOCH = re.compile(r"(\d{9,11})(?:[.,](\d{1,9}))?\Z")


class Unclear(ValueError):
    """A date may be read in two ways."""


def _match(text: str) -> re.Match[str] | None:
    """What a text tells; three numbers of two digits alone are as likely a time of the day."""
    match = _STAMP.match(_LETTERS.sub(r"\1:\2:\3", text.strip()))
    if match is None or len(match["c"] or "year") > 2:
        return match
    return match if match["H"] or match["H2"] or match["H3"] else None


def is_stamp(text: str) -> bool:
    """Whether a text tells a date or a time of the day."""
    return _match(text) is not None


def has_fraction(text: str) -> bool:
    """Whether a text tells a time to less than a second."""
    match = _match(text)
    return match is not None and any(match[name] for name in ("f", "f2", "f3", "only_f"))


def is_of_day(text: str) -> bool:
    """Whether a text tells a time of the day, without a date."""
    match = _match(text)
    return match is not None and match["only_H"] is not None and not (match["doy"] or match["days"])


def stamp_texts(texts: Sequence[str]) -> NDArray[np.int64] | None:
    """Times (N,) of texts, ns since 1970 or since midnight; None where one of them is no time.

    A time of the day that falls by more than half a day goes on with the next day. Unclear is
    raised for dates like 5/6/2024 that change."""
    found = [_match(text) for text in texts]
    if not all(found):
        return None
    parts = [match.groupdict() for match in found if match is not None]
    order = _order(parts)
    try:
        times = np.array([_time(part, order) for part in parts], dtype=np.int64)
    except (ValueError, OverflowError):
        return None
    if parts[0]["only_H"] is not None and not (parts[0]["doy"] or parts[0]["days"]):
        falls = np.diff(times) < -DAY // 2
        times[1:] += DAY * np.cumsum(falls)
    return times


def first_unread(texts: Sequence[str]) -> int:
    """The first row whose text is no time, of texts that are not all times."""
    for row, text in enumerate(texts):
        match = _match(text)
        try:
            if match is None:
                return row
            _time(match.groupdict(), _order([match.groupdict()]))
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
    match = _match(text)
    if match is None:  # epoch seconds
        mark = "," if "," in text else "."
        return f"{ns // SECOND}{mark}{ns % SECOND:09d}"
    part = match.groupdict()
    needed = len(f"{ns % SECOND:09d}".rstrip("0"))
    digits = max(needed, len(part["f"] or part["f2"] or part["f3"] or part["only_f"] or ""))
    moment = ns if part["only_H"] is not None else ns + _zone(part)
    stamp = np.datetime64(moment, "ns")
    iso = np.datetime_as_string(stamp, unit="ns")[: 19 + (digits + 1 if digits else 0)]
    if part["days"] is not None:
        return f"{ns // DAY} days {iso[11:]}"
    if part["doy"] is not None:
        return f"{ns // DAY + 1:03d}:{iso[11:]}"
    if part["only_H"] is not None:
        return str(iso[11:])
    return str(iso) + (part["zone"] or part["zone2"] or "")


def _order(parts: Sequence[dict[str, str | None]]) -> str:
    """In which order dates like 5/6/2024 or 5/6/24 have day, month and year."""
    dates = {(p["a"] or "", p["b"] or "", p["c"] or "") for p in parts if p["a"]}
    mark = next((p["mark"] for p in parts if p["a"]), "/")
    usual: tuple[str, ...] = ("dmy", "mdy") if mark == "." else ("mdy", "dmy")
    if any(len(c) == 2 for _, _, c in dates):
        usual = ("ymd", *usual) if mark == "-" else (*usual, "ymd")
    fitting = [order for order in usual if all(_fits(order, *texts) for texts in dates)]
    if len(fitting) > 1 and len(dates) > 1 and mark != ".":
        raise Unclear
    return (*fitting, *usual)[0]


def _fits(order: str, *texts: str) -> bool:
    """Whether there is such a day."""
    found = dict(zip(order, map(int, texts), strict=True))
    try:
        date(_year(found["y"]), found["m"], found["d"])
    except ValueError:
        return False
    return True


def _year(number: int) -> int:
    """A year of two digits in full, from 1970 on."""
    return number if number > 99 else number + (1900 if number >= 70 else 2000)


def _time(part: dict[str, str | None], order: str) -> int:
    if part["only_H"] is not None:
        days = int(part["days"] or int(part["doy"] or 1) - 1)
        return days * DAY + _clock({k[5:]: v for k, v in part.items() if k.startswith("only_")})
    numbers: tuple[str | None, ...]
    if part["Y"] is not None:
        numbers = part["Y"], part["m"], part["d"]
    elif part["month"] is not None:
        numbers = str(_year(int(part["year"] or 0))), _month(part["month"]), part["day"]
    elif part["month2"] is not None:
        numbers = part["year2"], _month(part["month2"]), part["day2"]
    elif part["compact"] is not None:
        numbers = part["compact"][:4], part["compact"][4:6], part["compact"][6:]
    else:
        found = dict(zip(order, (part["a"], part["b"], part["c"]), strict=True))
        numbers = str(_year(int(found["y"] or 0))), found["m"], found["d"]
    days = _days(*(int(n or 0) for n in numbers))
    for form in "23":  # without colons
        if part[f"H{form}"] is not None:
            clock = {k[:-1]: v for k, v in part.items() if k.endswith(form)}
            return days * DAY + _clock(clock | {"zone": None})
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
    zone = (part["zone"] or "").removeprefix("UTC").removeprefix("GMT")
    if zone in ("", "Z"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    ahead = (3600 * int(digits[:2]) + 60 * int(digits[2:])) * SECOND
    return ahead if zone[0] == "+" else -ahead
