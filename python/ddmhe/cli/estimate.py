"""``ddmhe estimate``: the states of a log from its outputs."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from ddmhe import report
from ddmhe._core import DdMhe
from ddmhe._core import Log as Estimates
from ddmhe.cli.options import log_options
from ddmhe.cli.printing import print_written, warn
from ddmhe.cli.reading import read, untold
from ddmhe.config import READING, read_config, space_from_text
from ddmhe.logs import Log, Split

Array = NDArray[np.float64]

__all__ = ["command"]


FIGURES = (".png", ".pdf", ".svg")


@click.command("estimate")
@log_options
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE.csv|DIR", help="Where the estimates go."
)
@click.option(
    "--plot", type=click.Path(path_type=Path), metavar="FILE.png", help="Where a figure goes."
)
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Settings; keys as in DdMhe.",
)
@click.option("--horizon", type=int, help="Horizon M, samples.  [default: from the recording]")
@click.option(
    "--rho", type=float, help="Discount per sample, in (0, 1).  [default: from the recording]"
)
@click.option("--mu", type=float, help="Weight on the fitted noise.  [default: from the recording]")
@click.option(
    "--space",
    metavar="auto|exact|truncated:RANK|ridge:WEIGHT",
    help="Which windows count as trajectories.",
)
@click.option(
    "--start-from",
    type=click.Choice(["auto", "recording", "state", "unknown"]),
    help="The recording's end, a state (x_prior, or the last recorded one), or anywhere.  "
    "[default: auto: recording]",
)
@click.option(
    "--warm-start/--no-warm-start",
    default=None,
    help="The old names of --start-from recording and state.",
)
def command(
    log: Path, out: Path | None, plot: Path | None, config: Path | None, **given: Any
) -> None:
    """Estimate the states of a CSV log from its outputs, and known inputs if there are any, after a
    history in which both were recorded.

    Writes the time column and one column per state, and prints the errors where the log holds the
    states."""
    csv, figure = _targets(log, out, plot)
    from_file = {} if config is None else read_config(config)
    for key in READING:
        found = from_file.pop(key, None)
        given[key] = found if given[key] is None else given[key]
    samples, split = read(log, given)
    est = DdMhe(split.history, **_settings(from_file, given))
    at_first = list(est.warnings)
    for sentence in untold(samples, at_first):
        warn(sentence)
    asked = len(split.Y)
    try:
        estimates = est.run(split.Y, split.U)
    except KeyboardInterrupt as e:
        estimates = e.finished  # type: ignore[attr-defined]
        samples, split = _cut(samples, split, len(estimates.x))
    for sentence in untold(samples, est.warnings):
        if sentence not in at_first:
            warn(sentence)
    written = _write(csv, figure, samples, split, estimates.x)
    console = Console()
    console.print(_summary(samples, split, est, estimates))
    print_written(console, written)
    if len(estimates.x) < asked:
        raise click.Abort


def _cut(samples: Log, split: Split, made: int) -> tuple[Log, Split]:
    """The log as if it ended with the last of `made` estimates; says so."""
    left_out = len(split.Y) - made
    if made == 0:
        raise KeyboardInterrupt
    print(f"ddmhe: stopped: {made} of {len(split.Y)} samples were estimated", file=sys.stderr)
    end = len(samples.t) - left_out

    def first(whole: Log | Split, names: tuple[str, ...], rows: int) -> dict[str, Any]:
        parts = {name: getattr(whole, name) for name in names}
        return {name: part if part is None else part[:rows] for name, part in parts.items()}

    return (
        replace(samples, **first(samples, ("t", "x", "y", "u", "lines", "samples"), end)),
        replace(split, **first(split, ("Y", "t", "x_true", "U"), made)),
    )


def _targets(log: Path, out: Path | None, plot: Path | None) -> tuple[Path | None, Path | None]:
    """Paths of the CSV and of the figure, None for none."""
    if plot is not None and plot.suffix.lower() not in FIGURES:
        wanted = ", ".join(FIGURES)
        raise click.BadParameter(
            f"expected a file ending in {wanted}, found {str(plot)!r}", param_hint="--plot"
        )
    csv = out
    if out is not None and out.suffix.lower() != ".csv":
        csv, plot = out / "estimate.csv", plot or out / "estimate.png"
    if csv is not None and csv.exists() and log.exists() and csv.samefile(log):
        raise click.BadParameter(
            f"expected a file other than the log, found {str(csv)!r}", param_hint="--out"
        )
    return csv, plot


def _settings(from_file: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Keywords of DdMhe: the file's, overridden by the options given."""
    named = dict(from_file)
    if given["start_from"] is not None or given["warm_start"] is not None:
        named = {key: value for key, value in named.items() if key not in ("start", "warm_start")}
    settings = named | {
        key: value for key, value in given.items() if value is not None and key != "start_from"
    }
    if given["start_from"] not in (None, "auto"):
        settings["start"] = given["start_from"]
    if not {"start", "warm_start", "x_prior"} & set(settings):
        settings["start"] = "recording"  # the log goes on where its history ends
    if isinstance(given["space"], str):
        settings["space"] = space_from_text(given["space"])
    return settings


def _summary(log: Log, split: Split, est: DdMhe, estimates: Estimates) -> Any:
    """The table that is printed: settings, how the steps ended, errors where the truth is known."""
    filled = int(np.sum(log.lines == 0))
    rows = {"history": f"T = {split.history.T} samples of {log.dt:.4g} s"}
    rows |= {"gaps filled": f"{filled} samples"} if filled else {}
    rows |= report.settings(est) | report.outcome(estimates.status, estimates.active)
    if estimates.bound is not None:
        rows["error bound"] = (
            f"{np.median(estimates.bound):.4g} median, {np.max(estimates.bound):.4g} at most"
        )
    if split.x_true is not None:
        errors = report.rmse(estimates.x - split.x_true)
        rows |= {
            f"RMSE {name}": f"{value:.4g}"
            for name, value in zip(log.names.state, errors, strict=True)
        }
        relative = report.nrmse(estimates.x, split.x_true)
        rows |= {
            f"NRMSE {name}": f"{value:.4f}"
            for name, value in zip(log.names.state, relative, strict=True)
        }
        rows["NRMSE"] = f"{report.root_mean_square(relative):.4f}"
        if len(relative) > 1 and len(set(split.history.x_units)) == 1 and split.history.x_units[0]:
            rows["NRMSE pooled"] = f"{report.pooled_nrmse(estimates.x, split.x_true):.4f}"
    return report.table(f"Estimates of {Path(log.path).name}", {"": rows})


def _write(
    csv: Path | None, figure: Path | None, log: Log, split: Split, x_hat: Array
) -> list[Path]:
    """One CSV row per row of the log after the history; the figure also shows the estimates inside
    filled gaps."""
    if csv is not None:
        csv.parent.mkdir(parents=True, exist_ok=True)
        logged = log.lines[-len(split.t) :] > 0
        report.write_estimates(csv, log.names.time, split.t[logged], log.names.state, x_hat[logged])
    if figure is not None:
        from ddmhe.report.figures import estimate_figure

        figure.parent.mkdir(parents=True, exist_ok=True)
        T = len(log.t) - len(split.t) - 1
        recorded = (log.t[: T + 1], log.x[: T + 1])
        drawing = estimate_figure(
            split.t,
            x_hat,
            split.x_true,
            history=recorded,
            names=log.names.state,
            quantity="state (unit of the log)",
        )
        report.save_figure(drawing, figure)
    return [path for path in (csv, figure) if path is not None]
