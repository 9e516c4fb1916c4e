"""x⁺ = x + Θφ(x) + Bu, y = Ψφ(x) + Du, fitted to recordings whose states may be noisy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.lifted.kalman import updated
from ddmhe.lifted.monomials import Monomials
from ddmhe.lifted.tol import BEYOND, CLOSE_TO_FLAT, GUARD_RANGE, NOISY, OUTSIDE, ROUNDS

Array = NDArray[np.float64]

__all__ = ["LiftedModel", "Part", "fit"]


class Part(NamedTuple):
    """One recording."""

    x: Array
    """States (T+1, n)."""
    y: Array
    """Outputs (T, p)."""
    u: Array
    """Inputs (T, m)."""


@dataclass(frozen=True, eq=False)
class LiftedModel:
    """The fitted system with what its filter needs."""

    mean: Array
    """Mean (n,) of the recorded states."""
    spread: Array
    """Standard deviation (n,) of the recorded states."""
    degree: int
    Theta: Array  # n × K
    Psi: Array  # p × K
    B: Array  # n × m
    D: Array  # p × m
    Q: Array  # n × n
    """Covariance of what the fit leaves of x⁺."""
    R: Array  # p × p
    """Covariance of what the fit leaves of y."""
    x_noise: Array
    """Standard deviation (n,) of the recorded states' noise."""
    x_end: Array
    """State (n,) at the end of the last recording."""
    P_end: Array
    """Covariance (n, n) of that state."""
    least: Array
    """Recorded minima (n,)."""
    most: Array
    """Recorded maxima (n,)."""

    def __post_init__(self) -> None:
        """Make the monomials, which follow from the rest, and lay arrays out as saved ones are: a
        product's last bits depend on it."""
        for name, value in self.arrays().items():
            object.__setattr__(self, name, np.ascontiguousarray(value) if value.ndim else value[()])
        object.__setattr__(self, "phi", Monomials(self.mean, self.spread, self.degree))

    phi: Monomials = None  # type: ignore[assignment]

    @property
    def cut_off(self) -> tuple[Array, Array]:
        """Where estimates are cut off, since a polynomial would go to infinity there."""
        reach = BEYOND * (self.most - self.least) + 1e-9
        return self.least - reach, self.most + reach

    def near(self, x: Array) -> bool:
        """Whether a state (n,) is in the recorded region, or nearly."""
        reach = GUARD_RANGE * (self.most - self.least)
        return bool(np.all((x >= self.least - reach) & (x <= self.most + reach)))

    def outside(self, x: Array) -> bool:
        """Whether a state (n,) has left the recorded range by more than a quarter of it."""
        reach = OUTSIDE * (self.most - self.least)
        return bool(np.any((x < self.least - reach) | (x > self.most + reach)))

    def next(self, x: Array, u: Array) -> tuple[Array, Array]:
        """x⁺ (n,) and ∂x⁺/∂x (n, n)."""
        A = np.eye(len(x)) + self.Theta @ self.phi.jacobian(x)
        return x + self.Theta @ self.phi(x) + self.B @ u, A

    def output(self, x: Array, u: Array) -> tuple[Array, Array]:
        """y (p,) and ∂y/∂x (p, n)."""
        return self.Psi @ self.phi(x) + self.D @ u, self.Psi @ self.phi.jacobian(x)

    def arrays(self) -> dict[str, Array]:
        """All that it is made of, by name."""
        names = (field.name for field in fields(self) if field.name != "phi")
        return {name: np.asarray(getattr(self, name)) for name in names}


def fit(
    parts: Sequence[Part],
    noise: tuple[Array, Array],
    degree: int,
    ridge: float,
    output_noise: Array | None,
) -> LiftedModel:
    """Fit the system to the recordings by rounds of regression and smoothing.

    noise : standard deviations (n,), (p,) of the noise of recorded states and outputs
    output_noise : (p,), that of online outputs, where it is stated
    """
    x = np.concatenate([part.x for part in parts])
    spread = x.std(axis=0) + CLOSE_TO_FLAT
    x_noise = np.maximum(noise[0], 1e-6 * x.std(axis=0) + CLOSE_TO_FLAT)
    phi = Monomials(x.mean(axis=0), spread, degree)
    noisy = bool(np.any(x_noise > NOISY * spread))

    model = _regress(parts, phi, ridge, x_noise, subtract=noisy)
    x_end, P_end = parts[-1].x[-1], np.diag(x_noise**2)
    for _ in range(ROUNDS if noisy else 0):
        smoothed = [_smooth(part, model) for part in parts]
        if not all(np.isfinite(states).all() for states, _ in smoothed):
            model = _regress(parts, phi, ridge, x_noise, subtract=True)
            break
        known = [part._replace(x=states) for part, (states, _) in zip(parts, smoothed, strict=True)]
        model = _regress(known, phi, ridge, x_noise, subtract=False)
    if noisy:
        states, covariance = _smooth(parts[-1], model)
        if np.isfinite(states).all():
            x_end, P_end = states[-1], covariance
    R = model.R
    if output_noise is not None:
        R = np.diag(np.maximum(np.diag(R), output_noise**2))
    found = model.arrays() | {"x_end": x_end, "P_end": P_end, "R": R}
    found |= {"least": x.min(axis=0), "most": x.max(axis=0)}
    return LiftedModel(**found | {"degree": degree})


