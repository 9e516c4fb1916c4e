"""The page on a run over a log, which `estimate --report`, `interval --report` and `report`
write."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np

from ddmhe import report
from ddmhe.checks import file_words
from ddmhe.cli.estimators import Chosen
from ddmhe.files import check_writable
from ddmhe.recordings import Recorded
from ddmhe.report.web import Source, StepTimes

__all__ = [
    "check_page",
    "report_option",
    "rerun_option",
    "step_times",
    "write_page_of",
    "write_recording_of",
]

SINGLE = 1000
"""Steps that are timed one by one."""

report_option = click.option(
    "--report",
    "page",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Where a page on the run goes: one file, charts and all.",
)


rerun_option = click.option(
    "--rerun",
    "viewed",
    type=click.Path(path_type=Path),
    metavar="FILE.rrd",
    help="The run for the Rerun viewer; three rates turn a box.",
)


def check_page(path: Path | None, option: str = "--report") -> None:
    """An error for a page that cannot be written, before anything is computed."""
    if path is None:
        return
    if path.suffix.lower() not in (".html", ".htm"):
        raise click.BadParameter(
            f"expected a file ending in .html, found '{file_words(path)}'", param_hint=option
        )
    check_writable(path)


def step_times(fresh: Chosen, split: Recorded, took: float) -> StepTimes:
    """Times of the run, which took so many seconds, and of its first steps made one by one by an
    estimator as it was before."""
    single = []
    for k in range(min(len(split.Y), SINGLE)):
        begin = time.perf_counter()
        fresh.step(split.Y, split.U, k)
        single.append(time.perf_counter() - begin)
    return StepTimes(took / max(len(split.Y), 1), np.array(single))


def write_page_of(
    path: Path,
    split: Recorded,
    made: tuple[Any, Any],
    about: Mapping[str, Any],
    warnings: list[str] | None,
    times: StepTimes | None = None,
) -> Path:
    """Write the page on an estimator and what its run returned, `made`; `about`: what the files
    hold as metadata."""
    log = split.log
    T = len(log.t) - len(split.t) - 1
    source = Source(
        log=file_words(Path(log.path).name),
        history=split.history,
        recorded=(log.t[: T + 1], log.x[: T + 1]) if T > 0 else None,
        command=shlex.join(["ddmhe", *sys.argv[1:]]),
        facts=_facts(split, about),
        warnings=warnings,
        times=times,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    est, estimates = made
    units = {name: log.unit(name) for name in (*split.names.state, *split.names.output)}
    truth = None if split.x_true is None else split.x_true[: len(estimates.x)]
    report.html(
        est, estimates, path, truth=truth, t=split.t[: len(estimates.x)], names=split.names,
        units=units, source=source,
    )  # fmt: skip
    return path


def write_recording_of(path: Path, split: Recorded, made: tuple[Any, Any]) -> Path:
    """Write what the Rerun viewer shows of an estimator and what its run returned, `made`."""
    est, estimates = made
    path.parent.mkdir(parents=True, exist_ok=True)
    units = {name: split.log.unit(name) for name in (*split.names.state, *split.names.output)}
    count = len(estimates.x)
    truth = None if split.x_true is None else split.x_true[:count]
    names = {"state": split.names.state, "output": split.names.output}
    return report.rerun(
        est, estimates, path, truth=truth, t=split.t[:count], names=names, units=units
    )


def _facts(split: Recorded, about: Mapping[str, Any]) -> dict[str, str]:
    """Version, files and their hashes, how they were read, settings that were named."""
    facts = {"ddmhe": version("ddmhe")}
    for k, one in enumerate((split.log, *split.recordings)):
        name = "log" if k == 0 else f"recording {k}"
        facts[name] = file_words(one.path)
        facts[f"SHA-256 of the {name}"] = one.digest or "not a file"
    facts["columns"] = "; ".join(
        f"{kind}: {', '.join(found)}"
        for kind in ("state", "output", "input")
        if (found := getattr(split.names, kind))
    )
    facts["read with"] = json.dumps(about["reading"], default=str) if about.get("reading") else ""
    facts["inferred in reading"] = "; ".join(split.notes)
    facts["settings that were named"] = json.dumps(about["named"]) if about.get("named") else ""
    return {key: text for key, text in facts.items() if text}
