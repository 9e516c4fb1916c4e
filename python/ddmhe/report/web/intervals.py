"""Sections on a run of an interval observer: bounds, their widths, what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.report.tables import observer_design
from ddmhe.report.web.numbers import listed, number, seconds, with_unit
from ddmhe.report.web.parts import Chart, Curve, Section, Table, Text
from ddmhe.report.web.run import Run
from ddmhe.report.web.states import reach

Array = NDArray[np.float64]

__all__ = ["bounds_section", "interval_summary", "observer_section", "verdict_section"]


def interval_summary(run: Run) -> list[str]:
    """What was bounded, whether the bounds held, what they say."""
    states = listed([channel.name for channel in run.states])
    log = f" of {run.source.log}" if run.source.log else ""
    span = f"{seconds(run.t[0], run.time_label)} to {seconds(run.t[-1], run.time_label)}"
    first = (
        f"Bounds of {states}{log} were computed at {len(run.t)} samples, {span}; they hold for "
        "every motion that the model and the stated radii allow."
    )
    return [first, _held(run), _said(run)]


def _held(run: Run) -> str:
    """The second sentence: did model and bounds hold?"""
    violation = getattr(run.log, "violation", None)
    if violation is not None:
        return f"The run ends there because an output contradicts model and radii: {violation}."
    if run.truth is None:
        return (
            "No output contradicts model and radii; the log holds no true states to compare with."
        )
    outside, known = _outside(run)
    if outside == 0:
        return (
            f"No output contradicts model and radii, and the bounds hold all {known} true states."
        )
    return (
        f"No output contradicts model and radii, yet {outside} of {known} true states are outside "
        "of the bounds: model or radii do not hold for this log."
    )


def _outside(run: Run) -> tuple[int, int]:
    """Rows with a true state outside of its bounds, and rows that are known."""
    assert run.truth is not None
    known = np.isfinite(run.truth)
    beyond = ((run.truth < run.log.lower) | (run.truth > run.log.upper)) & known
    return int(beyond.any(axis=1).sum()), int(known.any(axis=1).sum())


def _widths(run: Run) -> Array:
    """Full widths (N, n)."""
    with np.errstate(over="ignore"):
        return np.asarray(run.log.upper - run.log.lower)


def _said(run: Run) -> str:
    """The third sentence: how narrow the bounds are."""
    verdict = _verdict(run)
    if verdict is not None:
        useful = "narrow enough to be of use" if verdict.useful else "too wide to be of use"
        return f"The bounds are {useful}: {verdict.words}."
    middle = np.median(_widths(run), axis=0)
    texts = [
        f"{with_unit(float(width), c.unit)} for {c.name}"
        for c, width in zip(run.states, middle, strict=True)
    ]
    return f"Their full width is {listed(texts)} in the median."


def _verdict(run: Run) -> Any:
    """The widths against the recorded range; None where no recording is known."""
    from ddmhe.interval import judge  # loads scipy's linear programmes

    history = run.source.history
    if history is None:
        return None
    states = np.concatenate([x for x, _ in history.recordings])
    recorded = states.min(axis=0), states.max(axis=0)
    names = [channel.name for channel in run.states]
    if not (recorded[1] > recorded[0]).all():
        return None
    return judge(run.log.lower, run.log.upper, recorded, run.t, names)


def bounds_section(run: Run) -> Section:
    """A panel a state: the bounds, the middle, the truth, the recording before."""
    charts: list[Any] = []
    recorded = run.source.recorded
    for i, channel in enumerate(run.states):
        lower, upper = (np.asarray(side[:, i]) for side in (run.log.lower, run.log.upper))
        known, curves = [run.x[:, i]], []
        if recorded is not None:
            curves.append(Curve("recorded", "recorded", recorded[1][:, i], at="recording"))
            known.append(recorded[1][:, i])
        curves.append(Curve("bounds", "band", lower, upper))
        if run.truth is not None:
            curves.append(Curve("true", "truth", run.truth[:, i]))
            known.append(run.truth[:, i])
        curves.append(Curve("middle", "estimate", run.x[:, i]))
        width = with_unit(float(np.median(_widths(run)[:, i])), channel.unit)
        words = f"Bounds of {channel.label} over time, {width} wide in the median."
        view = reach(np.concatenate(known), np.concatenate([lower, upper, *known]))
        charts.append(Chart(channel.label, words, curves, view=view))
    words = "Each panel is a state over time: its bounds, shaded, and their middle"
    words += ", the broad line the truth as the log has it" if run.truth is not None else ""
    return Section("bounds", "Bounds", [Text(f"{words}."), *charts])


def verdict_section(run: Run) -> Section:
    """How wide the bounds are, over time and against the recorded range."""
    widths, verdict = _widths(run), _verdict(run)
    rows = []
    for i, channel in enumerate(run.states):
        of = widths[:, i]
        cells = [channel.name, with_unit(float(np.median(of)), channel.unit)]
        cells += [with_unit(float(of.max()), channel.unit)]
        cells += ["" if verdict is None else number(float(verdict.share[i]))]
        rows.append(cells)
    header = ("state", "full width, median", "largest", "median over the recorded range")
    blocks: list[Any] = [Table("Widths of the bounds", header, rows)]
    if verdict is not None:
        blocks.insert(0, Text(f"Verdict: {verdict.words}."))
    for i, channel in enumerate(run.states):
        curves = [Curve("full width", "estimate", widths[:, i])]
        alt = f"Full width of the bounds of {channel.label} over time, logarithmic axis."
        blocks.append(Chart(f"width of {channel.label}", alt, curves, log=True))
    return Section("verdict", "What the bounds say", blocks)


def observer_section(run: Run) -> Section:
    """The observer's gain and its guarantees."""
    est = run.est
    rows = [*observer_design(est.design).items(), ("method", str(est.method))]
    return Section("observer", "Observer", [Table("The interval observer", ("", "value"), rows)])
