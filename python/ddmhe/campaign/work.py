"""What a worker does: the scenarios of a part, with every estimator, one row a case."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ddmhe.campaign.data import Data, data_of
from ddmhe.campaign.estimators import in_force, made
from ddmhe.campaign.measures import measured
from ddmhe.campaign.spec import Case, Part, Spec
from ddmhe.campaign.systems import state_names

__all__ = ["DIED", "Done", "alone", "lost_part", "run_case", "run_part", "run_scenario"]

DIED = "WorkerDied"
"""Outcome of a case whose worker died, again and again."""
VERSION = version("ddmhe")
"""Found once: it is a file that is looked for and read."""
LONGEST = 300
"""Characters of an error that a row keeps."""


@dataclass(frozen=True, eq=False)
class Done:
    """What a part came to."""

    part: Part
    rows: list[dict[str, Any]] = field(default_factory=list)
    times: list[dict[str, Any]] = field(default_factory=list)
    traces: dict[int, dict[str, Any]] = field(default_factory=dict)

    @property
    def failed(self) -> int:
        """Cases that ended with an error."""
        return sum(row["outcome"] != "done" for row in self.rows)


@cache
def alone() -> None:
    """One thread in this process, for all it does."""
    os.environ["RAYON_NUM_THREADS"] = "1"
    threadpool_limits(1)


def run_part(spec: Spec, part: Part) -> Done:
    """All cases of a part; an error of a case is its row, no more."""
    alone()
    done = Done(part)
    for number in range(part.first, part.stop):
        run_scenario(spec, number, done)
    return done


def run_scenario(spec: Spec, number: int, done: Done) -> None:
    """The data of a scenario, and every estimator on it."""
    begin = time.perf_counter()
    made_of = _tried(lambda: data_of(spec, spec.scenario(number)))
    took = time.perf_counter() - begin
    for case in spec.cases_of(number):
        begin = time.perf_counter()
        row, trace = _case(spec, case, made_of)
        seconds = time.perf_counter() - begin
        done.rows.append(row)
        done.times.append(
            {"case": case.number, "seconds": seconds, "data_seconds": took / len(spec.estimators)}
        )
        if trace is not None and case.number in spec.keep["traces"]:
            done.traces[case.number] = trace


def run_case(spec: Spec, number: int) -> tuple[dict[str, Any], dict[str, Any] | None, Any]:
    """One case again: its row, its whole run and (estimator, log); none after an error."""
    alone()
    case = spec.case(number)
    data = _tried(lambda: data_of(spec, case.scenario))
    if isinstance(data, Exception):
        return _case(spec, case, data)[0], None, None
    ran = _tried(lambda: _run(spec, case, data))
    row, trace = _row(spec, case, data, ran)
    return row, trace, None if isinstance(ran, Exception) else (*ran, data)


def _case(spec: Spec, case: Case, data: Any) -> tuple[dict[str, Any], dict[str, Any] | None]:
    ran = data if isinstance(data, Exception) else _tried(lambda: _run(spec, case, data))
    return _row(spec, case, data, ran)


def _tried(make: Callable[[], Any]) -> Any:
    """What is made, or the exception that came instead."""
    try:
        with np.errstate(all="ignore"):  # of estimates that leave all bounds
            return make()
    except Exception as e:
        return e


def _run(spec: Spec, case: Case, data: Data) -> tuple[Any, Any]:
    """The estimator of a case and what its run returned."""
    table = spec.estimators[case.estimator]
    estimator = made(table, data.history, data.noise)
    log = estimator.run(data.Y) if data.U is None else estimator.run(data.Y, data.U)
    return estimator, log


def _row(
    spec: Spec, case: Case, data: Any, ran: Any
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The row of a case and its whole run."""
    row = _named(spec, case)
    if isinstance(ran, Exception):
        return row | _error(type(ran).__name__, str(ran)), None
    estimator, log = ran
    states = state_names(spec.systems[case.scenario.system])
    found = _tried(lambda: measured(log, data, states, spec.spans, spec.keep["bins"]))
    if isinstance(found, Exception):
        return row | _error(type(found).__name__, str(found)), None
    row |= found
    row |= {"source_sha256": data.digest, "settings": json.dumps(in_force(estimator))}
    violation = getattr(log, "violation", None)
    kind = "done" if found["finite"] == 1.0 else "diverged"
    row |= (
        {"outcome": kind, "error": ""} if violation is None else _error("violation", str(violation))
    )
    N = len(log.x)
    trace = {"t": data.t[:N], "x": data.x[:N], "x_hat": np.asarray(log.x), "y": data.Y[:N]}
    std = getattr(log, "std", None)
    return row, trace if std is None else trace | {"std": np.asarray(std)}


def _named(spec: Spec, case: Case) -> dict[str, Any]:
    """What case a row is of, and of which spec."""
    of = case.scenario
    return {
        "case": case.number,
        "system": of.system,
        "estimator": case.estimator,
        "noise": of.noise,
        "fault": of.fault,
        "source": of.source,
        "seed": of.seed,
        "spec_hash": spec.hash,
        "version": VERSION,
    }


def _error(kind: str, words: str) -> dict[str, Any]:
    text = " ".join(words.split())
    return {"outcome": kind, "error": text[:LONGEST]}


def lost_part(spec: Spec, part: Part, words: str) -> Done:
    """A part whose worker died each time it was tried: rows without numbers."""
    cases = [case for k in range(part.first, part.stop) for case in spec.cases_of(k)]
    return Done(part, [_named(spec, case) | _error(DIED, words) for case in cases])
