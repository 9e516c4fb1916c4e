"""What a reader who has a minute should know: three sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdMhe
from ddmhe.reasons import Reason
from ddmhe.report.measures import nrmse, rmse
from ddmhe.report.trust import BARS, share_words
from ddmhe.report.web.numbers import listed, percent, seconds, with_unit
from ddmhe.report.web.run import Run

Array = NDArray[np.float64]

__all__ = ["SAYS", "summary"]

SAYS = {
    Reason.NOVEL: "the motion is unlike the recording",
    Reason.UNCERTAIN: "a state may be off by more than half of its recorded spread",
    Reason.STUCK: "an output repeats one value",
    Reason.OUTSIDE: "a state or an input is outside of its recorded range",
}
"""What a reason says, as the rest of a sentence."""


def summary(run: Run) -> list[str]:
    """What was estimated, how far it can be trusted, how far off it is."""
    return [_what(run), _trust(run), _errors(run)]


def _what(run: Run) -> str:
    """The first sentence."""
    states = listed([channel.name for channel in run.states])
    from_what = listed([channel.name for channel in run.outputs]) or "outputs"
    log = f" of {run.source.log}" if run.source.log else ""
    history = run.source.history
    learnt = (
        ""
        if history is None
        else f", learnt from a recording of {history.T} samples "
        f"({history.T * history.dt:.4g} s)" + (" and no model" * isinstance(run.est, DdMhe))
    )
    many = len(run.states) > 1
    span = (
        f", {seconds(run.t[0], run.time_label)} to {seconds(run.t[-1], run.time_label)}"
        if len(run.t) > 1
        else ""
    )
    return (
        f"The state{'s' if many else ''} {states}{log} {'were' if many else 'was'} estimated "
        f"from {from_what} at {len(run.t)} samples{span}{learnt}."
    )


def _trust(run: Run) -> str:
    """The second sentence."""
    log = run.log
    reasons = getattr(log, "reasons", None)
    if reasons is None or log.trusted is None:
        return "Nothing was computed that says how far the estimates can be trusted."
    doubtful = ~np.asarray(log.trusted)
    if not doubtful.any():
        return "Nothing speaks against any of the estimates: the motion stays like the recording."
    first = int(np.argmax(doubtful))
    why = [SAYS[r] for r in (Reason.NOVEL, Reason.UNCERTAIN, Reason.STUCK) if reasons[first] & r]
    share = float(np.mean(~doubtful))
    if share == 0:
        return f"None of the estimates is to be trusted: {listed(why)}."
    once = "the first doubt" if first else "doubt"
    return (
        f"Nothing speaks against {share_words(share)} of the estimates; {once} comes at "
        f"{seconds(run.t[first], run.time_label)}, where {listed(why)}."
    )


def _errors(run: Run) -> str:
    """The third sentence."""
    if run.truth is None:
        promise = getattr(run.est, "promise", None)
        if promise is None or np.isnan(promise).all():
            return "How far off they are is not known: the log holds no true states."
        texts = [
            f"{with_unit(value, c.unit)} for {c.name}"
            for c, value in zip(run.states, promise, strict=True)
        ]
        return (
            "Where the motion goes on like the recording, root-mean-square errors of "
            f"{listed(texts)} are to be expected; the log holds no true states to compare with."
        )
    error = run.x - run.truth
    found = [
        f"{with_unit(value, c.unit)} for {c.name} ({_of_spread(share)})"
        for c, value, share in zip(run.states, rmse(error), nrmse(run.x, run.truth), strict=True)
    ]
    std = getattr(run.log, "std", None)
    held = ""
    if std is not None:
        known = np.isfinite(error)
        inside = float(np.mean((np.abs(error) <= BARS * std)[known]))
        held = f"; {percent(inside)} of the errors are within the stated {BARS:g} deviations"
    return f"Against the true states the root-mean-square errors are {listed(found)}{held}."


def _of_spread(share: float) -> str:
    """An error over the spread of its state, in words."""
    if np.isnan(share):
        return "its state never changes"
    if share < 0.001:
        return "less than 0.1 % of its spread"
    return f"{percent(share)} of its spread" if share < 1 else f"{share:.3g} times its spread"
