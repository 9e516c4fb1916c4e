"""Does `ddmhe.tune` keep what it promises? On recordings of several kinds: how often it leaves the
default rule, what
that gains later, and the share of later errors that stay in its range.

Run with `make study-promise` (some minutes). Cases are those of studies/defaults.py with other
seeds and targets, other cuts of the measured pendulum logs, and two families that are made here:
states driven by noise, and linear systems."""

import warnings
from collections import defaultdict

import numpy as np
from rich.console import Console
from rich.table import Table

import ddmhe
from ddmhe.logs import read_log
from ddmhe.reproduce.real import OUTPUT, STATE
from defaults import DATA, Case, detumbling, pendulums, random_target, spin_down

CUTS = ((3, 50, 170), (4, 110, 150), (6, 20, 100))
"""Decimation, samples after the swing begins, and T of the pendulum cuts."""


def driven(phi, T, seed):
    """A rate driven by noise, from the measured angle."""
    rng = np.random.default_rng([seed, 5])
    rate = np.zeros(2 * T + 1)
    for k in range(2 * T):
        rate[k + 1] = phi * rate[k] + np.sqrt(1 - phi**2) * rng.standard_normal()
    angle = np.concatenate([[0.0], np.cumsum(0.05 * rate[:-1])]) + 3e-3 * rng.standard_normal(
        2 * T + 1
    )
    return split("noise-driven", rate[:, None], angle[:, None], T)


def oscillator(T, seed):
    """A pair of slow oscillators, driven a little, one output; noise on all of the recording."""
    rng = np.random.default_rng([seed, 6])
    A = np.zeros((4, 4))
    for k in (0, 2):
        a = rng.uniform(0.05, 0.4)
        A[k : k + 2, k : k + 2] = rng.uniform(0.98, 1.0) * np.array(
            [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        )
    x = [rng.standard_normal(4)]
    for _ in range(2 * T):
        x.append(A @ x[-1] + 0.02 * rng.standard_normal(4))
    x = np.array(x)
    y = x @ rng.standard_normal((4, 2)) + 0.03 * rng.standard_normal((2 * T + 1, 2))
    case = split("linear", x, y, T)
    return Case(
        case.group,
        case.x + 0.02 * rng.standard_normal(case.x.shape),
        case.y,
        case.outputs,
        case.truth,
    )


def split(group, x, y, T):
    return Case(group, x[: T + 1], y[:T], y[T:-1], x[T + 1 :])


def cuts():
    """Pendulum logs at other rates and from other samples on; what is missing is left out of the
    errors."""
    for path in sorted((DATA / "repoimu-pendulum").glob("*.csv")):
        for decimate, lead, T in CUTS:
            log = read_log(path, STATE, OUTPUT, decimate=decimate)
            first = int(np.argmax(np.abs(log.x).max(axis=1) > 0.5)) + lead
            x, y = log.x[first:], log.y[first:]
            if len(y) > 1.6 * T and np.isfinite(x[: T + 1]).all() and np.isfinite(y[:T]).all():
                yield split("pendulum, other cuts", x, y, T)


def cases():
    yield from pendulums()
    yield from cuts()
    for target, noise in ((40, 0.01), (41, 0.05), (42, 0.01), (43, 0.05)):
        yield detumbling("3-DOF", random_target(target), 2e-4, noise, 900 + target)
    for seed in range(8):
        yield spin_down(
            "spin-down, linear brake",
            ddmhe.models.spin_down(),
            (0, 0.05)[seed % 2],
            1e-3,
            20 + seed,
        )
    for phi in (0.6, 0.9, 0.97):
        yield from (driven(phi, T, 40 + seed) for T in (150, 300) for seed in range(3))
    yield from (oscillator(T, seed) for T in (80, 150) for seed in range(5))


def judge(case):
    """Whether the default rule was left, the error over the default's, and for each state whether
    it was inside."""
    history = ddmhe.History(case.x, case.y, x_units="x", y_units="y")
    tuned = ddmhe.tune(history, progress=False)
    errors = []
    for settings in (tuned.settings, {}):
        x_hat = ddmhe.DdMhe(history, **settings, start=tuned.start).run(case.outputs).x
        squares = (x_hat - case.truth) ** 2
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a stretch without truth
            errors.append(
                [np.sqrt(np.nanmean(squares[:k], axis=0)) for k in (history.T, len(squares))]
            )
    lo, hi = tuned.range
    (ours, whole), (_, default) = errors
    ratio = np.sqrt(np.mean(whole**2) / np.mean(default**2))
    inside = [(lo <= error) & (error <= hi) for error in (ours, whole)]
    return bool(tuned.settings), ratio, inside, hi / tuned.promise, ours / tuned.promise


def main():
    """Print one row for each kind."""
    found = defaultdict(list)
    for case in cases():
        found[case.group].append(judge(case))
    header = (
        "kind",
        "cases",
        "left the default",
        "error over the default's, worst",
        "inside, T",
        "inside, all",
    )
    table = Table(
        *header, "hi / promise", "later / promise, 5 % to 95 %", title="What tune promises"
    )
    for group, rows in found.items():
        moved, ratio, inside, width, later = zip(*rows, strict=True)
        first, whole = (np.concatenate([each[k] for each in inside]).mean() for k in (0, 1))
        low, high = np.quantile(np.concatenate(later), [0.05, 0.95])
        cells = [
            group,
            str(len(rows)),
            str(sum(moved)),
            f"{np.exp(np.mean(np.log(ratio))):.3f}, {max(ratio):.2f}",
        ]
        cells += [f"{first:.0%}", f"{whole:.0%}", f"{np.median(np.concatenate(width)):.1f}"]
        table.add_row(*cells, f"{low:.2f} to {high:.2f}")
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
