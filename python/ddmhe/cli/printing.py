"""What every command prints: warnings, and the files that it wrote."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from ddmhe.checks import file_words, one_line

__all__ = ["print_warnings", "print_written", "warn"]


def warn(sentence: str) -> None:
    """One line on stderr."""
    print("ddmhe: warning:", one_line(sentence), file=sys.stderr)


def print_warnings(console: Console, prefix: str, warnings: Iterable[str]) -> None:
    """Warnings among what is printed, each after the prefix."""
    for warning in warnings:
        console.print(
            f"warning: {prefix}{one_line(warning)}", style="yellow", markup=False, soft_wrap=True
        )


def print_written(console: Console, paths: list[Path], replaced: Iterable[Path] = ()) -> None:
    """The paths, one a line, and whether a file was there before."""
    for path in paths:
        done = "replaced" if path in replaced else "wrote"
        console.print(f"{done} {file_words(path)}", markup=False, highlight=False, soft_wrap=True)
