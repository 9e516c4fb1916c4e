"""What every model does: it is simulated, and what an experiment would have recorded comes out."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError
from ddmhe.checks import check_number, check_whole, choice
from ddmhe.models.integrators import INTEGRATORS
from ddmhe.models.parameters import shaped
from ddmhe.models.recording import Recording
from ddmhe.tol import WHOLE_STEPS

Array = NDArray[np.float64]

__all__ = ["Model"]

MOST_STEPS = 100_000_000
"""Simulated steps that may fit into memory."""


class Model:
    """A system dx/dt = derivative(x), y = output(x), started at `initial_state`."""

    x_units: ClassVar[tuple[str, ...]] = ()
    """Units of the states (n)."""
    y_units: ClassVar[tuple[str, ...]] = ()
    """Units of the outputs (p)."""

    @property
    def initial_state(self) -> Array:
        """State at t = 0 (n,)."""
        raise NotImplementedError

    def derivative(self, x: ArrayLike) -> Array:
        """dx/dt at x: (…, n) to (…, n)."""
        raise NotImplementedError

    def output(self, x: ArrayLike) -> Array:
        """y at x without noise: (…, n) to (…, p)."""
        raise NotImplementedError

    def _as_recorded(self, x: Array, dt: float) -> Array:
        """The states (N+1, n) as a sensor reads them."""
        return x.copy()

    def simulate(
        self,
        duration: float,
        dt: float,
        noise: float = 0.0,
        seed: int = 0,
        integrator: str = "euler",
        *,
        disturbance: ArrayLike | None = None,
    ) -> Recording:
        """Simulate N = duration/dt steps from the initial state.

        Parameters
        ----------
        duration : float
            Simulated time, s; a multiple of dt.
        dt : float
            Sampling interval, s.
        noise : float
            Standard deviation of the white Gaussian noise on every output, in the output's unit.
        seed : int
            Seed of numpy's default_rng.
        integrator : "euler" or "accurate"
            Forward Euler with step dt, as in Liu et al. 2026, Eq. (4), or an eighth-order
            Runge-Kutta method (DOP853) at relative tolerance 2.3e-14, the smallest that it takes.
        disturbance : array (N, n)
            Process disturbance w of (5), in the state's unit: w(k) is added to the state at the end
            of step k.

        Raises
        ------
        DdmheError
            duration not a multiple of dt, dt or duration not positive, noise negative, an unknown
            integrator, or a motion that leaves all bounds (Euler with too large a dt).
        """
        steps = _steps(duration, dt)
        check_number("noise", noise, "a finite number of at least 0", lambda size: size >= 0)
        check_whole("seed", seed, 0)
        choice("integrator", integrator, INTEGRATORS)
        t: Array = dt * np.arange(steps + 1, dtype=np.float64)
        w = (
            None
            if disturbance is None
            else shaped("disturbance", disturbance, (steps, self.initial_state.size))
        )
        x = INTEGRATORS[integrator](self.derivative, self.initial_state, t, dt, w)
        if not np.isfinite(x).all():
            raise DdmheError(
                f"dt: expected one small enough, found that the {integrator!r} motion diverges at "
                f"{dt} s"
            )
        y = self.output(x)
        y += noise * np.random.default_rng(seed).standard_normal(y.shape)
        return Recording(t, x, y, self._as_recorded(x, dt), self.x_units, self.y_units)


def _steps(duration: float, dt: float) -> int:
    """N = duration/dt; DdmheError unless it is a whole number of at least 1 that fits."""
    for name, value in (("dt", dt), ("duration", duration)):
        check_number(name, value, "a positive number of seconds", lambda seconds: seconds > 0)
    if not duration / dt <= MOST_STEPS:
        raise DdmheError(
            f"duration: expected at most {MOST_STEPS} steps of dt = {dt} s, found {duration} s"
        )
    steps = round(duration / dt)
    if abs(steps * dt - duration) > WHOLE_STEPS * duration:
        raise DdmheError(f"duration: expected a multiple of dt = {dt} s, found {duration} s")
    return steps
