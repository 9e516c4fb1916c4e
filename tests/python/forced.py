"""Random linear systems with inputs, offsets and feed-through, their recordings and logs."""

from dataclasses import dataclass

import numpy as np

import ddmhe
from driven import Driven, random_driven


@dataclass(frozen=True)
class Forced(Driven):
    """A system, a recording of it and what follows."""

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
    system = random_driven(rng, n, p, m)
    T = 60
    u = rng.standard_normal((T + steps, m))
    u[T:] = 1 + np.sign(u[T:])  # other inputs than recorded
    x_0, w = rng.standard_normal(n), np.zeros((T + steps, n))
    w[T:] = disturbance * rng.standard_normal((steps, n))
    x, y = system.simulate(x_0, u, w)
    y[T:] += noise * rng.standard_normal((steps, p))
    history = ddmhe.History(x[: T + 1], y[:T], 0.1, u=u[:T] if m else None)
    return Forced(**vars(system), history=history, x=x[T:], Y=y[T:], U=u[T:] if m else None)
