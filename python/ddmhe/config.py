"""Settings of an estimator from a TOML file: the keys are the keywords of `DdMhe`, the values
TOML's own.

```toml
horizon = 20
rho = 0.9
x_bounds = [-1.0, 1.0]           # or [[-1.0, -2.0], [1.0, 2.0]], one number per state
equilibrium = [[0.0], [0.0]]     # x_e, y_e
missing = [-9999, 999]           # for the command line: numbers of a log that say "not measured"
space = { kind = "truncated", rank = 5 }   # or "auto", "exact", { kind = "ridge", weight = 1e-2, normalised = true }

[certificate]                    # as `ddmhe design` writes it, in the place of rho and mu
eta = 0.95
P = [[1.0]]
Q = [[2.0]]
R = [[0.5]]
```
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import tomli_w

from ddmhe._core import DdmheError, Exact, Ridge, Truncated
from ddmhe.checks import check_kind, check_path, shown
from ddmhe.files import write_text

if TYPE_CHECKING:
    from ddmhe.design.certificate import Certificate

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Space = Exact | Truncated | Ridge | str

__all__ = ["READING", "ConfigError", "Space", "read_config", "space_from_text", "write_config"]


READING = ("missing",)
"""Keys that say how to read a log: arguments of `read_log`, not of `DdMhe`."""


class ConfigError(DdmheError):
    """A configuration file cannot be used."""


def read_config(path: str | Path) -> dict[str, Any]:
    """Keywords of DdMhe, and of `read_log` (READING), from a TOML file.

    ConfigError in one sentence naming the file and the key.
    """
    check_path("path", path)
    try:
        with open(path, "rb") as f:
            table = tomllib.load(f)
    except FileNotFoundError:
        raise ConfigError(f"{path}: expected a configuration file, found no such file") from None
    except OSError as e:
        raise ConfigError(
            f"{path}: expected a readable configuration file, found that it is not ({e.strerror})"
        ) from e
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise ConfigError(
            f"{path}: expected a TOML file, found an error in it ({' '.join(str(e).split())})"
        ) from e
    return {key: _setting(str(path), key, value) for key, value in table.items()}


def write_config(path: str | Path, settings: Mapping[str, Any]) -> None:
    """Keywords of DdMhe as a file that `read_config` reads back: arrays as lists, spaces and
    certificates as tables."""
    if not isinstance(settings, Mapping):
        raise ConfigError(f"settings: expected keywords of DdMhe, found {shown(settings)}")
    try:
        text = tomli_w.dumps({key: _plain(value) for key, value in settings.items()})
    except (TypeError, ValueError, AttributeError) as e:
        raise ConfigError(
            f"settings: expected keywords of DdMhe that a file can hold, found others ({e})"
        ) from e
    write_text(path, text)


def _plain(value: Any) -> Any:
    """A setting in TOML's own values."""
    if isinstance(value, Exact):
        return "exact"
    if isinstance(value, Ridge):
        return {"kind": "ridge", "weight": value.weight, "normalised": value.normalised}
    if isinstance(value, Truncated):
        known = {"rank": value.rank, "tol": value.tol}
        return {"kind": "truncated"} | {k: v for k, v in known.items() if v is not None}
    if hasattr(value, "eta"):
        parts = {name: getattr(value, name) for name in ("eta", "growth", "residual", *_MATRICES)}
        table = {k: _plain(v) for k, v in parts.items() if v is not None}
        if value.identified:
            table["identified"] = True
        if value.uncertainty is not None:
            u = value.uncertainty
            table["uncertainty"] = {"metric": _plain(u.metric), "w": u.w, "v": u.v}
        return table
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def space_from_text(text: str) -> Space:
    """A trajectory space from ``auto``, ``exact``, ``truncated:RANK`` or ``ridge:WEIGHT``;
    ConfigError for others."""
    check_kind("space", text, str, "auto, exact, truncated:RANK or ridge:WEIGHT")
    kind, _, argument = text.partition(":")
    if text in ("auto", "exact"):
        return "auto" if text == "auto" else Exact()
    try:
        if kind == "truncated":
            return Truncated(rank=int(argument))
        if kind == "ridge":
            return Ridge(float(argument))
    except (ValueError, OverflowError):
        pass
    raise ConfigError(
        f"space: expected auto, exact, truncated:RANK or ridge:WEIGHT, found {text!r}"
    )


def _is_whole(value: object) -> bool:
    """An integer of TOML's 64 bits."""
    return isinstance(value, int) and not isinstance(value, bool) and -(2**63) <= value < 2**63


def _is_number(value: object) -> bool:
    return isinstance(value, float) or _is_whole(value)


def _is_numbers(value: object) -> bool:
    """A list of numbers or of lists of numbers."""
    return isinstance(value, list) and all(_is_number(v) or _is_numbers(v) for v in value)


