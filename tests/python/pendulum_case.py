"""What the tests of the interval side share: the pendulum of the interval paper under disturbances
of several kinds, a second implementation of its observer, and an adversary."""

import numpy as np

from ddmhe import interval

W, V = 0.006, 0.01
START, RADIUS = np.array([0.98, 0.02]), np.array([0.1, 1.0])


def trajectory(rng, steps, kind):
    """x (steps+1, 2), y (steps, 1) of the pendulum (60) with one kind of disturbance."""
    s = interval.pendulum()
    if kind == "uniform":
        w, v = rng.uniform(-W, W, (steps, 2)), rng.uniform(-V, V, (steps, 1))
    elif kind == "extreme":
        w, v = W * rng.choice([-1, 1], (steps, 2)), V * rng.choice([-1, 1], (steps, 1))
    elif kind == "constant":
        w, v = (
            np.tile(W * rng.choice([-1, 1], 2), (steps, 1)),
            np.full((steps, 1), V * rng.choice([-1, 1])),
        )
    else:  # switching every few samples
        period = int(rng.integers(2, 20))
        sign = np.where((np.arange(steps) // period) % 2, 1, -1)[:, None]
        w, v = W * sign * rng.choice([-1, 1], 2), V * sign * rng.choice([-1, 1], 1)
    x = [START + RADIUS * (rng.choice([-1, 1], 2) if rng.random() < 0.5 else rng.uniform(-1, 1, 2))]
    for k in range(steps):
        x.append(s.A @ x[-1] + s.f(x[-1]) + w[k])
    x = np.array(x)
    return x, x[:-1, :1] + 0.1 * v


KINDS = ("uniform", "extreme", "constant", "switching")
METHODS = (("paper", "girard"), ("tight", "girard"), ("tight", "pca"), ("tight", "combastel"))


def outside(x, lower, upper):
    return bool(((x < lower) | (x > upper)).any())


class NumpyObserver:
    """(45)-(50) written down once more with NumPy; `broken` leaves a part of it out, `design` adds
    (44) and (59)."""

    def __init__(self, system, gain, order, broken=None, design=None):
        self.s, self.L, self.q, self.broken, self.design = system, gain, order, broken, design

    def run(self, Y):
        s, scale = self.s, lambda part, M: 0.99 * M if self.broken == part else M
        x, M = START.copy(), scale("start", np.diag(RADIUS))
        halves, centers, balls = [], [], []
        if g := self.design:
            V0 = max(e @ g.P @ e for e in (RADIUS, RADIUS * [1, -1]))
        for k, y in enumerate(Y):
            r = np.abs(M).sum(axis=1)
            J_lo, J_hi = (np.asarray(J) for J in s.jacobian(x - r, x + r))
            middle, radius = 0.5 * (J_lo + J_hi), 0.5 * (J_hi - J_lo)
            D_s = np.diag(radius @ r)
            T = [middle @ M] + ([] if self.broken == "no D^s" else [D_s])
            parts = [scale("propagated", (s.A - self.L @ s.C) @ M)] + (
                [] if self.broken == "no T" else T
            )
            parts += [scale("process", s.D1 * W), scale("noise", self.L @ s.D2 * V)]
            M = np.hstack(parts)
            if M.shape[1] > self.q:
                ranked = M[:, np.argsort(-np.linalg.norm(M, axis=0), kind="stable")]
                keep, rest = ranked[:, : self.q - s.n], ranked[:, self.q - s.n :]
                M = np.hstack([keep, np.diag(np.abs(rest).sum(axis=1))])
            x = s.A @ x + s.f(x) + self.L @ (y - s.C @ x)
            centers.append(x)
            halves.append(np.abs(M).sum(axis=1))
            if g:
                fade = (1 - g.lam) ** (k + 1)
                phi = np.sqrt(g.mu * (g.lam * fade * V0 + g.mu_w * 2 * W**2 + g.mu_v * V**2))
                balls.append(
                    [np.maximum(x - halves[-1], x - phi), np.minimum(x + halves[-1], x + phi)]
                )
        if g:
            return np.array(balls).transpose(1, 0, 2)
        centers, halves = np.array(centers), np.array(halves)
        return centers - halves, centers + halves


def adversary(system, L, steps, direction):
    """A trajectory that drives the last error along `direction`: signs from the adjoint of the
    error dynamics."""
    w, v, e0 = np.zeros((steps, 2)), np.zeros((steps, 1)), np.zeros(2)
    for _ in range(4):
        x, x_hat, J = [START + e0], START, []
        for k in range(steps):
            J.append(np.asarray(system.jacobian(*2 * [0.5 * (x[-1] + x_hat)])[0]))
            y = system.C @ x[-1] + system.D2 @ v[k]
            x_hat = system.A @ x_hat + system.f(x_hat) + L @ (y - system.C @ x_hat)
            x.append(system.A @ x[-1] + system.f(x[-1]) + w[k])
        p = np.array(direction, dtype=float)
        for k in reversed(range(steps)):
            w[k], v[k] = W * np.sign(system.D1.T @ p), -V * np.sign((L @ system.D2).T @ p)
            p = (system.A - L @ system.C + J[k]).T @ p
        e0 = RADIUS * np.sign(p)
    x = [START + e0]
    for k in range(steps):
        x.append(system.A @ x[-1] + system.f(x[-1]) + w[k])
    x = np.array(x)
    return x, x[:-1] @ system.C.T + v @ system.D2.T


def adversaries(system, L):
    """Adversarial runs of 1 to 60 samples in several directions."""
    for steps in (1, 2, 3, 4, 6, 10, 60):
        for direction in ([1, 0], [0, 1], [-1, 0], [0, -1]):
            yield adversary(system, L, steps, direction)
