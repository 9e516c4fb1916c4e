"""Lines in which names stand beside their values, `t=0.02 w1=0.8` or `t:0.02, w1:0.8`, perhaps
behind the time and the words of a logger."""

from __future__ import annotations

import re

from ddmhe.recordings.text import Lines, line_of

__all__ = ["pair_lines"]

ENOUGH, MOST = 3, 0.5
"""Fewest lines with the same names that make a table, and their least share of all."""
_PAIR = re.compile(
    r"""([A-Za-z_][\w./-]*(?:\[[\w/%^*.-]+\])?)\s*(=|:(?!\d+:))\s*("[^"]*"|[^\s,;="]+)"""
)
_BETWEEN = re.compile(r"[\s,;|]*")
_STAMP = r"\d{4}-\d\d-\d\d[T\ ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?\s?(?:Z|[+-]\d\d:?\d\d)?"
_PREFIX = re.compile(
    rf"(?:[\[(]?(?P<time>{_STAMP})[\])]?\s*|(?=[A-Z]\s*\())"
    r"(?:[^\s=]+\s+)*?(?=[A-Za-z_][\w./\[\]-]*[=:]\S)"
)
"""The words of a logger before the pairs: the time first, or a letter for how grave it is, and what
the logger counts in brackets."""
_TIME = "time"

Pairs = list[tuple[str, str]]


def pair_lines(lines: Lines, first: int) -> tuple[Lines, list[str]] | None:
    """The same names in all lines but those that have none of them, which are left out; None for
    other texts."""
    if _pairs_of(lines.rows[first]) is None and not _PREFIX.match(lines.rows[first]):
        return None
    found = {k: _pairs_of(row) for k, row in enumerate(lines.rows) if row.strip()}
    every = [tuple(name for name, _ in pairs) for pairs in found.values() if pairs]
    names = max(set(every), key=every.count) if every else ()
    if len(names) < 2 or len(set(names)) < len(names):
        return None
    same = sum(one == names for one in every)
    known = set(names) - {_TIME}
    if same < ENOUGH or same < MOST * len(found):
        return None
    if any(one != names and known & set(one) for one in every):
        return None
    rows = [
        line_of([value for _, value in pairs])
        if (pairs := found.get(k)) is not None and len(pairs) == len(names) and _of(pairs) == names
        else ""
        for k in range(len(lines.rows))
    ]
    told = "names beside the values of each line"
    if same < len(found):
        told += f", {len(found) - same} lines without them left out"
    return Lines([line_of(list(names)), *rows], {}, -1), [told]


def _of(pairs: Pairs) -> tuple[str, ...]:
    return tuple(name for name, _ in pairs)


def _pairs_of(row: str) -> Pairs | None:
    """Names and values of a line, with the time that it begins with; None where it holds anything
    else."""
    row = row.strip()
    found: Pairs = []
    at = 0
    prefix = _PREFIX.match(row)
    if prefix is not None:
        at = prefix.end()
        found = [(_TIME, prefix["time"].strip())] if prefix["time"] else []
    while at < len(row):
        match = _PAIR.match(row, at)
        if match is None:
            return None
        found.append((match[1], match[3].strip('"')))
        between = _BETWEEN.match(row, match.end())
        assert between is not None
        if between.end() == match.end() < len(row):
            return None
        at = between.end()
    return found
