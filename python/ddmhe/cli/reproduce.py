"""``ddmhe reproduce``: the experiments of the papers again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import click

from ddmhe import report
from ddmhe.checks import shown
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import directory_option
from ddmhe.cli.working import Advance
from ddmhe.files import write_text

__all__ = ["command"]


@click.command("reproduce", short_help="The experiments of the papers again.")
@click.argument("name", metavar="NAME|all|real")
@directory_option("ddmhe-reproduce")
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="real: where the logs are.  [default: DDMHE_DATA]",
)
@answers
def command(answer: Answer, name: str, out: Path, data: Path | None) -> None:
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
    logs = pendulum_logs(data) if name == "real" else []
    driven = driven_logs(data) if name == "real" else []
    found = _Found(answer)
    if name == "real":
        found.real(logs, driven, out)
    else:
        found.experiments(list(EXPERIMENTS) if name == "all" else [name], out)
    if found.claims:
        found.written.append(out / "tables.md")
        tables = report.markdown("The tables of `ddmhe reproduce`", found.printed)
        write_text(found.written[-1], tables)
        found.written.append(out / "claims.md")
        write_claims(found.written[-1], found.claims)
        answer.show(verdicts(found.claims))
    answer.facts(claims=[asdict(claim) for claim in found.claims])
    answer.facts(tables=[report.cells(table) for table in found.printed])
    answer.wrote(found.written)


@dataclass
class _Found:
    """What came out by now: an interrupt leaves it."""

    answer: Answer
    claims: list[Any] = field(default_factory=list)
    printed: list[Any] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)

    def real(self, logs: list[Path], driven: list[tuple[str, Path]], out: Path) -> None:
        """Every estimator on measured logs, pendulums and logs with inputs."""
        from ddmhe.reproduce import reproduce_real

        total = len(logs) + len(driven)
        with self.answer.working("real") as advance:
            done = count(1)
            try:
                result, self.written = reproduce_real(
                    logs, out, lambda: advance(next(done), total), driven
                )
            except KeyboardInterrupt as e:
                if getattr(e, "finished", None) is None:
                    raise
                self.answer.stop()
                result, self.written = e.finished  # type: ignore[attr-defined]
        self.printed += result.printed
        self.answer.show(*result.printed)

    def experiments(self, names: list[str], out: Path) -> None:
        """One experiment after the other."""
        from ddmhe.reproduce import EXPERIMENTS, run_experiment

        for name in names:
            with self.answer.working(name) as advance:
                tell = partial(_next, advance, count(1), EXPERIMENTS[name].units)
                try:
                    result, paths = run_experiment(name, out, tell)
                except KeyboardInterrupt:
                    self.answer.stop()
                    return
            self.claims += result.claims
            self.printed += result.printed
            self.written += paths
            self.answer.show(*result.printed, "")


def _next(advance: Advance, done: Iterator[int], total: int) -> None:
    advance(next(done), total)
