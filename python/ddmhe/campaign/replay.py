"""One case of a campaign again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ddmhe import report
from ddmhe.campaign.results import Results
from ddmhe.campaign.systems import state_names
from ddmhe.campaign.work import run_case

__all__ = ["Replay", "replay"]


@dataclass(frozen=True, eq=False)
class Replay:
    """What a case comes to now."""

    row: dict[str, Any]
    differs: list[str] | None
    """Columns in which the campaign has another value; None where it has no row of the case."""
    estimator: Any
    """After the run; None after an error."""
    log: Any
    data: Any


def replay(campaign: Results, case: int, page: str | Path | None = None) -> Replay:
    """Run a case again, compare it with its row, and write the page on its run."""
    row, _, ran = run_case(campaign.spec, case)
    kept = campaign.rows[campaign.rows["case"] == case]
    differs = None
    if len(kept):
        there = {str(name): value for name, value in kept.iloc[0].items()}
        differs = [name for name, value in there.items() if not _same(value, row.get(name))]
    if ran is None:
        return Replay(row, differs, None, None, None)
    estimator, log, data = ran
    if page is not None:
        N = len(log.x)
        states = state_names(campaign.spec.systems[row["system"]])
        report.html(estimator, log, page, truth=data.x[:N], t=data.t[:N], names=states,
                    history=data.history)  # fmt: skip
    return Replay(row, differs, estimator, log, data)


def _same(kept: Any, now: Any) -> bool:
    """Whether two values are the same bits; nothing and NaN are the same."""
    if isinstance(kept, np.ndarray | list) or isinstance(now, list):
        if kept is None or now is None:
            return kept is now
        return np.array_equal(np.asarray(kept, float), np.asarray(now, float), equal_nan=True)
    if _nothing(kept) or _nothing(now):
        return _nothing(kept) and _nothing(now)
    return bool(kept == now)


def _nothing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))
