"""In which habit a text table is written: its separator, its header line, its decimal mark.

A header is where the columns that are asked for stand as cells of one line. Where no line has
them, the habit is the one that leaves the most numbers, so that a message can name the columns."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ddmhe.checks import shown
from ddmhe.recordings.cells import is_number
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.text import Lines

__all__ = ["Habit", "cells_of", "decimal_of", "habit_of", "without_brackets"]

SEPARATORS = (",", ";", "\t", "|", " ")
NAMES = {",": "','", ";": "';'", "\t": "tab", "|": "'|'", " ": "spaces"}
FIRST = 200
"""Lines among which a header is looked for."""
BODY = 50
"""Lines by whose cells a separator is judged."""
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(?:([.,])\d{3})(?:\1\d{3})*\Z")
"""A whole number in groups of three digits, which is a fraction in another habit."""
_BOTH = re.compile(r"[+-]?\d.*(,.*\.|\..*,)")


class Habit(NamedTuple):
    """How a text table is written."""

    sep: str
    """One character; a blank stands for any run of blanks and tabs."""
    header: int | None
    """Index of the header's line; None for a table without one."""
    commented: bool = False
    """Whether the header stands in a comment."""
    sniffed: bool = False
    """Whether the separator was not named."""
    begin: int = 0
    """Index of the first line of a table without a header."""


def cells_of(rows: Iterable[str], sep: str) -> Iterator[tuple[int, list[str]]]:
    """The rows of cells, each with the number of its last line counted from 1; blank ones too."""
    if sep == " ":
        rows = (row.replace("\t", " ").strip() for row in rows)
    reader = csv.reader((row + "\n" for row in rows), delimiter=sep, skipinitialspace=True)
    for row in reader:
        yield reader.line_num, row


def habit_of(path: str, lines: Lines, sep: str | None, asked: Sequence[str]) -> Habit:
    """The habit in which the columns asked for are found; LogError where there are two, or where
    the table is written in none."""
    if sep is not None:
        seps: tuple[str, ...] = (_stated(sep),)
    else:
        seps = SEPARATORS
    headers = {one: _header(lines, one, asked) for one in seps}
    found = {one: k for one, k in headers.items() if k is not None}
    if len(found) > 1:
        found.pop(" ", None)  # tabs count as blanks, and cells may begin with one
    if len(found) > 1:
        best = _by_numbers(lines, tuple(found))
        if best is None:
            words = " or ".join(NAMES[one] for one in found)
            raise LogError(f"{path}: the cells may be parted by {words}; --sep says which")
        found = {best: found[best]}
    for one, k in found.items():
        return Habit(one, k, k in lines.comments, sep is None)
    best = _by_numbers(lines, seps) or seps[0]
    begin, header = _first_of_its_width(lines, best)
    if header is not None and _by_place(_cells(lines.rows[header], best), asked):
        header = None
    return Habit(best, header, False, sep is None, begin)


def _by_place(cells: Sequence[str], asked: Sequence[str]) -> bool:
    """Whether columns are asked for by their places, from 1, and the first line has numbers
    there: then it is no header, whatever stands beside them."""
    places = [int(name) for name in asked if name.isascii() and name.isdigit()]
    if not places or len(places) < len(asked) or not 1 <= min(places) <= max(places) <= len(cells):
        return False
    return all(is_number(c) or is_stamp(c) for c in (cells[place - 1] for place in places))


def _stated(sep: str) -> str:
    words = {"tab": "\t", "\\t": "\t", "space": " ", "spaces": " ", "comma": ",", "semicolon": ";"}
    found = words.get(sep.lower(), sep)
    if len(found) != 1 or found in '"\n\r\0' or found.isalnum():
        raise LogError(
            f"sep: expected one character that parts cells, or tab or space, found {shown(sep)}"
        )
    return found


