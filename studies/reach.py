"""How far estimates of a tumbling body reach beyond its recording: thirty random bodies at five
noise levels, 20 s recorded, 600 s from their torque alone. Prints the tables of
docs/measured/reach.md."""

import sys

import numpy as np

import ddmhe
from ddmhe.report.page import markdown_table

BODIES, DT, RECORDED, ONLINE = 30, 0.1, 200, 6000
SPANS = (20, 40, 100, 600)
"""Seconds after the recording's end over which errors are taken."""
LEVELS = (
    ("none; 0.01 later", 0.0, 0.0, 1e-2),
    ("1e-5, 0.001", 1e-5, 1e-3, 1e-3),
    ("1e-4, 0.01", 1e-4, 1e-2, 1e-2),
    ("1e-3, 0.01", 1e-3, 1e-2, 1e-2),
    ("1e-3, 0.05", 1e-3, 5e-2, 5e-2),
)
"""Noise of recorded rates (rad/s), of recorded and of later torques (N m)."""
DEG = 180 / np.pi


def cross(v):
    """The matrices (…, 3, 3) of v × ·."""
    a, b, c = np.moveaxis(v, -1, 0)
    o = np.zeros_like(a)
    return np.stack([o, -c, b, c, o, -a, -b, a, o], -1).reshape(*v.shape, 3)


def rotation(draw):
    return np.linalg.qr(draw.standard_normal((3, 3)))[0]


def body(seed):
    """Inertia (kg m²), drag and map to the torque (3, 3), first rate (rad/s) of a random body in a
    magnetic field that brakes it."""
    draw = np.random.default_rng(seed)
    moments = draw.uniform(1000, 6000, 3)
    while 2 * moments.max() >= 0.98 * moments.sum():  # no body has such moments
        moments = draw.uniform(1000, 6000, 3)
    turn, other = rotation(draw), rotation(draw)
    conductivity = 0.89e5 * other @ np.diag(draw.uniform(1.5, 7, 3)) @ other.T
    field = draw.standard_normal(3)
    field *= draw.uniform(50e-4, 110e-4) / np.linalg.norm(field)
    gradient = draw.standard_normal((3, 3))
    gradient = 70e-4 * (gradient + gradient.T)
    gradient -= np.eye(3) * np.trace(gradient) / 3
    arm = cross(draw.uniform(-1, 1, 3))
    rate = draw.standard_normal(3)
    rate *= np.deg2rad(draw.uniform(2, 20)) / np.linalg.norm(rate)
    brake = conductivity @ cross(field)
    return (
        turn @ np.diag(moments) @ turn.T,
        cross(field) @ brake,
        -(cross(field) - arm @ gradient) @ brake,
        rate,
    )


def tumbling():
    """Rates and torques (samples, bodies, 3) of all bodies, without noise."""
    J, D, C, w = (np.array(part) for part in zip(*map(body, range(BODIES)), strict=True))
    inverse, h = np.linalg.inv(J), DT / 4

    def along(A, v):
        return np.einsum("bij,bj->bi", A, v)

    def f(w):
        return along(inverse, along(D, w) - np.cross(w, along(J, w)))

    rates = [w]
    for _ in range(RECORDED + ONLINE):
        for _ in range(4):
            a = f(w)
            b = f(w + h / 2 * a)
            c = f(w + h / 2 * b)
            w = w + h / 6 * (a + 2 * b + 2 * c + f(w + h * c))
        rates.append(w)
    x = np.array(rates)
    return x, np.einsum("bij,tbj->tbi", C, x)


def errors(log, truth):
    """Root-mean-square errors (deg/s) over each of SPANS, and the share within two deviations."""
    off = log.x - truth
    square = np.sum(off**2, axis=1)
    spans = [DEG * np.sqrt(np.mean(square[: round(s / DT)])) for s in SPANS]
    return [*spans, np.mean(np.abs(off) <= 2 * log.std)]


def case(x, y, level, seed):
    """Errors of three estimators on one body."""
    _, of_x, of_y, of_later = level
    draw = np.random.default_rng([77, seed])
    noisy = y[:-1] + np.where(np.arange(len(y) - 1) < RECORDED, of_y, of_later)[
        :, None
    ] * draw.standard_normal((len(y) - 1, 3))
    recorded = x[: RECORDED + 1] + of_x * draw.standard_normal((RECORDED + 1, 3))
    history = ddmhe.History(recorded, noisy[:RECORDED], dt=DT)
    noise = dict(x_noise=of_x, y_noise=of_y, output_noise=of_later)
    made = [
        ddmhe.DdMhe(history, output_noise=max(of_later, 1e-9)),
        ddmhe.RigidBodyMhe(history, refit="now", **noise),
        ddmhe.RigidBodyMhe(history, refit="sliced", **noise),
    ]
    logs = [estimator.run(noisy[RECORDED:]) for estimator in made]
    fell = [np.any(log.status == "affine") for log in logs]
    return [errors(log, x[RECORDED + 1 :]) for log in logs], fell


def main():
    """All cases; the tables."""
    x, y = tumbling()
    names = ("DdMhe", "RigidBodyMhe, now", "RigidBodyMhe, sliced")
    rows, ratios = [], []
    for level in LEVELS:
        found = []
        for k in range(BODIES):
            values, fell = case(x[:, k], y[:, k], level, k)
            found.append(values)
            if any(fell):
                print(f"{level[0]}: body {k} fell back", file=sys.stderr)
        found = np.array(found)  # bodies, estimators, spans and coverage
        for i, name in enumerate(names):
            spans = [f"{np.median(v):.2g} ({v.max():.2g})" for v in found[:, i, :4].T]
            cover = found[:, i, 4]
            rows.append((level[0], name, *spans, f"{cover.mean():.2f} ({cover.min():.2f})"))
        ratio = found[:, 2, :4] / found[:, 1, :4]
        means = [f"{np.exp(np.mean(np.log(v))):.2f} ({v.max():.3g})" for v in ratio.T]
        ratios.append((level[0], *means))
    head = ("noise", "estimator", *(f"{s} s" for s in SPANS), "within 2 sd")
    print("\n".join(markdown_table(head, rows)))
    print()
    print("\n".join(markdown_table(("noise", *(f"{s} s" for s in SPANS)), ratios)))


if __name__ == "__main__":
    main()
