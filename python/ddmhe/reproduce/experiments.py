"""The experiments by name: run, draw, write, judge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.table import Table

from ddmhe import report
from ddmhe.cases import bench as bench_case
from ddmhe.cases import pendulum as pendulum_case
from ddmhe.cases import satellite as case
from ddmhe.files import write
from ddmhe.report.palette import COLORS, color_of
from ddmhe.reproduce import bench, satellite
from ddmhe.reproduce.claims import Claim
from ddmhe.reproduce.montecarlo import ENDS, Trials, in_parallel, percentiles, run_grid, run_trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

__all__ = ["EXPERIMENTS", "Result", "run_experiment", "short"]

SEEDS = 50
"""Noise seeds of an experiment, and of each point of a sweep."""
FAMILY_SEEDS, SWEEP_SEEDS = 10, 5
"""Noise seeds on each bench of the family, and at each point of its sweep."""


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


def run_experiment(
    name: str, directory: Path, advance: Callable[[], None]
) -> tuple[Result, list[Path]]:
    """Run one experiment and write its figures (PNG, SVG) and series (CSV); what came out and the
    paths."""
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


def _bench(name: str, **given: Any) -> Experiment:
    """Fig. 2, 3, 4 or 5: drawn on the nominal bench, judged over the family."""
    kind, scenario = name.removeprefix("bench-"), given
    others = [each for each in bench.family("disturbed" in given) if each != bench_case.NOMINAL]

    def run(advance: Callable[[], None]) -> Result:
        from ddmhe.reproduce.figures import trials_figure

        trials = run_trials(bench.trial, range(SEEDS), advance, **scenario)
        settings = [{"bench": each, "names": bench.JUDGED, **scenario} for each in others]
        grid = run_grid(bench.trial, range(FAMILY_SEEDS), advance, settings)
        family = {bench_case.NOMINAL: trials, **dict(zip(others, grid, strict=True))}
        figure = trials_figure(
            trials,
            names=("omega",),
            quantity="angular velocity (rad/s)",
            event=bench_case.EVENT if given else None,
            band=bench_case.BOX,
            colors=_colors(bench.MHE, bench.KMHE, bench.ESKF, bench.DEFAULTS, bench.EKF),
        )
        spans = {"all": bench.WHOLE}
        if given:
            spans |= {"before": bench.BEFORE, "during": bench.DURING, "after": bench.AFTER}
        title = f"{name}: RMSE in rad/s, median [5 %, 95 %] of {SEEDS} seeds"
        tables = {name: _series(trials), f"{name}-family": _family(family)}
        return Result(
            bench.claims(kind, family),
            tables,
            {name: figure},
            [_table(title, _errors(trials, spans))],
        )

    return Experiment(SEEDS + FAMILY_SEEDS * len(others), run)


def _family(found: Mapping[bench_case.Bench, Trials]) -> pd.DataFrame:
    """Median errors of the compared estimators on every bench, rad/s."""
    rows = []
    for each, trials in found.items():
        row: dict[str, Any] = {quantity: label(each) for quantity, label in bench.LEVELS.items()}
        for name in bench.JUDGED:
            for label, span in bench.SPANS.items():
                row[f"{name}: RMSE {label}"] = float(np.median(trials.rms(name, *span)))
            row[f"{name}: scatter during"] = float(np.median(trials.scatter(name, *bench.DURING)))
        rows.append(row)
    return pd.DataFrame(rows)


def _mu(advance: Callable[[], None]) -> Result:
    from ddmhe.report.figures import sweep_figure
    from ddmhe.reproduce.figures import parameter_figure

    names = (bench.MHE, bench.KMHE)
    settings = [{"mu": mu, "names": names} for mu in bench_case.MUS]
    sweep = dict(
        zip(bench_case.MUS, run_grid(bench.trial, range(SEEDS), advance, settings), strict=True)
    )
    others = [each for each in bench.family(False) if each != bench_case.NOMINAL]
    grid = run_grid(
        bench.trial,
        range(SWEEP_SEEDS),
        advance,
        [{"bench": each, **given} for each in others for given in settings],
    )
    family = {bench_case.NOMINAL: sweep}
    for k, each in enumerate(others):
        family[each] = dict(zip(bench_case.MUS, grid[k * len(bench_case.MUS) :], strict=False))
    curves = {
        name: np.array([percentiles(trials.rms(name)) for trials in sweep.values()])
        for name in names
    }
    figures = {
        "bench-mu": sweep_figure(
            np.array(bench_case.MUS),
            curves,
            "weight mu on the fitted noise",
            "RMSE (rad/s)",
            chosen=bench_case.MU,
            colors=_colors(*names),
        ),
        "bench-mu-time": parameter_figure(
            {f"mu = {mu:g}": trials for mu, trials in list(sweep.items())[::2]},
            quantity="angular velocity (rad/s)",
            colors=_colors(*names),
        ),
    }
    frame = pd.DataFrame({"mu": bench_case.MUS})
    for name, curve in curves.items():
        for k, end in enumerate(ENDS):
            frame[f"{name}: {end}"] = curve[:, k]
    table = Table(
        "mu",
        *curves,
        title=f"bench-mu: RMSE in rad/s, median of {SEEDS} seeds",
        title_justify="left",
    )
    for k, mu in enumerate(bench_case.MUS):
        table.add_row(f"{mu:g}", *(f"{curve[k, 1]:.3g}" for curve in curves.values()))
    return Result(bench.claims_mu(family), {"bench-mu": frame}, figures, [table])


# --- the satellite


def _detumbling(advance: Callable[[], None]) -> Result:
    from ddmhe.report.figures import outputs_figure
    from ddmhe.reproduce.figures import trials_figure

    settings = satellite.settings()
    runs = run_grid(satellite.trial, range(SEEDS), advance, settings)
    found = {
        (each["noise"], each["recorded"]): trials
        for each, trials in zip(settings, runs, strict=True)
    }
    nominal, noisy = (found[satellite.JUDGED, recorded] for recorded in satellite.RECORDED)
    rows = []
    for (noise, recorded), trials in found.items():
        for name in trials.names:
            row: dict[str, Any] = {
                "torque noise (N m)": noise,
                "history noise (rad/s)": recorded,
                "estimator": name,
            }
            for span in satellite.spans(trials):
                errors = np.rad2deg(trials.rms(name, 0.0, span))
                for end, value in zip(ENDS, percentiles(errors), strict=True):
                    row[f"RMSE {span:g} s, {end} (deg/s)"] = value
            rows.append(row)
    columns = [f"{noise:g} N m, {recorded:g}" for noise, recorded in found]
    table = Table(
        "estimator",
        *columns,
        title=(
            f"detumbling: RMSE of |omega error| over 20/40/100 s ({satellite.JUDGED:g} N m: also "
            f"180 s) in deg/s, median of {SEEDS} seeds; columns: torque noise, noise of the "
            "recorded rate (rad/s)"
        ),
        title_justify="left",
    )
    for name in nominal.names:
        cells = [
            "/".join(short(np.median(np.rad2deg(t.rms(name, 0, s)))) for s in satellite.spans(t))
            for t in found.values()
        ]
        table.add_row(name, *cells)
    shown = (satellite.MHE, satellite.DEFAULTS, satellite.KMHE, satellite.ESKF, satellite.EKF)
    figures = {
        "detumbling-output": outputs_figure(
            nominal.t, nominal.all[0].y, ("x", "y", "z"), "torque on the chaser (N m)"
        ),
    }
    for stem, trials in (("detumbling", nominal), ("detumbling-noisy-history", noisy)):
        figures[stem] = trials_figure(
            trials,
            names=("omega_x", "omega_y", "omega_z"),
            quantity="angular velocity (deg/s)",
            scale=180 / np.pi,
            colors=_colors(*shown),
            band=case.BOX,
        )
    series = {
        "detumbling": pd.DataFrame(rows),
        "detumbling-series": _series(nominal),
        "detumbling-noisy-series": _series(noisy),
    }
    return Result(satellite.claims(nominal, noisy), series, figures, [table])


def _design(advance: Callable[[], None]) -> Result:
    from ddmhe.reproduce import design, theory

    histories = design.recordings()
    frame = design.placements(histories)
    columns = [name for name in frame.columns if name not in ("outcome", "arbitrary")]
    table = Table(*columns, title="design: Algorithm 2", title_justify="left")
    for row in frame[columns].itertuples(index=False):
        table.add_row(*(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row))
    left = pd.DataFrame(theory.linearisation(), columns=list(theory.LEFT))
    second = Table(
        *left.columns, title="design: what (5) leaves of the 3-DOF motion", title_justify="left"
    )
    for row in left.itertuples(index=False):
        second.add_row(*(f"{cell:.3g}" for cell in row))
    claims = design.claims(frame, histories)
    advance()
    return Result(claims, {"design": frame, "design-linearisation": left}, {}, [table, second])


# --- the interval paper


def pendulum_intervals(advance: Callable[[], None]) -> Result:
    """The two figures of the interval paper, and the widths of every method."""
    from ddmhe.report.figures import intervals_figure, widths_figure
    from ddmhe.reproduce import pendulum

    trials = in_parallel(pendulum.trial, range(SEEDS), advance)
    found = pendulum.measures(trials)
    mean = pendulum.widths(found)
    t: Array = pendulum_case.DT * np.arange(1, trials[0].x.shape[0], dtype=np.float64)
    table = Table("method", *pendulum.MEASURES, "samples outside", title_justify="left")
    table.title = (
        f"pendulum: mean full width of the bounds of x(51) to x(100), {SEEDS} trajectories"
    )
    for name, width in mean.items():
        table.add_row(
            name, *(f"{w:.5f}" for w in width), str(sum(trial.violations(name) for trial in trials))
        )
    first = trials[0]
    colors = dict(zip((*mean, pendulum.PRINTED_BALL), COLORS, strict=False))
    from_0 = np.concatenate([[0.0], t])

    def drawn(*names: str) -> Figure:
        shown = {name: pendulum.from_start(first, name) for name in names}
        return intervals_figure(from_0, first.x, shown, pendulum.MEASURES, colors=colors)

    widths = {k: v.mean(axis=0) for k, v in found.items()}
    figures = {
        "pendulum-fig1": drawn(pendulum.ZONOTOPE, pendulum.BALL, pendulum.PRINTED_BALL),
        "pendulum-fig2": drawn(pendulum.PAPER, pendulum.TAHIR, pendulum.TIGHT),
        "pendulum-widths": widths_figure(t, widths, pendulum.MEASURES, colors=colors),
    }
    series = {"time_s": t, "x1 true": first.x[1:, 0], "x2 true": first.x[1:, 1]}
    for name, (lower, upper) in first.bounds.items():
        for i in range(2):
            series |= {f"x{i + 1} lower {name}": lower[:, i], f"x{i + 1} upper {name}": upper[:, i]}
    frame = pd.DataFrame(
        {
            "method": list(mean),
            **{q: [w[i] for w in mean.values()] for i, q in enumerate(pendulum.MEASURES)},
        }
    )
    tables = {"pendulum": pd.DataFrame(series), "pendulum-widths": frame}
    return Result(pendulum.claims(trials), tables, figures, [table])


# --- tables and colours

ESTIMATORS = {
    bench.MHE: color_of(0),
    bench.DEFAULTS: color_of(5),
    bench.KMHE: color_of(4),
    bench.ESKF: color_of(2),
    bench.EKF: color_of(3),
}
"""One colour for each estimator in every figure."""


def _colors(*names: str) -> dict[str, str]:
    return {name: ESTIMATORS[name] for name in names}


def short(value: float) -> str:
    """A number in three digits; "inf" for one that has left all bounds."""
    return f"{value:.3g}" if value < 1e6 else "inf"


def _errors(trials: Trials, spans: dict[str, tuple[float, float]]) -> dict[str, dict[str, Array]]:
    return {
        name: {label: percentiles(trials.rms(name, *span)) for label, span in spans.items()}
        for name in trials.names
    }


def _table(title: str, errors: dict[str, dict[str, Array]]) -> Table:
    labels = list(next(iter(errors.values())))
    table = Table("estimator", *labels, title=title, title_justify="left")
    for name, row in errors.items():
        cells = [
            f"{short(row[label][1])} [{short(row[label][0])}, {short(row[label][2])}]"
            for label in labels
        ]
        table.add_row(name, *cells)
    return table


def _series(trials: Trials) -> pd.DataFrame:
    """Time, true states and estimates of the first seed, median and 90 % band of every error over
    the seeds."""
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
    "bench-nominal": _bench("bench-nominal"),
    "bench-noise": _bench("bench-noise", noisy=True),
    "bench-disturbance": _bench("bench-disturbance", disturbed=True),
    "bench-both": _bench("bench-both", noisy=True, disturbed=True),
    "bench-mu": Experiment(
        len(bench_case.MUS) * (SEEDS + SWEEP_SEEDS * (len(bench.family(False)) - 1)), _mu
    ),
    "detumbling": Experiment(SEEDS * len(satellite.NOISES) * len(satellite.RECORDED), _detumbling),
    "design": Experiment(1, _design),
    "pendulum": Experiment(SEEDS, pendulum_intervals),
}
