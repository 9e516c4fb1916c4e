"""The command line: read, estimate, print, write. One clear line on stderr and exit code 2 for any
wrong input. One file a command."""

from __future__ import annotations

import io
import sys
from typing import NoReturn

import click

from ddmhe._core import DdmheError
from ddmhe.checks import file_words, reason
from ddmhe.cli import (
    bench,
    campaign,
    demo,
    design,
    estimate,
    explain,
    interval,
    report_page,
    reproduce,
    tune,
)
from ddmhe.cli.interrupts import ended_by_interrupts

__all__ = ["cli", "main"]

LONGEST = 1000
"""Characters of a usage error, which may quote what was typed."""
WIDEST_HELP = 100
"""Columns of help, where the terminal has them."""


@click.group(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": WIDEST_HELP},
)
@click.version_option(package_name="ddmhe", prog_name="ddmhe")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Data-driven moving horizon estimation: the state of a system from its outputs and one
    recording, no model."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


_COMMANDS = (
    *(demo, explain, estimate, report_page, design, tune, interval),
    *(campaign, bench, reproduce),
)
for _module in _COMMANDS:
    cli.add_command(_module.command)


def main() -> NoReturn:
    """Entry point. Exits 0 on success, 2 on wrong usage or input with one line on stderr, 130 on
    Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # a terminal that lacks a character must not end the run
            stream.reconfigure(errors="replace")
    try:
        with ended_by_interrupts():
            sys.exit(cli.main(prog_name="ddmhe", standalone_mode=False))
    except click.Abort:
        sys.exit(130)
    except click.UsageError as e:
        command = e.ctx.command_path if e.ctx else "ddmhe"
        _fail(f"{reason(e.format_message(), LONGEST)} (see {command} --help)")
    except DdmheError as e:
        _fail(str(e))
    except OSError as e:
        place, found = e.filename or "a file", e.strerror or e
        _fail(f"{file_words(place)}: expected to be able to read or write it, found: {found}")


def _fail(message: str) -> NoReturn:
    print("ddmhe: error:", reason(message, None), file=sys.stderr)
    sys.exit(2)
