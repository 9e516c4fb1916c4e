"""Libraries of formats, loaded where they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ddmhe.recordings.errors import LogError

__all__ = ["library"]


def library(name: str, path: str, what: str) -> Any:
    """A library of the extra `logs`; LogError that names the extra where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise LogError(
            f"{path}: {what}, which needs {name.partition('.')[0]}: pip install 'ddmhe[logs]'"
        ) from None
