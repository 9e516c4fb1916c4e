"""How far estimates are to be trusted, for files, tables and figures: columns, counts and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import Estimate, Log
from ddmhe.reasons import Reason

Array = NDArray[np.float64]

__all__ = ["BARS", "Trust", "reason_words", "share_words"]

BARS = 3.0
"""Standard deviations that are drawn, and within which errors are counted."""
SOURCES = {
    "V": "bars calibrated by replay of the recording",
    "nis": "bars from the noise of the recording",
}
"""Where standard deviations come from, by the kind of the evidence."""


@dataclass(frozen=True, eq=False)
class Trust:
    """The evidence on N estimates of n states."""

    std: Array
    """Standard deviations of the errors (N, n)."""
    trusted: NDArray[np.bool_]
    """Whether nothing speaks against each estimate (N,)."""
    reasons: NDArray[np.uint8]
    """What does, as numbers of `Reason` (N,)."""
    kind: str
    """"V" or "nis": what the motion is judged by, `Evidence.kind`."""

    @classmethod
    def of_log(cls, log: Log) -> Trust | None:
        """That of a run; None without evidence."""
        if log.evidence is None:
            return None
        assert log.std is not None
        assert log.trusted is not None
        assert log.reasons is not None
        kinds = set(map(str, np.atleast_1d(log.evidence.kind)))  # one a step where that changes
        kind = kinds.pop() if len(kinds) == 1 else "V"
        return cls(log.std, log.trusted, log.reasons, kind)

    @classmethod
    def of_estimates(cls, estimates: Sequence[Estimate]) -> Trust:
        """That of single steps of one run, one at least, which have evidence."""
        newest = estimates[-1].evidence
        assert newest is not None
        return cls(
            np.array([e.std for e in estimates], dtype=np.float64),
            np.array([e.trusted for e in estimates], dtype=np.bool_),
            np.array([e.reasons for e in estimates], dtype=np.uint8),
            newest.kind,
        )

    def rows(self, chosen: Any) -> Trust:
        """Of some of the estimates: a mask or a slice."""
        parts = {name: getattr(self, name)[chosen] for name in ("std", "trusted", "reasons")}
        return replace(self, **parts)

    def columns(self, time: str, names: Sequence[str]) -> dict[str, Any]:
        """Columns of a file beside time and states: `<state>_std`, `trusted` as 1 or 0, and
        `reasons` as words. A name that is taken gets underscores."""
        deviations = [(f"{name}_std", self.std[:, i]) for i, name in enumerate(names)]
        flags = [("trusted", self.trusted.astype(int)), ("reasons", reason_words(self.reasons))]
        columns: dict[str, Any] = {}
        for name, values in (*deviations, *flags):
            while name in (time, *names, *columns):
                name += "_"
            columns[name] = values
        return columns

    def shares(self, error: Array) -> list[tuple[str, float, int]]:
        """Of the known errors (N, n), "all" and those of "trusted" estimates: the share that is
        within `BARS` deviations, and how many there are."""
        known = np.isfinite(error)
        inside = np.abs(error) <= BARS * self.std
        asked = {"all": known, "trusted": known & self.trusted[:, None]}
        return [
            (of, float(np.mean(inside[rows])), int(np.sum(rows)))
            for of, rows in asked.items()
            if rows.any()
        ]

    def within(self, error: Array) -> dict[str, str]:
        """The same as label and text."""
        labels = {"all": f"errors within {BARS:g} sd", "trusted": "... while trusted"}
        return {labels[of]: f"{share:.1%} of {count}" for of, share, count in self.shares(error)}

    def words(self, promise: Array | None) -> str:
        """One line: the share that is trusted, and where the bars come from; `promise` (n,) that of
        the estimator, NaN where nothing could be held out of the recording."""
        share = share_words(float(np.mean(self.trusted)))
        known = self.kind != "V" or (promise is not None and not np.isnan(promise).all())
        source = SOURCES[self.kind] if known else "the recording is too short to calibrate bars"
        return f"trusted for {share} of the log; {source}"


def reason_words(reasons: NDArray[np.uint8]) -> list[str]:
    """Numbers of `Reason` (N,) as words joined by "+", empty where there is none."""
    words = {
        number: "+".join(str(reason.name).lower() for reason in Reason if reason & number)
        for number in np.unique(reasons).tolist()
    }
    return [words[number] for number in reasons.tolist()]


def share_words(share: float) -> str:
    """A share in whole per cent; 0 % is none and 100 % is all."""
    percent = round(100 * share)
    if 0 < share < 1:
        percent = min(max(percent, 1), 99)
    return f"{percent} %"
