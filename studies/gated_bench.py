"""The worth of a gate with its restart on the paper's bench: nominal, noisy for a while, kicked."""

import numpy as np

from calibration_page import verdict
from ddmhe import DdMhe, History
from ddmhe.cases.bench import DT, DURATION, EVENT, HISTORY, LARGE_NOISE, NOISE, Bench
from ddmhe.report.page import markdown_table

KINDS = ("nominal", "large noise", "kick")
WEIGHTS = {"default": "auto", "ridge": "scaled"}
LIMITS = {"nominal": 1.0, "large noise": 1.0, "kick": 0.5}
"""Asked of the default: error with the gate over that without."""


def log(kind: str, seed: int) -> tuple[History, np.ndarray, np.ndarray]:
    """The recording, the outputs after it, and the true speeds (N, 1)."""
    bench = Bench()
    steps, T = round(DURATION / DT), round(HISTORY / DT)
    t = DT * np.arange(steps + 1)
    event = (t >= EVENT[0]) & (t < EVENT[1])
    jerk = (t[:-1] >= EVENT[0]) & (t[:-1] < EVENT[0] + 0.2 * (EVENT[1] - EVENT[0]))
    kick = np.zeros((steps, 1))
    if kind == "kick":
        kick[jerk] = bench.kick / jerk.sum()
    record = bench.model.simulate(DURATION, DT, disturbance=kick)
    level = np.full(steps + 1, bench.deviation)
    if kind == "large noise":
        level[event] *= LARGE_NOISE / NOISE
    y = record.y + level[:, None] * np.random.default_rng(seed).standard_normal(record.y.shape)
    history = History(record.x_recorded[: T + 1], y[:T], DT, x_units="rad/s", y_units="N m")
    return history, y[T:-1], record.x[T + 1 :]


def ratio(kind: str, seed: int, weights: str, gate: str) -> tuple[float, int]:
    """Rms error with the gate over that without, and how often the run started again."""
    history, Y, x = log(kind, seed)
    plain = DdMhe(history, weights=weights, start="recording").run(Y)
    gated = DdMhe(history, weights=weights, start="recording", gate=gate).run(Y)
    error = [np.sqrt(np.mean((found.x - x) ** 2)) for found in (plain, gated)]
    return error[1] / error[0], int(gated.evidence.restarted.sum())


def bench_table(runs: int, first: int, gate: str | None) -> tuple[list[list[str]], list[str]]:
    """Rows of what was asked for, and the table; nothing without a gate."""
    if gate is None:
        return [], []
    rows, asked = [], []
    for kind in KINDS:
        row = [kind]
        for name, weights in WEIGHTS.items():
            ratios, restarts = zip(
                *(ratio(kind, seed, weights, gate) for seed in range(first, first + runs)),
                strict=True,
            )
            middle = float(np.median(ratios))
            row += [f"{middle:.3f} ({max(ratios):.2f})", f"{np.mean(restarts):.1f}"]
            if name == "default":
                said = verdict(f"≤ {LIMITS[kind]:g}", f"{middle:.3f}", middle <= LIMITS[kind])
                asked.append([f"gate, bench, {kind}: error over plain", *said])
        rows.append(row)
    header = ("the bench", *(f"{name}{what}" for name in WEIGHTS for what in ("", ", restarts")))
    return asked, ["### The bench, and a jump", "", WORDS, *markdown_table(header, rows), ""]


WORDS = """\
Rms error with the gate over that without: median over the runs, in brackets the worst, and restarts
a run. The kick speeds the target up by 4 rad/s within .1 s, which no recorded motion did.
"""
