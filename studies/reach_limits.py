"""What an estimator of a tumbling body cannot see, and what it does with recordings that no rigid
body made. Writes tables of docs/measured/reach.md."""

import numpy as np

import ddmhe
import real_logs
from bodies import DEG, DT, RECORDED, Case, bodies, euler, moved, noisy, stacked, tumbled
from ddmhe.report.page import markdown_table
from lifted import integrated
from reach import everywhere, stated
from reach_page import put
from reach_variations import LEVEL, SEEDS, both

ONLINE, PUSHED, PUSH = 3000, 100, np.deg2rad(0.5)
"""Samples after the recording; when the rate jumps, and by how much (rad/s)."""


def of_the_paper():
    """The paper's target after six recordings with noise: errors (deg/s), shares within two
    deviations."""
    x, y = tumbled(stacked([ddmhe.models.detumbling()]))
    cases = [noisy(x[:, 0], y[:, 0], k, LEVEL) for k in range(6)]
    logs, rows = everywhere(both, [(case, stated(case)) for case in cases]), []
    for k, (affine, rigid, _) in enumerate(logs):
        rows.append((str(k), *map("{:.2g}".format, [*rigid.rms, *affine.rms[2:]]),
                     f"{rigid.within:.2f}"))  # fmt: skip
    head = ("draw", "20 s", "40 s", "100 s", "600 s", "DdMhe, 100 s", "600 s", "within 2 sd")
    return markdown_table(head, rows)


def pushed(along) -> list[Case]:
    """Cases in which each body's rate jumps 10 s after the recording: about its unseen direction,
    or about a direction across it."""
    group = bodies(SEEDS)
    across = np.cross(group.b, group.w)
    about = group.b if along else across / np.linalg.norm(across, axis=1, keepdims=True)
    f = euler(group.J, group.D)
    before = moved(f, group.w.T, RECORDED + PUSHED)
    after = moved(f, before[-1] + PUSH * about.T, ONLINE - PUSHED)
    x = np.moveaxis(np.concatenate([before[:-1], after]), 1, -1)
    y = np.einsum("bij,tbj->tbi", group.C, x)
    return [noisy(x[:, k], y[:, k], seed, LEVEL) for k, seed in enumerate(SEEDS)]


def unseen():
    """Pushes about the unseen direction and across it."""
    jobs = [(case, stated(case)) for along in (True, False) for case in pushed(along)]
    logs, rows = everywhere(both, jobs), []
    for about in ("the unseen direction", "a direction across"):
        own = [next(logs)[1] for _ in SEEDS]
        late = np.array([one.doubt for one in own]) - PUSHED * DT
        told = late[late >= 0]  # those doubted before say nothing
        three = np.array([one.unnoticed[0] for one in own])
        at = [[one.size[PUSHED + round(s / DT)] for one in own] for s in (1, 10, 50, 280)]
        rows.append((about, *(f"{np.median(v):.2g} ({max(v):.2g})" for v in at),
                     f"{len(told)}: {np.median(told):.2g} s" if len(told) else "0",
                     f"{three.mean():.1%}"))  # fmt: skip
    head = ("push about", "1 s after it", "10 s", "50 s", "280 s", "doubted, first after",
            "unnoticed, 3 sd")  # fmt: skip
    return markdown_table(head, rows)


def one_body():
    """Errors of the first body (deg/s) along its unseen direction and across it, after both
    pushes."""
    axes, lines = np.linalg.svd(bodies(SEEDS[:1]).b)[2], []
    cases = [pushed(along)[0] for along in (True, False)]
    logs = [ddmhe.RigidBodyMhe(case.history, **stated(case)).run(case.Y) for case in cases]
    for s in (-1, 0.5, 2, 5, 10, 20, 50):
        k, cells = PUSHED + round(s / DT), []
        for case, log in zip(cases, logs, strict=True):
            off = DEG * np.abs(axes @ (log.x[k] - case.truth[k]))
            cells += [
                f"{off[0]:.2g}",
                f"{np.hypot(*off[1:]):.2g}",
                "yes" if log.trusted[k] else "no",
            ]
        lines.append((f"{s} s", *cells))
    head = ("after the push", "pushed about b: along b", "across", "trusted",
            "pushed across: along b", "across", "trusted")  # fmt: skip
    return markdown_table(head, lines)


