"""``ddmhe reproduce``: the experiments of the papers again."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress

from ddmhe import report
from ddmhe.checks import shown
from ddmhe.cli.options import directory_option
from ddmhe.cli.printing import print_written
from ddmhe.files import write_text

__all__ = ["command"]


@click.command("reproduce")
@click.argument("name", metavar="NAME|all|real")
@directory_option("ddmhe-reproduce")
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="real: where the logs are.  [default: DDMHE_DATA]",
)
def command(name: str, out: Path, data: Path | None) -> None:
    """The experiments of the papers again: figures, series, and a verdict on each claim.

    NAME: bench-nominal, bench-noise, bench-disturbance, bench-both (Figs. 2 to 5), bench-mu (Fig.
    6), detumbling (Figs. 7 and 8), design (rho0 and mu0), pendulum (the interval paper), all; or
    real, every estimator on measured pendulum logs, and on logs with known inputs (folder
    input-logs). Writes PNG, SVG, CSV, tables.md and claims.md into DIR."""
    from ddmhe.reproduce import (
        EXPERIMENTS,
        driven_logs,
        pendulum_logs,
        verdicts,
        write_claims,
    )

    if name not in (*EXPERIMENTS, "all", "real"):
        raise click.BadParameter(
            f"expected one of {', '.join(EXPERIMENTS)}, all, real, found {shown(name)}",
            param_hint="NAME",
        )
    console = Console(width=None if sys.stdout.isatty() else 160)
    logs = pendulum_logs(data) if name == "real" else []
    driven = driven_logs(data) if name == "real" else []
    found = _Found()
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        if name == "real":
            found.real(logs, driven, out, progress)
        else:
            found.experiments(list(EXPERIMENTS) if name == "all" else [name], out, progress)
    if found.claims:
        found.written.append(out / "tables.md")
        tables = report.markdown("The tables of `ddmhe reproduce`", found.printed)
        write_text(found.written[-1], tables)
        found.written.append(out / "claims.md")
        write_claims(found.written[-1], found.claims)
        console.print(verdicts(found.claims))
    print_written(console, found.written)
    if found.stopped:
        raise click.Abort


@dataclass
class _Found:
    """What came out by now: an interrupt leaves it."""

    claims: list[Any] = field(default_factory=list)
    printed: list[Any] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)
    stopped: bool = False

    def real(
        self, logs: list[Path], driven: list[tuple[str, Path]], out: Path, progress: Progress
    ) -> None:
        """Every estimator on measured logs, pendulums and logs with inputs."""
        from ddmhe.reproduce import reproduce_real

        task = progress.add_task("real", total=len(logs) + len(driven))
        try:
            result, self.written = reproduce_real(
                logs, out, partial(progress.advance, task), driven
            )
        except KeyboardInterrupt as e:
            if getattr(e, "finished", None) is None:
                raise
            self.stopped, (result, self.written) = True, e.finished  # type: ignore[attr-defined]
        progress.console.print(*result.printed)

    def experiments(self, names: list[str], out: Path, progress: Progress) -> None:
        """One experiment after the other."""
        from ddmhe.reproduce import EXPERIMENTS, run_experiment

        for name in names:
            task = progress.add_task(name, total=EXPERIMENTS[name].units)
            try:
                result, paths = run_experiment(name, out, partial(progress.advance, task))
            except KeyboardInterrupt:
                self.stopped = True
                return
            progress.remove_task(task)
            self.claims += result.claims
            self.printed += result.printed
            self.written += paths
            progress.console.print(*result.printed, "")
