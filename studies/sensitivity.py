"""How the 3-DOF estimate depends on mu, rho, M, the rank of the trajectory space and the noise.

Run with `make study-sensitivity` (under a minute); writes docs/sensitivity-study.md and
docs/sensitivity-*.png."""

import sys
from itertools import product
from pathlib import Path

import numpy as np
from rich.progress import Progress

import ddmhe
from ddmhe import report
from ddmhe.cases import satellite as case
from ddmhe.report.figures import heat_figure
from ddmhe.reproduce.montecarlo import in_parallel

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SEEDS = range(20)
SPANS = (20.0, 100.0)
HISTORY_NOISE = 1e-4  # rad/s

HORIZONS = (4, 6, 10, 14, 20, 30)
RHOS = (0.5, 0.65, 0.8, 0.9, 0.95, 0.99)
MUS = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-2, 1e5)
RANKS = (2, 3, 4, 6, 9, 12, 20, 40)
NOISES = (1e-4, 1e-3, 1e-2, 5e-2)  # N m
BASE = {"horizon": 10, "rho": 0.8, "mu": 1e5, "rank": 3}


def errors(seed, noise, recorded, settings):
    """RMSE of |omega error|, deg/s, over SPANS, for each of `settings`."""
    record = ddmhe.models.detumbling().simulate(case.DURATION, case.DT, noise=noise, seed=seed)
    x, y = record.x[: case.T + 1], record.y[: case.T]
    x = x + recorded * np.random.default_rng(10_000 + seed).standard_normal(x.shape)
    y = y if recorded > 0 else ddmhe.models.detumbling().output(x[:-1])
    history = ddmhe.History(x, y, dt=case.DT, x_units=record.x_units, y_units=record.y_units)
    found = []
    for given in settings:
        given = BASE | given
        space = ddmhe.Truncated(given.pop("rank"))
        x_hat = (
            ddmhe.DdMhe(history, space=space, start="state", **given).run(record.y[case.T : -1]).x
        )
        norm = np.rad2deg(np.linalg.norm(x_hat - record.x[case.T + 1 :], axis=1))
        found.append([np.sqrt(np.mean(norm[: round(span / case.DT)] ** 2)) for span in SPANS])
    return np.array(found)


MAPS = {
    "mu-rho": (("rho", RHOS), ("mu", MUS)),
    "horizon-rho": (("rho", RHOS), ("horizon", HORIZONS)),
    "horizon-rank": (("rank", RANKS), ("horizon", HORIZONS)),
}
"""Two settings each; the others as in BASE, torque noise 0.01 N m."""


def medians(progress, title, noise, recorded, settings):
    """Median over the seeds: (settings, spans)."""
    task = progress.add_task(title, total=len(SEEDS))
    found = in_parallel(
        errors,
        SEEDS,
        lambda: progress.advance(task),
        noise=noise,
        recorded=recorded,
        settings=settings,
    )
    return np.median(found, axis=0)


def draw(name, rows, columns, values):
    """One figure with a panel per span."""
    panels = [(f"RMSE over {span:g} s", values[..., k]) for k, span in enumerate(SPANS)]
    labels = [(label, [f"{v:g}" for v in ticks]) for label, ticks in (rows, columns)]
    report.save_figure(
        heat_figure(panels, *labels, "|omega error| (deg/s)"), DOCS / f"sensitivity-{name}.png"
    )


def table(rows, columns, values):
    """Both spans in one cell."""
    yield f"| {rows[0]} \\\\ {columns[0]} | " + " | ".join(f"{v:g}" for v in columns[1]) + " |"
    yield "|" + " --- |" * (len(columns[1]) + 1)
    for label, line in zip(rows[1], values, strict=True):
        yield (
            f"| {label:g} | "
            + " | ".join("/".join(f"{v:.2g}" for v in cell) for cell in line)
            + " |"
        )


def main():
    """Run every map, draw it, write the tables."""
    lines = [
        "# Sensitivity of the 3-DOF estimate",
        "",
        "Printed by `make study-sensitivity` (studies/sensitivity.py): |omega error|, RMSE in "
        "deg/s over 20 s / 100 s",
        f"after 20 s of recording, median of {len(SEEDS)} seeds, no box; 1e-4 rad/s of noise on "
        "the recorded rate.",
        f"What is not on the axes: {', '.join(f'{k} = {v:g}' for k, v in BASE.items())}, torque "
        "noise 0.01 N m.",
        'rho and mu are given, so they are those of the cost (17) as printed (weights "paper"), '
        "whatever the default is.",
        "How to read it: [sensitivity.md](sensitivity.md).",
        "",
    ]
    with Progress(disable=not sys.stdout.isatty()) as progress:
        for name, (rows, columns) in MAPS.items():
            grid = [{rows[0]: r, columns[0]: c} for r, c in product(rows[1], columns[1])]
            shape = (len(rows[1]), len(columns[1]), len(SPANS))
            values = medians(progress, name, 0.01, HISTORY_NOISE, grid).reshape(shape)
            draw(name, rows, columns, values)
            lines += [
                f"## {name}",
                "",
                f"![{name}](sensitivity-{name}.png)",
                "",
                *table(rows, columns, values),
                "",
            ]
        for title, recorded in (
            ("noise-rank", HISTORY_NOISE),
            ("noise-rank, recording without noise", 0.0),
        ):
            grid = [{"rank": rank} for rank in RANKS]
            values = np.stack(
                [medians(progress, title, noise, recorded, grid) for noise in NOISES], axis=1
            )
            name = title.replace(", ", "-").replace(" ", "-")
            rows, columns = ("rank", RANKS), ("torque noise (N m)", NOISES)
            draw(name, rows, columns, values)
            lines += [
                f"## {title}",
                "",
                f"![{title}](sensitivity-{name}.png)",
                "",
                *table(rows, columns, values),
                "",
            ]
    (DOCS / "sensitivity-study.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
