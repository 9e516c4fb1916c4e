"""What several recordings of one tumbling body are worth beside a longer one: thirty random bodies,
each seen once more at as much spin about another axis; the run goes on from the same instant.
Writes a table of docs/measured/reach.md."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

import ddmhe
from bodies import DEG, DT, Case, bodies, noisy, tumbled
from bound import bound, sensitivities
from ddmhe.report.page import markdown_table
from reach import FAR, WORDS, everywhere, judged, stated
from reach_asked import mean
from reach_page import put

SEEDS = range(7000, 7030)
LONGEST, ONLINE = 400, 3000
"""Samples of the longest recording, and after it."""
SPANS = (20, 100, 300)
"""Seconds over which errors are taken."""
NOISES = (2, 3)
"""Levels."""
REFITS = ("now", "sliced")


@dataclass(frozen=True)
class Plan:
    """What is recorded."""

    name: str
    last: int
    """Samples of the recording that the run goes on from."""
    earlier: int = 0
    """Of the other one."""


PLANS = (
    Plan("20 s", 200),
    Plan("10 s and 10 s", 100, 100),
    Plan("40 s", 400),
    Plan("20 s and 20 s", 200, 200),
    Plan("35 s and 5 s", 50, 350),
)


def turned(group):
    """The same bodies at as much spin about an axis drawn anew."""
    draws = np.array([np.random.default_rng([seed, 7]).standard_normal(3) for seed in SEEDS])
    size = np.linalg.norm(group.w, axis=1) / np.linalg.norm(draws, axis=1)
    return replace(group, w=size[:, None] * draws)


@dataclass(frozen=True)
class Job:
    """A body's recordings as a plan has them."""

    case: Case
    other: Case | None
    unseen: np.ndarray
    refit: str = "now"

    @property
    def history(self) -> ddmhe.History:
        parts = [self.case] if self.other is None else [self.other, self.case]
        return ddmhe.History.concat([part.history for part in parts])


def jobs(plan, level, own, others, group):
    made = []
    for k, seed in enumerate(SEEDS):
        long = noisy(own[0][:, k], own[1][:, k], seed, level, LONGEST)
        case = replace(long, x=long.x[LONGEST - plan.last :], y=long.y[LONGEST - plan.last :])
        other = None
        if plan.earlier:
            x, y = others[0][: plan.earlier + 2, k], others[1][: plan.earlier + 2, k]
            other = noisy(x, y, 10**6 + seed, level, plan.earlier)
        made.append(Job(case, other, group.b[k]))
    return made


def estimated(job: Job):
    """What is found of a case, and the angle (deg) between the unseen direction and the one that
    the recordings alone say."""
    est = ddmhe.RigidBodyMhe(job.history, refit=job.refit, **stated(job.case))
    report = est.report()
    off = np.nan if report is None else abs(np.dot(report.unseen, job.unseen))
    return judged(est.run(job.case.Y), job.case), DEG * np.arccos(min(off, 1.0)), est.explained


def rms(size):
    """Over SPANS (3, …)."""
    return np.array([np.sqrt(np.mean(size[: round(s / DT)] ** 2, axis=0)) for s in SPANS])


def told(found, limit):
    """A row of the errors of all bodies."""
    logs, unseen, explained = found
    errors = rms(np.stack([one.size for one in logs], 1))
    ratio, within = errors / limit, np.array([one.within for one in logs])
    return (
        *(f"{np.median(v):.2g} ({v.max():.2g})" for v in errors),
        f"{np.median(limit[-1]):.2g}",
        f"{mean(ratio[-1]):.2f} ({ratio[-1].max():.2g})",
        f"{np.mean(ratio <= FAR):.0%}",
        f"{within.mean():.2f} ({within.min():.2f})",
        f"{np.median(unseen):.2g} ({np.max(unseen):.2g})",
        str(sum(explained)),
    )


def compared():
    """A row for each noise, plan, and when all is fitted anew."""
    group, rows = bodies(SEEDS), []
    own, others = tumbled(group, LONGEST + ONLINE), tumbled(turned(group), LONGEST)
    of_own = sensitivities(group, LONGEST + ONLINE)
    of_others = sensitivities(turned(group), LONGEST)
    for level, plan in product(NOISES, PLANS):
        made = jobs(plan, level, own, others, group)
        later = [by[LONGEST - plan.last :] for by in of_own]
        earlier = [by[: plan.earlier + 1] for by in of_others] if plan.earlier else None
        limit = rms(DEG * bound(*later, [job.case for job in made], plan.last, earlier))
        for refit in REFITS:
            work = [replace(job, refit=refit) for job in made]
            cells = told(zip(*everywhere(estimated, work), strict=True), limit)
            rows.append((WORDS[level], plan.name, refit, *cells))
            print(rows[-1], flush=True)
    head = ("noise", "recorded", "fits", *(f"{s} s" for s in SPANS), f"bound, {SPANS[-1]} s",
            f"ratio, {SPANS[-1]} s", f"up to {FAR}", "within 2 sd", "unseen direction (deg)",
            "explained")  # fmt: skip
    return markdown_table(head, rows)


if __name__ == "__main__":
    put("recordings", compared())
