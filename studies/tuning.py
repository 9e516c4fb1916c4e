"""How good is `ddmhe.tune`? Its error against the best setting in hindsight, on data that the tuner never saw.

Run with `make study-tuning`; writes docs/tuning-study.md. The measured pendulum logs and brake curve take part if
DDMHE_DATA, or ../shared/data beside the checkout, holds them. The cases are those of studies/defaults.py, with 30
detumbling cases: five random targets, three levels of noise on the recorded states and two on the torque.

Hindsight is the best of all settings that the tuner chose from, each span and case by itself, picked with the truth:
no rule can reach it.
"""

import os
import sys
import time
from collections import defaultdict
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import ddmhe
from ddmhe.models import TorqueCurve
from defaults import DATA, ROOT, detumbling, geometric, pendulum, random_target, spin_down

REPORT = ROOT / "docs" / "tuning-study.md"


def cases():
    """(case, equilibrium) of every group."""
    noises = list(product((0, 1e-4, 5e-4), (0.01, 0.05)))
    rest = (np.zeros(3), np.zeros(3))
    for group, targets in (("3-DOF, random targets", range(5)), ("3-DOF, held-out targets", range(20, 23))):
        for target, (sigma_x, sigma_y) in product(targets, noises):
            yield detumbling(group, random_target(target), sigma_x, sigma_y, 300 + target), rest
    still = (np.zeros(1), np.zeros(1))
    for sigma_x, sigma_y, seed in product((0, 0.05), (2e-4, 2e-3), range(4)):
        yield spin_down("spin-down, linear brake", ddmhe.models.spin_down(), sigma_x, sigma_y, seed), still
    curve = DATA / "eddy-brake" / "torque_vs_slip_speed.csv"
    if curve.is_file():
        brake = ddmhe.models.spin_down(omega_0=60.0, inertia=0.6, torque_curve=TorqueCurve.from_csv(curve))
        for seed, sigma in product(range(4), (0.05, 0.5)):
            yield spin_down("spin-down, measured brake curve", brake, 0.1, sigma, seed), still
    for path in sorted((DATA / "repoimu-pendulum").glob("*.csv")):
        yield pendulum(path), None


def judge(case, rest):
    """Errors with the tuned settings and with the default rule, the best of the tuner's candidates, and the tuner's
    time."""
    history = ddmhe.History(case.x, case.y)

    def run(settings):
        try:
            return case.errors(ddmhe.DdMhe(history, **settings).run(case.outputs).x)
        except ddmhe.DdmheError:
            return dict.fromkeys(case.spans, np.inf)

    with np.errstate(over="ignore", invalid="ignore"):
        begin = time.perf_counter()
        tuned = ddmhe.tune(history, equilibrium=rest, progress=False)
        seconds = time.perf_counter() - begin
        found = {"tuned": run(tuned.settings), "defaults": run({})}
        hindsight = []
        for settings in tuned.candidates:
            for warm in (False, True) if case.relative else (False,):
                hindsight.append(run(settings | {"warm_start": warm}))
    best = {name: np.nanmin([error[name] for error in hindsight]) for name in case.spans}
    return case.group, found, best, seconds


def main():
    """Run the study, print the table and write it to REPORT."""
    console = Console()
    todo = list(cases())
    results, seconds = [], []
    for case, rest in track(todo, "cases", console=console, disable=not sys.stdout.isatty()):
        *result, time_taken = judge(case, rest)
        results.append(result)
        seconds.append(time_taken)
    header = ["group", "cases", "error over", "setting", "median", "worst", "ratio to hindsight", "worst ratio"]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    table = Table(*header, title="Tuning against hindsight")
    groups = defaultdict(list)
    for group, found, best in results:
        for name, limit in best.items():
            for setting, errors in found.items():
                groups[group, name, setting].append((errors[name], limit))
    for (group, name, setting), pairs in groups.items():
        error, limit = np.array(pairs).T
        cells = [group, str(len(pairs)), name, setting, f"{np.median(error):.3g}", f"{error.max():.3g}"]
        cells += [f"{geometric(error / limit):.2f}", f"{(error / limit).max():.1f}"]
        table.add_row(*cells)
        lines.append("| " + " | ".join(cells) + " |")
    console.print(table)
    median, worst = np.median(seconds), max(seconds)
    took = f"One call of tune took {median:.1f} s in the median, {worst:.1f} s at most, on {os.cpu_count()} cores."
    console.print(took)
    if any(case.group == "measured pendulum" for case, _ in todo):
        REPORT.write_text("\n".join([*PREFACE, took, "", *lines, ""]), encoding="utf-8")
        console.print(f"wrote {REPORT.relative_to(ROOT)}")


PREFACE = [
    "# Tuning against hindsight",
    "",
    "Printed by `make study-tuning` (studies/tuning.py). *tuned* is `DdMhe(h, **tune(h).settings)`, *defaults* is "
    "`DdMhe(h)`. Errors:",
    "3-DOF in deg/s (|ω| error, RMSE over the span), spin-down in rad/s with the rest known, measured pendulum "
    "NRMSE. *Hindsight* is",
    "the best of the tuner's own candidates, picked with the truth for each case and span by itself. The tuner's "
    "constants were chosen",
    "with the random targets, the spin-downs and the logs in view; the held-out targets were not looked at before.",
    "",
]

if __name__ == "__main__":
    main()
