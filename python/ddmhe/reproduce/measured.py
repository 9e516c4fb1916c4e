"""Measured logs: every estimator on each of them, as tables and files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from ddmhe._core import DdmheError
from ddmhe.checks import file_words
from ddmhe.files import write, write_text
from ddmhe.report.page import markdown_table
from ddmhe.reproduce.experiments import Result, short

__all__ = ["driven_logs", "pendulum_logs", "reproduce_real"]


def reproduce_real(
    paths: list[Path],
    directory: Path,
    advance: Callable[[], None],
    driven: Sequence[tuple[str, Path]] = (),
) -> tuple[Result, list[Path]]:
    """All estimators on every pendulum log, and on the `driven` cases (name, folder) of logs with
    known inputs; errors as CSV and Markdown.

    A KeyboardInterrupt has the same of the logs that were finished as its `finished`, None without
    any."""
    from ddmhe.reproduce.driven import driven_scores
    from ddmhe.reproduce.real import pendulum_scores

    tables: list[Any] = []
    try:
        tables.append(pendulum_scores(paths, advance) if paths else ())
        tables.append(driven_scores(list(driven), advance) if driven else ())
        return _summarised(tables[0], tables[1], directory)
    except KeyboardInterrupt as e:
        pendulum, others = [*tables, getattr(e, "finished", ()), ()][:2]
        found = len(pendulum) or len(others)
        finished = _summarised(pendulum, others, directory) if found else None
        e.finished = finished  # type: ignore[attr-defined]
        raise


def _summarised(pendulum: Any, driven: Any, directory: Path) -> tuple[Result, list[Path]]:
    """Tables of the scores, of which either may be empty, and their files."""
    directory.mkdir(parents=True, exist_ok=True)
    printed, pages, written = [], [], []
    for scores, name, told in ((pendulum, "real", _pendulum), (driven, "real-inputs", _driven)):
        if len(scores):
            table, page = told(scores)
            printed.append(table)
            pages.append("\n".join([*page, ""]))
            written.append(directory / f"{name}.csv")
            write(written[-1], scores.to_csv)
    written.insert(1, directory / "real.md")
    write_text(written[1], "\n".join(pages))
    return Result(printed=printed), written


def _pendulum(scores: pd.DataFrame) -> tuple[Table, list[str]]:
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
    return table, _markdown(scores, sorted(summary), len(scores))


def _markdown(
    scores: pd.DataFrame, summary: list[tuple[float, str, float, float, int]], count: int
) -> list[str]:
    return [
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


def _driven(scores: pd.DataFrame) -> tuple[Table, list[str]]:
    """Estimators by logs: the NRMSE over all states, and below it each state in its unit."""
    from ddmhe.reproduce.driven import ALL

    def cells(rows: pd.DataFrame) -> list[tuple[str, ...]]:
        return [
            (str(name), *("–" if np.isnan(value) else short(value) for value in row))
            for name, row in rows.iterrows()
        ]

    overall = pd.DataFrame(scores.xs(ALL, level="state")).T
    states = scores.drop(index=ALL, level="state")
    states.index = pd.Index([f"{log}: {state}" for log, state in states.index])
    title = "Measured logs, known inputs u: NRMSE"
    table = Table("estimator", *map(str, overall), title=title, title_justify="left")
    for row in cells(overall):
        table.add_row(*row)
    page = [
        "# Measured logs with known inputs: every estimator",
        "",
        "Written by `ddmhe reproduce real`: NRMSE over all states; each test starts from its own "
        "true state, the circuit goes on where its recording ends.",
        "Every sample counts, also the first ones, in which what looks back (ARX, FIR) sees "
        "outputs of the recording's end.",
        "Nothing was chosen with the truth. *inf*: diverged; –: the log has no inputs.",
        "",
        *markdown_table(("estimator", *map(str, overall)), cells(overall)),
        "",
        "State by state, rms error in its unit:",
        "",
        *markdown_table(("log: state", *map(str, states)), cells(states)),
    ]
    return table, page


def driven_logs(data: Path | None) -> list[tuple[str, Path]]:
    """The cases of logs with known inputs, and their folder, of which a directory (or DDMHE_DATA),
    or its folder input-logs, holds every file."""
    from ddmhe.reproduce.driven import CASES

    folder = _folder(data)
    return [
        (name, place)
        for name, case in CASES.items()
        for place in (folder, folder / "input-logs")
        if all((place / f"{file}.csv").is_file() for file in case.files)
    ]


def _folder(data: Path | None) -> Path:
    """The directory of the measured logs."""
    given = data if data is not None else os.environ.get("DDMHE_DATA")
    if given is None:
        raise DdmheError(
            "--data: expected the directory of the measured logs (or DDMHE_DATA), found none"
        )
    return Path(given)


def pendulum_logs(data: Path | None) -> list[Path]:
    """The pendulum logs of a directory, or of DDMHE_DATA; DdmheError that says what is missing if
    there are no logs with known inputs either."""
    from ddmhe.reproduce.driven import CASES

    folder = _folder(data)
    others = {file for case in CASES.values() for file in case.files}
    paths = sorted(p for p in folder.glob("*.csv") if p.stem not in others) or sorted(
        (folder / "repoimu-pendulum").glob("*.csv")
    )
    if not paths and not driven_logs(data):
        raise DdmheError(
            f"--data: expected a directory with pendulum logs (CSV), '{file_words(folder)}' "
            "has none"
        )
    return paths
