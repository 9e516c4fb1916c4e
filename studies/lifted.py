"""The lifted estimator beside the affine one: curved systems at three noises, a linear one, and the
measured logs (from the folder that DDMHE_DATA names). Prints the table of docs/lifted.md."""

import time
from collections.abc import Callable, Iterator

import numpy as np

import ddmhe
import real_logs
from ddmhe.report.page import markdown_table

NOISES = (0.0, 0.01, 0.05)
"""Standard deviations of the outputs' noise over their spread; the states have a fifth of it."""


def integrated(f: Callable, x_0, dt: float, steps: int) -> np.ndarray:
    """States (steps+1, n) of x' = f(x) by Runge and Kutta's fourth-order method."""
    x = [np.asarray(x_0, float)]
    for _ in range(steps):
        z, h = x[-1], dt / 4
        for _ in range(4):
            a = f(z)
            b = f(z + h / 2 * a)
            c = f(z + h / 2 * b)
            z = z + h / 6 * (a + 2 * b + 2 * c + f(z + h * c))
        x.append(z)
    return np.array(x)


def systems() -> Iterator[tuple[str, np.ndarray, Callable]]:
    """States and the output's function: of the first third is learnt, the rest is estimated."""

    def vdp(x):
        return np.array([x[1], 1.5 * (1 - x[0] ** 2) * x[1] - x[0]])

    def lorenz(x):
        return np.array([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])

    def swing(x):
        return np.array([x[1], -np.sin(x[0])])

    def spring(x):
        return np.array([x[1], -x[0] - 0.05 * x[1]])

    def duffing(x):
        return np.array([x[1], x[0] - x[0] ** 3])

    yield "Van der Pol's oscillator", integrated(vdp, (1.0, 0.0), 0.05, 1200), lambda x: x[:, :1]
    yield (
        "Lorenz's system",
        integrated(lorenz, (1.0, 1.0, 20.0), 0.02, 3000)[300:],
        lambda x: x[:, :1],
    )
    yield "pendulum, 1.5 rad", integrated(swing, (1.5, 0.0), 0.1, 900), lambda x: np.sin(x[:, :1])
    yield "Duffing's oscillator", integrated(duffing, (0.0, 0.9), 0.1, 900), lambda x: x[:, 1:]

    def hunt(x):  # two species that eat and are eaten
        return np.array([x[0] * (1 - x[1]), x[1] * (x[0] - 1)])

    def roessler(x):
        return np.array([-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)])

    def driven(x):  # a pendulum that turns over, its angle as sine and cosine
        c, s, w = x
        return np.array([-s * w, c * w, -s - 0.1 * w])

    def bell(x):  # a kinetics of quotients, which no polynomial is
        return np.array(
            [1 - x[0] - 4 * x[0] * x[1] / (1 + x[0] ** 2), x[0] - x[0] * x[1] / (1 + x[0] ** 2)]
        )

    yield "predator and prey", integrated(hunt, (1.5, 1.0), 0.1, 900), lambda x: x[:, :1]
    yield (
        "Rössler's system",
        integrated(roessler, (1.0, 1.0, 0.0), 0.05, 3300)[300:],
        lambda x: x[:, 1:2],
    )
    yield "turning pendulum", integrated(driven, (1.0, 0.0, 2.5), 0.1, 900), lambda x: x[:, 1:2]
    yield "chemical kinetics", integrated(bell, (0.3, 0.2), 0.1, 600), lambda x: x[:, :1]
    yield "damped spring (linear)", integrated(spring, (1.0, 0.0), 0.1, 900), lambda x: x[:, :1]


def main() -> None:
    """Print the tables."""
    begun, rows = time.monotonic(), []
    for name, x, h in systems():
        for noise in NOISES:
            found = [_simulated(x, h, noise, seed) for seed in range(3 if noise else 1)]
            rows.append([f"{name}, ± {noise:g}", *_row(found)])
    for test in real_logs.pendulums():
        rows.append([test.name, *_row([_compared(test)])])
    for name, tests in real_logs.with_inputs():
        rows.append([name, *_row([_compared(test) for test in tests])])
    print("\n".join(markdown_table(HEAD, rows)))
    print(f"\nRun in {time.monotonic() - begun:.0f} s.")


HEAD = ("", "used", "degree", "NRMSE affine", "NRMSE lifted", "worst ratio", "3 sd", "stands for")


def _simulated(x, h, noise: float, seed: int):
    rng = np.random.default_rng(seed)
    y = h(x[:-1])
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    read = x + noise / 5 * x.std(axis=0) * rng.standard_normal(x.shape)
    T = len(y) // 3
    log = real_logs.Log(ddmhe.History(read[: T + 1], y[:T]), y[T:], x[T + 1 :])
    return _compared(real_logs.Test("", log))


def _compared(test):
    """The lifted estimator, its log, and both errors (N, n) over the recorded spread."""
    history = test.log.history
    lifted, affine = ddmhe.LiftedMhe(history), ddmhe.DdMhe(history)
    if test.x_start is not None:
        lifted.reset(test.x_start)
        affine.reset(test.x_start)
    log = lifted.run(test.log.Y, test.U)
    plain = affine.run(test.log.Y, test.U)
    spread = np.concatenate([x for x, _ in history.recordings]).std(axis=0)
    return (
        lifted,
        log,
        (log.x - test.log.truth) / spread,
        (plain.x - test.log.truth) / spread,
        spread,
    )


def _row(found):
    def nrmse(e):
        return float(np.sqrt(np.nanmean(e**2)))

    used = sum(lifted.chosen for lifted, *_ in found)
    degrees = sorted({lifted.degree for lifted, *_ in found})
    ratios = [nrmse(mine) / max(nrmse(affine), 1e-300) for _, _, mine, affine, _ in found]
    held = [
        np.mean((np.abs(mine) <= 3 * log.std / spread + 1e-12)[np.isfinite(mine)])
        for _, log, mine, _, spread in found
    ]
    stands = np.mean([np.mean(log.status == "lifted") for _, log, *_ in found])
    return [
        f"{used} of {len(found)}",
        ", ".join(map(str, degrees)),
        f"{np.median([nrmse(affine) for _, _, _, affine, _ in found]):.2g}",
        f"{np.median([nrmse(mine) for _, _, mine, _, _ in found]):.2g}",
        f"{max(ratios):.3g}",
        f"{np.mean(held):.1%}",
        f"{stands:.0%}",
    ]


if __name__ == "__main__":
    main()
