"""Texts that are tables in their own way, as plain rows below a header: ARFF, HTML, tables drawn
with lines, aligned columns whose names have blanks, sentences with checksums, names beside values.
Lines keep their numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import reduce
from operator import xor

from ddmhe.recordings.cells import is_number
from ddmhe.recordings.html_lines import html_lines
from ddmhe.recordings.pair_lines import pair_lines
from ddmhe.recordings.text import Lines, line_of

__all__ = ["plain_lines"]

_ATTRIBUTE = re.compile(r"@attribute\s+(?:'([^']*)'|\"([^\"]*)\"|(\S+))\s", re.IGNORECASE)
_SENTENCE = re.compile(r"\s*(\$[^$*]+)\*([0-9A-Fa-f]{2})\s*\Z")
_RECEIVED = re.compile(
    r"""\s*(?:\[((?:\d{4}-\d\d-\d\d[T ])?\d\d:\d\d:\d\d(?:[.,]\d{1,9})?)\]
    |((?:\d{4}-\d\d-\d\d[T ])?\d\d:\d\d:\d\d(?:[.,]\d{1,9})?)\s*->)\s*(\S.*)""",
    re.VERBOSE,
)
_WIDE_BLANK = re.compile(r" {2,}")
_RULE = re.compile(r"[\s|+:=-]*-{3}[\s|+:=-]*\Z|[\s+|=-]*={3}[\s+|=-]*\Z")
"""A line that is drawn below a header, or between rows."""
LOOKED_AT = 20
"""Lines in which such a one stands."""
_DRAWN = str.maketrans("│┃║─━═┼┬┴├┤┌┐└┘╇╈┏┓┗┛┡┩╪╬", "|||---" + 19 * "+")


def plain_lines(lines: Lines, asked: Sequence[str] = ()) -> tuple[Lines, list[str]]:
    """The lines, and what they were written in."""
    first = next((k for k, row in enumerate(lines.rows) if row.strip()), None)
    if first is None:
        return lines, []
    begin = lines.rows[first].lower().lstrip()
    if begin.startswith("@relation"):
        return _arff(lines)
    if begin.startswith(("<html", "<!doctype html", "<table", "<meta")):
        return html_lines(lines)
    for dialect in (_drawn, _sentences, pair_lines, _received):
        found = dialect(lines, first)
        if found is not None:
            return found
    return _aligned(lines, asked) or (lines, [])


def _arff(lines: Lines) -> tuple[Lines, list[str]]:
    """Names stand above the samples, one a line."""
    rows = list(lines.rows)
    data = next((k for k, row in enumerate(rows) if row.strip().lower() == "@data"), None)
    if data is None:
        return lines, []
    found = [match for row in rows[:data] if (match := _ATTRIBUTE.match(row.strip() + " "))]
    names = [next(name for name in match.groups() if name is not None) for match in found]
    rows[:data] = [""] * data
    rows[data] = line_of(names)
    return Lines(rows, lines.comments), ["ARFF"]


def _drawn(lines: Lines, first: int) -> tuple[Lines, list[str]] | None:
    """Bars between cells, perhaps at both ends of a row, and a rule below the header: Markdown, and
    what databases print; None for others."""
    top = [row.translate(_DRAWN) for row in lines.rows[: first + LOOKED_AT]]
    if not any(map(_RULE.match, top[first:])):
        return None
    rows = [row.translate(_DRAWN) for row in lines.rows]
    begin = first + 1 if _RULE.match(rows[first]) else first
    rule = next((k for k in range(begin + 1, len(rows)) if rows[k].strip()), begin)
    if "|" not in rows[begin] or not _RULE.match(rows[rule]):
        return None
    plain = [
        "" if _RULE.match(row) else row.strip().removeprefix("|").removesuffix("|")
        if row.lstrip().startswith("|")
        else row
        for row in rows
    ]  # fmt: skip
    kind = "Markdown" if begin == first and set(rows[rule]) <= set(" |:-") else "drawn lines"
    return Lines(plain, lines.comments), [f"a table of {kind}"]


def _sentences(lines: Lines, first: int) -> tuple[Lines, list[str]] | None:
    """Lines like $RIG,0.02,0.8*5A, whose end is the XOR of what is between "$" and "*"; those with
    another one are left out."""
    if _SENTENCE.match(lines.rows[first]) is None:
        return None
    matches = [_SENTENCE.match(row) for row in lines.rows]
    if any(match is None and row.strip() for match, row in zip(matches, lines.rows, strict=True)):
        return None
    rows = [
        match[1] if match is not None and _xor(match[1][1:]) == int(match[2], 16) else ""
        for match in matches
    ]
    wrong = sum(match is not None and not row for match, row in zip(matches, rows, strict=True))
    told = f", {wrong} lines with another one left out" if wrong else ""
    return Lines(rows, lines.comments), [f"checksums behind the lines{told}"]


def _received(lines: Lines, first: int) -> tuple[Lines, list[str]] | None:
    """Lines behind the time at which a terminal received them, "12:00:00.020 -> 0.8,0.2" or
    "[12:00:00.020] 0.8,0.2": that is put behind the cells, whose places it leaves."""
    if _RECEIVED.match(lines.rows[first]) is None:
        return None
    matches = [_RECEIVED.match(row) for row in lines.rows]
    if any(match is None and row.strip() for match, row in zip(matches, lines.rows, strict=True)):
        return None
    begin = matches[first]
    sep = next((one for one in ",;\t|" if begin is not None and one in begin[3]), " ")
    rows = []
    for match in matches:
        if match is None:
            rows.append("")
            continue
        cells = [cell.strip() for cell in match[3].split(None if sep == " " else sep)]
        last = match[1] or match[2] if any(map(is_number, cells)) else "received"
        rows.append(f'{match[3].strip()}{sep}"{last}"')
    return Lines(rows, lines.comments), ["times of receiving before the lines"]


def _xor(text: str) -> int:
    return reduce(xor, text.encode("utf-8", "replace"), 0)


def _aligned(lines: Lines, asked: Sequence[str]) -> tuple[Lines, list[str]] | None:
    """Columns parted by two blanks or more, of which some that are asked for have single blanks in
    their names; None where no line has these."""
    if not any(" " in name for name in asked):
        return None
    rows = [_WIDE_BLANK.split(row.strip()) for row in lines.rows]
    header = next((k for k, cells in enumerate(rows) if set(asked) <= set(cells)), None)
    if header is None or len(rows[header]) < 2 or "\t" in lines.rows[header]:
        return None
    width = len(rows[header])
    if any(len(cells) != width for cells in rows[header:] if cells != [""]):
        return None
    plain = [*lines.rows[:header], *("" if c == [""] else line_of(c) for c in rows[header:])]
    return Lines(plain, lines.comments), ["columns parted by two blanks or more"]
