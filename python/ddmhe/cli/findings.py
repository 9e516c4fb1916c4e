"""What a recording is good for: whether it is enough, which states it shows, what to estimate with,
how far to trust that. First in the words of the log, then in the paper's notation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import report
from ddmhe._core import DdMhe, History, RankReport
from ddmhe._core import Log as Estimates
from ddmhe.checks import one_line
from ddmhe.recordings import Names
from ddmhe.report.trust import share_words

Array = NDArray[np.float64]

__all__ = ["Findings", "notation", "states_table"]

WELL, ROUGHLY = 0.3, 0.7
"""Error over the spread of a state, below which it is estimated well, or roughly."""
SURE = 2.0
"""Standard errors beyond which an entry of C is not zero."""


@dataclass(frozen=True, eq=False)
class Findings:
    """What was found of a recording and its default estimator."""

    history: History
    est: DdMhe
    names: Names
    spread: Array
    """Standard deviation of each recorded state (n,)."""
    seen: list[list[str]]
    """For each state the outputs that surely answer to it at once."""
    estimates: Estimates | None
    """Those of the rest of the log; None where there is none."""

    @classmethod
    def of(
        cls, history: History, est: DdMhe, names: Names, estimates: Estimates | None
    ) -> Findings:
        """With the identified model's word on what the outputs show."""
        from ddmhe.design import identify

        model = identify(history)
        error = model.standard_errors[1]
        sure = np.abs(model.C) > SURE * error
        seen = [[names.output[j] for j in np.flatnonzero(column)] for column in sure.T]
        states = np.concatenate([x for x, _ in history.recordings])
        return cls(history, est, names, states.std(axis=0), seen, estimates)

    @property
    def promise(self) -> Array:
        """Error to expect of each state (n,); NaN where nothing could be held out."""
        unknown = np.full(self.history.n, np.nan)
        return unknown if self.est.promise is None else self.est.promise

    @property
    def relative(self) -> Array:
        """The same over the state's spread."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.promise / self.spread

    def verdict(self, i: int) -> str:
        """Of state i: well, roughly, hardly or unknown."""
        share = self.relative[i]
        if not np.isfinite(share):
            return "unknown"
        return "well" if share < WELL else "roughly" if share < ROUGHLY else "hardly"

    def first(self) -> str:
        """The sentence that is asked for: is there enough in this recording?"""
        groups: dict[str, list[str]] = {}
        for i, name in enumerate(self.names.state):
            groups.setdefault(self.verdict(i), []).append(name)
        if list(groups) == ["well"]:
            return "The recording is enough: every state can be estimated well from the outputs."
        if list(groups) == ["hardly"]:
            return (
                "The recording is not enough: in parts of it that were held out, no state is "
                "estimated much better than by its mean."
            )
        if list(groups) == ["unknown"]:
            return (
                "The recording is too short to say how good estimates will be: a longer one, of "
                f"{self.history.dt * self.history.T:.3g} s more at least, can be tested on itself."
            )
        said = [
            f"{_listed(groups[kind])} {words}"
            for kind, words in (
                ("well", "can be estimated well"),
                ("roughly", "roughly"),
                ("hardly", "hardly better than by the mean"),
                ("unknown", "nobody knows how well"),
            )
            if kind in groups
        ]
        return f"The recording is enough for a part: {', '.join(said)}."

    def sentences(self) -> Iterator[str]:
        """What follows from it."""
        yield from self._seen()
        yield from self._estimator()
        yield from self._trust()

    def _seen(self) -> Iterator[str]:
        hidden = [
            name for name, outputs in zip(self.names.state, self.seen, strict=True) if not outputs
        ]
        if hidden:
            yield (
                f"No output answers at once to {_listed(hidden)} by more than twice the error of "
                "what the recording tells of that: what is known comes from how outputs change "
                "over a window."
            )

    def _estimator(self) -> Iterator[str]:
        s, dt = self.est.settings, self.history.dt
        kinds = {
            "recorded": "it takes the noise of the recording itself, and without bounds it is a "
            "Kalman filter and the smoother behind it",
            "scaled": "its weights are relative to what was recorded of each channel",
            "paper": "its weights are in the units of the log",
        }
        yield (
            f"Take the default, ddmhe estimate without settings: windows of {s.horizon} outputs "
            f"({s.horizon * dt:.3g} s); {kinds[s.weights]}."
        )
        if s.why["weights"] != "as stated":
            yield f"Why: {s.why['weights']}."
        if s.weights == "recorded":
            yield (
                "The recording is one of a linear system that noise drives, so that "
                "ddmhe.baselines.ModelMhe or ErrorStateKalman on the identified model come as near."
            )

    def _trust(self) -> Iterator[str]:
        known = [
            f"{name} {value:.3g} (it moves by {spread:.3g})"
            for name, value, spread in zip(self.names.state, self.promise, self.spread, strict=True)
            if np.isfinite(value)
        ]
        if known:
            yield (
                "How far to trust it: where the motion goes on like the recording, expect errors "
                f"(rms) of {', '.join(known)}."
            )
        if self.estimates is None or self.estimates.trusted is None or not len(self.estimates):
            return
        trusted = self.estimates.trusted
        share = share_words(float(trusted.mean()))
        yield (
            f"Of the rest of this log, {len(trusted)} samples, {share} are like the recording; "
            "estimates say so one by one (trusted, reasons)."
        )

    def facts(self) -> dict[str, Any]:
        """All of it in numbers."""
        h, s = self.history, self.est.settings
        states = zip(
            self.names.state, self.spread, self.promise, self.relative, self.seen, strict=True
        )
        rest = self.estimates
        return {
            "enough": all(self.verdict(i) == "well" for i in range(h.n)),
            "history": {"T": h.T, "dt": h.dt, "n": h.n, "p": h.p, "m": h.m},
            "states": {
                name: {
                    "verdict": self.verdict(i),
                    "spread": spread,
                    "rms": rms,
                    "relative": share,
                    "seen_by": outputs,
                }
                for i, (name, spread, rms, share, outputs) in enumerate(states)
            },
            "settings": {"horizon": s.horizon, "rho": s.rho, "mu": s.mu, "weights": s.weights},
            "why": s.why,
            "trusted": None
            if rest is None or rest.trusted is None or not len(rest)
            else float(rest.trusted.mean()),
            "sentences": [self.first(), *self.sentences()],
        }


def _listed(names: Sequence[str]) -> str:
    quoted = [f"'{one_line(name)}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def states_table(found: Findings) -> Any:
    """A row a state."""
    columns: dict[str, dict[str, str]] = {
        head: {}
        for head in ("moves by", "error to expect", "share", "estimated", "seen at once by")
    }
    for i, name in enumerate(found.names.state):
        rms, share = found.promise[i], found.relative[i]
        cells = (
            f"{found.spread[i]:.3g}",
            f"{rms:.3g}" if np.isfinite(rms) else "unknown",
            f"{share:.1%}" if np.isfinite(share) else "unknown",
            found.verdict(i),
            ", ".join(found.seen[i]) or "none for sure",
        )
        for column, cell in zip(columns.values(), cells, strict=True):
            column[name] = cell
    return report.table("The states", columns)


def notation(found: Findings, rank: RankReport) -> tuple[Any, dict[str, Any]]:
    """The same in the paper's notation, as a table and as numbers."""
    from ddmhe.design import identify

    h, est = found.history, found.est
    model = identify(h)
    poles = np.linalg.eigvals(model.A)
    contraction = 4 * est.rho**est.horizon
    rows = {
        "T, n, p, m": f"{h.T}, {h.n}, {h.p}, {h.m}",
        "rank condition (7), L = M": f"{rank.rank} of n + 1 = {rank.required}, margin "
        f"{rank.margin:.2g}",
    }
    rows |= report.settings(est) | {
        "4 rho^M, below 1 in (33)": f"{contraction:.3g}",
        "poles of the identified A": ", ".join(f"{z:.4g}" for z in poles),
        "(A, C) observable": "yes" if model.observable else "no",
    }
    facts = {
        "rank": rank.rank,
        "required_rank": rank.required,
        "margin": rank.margin,
        "contraction": contraction,
        "poles": list(poles.astype(complex)),
        "observable": model.observable,
        "trajectory_space": {"directions": est.rank, "ridge": est.ridge},
        "spectral_radius": est.spectral_radius,
    }
    return report.table("In the paper's notation", {"": rows}), facts
