"""The data of a scenario: a recording, and the outputs and true states that follow."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import recordings
from ddmhe._core import DdmheError, History
from ddmhe.campaign.estimators import Noise
from ddmhe.campaign.faults import faulty
from ddmhe.campaign.files import local
from ddmhe.campaign.spec import Scenario, Spec
from ddmhe.campaign.systems import simulated

Array = NDArray[np.float64]

__all__ = ["Data", "data_of"]


@dataclass(frozen=True, eq=False)
class Data:
    """What an estimator gets, and the truth."""

    history: History
    Y: Array
    """Outputs (N, p)."""
    U: Array | None
    """Known inputs (N, m)."""
    x: Array
    """True states (N, n) after each output; NaN where unknown."""
    t: Array
    """Times of the estimates (N,), s after the recording."""
    noise: Noise
    digest: str
    """SHA-256 of a log; empty for a simulation."""


def data_of(spec: Spec, scenario: Scenario) -> Data:
    """The data of a scenario: the same wherever and whenever it is made."""
    system = spec.systems[scenario.system]
    level = spec.noise[scenario.noise]
    own = (scenario.system, PurePosixPath(scenario.source).name, scenario.seed)
    draw = _stream("noise", scenario.noise, *own)
    if system["kind"] == "log":
        history, Y, U, x, digest = _logged(system, scenario.source)
    else:
        U, digest = None, ""
        history, Y, x = _simulated(system, level, _stream("system", *own), draw)
    Y = Y + _each("later", level["later"], history.p) * draw.standard_normal(Y.shape)
    recorded = np.vstack([y for _, y in history.recordings])
    fault = spec.faults[scenario.fault]
    Y = faulty(Y, recorded, history.dt, fault, _stream("fault", scenario.fault, *own))
    t = history.dt * np.arange(1.0, len(Y) + 1)
    return Data(history, Y, U, x, t, Noise(level["x"], level["y"], level["later"]), digest)


def _simulated(
    system: Any, level: Any, of_system: np.random.Generator, draw: np.random.Generator
) -> tuple[History, Array, Array]:
    """The recording of a simulated motion, the outputs after it and their states."""
    motion = simulated(system, of_system)
    T = round(system["recorded"] / system["dt"])
    n, p = motion.x.shape[1], motion.y.shape[1]
    x = motion.x_recorded[: T + 1]
    x = x + _each("x", level["x"], n) * draw.standard_normal(x.shape)
    y = motion.y[:T] + _each("y", level["y"], p) * draw.standard_normal((T, p))
    history = History(x, y, system["dt"], x_units=motion.x_units, y_units=motion.y_units)
    return history, motion.y[T:-1], motion.x[T + 1 :]


def _logged(system: Any, source: str) -> tuple[History, Array, Array | None, Array, str]:
    """A log's recording, outputs, inputs and states, and its SHA-256."""
    skip = ("kind", "files", "sources")
    how = {k: v for k, v in system.items() if k not in skip and v is not None}
    with local(source) as path:
        read = recordings.read(path, **how)
    x = read.x_true
    unknown = np.full((len(read.Y), read.history.n), np.nan)
    return read.history, read.Y, read.U, unknown if x is None else x, read.log.digest or ""


def _each(name: str, value: Any, channels: int) -> Array:
    """One deviation a channel."""
    found = np.asarray(value, dtype=np.float64)
    if found.ndim and found.shape != (channels,):
        raise DdmheError(
            f"noise.{name}: expected a number or {channels} of them, found {len(found)}"
        )
    return np.broadcast_to(found, (channels,))


def _stream(*words: Any) -> np.random.Generator:
    """Random numbers that depend on these words alone."""
    digest = hashlib.sha256(json.dumps(words).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))
