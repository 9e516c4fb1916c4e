"""How good is `ddmhe.tune`? Its error against the best setting in hindsight, on data that the tuner
never saw.

Run with `make study-tuning`; writes docs/tuning-study.md. The measured pendulum logs and brake
curve take part if DDMHE_DATA, or ../shared/data beside the checkout, holds them. The cases are
those of studies/defaults.py, with 30 detumbling cases: five random targets, three levels of noise
on the recorded states and two on the torque.

Hindsight is the best of all settings that the tuner chose from, each span and case by itself,
picked with the truth: no rule can reach it."""

import os
import sys
import time
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import ddmhe
from defaults import (
    ROOT,
    counted,
    detumbling,
    geometric,
    pendulums,
    random_target,
    rows,
    spin_downs,
)

REPORT = ROOT / "docs" / "tuning-study.md"


def cases():
    """(case, equilibrium) of every group."""
    noises = list(product((0, 1e-4, 5e-4), (0.01, 0.05)))
    rest = (np.zeros(3), np.zeros(3))
    for group, targets in (
        ("3-DOF, random targets", range(5)),
        ("3-DOF, held-out targets", range(20, 23)),
    ):
        for target, (sigma_x, sigma_y) in product(targets, noises):
            yield detumbling(group, random_target(target), sigma_x, sigma_y, 300 + target), rest
    yield from ((case, (np.zeros(1), np.zeros(1))) for case in spin_downs())
    yield from ((case, None) for case in pendulums())


def judge(case, rest):
    """Errors with the tuned settings and with the default rule, the best of the candidates, and the
    tuner's time."""
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
        found = {
            "tuned": run(tuned.settings | {"start": tuned.start}),
            "defaults": run({}),
            "scaled": run({"weights": "scaled"}),
        }
        hindsight = []
        for settings in tuned.candidates:
            for start in ("state", "recording"):
                hindsight.append(run(settings | {"start": start}))
    best = {name: np.nanmin([error[name] for error in hindsight]) for name in case.spans}
    recorded = ddmhe.DdMhe(history).weights == "recorded"
    return case.group, found, best, recorded, bool(tuned.settings), seconds


def main():
    """Run the study, print the table and write it to REPORT."""
    console = Console()
    todo = list(cases())
    results, seconds = [], []
    for case, rest in track(todo, "cases", console=console, disable=not sys.stdout.isatty()):
        *result, time_taken = judge(case, rest)
        results.append(result)
        seconds.append(time_taken)
    header = [
        "group",
        "cases",
        "error over",
        "setting",
        "median",
        "worst",
        "ratio to hindsight",
        "worst ratio",
    ]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    table = Table(*header, title="Tuning against hindsight")
    for group, count, name, setting, median, worst, _, ratio in rows(results):
        cells = [group, str(count), name, setting, f"{median:.3g}", f"{worst:.3g}"]
        cells += [f"{geometric(ratio):.2f}", f"{ratio.max():.1f}"]
        table.add_row(*cells)
        lines.append("| " + " | ".join(cells) + " |")
    console.print(table)
    median, worst = np.median(seconds), max(seconds)
    took = (
        f"One call of tune took {median:.1f} s in the median, {worst:.1f} s at most, on "
        f"{os.cpu_count()} cores."
    )
    console.print(took)
    chosen = [
        f"The default rule takes the weights of the recording in {counted(results, 3)};",
        f"tune leaves the default rule in {counted(results, 4)}.",
    ]
    if any(case.group == "measured pendulum" for case, _ in todo):
        text = "\n".join([*PREFACE, *chosen, took, "", *lines, ""])
        REPORT.write_text(text, encoding="utf-8")
        console.print(f"wrote {REPORT.relative_to(ROOT)}")


PREFACE = [
    "# Tuning against hindsight",
    "",
    "Printed by `make study-tuning` (studies/tuning.py). *tuned* is `DdMhe(h, **t.settings, "
    "start=t.start)` with",
    '`t = tune(h)`, *defaults* is `DdMhe(h)`, *scaled* `DdMhe(h, weights="scaled")`.',
    "Errors: 3-DOF in deg/s (|ω| error, RMSE over the span), spin-down in rad/s with the rest "
    "known,",
    "measured pendulum NRMSE. *Hindsight* is the best of the tuner's own candidates, picked with "
    "the truth for each",
    "case and span by itself. The tuner's constants were chosen with the random targets, the "
    "spin-downs and the logs",
    "in view; the held-out targets were not looked at before. No units are stated, other than in "
    "`make study-defaults`.",
    "",
]

if __name__ == "__main__":
    main()
