"""Tumbling targets of random inertia, conductivity, field and spin, larger in variety than the
bodies of `noisy_systems`, with noises by level."""

import numpy as np

import ddmhe
from noisy_systems import Log

LEVELS = (
    (0.0, 0.0, 0.01),
    (1e-5, 1e-3, 1e-3),
    (1e-4, 0.01, 0.01),
    (1e-3, 0.01, 0.01),
    (1e-3, 0.05, 0.05),
)
"""By level: deviations on recorded rates (rad/s), recorded torques and later ones (N·m)."""
DT, RECORDED = 0.1, 200
AFTER = 1000
"""Samples after the recording."""


def target(seed: int):
    """A target as a model; drawn in the order inertia, conductivity, field, gradient, place,
    spin."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    moments = rng.uniform(1000, 6000, 3)
    while 2 * moments.max() >= 0.98 * moments.sum():
        moments = rng.uniform(1000, 6000, 3)
    inertia = axes @ np.diag(moments) @ axes.T
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    M_eff = 0.89e5 * axes @ np.diag(rng.uniform(1.5, 7, 3)) @ axes.T
    B = rng.standard_normal(3)
    B *= rng.uniform(50e-4, 110e-4) / np.linalg.norm(B)
    gradient = rng.standard_normal((3, 3))
    gradient = gradient + gradient.T
    gradient -= np.eye(3) * np.trace(gradient) / 3
    r = rng.uniform(-1, 1, 3)
    spin = rng.standard_normal(3)
    spin *= np.deg2rad(rng.uniform(2, 20)) / np.linalg.norm(spin)
    return ddmhe.models.detumbling(
        inertia=0.5 * (inertia + inertia.T),
        M_eff=M_eff,
        B=B,
        r=r,
        Lambda=70e-4 * gradient,
        omega_0=spin,
    )


def noise(seed: int, level: int, recorded: int, after: int):
    """Noise of recorded rates (recorded+1, 3), recorded torques and later ones (after, 3)."""
    rng, sizes = np.random.default_rng([seed, level]), (recorded + 1, recorded, after)
    draws = zip(LEVELS[level], sizes, strict=True)
    return [deviation * rng.standard_normal((size, 3)) for deviation, size in draws]


def detumbled(seed: int, level: int, after: int = AFTER) -> Log:
    """20 s of recording and `after` samples that follow."""
    record = target(seed).simulate((RECORDED + after) * DT, DT)
    of_x, of_y, of_later = noise(seed, level, RECORDED, after)
    x, y = record.x[: RECORDED + 1] + of_x, record.y[:RECORDED] + of_y
    history = ddmhe.History(x, y, DT, x_units="rad/s", y_units="N·m")
    read, _, later = LEVELS[level]
    Y = record.y[RECORDED:-1] + of_later
    return Log(history, Y, record.x[RECORDED + 1 :], read, later, 180 / np.pi)
