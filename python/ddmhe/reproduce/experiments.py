"""The experiments by name: run, draw, write, judge."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.table import Table

from ddmhe import demo, report
from ddmhe._core import DdmheError
from ddmhe.files import write, write_text
from ddmhe.reproduce import bench, satellite
from ddmhe.reproduce.claims import Claim
from ddmhe.reproduce.montecarlo import ENDS, Trials, in_parallel, percentiles, run_trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

__all__ = ["EXPERIMENTS", "Result", "pendulum_logs", "reproduce_real", "run_experiment"]

SEEDS = 50
"""Noise seeds of an experiment, and of each point of a sweep."""


@dataclass
class Result:
    """What one experiment leaves."""

    claims: list[Claim] = field(default_factory=list)
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)
    """By file name; the first column or the index names the row."""
    figures: dict[str, Figure] = field(default_factory=dict)
    """By file name."""
    printed: list[Table] = field(default_factory=list)
    """For the terminal."""


@dataclass(frozen=True)
class Experiment:
    """How many units of progress it takes, and how to run it."""

    units: int
    run: Callable[[Callable[[], None]], Result]


def run_experiment(name: str, directory: Path, advance: Callable[[], None]) -> tuple[Result, list[Path]]:
    """Run one experiment and write its figures (PNG, SVG) and series (CSV); what came out and the paths."""
    result = EXPERIMENTS[name].run(advance)
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for stem, table in result.tables.items():
        written.append(directory / f"{stem}.csv")
        write(written[-1], partial(table.to_csv, index=table.index.name is not None))
    for stem, figure in result.figures.items():
        for ending in ("png", "svg"):
            written.append(directory / f"{stem}.{ending}")
            report.save_figure(figure, written[-1])
    return result, written


# --- the bench


def _bench(name: str, judge: Callable[[Trials], list[Claim]], **given: Any) -> Callable[[Callable[[], None]], Result]:
    def run(advance: Callable[[], None]) -> Result:
        from ddmhe.plot import trials_figure

        trials = run_trials(bench.trial, range(SEEDS), advance, **given)
        event = bench.EVENT if given else None
        figure = trials_figure(
            trials,
            names=("omega",),
            quantity="angular velocity (rad/s)",
            event=event,
            band=bench.BOX,
            estimators=(bench.MHE, bench.KMHE, bench.ESKF, bench.DEFAULTS, bench.EKF),
        )
        spans = {"all": (0.0, np.inf)}
        if given:
            spans |= {"before": bench.BEFORE, "during": bench.DURING, "after": bench.AFTER}
        errors = _errors(trials, spans)
        title = f"{name}: RMSE in rad/s, median [5 %, 95 %] of {SEEDS} seeds"
        return Result(judge(trials), {name: _series(trials)}, {name: figure}, [_table(title, errors)])

    return run


def _mu(advance: Callable[[], None]) -> Result:
    from ddmhe.plot import sweep_figure

    sweep = {mu: run_trials(bench.trial, range(SEEDS), advance, mu=mu, swept=True) for mu in bench.MUS}
    curves = {
        name: np.array([percentiles(trials.rms(name)) for trials in sweep.values()]) for name in (bench.MHE, bench.KMHE)
    }
    figure = sweep_figure(np.array(bench.MUS), curves, "weight mu on the fitted noise", "RMSE (rad/s)", chosen=bench.MU)
    frame = pd.DataFrame({"mu": bench.MUS})
    for name, curve in curves.items():
        for k, end in enumerate(ENDS):
            frame[f"{name}: {end}"] = curve[:, k]
    table = Table("mu", *curves, title=f"bench-mu: RMSE in rad/s, median of {SEEDS} seeds", title_justify="left")
    for k, mu in enumerate(bench.MUS):
        table.add_row(f"{mu:g}", *(f"{curve[k, 1]:.3g}" for curve in curves.values()))
    return Result(bench.claims_mu(sweep), {"bench-mu": frame}, {"bench-mu": figure}, [table])


# --- the satellite


def _detumbling(advance: Callable[[], None]) -> Result:
    from ddmhe.plot import outputs_figure, trials_figure

    found = {
        (noise, recorded): run_trials(satellite.trial, range(SEEDS), advance, noise=noise, recorded=recorded)
        for noise in satellite.NOISES
        for recorded in satellite.RECORDED
    }
    nominal, noisy = found[0.01, 0.0], found[0.01, satellite.RECORDED[1]]
    rows = []
    for (noise, recorded), trials in found.items():
        for name in trials.names:
            row: dict[str, Any] = {"torque noise (N m)": noise, "history noise (rad/s)": recorded, "estimator": name}
            for span in satellite.SPANS:
                errors = np.rad2deg(trials.rms(name, 0.0, span))
                for end, value in zip(ENDS, percentiles(errors), strict=True):
                    row[f"RMSE {span:g} s, {end} (deg/s)"] = value
            rows.append(row)
    frame = pd.DataFrame(rows)
    columns = [f"{noise:g} N m, {recorded:g}" for noise, recorded in found]
    table = Table(
        "estimator",
        *columns,
        title=f"detumbling: RMSE of |omega error| over 20/40/100 s in deg/s, median of {SEEDS} seeds; columns: torque "
        "noise, noise of the recorded rate (rad/s)",
        title_justify="left",
    )
    for name in nominal.names:
        cells = [
            "/".join(_short(np.median(np.rad2deg(t.rms(name, 0, s)))) for s in satellite.SPANS) for t in found.values()
        ]
        table.add_row(name, *cells)
    shown = (satellite.MHE, satellite.DEFAULTS, satellite.KMHE, satellite.ESKF, satellite.EKF)
    figures = {
        "detumbling-output": outputs_figure(nominal.t, nominal.all[0].y, ("x", "y", "z"), "torque on the chaser (N m)"),
    }
    for stem, trials in (("detumbling", nominal), ("detumbling-noisy-history", noisy)):
        figures[stem] = trials_figure(
            trials,
            names=("omega_x", "omega_y", "omega_z"),
            quantity="angular velocity (deg/s)",
            scale=180 / np.pi,
            estimators=shown,
            band=demo.BOX,
        )
    series = {"detumbling": frame, "detumbling-series": _series(nominal), "detumbling-noisy-series": _series(noisy)}
    return Result(satellite.claims(nominal, noisy), series, figures, [table])


def _design(advance: Callable[[], None]) -> Result:
    from ddmhe.reproduce import design

    histories = design.recordings()
    frame = design.placements(histories)
    table = Table(*frame.columns[:-1], title="design: Algorithm 2", title_justify="left")
    for row in frame.drop(columns="outcome").itertuples(index=False):
        table.add_row(*(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row))
    claims = design.claims(frame, histories)
    advance()
    return Result(claims, {"design": frame}, {}, [table])


# --- the interval paper


def pendulum_intervals(advance: Callable[[], None]) -> Result:
    """The two figures of the interval paper, and the widths of every method."""
    from ddmhe.plot import intervals_figure, widths_figure
    from ddmhe.reproduce import pendulum

    trials = in_parallel(pendulum.trial, range(SEEDS), advance)
    found = pendulum.measures(trials)
    mean = pendulum.widths(found)
    t: Array = pendulum.DT * np.arange(1, trials[0].x.shape[0], dtype=np.float64)
    table = Table("method", *pendulum.MEASURES, "samples outside", title_justify="left")
    table.title = f"pendulum: mean full width of the bounds of x(51) to x(100), {SEEDS} trajectories"
    for name, width in mean.items():
        table.add_row(name, *(f"{w:.5f}" for w in width), str(sum(trial.violations(name) for trial in trials)))
    first = trials[0]
    shown = {name: first.bounds[name] for name in (pendulum.BALL, pendulum.TAHIR, pendulum.PAPER, pendulum.TIGHT)}
    figures = {
        "pendulum": intervals_figure(t, first.x[1:], shown, pendulum.MEASURES),
        "pendulum-widths": widths_figure(t, {k: v.mean(axis=0) for k, v in found.items()}, pendulum.MEASURES),
    }
    series = {"time_s": t, "x1 true": first.x[1:, 0], "x2 true": first.x[1:, 1]}
    for name, (lower, upper) in first.bounds.items():
        for i in range(2):
            series |= {f"x{i + 1} lower {name}": lower[:, i], f"x{i + 1} upper {name}": upper[:, i]}
    frame = pd.DataFrame(
        {"method": list(mean), **{q: [w[i] for w in mean.values()] for i, q in enumerate(pendulum.MEASURES)}}
    )
    tables = {"pendulum": pd.DataFrame(series), "pendulum-widths": frame}
    return Result(pendulum.claims(trials), tables, figures, [table])


# --- measured logs


def reproduce_real(paths: list[Path], directory: Path, advance: Callable[[], None]) -> tuple[Result, list[Path]]:
    """All estimators on every pendulum log; NRMSE as CSV and Markdown."""
    from ddmhe.reproduce.real import pendulum_scores

    scores = pendulum_scores(paths, advance)
    table = Table("estimator", "geometric mean", "median", "worst", "diverged", title="NRMSE", title_justify="left")
    summary = []
    for name in map(str, scores):
        column = scores[name].to_numpy()
        finite = np.isfinite(column) & (column < 1e3)
        mean = float(np.exp(np.mean(np.log(column)))) if finite.all() else np.inf
        summary.append((mean, name, float(np.median(column)), float(column.max()), int((~finite).sum())))
    for mean, name, median, worst, lost in sorted(summary):
        table.add_row(name, _short(mean), _short(median), _short(worst), str(lost))
    directory.mkdir(parents=True, exist_ok=True)
    written = [directory / "real.csv", directory / "real.md"]
    write(written[0], scores.to_csv)
    write_text(written[1], _markdown(scores, sorted(summary), len(paths)))
    return Result(printed=[table]), written


def _markdown(scores: pd.DataFrame, summary: list[tuple[float, str, float, float, int]], count: int) -> str:
    lines = [
        "# Measured pendulum logs: every estimator",
        "",
        f"Written by `ddmhe reproduce real`: NRMSE of the rate estimated from the accelerometer, {count} logs.",
        "Nothing was chosen with the truth. *inf*: diverged.",
        "",
        "| estimator | geometric mean | median | worst | diverged |",
        "| --- | --- | --- | --- | --- |",
        *(
            f"| {name} | {_short(mean)} | {_short(med)} | {_short(worst)} | {lost} |"
            for mean, name, med, worst, lost in summary
        ),
        "",
        "| log | " + " | ".join(str(name) for name in scores) + " |",
        "|" + " --- |" * (len(scores.columns) + 1),
    ]
    for log, row in scores.iterrows():
        lines.append(f"| {log} | " + " | ".join(_short(value) for value in row) + " |")
    return "\n".join([*lines, ""])


# --- tables


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1e6 else "inf"


def _errors(trials: Trials, spans: dict[str, tuple[float, float]]) -> dict[str, dict[str, Array]]:
    return {
        name: {label: percentiles(trials.rms(name, *span)) for label, span in spans.items()} for name in trials.names
    }


def _table(title: str, errors: dict[str, dict[str, Array]]) -> Table:
    labels = list(next(iter(errors.values())))
    table = Table("estimator", *labels, title=title, title_justify="left")
    for name, row in errors.items():
        cells = [f"{_short(row[label][1])} [{_short(row[label][0])}, {_short(row[label][2])}]" for label in labels]
        table.add_row(name, *cells)
    return table


def _series(trials: Trials) -> pd.DataFrame:
    """Time, true states and estimates of the first seed, median and 90 % band of every error over the seeds."""
    first = trials.all[0]
    frame = {"time_s": trials.t}
    for i in range(first.x.shape[1]):
        frame[f"x{i + 1} true"] = first.x[:, i]
        for name, x_hat in first.x_hat.items():
            frame[f"x{i + 1} {name}"] = x_hat[:, i]
    for name in trials.names:
        for end, values in zip(ENDS, trials.band(name), strict=True):
            frame[f"error {name}: {end}"] = values
    return pd.DataFrame(frame)


EXPERIMENTS: dict[str, Experiment] = {
    "bench-nominal": Experiment(SEEDS, _bench("bench-nominal", bench.claims_nominal)),
    "bench-noise": Experiment(SEEDS, _bench("bench-noise", bench.claims_noise, noisy=True)),
    "bench-disturbance": Experiment(SEEDS, _bench("bench-disturbance", bench.claims_disturbance, disturbed=True)),
    "bench-both": Experiment(SEEDS, _bench("bench-both", bench.claims_both, noisy=True, disturbed=True)),
    "bench-mu": Experiment(SEEDS * len(bench.MUS), _mu),
    "detumbling": Experiment(SEEDS * len(satellite.NOISES) * len(satellite.RECORDED), _detumbling),
    "design": Experiment(1, _design),
    "pendulum": Experiment(SEEDS, pendulum_intervals),
}


def pendulum_logs(data: Path | None) -> list[Path]:
    """The pendulum logs of a directory, or of DDMHE_DATA; DdmheError that says what is missing."""
    given = data if data is not None else os.environ.get("DDMHE_DATA")
    if given is None:
        raise DdmheError("--data: expected the directory of the measured logs (or DDMHE_DATA), found none")
    folder = Path(given)
    paths = sorted(folder.glob("*.csv")) or sorted((folder / "repoimu-pendulum").glob("*.csv"))
    if not paths:
        raise DdmheError(f"--data: expected a directory with pendulum logs (CSV), {str(folder)!r} has none")
    return paths
