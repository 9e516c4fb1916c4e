"""Faults of outputs: sensors that stick, lie by a bias or a gain, come late, spike; and a system
that suddenly runs at another pace."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

import ddmhe
from ddmhe._core import noise_levels
from noisy_systems import Log, masses, oscillator, single_axis, tumbling
from real_logs import Test, pendulums, with_inputs

SIGMA_FLOOR = 1e-6
"""Of the recorded spread: outputs without visible noise have spikes of this size."""


@dataclass(frozen=True)
class Case:
    """One kind of system: its tests, and where faults begin."""

    name: str
    tests: list[Test]
    start: int
    """First sample with the fault, counted from the recording's end,"""
    watch: int
    """and for how many samples it is watched."""
    settings: dict


@dataclass(frozen=True)
class Faulty:
    """Outputs with a fault, and the truth that belongs to them."""

    Y: np.ndarray
    truth: np.ndarray
    hit: np.ndarray
    """Where an entry of Y was changed (N, p)."""
    onset: int | None = None
    """Sample from which on it can be seen, where that is not the fault's first."""


Fault = Callable[[Log, int, np.random.Generator], Faulty]


def cases(runs: int, first: int) -> list[Case]:
    """Simulated ones with seeds from `first` on, and the measured pendulums."""
    seeds = range(first, first + runs)

    def made(make, *rest, **more) -> list[Test]:
        return [Test(str(seed), make(seed, *rest, **more)) for seed in seeds]

    model, scaled = ddmhe.models.detumbling(), {"weights": "scaled"}
    wheels, swings = made(masses, 0.003, 200, 400), made(oscillator, 0.003, 1e-3, 200)
    found = [
        Case("masses", wheels, 150, 200, {}),
        Case("masses, scaled", wheels, 150, 200, scaled),
        Case("oscillator", swings, 80, 100, {}),
        Case("oscillator, scaled", swings, 80, 100, scaled),
        Case("detumbling", made(tumbling, model, 1e-4, after=300), 60, 60, {}),
        Case("bench", made(single_axis), 80, 150, {}),
        Case("pendulum logs", pendulums(), 200, 200, {}),
    ]
    return [case for case in found if case.tests]


def all_systems(runs: int, first: int) -> list[Case]:
    """The same without those of stated weights, and the families of logs with inputs."""
    found = [case for case in cases(runs, first) if not case.settings]
    driven = [(name, tests) for name, tests in with_inputs() if "ignored" not in name]
    return [*found, *(Case(name, tests, 0, 0, {}) for name, tests in driven)]


def sigma(log: Log) -> np.ndarray:
    """Deviation of the outputs' noise (p,): what the recording shows of it, not what was put in."""
    spread = np.vstack([y for _, y in log.history.recordings]).std(axis=0)
    return np.maximum(noise_levels(log.history)[1], SIGMA_FLOOR * spread)


def first_spread(log: Log) -> float:
    """Recorded spread of the first output."""
    return float(np.concatenate([y[:, 0] for _, y in log.history.recordings]).std())


def changed(log: Log, Y: np.ndarray, truth: np.ndarray | None = None) -> Faulty:
    """Outputs that differ from those of the log."""
    rows = min(len(Y), len(log.Y))
    same = (Y[:rows] == log.Y[:rows]) | (np.isnan(Y[:rows]) & np.isnan(log.Y[:rows]))
    return Faulty(Y, log.truth if truth is None else truth, ~same)


def no_fault(log: Log, start: int, rng) -> Faulty:
    """As measured."""
    return changed(log, log.Y)


def stuck(log: Log, start: int, rng) -> Faulty:
    """The first output keeps the value it has."""
    Y = log.Y.copy()
    Y[start:, 0] = Y[start, 0]
    return changed(log, Y)


def stuck_with_noise(log: Log, start: int, rng) -> Faulty:
    """The first output keeps its value, with its noise."""
    Y = log.Y.copy()
    Y[start:, 0] = Y[start, 0] + sigma(log)[0] * rng.standard_normal(len(Y) - start)
    return changed(log, Y)


