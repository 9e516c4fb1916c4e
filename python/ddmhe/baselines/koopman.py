"""Dd-KMHE: moving horizon estimation on a lifted linear model (EDMD with thin-plate splines), after
Surana 2020."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import History
from ddmhe.baselines.base import Baseline, recordings
from ddmhe.baselines.tol import NONZERO
from ddmhe.checks import check_flag, check_number, check_whole

Array = NDArray[np.float64]
LiftedPart = tuple[Array, Array, Array]

__all__ = ["KoopmanMhe", "thin_plate"]

MOST = 1000
"""Longest horizon and dimension whose matrices, one for every depth, are reasonable to keep."""


def thin_plate(x: Array, centres: Array) -> Array:
    """Thin-plate spline r² log r, r = ‖x - c‖: points (…, n) and centres (K, n) to (…, K); 0 at a
    centre.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> ddmhe.baselines.thin_plate(np.array([[0.0], [1.0], [2.0]]), np.array([[0.0]])).round(3)
    array([[0.   ],
           [0.   ],
           [2.773]])
    """
    squared = np.sum((x[..., None, :] - centres) ** 2, axis=-1)
    return np.asarray(0.5 * squared * np.log(np.where(squared > 0, squared, 1.0)))


class KoopmanMhe(Baseline):
    """The estimator that Liu et al. 2026 call Dd-KMHE.

    A state is lifted to ψ(x) = [x; 1; thin-plate splines at random centres]; EDMD fits ψ(x⁺) = K
    ψ(x) + B u, y = C ψ(x) + D u by least squares (B, D with inputs only). The estimate minimises
    2ρ^m‖z(t-m) - z̄‖² + Σ ρ^{j-1} μ‖y(t-j) - C z(t-j) - D u(t-j)‖² over the lifted state at the
    window's start, which is linear least squares.

    Parameters
    ----------
    history : History
        The recording.
    horizon, rho, mu : int, float, float
        M, ρ and μ of the cost. Defaults: the paper's bench, 20, 0.9, 1e5.
    dimension : int
        Length of ψ; the paper's is 20.
    relift : bool
        Lift the prior anew from its state, ψ(x̂(t-m)), so that it is on the manifold of lifted
        states; without, the lifted estimate itself is the prior.
    seed : int
        Seed of the centres, uniform in the recorded range.
    cut : float
        Singular values of the lifted recording below this share of the largest are not used by
        EDMD. Default: the one of CUTS with which the first three quarters of the recording predict
        the last one best.
    x_prior : (n,)
        Default: the last recorded state.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> ddmhe.baselines.KoopmanMhe(record.history(200)).run(record.y[200:300]).x.shape
    (100, 3)
    """

    CUTS = tuple(10.0**k for k in range(-12, 0))

    def __init__(
        self,
        history: History,
        horizon: int = 20,
        rho: float = 0.9,
        mu: float = 1e5,
        *,
        dimension: int = 20,
        relift: bool = True,
        seed: int = 0,
        cut: float | None = None,
        x_prior: ArrayLike | None = None,
    ) -> None:
        """Check, identify and start."""
        parts = recordings(history)
        x_last = parts[-1][0][-1]
        super().__init__(history.n, history.p, x_last if x_prior is None else x_prior, history.m)
        self.dt = history.dt
        check_whole("horizon", horizon, 1, MOST, f"at least 1 and at most {MOST} outputs")
        check_number("rho, mu", rho, "rho in (0, 1) and a positive mu", lambda value: 0 < value < 1)
        check_number("rho, mu", mu, "rho in (0, 1) and a positive mu", lambda value: value > 0)
        enough = f"more than n + 1 = {self.n + 1} and at most {MOST} functions"
        check_whole("dimension", dimension, self.n + 2, MOST, enough)
        check_flag("relift", relift)
        check_whole("seed", seed, 0)
        if cut is not None:
            check_number("cut", cut, "a number in [0, 1)", lambda value: 0 <= value < 1)
        self._relift = relift
        x = np.concatenate([x for x, _ in parts])
        self._centre, self._scale = x.mean(axis=0), float(np.sqrt(x.var(axis=0).mean())) or 1.0
        scaled = (x - self._centre) / self._scale
        rng = np.random.default_rng(seed)
        self.centres = rng.uniform(
            scaled.min(axis=0), scaled.max(axis=0), (dimension - self.n - 1, self.n)
        )
        lifted = [(self.lift(x), y, u) for (x, y), u in zip(parts, history.inputs, strict=True)]
        self.cut = (
            min(self.CUTS, key=lambda each: self._prediction_error(each, lifted))
            if cut is None
            else cut
        )
        self.K, self.B, self.C, self.D = _edmd(lifted, self.cut)
        self.horizon = int(horizon)
        self._gains = list(self._prepared(rho, mu))
        self.reset()

    def lift(self, x: Array) -> Array:
        """ψ(x): (…, n) to (…, dimension); the first n entries are the state itself."""
        splines = thin_plate((x - self._centre) / self._scale, self.centres)
        return np.concatenate([x, np.ones((*x.shape[:-1], 1)), splines], axis=-1)

    def _prediction_error(self, cut: float, parts: list[LiftedPart]) -> float:
        """Squared error of states and outputs, relative to their spread, predicted over the last
        quarter."""
        lifted, y, u = parts[-1]
        end = 3 * len(y) // 4
        K, B, C, D = _edmd([*parts[:-1], (lifted[: end + 1], y[:end], u[:end])], cut)
        z, squares = lifted[end], 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(end, len(y)):
                squares += float(np.mean((_plus(C @ z, D, u[k]) - y[k]) ** 2)) / max(
                    float(y.var(axis=0).mean()), NONZERO
                )
                z = _plus(K @ z, B, u[k])
                squares += float(np.mean((z - lifted[k + 1])[: self.n] ** 2)) / self._scale**2
                if self._relift:
                    z = self.lift(z[: self.n])
        return squares if np.isfinite(squares) else np.inf

    def _prepared(self, rho: float, mu: float) -> list[tuple[Array, Array, Array]]:
        """For m = 1 … M: the observability matrix O, the rows' weights and K^m."""
        found, rows, power = [], [], np.eye(len(self.K))
        for m in range(1, self.horizon + 1):
            rows.append(self.C @ power)
            power = self.K @ power
            weights = np.repeat(
                np.sqrt(mu * rho ** np.arange(m - 1, -1, -1.0) / (2 * rho**m)), self.p
            )
            found.append((np.vstack(rows), weights, power.copy()))
        return found

    def _start(self, x_prior: Array) -> None:
        self._priors = [
            self.lift(x_prior)
        ]  # lifted estimates of the last M + 1 steps, oldest first
        self._outputs: list[Array] = []
        self._inputs: list[Array] = []

    def _forced(self) -> tuple[Array, Array]:
        """Outputs (m p,) and last lifted state (d,) that the window's inputs make from zero."""
        z, y = np.zeros(len(self.K)), []
        for u in self._inputs:
            y.append(self.C @ z + self.D @ u)
            z = self.K @ z + self.B @ u
        return np.concatenate(y), z

    def _step(self, y: Array, u: Array) -> Array:
        self._outputs = [*self._outputs, y][-self.horizon :]
        self._inputs = [*self._inputs, u][-self.horizon :]
        m = len(self._outputs)
        observability, weights, power = self._gains[m - 1]
        window = np.concatenate(self._outputs)
        z = self._priors[-m]
        forced = None
        if self.m:
            y_forced, forced = self._forced()
            window = window - y_forced
        weights = np.where(np.isnan(window), 0.0, weights)
        misfit = np.where(np.isnan(window), 0.0, window - observability @ z)
        if np.isfinite(misfit).all():
            rows = np.vstack([weights[:, None] * observability, np.eye(len(z))])
            z = (
                z
                + np.linalg.lstsq(
                    rows, np.concatenate([weights * misfit, np.zeros(len(z))]), rcond=None
                )[0]
            )
        lifted = power @ z if forced is None else power @ z + forced
        x = lifted[: self.n]
        self._priors = [*self._priors, self.lift(x) if self._relift else lifted][-self.horizon :]
        return np.asarray(x.copy())


def _plus(free: Array, gain: Array, u: Array) -> Array:
    """free + gain u; free itself where there are no inputs."""
    return np.asarray(free + gain @ u) if len(u) else free


def _edmd(parts: list[LiftedPart], cut: float) -> tuple[Array, Array, Array, Array]:
    """K, B, C and D of ψ(x⁺) = K ψ(x) + B u, y = C ψ(x) + D u by least squares.

    parts : lifted states (T_i+1, d), outputs (T_i, p) and inputs (T_i, m) of each recording; no
    pair crosses from one to the next. Inputs enter with unit deviation: their units do not move
    the cut."""
    before = np.concatenate([z[:-1] for z, _, _ in parts])
    after = np.concatenate([np.hstack([z[1:], y]) for z, y, _ in parts])
    u = np.concatenate([u for _, _, u in parts])
    d, m = before.shape[1], u.shape[1]
    scale = np.where(u.std(axis=0) > 0, u.std(axis=0), 1.0)
    if m:
        before = np.hstack([before, u / scale])
    theta: Array = np.linalg.lstsq(before, after, rcond=cut)[0].T.astype(np.float64)
    forced = theta[:, d:] / scale
    return theta[:d, :d], forced[:d], theta[d:, :d], forced[d:]
