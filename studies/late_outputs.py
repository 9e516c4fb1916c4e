"""Outputs that are late: after the recording, or all along; and the lag that a recording tells."""

import copy

import numpy as np

import ddmhe
import real_logs
from calibration import DOUBTS
from calibration_page import verdict
from ddmhe.design import output_delay
from ddmhe.report.page import markdown_table
from gated import error, run
from noisy_systems import (
    Log,
    body,
    masses,
    noise_driven,
    oscillator,
    pendulum,
    single_axis,
    spin_down,
    tumbling,
)
from output_faults import Case, all_systems, delay, lagging
from real_logs import Test
from targets import detumbled

LATE = (1, 3, 10, 30)
LAGS = (0, 1, 2, 3, 5, 10, 20, 30)


def late_tables(runs: int, first: int, progress) -> tuple[list, list[str]]:
    """Rows of what was asked for, and the tables."""
    systems = all_systems(runs, first)
    lines = ["### Late outputs", "", "**Recorded in step, later ones late.**", "", LATE_WORDS]
    lates = {
        case.name: later(case) for case in systems if case.tests[0].x_start is None and case.watch
    }
    rows = [[name, *(words for words, _ in each)] for name, each in lates.items()]
    lines += [*markdown_table(("", *(f"late by {d}" for d in LATE)), rows), ""]
    progress("late outputs")
    lines += ["**Late all along.**", "", LAG_WORDS]
    rows = [all_along(case) for case in systems]
    lines += [*markdown_table(("", *(f"late by {d}" for d in LATE)), rows), ""]
    progress("outputs late all along")
    counts = {name: told(tests) for name, tests in lag_families(runs, first + 500)}
    progress("lags told")
    lines += ["**The lag that a recording tells** (`design.output_delay`).", "", TOLD_WORDS]
    rows = [[name, *map(words_of, by_lag.values())] for name, by_lag in counts.items()]
    lines += [*markdown_table(("", *(f"late by {d}" for d in LAGS)), rows), ""]
    false = {True: 0, False: 0}
    total = {True: 0, False: 0}
    for name, by_lag in counts.items():
        hidden = "hidden" in name
        false[hidden] += by_lag[0][1]
        total[hidden] += sum(by_lag[0])
    row = verdict("0", f"{false[False]} of {total[False]} outputs", false[False] == 0)
    seen = ", ".join(f"{name} {each[LATE.index(10)][1]:.0%}" for name, each in lates.items())
    other = f"{false[True]} of {total[True]} outputs"
    return [
        [
            "runs in which outputs late by 10 samples after the recording are seen",
            "is it seen",
            seen,
            "",
        ],
        ["lag of outputs: told of recordings without one", *row],
        ["the same where states were left out of the recording", "–", other, ""],
    ], lines


def later(case: Case) -> list[tuple[str, float]]:
    """By delay: error factor, share of the steps in doubt, in brackets what it is without a delay,
    and share of the runs in which there is doubt before there would have been any, with the median
    of its first step; and that share."""
    found = []
    plain = [real_logs.estimator(test) for test in case.tests]
    clean = [run(est, test, test.log.Y) for est, test in zip(plain, case.tests, strict=True)]
    errors = [error(test, one.x) for test, one in zip(case.tests, clean, strict=True)]
    usual = np.mean([np.mean(one.reasons & DOUBTS != 0) for one in clean])
    for d in LATE:
        factor, share, since = [], [], []
        for est, test, one, was in zip(plain, case.tests, clean, errors, strict=True):
            made = delay(d)(test.log, 0, np.random.default_rng(0))
            late = copy.copy(est).run(made.Y)
            factor.append(error(test, late.x) / was)
            share.append(np.mean(late.reasons & DOUBTS != 0))
            first = first_doubt(late)
            since.append(first if first < first_doubt(one) else np.inf)
        seen = np.isfinite(since)
        when = f" · {np.median(np.array(since)[seen]):.0f}" if seen.any() else ""
        words = f"× {np.exp(np.mean(np.log(factor))):.2f} · {np.mean(share):.2f} ({usual:.2f})"
        found.append((f"{words} · {np.mean(seen):.2f}{when}", float(np.mean(seen))))
    return found


def first_doubt(log) -> float:
    """The first step in doubt, infinite for none."""
    steps = np.flatnonzero(log.reasons & DOUBTS != 0)
    return float(steps[0]) if steps.size else np.inf


def all_along(case: Case) -> list[str]:
    """Error factor with the lag left in, and with it taken off; share of the steps in doubt."""
    cells = []
    for d in LATE:
        left, taken, share = [], [], []
        for test in case.tests:
            if min(len(y) for _, y in test.log.history.recordings) < 4 * d + 40:
                continue
            clean = error(test, run(real_logs.estimator(test), test, test.log.Y).x)
            late = lagging(test, d)
            found = run(real_logs.estimator(late), late, late.log.Y)
            left.append(error(late, found.x) / clean)
            share.append(np.mean(found.reasons & DOUBTS != 0))
            back = np.vstack([test.log.Y[:-d], np.full((d, test.log.Y.shape[1]), np.nan)])
            taken.append(error(test, run(real_logs.estimator(test), test, back).x) / clean)
        means = [np.exp(np.mean(np.log(factor))) for factor in (left, taken)] if left else []
        cells.append(f"× {means[0]:.2f} · × {means[1]:.2f} · {np.mean(share):.2f}" if left else "–")
    return [case.name, *cells]


