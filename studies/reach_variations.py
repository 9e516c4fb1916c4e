"""What becomes of the estimate of a tumbling body when something is other than in studies/reach.py:
ten held-out bodies, noise of 1e-4 rad/s and .01 N m, one thing changed at a time. Writes a table of
docs/measured/reach.md."""

from dataclasses import dataclass, replace

import numpy as np

import ddmhe
from bodies import DT, Bodies, Case, bodies, euler, moved, noisy
from ddmhe.report.page import markdown_table
from reach import everywhere, judged, stated
from reach_page import put

SEEDS, LEVEL, ONLINE, SPAN = range(5000, 5010), 2, 300.0, 100
"""Seconds after the recording; seconds over which errors are taken."""
FINE, LONGEST = 0.05, 50.0
"""Sample period and longest recording of all simulations, s."""
SLUG_TIME = 5.0
"""Of a fuel slug that the tank drags along, s."""


@dataclass(frozen=True)
class Change:
    """What is other than usual."""

    name: str
    dt: float = DT
    recorded: float = 20.0
    """Seconds."""
    told: bool = True
    """Whether the noise is stated."""
    missing: float = 0.0
    """Share of later torques."""
    wild: float = 0.0
    """Share of later torques that are ten times too large at random."""
    bias: float = 0.0
    """On every torque, N m."""
    later: float = 0.0
    """On every torque after the recording, N m."""
    drift: float = 0.0
    """On every torque after the recording, growing by this in 100 s, N m."""
    cubic: float = 0.0
    """Drag and torque are 1 + this |ω|²/|ω(0)|² times as large."""
    slug: float = 0.0
    """Inertia of a fuel slug over the body's mean one."""
    wheel: float = 0.0
    """Angular momentum of a wheel about the first axis over the body's at first."""
    lag: float = 0.0
    """Of the torque's sensor, s."""
    feared: bool = False
    """Whether a lag is asked for."""


CHANGES = (
    Change("none"),
    Change("noise unknown", told=False),
    Change("recording of 10 s", recorded=10.0),
    Change("recording of 40 s", recorded=40.0),
    Change("dt .05 s", dt=0.05),
    Change("dt .2 s", dt=0.2),
    Change("dt .5 s, recording of 50 s", dt=0.5, recorded=50.0),
    Change("30 % of torques missing", missing=0.3),
    Change("1 % of torques wild", wild=0.01),
    Change("bias .05 N m", bias=0.05),
    Change("bias .5 N m", bias=0.5),
    Change("bias .05 N m, after the recording only", later=0.05),
    Change("drift of .05 N m in 100 s", drift=0.05),
    Change("cubic drag, 10 %", cubic=0.1),
    Change("cubic drag, 50 %", cubic=0.5),
    Change("fuel slug, 2 %", slug=0.02),
    Change("fuel slug, 10 %", slug=0.1),
    Change("wheel, 5 % of the momentum", wheel=0.05),
    Change("sensor's lag, .1 s", lag=0.1),
    Change("sensor's lag, .3 s", lag=0.3),
    Change("sensor's lag, 1 s", lag=1.0),
    Change("none, `output_lag=True`", feared=True),
    Change("lag of .1 s, `output_lag=True`", lag=0.1, feared=True),
    Change("lag of .3 s, `output_lag=True`", lag=0.3, feared=True),
    Change("lag of 1 s, `output_lag=True`", lag=1.0, feared=True),
)


def motion(changes, group: Bodies):
    """f of the joint states (9, B) of B bodies, a change each: rates, rates of the slug, what the
    torque's sensor shows."""
    plain, inverse = euler(group.J, 0 * group.D), np.linalg.inv(group.J)
    cubic, slug, wheel, lag = np.array([(c.cubic, c.slug, c.wheel, c.lag) for c in changes]).T
    cubic = cubic / np.sum(group.w**2, axis=1)
    slug = slug * np.trace(group.J, axis1=1, axis2=2) / 3 / SLUG_TIME
    wheel = wheel * np.linalg.norm(np.einsum("bij,bj->bi", group.J, group.w), axis=1)
    quick = np.divide(1, lag, out=np.zeros_like(lag), where=lag > 0)

    def f(state):
        w, of_slug, shown = state[:3], state[3:6], state[6:]
        strength = 1 + cubic * np.sum(w**2, axis=0)
        torque = strength * np.einsum("bij,jb->ib", group.D, w) - slug * (w - of_slug)
        torque -= np.stack([0 * wheel, w[2] * wheel, -w[1] * wheel])  # ω × h e_1
        y = strength * np.einsum("bij,jb->ib", group.C, w)
        turned = plain(w) + np.einsum("bij,jb->ib", inverse, torque)
        return np.concatenate([turned, (w - of_slug) / SLUG_TIME, quick * (y - shown)])

    return f


