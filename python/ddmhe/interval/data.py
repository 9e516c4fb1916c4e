"""A guaranteed interval from a recording alone: every system that it allows, as rotated boxes of parameters.

The recording's rows obey x(k+1) = A x(k) + e + w(k), y(k) = C x(k) + r + v(k) with |w| <= w_radius, |v| <= v_radius.
For each row θ = (A_i, e_i) or (C_i, r_i) it leaves the polytope {θ : |target(k) - θ·(x(k), 1)| <= radius for all k}.
That is enclosed by a box along the principal axes of the recorded (x, 1), each side found by two linear programmes: a
matrix zonotope with n + 1 generators a row. The idea is that of A. Alanwar, A. Koch, F. Allgöwer, K. H. Johansson
("Data-driven reachability analysis from noisy data", 2023) and their set-based estimation, with the polytope's own
extents in the place of their n T generators. What the programmes return is widened by what their tolerance can move it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, ModelViolationError, RankError
from ddmhe.design.model import samples
from ddmhe.interval.observer import IntervalObserver
from ddmhe.interval.observer_design import ObserverDesign, fixed_gain, steady_gain
from ddmhe.interval.systems import System, radius_of

Array = NDArray[np.float64]

__all__ = ["DataModel", "from_history"]

TOLERANCE = 1e-7
"""What a linear programme may be off by, relative to the noise bound: HiGHS keeps its constraints to 1e-7."""


@dataclass(frozen=True, eq=False)
class DataModel:
    """Every system that a recording and its noise bounds allow, and a gain for it."""

    system: System
    """Middle of the rows, with what they may be off by inside."""
    design: ObserverDesign
    """A gain for the middle: steady Kalman filter with the radii as deviations. No peak-to-peak bound."""
    w_radius: Array
    """(n,)"""
    v_radius: Array
    """(p,)"""
    x_last: Array
    """Last recorded state (n,)."""
    spread: Array
    """Widest side of each row's parameter box, in units of the output per standard deviation of the states (n+p,)."""
    lower: Array
    """Smallest recorded state (n,)."""
    upper: Array
    """Largest recorded state (n,)."""

    @property
    def words(self) -> str:
        """What the intervals hold for."""
        w, v = (", ".join(f"{r:.3g}" for r in radius) for radius in (self.w_radius, self.v_radius))
        low, high = (", ".join(f"{x:.3g}" for x in side) for side in (self.lower, self.upper))
        return (
            "Guaranteed for every system x+ = A x + e + w, y = C x + r + v that the recording allows with "
            f"|w| <= ({w}) and |v| <= ({v}), then and now. The recorded states count as true, so their errors belong "
            "into w and v; so does whatever an affine system does not follow. "
            f"Recorded: from ({low}) to ({high}); outside of this range the guarantee holds only for a system that is "
            "affine there, too."
        )

    def observer(
        self, x0_center: ArrayLike | None = None, x0_radius: ArrayLike = 0.0, **options: Any
    ) -> IntervalObserver:
        """An observer that starts at x0_center ± x0_radius; default the last recorded state, exactly known.

        `options` are those of IntervalObserver: order, method, reduction.
        """
        center = self.x_last if x0_center is None else x0_center
        return IntervalObserver(self.system, self.design, center, x0_radius, self.w_radius, self.v_radius, **options)


