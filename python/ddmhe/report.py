"""What a run leaves behind: error measures, tables for the terminal, CSV files and figure files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.table import Table

from ddmhe._core import DdMhe, History
from ddmhe.files import write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ddmhe.design import AffineModel, Certificate, PolePlacement
    from ddmhe.interval import ObserverDesign
    from ddmhe.tuning import Tuning

Array = NDArray[np.float64]

__all__ = [
    "design",
    "markdown",
    "nrmse",
    "observer_design",
    "outcome",
    "pooled_nrmse",
    "promise",
    "rmse",
    "rmse_norm",
    "root_mean_square",
    "save_figure",
    "scores",
    "settings",
    "table",
    "write_estimates",
]


def rmse(error: Array) -> Array:
    """Root mean square of each column of error (N, n), (n,); NaN entries are left out."""
    known = np.isfinite(error)
    squares = np.sum(np.where(known, error, 0.0) ** 2, axis=0)
    counts = known.sum(axis=0)
    return np.asarray(
        np.sqrt(np.where(counts > 0, squares, np.nan) / np.maximum(counts, 1)), dtype=np.float64
    )


def rmse_norm(error: Array) -> float:
    """Root mean square of the rows' Euclidean norms of error (N, n); rows with NaN are left out."""
    rows = error[np.isfinite(error).all(axis=1)]
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1)))) if len(rows) else float("nan")


def nrmse(x_hat: Array, x: Array) -> Array:
    """rms(x_hat - x)/std(x) of each column (N, n), (n,), over the rows where x is known: 1 is a
    constant's score.

    NaN for a column that never changes or is never known. One number for all states is their
    `root_mean_square`."""
    error, spread = _squares(x_hat, x)
    return np.asarray(
        np.sqrt(np.where(spread > 0, error, np.nan) / np.where(spread > 0, spread, 1.0))
    )


def root_mean_square(values: Array) -> float:
    """Root mean square of the numbers that are known, NaN without any: the one NRMSE of several
    states."""
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def pooled_nrmse(x_hat: Array, x: Array) -> float:
    """`nrmse` with errors and spreads pooled over all columns (N, n): for states of one unit; large
    ones count more.

    The spread is taken about each column's own mean.
    """
    error, spread = _squares(x_hat, x)
    return float(np.sqrt(error.sum() / spread.sum())) if spread.sum() > 0 else float("nan")


def _squares(x_hat: Array, x: Array) -> tuple[Array, Array]:
    """Sums of squares over each column of the errors and of the deviations of x from its mean,
    where x is known."""
    known = np.isfinite(x)
    counts = known.sum(axis=0)
    mean = np.where(known, x, 0.0).sum(axis=0) / np.maximum(counts, 1)
    error, deviation = (
        np.sum(np.where(known, part, 0.0) ** 2, axis=0) for part in (x_hat - x, x - mean)
    )
    return error, deviation


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


def outcome(status: Iterable[str], active: Iterable[int]) -> dict[str, str]:
    """How the steps ended, as label and text: count per status, share in which no bound was
    active."""
    counts = Counter(str(s) for s in status)
    free = [i == 0 for i in active]
    return {
        "steps": ", ".join(f"{count} {word}" for word, count in counts.most_common()),
        "no bound active": f"{np.mean(free):.1%}",
    }


def table(title: str, columns: Mapping[str, Mapping[str, str]]) -> Table:
    """A table with one row per label and one column per mapping; an empty name makes a column
    without heading."""
    names = list(columns)
    result = Table("", *names, title=title, title_justify="left", show_header=any(names))
    labels = list(dict.fromkeys(label for column in columns.values() for label in column))
    for label in labels:
        result.add_row(label, *(columns[name].get(label, "") for name in names))
    return result


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
        "history": f"T = {history.T} samples of {history.dt:.4g} s, n = {history.n}, p = {history.p}",
        "poles of the identified A": poles(np.linalg.eigvals(model.A)),
        "rank of [X1; Y0], asked (44)": f"{placement.rank} of {placement.required_rank}",
        "its singular values": ", ".join(f"{s:.3g}" for s in placement.singular_values),
        "Algorithm 2: region, beta": f"{placement.region}, {number(placement.beta)}",
        "poles as printed": poles(placement.poles),
        "rho0, mu0 as printed": f"{number(placement.rho0)}, {number(placement.mu0)}",
        "rho0, mu0 in the model": f"{number(placement.rho0_identified)}, {number(placement.mu0_identified)}",
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
    """The rows of a tuning's table, short: errors on held-out quarters, relative to the spread of
    the states."""
    result = Table(
        "M",
        "mu",
        "space",
        "rest",
        "error",
        "in the quarters",
        "radius",
        title=title,
        title_justify="left",
    )
    for row in best.to_dict("records"):
        weight = row["lambda/mu"]
        space = row["space"] if np.isnan(weight) else f"ridge {weight:.0e} mu"
        quarters = " ".join(f"{row[key]:.1e}" for key in row if str(key).startswith("quarter"))
        cells = [
            str(row["horizon"]),
            f"{row['mu']:.2g}",
            space,
            "yes" if row["equilibrium"] else "no",
        ]
        result.add_row(
            *cells, f"{np.exp(row['score']):.2e}", quarters, f"{row['spectral radius']:.3f}"
        )
    return result


def promise(title: str, tuning: Tuning, names: Sequence[str]) -> Table:
    """What a tuning promises of each state, in its unit, and whether it is better than the default
    rule there."""
    result = Table(
        "state", "rms error", "range", "against the default rule", title=title, title_justify="left"
    )
    kept = "horizon" not in tuning.settings and "equilibrium" not in tuning.settings
    for name, error, low, high, ratio in zip(
        names, tuning.promise, *tuning.range, tuning.ratio, strict=True
    ):
        against = "cannot tell" if kept or np.isnan(ratio) else f"{ratio:.2g} times its error"
        known = "unknown" if np.isnan(error) else f"{error:.3g}"
        result.add_row(
            name, known, f"{low:.2g} to {high:.2g}" if np.isfinite(high) else "unknown", against
        )
    return result


def markdown(title: str, tables: Sequence[Table]) -> str:
    """Tables as they are printed, as one Markdown page."""
    lines = [f"# {title}", ""]
    for table in tables:
        header = [str(column.header) for column in table.columns]
        rows = zip(*(map(str, column.cells) for column in table.columns), strict=True)
        lines += [
            f"{table.title}",
            "",
            "| " + " | ".join(header) + " |",
            "|" + " --- |" * len(header),
        ]
        lines += [
            "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows
        ]
        lines.append("")
    return "\n".join(lines)


def write_estimates(path: Path, time: str, t: Array, names: Sequence[str], x_hat: Array) -> None:
    """A CSV with the time column and one column per state, full precision."""
    frame = pd.DataFrame(x_hat, columns=list(names))
    frame.insert(0, time, t)
    write(path, lambda beside: frame.to_csv(beside, index=False))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of `path` names the format."""
    write(path, lambda beside: figure.savefig(beside, dpi=150))
