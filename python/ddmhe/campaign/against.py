"""Two campaigns, case against case: whether an estimator has become worse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ddmhe.campaign.errors import CampaignError

if TYPE_CHECKING:
    import pandas as pd

    from ddmhe.campaign.results import Results

__all__ = ["Comparison", "compared"]

CASE = ["system", "noise", "fault", "source", "seed", "estimator"]
"""What a case is known by in both."""
LARGER, SURELY = 1.02, 0.01
"""Errors are worse whose median ratio is above the first while more cases are worse than better
with a probability below the second, were both as likely."""
COVERED = 0.01
"""By how much less errors may be within three deviations."""


@dataclass(frozen=True)
class Comparison:
    """An estimator on a system, in the other campaign and in this one."""

    system: str
    estimator: str
    cases: int
    """Cases that both have."""
    ratio: float
    """Median of the errors here over those there; 1 is no change."""
    chance: float
    """Two-sided sign test on which of both is smaller."""
    failed: tuple[int, int]
    """Failed cases there and here, of those that both have."""
    within: tuple[float, float]
    """Share of errors within three deviations there and here; NaN without deviations."""

    @property
    def reasons(self) -> list[str]:
        """Why it counts as worse; empty where it does not."""
        found = []
        if self.ratio > LARGER and self.chance < SURELY:
            found.append(f"errors are {self.ratio:.3g} times as large in the median")
        if self.failed[1] > self.failed[0]:
            found.append(f"{self.failed[1]} cases fail, there {self.failed[0]}")
        if self.within[1] < self.within[0] - COVERED:
            found.append(
                f"{self.within[1]:.1%} of the errors are within 3 sd, there {self.within[0]:.1%}"
            )
        return found


def compared(here: Results, there: Results) -> list[Comparison]:
    """Every estimator on every system; CampaignError where no case is in both."""
    both = there.rows.merge(here.rows, on=CASE, suffixes=("_there", "_here"))
    if both.empty:
        raise CampaignError(
            f"against: expected a campaign with the same cases as {here.folder}, found none of "
            f"them in {there.folder}"
        )
    groups = both.groupby(["system", "estimator"], sort=False)
    return [_of(str(names[0]), str(names[1]), frame) for names, frame in groups]


def _of(system: str, estimator: str, both: pd.DataFrame) -> Comparison:
    from scipy.stats import binomtest  # takes longer to load than all else here

    there, here = (both[f"rmse_all_{side}"].to_numpy(np.float64) for side in ("there", "here"))
    known = np.isfinite(there) & np.isfinite(here) & (there > 0) & (here > 0)
    ratio = here[known] / there[known]
    worse, better = int(np.sum(ratio > 1)), int(np.sum(ratio < 1))
    failed = [int((both[f"outcome_{side}"] != "done").sum()) for side in ("there", "here")]
    within = [float(both[f"within_3sd_{side}"].mean()) for side in ("there", "here")]
    return Comparison(
        system,
        estimator,
        len(both),
        float(np.median(ratio)) if ratio.size else float("nan"),
        float(binomtest(worse, worse + better).pvalue) if worse + better else 1.0,
        (failed[0], failed[1]),
        (within[0], within[1]),
    )
