"""What a tuning found."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe._core import DdMhe, History
from ddmhe.tuning.candidates import Candidate
from ddmhe.tuning.folds import QUARTERS, Fold, Recorded
from ddmhe.tuning.promise import Promise, promise_of, ratio_to
from ddmhe.tuning.verdict import Verdict, ends_agree, undecided, unjudged, verdict_on
from ddmhe.tuning.words import words_for

Array = NDArray[np.float64]

__all__ = ["Standing", "Tuning", "tuning_of"]

FEWEST = 10
"""Samples of a quarter below which it shows nothing beyond doubt."""


@dataclass(frozen=True, eq=False)
class Tuning:
    """The settings that were chosen and why.

    The estimator takes them as `DdMhe(h, **tuning.settings)`, and as `DdMhe(h, **tuning.settings,
    start=tuning.start)` for a run that goes on where the recording ends.

    Examples
    --------
    >>> import ddmhe
    >>> tuning = ddmhe.tune(ddmhe.models.spin_down().simulate(1.0, 0.02, noise=0.001).history(40))
    >>> lowest, highest = tuning.range  # of the error of each state
    >>> bool((lowest <= tuning.promise).all()), bool((tuning.promise <= highest).all())
    (True, True)
    """

    settings: dict[str, Any]
    """Keywords of DdMhe that hold for every start: none where the default rule is kept; else
    weights and process_noise, or horizon, rho, mu, weights and space; and equilibrium where it was
    chosen."""
    score: float
    """Mean over the quarters of log(rms error / spread of the states): 0 is no better than their
    mean."""
    table: pd.DataFrame
    """One row per candidate, the chosen one first, then best first: its settings, its score, what
    it was ranked by, the error in each quarter relative to the spread, and the spectral radius."""
    words: str
    """How far the choice can be trusted; where the default rule is kept, that the recording cannot
    tell."""
    start: Literal["recording", "state"]
    """For a run that goes on where the recording ends: filled from there, which holds what the last
    recorded state holds and more."""
    candidates: list[dict[str, Any]]
    """Keywords of DdMhe of each row of the table."""
    warnings: list[str]
    """What an estimator with these settings says of them and of the recording."""
    promise: Array
    """Error of each state (n,), root mean square, in its unit: with `settings` and `start`, on ends
    of the recording that were not learnt from. NaN for a recording too short to hold ends out."""
    range: tuple[Array, Array]
    """(lo, hi), each (n,): where the rms error of each state is expected to stay in nine of ten
    runs as long as the recording; hi is infinite where nothing tells."""
    ratio: Array
    """`promise` over that of the default rule (n,); NaN where the recording cannot tell which is
    better for this state, 1 where the default rule was kept."""
    horizon: int
    """Horizon M in force."""
    rho: float
    """Discount per sample in force."""
    mu: float
    """Weight on the fitted noise in force, in scaled units."""
    space: Any
    """Trajectory space in force."""


class Standing(NamedTuple):
    """What a setting is and does, apart from any choice."""

    est: DdMhe
    promise: Promise

    @classmethod
    def of(
        cls, history: History, ends: list[Fold], rehearsals: list[Fold], given: dict[str, Any]
    ) -> Standing:
        """Of keywords of DdMhe."""
        est = DdMhe(history, start="recording", **given)  # without the short windows: sooner there
        return cls(est, promise_of(history, ends, rehearsals, given, est.horizon))


def tuning_of(
    recorded: Recorded,
    ends: list[Fold],
    rehearsals: list[Fold],
    ranked: list[Candidate],
    default: Candidate,
    hurried: Standing | None = None,
) -> Tuning:
    """The result for what was scored; `ranked` are the candidates, best first. `hurried` is the
    default rule's standing where there is no time for that of another."""
    history = recorded.history
    rule = _rule(ranked, default) if hurried is None else default
    verdict = _judged(recorded, ends, ranked, rule) if hurried is None else unjudged(default)
    best = verdict.chosen
    est, promise = hurried or Standing.of(history, ends, rehearsals, best.given)
    settings = _in_force(best, est)
    ratio = np.ones(history.n)
    if best is not default:
        others = promise_of(history, ends, [], default.given, default.horizon)
        ratio = ratio_to(promise, others)
    rows = [best, *(c for c in ranked if c is not best)]
    return Tuning(
        settings=settings,
        score=best.score,
        table=_table(rows),
        words=words_for(rows, (default, rule), verdict, promise, recorded),
        start="recording",
        candidates=[c.given for c in rows],
        warnings=est.warnings,
        promise=promise.held_out,
        range=(promise.lo, promise.hi),
        ratio=ratio,
        horizon=est.horizon,
        rho=est.rho,
        mu=est.mu,
        space=est.space,
    )


def _rule(ranked: list[Candidate], default: Candidate) -> Candidate:
    """What is left beyond doubt alone: the default rule, or where that takes the weights of the
    recording and the outputs are said to be noisier, these weights with the noise that is stated,
    unless the quarters speak against it."""
    for c in ranked:
        if c.stated is not None and math.isfinite(c.rated) and c.score <= default.score:
            return c
    return default


def _judged(
    recorded: Recorded, ends: list[Fold], ranked: list[Candidate], default: Candidate
) -> Verdict:
    """The verdict that the ends of the recording agree with, too; `default` is what is left beyond
    doubt alone."""
    T = len(recorded.y)
    # without a quarter there are next to no windows longer than half: what was held out is another
    # rule
    short = T < QUARTERS * FEWEST or (default.rehearsals is None and 2 * default.horizon > T)
    verdict = undecided(default) if short else verdict_on(ranked, default)
    if verdict.chosen is default:
        return verdict
    alone = verdict.rehearsals is None
    if ends_agree(ends, verdict.chosen.given, default.given, alone):
        return verdict
    return replace(verdict, chosen=default, refused=True)


def _in_force(best: Candidate, est: DdMhe) -> dict[str, Any]:
    """Keywords of DdMhe with the numbers that its estimator has."""
    if "horizon" not in best.given:
        return best.settings
    numbers = {"horizon": est.horizon, "rho": est.rho, "mu": est.mu}
    return best.given | numbers | {"weights": "scaled", "space": est.space}


def _table(ranked: list[Candidate]) -> pd.DataFrame:
    """One row per candidate."""
    rows = []
    for c in ranked:
        quarters = {
            f"quarter {q + 1}": math.exp(v)
            for q, v in enumerate(c.scores if c.scores is not None else [])
        }
        rows.append(
            {
                "horizon": c.horizon,
                "mu": c.mu,
                "space": str(c.given.get("space", "auto")),
                "weights": c.weights,
                "disturbance": c.disturbance,
                "lambda/mu": math.nan if c.weight is None else c.weight,
                "equilibrium": c.equilibrium,
                "default": c.default,
                "score": c.score,
                "rehearsed": c.rehearsed,
                "rated": c.rated,
                **quarters,
                "spectral radius": c.radius,
            }
        )
    return pd.DataFrame(rows)
