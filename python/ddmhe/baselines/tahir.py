"""A mixed-monotone interval observer: a **reconstruction** of the kind of A. M. Tahir and B.
Açıkmeşe (2021).

Their text was not at hand: what stands here is what the words mixed-monotone bounds, gain by a
semidefinite programme, with and without a change of coordinates allow. In coordinates z = T x the
closed map g(z) = (A - L C) z + f(z) + L y is bounded above and below by its mixed-monotone
decomposition: each entry of Dg that keeps its sign takes the end of the box that it points to, one
that changes sign takes an end and a slack of its smaller side times the width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, InfeasibleError, ModelViolationError
from ddmhe.baselines.tol import LEAST_MU, LEAST_RATIO, NONZERO, ROUNDING
from ddmhe.checks import channels
from ddmhe.design.solver import solve
from ddmhe.interval.observer_design import design_observer
from ddmhe.interval.systems import System, matrix, radius_of

Array = NDArray[np.float64]

__all__ = ["TahirIntervalObserver"]


@dataclass(frozen=True, eq=False)
class IntervalStep:
    """Bounds of one state."""

    lower: Array
    """(n,)"""
    upper: Array
    """(n,)"""

    @property
    def x(self) -> Array:
        """Their middle."""
        return 0.5 * (self.lower + self.upper)


class TahirIntervalObserver:
    """Mixed-monotone interval observer (reconstruction, see the module).

    Parameters
    ----------
    system : System
        With finite j_lo and j_hi and a function f, or none.
    x0_center, x0_radius, w_radius, v_radius
        As for `ddmhe.interval.IntervalObserver`.
    transform : bool
        Whether T are the real eigenvectors of the closed loop of the peak-to-peak design, or the
        identity.
    lam : float, optional
        λ of the programme; None tries several.

    Raises
    ------
    InfeasibleError
        No gain was found whose widths stay bounded, ρ(|A - L C| + F) < 1 in z.

    Examples
    --------
    >>> import ddmhe
    >>> observer = ddmhe.baselines.TahirIntervalObserver(
    ...     ddmhe.interval.pendulum(), [0.98, 0.02], [0.1, 1.0], w_radius=0.006, v_radius=0.01
    ... )
    >>> bounds = observer.step([1.0])
    >>> bool((bounds.lower < bounds.upper).all())
    True
    """

    def __init__(
        self,
        system: System,
        x0_center: ArrayLike,
        x0_radius: ArrayLike,
        w_radius: ArrayLike,
        v_radius: ArrayLike,
        transform: bool = True,
        lam: float | None = None,
    ) -> None:
        """Find the gain and start at x(0)."""
        if not isinstance(system, System):
            raise DdmheError(
                f"system: expected a ddmhe.interval.System, found {type(system).__name__}"
            )
        if not system.dynamics.exact:
            raise DdmheError(
                "system: expected one whose f is known exactly, found parameters within bounds"
            )
        self.system = system
        self._w = radius_of("w_radius", w_radius, system.D1.shape[1])
        self._v = radius_of("v_radius", v_radius, system.D2.shape[1])
        center, radius = (
            matrix("x0_center", x0_center, (system.n,)),
            radius_of("x0_radius", x0_radius, system.n),
        )
        self._start = center - radius, center + radius
        self.T = self._coordinates() if transform else np.eye(system.n)
        self._T_inv: Array = np.asarray(np.linalg.inv(self.T), dtype=np.float64)
        self.gain = self._designed(
            [0.02, 0.05, 0.1, 0.2, 0.3, 0.5] if lam is None else [float(lam)]
        )
        self.reset()

    def reset(self) -> None:
        """Back to the first sample."""
        self._x = self._start
        self._z = _mapped(self.T, *self._start)

    def step(self, y: ArrayLike) -> IntervalStep:
        """Consume y(k) (p,): bounds of x(k+1). ModelViolationError where they cross."""
        s = self.system
        y = matrix("y", y, (s.p,))
        low, high = self._z
        J_lo, J_hi = (
            (s.j_lo, s.j_hi)
            if s.jacobian is None
            else (matrix("jacobian", J, (s.n, s.n)) for J in s.jacobian(*self._x))
        )
        D_lo, D_hi = self._closed(np.maximum(J_lo, s.j_lo), np.minimum(J_hi, s.j_hi))
        noise = np.abs(self.T @ s.D1) @ self._w + np.abs(self.T @ self.gain @ s.D2) @ self._v
        constant = self.T @ self.gain @ (y - s.offset)
        new_low, new_high = np.empty(s.n), np.empty(s.n)
        for i in range(s.n):
            rising = D_hi[i] >= -D_lo[i]  # by its larger side
            slack = np.where(rising, np.maximum(-D_lo[i], 0), np.maximum(D_hi[i], 0)) @ (high - low)
            top, bottom = np.where(rising, high, low), np.where(rising, low, high)
            new_high[i] = self._map(top)[i] + slack + noise[i] + constant[i]
            new_low[i] = self._map(bottom)[i] - slack - noise[i] + constant[i]
        pad = ROUNDING * (np.abs(new_low) + np.abs(new_high) + NONZERO)
        z = np.asarray(new_low - pad), np.asarray(new_high + pad)
        x = _mapped(self._T_inv, *z)
        if (x[0] > x[1]).any():
            raise ModelViolationError(
                "y: expected a sample that model and bounds allow, found one that leaves no state"
            )
        self._z, self._x = z, x
        return IntervalStep(*x)

    def run(self, Y: ArrayLike) -> IntervalStep:
        """Consume Y (N, p): bounds (N, n)."""
        steps = [self.step(y) for y in matrix("Y", channels(Y, self.system.p), (-1, self.system.p))]
        shape = (len(steps), self.system.n)
        return IntervalStep(
            np.array([s.lower for s in steps]).reshape(shape),
            np.array([s.upper for s in steps]).reshape(shape),
        )

    def _map(self, z: Array) -> Array:
        """T((A - L C) x + f(x)), x = T⁻¹ z."""
        s, x = self.system, self._T_inv @ z
        f = np.zeros(s.n) if s.f is None else np.asarray(s.f(x))
        return np.asarray(self.T @ ((s.A - self.gain @ s.C) @ x + f))

    def _closed(self, J_lo: Array, J_hi: Array) -> tuple[Array, Array]:
        """Bounds of T(A - L C + J)T⁻¹."""
        middle = (
            self.T @ (self.system.A - self.gain @ self.system.C + 0.5 * (J_lo + J_hi)) @ self._T_inv
        )
        radius = np.abs(self.T) @ (0.5 * (J_hi - J_lo)) @ np.abs(self._T_inv)
        return middle - radius, middle + radius

    def _coordinates(self) -> Array:
        """Real eigenvectors of the closed loop of the peak-to-peak design, each of length one."""
        s = self.system
        closed = s.A + 0.5 * (s.j_lo + s.j_hi) - design_observer(s).gain @ s.C
        values, vectors = scipy.linalg.eig(closed)
        _, real = scipy.linalg.cdf2rdf(values, vectors)
        if np.linalg.cond(real) > 1e6:
            return np.eye(s.n)
        return np.asarray(np.linalg.inv(real / np.linalg.norm(real, axis=0)))

    def _designed(self, lams: list[float]) -> Array:
        """L that minimises the peak-to-peak gain of the width's comparison system, over diagonal P
        and the λ given."""
        import cvxpy as cp

        s = self.system
        A = self.T @ s.A @ self._T_inv
        middle = self.T @ (0.5 * (s.j_lo + s.j_hi)) @ self._T_inv
        radius = np.abs(self.T) @ (0.5 * (s.j_hi - s.j_lo)) @ np.abs(self._T_inv)
        C, D1 = s.C @ self._T_inv, self.T @ s.D1 * self._w
        best: tuple[float, Array] | None = None
        least = np.inf
        for lam in lams:
            d, W = cp.Variable(s.n), cp.Variable((s.n, s.p))
            X, V = cp.Variable((s.n, s.n)), cp.Variable((s.n, len(self._v)))
            gamma, mu = cp.Variable(), cp.Variable()
            P = cp.diag(d)
            inner = P @ (A + middle) - W @ C
            noise = W @ (s.D2 * self._v)
            D = P @ np.abs(D1)
            n_w, n_v = D1.shape[1], len(self._v)
            zero = np.zeros
            block = cp.bmat(
                [
                    [(1 - lam) * P, zero((s.n, n_w)), zero((s.n, n_v)), X.T],
                    [zero((n_w, s.n)), gamma * np.eye(n_w), zero((n_w, n_v)), D.T],
                    [zero((n_v, s.n)), zero((n_v, n_w)), gamma * np.eye(n_v), V.T],
                    [X, D, V, P],
                ]
            )
            constraints: list[Any] = [
                X - inner >= P @ radius,
                X + inner >= P @ radius,
                V - noise >= 0,
                V + noise >= 0,
            ]
            constraints += [block >> 0, lam * d >= mu, d <= 1]
            # the width's peak grows with γ/μ: normalise P below one, and weigh γ against μ
            problem = cp.Problem(cp.Minimize(gamma - mu), [*constraints, mu >= LEAST_MU])
            if not solve(problem) or d.value is None or W.value is None or not gamma.value > 0:
                continue
            gain = np.asarray(self._T_inv @ (W.value / d.value[:, None]))
            # the programme's word is good to a tolerance only, and d may be as small
            rho = self._growth(gain)
            least = min(least, rho)
            ratio = float(gamma.value / max(float(mu.value), LEAST_RATIO))
            if rho < 1 and (best is None or ratio < best[0]):
                best = ratio, gain
        if best is None:
            found = "none" if least == np.inf else f"rho(|A - L C| + F) = {least:.4f} at best"
            raise InfeasibleError(
                "transform, lam: expected a gain that keeps the widths bounded, rho(|A - L C| + F) "
                f"< 1 in these coordinates, found {found} among those tried"
            )
        return best[1]

    def _growth(self, gain: Array) -> float:
        """Spectral radius of |A - L C| + F in z, which takes widths to the next ones: below 1 they
        stay bounded.

        An entry of Dg within [c - r, c + r] adds r to |c|, and where it changes sign twice its
        slack, 2(r - |c|)."""
        s = self.system
        middle = np.abs(self.T @ (s.A - gain @ s.C + 0.5 * (s.j_lo + s.j_hi)) @ self._T_inv)
        radius = np.abs(self.T) @ (0.5 * (s.j_hi - s.j_lo)) @ np.abs(self._T_inv)
        comparison = middle + radius + 2 * np.maximum(radius - middle, 0)
        return (
            float(np.abs(np.linalg.eigvals(comparison)).max())
            if np.isfinite(comparison).all()
            else np.inf
        )


def _mapped(M: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds of M x over low <= x <= high."""
    positive, negative = np.maximum(M, 0), np.minimum(M, 0)
    return positive @ low + negative @ high, positive @ high + negative @ low