def _regress(
    parts: Sequence[Part], phi: Monomials, ridge: float, x_noise: Array, *, subtract: bool
) -> LiftedModel:
    """Θ, B, Ψ, D by least squares with a ridge that grows with the monomial's degree; Q and R are
    what is left, Q without the recorded states' noise where that is to be subtracted."""
    before = np.concatenate([part.x[:-1] for part in parts])
    step = np.concatenate([np.diff(part.x, axis=0) for part in parts])
    y = np.concatenate([part.y for part in parts])
    u = np.concatenate([part.u for part in parts])
    T, K, m = len(y), len(phi.orders), u.shape[1]
    y_spread = y.std(axis=0) + CLOSE_TO_FLAT
    u_spread = u.std(axis=0) + CLOSE_TO_FLAT
    F = np.hstack([phi(before), u / u_spread])  # T × (K + m)
    orders = np.concatenate([phi.orders, np.ones(m)])
    weights = np.where(orders >= 1, ridge * T * 10.0 ** (2 * (orders - 1)), 0.0)
    weights[orders == 1] *= 0.01
    targets = np.hstack([step / phi.scale, y / y_spread])
    found = np.linalg.solve(F.T @ F + np.diag(weights + 1e-12 * T), F.T @ targets).T
    n = len(phi.scale)
    # in the units of x, y and u
    coefficients = found * np.concatenate([phi.scale, y_spread])[:, None]
    misfit = np.hstack([step, y]) - F @ coefficients.T
    variances = np.mean(misfit**2, axis=0)
    q, r = variances[:n], variances[n:]
    if subtract:
        q = np.maximum(q - 2 * x_noise**2, 0.05 * q)
    forced = coefficients[:, K:] / u_spread
    zero = np.zeros(n)
    return LiftedModel(
        mean=phi.mean,
        spread=phi.scale,
        degree=phi.degree,
        Theta=coefficients[:n, :K],
        Psi=coefficients[n:, :K],
        B=forced[:n],
        D=forced[n:],
        Q=np.diag(q + 1e-14 * phi.scale**2),
        R=np.diag(r + 1e-10 * y_spread**2),
        x_noise=x_noise,
        x_end=zero,
        P_end=np.diag(x_noise**2),
        least=before.min(axis=0),
        most=before.max(axis=0),
    )


class _Filtered(NamedTuple):
    """What is known of one sample's state: predicted from those before it, and with its own."""

    x_predicted: Array
    P_predicted: Array
    x: Array
    P: Array
    A: Array
    """∂x/∂(the state before it)."""


def _smooth(part: Part, model: LiftedModel) -> tuple[Array, Array]:
    """Smoothed states (T+1, n) of a recording and the covariance (n, n) of the last: an extended
    Kalman filter over states and outputs, then the pass back of Rauch, Tung and Striebel."""
    n, T = len(model.mean), len(part.y)
    x_variance = model.x_noise**2
    reach = BEYOND * np.ptp(part.x, axis=0) + 1e-9
    least, most = part.x.min(axis=0) - reach, part.x.max(axis=0) + reach
    x, P, A = part.x[0], np.diag(x_variance), np.eye(n)
    known: list[_Filtered] = []
    for k in range(T + 1):
        if k:
            x, A = model.next(known[-1].x, part.u[k - 1])
            P = A @ known[-1].P @ A.T + model.Q
        H, v, r = np.eye(n), part.x[k] - x, x_variance
        if k < T:
            y, C = model.output(x, part.u[k])
            H, v = np.vstack([H, C]), np.concatenate([v, part.y[k] - y])
            r = np.concatenate([r, np.diag(model.R)])
        x_all, P_all = updated(x, P, H, v, np.diag(r))
        known.append(_Filtered(x, P, np.clip(x_all, least, most), P_all, A))
    return _passed_back(known), known[-1].P


def _passed_back(known: list[_Filtered]) -> Array:
    """States (T+1, n) that all samples give."""
    states = np.array([each.x for each in known])
    tiny = 1e-18 * np.eye(states.shape[1])
    for k in range(len(known) - 2, -1, -1):
        after = known[k + 1]
        G = np.linalg.solve(after.P_predicted + tiny, after.A @ known[k].P).T
        states[k] += G @ (states[k + 1] - after.x_predicted)
    return states
