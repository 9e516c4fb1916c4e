"""Independent references for a fitted disturbance: a linear fit, Kalman's filter, the window's
problem as written. Nothing here shares code with the package."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

import ddmhe
from driven import Driven, random_driven
from reference import hankel


@dataclass(frozen=True)
class Noisy(Driven):
    """A system, a recording of it with disturbance and noise, and what follows."""

    history: ddmhe.History
    x: np.ndarray
    Y: np.ndarray
    U: np.ndarray | None

    @classmethod
    def random(cls, seed, *, inputs=True, x_noise=0.0, T=150, steps=60, n=None):
        """n <= 4, p <= 2, m <= 2 (0 without inputs), offsets and feed-through; w .05, v .1."""
        rng = np.random.default_rng(5000 + seed)
        n = int(rng.integers(1, 5)) if n is None else n
        p, m = int(rng.integers(1, 3)), int(rng.integers(1, 3)) if inputs else 0
        system = random_driven(rng, n, p, m)
        u = rng.standard_normal((T + steps, m))
        u[T:] = 1 + np.sign(u[T:])  # other inputs than recorded
        w, v = (size * rng.standard_normal((T + steps, k)) for size, k in ((0.05, n), (0.1, p)))
        x, y = system.simulate(2 * rng.standard_normal(n), u, w, v)
        read = x[: T + 1] + x_noise * rng.standard_normal((T + 1, n))
        history = ddmhe.History(read, y[:T], 0.1, u=u[:T] if m else None)
        return cls(**vars(system), history=history, x=x[T:], Y=y[T:], U=u[T:] if m else None)


@dataclass(frozen=True)
class Fit(Driven):
    """The least-squares model of a recording and the covariances of what it leaves."""

    gamma: np.ndarray
    """Of the states' one-step residuals (n, n)."""
    R: np.ndarray
    """Of the outputs' residuals (p, p), its diagonal alone."""


def fitted(history):
    """[x(k+1); y(k)] by least squares on [x(k); u(k); 1], no step across a seam."""
    rows, targets = [], []
    for (x, y), u in zip(history.recordings, history.inputs, strict=True):
        rows.append(np.hstack([x[:-1], u, np.ones((len(y), 1))]))
        targets.append(np.hstack([x[1:], y]))
    rows, targets, n = np.vstack(rows), np.vstack(targets), history.n
    theta = np.linalg.lstsq(rows, targets, rcond=None)[0]
    errors = targets - rows @ theta
    S = errors.T @ errors / (len(rows) - rows.shape[1])
    theta, R = theta.T, np.diag(np.diag(S[n:, n:]))
    parts = theta[:n, :n], theta[:n, n:-1], theta[:n, -1], theta[n:, :n], theta[n:, n:-1]
    return Fit(*parts, theta[n:, -1], gamma=S[:n, :n], R=R)


def no_inputs(U, steps):
    return np.zeros((steps, 0)) if U is None else U


def stationary(model, Q):
    """P = A(P - PCᵀ(CPCᵀ + R)⁻¹CP)Aᵀ + Q, by scipy."""
    P = scipy.linalg.solve_discrete_are(model.A.T, model.C.T, Q, model.R)
    for _ in range(50):  # its last digits
        P = following(model, Q, P, np.full(len(model.r), True))
    return P


def following(model, Q, P, seen):
    """P(t) from P(t-1) and the outputs that were seen."""
    C, R = model.C[seen], model.R[np.ix_(seen, seen)]
    gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
    P = model.A @ (P - gain @ C @ P) @ model.A.T + Q
    return 0.5 * (P + P.T)


def kalman(model, Q, Y, U, x, P):
    """Predicted means (N, n) and covariances [P(1), …] by the textbook filter; NaN: lost."""
    means, covariances = [], []
    for y, u in zip(Y, no_inputs(U, len(Y)), strict=True):
        seen = ~np.isnan(y)
        C, R = model.C[seen], model.R[np.ix_(seen, seen)]
        gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x = x + gain @ (y - model.C @ x - model.D @ u - model.r)[seen]
        x = model.A @ x + model.B @ u + model.e
        P = following(model, Q, P, seen)
        means.append(x)
        covariances.append(P)
    return np.array(means), covariances


@dataclass(frozen=True)
class Moved:
    """States ((m+1) n,), outputs (m p,) and disturbances (m n,) of a window as z moves them."""

    x: np.ndarray
    y: np.ndarray
    w: np.ndarray


def by_model(model, m, U):
    """Of z = [x(0); w(0); …; w(m-1)], and of z = 0 under the inputs U (m, q)."""
    n, width = len(model.e), len(model.e) * (m + 1)
    x, at_rest, y, y_rest = [np.eye(n, width)], [np.zeros(n)], [], []
    for k in range(m):
        y.append(model.C @ x[-1])
        y_rest.append(model.C @ at_rest[-1] + model.D @ U[k] + model.r)
        w = np.zeros((n, width))
        w[:, n * (k + 1) : n * (k + 2)] = np.eye(n)
        x.append(model.A @ x[-1] + w)
        at_rest.append(model.A @ at_rest[-1] + model.B @ U[k] + model.e)
    moved = Moved(np.vstack(x), np.vstack(y), np.eye(width)[n:])
    return moved, np.concatenate(at_rest), np.concatenate(y_rest)


def by_recording(history, model, m):
    """Of z = [α; w(0); …; w(m-1)]: windows of the recording, and what w adds by the model."""
    driven, _, _ = by_model(model, m, np.zeros((m, model.B.shape[1])))
    n = history.n
    H_x = np.hstack([hankel(x, m + 1) for x, _ in history.recordings])
    H_y = np.hstack([hankel(y, m) for _, y in history.recordings])
    N = H_x.shape[1]
    return Moved(
        np.hstack([H_x, driven.x[:, n:]]),
        np.hstack([H_y, driven.y[:, n:]]),
        np.hstack([np.zeros((m * n, N)), np.eye(m * n)]),
    )


def blocks(m, b, n):
    """w (m n) of one vector for each block of b instants, and how long each is."""
    lengths = [min(b, m - k) for k in range(0, m, b)]
    ones = scipy.linalg.block_diag(*[np.ones((length, 1)) for length in lengths])
    return np.kron(ones, np.eye(n)), lengths


def most_likely(model, prior, Y, U):
    """States, disturbance and noise of a window by covariances, and its cost: everything given the
    outputs seen.

    prior : x̄ (n,), P and Q (n, n)."""
    x_bar, P, Q = prior
    m, n = len(Y), len(x_bar)
    moved, x_rest, y_rest = by_model(model, m, no_inputs(U, m))
    mean = np.append(x_bar, np.zeros(n * m))
    S = scipy.linalg.block_diag(P, *[Q] * m)
    y, noise = Y.ravel(), scipy.linalg.block_diag(*[model.R] * m)
    seen = ~np.isnan(y)
    Theta = moved.y[seen]
    error = y[seen] - y_rest[seen] - Theta @ mean
    weighed = np.linalg.solve(Theta @ S @ Theta.T + noise[np.ix_(seen, seen)], error)
    z = mean + S @ Theta.T @ weighed
    return moved.x @ z + x_rest, moved.w @ z, y - y_rest - moved.y @ z, error @ weighed