_EXPECTED: dict[str, tuple[str, Callable[[object], bool]]] = {
    "horizon": ("a whole number", _is_whole),
    "rho": ("a number", _is_number),
    "mu": ("a number", _is_number),
    "weights": ('"auto", "paper" or "scaled"', lambda v: isinstance(v, str)),
    "x_prior": ("a list of numbers", _is_numbers),
    "x_bounds": ("a list [lo, hi]", _is_numbers),
    "x_center": ('"history"', lambda v: isinstance(v, str)),
    "v_bounds": ("a list [lo, hi]", _is_numbers),
    "equilibrium": ("a list [x_e, y_e]", _is_numbers),
    "warm_start": ("true or false", lambda v: isinstance(v, bool)),
    "start": (
        '"recording", "state" or "unknown"',
        lambda v: v in ("recording", "state", "unknown"),
    ),
    "space": ("a text or a table", lambda v: isinstance(v, str | dict)),
    "certificate": ("a table", lambda v: isinstance(v, dict)),
    "disturbance": ("a list [initial, w, v]", _is_numbers),
    "missing": (
        "a list of finite numbers",
        lambda v: (
            isinstance(v, list) and all(_is_number(x) and math.isfinite(cast(float, x)) for x in v)
        ),
    ),
}
_SPACES: dict[str, tuple[type[Truncated] | type[Ridge] | type[Exact], tuple[str, ...]]] = {
    "exact": (Exact, ()),
    "truncated": (Truncated, ("rank", "tol")),
    "ridge": (Ridge, ("weight", "normalised")),
}
_ARGUMENTS: dict[str, tuple[str, Callable[[object], bool]]] = {
    "rank": ("a whole number", lambda v: _is_whole(v) and cast(int, v) >= 0),
    "tol": ("a number", _is_number),
    "weight": ("a number", _is_number),
    "normalised": ("true or false", lambda v: isinstance(v, bool)),
}
_MATRICES = ("P", "Q", "R", "A", "C", "e", "r")


def _setting(path: str, key: str, value: Any) -> Any:
    if key not in _EXPECTED:
        raise ConfigError(f"{path}: expected one of the keys {', '.join(_EXPECTED)}, found {key!r}")
    expected, fits = _EXPECTED[key]
    if not fits(value):
        raise ConfigError(f"{path}, {key}: expected {expected}, found {value!r}")
    if key == "certificate":
        return _certificate(path, value)
    if key != "space":
        return tuple(value) if key == "disturbance" else value
    try:
        return space_from_text(value) if isinstance(value, str) else _space_from_table(value)
    except ConfigError as e:
        raise ConfigError(f"{path}, {e}") from e


def _space_from_table(table: dict[str, Any]) -> Space:
    kind, arguments = table.get("kind"), {k: v for k, v in table.items() if k != "kind"}
    if kind not in _SPACES:
        raise ConfigError(f"space: expected kind {', '.join(map(repr, _SPACES))}, found {kind!r}")
    space, known = _SPACES[kind]
    for name, value in arguments.items():
        if name not in known:
            raise ConfigError(
                f"space: expected {' or '.join(known) or 'no argument'} for {kind}, found {name!r}"
            )
        wanted, fits = _ARGUMENTS[name]
        if not fits(value):
            raise ConfigError(f"space: expected {wanted} for {name}, found {value!r}")
    if kind == "ridge" and "weight" not in arguments:
        raise ConfigError("space: expected a weight for ridge, found none")
    return space(**arguments)


def _certificate(path: str, table: dict[str, Any]) -> Certificate:
    """A certificate as `write_config` wrote it; DdMhe checks its matrices."""
    from ddmhe.design.certificate import Certificate, Uncertainty

    known = {"eta", "growth", "residual", "uncertainty", "identified", *_MATRICES}
    for name, value in table.items():
        if name not in known:
            raise ConfigError(
                f"{path}, certificate: expected one of {', '.join(sorted(known))}, found {name!r}"
            )
        fits = (
            isinstance(value, dict)
            if name == "uncertainty"
            else (_is_number(value) or _is_numbers(value))
        )
        fits = isinstance(value, bool) if name == "identified" else fits
        if not fits:
            wanted = "true or false" if name == "identified" else "numbers"
            raise ConfigError(f"{path}, certificate: expected {wanted} for {name}, found {value!r}")
    missing = [name for name in ("eta", "P", "Q", "R") if name not in table]
    if missing:
        raise ConfigError(f"{path}, certificate: expected eta, P, Q and R, found no {missing[0]}")
    try:
        arrays: dict[str, Any] = {
            name: np.array(table[name], dtype=np.float64) for name in _MATRICES if name in table
        }
        spread = table.get("uncertainty")
        uncertainty = spread and Uncertainty(
            np.array(spread["metric"], dtype=np.float64), spread["w"], spread["v"]
        )
    except (ValueError, KeyError, TypeError) as e:
        raise ConfigError(
            f"{path}, certificate: expected rectangular matrices, found others ({e})"
        ) from e
    numbers: dict[str, Any] = {
        name: table[name] for name in ("eta", "growth", "identified") if name in table
    }
    # inf: never verified
    return Certificate(
        **arrays, **numbers, uncertainty=uncertainty, residual=table.get("residual", float("inf"))
    )
