"""The page on a run: which sections it has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ddmhe._core import History, IntervalLog
from ddmhe.files import check_writable
from ddmhe.logs import Names
from ddmhe.report.web.document import write_page
from ddmhe.report.web.evidence import evidence_section
from ddmhe.report.web.intervals import (
    bounds_section,
    interval_summary,
    observer_section,
    verdict_section,
)
from ddmhe.report.web.models import lifted_section, rigid_section
from ddmhe.report.web.parts import Page, Section
from ddmhe.report.web.run import Run, Source, run_of
from ddmhe.report.web.setup import (
    again_section,
    recording_section,
    settings_section,
    steps_section,
    warnings_section,
)
from ddmhe.report.web.states import doubt_section, doubts_of, error_section, state_section
from ddmhe.report.web.summary import summary

__all__ = ["html", "page_of"]


def html(
    est: object,
    log: object,
    path: str | Path,
    *,
    truth: ArrayLike | None = None,
    t: ArrayLike | None = None,
    names: Names | Mapping[str, Sequence[str]] | Sequence[str] | None = None,
    units: Mapping[str, str] | Sequence[str] | None = None,
    history: History | None = None,
    source: Source | None = None,
) -> None:
    """Write a page on a run that is read without anything else: one HTML file with its charts,
    which loads nothing from elsewhere.

    Parameters
    ----------
    est
        The estimator, after the run.
    log
        What its `run` returned, N estimates.
    path
        Where the page goes.
    truth
        True states (N, n), NaN where unknown.
    t
        Times of the estimates (N,), s; default: the log's, or steps.
    names
        Names of the states (n), or {"state": …, "output": …}, or `Recorded.names`.
    units
        Units of the states (n), or by the names of channels; default: the recording's.
    history
        The recording that was learnt from: the page then has its rank and singular values.
    source
        What else is known of where the run comes from.

    Raises
    ------
    ShapeError, NotFiniteError, DdmheError
        Arguments that do not fit.
    FileError
        The page cannot be written there.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> estimator = ddmhe.DdMhe(record.history(200))
    >>> log = estimator.run(record.y[200:300])
    >>> ddmhe.report.html(estimator, log, "page.html", truth=record.x[201:301])
    """
    check_writable(path)
    known = Source() if source is None else source
    if history is not None:
        known = known.with_history(history)
    run = run_of(est, log, truth=truth, t=t, names=names, units=units, source=known)
    with np.errstate(over="ignore", invalid="ignore"):  # of estimates that have left all bounds
        page = page_of(run)
        write_page(path, page)


def page_of(run: Run) -> Page:
    """Title, summary and sections of a run."""
    intervals = isinstance(run.log, IntervalLog)
    kind = "Intervals" if intervals else "Estimates"
    recorded = run.source.recorded
    return Page(
        title=f"{kind} of {run.source.log}" if run.source.log else kind,
        summary=interval_summary(run) if intervals else summary(run),
        sections=_interval_sections(run) if intervals else _sections(run),
        t=run.t,
        time_label=run.time_label,
        recorded_t=np.zeros(0) if recorded is None else recorded[0],
        doubts=doubts_of(run),
    )


def _sections(run: Run) -> list[Section]:
    """Of estimates."""
    found = (
        state_section(run),
        error_section(run),
        doubt_section(run),
        evidence_section(run),
        rigid_section(run),
        lifted_section(run),
        recording_section(run),
        settings_section(run),
        steps_section(run),
        warnings_section(run),
        again_section(run),
    )
    return [section for section in found if section is not None]


def _interval_sections(run: Run) -> list[Section]:
    """Of guaranteed bounds."""
    found = (
        bounds_section(run),
        verdict_section(run),
        observer_section(run),
        warnings_section(run),
        again_section(run),
    )
    return [section for section in found if section is not None]
