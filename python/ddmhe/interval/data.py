"""A guaranteed interval from a recording alone: every system that it allows, as rotated boxes of
parameters.

The recording's rows obey x(k+1) = A x(k) + e + w(k), y(k) = C x(k) + r + v(k) with |w| <= w_radius,
|v| <= v_radius. For each row θ = (A_i, e_i) or (C_i, r_i) it leaves the polytope {θ : |target(k) -
θ·(x(k), 1)| <= radius for all k}. That is enclosed by a box along the principal axes of the
recorded (x, 1), each side found by two linear programmes: a matrix zonotope with n + 1 generators a
row. The idea is that of A. Alanwar, A. Koch, F. Allgöwer, K. H. Johansson ("Data-driven
reachability analysis from noisy data", 2023) and their set-based estimation, with the polytope's
own extents in the place of their n T generators. What the programmes return is widened by what
their tolerance can move it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, Dynamics, History, ModelViolationError, RankError, ShapeError
from ddmhe.checks import shown, word
from ddmhe.design.arguments import check_number
from ddmhe.design.model import samples
from ddmhe.interval.observer import IntervalObserver
from ddmhe.interval.observer_design import ObserverDesign, fixed_gain, steady_gain
from ddmhe.interval.systems import System, radius_of

Array = NDArray[np.float64]

__all__ = ["DataModel", "from_history", "smallest_radii"]

TOLERANCE = 1e-7
"""What a linear programme may be off by, relative to the noise bound: HiGHS keeps its constraints
to 1e-7."""
LARGEST = 1e150
"""Recorded numbers beyond it have no deviation within floats."""


@dataclass(frozen=True, eq=False)
class DataModel:
    """Every system that a recording and its noise bounds allow, and a gain for it.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = 0.9 ** np.arange(31.0)[:, None]
    >>> history = ddmhe.History(x, x[:30], 0.1)
    >>> model = ddmhe.interval.from_history(history, w_radius=1e-3, v_radius=1e-3)
    >>> bool((model.x_last == x[-1]).all()), model.w_least.shape
    (True, (1,))
    """

    system: System
    """Middle of the rows, with what they may be off by inside."""
    design: ObserverDesign
    """A gain for the middle: steady Kalman filter with the radii as deviations. No peak-to-peak
    bound."""
    w_radius: Array
    """(n,)"""
    v_radius: Array
    """(p,)"""
    x_last: Array
    """Last recorded state (n,)."""
    spread: Array
    """Widest side of each row's parameter box, in units of the output per standard deviation of the
    states (n+p,)."""
    lower: Array
    """Smallest recorded state (n,)."""
    upper: Array
    """Largest recorded state (n,)."""
    w_least: Array
    """(n,): the smallest w_radius that an affine system satisfies on the recording, entry by
    entry."""
    v_least: Array
    """(p,): likewise v_radius."""

    @property
    def words(self) -> str:
        """What the intervals hold for."""
        w, v, least_w, least_v = (
            ", ".join(f"{r:.3g}" for r in radius)
            for radius in (self.w_radius, self.v_radius, self.w_least, self.v_least)
        )
        low, high = (", ".join(f"{x:.3g}" for x in side) for side in (self.lower, self.upper))
        return (
            "Guaranteed for every system x+ = A x + e + w, y = C x + r + v that the recording "
            "allows with "
            f"|w| <= ({w}) and |v| <= ({v}), then and now. The recorded states count as true, so "
            "their errors belong "
            "into w and v; so does whatever an affine system does not follow. No affine system "
            "satisfies less than "
            f"|w| <= ({least_w}), |v| <= ({least_v}) on the recording. "
            f"Recorded: from ({low}) to ({high}); outside of this range the guarantee holds only "
            "for a system that is "
            "affine there, too."
        )

    def observer(
        self, x0_center: ArrayLike | None = None, x0_radius: ArrayLike = 0.0, **options: Any
    ) -> IntervalObserver:
        """An observer that starts at x0_center ± x0_radius; default the last recorded state,
        exactly known.

        `options` are those of IntervalObserver: order, method, reduction.
        """
        center = self.x_last if x0_center is None else x0_center
        return IntervalObserver(
            self.system, self.design, center, x0_radius, self.w_radius, self.v_radius, **options
        )


def smallest_radii(history: History) -> tuple[Array, Array]:
    """The smallest w_radius (n,) and v_radius (p,) that an affine system satisfies on a recording,
    entry by entry.

    Of row i it is the Chebyshev fit min_θ max_k |target_i(k) - θ·(x(k), 1)|: each its own linear
    programme, so no entry can be traded for another. It is below the true system's bound, which the
    recording need not reach: take more, for instance 1.1 times as much.

    Raises
    ------
    RankError, DdmheError
        Too little data, or no History.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = 0.9 ** np.arange(31.0)[:, None]
    >>> w, v = ddmhe.interval.smallest_radii(ddmhe.History(x, x[:30], 0.1))
    >>> bool(w.max() < 1e-9)  # nothing disturbed it
    True
    """
    U, _, _, targets = _orthonormal(history)
    least = np.array([_chebyshev(U, target) for target in targets.T])
    return least[: history.n], least[history.n :]


def from_history(
    history: History,
    w_radius: ArrayLike | Literal["auto"] = "auto",
    v_radius: ArrayLike | Literal["auto"] = "auto",
    gain: ArrayLike | None = None,
    *,
    kappa: float = 1.1,
    names: tuple[Sequence[str], Sequence[str]] | None = None,
) -> DataModel:
    """All systems that agree with a recording, ready for an interval observer.

    Parameters
    ----------
    history : History
        At least n + 1 samples whose (x, 1) are independent.
    w_radius, v_radius : (n,), (p,), scalars or "auto"
        Bounds on |x(k+1) - A x(k) - e| and |y(k) - C x(k) - r| of the true system, in the recording
        and from then on. "auto": `kappa` times the `smallest_radii`, a guess that the recording
        cannot confirm.
    gain : (n, p), optional
        L; default that of a steady Kalman filter for the middle of the parameter boxes.
    kappa : float
        At least 1.
    names : (n states, p outputs), optional
        What messages call them; default x1, x2, …, y1, ….

    Raises
    ------
    ModelViolationError
        No system agrees with the recording within these bounds: they are too small. The message has
        the smallest.
    RankError, ShapeError, DdmheError
        Too little data, wrong arguments.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> rng = np.random.default_rng(0)
    >>> x = np.ones((101, 1))
    >>> for k in range(100):
    ...     x[k + 1] = 0.9 * x[k] + rng.uniform(-0.1, 0.1)
    >>> y = x[:100] + rng.uniform(-0.01, 0.01, (100, 1))
    >>> model = ddmhe.interval.from_history(ddmhe.History(x, y, 0.1), w_radius=0.11, v_radius=0.011)
    >>> bounds = model.observer().step(x[100])  # from the recording's last state on
    >>> bool((bounds.lower < 0.9 * x[100]).all() and (0.9 * x[100] < bounds.upper).all())
    True
    """
    U, to_theta, raw, targets = _orthonormal(history)
    n, p = history.n, history.p
    check_number("kappa", kappa, "a number of at least 1", lambda v: 1 <= v < np.inf)
    X0 = raw[:, :n]
    called = (
        ([f"x{i + 1}" for i in range(n)], [f"y{i + 1}" for i in range(p)])
        if names is None
        else names
    )
    least = smallest_radii(history)
    arguments = (("w_radius", w_radius), ("v_radius", v_radius))
    w, v = (
        _admitted(name, value, low, kappa, of)
        for (name, value), low, of in zip(arguments, least, called, strict=True)
    )
    rows, centers, spread = [], [], []
    for i, (target, radius) in enumerate(zip(targets.T, np.concatenate([w, v]), strict=True)):
        argument, row = ("w_radius", called[0][i]) if i < n else ("v_radius", called[1][i - n])
        low, high = _extent(U, target, float(radius), row, argument)
        with np.errstate(over="ignore", invalid="ignore"):
            center = to_theta @ (0.5 * (low + high))
            # the residual that the rounded center leaves joins the box: β off by at most its
            # projection
            lost = np.abs(U.T @ (raw @ center - U @ (0.5 * (low + high)))).max()
            side = 0.5 * (high - low) + lost + 1e-12 * np.abs(0.5 * (low + high))
            box = (to_theta * side).T.ravel()
        if not np.isfinite([*center, *box]).all():
            raise DdmheError(
                f"history: expected parameters within floats, found some beyond in row {row}; use "
                "other units"
            )
        rows.append([float(g) for g in box])
        centers.append(center)
        spread.append(float(side.max() / np.sqrt(len(X0)) * np.sqrt(n + 1)))
    theta = np.array(centers)
    A, e, C, r = theta[:n, :n], theta[:n, n], theta[n:, :n], theta[n:, n]
    reach = np.array([np.abs(np.reshape(row, (-1, n + 1)))[:, :n].sum(axis=0) for row in rows[:n]])
    bound = np.nextafter(reach, np.inf)
    f = Dynamics.uncertain(rows, [float(value) for value in e])
    system = System(A, C, np.eye(n), np.eye(p), None, None, -bound, bound, r=r, dynamics=f)
    design = fixed_gain(system, steady_gain(A, C, w, v) if gain is None else gain)
    x_last = history.recordings[-1][0][-1]
    return DataModel(
        system, design, w, v, x_last, np.array(spread), X0.min(axis=0), X0.max(axis=0), *least
    )


def _orthonormal(history: History) -> tuple[Array, Array, Array, Array]:
    """U (T, n+1) with orthonormal columns that span (x, 1), the T with θ = T β for θ·(x, 1) = β·U,
    (x, 1), targets."""
    if not isinstance(history, History):
        raise DdmheError(f"history: expected a History, found {type(history).__name__}")
    if history.m:
        raise DdmheError(
            f"history: expected a recording without inputs, found m = {history.m}; give a System "
            "with B, or history.without_inputs() where they did not act"
        )
    n = history.n
    X0, targets = samples(history)
    largest = max(float(np.abs(X0).max()), float(np.abs(targets).max()))
    if largest > LARGEST:
        raise DdmheError(
            f"history: expected numbers below {LARGEST:g}, found {largest:g}; use another unit"
        )
    raw = np.hstack([X0, np.ones((len(X0), 1))])
    middle, half = X0.mean(axis=0), np.maximum(X0.std(axis=0), 1e-300)
    U, s, Vt = scipy.linalg.svd(np.hstack([(X0 - middle) / half, raw[:, n:]]), full_matrices=False)
    if len(s) < n + 1 or s[-1] <= 1e-12 * s[0]:
        raise RankError(
            f"history: expected {n + 1} independent rows (x, 1), found rank "
            f"{int((s > 1e-12 * s[0]).sum())}"
        )
    # θ·(x, 1) = β·z with z = S⁻¹ V (scaled x, 1), so θ = T β
    to_scaled = np.zeros((n + 1, n + 1))
    to_scaled[:n, :n], to_scaled[:n, n] = np.diag(1 / half), -middle / half
    to_scaled[n, n] = 1.0
    return U, to_scaled.T @ Vt.T / s, raw, targets


def _chebyshev(U: Array, target: Array) -> float:
    """min_β max |target - U β|, as what the β that was found leaves: never below the minimum."""
    best = U.T @ target
    residual = target - U @ best
    scale = float(np.abs(residual).max())
    if scale <= 1e-13 * float(np.abs(target).max()):
        return scale  # an exact fit to rounding
    # variables (β, t) in units of what least squares leaves
    m = U.shape[1]
    ones = np.ones((len(U), 1))
    rows = np.block([[U, -ones], [-U, -ones]])
    cost = np.append(np.zeros(m), 1.0)
    found = _programme(
        cost, rows, np.concatenate([residual, -residual]) / scale, [(None, None)] * m + [(0, 1)]
    )
    return (
        scale * min(1.0, float(np.abs(residual / scale - U @ found.x[:m]).max()))
        if found.status == 0
        else scale
    )


def _programme(cost: Array, rows: Array, limits: Array, bounds: Any) -> Any:
    """One linear programme; what SciPy raises is an error of this package."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return scipy.optimize.linprog(cost, rows, limits, bounds=bounds, method="highs")
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as e:
        raise DdmheError(
            f"history: expected numbers that a linear programme can take, found: {e}"
        ) from e