def from_history(
    history: History, w_radius: ArrayLike, v_radius: ArrayLike, gain: ArrayLike | None = None
) -> DataModel:
    """All systems that agree with a recording, ready for an interval observer.

    Parameters
    ----------
    history : History
        At least n + 1 samples whose (x, 1) are independent.
    w_radius, v_radius : (n,), (p,) or scalars
        Bounds on |x(k+1) - A x(k) - e| and |y(k) - C x(k) - r| of the true system, in the recording and from then on.
    gain : (n, p), optional
        L; default that of a steady Kalman filter for the middle of the parameter boxes.

    Raises
    ------
    ModelViolationError
        No system agrees with the recording within these bounds: they are too small.
    RankError, ShapeError, DdmheError
        Too little data, wrong arguments.
    """
    if not isinstance(history, History):
        raise DdmheError(f"history: expected a History, found {type(history).__name__}")
    n, p = history.n, history.p
    w, v = radius_of("w_radius", w_radius, n), radius_of("v_radius", v_radius, p)
    X0, targets = samples(history)
    middle, half = X0.mean(axis=0), np.maximum(X0.std(axis=0), 1e-300)
    # (x, 1) in coordinates in which the regressors are orthonormal
    raw = np.hstack([X0, np.ones((len(X0), 1))])
    scaled = np.hstack([(X0 - middle) / half, np.ones((len(X0), 1))])
    U, s, Vt = scipy.linalg.svd(scaled, full_matrices=False)
    if len(s) < n + 1 or s[-1] <= 1e-12 * s[0]:
        raise RankError(
            f"history: expected {n + 1} independent rows (x, 1), found rank {int((s > 1e-12 * s[0]).sum())}"
        )
    # θ·(x, 1) = β·z with z = S⁻¹ V (scaled x, 1), so θ = T β
    to_scaled = np.zeros((n + 1, n + 1))
    to_scaled[:n, :n], to_scaled[:n, n] = np.diag(1 / half), -middle / half
    to_scaled[n, n] = 1.0
    T = to_scaled.T @ Vt.T / s  # columns: generators of θ
    rows, centers, spread = [], [], []
    for i, (target, radius) in enumerate(zip(targets.T, np.concatenate([w, v]), strict=True)):
        argument, row = ("w_radius", f"x{i + 1}") if i < n else ("v_radius", f"y{i - n + 1}")
        low, high = _extent(U, target, float(radius), row, argument)
        center = T @ (0.5 * (low + high))
        # the residual that the rounded center leaves joins the box: β off by at most its projection
        lost = np.abs(U.T @ (raw @ center - U @ (0.5 * (low + high)))).max()
        side = 0.5 * (high - low) + lost + 1e-12 * np.abs(0.5 * (low + high))
        rows.append([float(g) for g in (T * side).T.ravel()])
        centers.append(center)
        spread.append(float(side.max() / np.sqrt(len(X0)) * np.sqrt(n + 1)))
    theta = np.array(centers)
    A, e, C, r = theta[:n, :n], theta[:n, n], theta[n:, :n], theta[n:, n]
    reach = np.array([np.abs(np.reshape(row, (-1, n + 1)))[:, :n].sum(axis=0) for row in rows[:n]])
    bound = np.nextafter(reach, np.inf)
    kind = ("uncertain", rows, [float(value) for value in e])
    system = System(A, C, np.eye(n), np.eye(p), None, None, -bound, bound, r=r, kind=kind)
    design = fixed_gain(system, steady_gain(A, C, w, v) if gain is None else gain)
    x_last = history.recordings[-1][0][-1]
    return DataModel(system, design, w, v, x_last, np.array(spread), X0.min(axis=0), X0.max(axis=0))


def _extent(U: Array, target: Array, radius: float, name: str, argument: str) -> tuple[Array, Array]:
    """Ends of each β over {β : |target - U β| <= radius}, widened by the solver's tolerance."""
    scale = max(float(radius), 1e-12 * max(float(np.abs(target).max()), 1e-300))
    best = U.T @ target  # least squares: the programme in units of the radius about it
    residual = (target - U @ best) / scale
    limits = np.concatenate([residual + radius / scale, -residual + radius / scale]) + TOLERANCE
    rows = np.vstack([U, -U])
    low, high = np.empty(U.shape[1]), np.empty(U.shape[1])
    for j in range(U.shape[1]):
        for ends, sign in ((low, 1.0), (high, -1.0)):
            cost = np.zeros(U.shape[1])
            cost[j] = sign
            found = scipy.optimize.linprog(cost, rows, limits, bounds=(None, None), method="highs")
            if found.status == 2:
                raise ModelViolationError(
                    f"{argument}: expected a bound that an affine system satisfies on the recording, found {radius:g}; "
                    f"least squares misses row {name} by up to {np.abs(residual).max() * scale:.3g}"
                )
            if found.status != 0:
                raise DdmheError(f"history: expected a bounded set of systems, found that row {name}: {found.message}")
            # a point with constraints kept to TOLERANCE: the optimum may lie beyond by what the multipliers weigh them
            slack = TOLERANCE * (1.0 + float(np.abs(found.ineqlin.marginals).sum()))
            ends[j] = best[j] + scale * sign * (float(found.fun) - slack)  # type: ignore[arg-type]
    return low, high