def strangers():
    """Recordings of three states that no rigid body made: name, Case."""
    A = np.array([[0.99, 0.1, 0.0], [-0.1, 0.99, 0.0], [0.02, 0.0, 0.95]])
    C = np.array([[1.0, 0.2, 0.0], [0.0, 1.0, 0.3]])
    for seed in range(3):
        draw = np.random.default_rng([seed, 5])
        x = [draw.standard_normal(3)]
        for _ in range(1200):
            x.append(A @ x[-1] + [0.0, 0.01, 0.02])
        yield "stable oscillator", stranger(np.array(x), C, 1e-3, draw)

    def double(s):
        """Angles and rates of two equal rods with a mass at each end, g/l = 1."""
        a, b, u, v = s
        d = a - b
        den = 3 - np.cos(2 * d)
        return np.array([
            u, v,
            -(3 * np.sin(a) + np.sin(a - 2 * b)
              + 2 * np.sin(d) * (v * v + u * u * np.cos(d))) / den,
            2 * np.sin(d) * (2 * u * u + 2 * np.cos(a) + v * v * np.cos(d)) / den,
        ])  # fmt: skip

    for swing in (0.3, 1.0, 2.0):
        draw = np.random.default_rng([int(10 * swing), 6])
        s = integrated(double, (swing, -swing / 2, 0.0, 0.0), 0.1, 1200)
        yield f"double pendulum, {swing} rad", stranger(s[:, 1:], C, 1e-3, draw)

    def lorenz(x):
        return np.array([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])

    for seed in range(3):
        draw = np.random.default_rng([seed, 7])
        start = draw.standard_normal(3) + np.array([0, 0, 20])
        yield (
            "Lorenz's system",
            stranger(integrated(lorenz, start, 0.02, 1700)[500:], C, 1e-3, draw),
        )
    for test in real_logs.pendulums():
        log = test.log
        yield "measured pendulums", Case(*log.history.recordings[0], log.Y, log.truth, None,
                                         log.history.dt)  # fmt: skip


def stranger(x, C, share, draw):
    """A case of states (N+1, 3), with noise of a share of their spread."""
    y, recorded = x[:-1] @ C.T, 200
    read = x + share * x.std() * draw.standard_normal(x.shape)
    y = y + share * y.std() * draw.standard_normal(y.shape)
    return Case(read[: recorded + 1], y[:recorded], y[recorded:], x[recorded + 1 :], None)


def strange(case):
    """Errors of DdMhe and RigidBodyMhe, whether a body explains the recording, share affine."""
    history = ddmhe.History(case.x, case.y, case.dt)
    rigid = ddmhe.RigidBodyMhe(history)
    logs = ddmhe.DdMhe(history).run(case.Y), rigid.run(case.Y)
    off = [np.sqrt(np.nanmean((log.x - case.truth) ** 2)) for log in logs]
    return *off, rigid.explained, np.mean(logs[1].status == "affine")


def fallen():
    """A row for each kind of stranger."""
    jobs = list(strangers())
    rows, made = {}, everywhere(strange, [case for _, case in jobs])
    for (name, _), found in zip(jobs, made, strict=True):
        rows.setdefault(name, []).append(found)
    lines = []
    for name, own in rows.items():
        affine, rigid, explained, share = np.array(own, float).T
        lines.append((name, str(len(own)), f"{np.median(affine):.3g}", f"{np.median(rigid):.3g}",
                      f"{np.max(rigid / affine):.4f}", str(int(explained.sum())),
                      f"{share.mean():.0%}"))  # fmt: skip
    head = ("recordings", "number", "DdMhe", "RigidBodyMhe", "largest ratio",
            "explained by a body", "affine")  # fmt: skip
    return markdown_table(head, lines)


def main():
    put("paper", of_the_paper())
    put("pushes", unseen())
    put("one body", one_body())
    put("strangers", fallen())


if __name__ == "__main__":
    main()
