"""Model-based moving horizon estimation: what one would run who has, or identifies, a model."""

from __future__ import annotations

import io
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DEFAULT_RHO, DdmheError, History
from ddmhe.baselines.base import Baseline, Estimate, Log, recordings
from ddmhe.baselines.boxes import box
from ddmhe.baselines.linear_model import LinearModel, given, identified
from ddmhe.baselines.recorded_noise import recorded_noise
from ddmhe.baselines.tol import LEAST_OUTPUT_NOISE
from ddmhe.baselines.weights import PaperWeights, RecordedWeights, root
from ddmhe.baselines.window import WindowFit, WindowGains, WindowMotion
from ddmhe.checks import array, check_finite, check_number, check_whole, choice, shown

Array = NDArray[np.float64]

__all__ = ["ModelEstimate", "ModelLog", "ModelMhe"]

HORIZON = 20
"""Outputs in a full window unless told otherwise."""
MOST = 1000
"""Longest horizon whose matrices, one set for every depth, are reasonable to keep."""
SCALED_MU = 0.1
"""μ in units of the recorded variances, as the default rule of `DdMhe` has it."""
SNAPSHOT = "ddmhe ModelMhe 1"


@dataclass(frozen=True, eq=False)
class ModelEstimate(Estimate):
    """The estimate after one step."""

    window: Array
    """States of the whole window (M_t+1, n), oldest first."""
    v: Array
    """Fitted noise (M_t, p), NaN where not measured."""
    w: Array | None
    """Fitted disturbance (M_t, n), or None without `process_noise`."""
    cost: float
    """The minimum."""
    status: str
    """"optimal"; "infeasible": no window was inside all bounds; "failed"."""
    active: int
    """Number of bounds that hold the window."""


@dataclass(frozen=True, eq=False, repr=False)
class ModelLog(Log):
    """The estimates of many steps."""

    cost: Array
    """(N,)"""
    status: NDArray[np.str_]
    """(N,)"""
    active: NDArray[np.int64]
    """(N,)"""


