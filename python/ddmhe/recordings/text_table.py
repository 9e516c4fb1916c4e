"""A text in any usual habit as a table: CSV and its kin, with what was inferred of them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ddmhe.checks import reason
from ddmhe.recordings.cells import is_number, says_nothing
from ddmhe.recordings.dialects import plain_lines
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.habits import NAMES, Habit, cells_of, decimal_of, habit_of, without_brackets
from ddmhe.recordings.plain_cells import with_plain_units, with_plain_vectors
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.table import Table
from ddmhe.recordings.text import MOST_BREAKS, Lines, decode, lines_of, without_tail
from ddmhe.recordings.time_units import is_time_name
from ddmhe.recordings.units import is_unit

__all__ = ["text_table"]

ABOVE = 8
"""Lines without a number that may stand between header and samples: units, types, long names."""
RULE = set("-=")
"""Characters of a line that is drawn below the names."""
BELOW = 3
"""Lines of text that may stand below the samples."""
MOST_STATISTICS, LOOKED_AT = 12, 50
"""Rows of statistics below the samples; rows before them that are looked at."""
_GUARD = re.compile(r'(^|[,;\t|])="(?=[^"]*"(?:[,;\t|]|$))')
"""Cells that a spreadsheet shall take as texts, ="0.80"."""
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
    lost = 0 if encoding is not None else len(data) - len(without_tail(data))
    lines, dialect = plain_lines(lines_of(text, comment), asked)
    if not any(row.strip() for row in lines.rows):
        raise LogError(f"{path}: expected a header line and samples, found an empty file")
    habit = habit_of(path, lines, sep, asked)
    notes = [] if found is None else [f"encoding {found}"]
    notes += [f"{lost} zeros behind the end left out"] if lost else []
    rows, cut = _rows(path, lines, habit, text.endswith(("\n", "\r")))
    table, more = _table(path, rows, habit)
    table, of_units = _below_header(table, asked)
    table = with_plain_vectors(_with_channels(table, asked), asked)
    first = [table.header[0]] if table.header.count(table.header[0]) == 1 else []
    table = with_plain_units(table, list(dict.fromkeys((*first, *asked))))
    texts = zip(table.header, table.columns, strict=True)
    every = [(name, cells) for name, cells in texts if not isinstance(cells, np.ndarray)]
    named = [(name, cells) for name, cells in every if name in asked or is_time_name(name)]
    plain = habit.sep == "," and '"' not in text and not dialect  # then no cell has a comma
    mark, grouped = decimal_of(path, [] if plain else named or every, decimal)
    if decimal is None and mark == ",":
        notes.append("decimal comma")
    above = _above(lines, habit)
    said = (*dialect, *_of_separator(habit), *notes, *above, *more, *of_units, *cut, *table.notes)
    alone = table.alone and dialect in ([], ["ARFF"])
    return replace(table, alone=alone, decimal=mark, grouped=grouped, notes=said, sep=habit.sep)


def _of_separator(habit: Habit) -> list[str]:
    plain = not habit.sniffed or habit.sep == ","
    return [] if plain else [f"separator {NAMES[habit.sep]}"]


def _above(lines: Lines, habit: Habit) -> list[str]:
    """What is said of lines that are no samples."""
    first = habit.begin if habit.header is None else habit.header
    before = sum(bool(row.strip()) for row in lines.rows[:first])
    comments = len(lines.comments) - habit.commented
    what = "samples" if habit.header is None else "header"
    notes = [f"{before} lines before the {what} left out"] if before else []
    notes += [f"header in the comment of line {first + 1}"] if habit.commented else []
    return notes + ([f"{comments} comment lines left out"] if comments else [])


def _rows(
    path: str, lines: Lines, habit: Habit, ended: bool
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """The header and the rows of cells, each with its line from 1, blank ones left out; a last line
    that is cut short, too."""
    first = habit.begin if habit.header is None else habit.header
    rows = lines.rows[first:]
    if habit.commented:
        rows = [lines.comments[first], *rows[1:]]
    rows = [without_brackets(rows[0]), *rows[1:]]
    first += lines.shift
    guarded = any(_GUARD.search(row) for row in rows[:LOOKED_AT])
    rows = [_GUARD.sub(r'\1"', row) for row in rows] if guarded else rows
    found: list[tuple[int, list[str]]] = []
    last = 0
    try:
        for number, cells in cells_of(rows, habit.sep):
            if number > last + 1 and not _is_note(rows[last:number], cells, found, habit.sep):
                raise LogError(
                    f"{path}, line {first + last + 1}: expected a quote that ends on its line, "
                    f"found one that goes on to line {first + number}"
                )
            start, last = last + 1, number
            if any(cells):
                found.append((first + start, cells))
    except csv.Error as e:
        raise LogError(
            f"{path}: expected a CSV table, found one that cannot be read ({reason(e)})"
        ) from e
    if not found:
        raise LogError(f"{path}: expected a header line and samples, found empty cells alone")
    return _trimmed(found, ended, habit.header is not None)


def _is_note(
    lines: Sequence[str], cells: list[str], found: list[tuple[int, list[str]]], sep: str
) -> bool:
    """Whether lines are one row whose quotes hold their ends: as wide as the rows before, with no
    row among them."""
    width = len(found[0][1]) if found else 0
    inner = [next(cells_of([line.replace('"', "")], sep), (0, []))[1] for line in lines[1:-1]]
    tail = next(cells_of([lines[-1].partition('"')[0]], sep), (0, []))[1]
    rows = any(len(row) >= width for row in (*inner, tail))
    return len(cells) == width and len(lines) <= MOST_BREAKS and not rows


def _trimmed(
    found: list[tuple[int, list[str]]], ended: bool, headed: bool
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """The rows without what is none: a last one that is cut short, words below the samples, the
    header once more."""
    header, width, notes = found[0][1], len(found[0][1]), []
    if not ended and len(found) > 2 and len(found[-1][1]) < width == len(found[-2][1]):
        notes.append(f"line {found.pop()[0]}, the last, is cut short and left out")
    below = _below(found, width)
    if below:
        notes.append(f"{below} lines below the samples left out")
        del found[-below:]
    again = [line for line, cells in found[1:] if headed and cells == header]
    if again:
        notes.append(f"header repeated in line {', '.join(map(str, again))}")
        found = [found[0], *(row for row in found[1:] if row[1] != header)]
    return found, notes


def _below(found: list[tuple[int, list[str]]], width: int) -> int:
    """How many rows at the end are none: words alone, or a word in the place of the number or the
    time that all rows before begin with, as statistics have it."""
    last = len(found)
    while last > 2 and len(found) - last < BELOW and _is_remark(found[last - 1][1], width):
        last -= 1
    named = last
    while named > 2 and last - named < MOST_STATISTICS and _is_word(found[named - 1][1][0]):
        named -= 1
    begun = [cells[0].strip() for _, cells in found[max(1, named - LOOKED_AT) : named]]
    counted = len(begun) > 2 and all(is_number(cell) or is_stamp(cell) for cell in begun)
    if named < last and counted:
        last = named
        while last > 2 and len(found) - last < BELOW and _is_remark(found[last - 1][1], width):
            last -= 1
    return len(found) - last


def _is_word(cell: str) -> bool:
    text = cell.strip()
    plain = is_number(text) or is_stamp(text) or says_nothing(text)
    return not plain and re.match(r"[^\W\d_]", text) is not None


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
    if _row_names(header, rows):
        header, width = ["", *header], width + 1
        notes.append("the first column, which has no name, numbers the rows")
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


def _row_names(header: list[str], rows: list[tuple[int, list[str]]]) -> bool:
    """Whether each row has one cell more than the header, the first of which counts the rows, as R
    writes their names: what is called a time is a clock then, and else it would be a counter."""
    if not is_time_name(header[0]) or any(len(cells) != len(header) + 1 for _, cells in rows):
        return False
    numbers = [cells[0].strip() for _, cells in rows]
    counted = any(numbers == [str(k + one) for k in range(len(rows))] for one in (0, 1))
    clock = [cells[1].strip() for _, cells in rows]
    return counted and not all(cell.lstrip("+-").isdigit() for cell in clock)


def _padded(cells: list[str], width: int) -> list[str]:
    short = width - len(cells)
    return cells if short == 0 else [*cells, *[""] * short][:width]


def _below_header(table: Table, asked: Sequence[str]) -> tuple[Table, list[str]]:
    """Without the lines of words that stand between header and samples; units are what one of them
    states. Where all columns asked for have words, numbers beside them make no sample."""
    words = []
    places = [k for name in asked if (k := table.index(name)) is not None]
    for k in range(min(ABOVE, len(table) - 1)):
        cells = [str(column[k]).strip() for column in table.columns]
        of_asked = [cells[k] for k in {0, *places}] if len(places) == len(asked) else cells
        told = all(c and not says_nothing(c) for c in of_asked)
        if any(is_number(c) or is_stamp(c) for c in (of_asked if told else cells)):
            break
        if all(map(says_nothing, cells)) and not all(len(c) > 1 and set(c) <= RULE for c in cells):
            break
        if any("," in c and not c[0].isalpha() for c in cells):
            break  # a number in a habit that is not known yet
        words.append(cells)
    if not words or not _is_sample(table, len(words)):
        return table, []
    stating = [k for k, cells in enumerate(words) if any(map(is_unit, cells))]
    bracketed = any(name.rstrip().endswith(("]", ")")) for name in table.header)
    if len(words) == 1 and not bracketed and not {c.lower() for c in words[0] if c} <= TYPES:
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
    header = _with_index_name(table.header, words)
    return replace(rows, header=header, units=units if header == table.header else {}), notes


def _with_channels(table: Table, asked: Sequence[str]) -> Table:
    """The table of a text with a line a channel, whose first cell is its name; as it is where the
    names asked for do not begin the lines."""
    names = [table.header[0], *map(str, table.columns[0])]
    if any(table.index(n) is not None for n in asked) or any(names.count(n) != 1 for n in asked):
        return table
    rows = [table.header[1:], *zip(*table.columns[1:], strict=True)]
    cells = [[str(cell).strip() for cell in row] for row in rows]
    if not all(is_number(c) or is_stamp(c) or says_nothing(c) for row in cells for c in row):
        return table
    places = np.arange(2, len(cells[0]) + 2)
    return replace(
        table.noted("a line a channel"), header=names, columns=cells, places=places,
        place="column", units={}, alone=False,
    )  # fmt: skip


def _with_index_name(header: Sequence[str], words: list[list[str]]) -> Sequence[str]:
    """The header with the first column's name from a line of its own, as pandas writes it below
    several lines of names."""
    for cells in words:
        if is_time_name(cells[0]) and not is_time_name(header[0]) and not any(cells[1:]):
            return [cells[0], *header[1:]]
    return header


def _is_sample(table: Table, k: int) -> bool:
    return any(is_number(column[k]) for column in table.columns)
