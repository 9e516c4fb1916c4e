"""Measured logs for the studies, from the folder that DDMHE_DATA names: `repoimu-pendulum` and
`input-logs`. Without the variable there are none."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ddmhe
from ddmhe.reproduce.driven import CASES, Signals, task_of
from ddmhe.reproduce.real import pendulum_task
from noisy_systems import Log


@dataclass(frozen=True, eq=False)
class Test:
    """One log to be estimated."""

    name: str
    log: Log
    U: np.ndarray | None = None
    """Known inputs (N, m)."""
    x_start: np.ndarray | None = None
    """Where the test starts; None where it goes on after the recording."""


def folder(name: str) -> Path | None:
    """A folder of logs, None where there is none."""
    data = os.environ.get("DDMHE_DATA")
    found = None if data is None else Path(data) / name
    return found if found is not None and found.is_dir() else None


def pendulums() -> list[Test]:
    """The measured pendulums: gyroscope from accelerometer, 150 samples recorded."""
    logs = folder("repoimu-pendulum")
    if logs is None:
        return []
    tasks = [(path, pendulum_task(path)) for path in sorted(logs.glob("*.csv"))]
    return [
        Test(path.stem.replace("_Trial1_Segment_", "s"), Log(task.history, task.Y, task.x))
        for path, task in tasks
    ]


def with_inputs() -> Iterator[tuple[str, list[Test]]]:
    """The families of `input-logs` by name: with the inputs known, and ignored."""
    logs = folder("input-logs")
    if logs is None:
        return
    for name, case in CASES.items():
        task = task_of(case, logs)
        yield name, _tests(name, task)
        if case.input:
            yield f"{name}, u ignored", _tests(name, task.as_told(Signals.blind, "y"))


def _tests(name, task) -> list[Test]:
    history = task.history()
    return [
        Test(
            f"{name} {i + 1}",
            Log(history, test.y, test.x[1:]),
            test.u if test.u.shape[1] else None,
            None if test.goes_on else test.x[0],
        )
        for i, test in enumerate(task.tests)
    ]


def estimator(test: Test, **settings) -> ddmhe.DdMhe:
    """At the start of a test."""
    if test.x_start is None:
        return ddmhe.DdMhe(test.log.history, **settings)
    est = ddmhe.DdMhe(test.log.history, **{"start": "state"} | settings)
    est.reset(test.x_start)
    return est
