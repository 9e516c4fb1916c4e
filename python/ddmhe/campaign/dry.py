"""What a campaign would take, from a few of its cases."""

from __future__ import annotations

import io
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmhe.campaign.columns import rows_schema
from ddmhe.campaign.errors import library
from ddmhe.campaign.spec import Spec
from ddmhe.campaign.trial import check_settings_of
from ddmhe.campaign.work import Done, alone, run_scenario

__all__ = ["Forecast", "forecast"]

FEWEST = 3
"""Cases that are timed, at least."""


@dataclass(frozen=True)
class Forecast:
    """Sizes of a campaign."""

    cases: int
    parts: int
    timed: int
    """Cases that were run for it."""
    seconds: float
    """Of one worker, for all cases."""
    part_seconds: float
    """Of one worker, for the longest part."""
    bytes: float
    """On the disk, traces too."""


def forecast(spec: Spec) -> Forecast:
    """Run the first scenario of every system with every estimator, three cases at least, and
    count; CampaignError for settings that no case could take."""
    alone()
    check_settings_of(spec)
    timed: dict[str, list[Done]] = defaultdict(list)
    first: dict[str, int] = {}
    for part in spec.parts:
        first.setdefault(part.system, part.first)
    while sum(len(done.rows) for every in timed.values() for done in every) < FEWEST:
        again = len(next(iter(timed.values()), []))
        for system, begin in first.items():
            number = min(begin + again, spec.scenarios - 1)
            part = next(part for part in spec.parts if part.first <= number < part.stop)
            done = Done(part)
            run_scenario(spec, number, done)
            timed[system].append(done)
        if again + 1 >= spec.scenarios:
            break
    scenario = {system: _seconds(every) for system, every in timed.items()}
    seconds = sum(scenario[part.system] * (part.stop - part.first) for part in spec.parts)
    longest = max(scenario[part.system] * (part.stop - part.first) for part in spec.parts)
    every = [done for of in timed.values() for done in of]
    return Forecast(
        spec.cases, len(spec.parts), sum(len(done.rows) for done in every), seconds, longest,
        _bytes(spec, every),
    )  # fmt: skip


def _seconds(every: list[Done]) -> float:
    """Mean time of a scenario with all estimators."""
    return float(np.mean([sum(one["seconds"] + one["data_seconds"] for one in done.times)
                          for done in every]))  # fmt: skip


def _bytes(spec: Spec, every: list[Done]) -> float:
    """Bytes of all files, without compression: rows, times, traces."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    rows = [row for done in every for row in done.rows]
    rows = (rows * (spec.batch // len(rows) + 1))[: spec.batch]
    schema = rows_schema(spec)
    columns: dict[str, list[Any]] = {n: [row.get(n) for row in rows] for n in schema.names}
    buffer = io.BytesIO()
    parquet.write_table(pa.Table.from_pydict(columns, schema=schema), buffer, compression="none")
    case = buffer.tell() / len(rows)
    samples = max((row.get("samples") or 0 for row in rows), default=0)
    width = 2 + 4 * max(len(spec.states), 1)
    return float(spec.cases * (case + 30.0) + len(spec.keep["traces"]) * samples * width * 8.0)
