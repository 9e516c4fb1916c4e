"""The command line: read, estimate, print, write. One clear line on stderr and exit code 2 for any
wrong input. One file a command."""

from __future__ import annotations

import io
import sys
from importlib import import_module
from typing import NoReturn

import click

from ddmhe._core import DdmheError
from ddmhe.checks import file_words, reason
from ddmhe.cli.interrupts import ended_by_interrupts

__all__ = ["cli", "main"]

LONGEST = 1000
"""Characters of a usage error, which may quote what was typed."""
WIDEST_HELP = 100
"""Columns of help, where the terminal has them."""

COMMANDS = {
    "demo": ("demo", "The paper's satellite: simulated, recorded, estimated."),
    "explain": ("explain", "Whether a recording is enough, for which states, how far."),
    "estimate": ("estimate", "The states of a log from its outputs."),
    "report": ("report_page", "A run over a log as one page to hand on."),
    "design": ("design", "Algorithm 2 and a stability certificate from a recording."),
    "tune": ("tune", "Settings from a recording, and errors to expect."),
    "interval": ("interval", "Guaranteed intervals, of a log or of the paper's pendulum."),
    "campaign": ("campaign", "Thousands of cases on this machine or a cluster."),
    "bench": ("bench", "What a step costs on this machine with this log."),
    "reproduce": ("reproduce", "The experiments of the papers again."),
}
"""The commands in the order of help: the module of each, loaded when it is called, and its line."""


class Commands(click.Group):
    """The commands, each loaded when it is called: help would else wait for all of them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Their names."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """One of them."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        command: click.Command = import_module(f"ddmhe.cli.{COMMANDS[cmd_name][0]}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A line each."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])


@click.group(
    cls=Commands,
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
