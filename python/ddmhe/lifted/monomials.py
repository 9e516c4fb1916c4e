"""φ(x): products of powers of the scaled states up to a degree, and their derivatives."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["Monomials", "count"]


def count(n: int, degree: int) -> int:
    """Number K of monomials in n variables up to the degree."""
    return math.comb(n + degree, degree)


class Monomials:
    """All monomials of z = (x - mean)/scale up to a degree: 1, z_1 … z_n, z_1², z_1 z_2, …"""

    def __init__(self, mean: Array, scale: Array, degree: int) -> None:
        """mean, scale: (n,)."""
        self.mean, self.scale, self.degree = mean, scale, degree
        n = len(mean)
        powers = np.array(
            [
                e
                for total in range(degree + 1)
                for e in itertools.product(range(total + 1), repeat=n)
                if sum(e) == total
            ]
        )
        self.orders: NDArray[np.int64] = powers.sum(axis=1)
        """Total degree (K,) of each monomial."""
        self._powers = powers  # K × n
        # ∂/∂x_i of z^e is e_i z^(e - 1_i)/scale_i
        self._lowered = np.maximum(powers[None] - np.eye(n, dtype=int)[:, None], 0)  # n × K × n
        self._factors = powers.T / scale[:, None]  # n × K

    def __call__(self, x: Array) -> Array:
        """φ at points (…, n): (…, K)."""
        z = (x - self.mean) / self.scale
        return np.asarray(np.prod(z[..., None, :] ** self._powers, axis=-1))

    def jacobian(self, x: Array) -> Array:
        """∂φ/∂x (K, n) at one point (n,)."""
        z = (x - self.mean) / self.scale
        return np.asarray((self._factors * np.prod(z**self._lowered, axis=-1)).T)
