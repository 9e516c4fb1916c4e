"""Tables of a spec, checked key by key: one error that names the place, what was expected and what
came, with the nearest known key."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from ddmhe._core import DdmheError
from ddmhe.campaign.errors import CampaignError
from ddmhe.checks import check_flag, check_number, check_whole, choice, shown

__all__ = [
    "REQUIRED",
    "Key",
    "amount",
    "amount_from_0",
    "check_name",
    "check_tables",
    "check_whole_from",
    "flag",
    "one_of",
    "positive",
    "share",
    "size",
    "span",
    "span_above_0",
    "span_from_0",
    "table",
    "text",
    "texts",
]

REQUIRED = object()
"""The default of a key that has none."""
Check = Callable[[str, Any], Any]


@dataclass(frozen=True)
class Key:
    """A key of a table: its check, which returns the value as it is kept, and its default."""

    check: Check
    default: Any = REQUIRED


def table(where: str, given: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
    """The values of all keys, those that are not given at their defaults."""
    if not isinstance(given, Mapping):
        raise CampaignError(f"{where}: expected a table, found {shown(given)}")
    for name in given:
        check_name(where, name, keys)
    values = {}
    for name, key in keys.items():
        place = f"{where}.{name}" if where else name
        if name in given and given[name] != key.default:
            values[name] = key.check(place, given[name])
        elif key.default is REQUIRED:
            raise CampaignError(f"{place}: expected a value, found none")
        else:
            values[name] = key.default
    return values


def check_name(where: str, name: Any, known: Iterable[str]) -> None:
    """CampaignError with the nearest known name unless this is one."""
    names = list(known)
    if name in names:
        return
    near = get_close_matches(str(name), names, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    place = f"{where}: expected" if where else "spec: expected"
    raise CampaignError(f"{place} one of the keys {', '.join(names)}, found {shown(name)}{hint}")


def check_tables(where: str, given: Any) -> dict[str, Any]:
    """Tables by their names, one at least; a name is part of paths."""
    if not isinstance(given, Mapping) or not given:
        raise CampaignError(f"{where}: expected one table at least, by its name, found "
                            f"{shown(given)}")  # fmt: skip
    for name in given:
        if not isinstance(name, str) or not name.replace("-", "").replace("_", "").isalnum():
            raise CampaignError(
                f"{where}: expected names of letters, digits, - and _, found {shown(name)}"
            )
    return dict(given)


def positive(name: str, value: Any) -> float:
    """A positive number."""
    check_number(name, value, "a positive number", lambda v: v > 0)
    return float(value)


def share(name: str, value: Any) -> float:
    """A number from 0 to 1."""
    check_number(name, value, "a number from 0 to 1", lambda v: 0 <= v <= 1)
    return float(value)


def amount(name: str, value: Any) -> float:
    """Any finite number."""
    check_number(name, value, "a finite number", lambda v: True)
    return float(value)


def size(name: str, value: Any) -> float | list[float]:
    """A number of at least 0, or one a channel."""
    for one in value if isinstance(value, list | tuple) and value else [value]:
        check_number(name, one, "numbers of at least 0", lambda v: v >= 0)
    return [float(v) for v in value] if isinstance(value, list | tuple) else float(value)


def span(name: str, value: Any) -> list[float]:
    """Two numbers, the first not above the second."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise CampaignError(f"{name}: expected [least, most], found {shown(value)}")
    for one in value:
        check_number(name, one, "two finite numbers", lambda v: True)
    if value[0] > value[1]:
        raise CampaignError(f"{name}: expected [least, most], found {shown(value)}")
    return [float(v) for v in value]


def span_from_0(name: str, value: Any) -> list[float]:
    """Two numbers of at least 0, the first not above the second."""
    found = span(name, value)
    check_number(name, found[0], "two numbers of at least 0", lambda v: v >= 0)
    return found


def span_above_0(name: str, value: Any) -> list[float]:
    """Two positive numbers, the first not above the second."""
    found = span(name, value)
    check_number(name, found[0], "two numbers above 0", lambda v: v > 0)
    return found


def amount_from_0(name: str, value: Any) -> float:
    """A finite number of at least 0."""
    check_number(name, value, "a number of at least 0", lambda v: v >= 0)
    return float(value)


def check_whole_from(least: int) -> Check:
    """A whole number of at least so much."""

    def check(name: str, value: Any) -> int:
        whole = int(value) if isinstance(value, float) and value.is_integer() else value
        check_whole(name, whole, least)
        return int(whole)

    return check


def flag(name: str, value: Any) -> bool:
    """True or False."""
    check_flag(name, value)
    return bool(value)


def text(name: str, value: Any) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value:
        raise CampaignError(f"{name}: expected a text, found {shown(value)}")
    return value


def texts(name: str, value: Any) -> list[str]:
    """Texts, one at least."""
    if not isinstance(value, list | tuple) or not value:
        raise CampaignError(f"{name}: expected a list of texts, found {shown(value)}")
    return [text(name, one) for one in value]


def one_of(*known: str) -> Check:
    """One of these texts."""
    return lambda name, value: str(choice(name, value, known))


def plain(value: Any) -> Any:
    """A value of a spec in values of JSON; DdmheError for others."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise DdmheError(f"spec: expected texts, numbers, lists and tables, found {shown(value)}")
