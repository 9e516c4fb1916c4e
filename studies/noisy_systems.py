"""Recordings of noisy systems of many kinds, and what follows them: where weights taken from the
recording are right, and where not."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

import ddmhe
from ddmhe.cases import bench, satellite

BODIES = 11
"""Tumbling bodies."""
OSCILLATOR = 0.999 * np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])


@dataclass(frozen=True)
class Log:
    """A recording and what follows."""

    history: ddmhe.History
    Y: np.ndarray
    """Outputs (N, p)."""
    truth: np.ndarray
    """States (N, n) after them."""
    N: float = 0.0
    """Deviation of the reading noise on the recorded states; 0 for none."""
    R: float = 0.0
    """Of the outputs' noise."""
    scale: float = 1.0


def linear(A, C, start, sizes, T, after, rng):
    """x⁺ = A x + w, y = C x + v; `sizes` are the deviations of w, v and of the recorded x."""
    w, v, read = sizes
    x = [np.array(start, float)]
    for _ in range(T + after):
        x.append(A @ x[-1] + w * rng.standard_normal(len(A)))
    x = np.array(x)
    y = x[:-1] @ C.T + v * rng.standard_normal((T + after, len(C)))
    recorded = x[: T + 1] + read * rng.standard_normal((T + 1, len(A)))
    return Log(ddmhe.History(recorded, y[:T], 0.1), y[T:], x[T + 1 :], read, v)


def masses(seed, x_noise, T=200, after=1000):
    """Two masses between springs, positions measured; disturbance 1e-3, output noise .02."""
    k_1, k_2, c = 1.0, 0.7, 0.05
    rates = [[0, 1, 0, 0], [-k_1 - k_2, -c, k_2, 0], [0, 0, 0, 1], [k_2, 0, -k_1 - k_2, -c]]
    A, C, rng = scipy.linalg.expm(0.1 * np.array(rates)), np.eye(4)[[0, 2]], _rng(seed)
    return linear(A, C, [1.0, 0.0, -0.5, 0.0], (1e-3, 0.02, x_noise), T, after, rng)


def oscillator(seed, x_noise, w, T):
    """A slow oscillation, one of two states measured."""
    return linear(OSCILLATOR, np.eye(1, 2), [1.0, 0.0], (w, 0.01, x_noise), T, T, _rng(seed, 1))


def noise_driven(seed, phi, n, x_noise, T):
    """Decaying modes, the slowest by phi a sample, that noise alone moves; at rest at first."""
    rng = _rng(seed, 2)
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A, C = V @ np.diag(phi * np.linspace(1, 0.7, n)) @ V.T, rng.standard_normal((1 + (n > 2), n))
    return linear(A, C, np.zeros(n), (0.1, 0.1, x_noise), T, T, rng)


def pendulum(seed, swing, x_noise, T):
    """Let go at `swing` rad, angle measured."""
    dt, rng, x = 0.065, _rng(seed, 3), [np.array([swing, 0.0])]
    for _ in range(2 * T):
        angle, rate = x[-1]
        x.append(np.array([angle + dt * rate, rate - dt * (np.sin(angle) + 0.05 * rate)]))
    x = np.array(x)
    y = x[:-1, :1] + 0.01 * rng.standard_normal((2 * T, 1))
    read = x[: T + 1] + x_noise * rng.standard_normal((T + 1, 2))
    return Log(ddmhe.History(read, y[:T], dt), y[T:], x[T + 1 :], x_noise, 0.01)


def body(number):
    """A tumbling body of random inertia, axes and spin."""
    rng = _rng(number, 4)
    moments = np.sort(rng.uniform(2000, 6000, 3))[::-1]
    moments[0] = min(moments[0], 0.95 * (moments[1] + moments[2]))
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    spin = rng.standard_normal(3)
    spin *= np.deg2rad(rng.uniform(3, 20)) / np.linalg.norm(spin)
    inertia = axes @ np.diag(moments) @ axes.T
    return ddmhe.models.detumbling(inertia=0.5 * (inertia + inertia.T), omega_0=spin)


