"""How good is the default rule? Its error against the best setting in hindsight, on data nobody
tuned for.

Run with `make study-defaults` (some minutes on two cores); writes docs/defaults-study.md. The
measured pendulum logs and brake curve take part if DDMHE_DATA, or ../shared/data beside the
checkout, holds them.

Every case is a recording and the outputs that follow. The rule sees the recording only. Hindsight
is the best of a grid of settings chosen with the truth: a limit that no rule can reach, the same
for every rule."""

import os
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation

import ddmhe
from ddmhe.models import TorqueCurve
from ddmhe.reproduce import pendulum_task

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("DDMHE_DATA", ROOT.parent / "shared" / "data"))
REPORT = ROOT / "docs" / "defaults-study.md"


@dataclass(frozen=True)
class Case:
    """One recording x (T+1, n), y (T, p), the outputs that follow (N, p) and the states they should
    give (N, n)."""

    group: str
    x: np.ndarray
    y: np.ndarray
    outputs: np.ndarray
    truth: np.ndarray
    spans: dict = field(default_factory=dict)
    """Name of each error and the number of estimates it covers."""
    relative: bool = False
    """Error relative to the spread of the truth (NRMSE) instead of absolute."""
    scale: float = 1.0

    def errors(self, x_hat):
        missing = np.isnan(self.truth)
        squares = np.where(missing, 0.0, (x_hat - np.where(missing, 0.0, self.truth)) ** 2)
        if self.relative:
            spread = np.nansum((self.truth - np.nanmean(self.truth, axis=0)) ** 2)
            return {
                name: np.sqrt(squares[:steps].sum() / spread) for name, steps in self.spans.items()
            }
        return {
            name: self.scale * np.sqrt(squares[:steps].sum(1).mean())
            for name, steps in self.spans.items()
        }


def detumbling(group, model, sigma_x, sigma_y, seed, noisy_history=True):
    """20 s recorded, 100 s estimated, sampled at 0.1 s; errors of |omega| in deg/s."""
    record = model.simulate(120.0, 0.1, noise=sigma_y, seed=seed)
    rng = np.random.default_rng(1000 + seed)
    x = record.x[:201] + sigma_x * rng.standard_normal((201, 3))
    y = record.y[:200] if noisy_history else model.output(record.x[:200])
    spans = {"20 s": 200, "40 s": 400, "100 s": 999}
    return Case(group, x, y, record.y[200:-1], record.x[201:], spans, scale=180 / np.pi)


def random_target(seed):
    """Another satellite: inertia within 30 % about rotated axes, another magnet, another spin of 5
    to 20 deg/s."""
    rng = np.random.default_rng(seed)
    base = ddmhe.models.detumbling()
    moments = np.diag(base.inertia) * rng.uniform(0.7, 1.3, 3)
    while 2 * moments.max() >= moments.sum():
        moments = np.diag(base.inertia) * rng.uniform(0.7, 1.3, 3)
    axes = Rotation.random(random_state=seed).as_matrix()
    direction, spin = rng.standard_normal(3), rng.standard_normal(3)
    return ddmhe.models.detumbling(
        inertia=axes @ np.diag(moments) @ axes.T,
        M_eff=base.M_eff * rng.uniform(0.7, 1.3),
        B=direction / np.linalg.norm(direction) * np.linalg.norm(base.B),
        omega_0=spin / np.linalg.norm(spin) * np.deg2rad(rng.uniform(5, 20)),
    )


def spin_down(group, model, sigma_x, sigma_y, seed):
    """0.5 s recorded at 0.01 s, the next 4 s estimated; error in rad/s."""
    record = model.simulate(4.5, 0.01, noise=sigma_y, seed=seed)
    x = record.x[:51] + sigma_x * np.random.default_rng(1000 + seed).standard_normal((51, 1))
    return Case(group, x, record.y[:50], record.y[50:-1], record.x[51:], {"4 s": 400})


def pendulum(path):
    """The pendulum task; NRMSE."""
    task = pendulum_task(path)
    (x, y), = task.history.recordings  # fmt: skip
    return Case("measured pendulum", x, y, task.Y, task.x, {"all": len(task.Y)}, relative=True)


def cases():
    """All cases, and the names of what is missing for want of data."""
    nominal = ddmhe.models.detumbling()
    for k, (sigma_x, sigma_y) in enumerate(product((0, 1e-4, 5e-4), (0.001, 0.01, 0.05))):
        for seed in range(2):
            yield detumbling("3-DOF", nominal, sigma_x, sigma_y, 10 * k + seed)
    for seed in range(6):
        yield detumbling(
            "3-DOF, clean recording", nominal, 0, (0.001, 0.01, 0.05)[seed % 3], 200 + seed, False
        )
    for target, (sigma_x, sigma_y) in product(range(5), ((0, 0.01), (1e-4, 0.01), (5e-4, 0.05))):
        yield detumbling(
            "3-DOF, random targets", random_target(target), sigma_x, sigma_y, 300 + target
        )
    yield from spin_downs()
    yield from pendulums()


def spin_downs():
    """Single-axis spin-downs: a linear brake, and the measured brake curve if its data are
    there."""
    for sigma_x, sigma_y, seed in product((0, 0.05), (2e-4, 2e-3), range(4)):
        yield spin_down("spin-down, linear brake", ddmhe.models.spin_down(), sigma_x, sigma_y, seed)
    curve = DATA / "eddy-brake" / "torque_vs_slip_speed.csv"
    if curve.is_file():
        measured = TorqueCurve.from_csv(curve)
        brake = ddmhe.models.spin_down(
            omega_0=60.0, inertia=0.6, torque_curve=measured
        )  # rising branch
        for seed, sigma in product(range(4), (0.05, 0.5)):
            yield spin_down("spin-down, measured brake curve", brake, 0.1, sigma, seed)


