"""The systems of the papers, for simulation: what an experiment would have recorded.

Each model is a frozen dataclass whose fields are its parameters (SI units); ``simulate`` makes a
`Recording`. The estimator never sees a model, only recordings.

- `detumbling`: 3-DOF eddy-current braking of a tumbling satellite, Liu et al. 2026, Section IV-B.
- `spin_down`: the single-axis bench, Liu et al. 2026, Section IV-A.
- `pendulum`: the planar pendulum of the interval paper, (60).
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from ddmhe._core import DdmheError
from ddmhe.checks import word
from ddmhe.models.bench import SpinDown
from ddmhe.models.planar_pendulum import Pendulum
from ddmhe.models.recording import Recording
from ddmhe.models.satellite import Detumbling
from ddmhe.models.torque_curve import TorqueCurve

__all__ = [
    "Detumbling",
    "Pendulum",
    "Recording",
    "SpinDown",
    "TorqueCurve",
    "detumbling",
    "pendulum",
    "spin_down",
]


def detumbling(**overrides: Any) -> Detumbling:
    """The 3-DOF case of Liu et al. 2026, Section IV-B, with any field of `Detumbling`
    overridden.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
    >>> record.t.shape, record.x.shape, record.y.shape  # rad/s, N m
    ((301,), (301, 3), (301, 3))
    """
    return _build(Detumbling, overrides)


def spin_down(**overrides: Any) -> SpinDown:
    """The single-axis bench of Liu et al. 2026, Section IV-A, with any field of `SpinDown`
    overridden.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.spin_down().simulate(duration=2.0, dt=0.02, noise=0.001)
    >>> bool(record.x[-1, 0] < record.x[0, 0])  # rad/s: it is braked
    True
    """
    return _build(SpinDown, overrides)


def pendulum(**overrides: Any) -> Pendulum:
    """The pendulum of the interval paper, (60), with any field of `Pendulum` overridden.

    Examples
    --------
    >>> import ddmhe
    >>> ddmhe.models.pendulum().simulate(duration=10.0, dt=0.05, noise=0.01).x.shape
    (201, 2)
    """
    return _build(Pendulum, overrides)


_M = TypeVar("_M", Detumbling, SpinDown, Pendulum)


def _build(model: type[_M], overrides: dict[str, Any]) -> _M:
    known = [f.name for f in fields(model)]
    unknown = [name for name in overrides if name not in known]
    if unknown:
        raise DdmheError(
            f"{word(unknown[0])}: expected a parameter of {model.__name__}: {', '.join(known)}"
        )
    return model(**overrides)
