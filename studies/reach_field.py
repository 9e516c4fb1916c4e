"""What a known field that moves is worth to the estimate of a tumbling body: thirty random bodies,
each in its field as it stands, and with that turned about a random axis. Writes a table of
docs/measured/reach.md."""

from dataclasses import dataclass
from itertools import product

import numpy as np

import ddmhe
from bodies import DEG, DT, Case, bodies, cross, euler, moved, noisy, tumbled
from bound import STEP, E, bound, deviations, sensitivities, weights
from ddmhe.report.page import markdown_table
from reach import FAR, WORDS, everywhere, judged, stated
from reach_asked import mean
from reach_page import put
from targets import RECORDED, target

SEEDS, ONLINE = range(7100, 7130), 3000
SPANS = (20, 40, 100, 300)
"""Seconds over which errors are taken."""
NOISES = (2, 3)
"""Levels."""
REFITS = ("now", "sliced")
TURN, ALONG = 0.3, 0.4
"""How fast the field turns (rad/s), and its part along the axis over that across it."""
MOVING, ALL = 14, 15
"""Unknowns that move the body: its first rate 3, J 5, M 6; and log κ."""
ENTRIES = np.triu_indices(3)


@dataclass(frozen=True)
class Turned:
    """Bodies (B, …) in turned fields."""

    J: np.ndarray
    """Inertia of trace 3."""
    M: np.ndarray
    """What the field moves in the body, in the same unit."""
    scale: np.ndarray
    """Of the inertia, kg·m²: κ."""
    frame: np.ndarray
    """The field turns in the plane of the first two columns (B, 3, 3), which have its size."""
    arm: np.ndarray
    """K = [B] - arm."""
    w: np.ndarray
    """First rate (B, 3), rad/s."""


def turned() -> Turned:
    models = [target(seed) for seed in SEEDS]
    scale = np.array([np.trace(m.inertia) / 3 for m in models])
    draws = [np.random.default_rng([seed, 8]).standard_normal((3, 3)) for seed in SEEDS]
    axes = np.linalg.qr(np.array(draws))[0]
    size = np.array([np.linalg.norm(m.B) for m in models]) / np.hypot(1, ALONG)
    return Turned(
        np.array([m.inertia for m in models]) / scale[:, None, None],
        np.array([m.M_eff for m in models]) / scale[:, None, None],
        scale,
        axes * size[:, None, None],
        np.array([cross(m.r) @ m.Lambda for m in models]),
        np.array([m.omega_0 for m in models]),
    )


def field(frame, t):
    """B at time t of frames (…, 3, 3)."""
    return frame @ np.array([np.cos(TURN * t), np.sin(TURN * t), ALONG])


def motion(J, M, frame):
    """f of (ω, t) (4, B), of bodies in turning fields."""
    plain, inverse = euler(J, 0 * J), np.linalg.inv(J)

    def f(state):
        w, b = state[:3], cross(field(frame, state[3, 0].real))
        torque = np.einsum("bij,bjk,bkl,lb->bi", b, M, b, w, optimize=True)
        gain = np.einsum("bij,bj->ib", inverse, torque)
        return np.concatenate([plain(w) + gain, np.ones((1, w.shape[1]))])

    return f


def simulated(group, unknown=1, J=None, M=None, w=None):
    """Rates (samples+1, B, 3), each body `unknown` times."""
    w = group.w if w is None else w
    frame = np.repeat(group.frame, unknown, axis=0)
    f = motion(group.J if J is None else J, group.M if M is None else M, frame)
    start = np.concatenate([w.T, np.zeros((1, len(w)))])
    return np.moveaxis(moved(f, start, RECORDED + ONLINE)[:, :3], 1, -1)


def known(group, samples):
    """B (samples, B, 3) and K (samples, B, 3, 3)."""
    B = np.array([field(group.frame, k * DT) for k in range(samples)])
    return B, cross(B) - group.arm


def shown(M, x, B, K):
    """y / κ = -K M (B × ω)."""
    return -np.einsum("...ij,...jk,...k->...i", K, M, np.cross(B, x), optimize=True)


