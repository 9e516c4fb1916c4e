"""Systems of a campaign: what a spec says of them, and the experiment of one seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import models
from ddmhe.campaign.tables import (
    Key,
    amount,
    check_whole_from,
    flag,
    one_of,
    positive,
    span,
    span_above_0,
    span_from_0,
    text,
    texts,
)
from ddmhe.models import Recording

Array = NDArray[np.float64]

__all__ = ["SYSTEMS", "simulated", "state_names"]

CONDUCTIVITY, GRADIENT = 0.89e5, 70e-4
"""Effective magnetic tensor per eigenvalue, S·m⁴; deviation of the field's gradient, T/m."""
NO_BODY = 0.49
"""Largest share of the sum of moments of inertia that one of them has: that of a rod is a half."""


@dataclass(frozen=True)
class Kind:
    """A kind of system: its keys in a spec and its states."""

    keys: Mapping[str, Key]
    states: tuple[str, ...] = ()
    model: Callable[[Mapping[str, Any], np.random.Generator], Any] | None = None


def _satellite(table: Mapping[str, Any], draw: np.random.Generator) -> models.Detumbling:
    """A tumbling target; drawn in the order inertia, conductivity, field, gradient, place, spin."""
    if not table["dispersed"]:
        return models.detumbling()
    inertia = _turned(draw, _moments(table["inertia"], draw))
    tensor = CONDUCTIVITY * _turned(draw, _three(draw, table["conductivity"]))
    field = _directed(draw, draw.uniform(*table["field"]))
    gradient = draw.standard_normal((3, 3))
    gradient = gradient + gradient.T
    gradient -= np.eye(3) * np.trace(gradient) / 3
    place = draw.uniform(-1, 1, 3)
    return models.detumbling(
        inertia=inertia,
        M_eff=tensor,
        B=field,
        r=place,
        Lambda=GRADIENT * gradient,
        omega_0=_directed(draw, np.deg2rad(draw.uniform(*table["rate"]))),
    )


def _moments(limits: list[float], draw: np.random.Generator) -> Array:
    """Principal moments (3,) that a body can have."""
    moments = _three(draw, limits)
    while moments.max() >= NO_BODY * moments.sum():
        moments = _three(draw, limits)
    return moments


def _three(draw: np.random.Generator, limits: Sequence[float]) -> Array:
    return draw.uniform(limits[0], limits[1], 3)


def _turned(draw: np.random.Generator, values: Array) -> Array:
    """A symmetric matrix (3, 3) of these eigenvalues along random axes."""
    axes = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    found = axes @ np.diag(values) @ axes.T
    return np.asarray(0.5 * (found + found.T))


def _directed(draw: np.random.Generator, length: float) -> Array:
    """A vector (3,) of this length in a random direction."""
    found = draw.standard_normal(3)
    return np.asarray(length * found / np.linalg.norm(found))


def _bench(table: Mapping[str, Any], draw: np.random.Generator) -> models.SpinDown:
    """The single-axis bench with another target, magnet and speed."""
    return models.spin_down(
        inertia=draw.uniform(*table["inertia"]),
        eddy=draw.uniform(*table["eddy"]),
        omega_0=draw.uniform(*table["speed"]),
    )


def _pendulum(table: Mapping[str, Any], draw: np.random.Generator) -> models.Pendulum:
    """The pendulum from another start."""
    return models.pendulum(
        stiffness=draw.uniform(*table["stiffness"]),
        x_0=np.array([draw.uniform(*table["angle"]), draw.uniform(*table["rate"])]),
    )


def _timed(dt: float, recorded: float, duration: float) -> dict[str, Key]:
    return {
        "kind": Key(text),
        "dt": Key(positive, dt),
        "recorded": Key(positive, recorded),
        "duration": Key(positive, duration),
        "integrator": Key(one_of("euler", "accurate"), "euler"),
    }


def _any(name: str, value: Any) -> Any:
    return value


_READING = ("time", "time_unit", "dt", "start", "sep", "decimal", "comment", "encoding", "missing",
            "unwrap", "delay", "resample", "decimate", "duplicates", "sort")  # fmt: skip
SYSTEMS: dict[str, Kind] = {
    "satellite": Kind(
        _timed(0.1, 20.0, 100.0)
        | {
            "dispersed": Key(flag, True),
            "inertia": Key(span_above_0, [1000.0, 6000.0]),  # principal moments, kg·m²
            "conductivity": Key(span_from_0, [1.5, 7.0]),  # eigenvalues of M_eff, 0.89e5 S·m⁴
            "field": Key(span_from_0, [50e-4, 110e-4]),  # T
            "rate": Key(span_from_0, [2.0, 20.0]),  # at the start, deg/s
        },
        ("wx", "wy", "wz"),
        _satellite,
    ),
    "bench": Kind(
        _timed(0.01, 0.5, 2.5)
        | {
            "inertia": Key(span_above_0, [2.5e-3, 1e-2]),  # kg·m²
            "eddy": Key(span_from_0, [2.5e-3, 1e-2]),  # N·m·s
            "speed": Key(span, [20.0, 40.0]),  # rad/s
        },
        ("speed",),
        _bench,
    ),
    "pendulum": Kind(
        _timed(0.065, 6.5, 13.0)
        | {
            "stiffness": Key(span_above_0, [1.0, 1.0]),  # 1/s²
            "angle": Key(span, [0.5, 1.2]),  # rad
            "rate": Key(span, [-0.3, 0.3]),  # rad/s
        },
        ("angle", "rate"),
        _pendulum,
    ),
    "log": Kind(
        {
            "kind": Key(text),
            "files": Key(text),
            "state": Key(texts),
            "output": Key(texts),
            "input": Key(texts, []),
            "history": Key(positive),
            "gaps": Key(one_of("fill", "error"), "fill"),
        }
        | {name: Key(amount if name in ("resample",) else _any, None) for name in _READING}
        | {"decimate": Key(check_whole_from(1), 1)}
    ),
}
"""Kinds of systems by name."""


def state_names(table: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the states of a system."""
    kind = SYSTEMS[table["kind"]]
    return kind.states or tuple(table["state"])


def simulated(table: Mapping[str, Any], draw: np.random.Generator) -> Recording:
    """The motion of one seed, without noise: recorded part and what follows."""
    kind = SYSTEMS[table["kind"]]
    assert kind.model is not None
    whole = _steps(table, "recorded") + _steps(table, "duration")
    model = kind.model(table, draw)
    found: Recording = model.simulate(
        whole * table["dt"], table["dt"], integrator=table["integrator"]
    )
    return found


def _steps(table: Mapping[str, Any], name: str) -> int:
    steps: float = table[name] / table["dt"]
    return round(steps)
