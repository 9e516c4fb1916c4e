"""Sections on what was estimated: states over time, and where they are in doubt."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.reasons import Reason
from ddmhe.report.measures import nrmse, rmse
from ddmhe.report.trust import BARS
from ddmhe.report.web.numbers import number, percent, seconds, times, with_unit
from ddmhe.report.web.parts import Chart, Curve, Section, Table, Text
from ddmhe.report.web.run import Run
from ddmhe.report.web.summary import SAYS
from ddmhe.report.web.thinning import Spans

Array = NDArray[np.float64]

__all__ = ["doubt_section", "doubts_of", "error_section", "reach", "state_section"]

LISTED = 12
"""Spans of doubt that a table has."""


def reach(known: Array, drawn: Array) -> tuple[float, float] | None:
    """What is shown at first: all that is drawn, but at most three times the known range, so that
    an estimate that diverges hides nothing."""
    known, drawn = known[np.isfinite(known)], drawn[np.isfinite(drawn)]
    if not known.size or not drawn.size:
        return None
    lo, hi = float(known.min()), float(known.max())
    room = (hi - lo) or abs(hi) or 1.0
    bottom, top = max(float(drawn.min()), lo - room), min(float(drawn.max()), hi + room)
    bottom, top = min(bottom, lo), max(top, hi)
    return bottom - 0.05 * room, top + 0.05 * room


def state_section(run: Run) -> Section:
    """A panel a state: estimate with its band, truth, the recording before it."""
    std = getattr(run.log, "std", None)
    recorded = run.source.recorded
    charts: list[Any] = []
    for i, channel in enumerate(run.states):
        x = run.x[:, i]
        curves = []
        known = [x] if recorded is None and run.truth is None else []
        if recorded is not None:
            curves.append(Curve("recorded", "recorded", recorded[1][:, i], at="recording"))
            known.append(recorded[1][:, i])
        if std is not None:
            room = BARS * std[:, i]
            curves.append(Curve(f"± {BARS:g} sd", "band", x - room, x + room))
        if run.truth is not None:
            curves.append(Curve("true", "truth", run.truth[:, i]))
            known.append(run.truth[:, i])
        curves.append(Curve("estimated", "estimate", x))
        drawn = x if std is None else np.concatenate([x - BARS * std[:, i], x + BARS * std[:, i]])
        view = reach(np.concatenate(known), np.concatenate([drawn, *known]))
        words = _seen(channel.label, x, None if std is None else std[:, i], channel.unit)
        charts.append(Chart(channel.label, words, curves, doubts=True, view=view))
    words = "Each panel is a state over time. The line is the estimate"
    words += f", the band around it {BARS:g} standard deviations" if std is not None else ""
    words += ", the broad line the truth as the log has it" if run.truth is not None else ""
    words += ", grey the recording that was learnt from" if recorded is not None else ""
    words += ". Shaded is time in doubt." if doubts_of(run) else "."
    return Section("estimate", "Estimate", [Text(words), *charts])


def _seen(label: str, x: Array, std: Array | None, unit: str) -> str:
    """A chart of a state in words."""
    known = x[np.isfinite(x)]
    if not known.size:
        return f"{label}: no finite estimate."
    text = f"Estimate of {label} over time, from {known.min():.4g} to {known.max():.4g}"
    if std is not None:
        text += (
            f"; standard deviation {with_unit(float(np.median(std)), unit)} in the median, "
            f"{with_unit(float(np.max(std)), unit)} at most"
        )
    return text + "."


def error_section(run: Run) -> Section | None:
    """Errors against the truth, with the bars they should stay within; None without a truth."""
    if run.truth is None:
        return None
    error, std = run.x - run.truth, getattr(run.log, "std", None)
    promise = getattr(run.est, "promise", None)
    trusted = getattr(run.log, "trusted", None)
    sizes, relative = rmse(error), nrmse(run.x, run.truth)
    rows, charts = [], []
    for i, channel in enumerate(run.states):
        curves, of = [], error[:, i]
        if std is not None:
            room = BARS * std[:, i]
            curves.append(Curve(f"± {BARS:g} sd", "band", -room, room))
        curves.append(Curve("error", "estimate", of))
        known = np.isfinite(of)
        size = with_unit(float(sizes[i]), channel.unit)
        charts.append(
            Chart(
                f"error of {channel.label}",
                f"Estimate less truth of {channel.label} over time: {size} rms.",
                curves,
                doubts=True,
                view=_error_view(of, None if std is None else room),
            )
        )
        cells = [channel.name, size, number(float(relative[i]))]
        cells.append("" if promise is None else with_unit(float(promise[i]), channel.unit))
        if std is not None and known.any():
            inside = np.abs(of) <= BARS * std[:, i]
            cells.append(percent(float(np.mean(inside[known]))))
            kept = known & np.asarray(trusted)
            cells.append(percent(float(np.mean(inside[kept]))) if kept.any() else "none trusted")
        else:
            cells += ["", ""]
        rows.append(cells)
    header = (
        "state", "rms error", "over its spread", "promised rms", f"within {BARS:g} sd",
        "while trusted",
    )  # fmt: skip
    said = [k for k in range(len(header)) if any(row[k] for row in rows)]
    rows = [[row[k] for k in said] for row in rows]
    names = tuple(header[k] for k in said)
    table = Table("Errors against the states that the log holds", names, rows)
    return Section("errors", "Errors against the truth", [table, *charts])


def _error_view(error: Array, room: Array | None) -> tuple[float, float] | None:
    """What is shown of an error at first: all of it, and of its bars what is not far beyond."""
    known = np.abs(error[np.isfinite(error)])
    if not known.size or not known.max():
        return None
    most = 1.1 * float(known.max())
    if room is not None and np.isfinite(room).any():
        most = max(most, min(1.05 * float(np.nanmax(room)), 4 * most))
    return -most, most


def doubts_of(run: Run) -> dict[str, Spans]:
    """Time in doubt by the reason's name; reasons that there are."""
    reasons = getattr(run.log, "reasons", None)
    if reasons is None:
        return {}
    found = {
        str(reason.name).lower(): run.spans(np.asarray(reasons) & reason != 0) for reason in Reason
    }
    return {name: spans for name, spans in found.items() if spans}


