"""The settings in force: those that somebody gave are marked, and of the others it is said why."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ddmhe import report
from ddmhe._core import DdMhe, Truncated
from ddmhe.checks import file_words
from ddmhe.cli.answer import Answer

__all__ = ["BY_LOG", "in_force", "say_why", "who_gave", "words_of"]

BY_LOG = "by the kind of log"
"""Who gave a setting that nobody named."""
LABELS = {"horizon": "horizon M", "rho": "rho", "mu": "mu", "space": "trajectory space"}
"""What the table calls settings that it always shows."""


def who_gave(
    from_file: Mapping[str, Any], options: Mapping[str, Any], config: Path | None
) -> dict[str, str]:
    """Who gave settings: an option or the settings file."""
    file = "" if config is None else file_words(config)
    given = {"start" if key == "start_from" else key for key, v in options.items() if v is not None}
    return {key: f"from {file}" for key in from_file} | dict.fromkeys(given, "given")


def in_force(est: DdMhe, named: Mapping[str, Any], givers: Mapping[str, str]) -> dict[str, str]:
    """Settings as label and text; `named`: the keywords of DdMhe, which are marked."""
    rows = report.settings(est)
    for key, value in named.items():
        by = givers.get(key, BY_LOG)
        if isinstance(value, Truncated) and (value.rank or 0) > est.rank:
            rows[LABELS[key]] += f", no more are there ({by}: {value.rank})"
        elif key in LABELS:
            rows[LABELS[key]] += f" ({by})"
        elif key.endswith("_bounds"):
            rows[key.replace("_", " ")] = f"{words_of(value[0])} to {words_of(value[1])} ({by})"
        else:
            rows[key.replace("_", " ")] = f"{words_of(value)} ({by})"
    return rows


def words_of(value: Any) -> str:
    """A setting on one line."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {words_of(one)}" for key, one in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(words_of(one) for one in value)
    if isinstance(value, np.ndarray):
        rows = [" ".join(f"{number:.4g}" for number in row) for row in np.atleast_2d(value)]
        return "; ".join(rows)
    if isinstance(value, float):
        return f"{value:.4g}"
    return type(value).__name__ if hasattr(value, "eta") else str(value).lower()


def say_why(answer: Answer, est: DdMhe) -> None:
    """One line a setting that was left open."""
    for key, sentence in est.settings.why.items():
        if sentence != "as stated":
            answer.more(f"{key}: {sentence}")
