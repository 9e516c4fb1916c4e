"""``ddmhe estimate``: the states of a log from its outputs."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from ddmhe.checks import file_words
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.estimated import facts, summary, write_files
from ddmhe.cli.estimators import choose, estimator_option
from ddmhe.cli.follow import follow
from ddmhe.cli.in_force import who_gave
from ddmhe.cli.metadata import metadata, read_as
from ddmhe.cli.options import log_options
from ddmhe.cli.page import (
    check_page,
    report_option,
    rerun_option,
    step_times,
    write_page_of,
    write_recording_of,
)
from ddmhe.cli.reading import read, untold
from ddmhe.cli.running import run
from ddmhe.cli.settings import OF_ESTIMATOR, setting_options, settings_from_file, settings_of
from ddmhe.cli.telling import in_words_of
from ddmhe.files import check_writable
from ddmhe.recordings import Log, Recorded
from ddmhe.report.estimates_file import check_ending, described_in
from ddmhe.report.trust import Trust
from ddmhe.report.viewer import check_recording

__all__ = ["command"]


FIGURES = (".png", ".pdf", ".svg")


@click.command("estimate", short_help="The states of a log from its outputs.")
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
@report_option
@rerun_option
@estimator_option
@setting_options
@click.option("--follow", is_flag=True, help="LOG is still being written: a line in, one out.")
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="With --follow: go on from what a signal left here.",
)
@answers
def command(
    answer: Answer,
    log: Path,
    out: Path | None,
    plot: Path | None,
    page: Path | None,
    viewed: Path | None,
    config: Path | None,
    **given: Any,
) -> None:
    """Estimate the states of a log from its outputs, and known inputs if there are any, after a
    history in which both were recorded.

    LOG is a CSV in any habit, Parquet, Feather, HDF5, MAT, MCAP, npz or JSON lines; "-" is standard
    input. Writes a row for every step: time, states, STATE_std, `trusted` (1 or 0), `reasons`
    (novel, uncertain, stuck, outside, joined by +), `status`, OUTPUT_innovation, and STATE_true
    where the log holds the states; prints the errors then."""
    resume, live, kind = given.pop("resume"), given.pop("follow"), given.pop("estimator")
    if resume is not None and not live:
        raise click.UsageError("--resume: expected with --follow, found alone")
    own = {key: given.pop(key) for key in OF_ESTIMATOR}
    from_file = settings_from_file(config, given)
    if live:
        for option, place in (("--report", page), ("--rerun", viewed)):
            if place is not None:
                raise click.BadParameter("expected without --follow, found both", param_hint=option)
        if kind != "dd":
            raise click.BadParameter("expected dd with --follow", param_hint="--estimator")
        _follow(answer, log, out, plot, given, (from_file, own), resume)
        return
    check_page(page)
    if viewed is not None:
        check_recording(viewed, "--rerun")
    target, figure = _targets(log, out, plot)
    described = None if target is None else described_in(target)
    places = (target, described, figure, page, viewed)
    replaced = [path for path in places if path is not None and path.exists()]
    how = read_as(given)
    samples, split = read(answer, log, given)
    named = settings_of(from_file, own, samples.names, split.goes_on)
    with answer.working("preparing"):
        chosen = choose(kind, split, named)
    est = chosen.est
    at_first = list(est.warnings)
    _warn(answer, samples, split, at_first)
    asked = len(split.Y)
    fresh = None if page is None else replace(chosen, est=copy(est))
    begin = time.perf_counter()
    estimates = run(answer, chosen.runner(split.Y, split.U), asked)
    took = time.perf_counter() - begin
    if len(estimates.x) < asked:
        answer.stop()
        samples, split = _cut(samples, split, len(estimates.x))
    about = metadata(split, chosen.in_force(), named, how, est.warnings)
    written = write_files(target, figure, split, estimates, about)
    if page is not None and fresh is not None:
        told = list(in_words_of(samples.names, est.warnings, split.t))
        times = step_times(fresh, split, took)
        written.append(write_page_of(page, split, (est, estimates), about, told, times))
    if viewed is not None:
        written.append(write_recording_of(viewed, split, (est, estimates)))
    _warn(answer, samples, split, [told for told in est.warnings if told not in at_first])
    marks = chosen.rows(who_gave(from_file, own, config))
    answer.show(summary(samples, split, chosen.promise, estimates, marks))
    chosen.say_more(answer)
    trust = Trust.of_log(estimates)
    if trust is not None:
        answer.say(trust.words(chosen.promise))
    answer.facts(**{k: v for k, v in about.items() if k not in ("ddmhe", "warnings", "notes")})
    answer.facts(**facts(split, chosen.promise, estimates, chosen.facts()))
    answer.wrote(written, replaced)
    if not written:
        answer.say("nothing was written; --out estimate.csv writes the estimates")


def _follow(
    answer: Answer,
    log: Path,
    out: Path | None,
    plot: Path | None,
    given: dict[str, Any],
    settings: tuple[Mapping[str, Any], Mapping[str, Any]],
    resume: Path | None,
) -> None:
    """A log that is still being written."""
    if plot is not None:
        raise click.BadParameter("expected without --follow, found both", param_hint="--plot")
    if answer.as_json:
        raise click.BadParameter(
            "expected without --follow, whose lines are JSON where the log's are, found both",
            param_hint="--json",
        )
    if out is not None:
        check_writable(out)
    follow(
        answer,
        log,
        given,
        lambda names, goes_on: settings_of(*settings, names, goes_on),
        out,
        resume,
    )


def _warn(answer: Answer, samples: Log, split: Recorded, warnings: list[str]) -> None:
    for sentence in in_words_of(samples.names, untold(samples, warnings), split.t):
        answer.warn(sentence)


def _cut(samples: Log, split: Recorded, made: int) -> tuple[Log, Recorded]:
    """The log as if it ended with the last of `made` estimates; says so."""
    left_out = len(split.Y) - made
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
