"""Tables for the terminal: labels and texts of what an estimator, a design or a tuning found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table
from rich.text import Text

from ddmhe._core import DdMhe, History
from ddmhe.checks import one_line, times

if TYPE_CHECKING:
    import pandas as pd

    from ddmhe.design import AffineModel, Certificate, PolePlacement
    from ddmhe.interval import ObserverDesign
    from ddmhe.tuning import Tuning

__all__ = ["design", "observer_design", "outcome", "promise", "scores", "settings", "table"]


def settings(est: DdMhe) -> dict[str, str]:
    """The settings in force, as label and text."""
    space = f"{est.rank} directions" + (f", ridge {est.ridge:.3g}" if est.ridge > 0 else "")
    return {
        "horizon M": str(est.horizon),
        "rho": f"{est.rho:.4g}",
        "mu": f"{est.mu:.4g}" + (" (scaled)" if est.weights == "scaled" else ""),
        "trajectory space": space,
        "spectral radius": f"{est.spectral_radius:.4f}",
    }


def outcome(status: Iterable[str], active: Iterable[int] | None) -> dict[str, str]:
    """How the steps ended, as label and text: count per status, share in which no bound was
    active where that is known."""
    counts = Counter(str(s) for s in status)
    rows = {"steps": ", ".join(f"{count} {word}" for word, count in counts.most_common())}
    if active is not None:
        rows["no bound active"] = f"{np.mean([i == 0 for i in active]):.1%}"
    return rows


def table(title: str, columns: Mapping[str, Mapping[str, str]]) -> Table:
    """A table with one row per label and one column per mapping; an empty name makes a column
    without heading."""
    names = list(columns)
    made = Table("", *names, title=_title(title), title_justify="left", show_header=any(names))
    result = _folding(made)
    labels = list(dict.fromkeys(label for column in columns.values() for label in column))
    for label in labels:
        texts = (columns[name].get(label, "") for name in names)
        result.add_row(_plain(label), *map(_plain, texts))
    return result


def _plain(label: str) -> Text:
    """A label with names of a file in it: letter by letter, none of it style."""
    return Text(one_line(label))


def _title(words: str) -> Text:
    return Text(one_line(words), style="table.title", no_wrap=True, overflow="ignore")


def design(
    title: str,
    history: History,
    model: AffineModel,
    placement: PolePlacement,
    certificate: Certificate,
) -> Table:
    """What a design found: the model, Algorithm 2 as printed and recomputed, the certificate."""

    def poles(values: Any) -> str:
        return (
            ", ".join(f"{z.real:.4g}{z.imag:+.4g}j" if z.imag else f"{z.real:.4g}" for z in values)
            or "none"
        )

    def number(value: float) -> str:
        return f"{value:.4g}" if np.isfinite(value) else "none"

    rows = {
        "history": f"T = {history.T} samples of {history.dt:.4g} s, n = {history.n}, "
        f"p = {history.p}" + (f", m = {history.m}" if history.m else ""),
        "poles of the identified A": poles(np.linalg.eigvals(model.A)),
        "rank of [X1; Y0], asked (44)": f"{placement.rank} of {placement.required_rank}",
        "its singular values": ", ".join(f"{s:.3g}" for s in placement.singular_values),
        "Algorithm 2: region, beta": f"{placement.region}, {number(placement.beta)}",
        "poles as printed": poles(placement.poles),
        "rho0, mu0 as printed": f"{number(placement.rho0)}, {number(placement.mu0)}",
        "rho0, mu0 in the model": f"{number(placement.rho0_identified)}, "
        f"{number(placement.mu0_identified)}",
        "rho0 of any gain at least": number(placement.lower_bound),
        "(24) holds": "yes" if placement.certified else "no",
        "certificate: eta, horizon": f"{certificate.eta:.6g}, {certificate.horizon}",
        "cond P, trace Q, trace R": f"{certificate.condition:.4g}, {np.trace(certificate.Q):.4g}, "
        f"{np.trace(certificate.R):.4g}",
        "largest eigenvalue": f"{certificate.residual:.3g}",
    }
    return table(title, {"": rows})


def observer_design(design: ObserverDesign) -> dict[str, str]:
    """An interval observer's gain and its bound, as label and text."""
    return {
        "gain": ", ".join(f"{v:.5g}" for v in design.gain.ravel()),
        "mu_w, mu_v": f"{design.mu_w:.5g}, {design.mu_v:.5g}",
        "gamma": f"{design.gamma:.5g}",
        "lambda": f"{design.lam:.4g}",
        "verified": f"yes, slack {design.slack:.1e}" if design.verified else "no",
    }


def scores(title: str, best: pd.DataFrame) -> Table:
    """The rows of a tuning's table, short. "ranked by" is the error, relative to the spread of the
    states, smoothed over neighbouring weights and, where there are rehearsals, mostly theirs;
    "error" is that on held-out quarters. The chosen setting stands first."""
    heads = ("", "M", "mu", "space", "rest", "ranked by", "error", "in the quarters", "radius")
    result = _folding(Table(*heads, title=_title(title), title_justify="left"))
    for place, row in enumerate(best.to_dict("records")):
        weight = row["lambda/mu"]
        space = row["space"] if np.isnan(weight) else f"ridge {weight:.0e} mu"
        if row["weights"] == "recorded":
            space = "weights of the recording"
        if row["disturbance"] not in ("none", "recorded" if row["weights"] == "recorded" else ""):
            space += f", w {row['disturbance']}"
        quarters = " ".join(f"{row[key]:.1e}" for key in row if str(key).startswith("quarter"))
        marks = ["chosen"] * (place == 0) + ["default"] * bool(row["default"])
        result.add_row(
            ", ".join(marks),
            str(row["horizon"]),
            "" if np.isnan(row["mu"]) else f"{row['mu']:.2g}",
            space,
            "yes" if row["equilibrium"] else "no",
            f"{np.exp(row['rated']):.2e}" if np.isfinite(row["rated"]) else "unstable",
            f"{np.exp(row['score']):.2e}",
            quarters,
            f"{row['spectral radius']:.3f}",
        )
    return result


def _folding(table: Table) -> Table:
    """Cells that are too wide for the terminal go on on the next line: nothing is cut."""
    for column in table.columns:
        column.overflow = "fold"
    return table


def promise(title: str, tuning: Tuning, names: Sequence[str]) -> Table:
    """What a tuning promises of each state, in its unit, and whether it is better than the default
    rule there."""
    heads = ("state", "rms error", "range", "against the default rule")
    result = _folding(Table(*heads, title=_title(title), title_justify="left"))
    kept = not tuning.settings
    for name, error, low, high, ratio in zip(
        names, tuning.promise, *tuning.range, tuning.ratio, strict=True
    ):
        against = "cannot tell" if kept or np.isnan(ratio) else times(ratio, "its error")
        known = "unknown" if np.isnan(error) else f"{error:.3g}"
        result.add_row(
            _plain(name),
            known,
            f"{low:.2g} to {high:.2g}" if np.isfinite(high) else "unknown",
            against,
        )
    return result
