"""The choice in words: how far it can be trusted, and what it promises."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import times
from ddmhe.tuning.candidates import Candidate
from ddmhe.tuning.folds import Recorded
from ddmhe.tuning.promise import Promise
from ddmhe.tuning.rehearsals import DRAWS, SPANS
from ddmhe.tuning.verdict import MARGIN, Verdict

Array = NDArray[np.float64]

__all__ = ["words_for"]

LITTLE = -0.3
"""A log error above this (three quarters of the spread) is little better than the states' mean."""
LARGEST_LOG = 40.0
"""Logs of ratios are cut here, lest their exponential overflows."""


def words_for(
    rows: list[Candidate],
    rules: tuple[Candidate, Candidate],
    verdict: Verdict,
    promise: Promise,
    recorded: Recorded,
) -> str:
    """How far the choice can be trusted; `rows` begin with the chosen one, `rules` are the default
    rule and what is left beyond doubt alone."""
    best = verdict.chosen
    parts = [*_in_question(*rules), _decision(verdict, rules, len(rows) - 1)]
    if best not in rules and "horizon" not in best.given:
        parts.append(f"Chosen: {best.weights} weights, fitted disturbance {best.disturbance}.")
    scores = best.scores if best.scores is not None else np.full(1, math.inf)
    if np.isfinite(scores).all():
        parts.append(
            f"On held-out quarters of the recording the error is {math.exp(best.score):.3g} of the "
            f"states' spread, from {math.exp(scores.min()):.3g} to {math.exp(scores.max()):.3g}."
        )
        if best.score > LITTLE:
            parts.append(
                "That is little better than the mean of the states: the quarters hardly tell the "
                "states apart."
            )
    else:
        parts.append("The recording is too short for held-out quarters.")
    if math.isfinite(best.rehearsed):
        driven = ", driven by the recorded inputs back and forth" if recorded.history.m else ""
        parts.append(
            f"On {DRAWS} rehearsals of a quadratic surrogate{driven}, up to {max(SPANS)} times as "
            f"long as the recording, the error is {math.exp(best.rehearsed):.3g} of the spread: "
            "trust it as far as the motion stays smooth and second-order."
        )
    else:
        parts.append("Nothing here tests motion outside of the recorded region.")
    if best.equilibrium:
        parts.append("The known rest was chosen.")
    return " ".join([*parts, _expected(promise, recorded.spread)])


def _in_question(default: Candidate, rule: Candidate) -> list[str]:
    """What the default rule takes of the noise of the recording."""
    if default.weights == "scaled":
        return []
    taken = "The default rule takes the weights of the recording."
    if rule is default:
        return [taken]
    gain = math.exp(min(rule.score - default.score, LARGEST_LOG))
    return [
        f"{taken} It was left: the stated noise of the outputs is not that of the recording. A "
        f"process_noise smaller by {rule.stated:.3g} gives its filter the stated noise, and "
        f"{times(gain, 'its error')} in the quarters."
    ]


def _decision(verdict: Verdict, rules: tuple[Candidate, Candidate], others: int) -> str:
    """Whether the rule was left, and what for."""
    default, rule = rules
    moved = verdict.chosen is not rule
    name_of_rule = "The default rule" if rule is default else "This filter"
    if verdict.hurried:
        return (
            f"{name_of_rule} is kept: there was no time to try the best of the others on ends of "
            "the recording."
        )
    judges = verdict.quarters if verdict.rehearsals is None else verdict.rehearsals
    name = "quarters" if verdict.rehearsals is None else "rehearsals"
    if not np.isfinite(judges).all():
        return (
            f"{name_of_rule} is kept, the recording cannot tell that another setting is better: "
            "it is too short, or the default's windows are too long, for parts to be held out."
        )
    mean, low, high = (
        math.exp(min(v, LARGEST_LOG)) for v in (judges.mean(), judges.min(), judges.max())
    )
    whose = "the default rule's error" if rule is default else "its error"
    if (judges == 0.0).all():
        return (
            f"{name_of_rule} is kept, the recording cannot tell that another setting is better: it "
            f"has the least error of {others + 1} settings, whichever of the {name} is left out."
        )
    seen = (
        f"of {others} other settings the best by all other parts has {times(mean, whose)} "
        f"in the {name} left out, from {low:.2g} to {high:.2g} of it"
    )
    if moved:
        return f"{name_of_rule} was left: {seen}; the ends of the recording show the same."
    kept = f"{name_of_rule} is kept, the recording cannot tell that another setting is better"
    if verdict.refused:
        return f"{kept}: {seen}, but the ends of the recording do not show the same."
    asked = (
        f"below {math.exp(-MARGIN[name]):.2g} within a standard error, and below 1 in every part"
    )
    if verdict.rehearsals is not None:
        asked += ", without a loss in the quarters"
    return f"{kept}: {seen}; asked is {asked}."


def _expected(promise: Promise, spread: Array) -> str:
    """The promise in words, in units of the spread since states have theirs."""
    if np.isnan(promise.held_out).any():
        return "No promise: the recording is too short to hold out its end."
    lo, hi = (float(v) for v in (np.min(promise.lo / spread), np.max(promise.hi / spread)))
    held = float(np.sqrt(np.mean((promise.held_out / spread) ** 2)))
    words = (
        f"On ends of the recording that were not learnt from, the error is {held:.3g} of the "
        f"spread; in runs as long as the recording it is expected between {lo:.2g} and {hi:.2g} of "
        "it, state by state in nine of ten."
    )
    if hi > 1.0:
        words += (
            " That range reaches beyond the spread of a state: of such a state the recording "
            "promises nothing."
        )
    return words
