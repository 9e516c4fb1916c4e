"""The section on what an estimate is judged by: innovations, their whiteness, the statistic."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.report.trust import BARS
from ddmhe.report.web.numbers import percent, times
from ddmhe.report.web.parts import Chart, Curve, Section, Table, Text
from ddmhe.report.web.run import Run
from ddmhe.report.web.states import reach

Array = NDArray[np.float64]

__all__ = ["autocorrelation", "evidence_section"]

LAGS = 40
WHITE = 1.96
"""Deviations that one in twenty autocorrelations of white noise exceeds."""
KINDS = {
    "V": (
        "V, the minimum of the window's problem",
        "V is the squared Mahalanobis length of a window under the recorded ones. Above its limit, "
        "three times what held-out windows of the recording have, the motion is new.",
    ),
    "nis": (
        "normalised innovations squared",
        "The statistic is the mean of the squared normalised innovations over the window. Above "
        "its limit, what chance exceeds once in ten thousand times, the motion is new.",
    ),
}
"""Names of the statistics, and what they say."""
INNOVATION = {
    "V": "An innovation is what the newest output differs by from what all others of its window "
    "say it is. These are not white even where all is well: neighbouring windows share outputs.",
    "nis": "An innovation is what an output differs by from its prediction. Where the recording "
    "goes on they are white: their autocorrelations stay within the band.",
}
"""What innovations are, by the kind of the evidence."""


def autocorrelation(values: Array, lags: int = LAGS) -> Array:
    """Autocorrelations (L,) of values (N,) at lags 1 to L; NaN entries are left out."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(lags, np.nan)
    centred = np.where(known, values - values[known].mean(), 0.0)
    power = float(centred @ centred) / known.sum()
    found = np.full(lags, np.nan)
    for lag in range(1, min(lags, len(values) - 1) + 1):
        pairs = int((known[lag:] & known[:-lag]).sum())
        if pairs and power > 0:
            found[lag - 1] = float(centred[lag:] @ centred[:-lag]) / pairs / power
    return found


def evidence_section(run: Run) -> Section | None:
    """Innovations, statistic, gated and stuck outputs; None without evidence."""
    evidence = getattr(run.log, "evidence", None)
    if evidence is None:
        return None
    kinds = sorted(set(np.atleast_1d(evidence.kind).tolist()))
    blocks: list[Any] = [Text(INNOVATION[kind]) for kind in kinds]
    blocks.append(_table(run, evidence))
    for i, channel in enumerate(run.outputs):
        blocks.append(_innovation(channel.label, evidence, i))
        blocks.append(_whiteness(channel.label, evidence, i))
    blocks += [Text(KINDS[kind][1]) for kind in kinds]
    blocks.append(_statistic(KINDS[kinds[0]][0] if len(kinds) == 1 else "", evidence))
    return Section("evidence", "Evidence", blocks)


def _statistic(name: str, evidence: Any) -> Chart:
    """The statistic and its limit; of several without one name, their shares of their limits."""
    value, limit = np.asarray(evidence.value), np.asarray(evidence.limit)
    if not name:
        name, value, limit = "statistic over its limit", value / limit, np.ones(len(value))
    above = percent(float(np.mean(value > limit)))
    alt = f"{name} over time with its limit, on a logarithmic axis: above it {above}."
    curves = [Curve("limit", "limit", limit), Curve(name, "estimate", value)]
    return Chart(name, alt, curves, log=True, doubts=True)


def _table(run: Run, evidence: Any) -> Table:
    """Outputs with what was found of each."""
    rows = []
    for i, channel in enumerate(run.outputs):
        innovation, std = evidence.innovation[:, i], evidence.innovation_std[:, i]
        known = np.isfinite(innovation)
        inside = np.abs(innovation) <= BARS * std
        rows.append(
            (
                channel.label,
                percent(float(np.mean(~known))),
                percent(float(np.mean(inside[known]))) if known.any() else "none measured",
                percent(float(np.mean(evidence.gated[:, i]))),
                percent(float(np.mean(evidence.stuck[:, i]))),
            )
        )
    header = (
        "output", "not measured", f"innovations within {BARS:g} sd", "rejected by the gate",
        "stuck",
    )  # fmt: skip
    again = int(np.sum(evidence.restarted))
    more = f"; the run started again {times(again)}" if again else ""
    return Table(f"Outputs{more}", header, rows)


def _innovation(label: str, evidence: Any, i: int) -> Chart:
    innovation, std = evidence.innovation[:, i], BARS * evidence.innovation_std[:, i]
    curves = [
        Curve(f"± {BARS:g} sd", "band", -std, std),
        Curve("innovation", "output", innovation),
    ]
    rejected = np.where(evidence.gated[:, i], innovation, np.nan)
    if np.isfinite(rejected).any():
        curves.append(Curve("rejected", "mark", rejected))
    known = innovation[np.isfinite(innovation)]
    most = f"{np.max(np.abs(known)):.3g}" if known.size else "none"
    return Chart(
        f"innovation of {label}",
        f"Innovations of {label} over time with the band they should stay in; largest {most}.",
        curves,
        doubts=True,
        view=reach(known, np.concatenate([known, -std, std])),
    )


def _whiteness(label: str, evidence: Any, i: int) -> Chart:
    values = evidence.innovation[:, i] / evidence.innovation_std[:, i]
    found = autocorrelation(values)
    lags = np.arange(1.0, len(found) + 1)
    count = max(int(np.isfinite(values).sum()), 1)
    edge = np.full(len(found), WHITE / np.sqrt(count))
    outside = int(np.nansum(np.abs(found) > edge))
    return Chart(
        f"autocorrelation, innovation of {label}",
        f"Autocorrelation of the innovations of {label} at lags 1 to {len(found)}: {outside} of "
        "them are beyond what white noise has in 19 of 20 cases.",
        [
            Curve("white noise, 19 of 20", "band", -edge, edge),
            Curve("autocorrelation", "bar", found),
        ],
        x=lags,
        x_label="lag (samples)",
        view=(-1.05, 1.05),
    )
