"""Options that several commands share, and what their texts mean."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.cli.values import parsed, stand_ins
from ddmhe.files import check_writable
from ddmhe.recordings.order import DUPLICATES

Array = NDArray[np.float64]

__all__ = ["directory_option", "log_options", "radius", "reading_options"]


def names(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...]:
    """Column names from a comma-separated list; a name with a comma may be quoted."""
    if value is None:  # `interval pendulum` needs none
        return ()
    try:
        (parts,) = (
            csv.reader([value], skipinitialspace=True) if '"' in value else [value.split(",")]
        )
    except (csv.Error, ValueError):
        parts = value.split(",")
    names = tuple(part.strip() for part in parts)
    if "" in names:
        raise click.BadParameter(f"expected column names separated by commas, found {shown(value)}")
    return names


def radius(ctx: click.Context, param: click.Parameter, value: str | None) -> Array | None:
    """One number for all columns, or one a column, separated by commas."""
    if value is None:
        return None
    found = np.array(parsed(value))
    if not found.size:
        raise click.BadParameter(
            f"expected a number, or one a column parted by commas, found {shown(value)}"
        )
    return found[0] if len(found) == 1 else found


def delays(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> float | dict[str, float] | None:
    """Seconds for all outputs, or NAME=SECONDS parted by commas."""
    if value is None:
        return None
    if "=" not in value:
        found = parsed(value)
        if len(found) != 1 or not np.isfinite(found[0]):
            raise click.BadParameter(f"expected seconds, or NAME=SECONDS, found {value!r}")
        return found[0]
    named: dict[str, float] = {}
    for part in value.split(","):
        name, _, seconds = (text.strip() for text in part.rpartition("="))
        found = parsed(seconds)
        if not name or name in named or len(found) != 1 or not np.isfinite(found[0]):
            raise click.BadParameter(
                f"expected different NAME=SECONDS parted by commas, found {value!r}"
            )
        named[name] = found[0]
    return named


_HOW_TO_READ: list[Callable[[Any], Any]] = [
    click.option(
        "--time", metavar="NAME", help="Column of the time.  [default: the one that says so]"
    ),
    click.option("--time-unit", metavar="UNIT", help="s, ms, us, ns, min, h or days."),
    click.option("--dt", type=float, metavar="S", help="The step, s, of a log without times."),
    click.option(
        "--start",
        metavar="S|DATE",
        help="Where the recording begins, on the log's clock.  [default: first row]",
    ),
    click.option(
        "--decimate",
        type=int,
        default=1,
        show_default=True,
        metavar="K",
        help="Keep every K-th row.",
    ),
    click.option(
        "--gaps",
        type=click.Choice(["error", "fill"]),
        default="fill",
        show_default=True,
        help="A gap in the log: take the lacking samples as not measured, or refuse the log.",
    ),
    click.option(
        "--duplicates",
        type=click.Choice(DUPLICATES),
        default="error",
        show_default=True,
        help="Which row of a repeated time counts.",
    ),
    click.option(
        "--resample",
        type=float,
        metavar="S",
        help="Put the log on even steps, s, by straight lines.  [default: nothing is resampled]",
    ),
    click.option("--sort", is_flag=True, help="Put the rows in the order of time."),
    click.option("--sep", metavar="C", help="What parts the cells; tab, space.  [default: seen]"),
    click.option("--decimal", metavar=".|,", help="Decimal mark.  [default: seen]"),
    click.option(
        "--comment", metavar="C", help="What a comment begins with.  [default: #, %, // at first]"
    ),
    click.option("--encoding", metavar="NAME", help="Like latin-1.  [default: seen]"),
    click.option(
        "--missing",
        callback=stand_ins,
        metavar="V1,V2,...",
        help="Numbers and words that say not measured, like -9999.",
    ),
    click.option(
        "--unwrap",
        callback=names,
        metavar="C1,C2,...",
        help="Angles that jump by a turn: go on instead.",
    ),
    click.option(
        "--delay",
        callback=delays,
        metavar="SECONDS|C1=SECONDS,...",
        help="How late output columns are; they are moved back by it.  [default: 0]",
    ),
]
"""What may be said of any log."""


def reading_options(required: bool) -> Callable[[Any], Any]:
    """How to read a log; `required`: whether its columns and its history must be named."""

    def columns(name: str, words: str) -> Callable[[Any], Any]:
        return click.option(
            name, callback=names, required=required, metavar="C1,C2,...", help=words
        )

    options = [
        columns("--state", "Columns of the state."),
        columns("--output", "Columns of the output."),
        click.option("--history", type=float, help="Length of the recording to learn from, s."),
        click.option(
            "--recording",
            multiple=True,
            metavar="FILE[:A..B]",
            help="Another recording of the system, from A to B s; may be repeated.",
        ),
        *_HOW_TO_READ,
    ]

    def decorate(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def directory_option(default: str) -> Callable[[Any], Any]:
    """Where a command writes its files: a place that can be written to, which is checked first."""

    def checked(ctx: click.Context, param: click.Parameter, value: Path) -> Path:
        check_writable(value / "any")
        return value

    return click.option(
        "--out",
        type=click.Path(path_type=Path),
        default=Path(default),
        show_default=True,
        metavar="DIR",
        callback=checked,
        help="Where files are written.",
    )


def log_options(command: Any) -> Any:
    """The log and how to read it: what every command that takes a log has."""
    named = click.option(
        "--input",
        callback=names,
        metavar="C1,C2,...",
        help="Columns of known inputs, with a number in every row.  [default: none]",
    )
    return click.argument("log", type=click.Path(path_type=Path))(
        reading_options(required=True)(named(command))
    )
