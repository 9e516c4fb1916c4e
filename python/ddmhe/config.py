"""Settings of an estimator from a TOML file: the keys are the keywords of `DdMhe`, the values
TOML's own. Which keys and values there are, the compiled core knows (`check_settings`).

```toml
horizon = 20
rho = 0.9
x_bounds = [-1.0, 1.0]           # or [[-1.0, -2.0], [1.0, 2.0]], one number per state
soft = 10.0                      # what leaving bounds costs, or { x = 10.0, v = 100.0 }
equilibrium = [[0.0], [0.0]]     # x_e, y_e, and u_e of a system with inputs
weights = "recorded"             # without rho and mu; or "scaled", "paper"
process_noise = "residual"       # or "recorded", "none", or [[1e-4, 0.0], [0.0, 1e-4]]
w_bounds = [-0.1, 0.1]
output_noise = 0.01              # or one an output, [0.01, 0.02]
evidence = true                  # false: estimates do not say how far to trust them
gate = 5.0                       # or "auto": outputs that cannot be right are rejected
stuck = "missing"                # an output that is stuck counts as not measured
start = "unknown"                # or "auto", "recording", "state"
missing = [-9999, 999]           # for the command line: numbers of a log that say "not measured"
delay = { acc_x = 0.02 }         # for the command line: by how much outputs are late, s; or 0.02
space = { kind = "truncated", rank = 5 }   # or "auto", "exact", or a ridge:
# space = { kind = "ridge", weight = 1e-2, normalised = true }

[certificate]                    # as `ddmhe design` writes it, in the place of rho and mu
eta = 0.95
P = [[1.0]]
Q = [[2.0]]
R = [[0.5]]
```
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from ddmhe._core import DdmheError, Exact, Ridge, Truncated, check_settings, setting_names
from ddmhe.checks import (
    check_kind,
    check_number,
    check_path,
    did_you_mean,
    file_words,
    reason,
    shown,
)
from ddmhe.files import write_text

if TYPE_CHECKING:
    from ddmhe.design.certificate import Certificate

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Space = Exact | Truncated | Ridge | str

__all__ = [
    "READING",
    "ConfigError",
    "Space",
    "plain_settings",
    "read_config",
    "setting",
    "space_from_text",
    "write_config",
]


READING = ("missing", "delay")
"""Keys that say how to read a log: arguments of `read_log`, not of `DdMhe`."""
SPACES: dict[str, type[Exact] | type[Truncated] | type[Ridge]] = {
    "exact": Exact,
    "truncated": Truncated,
    "ridge": Ridge,
}
"""Kinds of a space; the other keys of its table are the arguments of the class."""
CERTIFICATE = (
    *("eta", "growth", "residual"),
    *("P", "Q", "R", "A", "B", "C", "D", "e", "r"),
    *("identified", "uncertainty"),
)
"""Attributes of a certificate that a file holds, in its order."""
UNCERTAINTY = ("metric", "w", "v")
NOTHING = "none"
"""A process_noise of None, which TOML does not have."""


class ConfigError(DdmheError):
    """A configuration file cannot be used."""


def read_config(path: str | Path) -> dict[str, Any]:
    """Keywords of DdMhe, and of `read_log` (READING), from a TOML file.

    ConfigError in one sentence naming the file and the key.
    """
    check_path("path", path)
    named, table = file_words(path), read_table(path)
    known = (*setting_names(), *READING)
    for key in table:
        if key not in known:
            raise ConfigError(
                f"{named}: expected one of the keys {', '.join(known)}, "
                f"found {shown(key)}{did_you_mean(key, known)}"
            )
    try:
        return {key: setting(key, value) for key, value in table.items()}
    except DdmheError as e:
        raise ConfigError(f"{named}, {e}") from e


def read_table(path: str | Path) -> dict[str, Any]:
    named = file_words(path)
    try:
        with open(path, "rb") as f:
            return tomllib.load(f)
    except FileNotFoundError:
        raise ConfigError(f"{named}: expected a configuration file, found no such file") from None
    except OSError as e:
        raise ConfigError(
            f"{named}: expected a readable configuration file, found that it is not ({e.strerror})"
        ) from e
    except (ValueError, RecursionError) as e:  # not TOML, not UTF-8, beyond what Python converts
        raise ConfigError(
            f"{named}: expected a TOML file, found an error in it ({reason(e)})"
        ) from e


def setting(key: str, value: Any) -> Any:
    """A setting from TOML's values, as DdMhe takes it; DdmheError for one that it does not have."""
    if key == "delay":
        numbers = value.values() if isinstance(value, dict) else [value]
        for number in numbers:
            check_number(key, number, "seconds, or seconds by column", lambda _: True)
        return value
    if key == "missing":
        for one in check_kind(key, value, list, "a list of finite numbers and words"):
            if not isinstance(one, str) or not one.strip():
                check_number(key, one, "a list of finite numbers and words", lambda _: True)
        return value
    if key == "space":
        value = _space(value)
    elif key == "certificate":
        value = _certificate(value)
    elif key == "process_noise" and value == NOTHING:
        return None
    check_settings({key: value})
    return value


