"""What a page is about: a run of an estimator, and what is known of where it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, ShapeError
from ddmhe.checks import array, check_finite, check_history, shown, word
from ddmhe.logs import Names
from ddmhe.report.web.thinning import Spans, spans_of

Array = NDArray[np.float64]

__all__ = ["Channel", "Run", "Source", "StepTimes", "run_of"]


@dataclass(frozen=True)
class Channel:
    """A state or an output as people call it."""

    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """Name, and unit in brackets."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True)
class StepTimes:
    """How long steps took, s."""

    mean: float
    """Of the whole run."""
    single: Array
    """Of steps made one by one (S,)."""


@dataclass(frozen=True, eq=False)
class Source:
    """What is known of where a run comes from; all of it may be lacking."""

    log: str = ""
    """Name of the log."""
    history: History | None = None
    recorded: tuple[Array, Array] | None = None
    """Times (K,) on the run's clock and states (K, n) of the recording before the run."""
    command: str = ""
    """What makes the page again."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Versions, files, hashes, what was inferred: label and text."""
    warnings: Sequence[str] | None = None
    """In the words of the log; None: as the estimator has them."""
    times: StepTimes | None = None

    def with_history(self, history: History) -> Source:
        """The same, with the recording that was learnt from."""
        return replace(self, history=check_history(history))


@dataclass(frozen=True, eq=False)
class Run:
    """N estimates of n states."""

    est: Any
    log: Any
    t: Array
    """Times (N,), s, or steps."""
    time_label: str
    x: Array
    """Estimates (N, n), of an interval observer the middles."""
    truth: Array | None
    """True states (N, n), NaN where unknown."""
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    source: Source

    @property
    def begin(self) -> float:
        """Where the run begins: one step before the first estimate."""
        if self.source.recorded is not None and len(self.source.recorded[0]):
            return float(self.source.recorded[0][-1])
        step = self.t[1] - self.t[0] if len(self.t) > 1 else 0.0
        return float(self.t[0] - step)

    def spans(self, holds: NDArray[np.bool_]) -> Spans:
        """Times at which something holds of the estimates."""
        return spans_of(holds, self.t, self.begin)


def run_of(
    est: Any,
    log: Any,
    *,
    truth: ArrayLike | None,
    t: ArrayLike | None,
    names: Names | Mapping[str, Sequence[str]] | Sequence[str] | None,
    units: Mapping[str, str] | Sequence[str] | None,
    source: Source,
) -> Run:
    """Checked arguments as a run; `Source` where nothing more is known."""
    x = _estimates(log)
    N, n = x.shape
    if N == 0:
        raise DdmheError("log: expected one estimate at least, found none")
    history = source.history
    if history is not None and history.n != n:
        raise ShapeError(f"history: expected {n} states as the log has, found {history.n}")
    t = getattr(log, "t", None) if t is None else t
    label = "time (s)" if t is not None or history is not None else "step"
    if t is None:
        t = np.arange(1.0, N + 1) * (1.0 if history is None else history.dt)
    times = array("t", t, (N,))
    check_finite("t", times)
    if (np.diff(times) < 0).any():
        raise DdmheError("t: expected times that do not go back, found some that do")
    known = None if truth is None else array("truth", truth, (N, n), missing=True)
    if known is not None and np.isnan(known).all():
        known = None
    p = _outputs(est, log)
    states, outputs = _names(names, n, p)
    asked = _units(units, history, states, outputs)
    channels = [
        tuple(Channel(word(a), word(b) if b else "") for a, b in zip(group, of, strict=True))
        for group, of in zip((states, outputs), asked, strict=True)
    ]
    return Run(est, log, times, label, x, known, channels[0], channels[1], source)


def _estimates(log: Any) -> Array:
    """The estimates (N, n) of a log of any of our estimators."""
    x = getattr(log, "x", None)
    if not isinstance(x, np.ndarray) or x.ndim != 2:
        raise DdmheError(f"log: expected what an estimator's run returns, found {shown(log)}")
    return np.asarray(x, dtype=np.float64)


def _outputs(est: Any, log: Any) -> int:
    """How many outputs there are, as far as it shows."""
    evidence = getattr(log, "evidence", None)
    if evidence is not None:
        return int(evidence.innovation.shape[1])
    return int(getattr(est, "p", 0))


def _names(names: Any, n: int, p: int) -> tuple[Sequence[str], Sequence[str]]:
    """Names of states (n) and of outputs (p)."""
    states: Sequence[str] = [f"x{i}" for i in range(n)]
    outputs: Sequence[str] = [f"y{i}" for i in range(p)]
    if names is None:
        return states, outputs
    if isinstance(names, Names):
        names = {"state": names.state, "output": names.output}
    if isinstance(names, Mapping):
        unknown = set(names) - {"state", "output"}
        if unknown:
            raise DdmheError(f"names: expected keys state and output, found {shown(unknown)}")
        states, outputs = names.get("state", states), names.get("output", outputs)
    else:
        states = names
    for key, found, size in (("state", states, n), ("output", outputs, p)):
        texts = not isinstance(found, str) and all(isinstance(one, str) for one in found)
        if not texts or (len(found) != size and not (key == "output" and p == 0)):
            raise ShapeError(f"names: expected {size} texts for {key}s, found {shown(found)}")
    return list(states), list(outputs)[:p]


def _units(
    units: Any, history: History | None, states: Sequence[str], outputs: Sequence[str]
) -> tuple[Sequence[str], Sequence[str]]:
    """Units of states and outputs: those that are named, else the recording's."""
    found: tuple[Sequence[str], Sequence[str]] = ([""] * len(states), [""] * len(outputs))
    if history is not None and len(outputs) in (0, history.p):
        found = (history.x_units, history.y_units[: len(outputs)])
    if units is None:
        return found
    if isinstance(units, Mapping):
        pairs = zip((states, outputs), found, strict=True)
        named = [
            [str(units.get(name) or old) for name, old in zip(group, olds, strict=True)]
            for group, olds in pairs
        ]
        return named[0], named[1]
    if isinstance(units, str) or len(units) != len(states):
        raise ShapeError(f"units: expected {len(states)} texts, found {shown(units)}")
    return [str(unit or "") for unit in units], found[1]
