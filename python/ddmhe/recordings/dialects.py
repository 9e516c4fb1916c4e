"""Texts that are tables in their own way, as plain rows below a header: ARFF, tables of Markdown.
Lines keep their numbers."""

from __future__ import annotations

import csv
import io
import re

from ddmhe.recordings.text import Lines

__all__ = ["plain_lines"]

_ATTRIBUTE = re.compile(r"@attribute\s+(?:'([^']*)'|\"([^\"]*)\"|(\S+))\s", re.IGNORECASE)
_RULE = re.compile(r"\|?\s*:?-{3,}:?\s*(\|\s*:?-{3,}:?\s*)*\|?\s*\Z")


def plain_lines(lines: Lines) -> tuple[Lines, list[str]]:
    """The lines, and what they were written in."""
    first = next((k for k, row in enumerate(lines.rows) if row.strip()), None)
    if first is None:
        return lines, []
    if lines.rows[first].lower().startswith("@relation"):
        return _arff(lines)
    below = lines.rows[first + 1] if first + 1 < len(lines.rows) else ""
    if "|" in lines.rows[first] and _RULE.match(below):
        return _markdown(lines, first + 1)
    return lines, []


def _arff(lines: Lines) -> tuple[Lines, list[str]]:
    """Names stand above the samples, one a line."""
    rows = list(lines.rows)
    data = next((k for k, row in enumerate(rows) if row.strip().lower() == "@data"), None)
    if data is None:
        return lines, []
    found = [match for row in rows[:data] if (match := _ATTRIBUTE.match(row.strip() + " "))]
    names = [next(name for name in match.groups() if name is not None) for match in found]
    header = io.StringIO()
    csv.writer(header, lineterminator="").writerow(names)
    rows[:data] = [""] * data
    rows[data] = header.getvalue()
    return Lines(rows, lines.comments), ["ARFF"]


def _markdown(lines: Lines, rule: int) -> tuple[Lines, list[str]]:
    """A bar at both ends of each row, a rule below the header."""
    rows = [
        row.strip()[1:].removesuffix("|") if row.lstrip().startswith("|") else row
        for row in lines.rows
    ]
    rows[rule] = ""
    return Lines(rows, lines.comments), ["a table of Markdown"]
