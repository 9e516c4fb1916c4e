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
from ddmhe.cli.follow import follow
from ddmhe.cli.metadata import metadata, read_as
from ddmhe.cli.options import deviations, gate, log_options
from ddmhe.cli.printing import print_written, warn
from ddmhe.cli.reading import print_notes, read, untold
from ddmhe.cli.telling import in_words_of
from ddmhe.config import READING, read_config, space_from_text
from ddmhe.files import check_writable
from ddmhe.recordings import Log, Recorded
from ddmhe.report.estimates_file import EstimatesFile, check_ending, write_estimates_file
from ddmhe.report.trust import Trust

Array = NDArray[np.float64]

__all__ = ["command"]


OF_ESTIMATOR = (
    "horizon",
    "rho",
    "mu",
    "space",
    "start_from",
    "warm_start",
    "output_noise",
    "evidence",
    "gate",
    "stuck",
)
"""Options that are the estimator's."""
FIGURES = (".png", ".pdf", ".svg")


@click.command("estimate")
@log_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE|DIR",
    help="Estimates: .csv, .parquet, .npz or .mat.",
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
@click.option("--follow", is_flag=True, help="LOG is still being written: a line in, one out.")
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="With --follow: go on from what a signal left here.",
)
def command(
    log: Path, out: Path | None, plot: Path | None, config: Path | None, **given: Any
) -> None:
    """Estimate the states of a log from its outputs, and known inputs if there are any, after a
    history in which both were recorded.

    LOG is a CSV in any habit, Parquet, Feather, HDF5, MAT, MCAP, npz or JSON lines; "-" is standard
    input. Writes a row for every step: time, states, STATE_std, `trusted` (1 or 0), `reasons`
    (novel, uncertain, stuck, outside, joined by +), `status`, OUTPUT_innovation, and STATE_true
    where the log holds the states; prints the errors then."""
    resume, live = given.pop("resume"), given.pop("follow")
    if resume is not None and not live:
        raise click.UsageError("--resume: expected with --follow, found alone")
    if live:
        _follow(log, out, plot, config, given, resume)
        return
    target, figure = _targets(log, out, plot)
    replaced = [path for path in (target, figure) if path is not None and path.exists()]
    from_file = _from_file(config, given)
    how = read_as(given)
    samples, split = read(log, given)
    named = _settings(from_file, given, split.goes_on)
    est = DdMhe(split.history, **named)
    at_first = list(est.warnings)
    _warn(samples, split, at_first)
    asked = len(split.Y)
    try:
        estimates = est.run(split.Y, split.U)
    except KeyboardInterrupt as e:
        estimates = e.finished  # type: ignore[attr-defined]
        samples, split = _cut(samples, split, len(estimates.x))
    trust = Trust.of_log(estimates)
    about = metadata(split, est, named, how)
    written = _write(target, figure, split, estimates, about)
    _warn(samples, split, [told for told in est.warnings if told not in at_first])
    console = Console()
    print_notes(console, split)
    console.print(_summary(samples, split, est, estimates))
    if trust is not None:
        console.print(trust.words(est.promise), markup=False, highlight=False, soft_wrap=True)
    print_written(console, written, replaced)
    if not written:
        console.print("nothing was written; --out estimate.csv writes the estimates", markup=False)
    if len(estimates.x) < asked:
        raise click.Abort


def _follow(
    log: Path,
    out: Path | None,
    plot: Path | None,
    config: Path | None,
    given: dict[str, Any],
    resume: Path | None,
) -> None:
    """A log that is still being written."""
    from_file = _from_file(config, given)
    if plot is not None:
        raise click.BadParameter("expected without --follow, found both", param_hint="--plot")
    if out is not None:
        check_writable(out)
    own = {key: value for key, value in given.items() if key in OF_ESTIMATOR}
    follow(log, given, lambda goes_on: _settings(from_file, own, goes_on), out, resume)


def _from_file(config: Path | None, given: dict[str, Any]) -> dict[str, Any]:
    """Settings of a file; those that say how to read a log become options."""
    from_file = {} if config is None else read_config(config)
    for key in READING:
        found = from_file.pop(key, None)
        given[key] = found if given[key] is None else given[key]
    return from_file


