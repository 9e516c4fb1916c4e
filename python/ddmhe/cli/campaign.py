"""``ddmhe campaign``: many cases on Dask's workers. Dask and what stores results are loaded when a
command runs."""

from __future__ import annotations

import atexit
import logging
import os
import sys
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any

import click

from ddmhe.checks import file_words
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.interrupts import GRACE, STOPPED
from ddmhe.cli.page import check_page, report_option
from ddmhe.cli.watching import length, watching

if TYPE_CHECKING:
    from ddmhe.campaign import Campaign, Spec

__all__ = ["command"]

UNITS = ("bytes", "kB", "MB", "GB", "TB")
TOLD = ("rmse_all", "nees_all", "within_3sd", "inside", "trusted", "unnoticed", "status",
        "settings")  # fmt: skip
"""What is told of a case that is run again, as far as it is known."""


@click.group("campaign", short_help="Thousands of cases on this machine or a cluster.")
def command() -> None:
    """Thousands of cases, on the workers of this machine or of a Dask cluster: systems, noise,
    faults, estimators and seeds as a TOML file names them (docs/campaigns.md)."""


@command.command("run")
@click.argument("spec", required=False, type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder of a new campaign."
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder of a campaign to go on with; a spec beside it must be the same.",
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="A Dask scheduler.  [default: one on this machine]"
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes on this machine.  [default: one a core]",
)
@click.option("--dry-run", is_flag=True, help="Say what it would take, from a few timed cases.")
@answers
def _run(answer: Answer, spec: Path | None, **given: Any) -> None:
    """Run the cases of a SPEC, or go on with those that a folder lacks.

    A case that fails is a row with its error. All that is finished is kept whatever happens:
    Ctrl-C, a killed worker, scheduler or client; --resume runs the rest, and what comes out is the
    same, bit for bit."""
    from ddmhe.campaign import read_spec, run

    out, resume = given["out"], given["resume"]
    if spec is None and resume is None:
        raise click.UsageError("Missing argument 'SPEC' (or option '--resume').")
    if given["dry_run"]:
        _dry(answer, read_spec(spec) if spec is not None else _resumed(resume))
        return
    if (out is None) == (resume is None):
        raise click.UsageError("expected one of '--out' and '--resume'")
    folder = out if resume is None else resume
    if given["scheduler"] is not None and given["workers"] is not None:
        raise click.UsageError("expected one of '--scheduler' and '--workers'")
    try:
        with watching(answer) as tell:
            campaign = run(
                spec, folder, scheduler=given["scheduler"], resume=resume is not None,
                workers=given["workers"], progress=tell,
            )  # fmt: skip
    except KeyboardInterrupt:
        _end_soon()
        answer.say(
            f"stopped; finished parts are kept: ddmhe campaign run --resume {file_words(folder)}"
        )
        answer.stop()
        return
    _tell(answer, campaign)


def _end_soon() -> None:
    """Dask's own end waits for workers, which are gone, and says so."""

    def end() -> None:
        sys.stdout.flush()
        os._exit(STOPPED)

    logging.disable()
    clusters = sys.modules.get("distributed.deploy.spec")  # not yet where it came early
    if clusters is not None:
        atexit.unregister(clusters.close_clusters)
    timer = Timer(GRACE, end)
    timer.daemon = True
    timer.start()


def _resumed(folder: Path) -> Spec:
    from ddmhe.campaign import open as open_campaign

    return open_campaign(folder).spec


def _dry(answer: Answer, spec: Spec) -> None:
    """What a campaign would take."""
    from ddmhe.campaign.dry import forecast

    with answer.working("timing"):
        found = forecast(spec)
    answer.say(f"{found.cases} cases in {found.parts} parts; spec {spec.hash[:12]}")
    answer.say(
        f"from {found.timed} timed cases: {length(found.seconds)} on one worker, "
        f"{length(found.part_seconds)} for the longest part, at most {_size(found.bytes)}"
    )
    answer.facts(
        hash=spec.hash, cases=found.cases, parts=found.parts, timed=found.timed,
        seconds=found.seconds, part_seconds=found.part_seconds, bytes=found.bytes,
    )  # fmt: skip


def _size(count: float) -> str:
    unit = 0
    while count >= 1000 and unit + 1 < len(UNITS):
        count, unit = count / 1000, unit + 1
    return f"{count:.3g} {UNITS[unit]}"


def _tell(answer: Answer, campaign: Campaign) -> None:
    """How a campaign ended."""
    outcomes = campaign.rows["outcome"].value_counts().sort_index()
    words = ", ".join(f"{count} {name}" for name, count in outcomes.items())
    answer.say(f"{len(campaign.rows)} of {campaign.spec.cases} cases: {words}")
    answer.say(f"wrote {file_words(campaign.folder)}")
    answer.facts(
        hash=campaign.spec.hash, cases=campaign.spec.cases, finished=len(campaign.rows),
        outcomes={str(name): int(count) for name, count in outcomes.items()},
        folder=str(campaign.folder),
    )  # fmt: skip


@command.command("report")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Another campaign: exit code 1 where this one is worse.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Where the page goes.  [default: report.html in the folder]",
)
@answers
def _report(answer: Answer, folder: Path, against: Path | None, out: Path | None) -> None:
    """Write a page on the campaign of a FOLDER: distributions, errors over time, consistency, the
    worst cases with what runs them again, failures."""
    from ddmhe.campaign import open as open_campaign
    from ddmhe.campaign.page import write_campaign

    campaign = open_campaign(folder)
    found = None if against is None else campaign.compare(open_campaign(against))
    path = folder / "report.html" if out is None else out
    check_page(path, "--out")
    with answer.working("writing"):
        write_campaign(campaign, path, found)
    answer.wrote([path])
    worse = [one for one in found or [] if one.reasons]
    for one in worse:
        answer.say(f"worse: {one.estimator} on {one.system}: {'; '.join(one.reasons)}")
    if against is not None:
        if not worse:
            answer.say(f"no estimator is worse than in {file_words(against)}")
        answer.facts(worse=[
            {"system": one.system, "estimator": one.estimator, "reasons": one.reasons}
            for one in worse
        ])  # fmt: skip
    if worse:
        answer.end()
        click.get_current_context().exit(1)


@command.command("replay")
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("case", type=click.IntRange(min=0))
@report_option
@answers
def _replay(answer: Answer, folder: Path, case: int, page: Path | None) -> None:
    """Run one CASE of the campaign of a FOLDER again, and compare it with its row."""
    from ddmhe.campaign import open as open_campaign
    from ddmhe.campaign.replay import replay

    check_page(page)
    found = replay(open_campaign(folder), case, page)
    row = found.row
    answer.say(f"case {case}: {row['estimator']} on {row['system']}, noise {row['noise']}, fault "
               f"{row['fault']}, seed {row['seed']}: {row['outcome']} {row['error']}")  # fmt: skip
    for name in TOLD:
        value = row.get(name)
        if value not in (None, "{}") and value == value:
            answer.say(f"{name}: {value}")
    if found.differs is None:
        answer.say("the campaign has no row of it yet")
    elif found.differs:
        answer.warn(f"case {case}: the campaign has another {', '.join(found.differs)}")
    else:
        answer.say("the same as its row, bit for bit")
    if page is not None and found.log is not None:
        answer.wrote([page])
    answer.facts(row=row, differs=found.differs)
