"""Estimators of a campaign: what a spec says of them, and one made for a recording."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmhe._core import DdMhe, History, RigidBodyMhe, setting_names
from ddmhe.baselines import (
    ArxKalman,
    Baseline,
    ErrorStateKalman,
    KoopmanMhe,
    ModelMhe,
    RidgeFir,
)
from ddmhe.campaign.errors import CampaignError
from ddmhe.campaign.tables import Key, check_name, flag, plain, text
from ddmhe.config import setting
from ddmhe.lifted import LiftedMhe

__all__ = ["ESTIMATOR", "Noise", "checked_settings", "kind_of", "made"]

OTHERS: dict[str, Any] = {
    "RigidBodyMhe": RigidBodyMhe,
    "LiftedMhe": LiftedMhe,
    "ErrorStateKalman": ErrorStateKalman,
    "KoopmanMhe": KoopmanMhe,
    "ArxKalman": ArxKalman,
    "RidgeFir": RidgeFir,
    "ModelMhe": ModelMhe,
}
"""Estimators beside `DdMhe`: their classes."""
INTERVALS = ("w_radius", "v_radius", "kappa")
"""Settings of "intervals"."""
KINDS = ("DdMhe", "tuned", *OTHERS, "intervals")
REFIT = ("now", "sliced")


@dataclass(frozen=True)
class Noise:
    """Standard deviations of recorded states (n), recorded outputs (p) and later outputs (p)."""

    x: Any
    y: Any
    later: Any


def _settings(name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise CampaignError(f"{name}: expected a table of settings, found {value!r}")
    found: dict[str, Any] = plain(value)
    return found


ESTIMATOR = {
    "kind": Key(text, None),
    "settings": Key(_settings, {}),
    "knows_noise": Key(flag, False),  # whether it is told the noise's deviations
}
"""Keys of an estimator in a spec."""


def kind_of(where: str, name: str, given: Any) -> str:
    """The kind that an estimator's table names, by default the name itself."""
    kind = given.get("kind", name) if isinstance(given, Mapping) else name
    if kind not in KINDS:
        check_name(f"{where}.kind", kind, KINDS)
    return str(kind)


def checked_settings(where: str, kind: str, settings: Mapping[str, Any]) -> None:
    """An error for settings that the estimator does not have, or whose values it cannot take."""
    if kind in ("DdMhe", "tuned"):
        known: Any = setting_names()
    elif kind == "intervals":
        known = INTERVALS
    else:
        known = list(inspect.signature(OTHERS[kind]).parameters)[1:]
        if kind == "RigidBodyMhe":
            known.remove("fallback")  # an estimator, which no spec can write
    for name, value in settings.items():
        check_name(f"{where}.settings", name, known)
        if kind in ("DdMhe", "tuned"):
            try:
                setting(name, value)
            except ValueError as e:
                raise CampaignError(f"{where}.settings, {e}") from e
    if kind == "RigidBodyMhe" and settings.get("refit", "now") not in REFIT:
        raise CampaignError(
            f"{where}.settings.refit: expected one of {', '.join(REFIT)}, found "
            f"{settings['refit']!r}"
        )


def made(table: Mapping[str, Any], history: History, noise: Noise) -> Any:
    """The estimator of a table for a recording."""
    kind, settings = table["kind"], dict(table["settings"])
    told = table["knows_noise"]
    later = noise.later if told and np.any(np.asarray(noise.later) > 0) else None
    if kind in ("DdMhe", "tuned"):
        settings = {name: setting(name, value) for name, value in settings.items()}
        if later is not None:
            settings = {"output_noise": later} | settings
        return _tuned(history, settings) if kind == "tuned" else DdMhe(history, **settings)
    if kind == "intervals":
        from ddmhe.interval import from_history  # cvxpy comes with it where a gain is designed

        return from_history(history, **settings).observer()
    if told and kind == "RigidBodyMhe":
        settings = {"x_noise": noise.x, "y_noise": noise.y, "output_noise": noise.later} | settings
    if later is not None and kind == "LiftedMhe":
        settings = {"output_noise": later} | settings
    return OTHERS[kind](history, **settings)


def _tuned(history: History, settings: dict[str, Any]) -> DdMhe:
    from ddmhe.tuning import tune

    found = tune(history, output_noise=settings.get("output_noise"))
    return DdMhe(history, **{"start": found.start} | dict(found.settings) | settings)


def in_force(estimator: Any) -> dict[str, Any]:
    """The settings that an estimator runs with, as far as it says."""
    settings = getattr(estimator, "settings", None)
    if settings is None or isinstance(estimator, Baseline):
        return {}
    return {
        name: _word(getattr(settings, name))
        for name in ("horizon", "rho", "mu", "weights", "process_noise", "start", "space")
        if hasattr(settings, name)
    }


def _word(value: Any) -> Any:
    """A setting in values of JSON."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value if value is None or isinstance(value, str | int | float) else str(value)
