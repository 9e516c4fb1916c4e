"""Random linear systems with inputs, offsets and feed-through, their recordings and logs."""

from dataclasses import dataclass

import numpy as np

import ddmhe
from reference import random_system


@dataclass(frozen=True)
class Forced:
    """x(k+1) = A x + B u + e, y = C x + D u + r, a recording of it and what follows."""

    A: np.ndarray
    B: np.ndarray
    e: np.ndarray
    C: np.ndarray
    D: np.ndarray
    r: np.ndarray
    history: ddmhe.History
    x: np.ndarray
    Y: np.ndarray
    U: np.ndarray | None
    residual: np.ndarray | None = None


def random_case(seed, *, inputs=True, noise=0.0, disturbance=0.0, steps=40):
    """n <= 4, p <= 2, m <= 2 (0 without inputs); the recording is exact, noise and disturbance come
    after it."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    m = int(rng.integers(1, 3)) if inputs else 0
    system = random_system(rng, n, p)
    B, D = rng.standard_normal((n, m)), rng.standard_normal((p, m))
    T = 60
    u = rng.standard_normal((T + steps, m))
    u[T:] = 1 + np.sign(u[T:])  # other inputs than recorded
    x, y = [rng.standard_normal(n)], []
    for k in range(T + steps):
        y.append(system.C @ x[-1] + D @ u[k] + system.r)
        w = disturbance * rng.standard_normal(n) if k >= T else 0.0
        x.append(system.A @ x[-1] + B @ u[k] + system.e + w)
    x, y = np.array(x), np.array(y)
    y[T:] += noise * rng.standard_normal((steps, p))
    history = ddmhe.History(x[: T + 1], y[:T], 0.1, u=u[:T] if m else None)
    return Forced(
        system.A, B, system.e, system.C, D, system.r, history, x[T:], y[T:], u[T:] if m else None
    )
