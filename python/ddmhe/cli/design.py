"""``ddmhe design``: stability from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ddmhe import report
from ddmhe.checks import word
from ddmhe.cli.options import directory_option, log_options
from ddmhe.cli.printing import print_written
from ddmhe.cli.reading import print_notes, read
from ddmhe.config import write_config

__all__ = ["command"]


@click.command("design")
@log_options
@directory_option("ddmhe-design")
@click.option(
    "--radius",
    type=float,
    default=0.9,
    show_default=True,
    help="Disc for Algorithm 2's poles, in (0, 1).",
)
@click.option("--eta", type=float, help="Discount of the certificate, in (0, 1).  [default: 0.95]")
@click.option(
    "--condition", type=float, help="Bound on cond P; alone, it asks for the smallest eta."
)
@click.option(
    "--noise-x",
    type=float,
    default=0.0,
    help="Errors of the recorded states: a robust certificate.",
)
@click.option("--noise-y", type=float, default=0.0, help="Errors of the recorded outputs.")
@click.option("--noise-w", type=float, default=0.0, help="Process noise during the recording.")
@click.option(
    "--noise-kind", type=click.Choice(["bounded", "gaussian"]), default="bounded", show_default=True
)
def command(
    log: Path, out: Path, radius: float, eta: float | None, condition: float | None, **given: Any
) -> None:
    """Stability from a recording: Algorithm 2 with its limits, and a certificate for the estimator.

    Writes design.toml, which `estimate --config` accepts, and poles.png into DIR.
    """
    from ddmhe import design as designs
    from ddmhe.report.figures import pole_figure

    _, split = read(log, given)
    noise = None
    if any(given[f"noise_{name}"] != 0 for name in "xyw"):
        noise = designs.RecordingNoise(
            given["noise_x"], given["noise_y"], given["noise_w"], given["noise_kind"]
        )
    model = designs.identify(split.history)
    placement = designs.pole_placement(split.history, radius)
    certificate = designs.ioss(split.history, eta, condition=condition, noise=noise)
    out.mkdir(parents=True, exist_ok=True)
    written = [out / "design.toml", out / "poles.png"]
    write_config(written[0], {"certificate": certificate})
    report.save_figure(pole_figure(model, placement), written[1])
    console = Console()
    print_notes(console, split)
    console.print(
        report.design(f"Design from {word(log.name)}", split.history, model, placement, certificate)
    )
    for words in (placement.words, certificate.words):
        console.print(words, markup=False, highlight=False)
    print_written(console, written)