def _admitted(argument: str, value: Any, least: Array, kappa: float, names: Sequence[str]) -> Array:
    """The radii that were asked for, at least the smallest admissible ones."""
    if len(names) != len(least):
        raise ShapeError(f"names: expected {len(least)} for {argument}, found {len(names)}")
    if isinstance(value, str):
        if value != "auto":
            raise DdmheError(f'{argument}: expected "auto" or radii, found {shown(value)}')
        return np.nextafter(kappa * least, np.inf)
    radius = radius_of(argument, value, len(least))
    # the same smallest radii come out to 1e-7: what the linear programme is solved to
    if (radius < (1 - TOLERANCE) * least).any():
        smallest = ", ".join(
            f"{_rounded_up(r)} for {word(name)}" for r, name in zip(least, names, strict=True)
        )
        raise ModelViolationError(
            f"{argument}: expected a bound that an affine system satisfies on the recording, at "
            f"least {smallest}, "
            f"found {', '.join(f'{r:g}' for r in np.unique(radius))}"
        )
    return radius


def _rounded_up(value: float) -> str:
    """Four digits that are not below the value."""
    text = f"{value:.4g}"
    return (
        text
        if float(text) >= value
        else f"{value + 0.6 * 10.0 ** (np.floor(np.log10(value)) - 3):.4g}"
    )


def _extent(
    U: Array, target: Array, radius: float, name: str, argument: str
) -> tuple[Array, Array]:
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
            found = _programme(cost, rows, limits, (None, None))
            if found.status == 2:
                raise ModelViolationError(
                    f"{argument}: expected a bound that an affine system satisfies on the "
                    f"recording, found {radius:g}; "
                    f"least squares misses row {word(name)} by up to "
                    f"{np.abs(residual).max() * scale:.3g}"
                )
            if found.status != 0:
                raise DdmheError(
                    f"history: expected a bounded set of systems, found that row {word(name)}: "
                    f"{found.message}"
                )
            # a point with constraints kept to TOLERANCE: the optimum may lie beyond by what the
            # multipliers weigh them
            slack = TOLERANCE * (1.0 + float(np.abs(found.ineqlin.marginals).sum()))
            ends[j] = best[j] + scale * sign * (float(found.fun) - slack)
    return low, high