def doubt_section(run: Run) -> Section | None:
    """When and why an estimate is in doubt; None without evidence."""
    reasons = getattr(run.log, "reasons", None)
    if reasons is None:
        return None
    doubts = doubts_of(run)
    if not doubts:
        words = "The run stays like the recording: nothing speaks against any estimate."
        return Section("doubt", "Where the log leaves the recording", [Text(words)])
    reasons = np.asarray(reasons)
    rows = [
        (
            name,
            SAYS[Reason[name.upper()]],
            percent(float(np.mean(reasons & Reason[name.upper()] != 0))),
            "no" if name == "outside" else "yes",
        )
        for name in doubts
    ]
    kinds = Table(
        "What speaks against estimates",
        ("reason", "it says", "share of the run", "takes trust away"),
        rows,
    )
    alt = "Bars over time for each reason: " + "; ".join(
        f"{name} {times(len(spans))}, first from {seconds(spans[0][0], run.time_label)}"
        for name, spans in doubts.items()
    )
    lanes = Chart("reasons for doubt", f"{alt}.", [], lanes=doubts)
    spans = sorted((a, b, name) for name, found in doubts.items() for a, b in found)
    shown = [
        (seconds(a, run.time_label), seconds(b, run.time_label), name)
        for a, b, name in spans[:LISTED]
    ]
    more = f", the first {LISTED} of {len(spans)}" if len(spans) > LISTED else ""
    table = Table(f"Time in doubt{more}", ("from", "to", "reason"), shown)
    return Section("doubt", "Where the log leaves the recording", [kinds, lanes, table])