def tumbling(seed, model, x_noise, T=satellite.T, after=None):
    """A satellite's rates by the braking torque, noise .01 N·m; deg/s."""
    after = T if after is None else after
    record = model.simulate((T + after) * satellite.DT, satellite.DT, noise=0.01, seed=seed)
    x = record.x[: T + 1] + x_noise * _rng(seed, 5).standard_normal((T + 1, 3))
    history = ddmhe.History(x, record.y[:T], satellite.DT, x_units="rad/s", y_units="N·m")
    return Log(history, record.y[T:-1], record.x[T + 1 :], x_noise, 0.01, 180 / np.pi)


def spin_down(seed, x_noise, T):
    """A spinning target that a magnet brakes, its speed read with noise."""
    record = ddmhe.models.spin_down().simulate(0.02 * T, 0.01)
    rng = _rng(seed, 6)
    y = record.y + 2e-4 * rng.standard_normal(record.y.shape)
    x = record.x[: T + 1] + x_noise * rng.standard_normal((T + 1, 1))
    return Log(ddmhe.History(x, y[:T], 0.01), y[T:-1], record.x[T + 1 :], x_noise, 2e-4)


def single_axis(seed, *, noisy=False, kicked=False):
    """The paper's bench, its encoder rounding the recorded state; rad/s."""
    own, T = bench.NOMINAL, round(bench.HISTORY / bench.DT)
    steps = round(bench.DURATION / bench.DT)
    t, kick = bench.DT * np.arange(steps + 1), np.zeros((steps, 1))
    if kicked:
        during = (t[:-1] >= bench.EVENT[0]) & (t[:-1] < bench.EVENT[0] + 0.1)
        kick[during] = own.kick / during.sum()
    record = own.model.simulate(bench.DURATION, bench.DT, disturbance=kick)
    level = np.full(steps + 1, own.deviation)
    if noisy:
        event = (t >= bench.EVENT[0]) & (t < bench.EVENT[1])
        level[event] *= bench.LARGE_NOISE / bench.NOISE
    y = record.y + level[:, None] * _rng(seed, 7).standard_normal(record.y.shape)
    history = ddmhe.History(record.x_recorded[: T + 1], y[:T], bench.DT)
    count = 2 * np.pi / (bench.ENCODER * bench.DT)
    return Log(history, y[T:-1], record.x[T + 1 :], count / np.sqrt(12), own.deviation)


def _rng(seed, kind=0):
    return np.random.default_rng([seed, kind])


def kinds(first, T):
    """Name of each kind, whether it is linear, and its logs; seeds from `first` on."""
    ten = range(first, first + 10)
    for read in (0.0, 0.003, 0.01):
        seeds = range(first, first + 30)
        yield f"masses, x ± {read:g}", True, [masses(s, read, T, T) for s in seeds]
    for read, w in ((0.0, 1e-3), (0.003, 1e-3), (0.01, 1e-3), (0.01, 0.0)):
        name = f"oscillator, w {w:g}, x ± {read:g}"
        yield name, True, [oscillator(s, read, w, T) for s in ten]
    driven = [
        noise_driven(s, phi, n, read, T)
        for phi in (0.6, 0.8, 0.9, 0.95, 0.99)
        for n in (1, 3)
        for read in (0.0, 0.05)
        for s in ten
    ]
    yield "noise-driven", True, driven
    for read in (0.01, 0.1):
        yield f"spin-down, x ± {read:g}", False, [spin_down(s, read, T) for s in ten]
    for swing, read in ((0.1, 0.003), (0.1, 0.02), (1.0, 0.003), (1.0, 0.02), (2.0, 0.003)):
        name = f"pendulum from {swing:g} rad, x ± {read:g}"
        yield name, False, [pendulum(s, swing, read, T) for s in ten]
    bodies = [body(first + i) for i in range(BODIES)]
    for read in (1e-4, 1e-3, 1e-2):
        logs = [tumbling(s, model, read, T) for model in bodies for s in ten[:3]]
        yield f"tumbling, x ± {read:g}", False, logs
