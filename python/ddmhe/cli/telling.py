"""Warnings of an estimator in the words of a log: its columns' names, its clock."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ddmhe.logs import Names

Array = NDArray[np.float64]

__all__ = ["in_words_of"]

SINCE = re.compile(r"^from \S+ s on \(step (\d+)\) ")
"""How a sentence begins that came up while the estimator ran."""
CHANNEL = re.compile(r"\b(state|output|input) (\d+) \(counted from 0\)")
"""What a sentence calls a channel."""


def in_words_of(names: Names, warnings: Iterable[str], t: Array | None = None) -> list[str]:
    """Sentences with columns' names for channels' numbers, in the order of the steps at which they
    came up; given the times t (N,), s, of the estimates, with these instead of those since the run
    began."""

    def channel(found: re.Match[str]) -> str:
        columns: tuple[str, ...] = getattr(names, found[1])
        return f"{found[1]} {columns[int(found[2])]!r}"

    told = []
    for sentence in warnings:
        found = SINCE.match(sentence)
        step = int(found[1]) if found else 0
        if found and t is not None:
            since = t[min(step, len(t)) - 1]
            sentence = f"from {since:.6g} s on (step {step}) {sentence[found.end() :]}"
        told.append((step, CHANNEL.sub(channel, sentence)))
    return [sentence for _, sentence in sorted(told, key=lambda one: one[0])]
