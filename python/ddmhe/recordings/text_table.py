"""A text in any usual habit as a table: CSV and its kin, with what was inferred of them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ddmhe.checks import reason
from ddmhe.recordings.cells import says_nothing
from ddmhe.recordings.dialects import plain_lines
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.habits import NAMES, Habit, cells_of, decimal_of, habit_of, is_number
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.table import Table
from ddmhe.recordings.text import Lines, decode, lines_of
from ddmhe.recordings.time_units import is_time_name
from ddmhe.recordings.units import is_unit

__all__ = ["text_table"]

ABOVE = 3
"""Lines without a number that may stand between header and samples: units, types, long names."""
BELOW = 3
"""Lines of text that may stand below the samples."""
TYPES = frozenset(
    """float double int integer single real number numeric string str bool""".split()  # noqa: SIM905
)


def text_table(
    path: str,
    data: bytes,
    asked: Sequence[str],
    *,
    sep: str | None = None,
    decimal: str | None = None,
    comment: str | None = None,
    encoding: str | None = None,
) -> Table:
    """The table of a text file in which the columns `asked` are looked for; LogError in one
    sentence for what is none."""
    text, found = decode(path, data, encoding)
    lines, dialect = plain_lines(lines_of(text, comment))
    if not any(row.strip() for row in lines.rows):
        raise LogError(f"{path}: expected a header line and samples, found an empty file")
    habit = habit_of(path, lines, sep, asked)
    notes = [] if found is None else [f"encoding {found}"]
    rows, cut = _rows(path, lines, habit, text.endswith(("\n", "\r")))
    table, more = _table(path, rows, habit)
    table, of_units = _below_header(table)
    texts = zip(table.header, table.columns, strict=True)
    every = [(name, cells) for name, cells in texts if not isinstance(cells, np.ndarray)]
    named = [(name, cells) for name, cells in every if name in asked or is_time_name(name)]
    plain = habit.sep == "," and '"' not in text  # then no cell has a comma
    mark, grouped = decimal_of(path, [] if plain else named or every, decimal)
    if decimal is None and mark == ",":
        notes.append("decimal comma")
    above = _above(lines, habit)
    said = (*dialect, *_of_separator(habit), *notes, *above, *more, *of_units, *cut)
    return replace(table, decimal=mark, grouped=grouped, notes=said, sep=habit.sep)


def _of_separator(habit: Habit) -> list[str]:
    plain = not habit.sniffed or habit.sep == ","
    return [] if plain else [f"separator {NAMES[habit.sep]}"]


def _above(lines: Lines, habit: Habit) -> list[str]:
    """What is said of lines that are no samples."""
    first = -1 if habit.header is None else habit.header
    before = sum(bool(row.strip()) for row in lines.rows[: max(first, 0)])
    comments = len(lines.comments) - habit.commented
    notes = [f"{before} lines before the header left out"] if before else []
    notes += [f"header in the comment of line {first + 1}"] if habit.commented else []
    return notes + ([f"{comments} comment lines left out"] if comments else [])


def _rows(
    path: str, lines: Lines, habit: Habit, ended: bool
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """The header and the rows of cells, each with its line from 1, blank ones left out; a last line
    that is cut short, too."""
    first = habit.header or 0
    rows = lines.rows[first:]
    if habit.commented:
        rows = [lines.comments[first], *rows[1:]]
    found: list[tuple[int, list[str]]] = []
    last = 0
    try:
        for number, cells in cells_of(rows, habit.sep):
            if number > last + 1:
                raise LogError(
                    f"{path}, line {first + last + 1}: expected a quote that ends on its line, "
                    f"found one that goes on to line {first + number}"
                )
            last = number
            if any(cells):
                found.append((first + number, cells))
    except csv.Error as e:
        raise LogError(
            f"{path}: expected a CSV table, found one that cannot be read ({reason(e)})"
        ) from e
    if not found:
        raise LogError(f"{path}: expected a header line and samples, found empty cells alone")
    return _trimmed(found, ended, habit.header is not None)


def _trimmed(
    found: list[tuple[int, list[str]]], ended: bool, headed: bool
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """The rows without what is none: a last one that is cut short, words below the samples, the
    header once more."""
    header, width, notes = found[0][1], len(found[0][1]), []
    if not ended and len(found) > 2 and len(found[-1][1]) < width == len(found[-2][1]):
        notes.append(f"line {found.pop()[0]}, the last, is cut short and left out")
    below = 0
    while below < BELOW and len(found) > 2 and _is_remark(found[-1][1], width):
        found.pop()
        below += 1
    notes += [f"{below} lines below the samples left out"] if below else []
    again = [line for line, cells in found[1:] if headed and cells == header]
    if again:
        notes.append(f"header repeated in line {', '.join(map(str, again))}")
        found = [found[0], *(row for row in found[1:] if row[1] != header)]
    return found, notes


def _is_remark(cells: list[str], width: int) -> bool:
    """Whether a row is one text, and no sample."""
    text = cells[0].strip()
    alone = width > 1 and text != "" and not any(cells[1:])
    return alone and not is_number(text) and not is_stamp(text) and not says_nothing(text)


def _table(path: str, rows: list[tuple[int, list[str]]], habit: Habit) -> tuple[Table, list[str]]:
    """Header and columns; each row as wide as the header."""
    notes = []
    if habit.header is None:
        header = [str(k + 1) for k in range(len(rows[0][1]))]
        notes.append("no header line, columns are called 1, 2, …")
    else:
        header, rows = [name.strip() for name in rows[0][1]], rows[1:]
    if not rows:
        raise LogError(f"{path}: expected samples after the header line, found none")
    width = len(header)
    while width > 1 and not header[width - 1] and not any(any(c[width - 1 :]) for _, c in rows):
        width -= 1  # a separator at the end of each line
    header = header[:width]
    for line, cells in rows:
        if len(cells) > width and any(cells[width:]):
            hint = f"; a cell with {NAMES[habit.sep]} in it needs quotes"
            if habit.sep == "," and len(cells) in (2 * width, 2 * width - 1):
                hint = "; where a comma is decimal mark and separator, write the file with ';'"
            raise LogError(
                f"{path}, line {line}: expected {width} cells as in the header, found "
                f"{len(cells)}{hint}"
            )
    columns = list(zip(*(_padded(cells, width) for _, cells in rows), strict=True))
    places = np.array([line for line, _ in rows], dtype=np.int64)
    return Table(path, header, columns, places), notes


def _padded(cells: list[str], width: int) -> list[str]:
    short = width - len(cells)
    return cells if short == 0 else [*cells, *[""] * short][:width]


def _below_header(table: Table) -> tuple[Table, list[str]]:
    """Without the lines of words that stand between header and samples; units are what one of them
    states."""
    words = []
    for k in range(min(ABOVE, len(table) - 1)):
        cells = [str(column[k]).strip() for column in table.columns]
        if any(is_number(c) or is_stamp(c) for c in cells) or all(map(says_nothing, cells)):
            break
        if any(c.count(",") for c in cells):
            break  # a number in a habit that is not known yet
        words.append(cells)
    if not words or not _is_sample(table, len(words)):
        return table, []
    stating = [k for k, cells in enumerate(words) if any(map(is_unit, cells))]
    if len(words) == 1 and not {c.lower() for c in words[0] if c} <= TYPES:
        stating = [0]
    units: dict[str, str] = {}
    notes = []
    for k, cells in enumerate(words):
        kind = "units in" if k in stating[:1] else "words left out in"
        notes.append(f"{kind} line {table.places[k]}")
        if k in stating[:1]:
            stated = zip(table.header, (c.strip("[]() ") for c in cells), strict=True)
            units = {name: c for name, c in stated if c and (c == "-" or not says_nothing(c))}
    rows = table.rows(np.arange(len(words), len(table)))
    return replace(rows, units=units), notes


def _is_sample(table: Table, k: int) -> bool:
    return any(is_number(column[k]) for column in table.columns)
