"""The page on a campaign: one file, in the style of the page on a run."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.campaign.against import Comparison
from ddmhe.files import check_writable
from ddmhe.report.web.document import write_page
from ddmhe.report.web.numbers import number, percent
from ddmhe.report.web.parts import Chart, Code, Curve, Page, Section, Table, Text

if TYPE_CHECKING:
    import pandas as pd

    from ddmhe.campaign.results import Results

Array = NDArray[np.float64]

__all__ = ["write_campaign"]

QUANTILES = (5, 25, 50, 75, 95)
WORST = 10
LOOKS = ("estimate", "limit", "output", "recorded")
"""How the curves of one chart differ; more estimators have more charts."""
PERCENT = np.arange(0.0, 101.0)


def write_campaign(
    campaign: Results, path: str | Path, against: list[Comparison] | None = None
) -> None:
    """Write the page on a campaign, as far as it is finished; one HTML file that loads nothing."""
    check_writable(path)
    sections = [
        *([] if against is None else [_compared(against)]),
        _distributions(campaign),
        _over_time(campaign),
        _consistency(campaign),
        _worst(campaign),
        _failures(campaign),
        _setup(campaign),
    ]
    page = Page(
        title=f"Campaign {campaign.spec.name}",
        summary=_summary(campaign, against),
        sections=sections,
        t=np.zeros(0),
        time_label="time (s)",
    )
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_page(path, page)


@dataclass(frozen=True, eq=False)
class Group:
    """Cases that are told of together: of one system, noise and fault."""

    title: str
    system: Mapping[str, Any]
    """Its table in the spec."""
    rows: Mapping[str, pd.DataFrame]
    """Rows by their estimators, in the order of the spec."""


def _groups(campaign: Results) -> Iterator[Group]:
    for names, frame in campaign.rows.groupby(["system", "noise", "fault"], sort=False):
        system = campaign.spec.systems[str(names[0])]
        yield Group(", ".join(map(str, names)), system, dict(_by_estimator(campaign, frame)))


def _by_estimator(campaign: Results, frame: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for name in campaign.spec.estimators:
        yield name, frame[frame["estimator"] == name]


def _summary(campaign: Results, against: list[Comparison] | None) -> list[str]:
    spec, rows = campaign.spec, campaign.rows
    failed = len(campaign.failed)
    words = [
        f"{len(rows)} of {spec.cases} cases are finished: {spec.scenarios} scenarios, "
        f"{len(spec.estimators)} estimators ({', '.join(spec.estimators)}); {failed} failed.",
        "An error is the root mean square over the run of the norm of estimate less truth, in the "
        "unit of the states.",
    ]
    if against is not None:
        worse = [f"{one.estimator} on {one.system}" for one in against if one.reasons]
        words.append(f"Worse than the other campaign: {', '.join(worse) or 'nothing'}.")
    return words


def _compared(against: list[Comparison]) -> Section:
    rows = [
        (
            f"{one.estimator}, {one.system}", str(one.cases), number(one.ratio),
            number(one.chance), f"{one.failed[0]}, {one.failed[1]}",
            " and ".join(percent(share) if share == share else "none" for share in one.within),
            "; ".join(one.reasons) or "no",
        )
        for one in against
    ]  # fmt: skip
    header = ("", "cases in both", "error here over there", "chance", "failed there, here",
              "within 3 sd there, here", "worse")  # fmt: skip
    words = Text(
        "Case against case, of those that both campaigns have. The ratio is the median; the chance "
        "is that of as many cases being larger here, were both as likely."
    )
    return Section("against", "Against the other campaign",
                   [words, Table("This campaign against the other", header, rows)])  # fmt: skip


def _distributions(campaign: Results) -> Section:
    """Quantiles of errors, as tables and curves."""
    blocks: list[Any] = []
    header = ("estimator", "cases", *(f"{q} %" for q in QUANTILES), "worst")
    for group in _groups(campaign):
        rows, curves = [], []
        for name, own in group.rows.items():
            errors = _known(own["rmse_all"])
            if not errors.size:
                rows.append((name, "0", *[""] * (len(QUANTILES) + 1)))
                continue
            at = np.percentile(errors, QUANTILES, method="nearest")
            rows.append((name, str(errors.size), *map(number, at), number(errors.max())))
            curves.append((name, np.percentile(errors, PERCENT, method="nearest")))
        blocks.append(Table(f"Errors: {group.title}", header, rows))
        blocks += _side_by_side(group.title, curves)
    return Section("distributions", "Distributions of errors", blocks)


def _known(column: Any) -> Array:
    values = column.to_numpy(np.float64)
    return np.asarray(values[~np.isnan(values)])


def _side_by_side(group: str, curves: list[tuple[str, Array]]) -> Iterator[Chart]:
    """Errors over the share of cases below them."""
    for first in range(0, len(curves), len(LOOKS)):
        some = curves[first : first + len(LOOKS)]
        yield Chart(
            f"Error: {group}",
            "Error over the share of cases that have less: " + "; ".join(
                f"{name} {number(float(values[50]))} in the median" for name, values in some
            ) + ".",
            [Curve(name, look, values) for (name, values), look in zip(some, LOOKS, strict=False)],
            x=PERCENT,
            x_label="share of cases (%)",
            log=True,
        )  # fmt: skip


def _over_time(campaign: Results) -> Section:
    """Median and 90 % band of the errors of all cases over time."""
    words = "The line is the median over the cases, the band reaches from 5 to 95 % of them."
    charts = (_bands(group, "Error", "error_over_time") for group in _groups(campaign))
    return Section("time", "Errors over time", [Text(words), *chain.from_iterable(charts)])


def _bands(group: Group, what: str, column: str) -> Iterator[Chart]:
    """A chart an estimator that has such a column."""
    for name, own in group.rows.items():
        values = _over_bins(own[column])
        if values is not None:
            yield _band(f"{what} of {name}: {group.title}", values, group.system)


def _over_bins(column: Any) -> Array | None:
    """Cases whose bins are all known (cases, bins)."""
    kept = [v for v in column if v is not None and not np.isnan(np.asarray(v)).all()]
    return np.array(kept, dtype=np.float64) if kept else None


def _band(title: str, values: Array, system: Any) -> Chart:
    low, middle, high = np.nanpercentile(values, (5, 50, 95), axis=0, method="nearest")
    duration, bins = system.get("duration"), values.shape[1]
    x = (np.arange(bins) + 0.5) / bins * (100.0 if duration is None else duration)
    label = "share of the run (%)" if duration is None else "time after the recording (s)"
    return Chart(
        title,
        f"{title} over time: {number(float(middle[0]))} in the first piece, "
        f"{number(float(middle[-1]))} in the last, in the median of {len(values)} cases.",
        [Curve("5 to 95 %", "band", low, high), Curve("median", "estimate", middle)],
        x=x,
        x_label=label,
        log=True,
    )


def _consistency(campaign: Results) -> Section:
    """Whether the stated deviations hold: NEES by span, shares within them."""
    spans = list(campaign.spec.spans)
    header = ("estimator", *(f"NEES, {_span(s)}" for s in spans), "within 1 sd", "2 sd", "3 sd",
              "trusted", "wrong unnoticed", "inside bounds")  # fmt: skip
    blocks: list[Any] = [
        Text(
            "NEES is the squared error in units of the stated covariance, over the number of "
            "states: its mean is 1 where the covariance is right, below where it is cautious, "
            "above where it says too little. Here the median over the cases; shares are means. "
            "Wrong unnoticed: trusted while the error of a state is beyond 3 sd."
        )
    ]
    for group in _groups(campaign):
        rows = []
        for name, own in group.rows.items():
            nees = [own[f"nees_{s}"].median() for s in spans]
            shares = [own[c].astype(float).mean() for c in (
                "within_1sd", "within_2sd", "within_3sd", "trusted", "unnoticed",
                "inside")]  # fmt: skip
            cells = [percent(v) if v == v else "" for v in shares]
            rows.append((name, *("" if v != v else number(float(v)) for v in nees), *cells))
        blocks += _told(f"Consistency: {group.title}", header, rows)
        blocks += _bands(group, "NEES", "nees_over_time")
    return Section("consistency", "Consistency", blocks)


def _told(caption: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[Table]:
    """A table without rows and columns in which nothing is said."""
    rows = [row for row in rows if any(row[1:])]
    kept = [k for k in range(len(header)) if any(row[k] for row in rows)]
    if rows:
        yield Table(caption, [header[0], *(header[k] for k in kept[1:])],
                    [[row[k] for k in kept] for row in rows])  # fmt: skip


def _span(name: str) -> str:
    return "whole run" if name == "all" else name.replace("s", " s")


def replay_command(campaign: Results, case: int) -> str:
    """What runs a case again."""
    return f"ddmhe campaign replay {shlex.quote(str(campaign.folder))} {case}"


def _worst(campaign: Results) -> Section:
    """The largest errors of each estimator."""
    header = ("case", "system, noise, fault", "seed", "error", "NEES", "again")
    blocks: list[Any] = []
    for name, own in _by_estimator(campaign, campaign.rows):
        worst = own[own["rmse_all"].notna()].nlargest(WORST, "rmse_all")
        rows = [
            (
                str(row["case"]), f"{row['system']}, {row['noise']}, {row['fault']}",
                f"{row['seed']} {Path(str(row['source'])).name}".strip(), number(row["rmse_all"]),
                number(row["nees_all"]) if row["nees_all"] == row["nees_all"] else "",
                replay_command(campaign, int(row["case"])),
            )
            for _, row in worst.iterrows()
        ]  # fmt: skip
        blocks.append(Table(f"The worst {len(rows)} cases of {name}", header, rows))
    return Section("worst", "Worst cases", blocks)


def _failures(campaign: Results) -> Section:
    failed = campaign.failed
    if failed.empty:
        return Section("failures", "Failures", [Text("No case failed.")])
    rows = [
        (
            str(names[0]), str(names[1]), str(len(frame)),
            str(frame["error"].iloc[0] or ""), replay_command(campaign, int(frame["case"].iloc[0])),
        )
        for names, frame in failed.groupby(["outcome", "estimator"], sort=False)
    ]  # fmt: skip
    header = ("kind", "estimator", "cases", "the first one's error", "again")
    return Section("failures", "Failures", [Table("Failed cases by kind", header, rows)])


def _setup(campaign: Results) -> Section:
    """What makes it again, and what it took."""
    spec, times = campaign.spec, campaign.timing
    rows = []
    merged = campaign.rows[["case", "estimator"]].merge(times, on="case")
    for name, own in merged.groupby("estimator", sort=False):
        median, most = own["seconds"].median(), own["seconds"].max()
        rows.append((str(name), f"{median:.3g} s", f"{most:.3g} s"))
    return Section(
        "setup",
        "Setup",
        [
            Text(f"Spec {spec.hash}; {campaign.folder}."),
            Table("Wall time of a case", ("estimator", "median", "longest"), rows),
            Code(json.dumps(spec.plain, indent=1), "The spec, with all defaults"),
        ],
    )