def _warn(samples: Log, split: Recorded, warnings: list[str]) -> None:
    for sentence in in_words_of(samples.names, untold(samples, warnings), split.t):
        warn(sentence)


def _cut(samples: Log, split: Recorded, made: int) -> tuple[Log, Recorded]:
    """The log as if it ended with the last of `made` estimates; says so."""
    left_out = len(split.Y) - made
    if made == 0:
        raise KeyboardInterrupt
    print(f"ddmhe: stopped: {made} of {len(split.Y)} samples were estimated", file=sys.stderr)
    end = len(samples.t) - left_out

    def first(whole: Log | Recorded, names: tuple[str, ...], rows: int) -> dict[str, Any]:
        parts = {name: getattr(whole, name) for name in names}
        return {name: part if part is None else part[:rows] for name, part in parts.items()}

    log = replace(
        samples, **first(samples, ("t", "x", "y", "u", "lines", "samples", "y_lines"), end)
    )
    parts = first(split, ("Y", "t", "x_true", "U", "stamps"), made)
    return log, replace(split, log=log, **parts)


def _targets(log: Path, out: Path | None, plot: Path | None) -> tuple[Path | None, Path | None]:
    """Paths of the estimates and of the figure, None for none; an error for one that cannot be
    written, before anything is computed."""
    if plot is not None and plot.suffix.lower() not in FIGURES:
        wanted = ", ".join(FIGURES)
        raise click.BadParameter(
            f"expected a file ending in {wanted}, found '{file_words(plot)}'", param_hint="--plot"
        )
    if out is not None and (out.suffix == "" or out.is_dir()):
        out, plot = out / "estimate.csv", plot or out / "estimate.png"
    if out is not None:
        check_ending(out)
        if out.exists() and log.exists() and out.samefile(log):
            raise click.BadParameter(
                f"expected a file other than the log, found '{file_words(out)}'", param_hint="--out"
            )
    for target in (out, plot):
        if target is not None:
            check_writable(target)
    return out, plot


def _settings(from_file: dict[str, Any], given: dict[str, Any], goes_on: bool) -> dict[str, Any]:
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
    if not known and not goes_on:
        settings["start"] = "unknown"  # another log than the recorded one begins anywhere
    elif not known and (settings.get("evidence") is False or "disturbance" in settings):
        settings["start"] = "recording"  # the log goes on where its history ends
    if isinstance(given["space"], str):
        settings["space"] = space_from_text(given["space"])
    return settings


def _summary(log: Log, split: Recorded, est: DdMhe, estimates: Estimates) -> Any:
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
    rows |= _rejected(log.names.output, estimates)
    if est.promise is not None:
        rows |= {
            f"promised rms {name}": "unknown" if np.isnan(value) else f"{value:.4g}"
            for name, value in zip(log.names.state, est.promise, strict=True)
        }
    if split.x_true is not None:
        rows |= _errors(log.names.state, split.history, estimates, split.x_true)
    return report.table(f"Estimates of {word(Path(log.path).name)}", {"": rows})


def _rejected(names: Sequence[str], estimates: Estimates) -> dict[str, str]:
    """How many outputs a gate left out, and how often the run started again."""
    if estimates.evidence is None:
        return {}
    counts = estimates.evidence.gated.sum(axis=0)
    rows = {f"rejected {name}": str(n) for name, n in zip(names, counts, strict=True) if n}
    again = int(estimates.evidence.restarted.sum())
    return rows | ({"started again": f"{again} times"} if again else {})


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
    out: Path | None, figure: Path | None, split: Recorded, estimates: Estimates, metadata: Any
) -> list[Path]:
    """A row for every step; the figure, too."""
    written = []
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        written += write_estimates_file(out, EstimatesFile.of(split, estimates, metadata))
    if figure is not None:
        from ddmhe.report.figures import estimate_figure
        from ddmhe.report.style import caption

        log, T = split.log, len(split.log.t) - len(split.t) - 1
        figure.parent.mkdir(parents=True, exist_ok=True)
        drawing = estimate_figure(
            split.t,
            estimates.x,
            split.x_true,
            history=(log.t[: T + 1], log.x[: T + 1]),
            names=[caption(name) for name in log.names.state],
            quantity="state (unit of the log)",
            trust=Trust.of_log(estimates),
        )
        report.save_figure(drawing, figure)
        written.append(figure)
    return written
