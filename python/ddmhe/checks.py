"""Arguments, checked: one error each that names the argument, what was expected and what came."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Callable, Iterable, Sequence
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, NotFiniteError, ShapeError, numbers

Array = NDArray[np.float64]
T = TypeVar("T")

__all__ = [
    "array",
    "channels",
    "check_finite",
    "check_flag",
    "check_history",
    "check_kind",
    "check_number",
    "check_path",
    "check_whole",
    "choice",
    "did_you_mean",
    "file_words",
    "listed",
    "one_line",
    "reason",
    "shown",
    "times",
    "word",
]

LONGEST = 60
"""Characters of what was given that a message shows."""
LONGEST_REASON = 300
"""Characters of another library's message, or of a path, that a message shows."""
MOST_LISTED = 40
"""Names of a file that a message lists."""
MOST = 2**63 - 1
"""Largest whole number that arrays can be indexed with."""


def array(name: str, value: ArrayLike, shape: tuple[int, ...], *, missing: bool = False) -> Array:
    """Real numbers as a float64 array of the shape, -1 for any length; a copy.

    Masked entries, None and pandas.NA are NaN where they may be `missing`, else NotFiniteError; NaN
    and infinity pass."""
    found = numbers(name, value, missing)
    fits = found.ndim == len(shape) and all(
        s in (-1, length) for s, length in zip(shape, found.shape, strict=True)
    )
    if not fits:
        wanted = f"shape {_words(shape)}" if shape else "a single number"
        came = found.shape or "a single number"
        raise ShapeError(f"{name}: expected {wanted}, found {came}")
    return found


def _words(shape: tuple[int, ...]) -> str:
    lengths = ", ".join("any" if s < 0 else str(s) for s in shape)
    return f"({lengths},)" if len(shape) == 1 else f"({lengths})"


def channels(value: ArrayLike, count: int) -> ArrayLike:
    """Samples of one channel (N,) as a column (N, 1); anything else as it is."""
    if count != 1 or value is None:
        return value
    found = value if hasattr(value, "ndim") else np.asarray(value, dtype=object)
    return np.reshape(found, (-1, 1)) if found.ndim == 1 else value


def check_finite(name: str, M: Array) -> None:
    """NotFiniteError naming the argument and the place."""
    known = np.isfinite(M)
    if not known.all():
        place = ", ".join(map(str, np.argwhere(~known)[0]))
        raise NotFiniteError(f"{name}: expected finite numbers, found {M[~known][0]} at ({place})")


def check_number(name: str, value: Any, expected: str, fits: Callable[[float], bool]) -> None:
    """DdmheError naming the argument unless the value is a finite real number that fits; True and
    False are none."""
    if not math.isfinite(_real(value)) or not fits(_real(value)):
        raise DdmheError(f"{name}: expected {expected}, found {shown(value)}")


def _real(value: Any) -> float:
    """A real number as a float; NaN for what is none."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def check_whole(
    name: str, value: Any, least: int = 1, most: int = MOST, expected: str = ""
) -> None:
    """DdmheError naming the argument unless the value is a whole number from `least` to `most`;
    True is none.

    expected : how the expectation reads, where more can be said than these numbers
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or not least <= value <= most:
        limit = f"a whole number of at least {least}" + (f", at most {most}" if most < MOST else "")
        raise DdmheError(f"{name}: expected {expected or limit}, found {shown(value)}")


def check_flag(name: str, value: Any) -> None:
    """DdmheError naming the argument unless the value is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise DdmheError(f"{name}: expected True or False, found {shown(value)}")


def check_path(name: str, value: Any) -> None:
    """DdmheError naming the argument unless the value is a text or a path; a number would be an
    open file."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise DdmheError(f"{name}: expected the path of a file, found {shown(value)}")


def check_history(value: Any) -> History:
    """The recording; DdmheError for anything else."""
    return check_kind("history", value, History, "a History")


def check_kind(name: str, value: Any, kind: type[T], words: str) -> T:
    """The value, an object of the class; DdmheError naming the argument for any other."""
    if not isinstance(value, kind):
        raise DdmheError(f"{name}: expected {words}, found {shown(value)}")
    return value


def choice(name: str, value: Any, known: Any) -> Any:
    """The value, one of the texts that are known; DdmheError naming the argument for any other."""
    if not isinstance(value, str) or value not in known:
        raise DdmheError(
            f"{name}: expected one of {', '.join(map(str, known))}, found {shown(value)}"
        )
    return value


def shown(value: Any) -> str:
    """What was given, short and in one line."""
    try:
        text = repr(value) if type(value) is str else reason(repr(value), None)
    except Exception:  # a whole number of more than 4300 digits, or whatever a class may do
        return f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}… (a {type(value).__name__})"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The known name that was most likely meant, as the end of a message: but for capitals the
    same, the same before a unit in brackets, or the closest."""
    names = list(known)
    folded = [one for one in names if one.casefold() == name.casefold()]
    bare = [one for one in names if one.split("[")[0].split("(")[0].strip() == name]
    near = (folded or bare or difflib.get_close_matches(name, names, n=1))[:1]
    return f"; did you mean {shown(near[0])}?" if near else ""


def word(text: str) -> str:
    """A name from a file as it stands there; as `shown` where it is long or not of one line."""
    return text if text.isprintable() and len(text) <= LONGEST else shown(text)


def listed(names: Sequence[str]) -> str:
    """Names from a file, separated by commas; of many the first ones."""
    more = len(names) - MOST_LISTED
    return ", ".join(map(word, names[:MOST_LISTED])) + (f" and {more} more" if more > 0 else "")


def file_words(path: str | os.PathLike[str]) -> str:
    """A path in one line; of a long one the end, which says most."""
    text = one_line(str(path))
    return text if len(text) <= LONGEST_REASON else f"…{text[-LONGEST_REASON:]}"


def reason(said: object, longest: int | None = LONGEST_REASON) -> str:
    """What another library said, in one line."""
    text = one_line(" ".join(str(said).split()))
    return text if longest is None or len(text) <= longest else f"{text[:longest]}…"


def one_line(text: str) -> str:
    """The text with escapes for what a terminal would obey or could not show."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def times(ratio: float, whose: str) -> str:
    """How often something is as large as another, in words; what is the same is said so."""
    rounded = f"{ratio:.2g}"
    return f"as much as {whose}" if rounded == "1" else f"{rounded} times {whose}"
