"""How a log is read: every option, checked once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmhe.checks import MOST, check_flag, check_kind, choice, shown
from ddmhe.recordings.errors import LARGEST, LogError
from ddmhe.recordings.order import DUPLICATES
from ddmhe.recordings.time_units import checked_unit

__all__ = ["Reading", "checked_missing"]


@dataclass(frozen=True)
class Reading:
    """Options beyond the columns; LogError for a wrong one."""

    time: str | None = None
    start: float | str | None = None
    decimate: int = 1
    missing: Sequence[float | str] = ()
    unwrap: Sequence[str] = ()
    time_unit: str | None = None
    dt: float | None = None
    sep: str | None = None
    decimal: str | None = None
    comment: str | None = None
    encoding: str | None = None
    duplicates: str = "error"
    sort: bool = False
    delay: float | Mapping[str, float] = 0.0
    resample: float | None = None

    def __post_init__(self) -> None:
        """Each option on its own."""
        for option in ("time", "sep", "decimal", "comment", "encoding"):
            value = getattr(self, option)
            if value is not None:
                check_kind(option, value, str, "a text")
                if not value:
                    raise LogError(f"{option}: expected a text, found an empty one")
        check_texts("unwrap", self.unwrap)
        object.__setattr__(self, "missing", checked_missing(self.missing))
        choice("duplicates", self.duplicates, DUPLICATES)
        check_flag("sort", self.sort)
        if self.time_unit is not None:
            checked_unit("time_unit", self.time_unit)
        if self.start is not None and not is_real(self.start) and not isinstance(self.start, str):
            raise LogError(f"start: expected a time in seconds, found {shown(self.start)}")
        if self.dt is not None and not (is_real(self.dt) and 0 < self.dt <= LARGEST):
            raise LogError(f"dt: expected a positive number of seconds, found {shown(self.dt)}")
        if self.resample is not None and not (
            is_real(self.resample) and 0 < self.resample <= LARGEST
        ):
            raise LogError(
                f"resample: expected a positive number of seconds, found {shown(self.resample)}"
            )
        if self.dt is not None and (self.time is not None or self.time_unit is not None):
            raise LogError("dt: expected without time or time_unit, found both")
        whole = isinstance(self.decimate, int | np.integer)
        if not whole or isinstance(self.decimate, bool) or not 1 <= self.decimate <= MOST:
            raise LogError(
                f"decimate: expected a whole number of at least 1, found {shown(self.decimate)}"
            )


def is_real(value: Any) -> bool:
    """Whether a value is a real number; True is none."""
    number = isinstance(value, int | float | np.integer | np.floating)
    if not number or isinstance(value, bool):
        return False
    return isinstance(value, float) or abs(value) <= LARGEST


def check_texts(option: str, group: Any) -> None:
    """LogError unless the group is a list of column names."""
    if not isinstance(group, list | tuple) or not all(isinstance(name, str) for name in group):
        raise LogError(f"{option}: expected a list of column names, found {shown(group)}")


def checked_missing(missing: Any) -> tuple[float | str, ...]:
    """Numbers and words that stand for "not measured"; LogError for anything else."""
    found: Sequence[Any] = missing if isinstance(missing, list | tuple) else [missing]
    for one in found:
        word = isinstance(one, str) and one.strip() != ""
        if not word and (not is_real(one) or not -LARGEST <= one <= LARGEST):
            raise LogError(f"missing: expected finite numbers or words, found {shown(one)}")
    return tuple(one.strip() if isinstance(one, str) else float(one) for one in found)
