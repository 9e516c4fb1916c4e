"""What a command answers: tables and sentences for people, or one JSON object for programs.

docs/command-line.md lists the keys of each command's object."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from functools import wraps
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console, RenderableType

from ddmhe.checks import file_words, one_line
from ddmhe.cli.working import Advance, working

__all__ = ["Answer", "answers", "plain"]

WIDEST = 10_000
"""Columns of what is no terminal: tables are as wide as they are."""


class Answer:
    """Where the results of one command go."""

    def __init__(self, command: str, as_json: bool, quiet: bool, verbose: bool) -> None:
        """For one run of `command`."""
        self.as_json, self.quiet, self.verbose = as_json, quiet, verbose
        self.console = Console(width=None if sys.stdout.isatty() else WIDEST)
        self._facts: dict[str, Any] = {"command": command, "ddmhe": version("ddmhe")}
        self._warnings: list[str] = []
        self._written: list[str] = []
        self.stopped = False
        self._notes: list[str] = []

    @property
    def tells(self) -> bool:
        """Whether people read it."""
        return not (self.as_json or self.quiet)

    def show(self, *tables: RenderableType) -> None:
        """Tables, one below the other, below what was noted."""
        self._say_notes()
        if self.tells:
            self.console.print(*tables)

    def _say_notes(self) -> None:
        notes, self._notes = self._notes, []
        for words in notes:
            self.say(words)

    def note(self, words: str) -> None:
        """A sentence above the first table; an error before it is alone."""
        self._notes.append(words)

    def say(self, words: str) -> None:
        """A sentence; names of files in it are no markup."""
        if self.tells:
            self.console.print(one_line(words), markup=False, highlight=False, soft_wrap=True)

    def more(self, words: str) -> None:
        """A sentence for those who asked for more."""
        if self.verbose:
            self.say(words)

    def warn(self, sentence: str) -> None:
        """One line on stderr."""
        self._warnings.append(one_line(sentence))
        if not self.quiet:
            print("ddmhe: warning:", one_line(sentence), file=sys.stderr)

    def facts(self, **facts: Any) -> None:
        """Numbers and texts of the JSON object."""
        self._facts |= facts

    def wrote(self, paths: Iterable[Path], replaced: Iterable[Path] = ()) -> None:
        """The files, one a line, and whether one was there before."""
        there = set(replaced)
        for path in paths:
            self._written.append(str(path))
            self.say(f"{'replaced' if path in there else 'wrote'} {file_words(path)}")

    def working(self, what: str) -> AbstractContextManager[Advance]:
        """A piece of work, with a bar where it takes longer than a second."""
        return working(what, shown=not self.quiet, timed=self.verbose and not self.quiet)

    def stop(self) -> None:
        """The work was interrupted: what was finished is answered, and the exit code says so."""
        self.stopped = True

    def end(self) -> None:
        """The JSON object, where one is wanted; Abort after an interrupt."""
        self._say_notes()
        if self.as_json:
            ends = {"warnings": self._warnings, "written": self._written, "stopped": self.stopped}
            text = json.dumps(plain(self._facts | ends), allow_nan=False, ensure_ascii=False)
            sys.stdout.write(text + "\n")
        if self.stopped:
            raise click.Abort


def plain(value: Any) -> Any:
    """In values of JSON: arrays as lists, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def answers(command: Any) -> Any:
    """`--json`, `--quiet` and `--verbose`; the command gets an Answer first."""

    @click.option("--json", "as_json", is_flag=True, help="Print one JSON object, nothing else.")
    @click.option("-q", "--quiet", is_flag=True, help="Print errors alone.")
    @click.option("-v", "--verbose", is_flag=True, help="Print how it was found, and the times.")
    @wraps(command)
    def answered(as_json: bool, quiet: bool, verbose: bool, **given: Any) -> None:
        name = click.get_current_context().info_name
        answer = Answer(str(name), as_json, quiet, verbose)
        command(answer, **given)
        answer.end()

    return answered