def told(tests: list[Test]) -> dict[int, tuple[int, int, int]]:
    """By lag: how many outputs were told right, wrong, and not at all; no lag is right at 0."""
    found = {}
    for d in LAGS:
        right = wrong = silent = 0
        for test in tests:
            if min(len(y) for _, y in test.log.history.recordings) < d + 40:
                continue
            for samples in output_delay(lagging(test, d).log.history).samples:
                silent += samples is None
                right += samples == d
                wrong += samples is not None and samples != d
        found[d] = (right, wrong, silent)
    return found


def words_of(counts: tuple[int, int, int]) -> str:
    """Right · wrong of all."""
    right, wrong, silent = counts
    return f"{right} · {wrong} of {right + wrong + silent}" if sum(counts) else "–"


def lag_families(runs: int, first: int):
    """Recordings in step, by family; *hidden* ones lack states."""

    def made(make, *rest, **more):
        return [Test(str(s), make(s, *rest, **more)) for s in range(first, first + runs)]

    def body_of(seed, read):
        return tumbling(seed, body(seed), read, after=1)

    for read in (0.0, 0.01):
        yield f"masses, x ± {read:g}", made(masses, read, 200, 1)
    yield "oscillator", made(oscillator, 0.003, 1e-3, 200)
    for phi in (0.6, 0.9, 0.99):
        for n in (1, 3):
            for read in (0.0, 0.05):
                name = f"noise-driven, φ = {phi:g}, n = {n}, x ± {read:g}"
                yield name, made(noise_driven, phi, n, read, 200)
    for swing in (0.1, 1.0, 2.0):
        yield f"pendulum from {swing:g} rad", made(pendulum, swing, 0.01, 200)
    yield "spin-down", made(spin_down, 0.01, 200)
    yield "bench", made(single_axis)
    for read in (0.0, 1e-3):
        yield f"tumbling bodies, x ± {read:g}", made(body_of, read)
    yield "targets, level 2", made(detumbled, 2, 1)
    yield from real_logs.with_inputs()
    if tests := real_logs.pendulums():
        yield "pendulum logs", tests
    yield "hidden: a pendulum's angle", [kept(t, [1]) for t in made(pendulum, 1.0, 0.003, 200)]
    yield "hidden: the masses' places", [kept(t, [1, 3]) for t in made(masses, 0.003, 200, 1)]
    yield "hidden: half an oscillator", [kept(t, [1]) for t in made(oscillator, 0.003, 1e-3, 200)]
    driven = made(noise_driven, 0.9, 3, 0.0, 200)
    yield "hidden: two of three driven states", [kept(t, [0]) for t in driven]
    yield "hidden: a filter of 5 samples", made(filtered, 5)
    yield "hidden: two of a body's three rates", [kept(t, [0]) for t in made(body_of, 1e-4)]


def kept(test: Test, states: list[int]) -> Test:
    """With these of the states alone."""
    x, y = test.log.history.recordings[0]
    history = ddmhe.History(x[:, states], y, test.log.history.dt)
    return Test(test.name, Log(history, test.log.Y, test.log.truth[:, states]))


def filtered(seed: int, tau: float, T: int = 200) -> Log:
    """A state that noise drives, and an output that a low-pass filter makes of it."""
    rng = np.random.default_rng([seed, 9])
    x, low, rows = 0.0, 0.0, []
    for _ in range(T + 2):
        rows.append((x, low))
        x, low = 0.95 * x + 0.1 * rng.standard_normal(), low + (x - low) / tau
    x_all, y = np.array(rows)[:, :1], np.array(rows)[:, 1:] + 0.01 * rng.standard_normal((T + 2, 1))
    return Log(ddmhe.History(x_all[: T + 1], y[:T], 0.1), y[T : T + 1], x_all[T + 1 :])


LATE_WORDS = """\
Error factor (geometric mean) · share of the steps in doubt (without a delay) · share of the runs
with doubt before there would have been any, and the median of its first step. The run begins with
late outputs: by default (`start="auto"`) it is mostly taken for one that starts elsewhere, which a
warning says, and is then trusted. Started with `start="recording"` these runs stay in doubt for a
horizon, as those above in which a delay sets in later.
"""
LAG_WORDS = """\
Recording and log late alike. Error factor where the lag is left in · where it is taken off, as
`delay=` does, the last rows without outputs · share of the steps in doubt where it is left in.
A lag that is left in costs nothing where the motion is linear and undisturbed. Where it is taken
off a live estimate is that of t - d, the instant that its newest outputs tell of.
"""
TOLD_WORDS = """\
Outputs of which the right lag is told · a wrong one, of all; at 0 *right* says that there is none.
The rest is not told. *hidden*: states were left out of the recording on purpose. The limits of the
rule were chosen on the same families with seeds 30 000 to 30 107 and on the measured logs; these
recordings have others.
"""
