"""The measurement update of a Kalman filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["updated"]


def updated(x: Array, P: Array, H: Array, v: Array, R: Array) -> tuple[Array, Array]:
    """The state (n,) and its covariance (n, n) with outputs taken in, in Joseph's form.

    H : (q, n), their derivative; v : (q,), by how much they differ from what is expected; R : (q,
    q), the covariance of their noise"""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(len(x)) - K @ H
    return x + K @ v, left @ P @ left.T + K @ R @ K.T
