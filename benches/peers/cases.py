"""The problems: recordings, the estimator that solves them, and the same windows as quadratic
programmes.

The reduction here is written anew in NumPy and shares nothing with the package: mean window and
leading singular directions of the scaled recorded windows, then a QR decomposition of the weighted
cost rows. What is left of (16), (17) at each step is

    minimise 1/2 |t|^2  subject to  lower <= A t <= upper

with A fixed and new bounds at every step; the estimate is x = x_free + A_x t.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import ddmhe

Array = NDArray[np.float64]
RHO = 0.9


def windows(x: Array, y: Array, depth: int) -> Array:
    """Interleaved windows x(0), y(0), …, x(depth) of a recording, one a column."""
    rows = [
        np.hstack([x[k : k + depth], y[k : k + depth]]).ravel() for k in range(len(y) - depth + 1)
    ]
    return np.array([np.concatenate([row, x[k + depth]]) for k, row in enumerate(rows)]).T


@dataclass
class Case:
    """One size of problem: recording, settings, online outputs."""

    name: str
    x: Array
    y: Array
    horizon: int
    rank: int
    mu: float
    outputs: Array
    v_bound: float = np.inf
    regime: str = "free"
    x_hat: Array = field(default_factory=lambda: np.empty((0, 0)))
    active: Array = field(default_factory=lambda: np.empty(0))

    def estimator(self) -> ddmhe.DdMhe:
        """ddmhe with the bounds of this case on states and noise."""
        return ddmhe.DdMhe(
            ddmhe.History(self.x, self.y, x_units=["rad/s"], y_units=["rad/s"]),  # one scale each
            horizon=self.horizon,
            rho=RHO,
            mu=self.mu,
            space=ddmhe.Truncated(rank=self.rank),
            x_bounds=(-1e3, 1e3),
            v_bounds=(-min(self.v_bound, 1e3), min(self.v_bound, 1e3)),
        )

    def run(self) -> ddmhe.Log:
        """The whole log; remembers the estimates, which are the priors of later windows."""
        log = self.estimator().run(self.outputs)
        self.x_hat, self.active = log.x, log.active
        return log

    @property
    def steps(self) -> range:
        """Steps with a full window whose prior is an estimate."""
        return range(2 * self.horizon + 1, len(self.outputs) + 1)

    @cached_property
    def reduced(self) -> "Reduced":
        """The quadratic programmes of all steps."""
        return Reduced(self)

    def tightened(self) -> "Case":
        """The same with a bound on the noise at which 2 to 6 bounds are active in the typical step,
        none infeasible."""
        low, high = 0.0, float(np.abs(self.outputs).max())
        tight = self
        for _ in range(40):
            bound = (low + high) / 2
            trial = Case(
                self.name,
                self.x,
                self.y,
                self.horizon,
                self.rank,
                self.mu,
                self.outputs,
                bound,
                "active",
            )
            log = trial.run()
            late = slice(trial.steps.start - 1, None)
            if (log.status[late] != "optimal").any() or np.median(log.active[late]) > 4:
                low = bound
            else:
                high, tight = bound, trial
                if np.median(log.active[late]) >= 3:
                    break
        return tight


@dataclass
class InUserUnits:
    """The same programmes as a step in C makes them: z* = z_0 + K [x̄; y], window c + A (z* + t)."""

    K: Array
    z_0: Array
    A: Array
    c: Array
    lower: Array
    """Of all states and of the fitted noise, in this order."""
    upper: Array
    prior_weight: float
    weight: Array
    """Of the squares of the fitted noise (M p)."""


class Reduced:
    """The windows of a case as least-distance problems: A (m, r), lower and upper (steps, m); x
    from t."""

    def __init__(self, case: Case) -> None:
        M, n, p = case.horizon, case.x.shape[1], case.y.shape[1]
        s_x = np.sqrt(((case.x - case.x.mean(0)) ** 2).mean())
        s_y = np.sqrt(((case.y - case.y.mean(0)) ** 2).mean())
        scale = np.concatenate(
            [np.tile(np.r_[np.full(n, s_x), np.full(p, s_y)], M), np.full(n, s_x)]
        )
        W = windows(case.x, case.y, M) / scale[:, None]
        mean = W.mean(1)
        B = np.linalg.svd(W - mean[:, None], full_matrices=False)[0][:, : case.rank]
        block = np.arange(M)[:, None] * (n + p)
        y_rows = (block + n + np.arange(p)).ravel()
        x_rows = (np.arange(M + 1)[:, None] * (n + p) + np.arange(n)).ravel()
        mu = case.mu * (s_y / s_x) ** 2
        weight = np.r_[
            np.full(n, np.sqrt(2 * RHO**M)),
            np.repeat(np.sqrt(mu * RHO ** np.arange(M - 1, -1, -1.0)), p),
        ]
        seen = np.r_[np.arange(n), y_rows]
        Q, R = np.linalg.qr(weight[:, None] * B[seen])
        A = B @ np.linalg.inv(R)

        steps = np.array(case.steps)
        outputs = np.array([case.outputs[t - M : t].ravel() for t in steps])
        priors = np.array([case.x_hat[t - M - 1] for t in steps])
        f = np.hstack([priors / s_x, outputs / s_y])
        self.gain = Q.T * weight
        self.offset = mean[seen]
        self.f = f - self.offset
        z = self.f @ self.gain.T
        free = mean + z @ A.T
        v_hi = case.v_bound if np.isfinite(case.v_bound) else 1e3
        rows = np.r_[x_rows, y_rows]
        above = np.hstack([np.full((len(f), len(x_rows)), 1e3 / s_x), (outputs + v_hi) / s_y])
        below = np.hstack([np.full((len(f), len(x_rows)), -1e3 / s_x), (outputs - v_hi) / s_y])
        self.A = np.ascontiguousarray(A[rows])
        self.lower = np.ascontiguousarray(below - free[:, rows])
        self.upper = np.ascontiguousarray(above - free[:, rows])
        self.window = mean[rows], self.A
        s_seen, s_rows = np.r_[np.full(n, s_x), np.full(M * p, s_y)], scale[rows]
        bound = np.r_[np.full(len(x_rows), 1e3), np.full(len(y_rows), v_hi)]
        self.user = InUserUnits(
            K=self.gain / s_seen,
            z_0=-self.gain @ self.offset,
            A=self.A * s_rows[:, None],
            c=mean[rows] * s_rows,
            lower=-bound,
            upper=bound,
            prior_weight=2 * RHO**M,
            weight=case.mu * np.repeat(RHO ** np.arange(M - 1, -1, -1.0), p),
        )
        self.x_free = free[:, -n:] * s_x
        self.A_x = A[-n:] * s_x
        self.x_hat = case.x_hat[steps - 1]

    def estimate(self, k: int, t: Array) -> Array:
        """The estimate of window k (n,) from its solution t."""
        return np.asarray(self.x_free[k] + self.A_x @ t)


def cases(count: int) -> list[Case]:
    """All sizes, each with nothing active and with a few bounds active, of `count` windows."""
    found = []
    for name, model, noisy, M, r in [
        ("3-DOF", ddmhe.models.detumbling(), False, 10, 5),
        ("3-DOF", ddmhe.models.detumbling(), False, 20, 5),
        ("3-DOF", ddmhe.models.detumbling(), False, 50, 20),
        ("3-DOF-n", ddmhe.models.detumbling(), True, 20, 20),
        ("3-DOF-n", ddmhe.models.detumbling(), True, 50, 20),
        ("1-DOF", ddmhe.models.spin_down(), False, 20, 3),
    ]:
        steps = 2 * M + count
        clean = model.simulate(round(20 + steps * 0.1, 1), 0.1)
        spread = float(np.std(clean.y[:200]))
        rng = np.random.default_rng(0)
        recorded = clean.y[:200] + (
            0.02 * spread if noisy else 1e-6 * spread
        ) * rng.standard_normal(clean.y[:200].shape)
        online = clean.y[200 : 200 + steps]
        # bounded noise, so that bounds can cut much of it before they contradict each other
        online = online + 0.04 * spread * rng.uniform(-1, 1, online.shape)
        mu = float(np.var(clean.x[:201]) / np.var(clean.y[:200]))
        case = Case(f"{name} M={M} r={r}", clean.x[:201], recorded, M, r, mu, online)
        case.run()
        found += [case, case.tightened()]
    return found