def simulated(changes):
    """Rates and torques of each change (changes, samples, bodies, 3) every FINE seconds, without
    noise."""
    one = bodies(SEEDS)
    parts = [np.concatenate([part] * len(changes)) for part in (one.J, one.D, one.C, one.b, one.w)]
    group, each = Bodies(*parts), np.repeat(changes, len(SEEDS))
    cubic = np.array([change.cubic for change in each])
    first = (1 + cubic) * np.einsum("bij,bj->ib", group.C, group.w)
    start = np.concatenate([group.w.T, group.w.T, first])
    state = moved(motion(each, group), start, round((LONGEST + ONLINE) / FINE), FINE)
    x = state[:, :3]
    strength = 1 + cubic * np.sum(x**2, axis=1) / np.sum(group.w**2, axis=1)
    y = strength[:, None] * np.einsum("bij,tjb->tib", group.C, x)
    lagged = np.array([change.lag > 0 for change in each])
    y[..., lagged] = state[:, 6:][..., lagged]
    shape = (len(x), 3, len(changes), len(SEEDS))
    return (np.einsum("tikb->ktbi", v.reshape(shape)) for v in (x, y))


def cases(change: Change, x, y) -> list[Case]:
    """A case of each body from rates and torques (samples, bodies, 3) every FINE seconds."""
    recorded, end = round(change.recorded / change.dt), round((change.recorded + ONLINE) / FINE)
    x, y = (v[: end + 1 : round(change.dt / FINE)] for v in (x, y))
    after = np.arange(len(y)) - recorded
    offset = change.bias + (after >= 0) * (change.later + change.drift * after * change.dt / 100)
    made = []
    for k, seed in enumerate(SEEDS):
        case = noisy(x[:, k], y[:, k] + offset[:, None], seed, LEVEL, recorded, change.dt)
        draw, Y = np.random.default_rng([seed, 99]), case.Y.copy()
        Y[draw.random(Y.shape) < change.missing] = np.nan
        wild = draw.random(Y.shape) < change.wild
        Y[wild] = 10 * np.sqrt(np.mean(case.y**2)) * draw.standard_normal(wild.sum())
        made.append(replace(case, Y=Y))
    return made


def settings(case: Case, change: Change) -> dict:
    """Of RigidBodyMhe."""
    lag = dict(output_lag=True) if change.feared else {}
    return (stated(case) if change.told else {}) | lag


def both(job):
    """What DdMhe and RigidBodyMhe make of a case, with settings of the latter, and whether a body
    explains the recording."""
    case, settings = job
    affine = ddmhe.DdMhe(case.history, output_noise=settings.get("output_noise"))
    rigid = ddmhe.RigidBodyMhe(case.history, **settings)
    found = [judged(estimator.run(case.Y), case) for estimator in (affine, rigid)]
    rigid.reset()
    return *found, rigid.explained


def rms(found, dt, seconds=SPAN):
    return float(np.sqrt(np.mean(found.size[: round(seconds / dt)] ** 2)))


def changed():
    """A row for each change."""
    sets = [cases(*parts) for parts in zip(CHANGES, *simulated(CHANGES), strict=True)]
    together = zip(CHANGES, sets, strict=True)
    jobs = [(case, settings(case, change)) for change, own in together for case in own]
    made, rows = everywhere(both, jobs), []
    for change, own in zip(CHANGES, sets, strict=True):
        affine, rigid, explained = zip(*(next(made) for _ in own), strict=True)
        ours, theirs = (np.array([rms(one, change.dt) for one in e]) for e in (rigid, affine))
        three, five = np.array([one.unnoticed for one in rigid]).T
        doubts = np.array([one.doubt for one in rigid])
        seen = doubts[np.isfinite(doubts)]
        rows.append((change.name, f"{np.median(ours):.2g} ({ours.max():.2g})",
                     f"{np.median(theirs):.2g} ({theirs.max():.2g})", str(sum(explained)),
                     f"{np.mean([one.trusted for one in rigid]):.0%}",
                     f"{three.mean():.1%} ({three.max():.0%})",
                     f"{five.mean():.1%} ({five.max():.0%})",
                     f"{len(seen)}: {np.median(seen):.2g} s" if len(seen) else "0",
                     str(sum(one.fell for one in rigid))))  # fmt: skip
    head = ("changed", "RigidBodyMhe", "DdMhe", "explained", "trusted", "unnoticed, 3 sd", "5 sd",
            "doubted, first after", "fell back")  # fmt: skip
    return markdown_table(head, rows)


if __name__ == "__main__":
    put("variations", changed())
