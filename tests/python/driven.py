"""Random systems with known inputs, for tests: nothing here shares code with the package."""

from dataclasses import dataclass

import numpy as np

import ddmhe
from reference import random_system


@dataclass(frozen=True)
class Driven:
    """x(t+1) = A x + B u + e + w, y = C x + D u + r + v."""

    A: np.ndarray
    B: np.ndarray
    e: np.ndarray
    C: np.ndarray
    D: np.ndarray
    r: np.ndarray

    def simulate(self, x_0, u, w=None, v=None):
        """States (steps+1, n) and outputs (steps, p) under u, w and v (steps, m or n or p)."""
        x = [np.asarray(x_0, float)]
        for k in range(len(u)):
            x.append(self.A @ x[-1] + self.B @ u[k] + self.e + (0.0 if w is None else w[k]))
        x = np.array(x)
        y = x[:-1] @ self.C.T + u @ self.D.T + self.r
        return x, y if v is None else y + v


def random_driven(rng, n, p, m):
    """An observable system with a direct feedthrough."""
    free = random_system(rng, n, p)
    B, D = rng.standard_normal((n, m)), rng.standard_normal((p, m))
    return Driven(free.A, B, free.e, free.C, D, free.r)


def spheres(rng, steps, dimension, size):
    """Vectors (steps, dimension) of Euclidean norm `size`."""
    vectors = rng.standard_normal((steps, dimension))
    return size * vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def recorded(system, rng, steps=100, x_noise=0.0, y_noise=0.0, w=0.0, x_0=None):
    """A recording under white inputs, with errors of the stated norms."""
    n, p, m = len(system.e), len(system.r), system.B.shape[1]
    u = rng.standard_normal((steps, m))
    x_0 = rng.standard_normal(n) if x_0 is None else x_0
    x, y = system.simulate(x_0, u, spheres(rng, steps, n, w))
    x = x + spheres(rng, steps + 1, n, x_noise)
    return ddmhe.History(x, y + spheres(rng, steps, p, y_noise), u=u)
