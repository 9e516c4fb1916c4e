"""Warnings of an estimator in the words of a log: its columns' names, its clock."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.logs import Names

Array = NDArray[np.float64]

__all__ = ["in_words_of"]

SINCE = re.compile(r"\bfrom \S+ s on \(step (\d+)\)")
"""What is in a sentence that came up while the estimator ran."""
CHANNEL = re.compile(r"\b(state|output|input) (\d+) \(counted from 0\)")
"""What a sentence calls a channel."""


def in_words_of(names: Names, warnings: Iterable[str], t: Array | None = None) -> list[str]:
    """Sentences with columns' names for channels' numbers, in the order of the steps at which they
    came up; given the times t (N,), s, of the estimates, with these instead of those since the run
    began."""

    def channel(found: re.Match[str]) -> str:
        columns: tuple[str, ...] = getattr(names, found[1])
        return f"{found[1]} {shown(columns[int(found[2])])}"

    def since(found: re.Match[str]) -> str:
        step = int(found[1])
        return found[0] if t is None else f"from {t[min(step, len(t)) - 1]:.6g} s on (step {step})"

    def step(sentence: str) -> int:
        found = SINCE.search(sentence)
        return int(found[1]) if found else 0

    return [CHANNEL.sub(channel, SINCE.sub(since, one)) for one in sorted(warnings, key=step)]