def of_field(group):
    """∂ω/∂ and ∂y/∂ (samples+1, B, 3, 15) by the unknowns, by complex steps."""
    B, steps = len(group.w), 1j * STEP * np.eye(MOVING)
    w = (group.w[:, None] + steps[:, :3]).reshape(-1, 3)
    J = (group.J[:, None] + np.einsum("dk,kij->dij", steps[:, 3:8], E)).reshape(-1, 3, 3)
    moment = np.zeros((MOVING, 3, 3), complex)
    upper, lower = ENTRIES
    moment[:, upper, lower] = moment[:, lower, upper] = steps[:, 8:]
    M = group.M[:, None] + moment
    x = simulated(group, MOVING, J, M.reshape(-1, 3, 3), w).reshape(-1, B, MOVING, 3)
    b, K = known(group, len(x))
    y = group.scale[:, None, None] * shown(M, x, b[:, :, None], K[:, :, None])
    of_x, of_y = np.zeros((2, *x.shape[:2], 3, ALL))
    of_x[..., :MOVING] = np.moveaxis(x.imag, 2, 3) / STEP
    of_y[..., :MOVING] = np.moveaxis(y.imag, 2, 3) / STEP
    of_y[..., MOVING] = y[:, :, 0].real
    return of_x, of_y


def limit_in_field(by, group, cases):
    """What the bound allows (N, B), rad/s."""
    weight, W, _ = weights(cases)
    size = 0.3 * W / np.mean(np.sum(known(group, RECORDED)[0] ** 2, axis=-1), axis=0)
    one = np.ones(len(cases))
    prior = [0 * one] * 3 + [one / 0.35] * 5 + [1 / size] * 6 + [one / 2]
    return deviations(np.transpose(prior)[:, :, None] * np.eye(ALL), *by, weight, RECORDED)


@dataclass(frozen=True)
class Job:
    """A case, and the field of all its samples, if it is known."""

    case: Case
    field: tuple | None
    refit: str


def estimated(job: Job):
    """What is found of a case, and whether a body explains the recording."""
    told, later = {}, {}
    if job.field:
        B, K = job.field
        told["field"] = B[: RECORDED + 1], K[: RECORDED + 1]
        later["field"] = B[RECORDED:-1], K[RECORDED:-1]
    est = ddmhe.RigidBodyMhe(job.case.history, refit=job.refit, **told, **stated(job.case))
    return judged(est.run(job.case.Y, **later), job.case), est.explained


def rms(size):
    """Over SPANS (4, …)."""
    return np.array([np.sqrt(np.mean(size[: round(s / DT)] ** 2, axis=0)) for s in SPANS])


def told(found, limit):
    """A row of the errors of all bodies."""
    logs, explained = found
    errors = rms(np.stack([one.size for one in logs], 1))
    ratio, within = errors / limit, np.array([one.within for one in logs])
    return (
        *(f"{np.median(v):.2g} ({v.max():.2g})" for v in errors),
        " ".join(f"{np.median(v):.2g}" for v in limit[[0, 2]]),
        " ".join(f"{mean(v):.2f}" for v in ratio) + f" ({ratio.max():.2g})",
        f"{np.mean(ratio <= FAR):.0%}",
        f"{within.mean():.2f} ({within.min():.2f})",
        str(sum(explained)),
    )


def compared():
    """A row for each noise, field, and when all is fitted anew."""
    standing, group, rows = bodies(SEEDS), turned(), []
    x = simulated(group)
    fields = known(group, len(x))
    of_standing, of_turned = sensitivities(standing, RECORDED + ONLINE), of_field(group)
    y = group.scale[:, None] * shown(group.M, x, *fields)
    kinds = {"stands": tumbled(standing, RECORDED + ONLINE), "turns": (x, y)}
    for level, (kind, data) in product(NOISES, kinds.items()):
        made = [noisy(*(v[:, k] for v in data), seed, level) for k, seed in enumerate(SEEDS)]
        moves = kind == "turns"
        allowed = limit_in_field(of_turned, group, made) if moves else bound(
            *of_standing, made, RECORDED)  # fmt: skip
        for refit in REFITS:
            jobs = [
                Job(case, tuple(v[:, k] for v in fields) if moves else None, refit)
                for k, case in enumerate(made)
            ]
            cells = told(zip(*everywhere(estimated, jobs), strict=True), rms(DEG * allowed))
            rows.append((WORDS[level], kind, refit, *cells))
            print(rows[-1], flush=True)
    head = ("noise", "field", "fits", *(f"{s} s" for s in SPANS), "bound, 20 and 100 s",
            "ratios", f"up to {FAR}", "within 2 sd", "explained")  # fmt: skip
    return markdown_table(head, rows)


if __name__ == "__main__":
    put("field", compared())
