"""Whether the default rule is left: only where parts that took no part in the choice all say so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import validate
from ddmhe.tuning.candidates import Candidate
from ddmhe.tuning.folds import QUARTERS, Fold
from ddmhe.tuning.score import log_error, rating

Array = NDArray[np.float64]

__all__ = ["MARGIN", "Verdict", "ends_agree", "undecided", "unjudged", "verdict_on"]

MARGIN = {"rehearsals": 0.3, "quarters": 0.5}
"""What the log error has to be smaller by than the default rule's, by what decides. On measured
pendulums (T = 150) gains of a third that all four quarters shared were losses later."""


@dataclass(frozen=True)
class Verdict:
    """What is chosen, and the evidence for leaving the default rule."""

    chosen: Candidate
    quarters: Array
    """log(rms/default's rms) of each quarter of the setting that is best on the other parts; NaN if
    nothing compares."""
    rehearsals: Array | None
    """The same of each rehearsal."""
    refused: bool = False
    """Whether the ends of the recording did not show what the other parts did."""
    hurried: bool = False
    """Whether there was no time to ask the ends."""


def undecided(default: Candidate) -> Verdict:
    """The default rule, where nothing compares."""
    return Verdict(default, np.full(QUARTERS, math.nan), None)


def unjudged(default: Candidate) -> Verdict:
    """The default rule, where there is no time for a verdict."""
    return replace(undecided(default), hurried=True)


def verdict_on(ranked: list[Candidate], default: Candidate) -> Verdict:
    """The best setting if it is better than the default rule beyond doubt, else the default
    rule."""
    usable = [c for c in ranked if math.isfinite(c.rated)]
    if default not in usable or default.smoothed is None:
        return undecided(default)  # too short a recording for it to be held out
    gains = np.array([c.smoothed for c in usable]) - default.smoothed
    best = int(np.argmin([rating(g) for g in gains]))
    # the part that judges takes no part in the choice
    picked = [np.argmin([rating(g, part) for g in gains]) for part in range(gains.shape[1])]
    nested = gains[picked, np.arange(gains.shape[1])]
    quarters, rehearsals = nested[:QUARTERS], nested[QUARTERS:]
    own_quarters, own_rehearsals = gains[best, :QUARTERS], gains[best, QUARTERS:]
    if len(rehearsals) == 0:
        sure = all(_clear(g, MARGIN["quarters"]) for g in (quarters, own_quarters))
    else:
        lost = any(_mean_less_error(g) > 0 for g in (quarters, own_quarters))
        sure = (
            all(_clear(g, MARGIN["rehearsals"]) for g in (rehearsals, own_rehearsals)) and not lost
        )
    return Verdict(
        usable[best] if sure else default, quarters, rehearsals if len(rehearsals) else None
    )


def _mean_less_error(values: Array) -> float:
    """Mean less one standard error; NaN of a single value, whose error nothing tells."""
    if len(values) < 2:
        return math.nan
    return float(np.mean(values) - np.std(values, ddof=1) / math.sqrt(len(values)))


def _clear(gains: Array, margin: float) -> bool:
    """Whether the error is smaller in every part, and by `margin` in the mean within one standard
    error."""
    return bool((gains < 0).all()) and _mean_less_error(-gains) > margin


def ends_agree(
    ends: list[Fold], given: dict[str, Any], default: dict[str, Any], alone: bool
) -> bool:
    """Whether settings are better on the ends, too: clearly if quarters `alone` decide, else no
    worse."""
    jobs = [
        (i, each | {"start": "recording"}) for each in (given, default) for i in range(len(ends))
    ]
    found = np.array(
        [log_error(squares) for squares, _ in (score for score in validate(ends, jobs) if score)]
    )
    ours, theirs = found.reshape(2, len(ends))
    if not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        return False
    return (
        _clear(ours - theirs, MARGIN["quarters"]) if alone else _mean_less_error(ours - theirs) <= 0
    )
