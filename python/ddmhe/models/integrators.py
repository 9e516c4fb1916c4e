"""From a derivative to a motion: forward Euler as the papers step, and an accurate solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddmhe.tol import INTEGRATION_ABSOLUTE, INTEGRATION_RELATIVE

Array = NDArray[np.float64]

__all__ = ["INTEGRATORS", "Derivative"]

Derivative = Callable[[Array], Array]
"""dx/dt (n,) at the state x (n,)."""


def _euler(derivative: Derivative, x_0: Array, t: Array, dt: float, w: Array | None) -> Array:
    """Forward Euler x(k+1) = x(k) + dt f(x(k)), Liu et al. 2026, Eq. (4)."""
    x = np.empty((t.size, x_0.size))
    x[0] = x_0
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(t.size - 1):
            x[k + 1] = x[k] + dt * derivative(x[k]) + (0.0 if w is None else w[k])
    return x


def _accurate(derivative: Derivative, x_0: Array, t: Array, dt: float, w: Array | None) -> Array:
    """An eighth-order Runge-Kutta method near rounding; NaN from where it gives up."""
    from scipy.integrate import solve_ivp

    def motion(start: Array, times: Array) -> Array:
        found = solve_ivp(
            lambda _, x: derivative(x),
            (0.0, times[-1]),
            start,
            "DOP853",
            t_eval=times,
            rtol=INTEGRATION_RELATIVE,
            atol=INTEGRATION_ABSOLUTE,
        ).y.T
        lacking = np.full((len(times) - len(found), len(start)), np.nan)
        return np.asarray(np.vstack([found, lacking]))

    if w is None:
        return motion(x_0, t)
    x = np.vstack([x_0, np.empty_like(w)])
    for k in range(len(w)):
        x[k + 1] = motion(x[k], np.array([0.0, dt]))[-1] + w[k]
    return x


INTEGRATORS = {"euler": _euler, "accurate": _accurate}
"""Motions (N+1, n) at the times t = 0, dt, … by name, with w (N, n) added to the state at the end
of each step."""
