"""Bytes to lines of text: which encoding, which lines are comments."""

from __future__ import annotations

import codecs
import csv
import io
import re
from typing import NamedTuple

from ddmhe.checks import shown
from ddmhe.recordings.errors import LogError

__all__ = ["MOST_BREAKS", "Lines", "decode", "line_of", "lines_of", "without_tail"]

BOMS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
"""Longer ones first: a mark of UTF-32 begins as one of UTF-16."""
WIDE_BOMS = tuple(mark for mark, name in BOMS if name != "utf-8")
COMMENTS = ("#", "%", "//")
"""What a line of a comment begins with, unless another mark is named."""
FIRST = 200
"""Lines that may be above the samples."""
MOST_BREAKS = 10
"""Lines over which a quote may go on there."""
MOST_ZEROS = 3
"""Zeros that a last character of UTF-16 or UTF-32 may end with."""
_QUOTED = re.compile('"#[A-Za-z]')
"""A comment in the quotes of a cell; "#" alone is a name for row numbers."""
CONTROL = re.compile("[\0-\x08\x0e-\x1b]")
"""Characters that no text has."""


class Lines(NamedTuple):
    """The lines of a text, without their ends."""

    rows: list[str]
    """All lines, "" where one is a comment."""
    comments: dict[int, str]
    """Comments by their place in `rows`, without their mark."""
    shift: int = 0
    """What places in `rows` are ahead of the file's own, if a header was put before them: -1."""


def line_of(cells: list[str]) -> str:
    """Cells as one line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()


def decode(path: str, data: bytes, encoding: str | None) -> tuple[str, str | None]:
    """The text, and its encoding where that is neither stated nor UTF-8; LogError for what is no
    text."""
    if encoding is not None:
        return _stated(path, data, encoding), None
    data = without_tail(data)
    for mark, name in BOMS:
        if data.startswith(mark):
            text = _strict(path, data[len(mark) :], name).rstrip("\0")
            return text, None if name == "utf-8" else name.upper()
    wide = _wide(data[:4000])
    if wide is not None:
        return _strict(path, data, wide).rstrip("\0"), wide.upper()
    try:
        text, found = data.decode("utf-8"), None
    except UnicodeDecodeError:
        try:
            text, found = data.decode("cp1252"), "Windows-1252"
        except UnicodeDecodeError:
            text, found = data.decode("latin-1"), "Latin-1"
    if "\0" in text or (found is not None and CONTROL.search(text[:100_000])):
        raise LogError(
            f"{path}: expected a text file in UTF-8 or a known binary format, found bytes that are "
            "neither; --encoding names another encoding"
        )
    return text, found


def without_tail(data: bytes) -> bytes:
    """The bytes without the zeros at the end of a file whose writer reserved more room than it
    filled; two of them or fewer may be half of a wide character."""
    bare = data.rstrip(b"\0")
    if len(data) - len(bare) <= MOST_ZEROS:
        return data
    wide = data.startswith(WIDE_BOMS) or _wide(data[:4000]) is not None
    return data[: 4 * -(-len(bare) // 4)] if wide else bare


def _stated(path: str, data: bytes, encoding: str) -> str:
    try:
        text = data.decode(encoding)
    except LookupError:
        raise LogError(
            f"encoding: expected one like utf-8, latin-1 or utf-16, found {shown(encoding)}"
        ) from None
    except UnicodeError as e:
        raise LogError(
            f"{path}: expected a text in {encoding}, as --encoding says, found bytes that are not"
        ) from e
    return text.removeprefix("\ufeff")


def _strict(path: str, data: bytes, encoding: str) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as e:
        raise LogError(
            f"{path}: expected a text file in {encoding.upper()}, as its first bytes say, found "
            "bytes that are not; --encoding names another, like UTF-8"
        ) from e


def _wide(head: bytes) -> str | None:
    """UTF-16 without a mark: every other byte of ASCII text is zero."""
    size = len(head) // 2
    low, high = head[0::2].count(0), head[1::2].count(0)
    if size and high > 0.8 * size and low < 0.1 * size:
        return "utf-16-le"
    if size and low > 0.8 * size and high < 0.1 * size:
        return "utf-16-be"
    return None


def _rows(text: str) -> list[str]:
    """The lines; one at the beginning whose quotes go on over the next ones holds these, too, and
    leaves them blank."""
    rows = text.split("\n")
    for k in range(min(FIRST, len(rows))):
        if rows[k].count('"') % 2 == 0:
            continue
        ends = (j for j in range(k + 1, min(k + MOST_BREAKS, len(rows))) if rows[j].count('"') % 2)
        last = next(ends, k)
        rows[k : last + 1] = ["\n".join(rows[k : last + 1]), *[""] * (last - k)]
    return rows


def lines_of(text: str, comment: str | None) -> Lines:
    """Lines, those of comments blanked; a mark that is named ends a line anywhere."""
    text = re.sub("\r+\n", "\n", text).replace("\n\ufeff", "\n")  # of files one behind the other
    rows = _rows(text if "\n" in text else text.replace("\r", "\n"))
    marks = COMMENTS if comment is None else (comment,)
    comments = {}
    for k, row in enumerate(rows):
        bare = row.lstrip(" ")  # a tab is an empty cell
        mark = next((mark for mark in marks if bare.startswith(mark)), None)
        if mark is None and comment is None and _QUOTED.match(bare):
            mark = '"#'
        if mark is not None:
            comments[k] = bare.lstrip(mark).strip()
            rows[k] = ""
        elif comment is not None and comment in row:
            rows[k] = row.partition(comment)[0]
    return Lines(rows, comments)
