"""The interval observer: no trajectory outside, how wide its bounds are, how long it takes, the
tumbling target.

Run with `make study-intervals` (about five minutes); writes docs/intervals-study.md.
"""

import sys
import time
from pathlib import Path

import numpy as np
from rich.progress import Progress

import ddmhe
from ddmhe import interval
from ddmhe.cases import pendulum as case
from ddmhe.design.model import samples
from ddmhe.reproduce import pendulum
from ddmhe.reproduce.montecarlo import in_parallel

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "docs" / "intervals-study.md"
sys.path.insert(0, str(ROOT / "tests" / "python"))
from pendulum_case import NumpyObserver, adversary  # noqa: E402

TRAJECTORIES, BATCH, STEPS = 100_000, 1000, 100
ADVERSARIES = 200
KINDS = ("uniform", "extreme", "constant", "switching")
METHODS = {
    "paper": ("paper", "girard"),
    "tight, Girard": ("tight", "girard"),
    "tight, Combastel": ("tight", "combastel"),
    "tight, PCA": ("tight", "pca"),
}


def simulate(rng, kind, count):
    """True states (count, STEPS+1, 2) and outputs (count, STEPS, 1); every other start is a vertex
    of the box."""
    s = interval.pendulum()
    shape = (count, STEPS, 3)
    if kind == "uniform":
        d = rng.uniform(-1, 1, shape)
    elif kind == "extreme":
        d = rng.choice([-1.0, 1.0], shape)
    elif kind == "constant":
        d = np.repeat(rng.choice([-1.0, 1.0], (count, 1, 3)), STEPS, axis=1)
    else:
        period = rng.integers(2, 20, (count, 1))
        sign = np.where((np.arange(STEPS) // period) % 2, 1.0, -1.0)[..., None]
        d = sign * rng.choice([-1.0, 1.0], (count, 1, 3))
    x = np.empty((count, STEPS + 1, 2))
    start = rng.uniform(-1, 1, (count, 2))
    start[::2] = rng.choice([-1.0, 1.0], (len(start[::2]), 2))
    x[:, 0] = case.CENTER + case.RADIUS * start
    for k in range(STEPS):
        x[:, k + 1] = x[:, k] @ s.A.T + case.W * d[:, k, :2]
        x[:, k + 1, 1] -= case.DT * np.sin(x[:, k, 0])
    return x, x[:, :-1, :1] + 0.1 * case.V * d[:, :, 2:]


def observer(name):
    """One of METHODS on the pendulum with the paper's gain."""
    method, reduction = METHODS[name]
    s, start = interval.pendulum(), (case.CENTER, case.RADIUS)
    return interval.IntervalObserver(
        s, pendulum.design(), *start, case.W, case.V, case.ORDER, method, reduction
    )


def outcome(o, x, y):
    """Violations of the predicted, filtered and peak-to-peak bounds, and late widths (predicted,
    filtered)."""
    o.reset()
    log = o.run(y)
    outside = [
        ((now < lower) | (now > upper)).any()
        for now, (lower, upper) in (
            (x[1:], (log.lower, log.upper)),
            (x[:-1], log.filtered),
            (x[1:], log.ball),
            (x[1:], log.ellipsoid),
        )
    ]
    late = case.LATE
    width = np.concatenate(
        [(log.upper - log.lower)[late].mean(0), (log.filtered[1] - log.filtered[0])[late].mean(0)]
    )
    return np.array(outside), width


def batch(seed):
    """BATCH trajectories through every method: violations (methods, 4), summed widths (methods,
    4)."""
    x, y = simulate(np.random.default_rng(seed), KINDS[seed % 4], BATCH)
    violations, widths = np.zeros((len(METHODS), 4), int), np.zeros((len(METHODS), 4))
    for m, name in enumerate(METHODS):
        o = observer(name)
        for k in range(BATCH):
            outside, width = outcome(o, x[k], y[k])
            violations[m] += outside
            widths[m] += width
    return violations, widths


def adversarial():
    """As `batch`, of trajectories that push the last error as far as the adjoint of the error
    dynamics can."""
    s, rng = interval.pendulum(), np.random.default_rng(0)
    violations, widths = np.zeros((len(METHODS), 4), int), np.zeros((len(METHODS), 4))
    observers = [observer(name) for name in METHODS]
    for _ in range(ADVERSARIES):
        angle = rng.uniform(0, 2 * np.pi)
        x, y = adversary(s, pendulum.design().gain, STEPS, [np.cos(angle), 20 * np.sin(angle)])
        for m, o in enumerate(observers):
            outside, width = outcome(o, x, y)
            violations[m] += outside
            widths[m] += width
    return violations, widths


def soundness(progress):
    """Nothing outside, and the widths."""
    task = progress.add_task("trajectories", total=TRAJECTORIES // BATCH)
    seeds = range(TRAJECTORIES // BATCH)
    found = in_parallel(batch, seeds, lambda: progress.advance(task))
    bad, widths = adversarial()
    total = sum(f[0] for f in found) + bad
    count = TRAJECTORIES + ADVERSARIES
    yield (
        f"{TRAJECTORIES} trajectories of {STEPS} samples, a quarter each uniform, extreme, "
        "constant and switching,"
    )
    yield (
        f"half of them from a vertex of the initial box; {ADVERSARIES} adversarial ones. "
        "Trajectories that leave:"
    )
    yield ""
    yield "| method | predicted | with y(k) | ball (44) | ellipsoid |"
    yield "|" + " --- |" * 5
    for name, row in zip(METHODS, total, strict=True):
        yield f"| {name} | " + " | ".join(map(str, row)) + " |"
    yield ""
    yield "Mean full widths of x1 / x2, bounds of x(51) to x(100):"
    yield ""
    yield (
        "| method | "
        + " | ".join(
            [
                *KINDS,
                "adversarial",
                "mean of the first four",
                "mean of 250 of each and the adversarial",
            ]
        )
        + " |"
    )
    yield "|" + " --- |" * (len(KINDS) + 4)
    for m, name in enumerate(METHODS):
        for label, part in (("predicted", slice(0, 2)), ("with y(k)", slice(2, 4))):
            kinds = [
                sum(f[1][m, part] for f in found[k::4]) / (count // 4 // BATCH * BATCH)
                for k in range(4)
            ]
            kinds.append(widths[m, part] / ADVERSARIES)
            few = (1000 * np.mean(kinds[:4], axis=0) + ADVERSARIES * kinds[4]) / (
                1000 + ADVERSARIES
            )
            cells = [f"{a:.5f} / {b:.5f}" for a, b in [*kinds, np.mean(kinds[:4], axis=0), few]]
            yield f"| {name}, {label} | " + " | ".join(cells) + " |"


def speed():
    """From Python, interleaved: `run`, `step`, and the same recursion written with NumPy."""
    _, y = simulate(np.random.default_rng(0), "uniform", 1)
    g = pendulum.design()
    reference = NumpyObserver(interval.pendulum(), g.gain, case.ORDER, design=g)
    times = {}
    for _ in range(30):
        for name in METHODS:
            o = observer(name)
            begin = time.perf_counter()
            o.run(y[0])
            times.setdefault((name, "run"), []).append(time.perf_counter() - begin)
            o.reset()
            begin = time.perf_counter()
            for sample in y[0]:
                o.step(sample)
            times.setdefault((name, "step"), []).append(time.perf_counter() - begin)
        begin = time.perf_counter()
        reference.run(y[0])
        times.setdefault(("the paper's method in NumPy", "run"), []).append(
            time.perf_counter() - begin
        )
    medians = {key: np.median(value) / STEPS * 1e6 for key, value in times.items()}
    slow = medians["the paper's method in NumPy", "run"]
    yield "| from Python | us a sample | NumPy's time over it |"
    yield "| --- | --- | --- |"
    for (name, call), value in medians.items():
        yield f"| {name}, `{call}` | {value:.2f} | {slow / value:.1f} |"


def detumbling():
    """The guaranteed interval of the tumbling target's rate from the torque, deg/s."""
    model = ddmhe.models.detumbling()
    record = model.simulate(120.0, 0.1)
    y = record.y[:-1] + np.random.default_rng(0).uniform(-0.01, 0.01, record.y[:-1].shape)
    yield (
        "Rate known to 1e-3 rad/s at the start, torque noise below 0.01 N m, |w| < 1e-7 rad/s a "
        "sample; steady Kalman"
    )
    yield (
        "gain, 60 generators. Widest full width over the three axes, deg/s; the rate itself is "
        "14.8 deg/s."
    )
    yield ""
    yield "| parameters | method | 5 s | 20 s | 40 s | 100 s | 120 s | samples outside |"
    yield "|" + " --- |" * 8
    for uncertainty in (0.0, 0.005, 0.02):
        s = interval.detumbling(uncertainty=uncertainty)
        g = interval.fixed_gain(s, interval.kalman_gain(s, 1e-6, 0.01))
        for method in ("tight", "paper"):
            o = interval.IntervalObserver(
                s, g, record.x[0], 1e-3, 1e-7, 0.01, order=60, method=method
            )
            log = o.run(y)
            outside = int(
                ((record.x[1:] < log.lower) | (record.x[1:] > log.upper)).any(axis=1).sum()
            )
            width = np.rad2deg(log.upper - log.lower).max(axis=1)
            cells = " | ".join(f"{width[k - 1]:.3g}" for k in (50, 200, 400, 1000, 1200))
            yield f"| ± {100 * uncertainty:g} % | {method} | {cells} | {outside} |"


def recorded():
    """Intervals from 20 s of the same target's recording."""
    model = ddmhe.models.detumbling()
    yield (
        "20 s of recording without errors in the rate, then the next 20 s. w_radius is 1.2 or 3 "
        "times what least"
    )
    yield (
        "squares misses the recorded rates by, v_radius 1.5 times what it misses the torque by, or "
        "the noise's bound"
    )
    yield "if that is larger."
    yield ""
    yield (
        "| torque noise below (N m) | largest w_radius (rad/s) | full width after 1, 5, 20 s "
        "(deg/s) | outside |"
    )
    yield "|" + " --- |" * 4
    for noise in (1e-4, 1e-3, 1e-2):
        record = model.simulate(40.0, 0.1)
        y = record.y + noise * np.random.default_rng(0).uniform(-1, 1, record.y.shape)
        h = ddmhe.History(record.x[:201], y[:200], dt=0.1)
        X, targets = samples(h)
        rows = np.hstack([X, np.ones((len(X), 1))])
        missed = np.abs(targets - rows @ np.linalg.lstsq(rows, targets, rcond=None)[0]).max(axis=0)
        for factor in (1.2, 3.0):
            w, v = factor * missed[:3], np.maximum(1.5 * missed[3:], noise)
            log = interval.from_history(h, w, v).observer(order=60).run(y[200:-1])
            truth = record.x[201:]
            outside = int(((truth < log.lower) | (truth > log.upper)).any(axis=1).sum())
            width = np.rad2deg(log.upper - log.lower).max(axis=1)
            cells = ", ".join(f"{width[k - 1]:.2g}" for k in (10, 50, 200))
            yield f"| {noise:g} | {w.max():.1e} | {cells} | {outside} |"


def main():
    """Run everything, print it and write it to REPORT."""
    lines = ["# Guaranteed intervals: containment, widths, time", ""]
    lines += ["Printed by `make study-intervals` (studies/intervals.py).", ""]
    with Progress(disable=not sys.stdout.isatty()) as progress:
        for title, part in (
            ("The pendulum: nothing outside, and how wide", lambda: soundness(progress)),
            ("Time", speed),
            ("The tumbling target, parameters within bounds", detumbling),
            ("The tumbling target, from a recording", recorded),
        ):
            lines += [f"## {title}", "", *part(), ""]
    REPORT.write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