def _header(lines: Lines, sep: str, asked: Sequence[str]) -> int | None:
    """The last line above the samples that has all columns asked for as cells."""
    wanted, found = {re.sub(r"\[\d+\]\Z", "", name) for name in asked}, None
    exact = set(asked)
    for k, row in enumerate(lines.rows[:FIRST]):
        line = lines.comments.get(k, row)
        cells = _cells(line, sep)
        quoted = [cell for cell in cells if "," in cell and '"' in line and len(cells) > 1]
        parts = [part.strip() for cell in quoted for part in cell.split(",")]
        if exact <= {*cells, *parts} or wanted <= {*cells, *parts}:
            found = k
        elif found is not None and any(map(is_number, cells)) and k not in lines.comments:
            break
    return found


def without_brackets(line: str) -> str:
    """A line of quoted names without the brackets around all of them."""
    bare = line.strip()
    return bare[1:-1] if bare.startswith('("') and bare.endswith('")') else line


def _cells(line: str, sep: str) -> list[str]:
    line = without_brackets(line)
    try:
        return [cell.strip() for cell in next(cells_of([line], sep), (0, []))[1]]
    except csv.Error:
        return []


def _by_numbers(lines: Lines, seps: Sequence[str]) -> str | None:
    """The separator that leaves the most cells of the body numbers; None where two are alike."""
    body = [row for row in lines.rows[: 2 * FIRST] if row.strip()][-BODY:]

    def score(sep: str) -> float:
        rows = [_cells(line, sep) for line in body]
        width = Counter(map(len, rows)).most_common(1)
        cells = [cell for row in rows for cell in row if cell]
        if not width or width[0][0] < 2 or not cells:
            return 0.0
        regular = width[0][1] / len(rows)
        return regular * sum(map(is_number, cells)) / len(cells)

    if any("\t" in row.strip() for row in body):
        seps = [sep for sep in seps if sep != " " or len(seps) == 1]  # tabs count as blanks, too
    scores = sorted(((score(sep), sep) for sep in seps), key=lambda pair: -pair[0])
    if not scores[0][0] or (len(scores) > 1 and scores[0][0] - scores[1][0] < 0.01):
        return None
    return scores[0][1]


def _first_of_its_width(lines: Lines, sep: str) -> tuple[int, int | None]:
    """The line that opens the table, by how many cells it has, and its header: that line, or None
    if it holds numbers."""
    widths = [(k, _cells(row, sep)) for k, row in enumerate(lines.rows[:FIRST]) if row.strip()]
    if not widths:
        return 0, None
    usual = Counter(len(cells) for _, cells in widths).most_common(1)[0][0]
    at, cells = next((k, cells) for k, cells in widths if len(cells) == usual)
    commented = [k for k, line in lines.comments.items() if k < at]
    if all(is_number(cell) for cell in cells if cell):
        last = commented[-1] if commented else None
        fits = last is not None and len(_cells(lines.comments[last], sep)) == usual
        return at, last if fits else None
    return at, at


def decimal_of(
    path: str, named: Sequence[tuple[str, Sequence[str]]], stated: str | None
) -> tuple[str, bool]:
    """The decimal mark of columns (name, cells), and whether the other mark groups thousands.

    LogError where the cells can be read in two ways."""
    if stated is not None:
        words = {"comma": ",", "point": ".", "dot": "."}
        mark = words.get(stated.lower(), stated)
        if mark not in (",", "."):
            raise LogError(f"decimal: expected '.' or ',', found {shown(stated)}")
        return mark, True
    commas = [
        (name, cell)
        for name, cells in named
        for cell in cells
        if "," in cell
        and (is_number(cell.strip()) or _BOTH.match(cell.strip()))
        and not is_stamp(cell)
    ]
    if not commas:
        return ".", False
    point = _with_point(named)
    plain = not any("." in cell for _, cell in commas)
    if plain and point is None and any(not _GROUPS.match(cell.strip()) for _, cell in commas):
        return ",", False
    name, cell = commas[0]
    beside = "" if point is None else f" beside {shown(point[1])}"
    raise LogError(
        f"{path}, column {shown(name)}: {shown(cell)}{beside} can be read in two ways; --decimal "
        ", or --decimal . says which mark begins the fraction"
    )


def _with_point(named: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, str] | None:
    found = ((name, c) for name, cells in named for c in cells if "." in c and is_number(c.strip()))
    return next(found, None)
