"""The observer as users meet it: arguments checked here, sets computed by the core."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, IntervalEstimate, IntervalLog, ObserverCore, ShapeError
from ddmhe.interval.observer_design import ObserverDesign
from ddmhe.interval.systems import System, matrix, radius_of

Array = NDArray[np.float64]

__all__ = ["IntervalObserver"]

ORDER, METHOD, REDUCTION = ObserverCore.defaults()


class IntervalObserver:
    """Bounds that hold the state for every motion that system and radii allow.

    Parameters
    ----------
    system : System
    design : ObserverDesign
        From `design_observer`, or `fixed_gain` (then without a peak-to-peak bound).
    x0_center, x0_radius : (n,)
        |x(0) - x0_center| <= x0_radius; a scalar radius serves every state.
    w_radius, v_radius : (n_w,), (n_v,)
        Bounds of |w|, |v|; a scalar serves all.
    order : int
        Generators kept, q >= n.
    method : "tight" or "paper"
        One interval matrix and a box contracted with the measurements, or (45)-(50) and (59) as
        printed.
    reduction : "pca", "girard" or "combastel"
        How "tight" reduces; "paper" has its own.

    Raises
    ------
    ShapeError, NotFiniteError, DdmheError
        Wrong arguments. `step` raises ModelViolationError where a measurement contradicts model and
        bounds, `run` ends there; the observer is then as before that sample.

    Examples
    --------
    >>> import ddmhe
    >>> system = ddmhe.interval.pendulum()
    >>> observer = ddmhe.interval.IntervalObserver(
    ...     system,
    ...     ddmhe.interval.design_observer(system),
    ...     x0_center=[0.98, 0.02],
    ...     x0_radius=[0.1, 1.0],
    ...     w_radius=0.006,
    ...     v_radius=0.01,
    ... )
    >>> bounds = observer.step([1.0])
    >>> bool((bounds.lower < bounds.upper).all())
    True
    """

    def __init__(
        self,
        system: System,
        design: ObserverDesign,
        x0_center: ArrayLike,
        x0_radius: ArrayLike,
        w_radius: ArrayLike,
        v_radius: ArrayLike,
        order: int = ORDER,
        method: str = METHOD,
        reduction: str = REDUCTION,
    ) -> None:
        """Check every argument and start at x(0)."""
        if not isinstance(system, System):
            raise DdmheError(
                f"system: expected a ddmhe.interval.System, found {type(system).__name__}"
            )
        if not isinstance(design, ObserverDesign):
            raise DdmheError(f"design: expected an ObserverDesign, found {type(design).__name__}")
        if design.gain.shape != (system.n, system.p):
            found = f"{design.gain.shape}"
            raise ShapeError(
                f"design: expected one for {system.n} states and {system.p} outputs, found a gain "
                f"{found}"
            )
        center = matrix("x0_center", x0_center, (system.n,))
        parts: dict[str, Any] = {
            k: getattr(system, k) for k in ("A", "C", "D1", "D2", "j_lo", "j_hi")
        }
        parts["B"] = np.zeros((system.n, 0)) if system.B is None else system.B
        parts["r"] = system.offset
        parts["w_radius"] = radius_of("w_radius", w_radius, system.D1.shape[1])
        parts["v_radius"] = radius_of("v_radius", v_radius, system.D2.shape[1])
        bound = design.gamma if design.verified else np.inf
        gain = {
            "L": design.gain,
            "P": design.P,
            "lam": design.lam,
            "gamma": bound,
            "weights": design.weights,
        }
        gain |= {"mu_w": design.mu_w, "mu_v": design.mu_v}
        start = radius_of("x0_radius", x0_radius, system.n)
        self.system, self.design, self.method = system, design, method
        self._given = (
            system,
            design,
            center,
            start,
            parts["w_radius"],
            parts["v_radius"],
            order,
            method,
            reduction,
        )
        self._core = ObserverCore(
            system.dynamics, parts, gain, center.tolist(), start.tolist(), order, method, reduction
        )

    def __getstate__(self) -> tuple[tuple[Any, ...], bytes]:
        """The arguments, and where the observer stands."""
        return self._given, self._core.present()

    def __setstate__(self, state: tuple[tuple[Any, ...], bytes]) -> None:
        """As it stood."""
        given, present = state
        IntervalObserver.__init__(self, *given)
        self._core.resume(present)

    def step(self, y: ArrayLike, u: ArrayLike | None = None) -> IntervalEstimate:
        """Consume y(k) (p,), NaN = not measured, and u(k) (n_u,): bounds of x(k) that use y(k), and
        of x(k+1)."""
        return self._core.step(y, self._input(u))

    def run(self, Y: ArrayLike, U: ArrayLike | None = None) -> IntervalLog:
        """Consume Y (N, p) and U (N, n_u): the same numbers as N calls of `step`.

        A sample that contradicts model and bounds ends the run: the log then has a row for each
        sample before it, and its `violation` is the ModelViolationError that `step` raises there
        (None: the run came to its end)."""
        return self._core.run(Y, self._input(U))

    def reset(self) -> None:
        """Back to the first sample."""
        self._core.reset()

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(lo, hi) of the state that the next output belongs to, (n,) each."""
        return self._core.predicted()

    def _input(self, u: ArrayLike | None) -> ArrayLike | None:
        B = self.system.B
        if B is None and u is not None:
            raise ShapeError("u: expected None, for the system has no input, found an array")
        if B is not None and u is None:
            raise ShapeError(f"u: expected {B.shape[1]} numbers, found None")
        return u
