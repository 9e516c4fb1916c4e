"""What estimates are made of, for the file that holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from importlib.metadata import version
from typing import Any

from ddmhe.config import plain_settings
from ddmhe.recordings import Recorded
from ddmhe.recordings.options import Reading

__all__ = ["IN_FORCE", "metadata", "read_as"]

IN_FORCE = ("horizon", "rho", "mu", "weights", "process_noise", "start", "space")
"""Settings that an estimator states."""


def read_as(given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of reading that were given."""
    usual = {option.name: option.default for option in fields(Reading)} | {"gaps": "fill"}
    asked = {key: given[key] for key in (*usual, "history", "recording") if key in given}
    return {k: v for k, v in asked.items() if v not in (None, (), usual.get(k))}


def metadata(
    split: Recorded,
    force: Mapping[str, Any],
    named: Mapping[str, Any],
    how: Mapping[str, Any],
    warnings: Sequence[str],
) -> dict[str, Any]:
    """What estimates are made of, in values of JSON: version, logs with their hashes, how they were
    read, the settings in force and those that were named."""
    sources = [split.log, *split.recordings]
    return {
        "ddmhe": version("ddmhe"),
        "logs": [{"path": one.path, "sha256": one.digest, "dt": one.dt} for one in sources],
        "columns": asdict(split.names),
        "history": {"samples": split.history.T, "recordings": len(split.history.recordings)},
        "reading": dict(how),
        "notes": list(split.notes),
        "settings": plain_settings(force),
        "named": plain_settings(named),
        "warnings": list(warnings),
    }