def _space(value: Any) -> Space:
    if isinstance(value, str):
        return space_from_text(value)
    if not isinstance(value, dict):
        raise ConfigError(f"space: expected a text or a table, found {shown(value)}")
    kind, arguments = value.get("kind"), {k: v for k, v in value.items() if k != "kind"}
    if not isinstance(kind, str) or kind not in SPACES:
        raise ConfigError(
            f"space: expected kind {', '.join(map(repr, SPACES))}, found {shown(kind)}"
        )
    known = inspect.signature(SPACES[kind]).parameters
    for name in arguments:
        if name not in known:
            raise ConfigError(
                f"space: expected {' or '.join(known) or 'no argument'} for {kind}, "
                f"found {shown(name)}"
            )
    for name, parameter in known.items():
        if parameter.default is parameter.empty and name not in arguments:
            raise ConfigError(f"space: expected a {name} for {kind}, found none")
    try:
        return SPACES[kind](**arguments)
    except DdmheError as e:
        raise ConfigError(f"space, {e}") from e


def _certificate(table: Any) -> Certificate:
    """A certificate as `write_config` wrote it; without a residual it was never verified."""
    from ddmhe.design.certificate import Certificate, Uncertainty

    if not isinstance(table, dict):
        raise ConfigError(f"certificate: expected a table, found {shown(table)}")
    for name in table:
        if name not in CERTIFICATE:
            raise ConfigError(
                f"certificate: expected one of {', '.join(sorted(CERTIFICATE))}, "
                f"found {shown(name)}{did_you_mean(name, CERTIFICATE)}"
            )
    missing = [name for name in ("eta", "P", "Q", "R") if name not in table]
    if missing:
        raise ConfigError(f"certificate: expected eta, P, Q and R, found no {missing[0]}")
    parts = {name: _array(value) for name, value in table.items()}
    spread = table.get("uncertainty")
    if spread is not None:
        if not isinstance(spread, dict) or set(spread) != set(UNCERTAINTY):
            raise ConfigError(
                f"certificate: expected {', '.join(UNCERTAINTY)} for uncertainty, "
                f"found {shown(spread)}"
            )
        parts["uncertainty"] = Uncertainty(**{k: _array(v) for k, v in spread.items()})
    return Certificate(**{"residual": float("inf")} | parts)


def _array(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as e:
        raise ConfigError(
            f"certificate: expected rectangular matrices, found others ({reason(e)})"
        ) from e


def write_config(path: str | Path, settings: Mapping[str, Any]) -> None:
    """Keywords of DdMhe as a file that `read_config` reads back: arrays as lists, spaces and
    certificates as tables."""
    if not isinstance(settings, Mapping):
        raise ConfigError(f"settings: expected keywords of DdMhe, found {shown(settings)}")
    try:
        plain = {key: _plain(value) for key, value in settings.items()}
        if "process_noise" in plain and plain["process_noise"] is None:
            plain["process_noise"] = NOTHING
        text = tomli_w.dumps(plain)
    except (TypeError, ValueError, AttributeError) as e:
        raise ConfigError(
            f"settings: expected keywords of DdMhe that a file can hold, found others ({reason(e)})"
        ) from e
    write_text(path, text)


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings in values of JSON."""
    return {key: _plain(value) for key, value in settings.items()}


def _plain(value: Any) -> Any:
    """A setting in TOML's own values."""
    for kind, space in SPACES.items():
        if isinstance(value, space):
            parts = _parts(value, inspect.signature(space).parameters)
            return kind if space is Exact else {"kind": kind, **parts}
    if hasattr(value, "eta"):
        table = _parts(value, CERTIFICATE)
        if not table["identified"]:
            del table["identified"]
        if "uncertainty" in table:
            table["uncertainty"] = _parts(table["uncertainty"], UNCERTAINTY)
        return table
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _parts(value: Any, names: Iterable[str]) -> dict[str, Any]:
    """Attributes in TOML's own values, which have no None."""
    parts = {name: getattr(value, name) for name in names}
    return {name: _plain(part) for name, part in parts.items() if part is not None}


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
        f"space: expected auto, exact, truncated:RANK or ridge:WEIGHT, found {shown(text)}"
    )