def bias(size: float) -> Fault:
    """The first output is off by `size` recorded spreads."""

    def fault(log: Log, start: int, rng) -> Faulty:
        Y = log.Y.copy()
        Y[start:, 0] += size * first_spread(log)
        return changed(log, Y)

    return fault


def gain(size: float) -> Fault:
    """The first output is `size` times what it should be."""

    def fault(log: Log, start: int, rng) -> Faulty:
        Y = log.Y.copy()
        Y[start:, 0] *= size
        return changed(log, Y)

    return fault


def delay(samples: int) -> Fault:
    """All outputs come `samples` late, those before the recording's end included."""

    def fault(log: Log, start: int, rng) -> Faulty:
        before = log.history.recordings[-1][1][-samples:]
        whole = np.vstack([before, log.Y])
        Y = log.Y.copy()
        Y[start:] = whole[len(before) + start - samples : len(whole) - samples]
        return changed(log, Y)

    return fault


def pace(rate: float) -> Fault:
    """From `start` on the motion runs `rate` times as fast."""

    def fault(log: Log, start: int, rng) -> Faulty:
        rows = np.arange(len(log.Y))
        at = np.where(rows > start, start + (rows - start) * rate, rows)
        at = at[at <= len(log.Y) - 1]

        def read(values: np.ndarray) -> np.ndarray:
            return np.column_stack([np.interp(at, rows, column) for column in values.T])

        Y = read(log.Y)
        return changed(log, Y, read(log.truth))

    return fault


def spikes(share: float, size: float) -> Fault:
    """That share of the outputs is off by `size` deviations of their noise, up or down."""

    def fault(log: Log, start: int, rng) -> Faulty:
        Y = log.Y.copy()
        hit = rng.random(Y.shape) < share
        hit[:start] = False
        Y += np.where(hit, size * sigma(log) * rng.choice([-1.0, 1.0], Y.shape), 0.0)
        rows = np.flatnonzero(hit.any(axis=1))
        return replace(changed(log, Y), onset=int(rows[0]) if rows.size else len(Y) - 1)

    return fault


def faults() -> Iterator[tuple[str, Fault]]:
    """What is tried, by name."""
    yield "none", no_fault
    yield "stuck", stuck
    yield "stuck, noise goes on", stuck_with_noise
    for size in (0.1, 0.3, 1.0, 3.0):
        yield f"bias {size:g} spread", bias(size)
    for size in (0.5, 0.8, 1.25, 2.0):
        yield f"gain {size:g}", gain(size)
    for samples in (1, 3, 10, 30):
        yield f"late by {samples}", delay(samples)
    for rate in (0.8, 1.1, 1.3, 2.0):
        yield f"pace {rate:g}", pace(rate)
    yield "spikes, 1 % of 100 σ", spikes(0.01, 100.0)
    yield "spikes, 5 % of 10 σ", spikes(0.05, 10.0)


def lagging(test: Test, samples: int) -> Test:
    """The same test with all outputs late by so many samples, recorded ones and later ones alike:
    the first rows of each recording are left out."""
    if samples == 0:
        return test
    h, Y = test.log.history, test.log.Y
    inputs = h.inputs or [None] * len(h.recordings)
    units = {"x_units": h.x_units, "y_units": h.y_units}
    late = []
    for (x, y), u in zip(h.recordings, inputs, strict=True):
        driven = {"u": u[samples:], "u_units": h.u_units} if h.m else {}
        late.append(ddmhe.History(x[samples:], y[:-samples], h.dt, **units, **driven))
    before = h.recordings[-1][1][-samples:]
    if test.x_start is not None:
        before = np.full_like(before, np.nan)
    log = replace(
        test.log,
        history=ddmhe.History.concat(late) if late[1:] else late[0],
        Y=np.vstack([before, Y])[: len(Y)],
    )
    return replace(test, log=log)
