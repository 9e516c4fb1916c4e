"""``ddmhe tune``: settings from a recording alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from ddmhe import report
from ddmhe.checks import word
from ddmhe.cli.options import directory_option, log_options
from ddmhe.cli.printing import print_warnings, print_written
from ddmhe.cli.reading import print_notes, read, untold
from ddmhe.config import write_config
from ddmhe.files import write

__all__ = ["command"]


@click.command("tune")
@log_options
@directory_option("ddmhe-tune")
@click.option("--output-noise", type=float, help="Standard deviation of the online outputs' noise.")
@click.option(
    "--rest",
    is_flag=True,
    help="x = 0, y = 0 (and input 0) is a rest of the system: try it as an equilibrium.",
)
def command(log: Path, out: Path, output_noise: float | None, rest: bool, **given: Any) -> None:
    """Settings from a recording alone, chosen on parts of it that the estimator has not seen.

    Prints for each state what error to expect and whether the recording shows the settings to be
    better than the default rule's. Writes tune.toml, which `estimate --config` accepts and which
    holds nothing but the start where the default rule is kept, the scores as tune.csv and tune.png
    into DIR."""
    from ddmhe.report.figures import tuning_figure
    from ddmhe.tuning import tune as tuned

    samples, split = read(log, given)
    h = split.history
    sizes = (h.n, h.p, h.m) if h.m else (h.n, h.p)
    equilibrium = tuple(np.zeros(size) for size in sizes) if rest else None
    stopped = False
    try:
        found = tuned(h, output_noise=output_noise, equilibrium=equilibrium)
    except KeyboardInterrupt as e:
        if getattr(e, "finished", None) is None:
            raise
        stopped, found = True, e.finished  # type: ignore[attr-defined]
    out.mkdir(parents=True, exist_ok=True)
    written = [out / name for name in ("tune.toml", "tune.csv", "tune.png")]
    write_config(written[0], found.settings | {"start": found.start})
    write(written[1], lambda beside: found.table.to_csv(beside, index=False))
    report.save_figure(tuning_figure(found.table), written[2])
    console = Console()
    print_notes(console, split)
    console.print(
        report.scores(
            f"Settings for {word(log.name)}, the ten best of {len(found.table)}",
            found.table.head(10),
        )
    )
    names = samples.names.state
    console.print(report.promise("What to expect, by held-out ends of the recording", found, names))
    console.print(found.words, markup=False, highlight=False)
    print_warnings(console, "", untold(samples, found.warnings))
    print_written(console, written)
    if stopped:
        raise click.Abort
