"""Measured logs: every estimator on each of them, as tables and files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from ddmhe._core import DdmheError
from ddmhe.files import write, write_text
from ddmhe.report.page import markdown_table
from ddmhe.reproduce.experiments import Result, short

__all__ = ["pendulum_logs", "reproduce_real"]


def reproduce_real(
    paths: list[Path], directory: Path, advance: Callable[[], None]
) -> tuple[Result, list[Path]]:
    """All estimators on every pendulum log; NRMSE as CSV and Markdown.

    A KeyboardInterrupt has the same of the logs that were finished as its `finished`, None without
    any."""
    from ddmhe.reproduce.real import pendulum_scores

    try:
        return _summarised(pendulum_scores(paths, advance), directory)
    except KeyboardInterrupt as e:
        scores: Any = getattr(e, "finished", ())
        finished = _summarised(scores, directory) if len(scores) else None
        e.finished = finished  # type: ignore[attr-defined]
        raise


def _summarised(scores: pd.DataFrame, directory: Path) -> tuple[Result, list[Path]]:
    table = Table(
        "estimator",
        "geometric mean",
        "median",
        "worst",
        "diverged",
        title="NRMSE",
        title_justify="left",
    )
    summary = []
    for name in map(str, scores):
        column = scores[name].to_numpy()
        finite = np.isfinite(column) & (column < 1e3)
        mean = float(np.exp(np.mean(np.log(column)))) if finite.all() else np.inf
        summary.append(
            (mean, name, float(np.median(column)), float(column.max()), int((~finite).sum()))
        )
    for mean, name, median, worst, lost in sorted(summary):
        table.add_row(name, short(mean), short(median), short(worst), str(lost))
    directory.mkdir(parents=True, exist_ok=True)
    written = [directory / "real.csv", directory / "real.md"]
    write(written[0], scores.to_csv)
    write_text(written[1], _markdown(scores, sorted(summary), len(scores)))
    return Result(printed=[table]), written


def _markdown(
    scores: pd.DataFrame, summary: list[tuple[float, str, float, float, int]], count: int
) -> str:
    lines = [
        "# Measured pendulum logs: every estimator",
        "",
        "Written by `ddmhe reproduce real`: NRMSE of the rate estimated from the accelerometer, "
        f"{count} logs.",
        "Nothing was chosen with the truth. *inf*: diverged.",
        "",
        *markdown_table(
            ("estimator", "geometric mean", "median", "worst", "diverged"),
            [
                (str(name), *(short(value) for value in (mean, med, worst)), str(lost))
                for mean, name, med, worst, lost in summary
            ],
        ),
        "",
        *markdown_table(
            ("log", *(str(name) for name in scores)),
            [(str(log), *(short(value) for value in row)) for log, row in scores.iterrows()],
        ),
    ]
    return "\n".join([*lines, ""])


def pendulum_logs(data: Path | None) -> list[Path]:
    """The pendulum logs of a directory, or of DDMHE_DATA; DdmheError that says what is missing."""
    given = data if data is not None else os.environ.get("DDMHE_DATA")
    if given is None:
        raise DdmheError(
            "--data: expected the directory of the measured logs (or DDMHE_DATA), found none"
        )
    folder = Path(given)
    paths = sorted(folder.glob("*.csv")) or sorted((folder / "repoimu-pendulum").glob("*.csv"))
    if not paths:
        raise DdmheError(
            f"--data: expected a directory with pendulum logs (CSV), {str(folder)!r} has none"
        )
    return paths
