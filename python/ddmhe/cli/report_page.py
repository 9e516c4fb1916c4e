"""``ddmhe report``: a run over a log as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ddmhe.cli import estimate
from ddmhe.cli.page import check_page

__all__ = ["command"]

NOT_HERE = ("out", "plot", "page", "follow", "resume")
"""Options of `estimate` that say where else results go."""


def _written(out: Path, **given: Any) -> None:
    """Estimate the states of a log, as `estimate` does with the same options, and write a page on
    it: one HTML file that holds its charts, loads nothing and can be handed on.

    It has a summary, the estimates with their bands, where the log leaves the recording and why,
    the evidence, settings with their reasons, times, warnings, and what makes it again."""
    check_page(out, "--out")
    assert estimate.command.callback is not None
    estimate.command.callback(out=None, plot=None, follow=False, resume=None, page=out, **given)


command = click.Command(
    "report",
    callback=_written,
    help=_written.__doc__,
    short_help="A run over a log as one page to hand on.",
    params=[
        *(option for option in estimate.command.params if option.name not in NOT_HERE),
        click.Option(
            ["--out"],
            type=click.Path(path_type=Path),
            required=True,
            metavar="FILE.html",
            help="Where the page goes.",
        ),
    ],
)
"""The command, with the options of `estimate`."""