class ModelMhe(Baseline):
    """Moving horizon estimation on x(k+1) = A x + B u + e + w, y = C x + D u + r + v.

    At step t, over the last m = min(t, M) outputs, it minimises the cost (17) of `DdMhe`,
    2ρ^m ‖x̂(t-m) - x̄(t-m)‖² + Σ_j ρ^{j-1} μ ‖v̂(t-j)‖², within boxes. On exact recordings of a linear
    system both are the same estimator.

    With `process_noise` Q the window is driven by ŵ(j) = L_Q d(j), L_Q L_Qᵀ = Q, and the cost grows
    by c ‖d‖². With "paper" weights c = μ σ_v², σ_v² the mean variance of the outputs' noise (of
    `model.residual`; c = 1, that is μ = 1/σ_v², for a model without): a disturbance of its own
    deviation costs as much as a noise of its own. With "recorded" weights the cost is
    ‖x̂(t-m) - x̄‖²_{P⁻¹} + Σ‖v̂‖²_{R⁻¹} + ‖d‖², P of the Riccati equation and R of the residual:
    without bounds a Kalman filter that starts from the stationary P, also when outputs are lost.

    Steps without active bounds and lost outputs are matrix products, prepared once for a depth;
    bounds are met by an active-set solution of the least-distance problem.

    Parameters
    ----------
    model : History or model
        A recording, of which the least-squares model is taken, or an object with .A (n, n), .e
        (n,), .C (p, n), .r (p,), with inputs also .B (n, m), .D (p, m), and with .residual
        (n+p, n+p), the covariance of [w; v], where noise matters. `design.identify` gives one.
    horizon : int
        M; default 20.
    rho, mu : float
        ρ in (0, 1), default 0.95; μ > 0 in units of x² / y², default 0.1 times the quotient of the
        recorded variances (to be stated for a model). Neither goes with "recorded" weights.
    weights : "paper" or "recorded"
        See above; "recorded" needs process_noise.
    process_noise : (n, n), "residual" or "recorded"
        Q, symmetric and positive semidefinite, units of x²; "residual": that of the one-step
        residuals of the recording, right where its states are exact; "recorded", of a History: the
        share of it that makes the recording most likely when its states carry reading noise, and
        the R that belongs to it (`recorded_noise`). Default: no disturbance.
    x_prior : (n,)
        State at the first output; default: the last recorded state.
    x_bounds, v_bounds, w_bounds : (lo, hi)
        Each side a scalar or an array, (n,), (p,), (n,): on every state, noise and disturbance of
        the window.
    block : int
        Instants over which d is constant (covariance Q/block): fewer unknowns. The equality with
        the Kalman filter holds for 1 only.

    Raises
    ------
    DdmheError
        One clear error naming the argument.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> history = record.history(200)
    >>> same = {"horizon": 10, "rho": 0.8, "mu": 1e5}
    >>> log = ddmhe.baselines.ModelMhe(history, **same).run(record.y[200:300])
    >>> bool(np.abs(log.x - record.x[201:301]).max() < 0.01)
    True
    """

    def __init__(
        self,
        model: Any,
        horizon: int | None = None,
        rho: float | None = None,
        mu: float | None = None,
        *,
        weights: Literal["paper", "recorded"] = "paper",
        process_noise: ArrayLike | Literal["residual", "recorded"] | None = None,
        x_prior: ArrayLike | None = None,
        x_bounds: Any = None,
        v_bounds: Any = None,
        w_bounds: Any = None,
        block: int = 1,
    ) -> None:
        """Check, identify and start."""
        self.model = identified(model) if isinstance(model, History) else given(model)
        n, p = len(self.model.A), len(self.model.C)
        if x_prior is None:
            if not isinstance(model, History):
                raise DdmheError(
                    f"x_prior: expected {n} numbers, the state at the first output, since the model"
                    " is given, found none"
                )
            x_prior = recordings(model)[-1][0][-1]
        super().__init__(n, p, x_prior, self.model.B.shape[1])
        self.dt = float(getattr(model, "dt", 1.0))
        self.horizon = HORIZON if horizon is None else horizon
        check_whole("horizon", self.horizon, 1, MOST)
        self.horizon = int(self.horizon)
        check_whole("block", block)
        self.block = int(block)
        choice("weights", weights, ("paper", "recorded"))
        self.Q = self._process_noise(process_noise, model)
        self.weights = weights
        if weights == "paper":
            self._weights: Any = self._paper(model, rho, mu)
        else:
            self._weights = self._recorded(rho, mu)
        self.x_bounds = box("x_bounds", x_bounds, n)
        self.v_bounds = box("v_bounds", v_bounds, p)
        self.w_bounds = box("w_bounds", w_bounds, n)
        if self.w_bounds is not None and self.Q is None:
            raise DdmheError("w_bounds: expected none without process_noise, found some")
        self._prepare()
        self.reset()

    def _process_noise(self, given: Any, model: Any) -> Array | None:
        if given is None:
            return None
        n = self.n
        if isinstance(given, str):
            choice("process_noise", given, ("residual", "recorded"))
            residual = self._residual("process_noise")
            if given == "residual":
                return residual[:n, :n]
            if not isinstance(model, History):
                raise DdmheError(
                    "process_noise: expected a covariance or 'residual', since the model is given, "
                    "found 'recorded'"
                )
            found = recorded_noise(model, self.model)
            residual = scipy.linalg.block_diag(found.Q, found.R)
            self.model = replace(self.model, residual=residual)
            return found.Q
        Q = array("process_noise", given, (n, n))
        check_finite("process_noise", Q)
        least = float(np.linalg.eigvalsh(0.5 * (Q + Q.T))[0])
        size = float(np.abs(Q).max())
        if np.abs(Q - Q.T).max() > 1e-9 * size or least < -1e-9 * size or size == 0:
            raise DdmheError(
                "process_noise: expected a covariance, symmetric and positive semidefinite, not 0, "
                f"found one with the least eigenvalue {least:g}"
            )
        return 0.5 * (Q + Q.T)

    def _residual(self, name: str) -> Array:
        if self.model.residual is None:
            raise DdmheError(
                f"{name}: expected a model with .residual, the covariance of [w; v], found none"
            )
        return self.model.residual

    def _paper(self, model: Any, rho: float | None, mu: float | None) -> PaperWeights:
        rho = DEFAULT_RHO if rho is None else rho
        check_number("rho", rho, "a number in (0, 1)", lambda value: 0 < value < 1)
        if mu is None:
            if not isinstance(model, History):
                raise DdmheError(
                    "mu: expected a positive finite number, since the model is given, found none"
                )
            mu = SCALED_MU * _variance(model, 0) / _variance(model, 1)
        check_number("mu", mu, "a positive finite number", lambda value: value > 0)
        self.rho, self.mu = float(rho), float(mu)
        unit = 1.0
        if self.model.residual is not None:
            noise = np.diag(self.model.residual)[self.n :]
            if isinstance(model, History):  # an exact one: some noise, else no disturbance costs
                y = np.concatenate([y for _, y in recordings(model)])
                noise = np.maximum(noise, LEAST_OUTPUT_NOISE**2 * y.var(axis=0))
            unit = self.mu * float(noise.mean()) if noise.any() else 1.0
        return PaperWeights(self.rho, self.mu, unit)

    def _recorded(self, rho: float | None, mu: float | None) -> RecordedWeights:
        for name, value in (("rho", rho), ("mu", mu)):
            if value is not None:
                raise DdmheError(
                    f"{name}: expected none beside weights='recorded', found {shown(value)}"
                )
        if self.Q is None:
            raise DdmheError(
                "process_noise: expected a covariance, 'residual' or 'recorded' for weights="
                "'recorded', found "
                "none"
            )
        R = self._residual("weights")[self.n :, self.n :]
        return RecordedWeights(self.model, self.Q, R)

    def _prepare(self) -> None:
        """What follows from the settings; depths are made when a window first has them."""
        self._noise_root = None if self.Q is None else root(self.Q) / np.sqrt(self._weights.unit)
        self._motions: dict[int, WindowMotion] = {}
        self._gains: dict[int, WindowGains] = {}
        self._boxes: dict[int, tuple[Array, Array] | None] = {}

    def _start(self, x_prior: Array) -> None:
        # the last M+1 estimates with their covariances, oldest first; M outputs and inputs
        self._priors: list[tuple[Array, Array | None]] = [(x_prior, self._weights.first())]
        self._outputs: list[Array] = []
        self._inputs: list[Array] = []
        self._last: ModelEstimate | None = None

    def _motion(self, m: int) -> WindowMotion:
        if m not in self._motions:
            self._motions[m] = WindowMotion(self.model, m, self._noise_root, self.block)
        return self._motions[m]

    def _gains_of(self, m: int, seen: NDArray[np.bool_], P: Array | None) -> WindowGains:
        nominal = P is None and bool(seen.all())
        if nominal and m in self._gains:
            return self._gains[m]
        L = self._weights.prior_root(m, self.n, P)
        gains = WindowGains(self._motion(m), L, self._weights.whitening(seen), seen)
        if nominal:
            self._gains[m] = gains
        return gains

    def _box(self, m: int) -> tuple[Array, Array] | None:
        if m not in self._boxes:
            self._boxes[m] = self._sides(m)
        return self._boxes[m]

    def _sides(self, m: int) -> tuple[Array, Array] | None:
        """lo and hi of [x̂; v̂; ŵ] of a window of m outputs."""
        parts = [
            (self.x_bounds, self.n, m + 1),
            (self.v_bounds, self.p, m),
            (self.w_bounds, self.n, m if self.Q is not None else 0),
        ]
        if all(limits is None for limits, _, _ in parts):
            return None
        free = np.inf
        sides = []
        for side, unbounded in enumerate((-free, free)):
            of = [
                np.tile(np.full(width, unbounded) if limits is None else limits[side], count)
                for limits, width, count in parts
            ]
            # without process_noise ŵ has rows that stay 0
            rest = np.full(m * self.n if self.Q is None else 0, unbounded)
            sides.append(np.concatenate([*of, rest]))
        return sides[0], sides[1]

    def _fit(self, m: int) -> WindowFit:
        """The window of the last m outputs."""
        x_bar, P = self._priors[-m]
        Y = np.array(self._outputs[-m:])
        x, y = self._motion(m).free(x_bar, np.array(self._inputs[-m:]))
        gains = self._gains_of(m, ~np.isnan(Y), P)
        fit = gains.minimise(x, y, Y.ravel(), self._box(m))
        if fit.status == "optimal" or np.isnan(self._outputs[-1]).all():
            return fit
        # no window is inside of all bounds: without the newest output, now and later
        self._outputs[-1] = np.full(self.p, np.nan)
        return self._fit(m)

    def _step(self, y: Array, u: Array) -> Array:
        M = self.horizon
        self._outputs = [*self._outputs, y.copy()][-M:]
        self._inputs = [*self._inputs, u][-M:]
        m = len(self._outputs)
        fit = self._fit(m)
        dropped = bool((np.isnan(self._outputs[-1]) & ~np.isnan(y)).any())
        x = fit.x
        if self.x_bounds is not None:  # by rounding, or where nothing else is possible
            x = np.clip(x, np.tile(self.x_bounds[0], m + 1), np.tile(self.x_bounds[1], m + 1))
        window = x.reshape(m + 1, self.n)
        self._last = ModelEstimate(
            x=window[-1].copy(),
            window=window,
            v=fit.v.reshape(m, self.p),
            w=None if self.Q is None else fit.w.reshape(m, self.n),
            cost=fit.cost,
            status="infeasible" if dropped and fit.status == "optimal" else fit.status,
            active=fit.active,
        )
        P = self._weights.following(self._priors[-1][1], ~np.isnan(self._outputs[-1]))
        self._priors = [*self._priors, (window[-1].copy(), P)][-M:]
        return self._last.x

    def _estimate(self, y: Array, u: Array) -> ModelEstimate:
        x = self._next(y, u)
        if self._last is None or self._diverged:
            nothing = np.full((1, self.n), np.nan)
            return ModelEstimate(x, nothing, nothing[:0], None, np.nan, "failed", 0)
        return self._last

    def step(self, y_t: ArrayLike, u: ArrayLike | None = None) -> ModelEstimate:
        """Consume y(t-1) (p,), NaN where not measured, and u(t-1) (m,); x̂(t) and its window."""
        estimate = super().step(y_t, u)
        assert isinstance(estimate, ModelEstimate)
        return estimate

    def run(self, Y: ArrayLike, U: ArrayLike | None = None) -> ModelLog:
        """Consume outputs (N, p) and inputs (N, m), one step each."""
        log = super().run(Y, U)
        assert isinstance(log, ModelLog)
        return log

    def _log(self, estimates: list[Any], before: int) -> ModelLog:
        return ModelLog(
            x=np.reshape([e.x for e in estimates], (-1, self.n)),
            cost=np.array([e.cost for e in estimates], dtype=np.float64),
            status=np.array([e.status for e in estimates], dtype=str),
            active=np.array([e.active for e in estimates], dtype=np.int64),
            before=before,
            dt=self.dt,
        )

    def snapshot(self) -> bytes:
        """Model, settings and state, for `restore`; NumPy's .npz format."""
        holds = {f"model_{f.name}": getattr(self.model, f.name) for f in fields(LinearModel)}
        holds |= {name: getattr(self, name) for name in _KEPT}
        holds |= {f"prior_{i}": x for i, (x, _) in enumerate(self._priors)}
        holds |= {f"covariance_{i}": P for i, (_, P) in enumerate(self._priors)}
        holds |= {"default_prior": self._default_prior, "priors": len(self._priors)}
        holds |= {"dt": self.dt, "t": self.t}
        if self.weights == "paper":
            holds |= {"rho": self.rho, "mu": self.mu}
        holds |= {"outputs": np.reshape(self._outputs, (len(self._outputs), self.p))}
        holds |= {"inputs": np.reshape(self._inputs, (len(self._inputs), self.m))}
        blob = io.BytesIO()
        np.savez(blob, format=SNAPSHOT, **{k: v for k, v in holds.items() if v is not None})
        return blob.getvalue()

    @classmethod
    def restore(cls, blob: bytes) -> ModelMhe:
        """The estimator of a snapshot, at its step; DdmheError for other bytes."""
        if not isinstance(blob, bytes):
            raise DdmheError(f"blob: expected bytes, as they were made, found {type(blob)}")
        try:
            with np.load(io.BytesIO(blob), allow_pickle=False) as file:
                held = {name: file[name] for name in file.files}
            if str(held["format"]) != SNAPSHOT:
                raise ValueError(str(held["format"]))
            return cls._of(held)
        except DdmheError:
            raise
        except Exception as error:
            raise DdmheError(
                "blob: expected a snapshot of a ModelMhe, as it was made, found "
                f"{len(blob)} bytes that are none"
            ) from error

    @classmethod
    def _of(cls, held: dict[str, Array]) -> ModelMhe:
        parts: dict[str, Any] = {f.name: held.get(f"model_{f.name}") for f in fields(LinearModel)}
        model = LinearModel(**parts)
        settings: dict[str, Any] = {"weights": str(held["weights"]), "block": int(held["block"])}
        settings |= {k: held.get(k) for k in ("x_bounds", "v_bounds", "w_bounds")}
        if "rho" in held:
            settings |= {"rho": float(held["rho"]), "mu": float(held["mu"])}
        found = cls(
            model,
            int(held["horizon"]),
            process_noise=held.get("Q"),
            x_prior=held["default_prior"],
            **settings,
        )
        count = range(int(held["priors"]))
        found._priors = [(held[f"prior_{i}"], held.get(f"covariance_{i}")) for i in count]
        found._outputs, found._inputs = list(held["outputs"]), list(held["inputs"])
        found._diverged = bool(held["_diverged"])
        found.dt, found.t = float(held.get("dt", 1.0)), int(held.get("t", 0))
        return found


_KEPT = ("horizon", "block", "weights", "Q", "x_bounds", "v_bounds", "w_bounds", "_diverged")


def _variance(history: History, signal: Literal[0, 1]) -> float:
    """Mean variance of the recorded states or outputs; 1 where they never change."""
    values = np.concatenate([part[signal] for part in recordings(history)])
    return float(values.var(axis=0).mean()) or 1.0
