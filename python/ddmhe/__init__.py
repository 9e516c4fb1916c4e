"""Estimate the state of a system from its outputs and one recording, with no model.

The recording, a `History` of states and outputs taken together, stands in for the model through
Willems' fundamental lemma. `DdMhe` solves a small constrained optimisation over a moving window at
every sample (data-driven moving horizon estimation; Liu et al. 2026, arXiv 2301.05351):

>>> import ddmhe
>>> record = ddmhe.models.detumbling().simulate(duration=120.0, dt=0.1, noise=0.01)
>>> history = ddmhe.History(record.x[:201], record.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
>>> estimator = ddmhe.DdMhe(history)
>>> estimate = estimator.step(record.y[200])   # estimate.x is the state at sample 201

Arrays are float64 and time-major: row k is sample k. Wrong inputs raise `DdmheError` (a
`ValueError`) or one of its kinds; what the optimisation finds is `Estimate.status`, never an
exception."""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING, Any

from ddmhe import models
from ddmhe._core import (
    DdMhe,
    DdmheError,
    Estimate,
    Evidence,
    EvidenceLog,
    Exact,
    History,
    InfeasibleError,
    Log,
    ModelViolationError,
    NotFiniteError,
    RankError,
    RankReport,
    Ridge,
    RigidBodyMhe,
    RigidBodyReport,
    ShapeError,
    Truncated,
    Zonotope,
    run_many,
)
from ddmhe.reasons import Reason

if TYPE_CHECKING:
    from ddmhe import baselines, campaign, config, design, interval, plot, recordings, report
    from ddmhe.lifted import LiftedMhe
    from ddmhe.tuning import Tuning, tune

__version__ = _version("ddmhe")

# Loaded on first use, as cvxpy is by what runs a programme: they take longer to import than an
# estimator to build.
_MODULES = ("baselines", "campaign", "config", "design", "interval", "plot", "recordings", "report")
_LAZY = {name: f"ddmhe.{name}" for name in _MODULES} | {
    "tune": "ddmhe.tuning",
    "Tuning": "ddmhe.tuning",
    "LiftedMhe": "ddmhe.lifted",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = _import_module(_LAZY[name])
    value = module if name in _MODULES else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


__all__ = [
    "DdMhe",
    "DdmheError",
    "Estimate",
    "Evidence",
    "EvidenceLog",
    "Exact",
    "History",
    "InfeasibleError",
    "LiftedMhe",
    "Log",
    "ModelViolationError",
    "NotFiniteError",
    "RankError",
    "RankReport",
    "Reason",
    "Ridge",
    "RigidBodyMhe",
    "RigidBodyReport",
    "ShapeError",
    "Truncated",
    "Tuning",
    "Zonotope",
    "baselines",
    "campaign",
    "config",
    "design",
    "interval",
    "models",
    "plot",
    "recordings",
    "report",
    "run_many",
    "tune",
]