def pendulums():
    """The measured pendulum logs that are there."""
    for path in sorted((DATA / "repoimu-pendulum").glob("*.csv")):
        yield pendulum(path)


def grid(history):
    """Settings to choose from in hindsight; weights in units of the recording's own spread."""
    (x, y), = history.recordings  # fmt: skip
    unit = np.mean(x.var(0)) / np.mean(y.var(0))
    horizons = sorted({M for M in (10, 20, 40, 80) if M <= 0.6 * history.T})
    for M, mu in product(horizons, (0.01, 0.1, 1.0)):
        settings = {"horizon": M, "mu": mu * unit, "rho": 0.95}
        for weight in (1e-7, 1e-5, 1e-3, 1e-1):
            alpha = weight * mu * (history.T - M + 1) * np.mean(x.var(0))
            yield settings | {"space": ddmhe.Ridge(alpha)}
        for rank in (history.n, history.n + 2):
            yield settings | {"space": ddmhe.Truncated(rank)}


def judge(case):
    """Errors of the rule, of the paper's weights in the same space, of the options, and of the best
    of the grid."""
    history = ddmhe.History(
        case.x, case.y, x_units="x", y_units="y"
    )  # all states of a case share a unit, all outputs too

    def run(**settings):
        try:
            return case.errors(ddmhe.DdMhe(history, **settings).run(case.outputs).x)
        except ddmhe.DdmheError:
            return {name: np.inf for name in case.spans}

    with np.errstate(over="ignore", invalid="ignore"):
        found = {"rule": run(), "scaled": run(weights="scaled")}
        found["warm start"] = run(start="recording")
        if case.group.startswith("spin"):
            found["equilibrium"] = run(equilibrium=([0.0], [0.0]))
        elif case.group.startswith("3-DOF"):
            found["equilibrium"] = run(equilibrium=(np.zeros(3), np.zeros(3)))
            found["paper"] = run(horizon=10, rho=0.8, mu=1e5, space=ddmhe.Truncated(3))
        hindsight = [run(**settings) for settings in grid(history)]
    best = {name: np.nanmin([error[name] for error in hindsight]) for name in case.spans}
    return case.group, found, best, ddmhe.DdMhe(history).weights == "recorded"


def geometric(values):
    return float(np.exp(np.mean(np.log(values))))


def rows(results):
    """One row per group, span and setting: median and worst error, geometric mean and worst ratio
    to hindsight."""
    groups = defaultdict(list)
    for group, found, best, *_ in results:
        for name, limit in best.items():
            for setting, errors in found.items():
                groups[group, name, setting].append((errors[name], limit))
    for (group, name, setting), pairs in groups.items():
        error, limit = np.array(pairs).T
        yield (
            group,
            len(pairs),
            name,
            setting,
            np.median(error),
            error.max(),
            geometric(error),
            error / limit,
        )


def counted(results, column):
    """In how many cases of each group `column` of the results is true, in words."""
    groups = defaultdict(list)
    for result in results:
        groups[result[0]].append(result[column])
    found = (f"{sum(each)} of {len(each)} ({group})" for group, each in groups.items() if any(each))
    return ", ".join(found) or "no case"


def main():
    """Run the study, print the table and write it to REPORT."""
    console = Console()
    todo = list(cases())
    if not any(case.group == "measured pendulum" for case in todo):
        console.print(f"no measured logs under {DATA}: their groups are left out (set DDMHE_DATA)")
    workers = os.cpu_count() or 1
    with ProcessPoolExecutor(workers, get_context("forkserver")) as pool:
        results = list(
            track(
                pool.map(judge, todo),
                "cases",
                len(todo),
                console=console,
                disable=not sys.stdout.isatty(),
            )
        )
    header = [
        "group",
        "cases",
        "error over",
        "setting",
        "median",
        "worst",
        "geometric mean",
        "ratio to hindsight",
        "worst ratio",
    ]
    table = Table(*header, title="Default rule against hindsight")
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    for group, count, name, setting, *errors, ratio in rows(results):
        cells = [group, str(count), name, setting, *(f"{e:.3g}" for e in errors)]
        cells += [f"{geometric(ratio):.2f}", f"{ratio.max():.1f}"]
        table.add_row(*cells)
        lines.append("| " + " | ".join(cells) + " |")
    console.print(table)
    if any(case.group == "measured pendulum" for case in todo):
        taken = f"The rule takes the weights of the recording in {counted(results, 3)}."
        text = "\n".join([*PREFACE, taken, "", *lines, ""])
        REPORT.write_text(text, encoding="utf-8")
        console.print(f"wrote {REPORT.relative_to(ROOT)}")


PREFACE = [
    "# The default rule against hindsight",
    "",
    "Printed by `make study-defaults` (studies/defaults.py). *rule* is `DdMhe(history)` with "
    "nothing given; *scaled*",
    'has `weights="scaled"`, the rule without the weights of the recording; *paper* the paper\'s '
    "weights (ρ = 0.8, M = 10,",
    "μ = 1e5) with rank 3; *warm start* and *equilibrium* are the rule with that option. Errors: "
    "3-DOF in deg/s (|ω| error,",
    "RMSE over the span), spin-down in rad/s, measured pendulum NRMSE. *hindsight* is the best of "
    "a grid of horizons, weights",
    "(those of scales, not of the recording) and spaces chosen with the truth, case by case: a "
    "ratio below 1 is possible.",
    "The rule's constants were chosen with the nominal 3-DOF target and these pendulum logs in "
    "view (some 400 settings",
    "were compared on them), so those groups are in-sample: expect other logs of the kind to do "
    "worse.",
    "",
]

if __name__ == "__main__":
    main()
