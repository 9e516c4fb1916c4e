"""What is wrong with a log, and what its columns are called."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from ddmhe._core import DdmheError

__all__ = ["LARGEST", "LogError", "Names"]

LARGEST = sys.float_info.max


class LogError(DdmheError):
    """A log file cannot be used as asked."""


@dataclass(frozen=True)
class Names:
    """Column names of a log."""

    time: str
    state: tuple[str, ...]
    output: tuple[str, ...]
    input: tuple[str, ...] = ()
