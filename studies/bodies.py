"""Cases of a tumbling body that is estimated beyond its recording: the targets of `targets`, moved
accurately, many at once."""

from dataclasses import dataclass

import numpy as np

import ddmhe
from targets import DT, LEVELS, RECORDED, noise, target

ONLINE = 6000
"""Samples after the recording."""
SUBSTEP = 0.025
"""Of the integration, s: at 20 deg/s a step then errs by 1e-12 of the rate."""
DEG = 180 / np.pi
PAIRS = np.triu_indices(3)


@dataclass(frozen=True)
class Bodies:
    """Bodies of a stack (B, …), up to the scale of the inertia as the motion shows them."""

    J: np.ndarray
    """Inertia (B, 3, 3), kg·m²."""
    D: np.ndarray
    """Drag (B, 3, 3): J ω̇ = D ω - ω × J ω."""
    C: np.ndarray
    """Torque (B, 3, 3): y = C ω."""
    b: np.ndarray
    """Unseen direction (B, 3), of length 1."""
    w: np.ndarray
    """First rate (B, 3), rad/s."""


def bodies(seeds) -> Bodies:
    """The targets with these seeds."""
    return stacked([target(seed) for seed in seeds])


def stacked(models) -> Bodies:
    return Bodies(
        np.array([m.inertia for m in models]),
        np.array([m.torque(np.eye(3)).T for m in models]),
        np.array([m.output(np.eye(3)).T for m in models]),
        np.array([m.B / np.linalg.norm(m.B) for m in models]),
        np.array([m.omega_0 for m in models]),
    )


def cross(v):
    """The matrices (…, 3, 3) of v × ·."""
    a, b, c = np.moveaxis(v, -1, 0)
    o = np.zeros_like(a)
    return np.stack([o, -c, b, c, o, -a, -b, a, o], -1).reshape(*v.shape, 3)


def euler(J, D):
    """Euler's equation of B bodies as f(ω) of (3, B): its monomials times their coefficients."""
    inverse = np.linalg.inv(J)
    # ω × J ω = Σ_ab ω_a ω_b e_a × J e_b
    gyro = np.einsum("...ij,ajk,...kb->...iab", inverse, cross(np.eye(3)), J)
    square = gyro + np.swapaxes(gyro, -1, -2)
    square[..., range(3), range(3)] /= 2
    terms = np.concatenate([inverse @ D, -square[..., PAIRS[0], PAIRS[1]]], -1)
    terms = np.ascontiguousarray(np.moveaxis(terms, 0, -1))  # 3 × 9 × B

    def f(w):
        return np.einsum("ikb,kb->ib", terms, np.concatenate([w, w[PAIRS[0]] * w[PAIRS[1]]]))

    return f


def moved(f, start, samples, dt=DT):
    """States (samples+1, …) at 0, dt, … of ẋ = f(x) from `start`, by the classical Runge-Kutta
    method."""
    substeps = int(np.ceil(dt / SUBSTEP - 1e-9))
    x, h, states = start, dt / substeps, np.empty((samples + 1, *start.shape), start.dtype)
    states[0] = x
    for k in range(samples):
        for _ in range(substeps):
            p = f(x)
            q = f(x + h / 2 * p)
            r = f(x + h / 2 * q)
            x = x + h / 6 * (p + 2 * q + 2 * r + f(x + h * r))
        states[k + 1] = x
    return states


def tumbled(group: Bodies, samples=RECORDED + ONLINE, dt=DT):
    """Rates and torques (samples+1, B, 3), without noise."""
    x = np.moveaxis(moved(euler(group.J, group.D), group.w.T, samples, dt), 1, -1)
    return x, np.einsum("bij,tbj->tbi", group.C, x)


@dataclass(frozen=True)
class Case:
    """A recording, what follows it, and the noise of both."""

    x: np.ndarray
    """Recorded rates (T+1, 3)."""
    y: np.ndarray
    """Recorded torques (T, 3)."""
    Y: np.ndarray
    """Torques after it (N, 3)."""
    truth: np.ndarray
    """Rates (N, 3) behind each of them."""
    noise: tuple[float, float, float]
    """Deviations of x, y and Y."""
    dt: float = DT

    @property
    def history(self) -> ddmhe.History:
        return ddmhe.History(self.x, self.y, dt=self.dt, x_units="rad/s", y_units="N m")


def noisy(x, y, seed, level, recorded=RECORDED, dt=DT) -> Case:
    """A case of one body's rates and torques (N+1, 3), with the noise of a level."""
    of_x, of_y, of_later = noise(seed, level, recorded, len(y) - 1 - recorded)
    read, torque, later = x[: recorded + 1] + of_x, y[:recorded] + of_y, y[recorded:-1] + of_later
    return Case(read, torque, later, x[recorded + 1 :], LEVELS[level], dt)
