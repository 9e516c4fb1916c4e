"""Pages: tables as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Table

__all__ = ["cells", "markdown", "markdown_table"]


def markdown(title: str, tables: Sequence[Table]) -> str:
    """Tables as they are printed, as one Markdown page."""
    lines = [f"# {title}", ""]
    for table in tables:
        of = cells(table)
        lines += [of["title"], "", *markdown_table(of["columns"], of["rows"]), ""]
    return "\n".join(lines)


def cells(table: Table) -> dict[str, Any]:
    """A table's "title", "columns" and "rows" as texts."""
    rows = zip(*(map(str, column.cells) for column in table.columns), strict=True)
    return {
        "title": str(table.title),
        "columns": [str(column.header) for column in table.columns],
        "rows": [list(row) for row in rows],
    }


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table.

    Cells are not padded to the width of their column, as libraries do: with one cell that changes,
    one line of a page changes."""
    return [_line(header), "|" + " --- |" * len(header), *(_line(row) for row in rows)]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
