"""``ddmhe estimate``: the states of a log from its outputs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from ddmhe import report
from ddmhe._core import DdMhe, History
from ddmhe._core import Log as Estimates
from ddmhe.checks import file_words, word
from ddmhe.cli.options import deviations, gate, log_options
from ddmhe.cli.printing import print_written, warn
from ddmhe.cli.reading import read, untold
from ddmhe.cli.telling import in_words_of
from ddmhe.config import READING, read_config, space_from_text
from ddmhe.logs import Log, Split
from ddmhe.report.trust import Trust

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
    help="Where the run starts: the recording's end, a state (x_prior, or the last recorded one), "
    "or anywhere; auto finds out whether it goes on from the recording.  [default: auto]",
)
@click.option(
    "--warm-start/--no-warm-start",
    default=None,
    help="The old names of --start-from recording and state.",
)
@click.option(
    "--output-noise",
    callback=deviations,
    metavar="SD[,SD,...]",
    help="Standard deviation of the noise of later outputs.  [default: the recording's]",
)
@click.option(
    "--gate",
    callback=gate,
    metavar="auto|K",
    help="Reject outputs that are K deviations from what all others say they are, and start again "
    "where the state has jumped.  [default: none]",
)
@click.option(
    "--stuck",
    type=click.Choice(["tell", "missing"]),
    help="What becomes of an output that repeats one value too long.  [default: tell]",
)
@click.option(
    "--evidence/--no-evidence",
    default=None,
    help="Whether to say how far to trust each estimate.  [default: evidence]",
)
def command(
    log: Path, out: Path | None, plot: Path | None, config: Path | None, **given: Any
) -> None:
    """Estimate the states of a CSV log from its outputs, and known inputs if there are any, after a
    history in which both were recorded.

    Writes the time column, one column per state, its standard deviation as STATE_std, `trusted` (1
    or 0) and `reasons` (novel, uncertain, stuck, outside, joined by +; empty where there is none),
    and prints the errors where the log holds the states."""
    csv, figure = _targets(log, out, plot)
    from_file = {} if config is None else read_config(config)
    for key in READING:
        found = from_file.pop(key, None)
        given[key] = found if given[key] is None else given[key]
    samples, split = read(log, given)
    est = DdMhe(split.history, **_settings(from_file, given))
    at_first = list(est.warnings)
    _warn(samples, split, at_first)
    asked = len(split.Y)
    try:
        estimates = est.run(split.Y, split.U)
    except KeyboardInterrupt as e:
        estimates = e.finished  # type: ignore[attr-defined]
        samples, split = _cut(samples, split, len(estimates.x))
    trust = Trust.of_log(estimates)
    written = _write(csv, figure, samples, split, (estimates.x, trust))
    _warn(samples, split, [told for told in est.warnings if told not in at_first])
    console = Console()
    console.print(_summary(samples, split, est, estimates))
    if trust is not None:
        console.print(trust.words(est.promise), markup=False, highlight=False, soft_wrap=True)
    print_written(console, written)
    if len(estimates.x) < asked:
        raise click.Abort


def _warn(samples: Log, split: Split, warnings: list[str]) -> None:
    for sentence in in_words_of(samples.names, untold(samples, warnings), split.t):
        warn(sentence)


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
        replace(
            samples, **first(samples, ("t", "x", "y", "u", "lines", "samples", "y_lines"), end)
        ),
        replace(split, **first(split, ("Y", "t", "x_true", "U"), made)),
    )


def _targets(log: Path, out: Path | None, plot: Path | None) -> tuple[Path | None, Path | None]:
    """Paths of the CSV and of the figure, None for none."""
    if plot is not None and plot.suffix.lower() not in FIGURES:
        wanted = ", ".join(FIGURES)
        raise click.BadParameter(
            f"expected a file ending in {wanted}, found '{file_words(plot)}'", param_hint="--plot"
        )
    csv = out
    if out is not None and out.suffix.lower() != ".csv":
        csv, plot = out / "estimate.csv", plot or out / "estimate.png"
    if csv is not None and csv.exists() and log.exists() and csv.samefile(log):
        raise click.BadParameter(
            f"expected a file other than the log, found '{file_words(csv)}'", param_hint="--out"
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
    if given["start_from"] is not None:
        settings["start"] = given["start_from"]
    known = {"start", "warm_start", "x_prior"} & set(settings)
    if not known and (settings.get("evidence") is False or "disturbance" in settings):
        settings["start"] = "recording"  # the log goes on where its history ends
    if isinstance(given["space"], str):
        settings["space"] = space_from_text(given["space"])
    return settings


def _summary(log: Log, split: Split, est: DdMhe, estimates: Estimates) -> Any:
    """The table that is printed: settings, how the steps ended, what is promised, errors where the
    truth is known."""
    filled = int(np.sum(log.lines == 0))
    rows = {"history": f"T = {split.history.T} samples of {log.dt:.4g} s"}
    rows |= {"gaps filled": f"{filled} samples"} if filled else {}
    rows |= {f"delay of {name}": f"{seconds:.4g} s" for name, seconds in log.delay.items()}
    rows |= report.settings(est) | report.outcome(estimates.status, estimates.active)
    if estimates.bound is not None:
        rows["error bound"] = (
            f"{np.median(estimates.bound):.4g} median, {np.max(estimates.bound):.4g} at most"
        )
    if est.promise is not None:
        rows |= {
            f"promised rms {name}": "unknown" if np.isnan(value) else f"{value:.4g}"
            for name, value in zip(log.names.state, est.promise, strict=True)
        }
    if split.x_true is not None:
        rows |= _errors(log.names.state, split.history, estimates, split.x_true)
    return report.table(f"Estimates of {word(Path(log.path).name)}", {"": rows})


def _errors(
    names: Sequence[str], history: History, estimates: Estimates, x_true: Array
) -> dict[str, str]:
    """Errors against the states of the log, and the share of them that the bars hold, as label and
    text."""
    errors = report.rmse(estimates.x - x_true)
    rows = {f"RMSE {name}": f"{value:.4g}" for name, value in zip(names, errors, strict=True)}
    relative = report.nrmse(estimates.x, x_true)
    rows |= {f"NRMSE {name}": f"{value:.4f}" for name, value in zip(names, relative, strict=True)}
    rows["NRMSE"] = f"{report.root_mean_square(relative):.4f}"
    if len(relative) > 1 and len(set(history.x_units)) == 1 and history.x_units[0]:
        rows["NRMSE pooled"] = f"{report.pooled_nrmse(estimates.x, x_true):.4f}"
    trust = Trust.of_log(estimates)
    if trust is not None:
        rows |= trust.within(estimates.x - x_true)
    return rows


def _write(
    csv: Path | None,
    figure: Path | None,
    log: Log,
    split: Split,
    estimated: tuple[Array, Trust | None],
) -> list[Path]:
    """One CSV row per row of the log after the history; the figure also shows the estimates inside
    filled gaps."""
    x_hat, trust = estimated
    if csv is not None:
        csv.parent.mkdir(parents=True, exist_ok=True)
        logged = log.lines[-len(split.t) :] > 0
        names = log.names.state
        beside = {} if trust is None else trust.rows(logged).columns(log.names.time, names)
        report.write_estimates(csv, log.names.time, split.t[logged], names, x_hat[logged], beside)
    if figure is not None:
        from ddmhe.report.figures import estimate_figure
        from ddmhe.report.style import caption

        figure.parent.mkdir(parents=True, exist_ok=True)
        T = len(log.t) - len(split.t) - 1
        recorded = (log.t[: T + 1], log.x[: T + 1])
        drawing = estimate_figure(
            split.t,
            x_hat,
            split.x_true,
            history=recorded,
            names=[caption(name) for name in log.names.state],
            quantity="state (unit of the log)",
            trust=trust,
        )
        report.save_figure(drawing, figure)
    return [path for path in (csv, figure) if path is not None]
