"""Independent reference of the covariance and the doubts of an estimate, for weights of scaled
units: held-out windows of the recording say how large an error goes with how large a minimum V.

Everything is in the scaled units of the twin."""

import itertools
from dataclasses import dataclass

import numpy as np

from evidence_reference import Twin, one_step


def folds(parts, origins=(0.6, 0.8)):
    """[(training parts, x, y, first target)]: with one recording what comes after each origin, up
    to the next; with several the four longest in turn, learnt from the others."""
    if len(parts) == 1:
        (x, y), T = parts[0], len(parts[0][1])
        edges = [int(o * T) for o in (*origins, 1.0)]
        return [([(x[: s + 1], y[:s])], x[: e + 1], y[:e], s)
                for s, e in itertools.pairwise(edges)]  # fmt: skip
    longest = np.argsort([-len(y) for _, y in parts], kind="stable")[:4]
    return [([q for j, q in enumerate(parts) if j != i], *parts[i], 0) for i in longest]


def shortened(parts, m, n):
    """The depth, at most m, that leaves max(2n+1, .4 T) windows."""
    T = sum(len(y) for _, y in parts)
    while m > 1 and sum(max(len(y) - m + 1, 0) for _, y in parts) < max(2 * n + 1, 0.4 * T):
        m -= 1
    return m


@dataclass
class Held:
    """Held-out windows of one nominal depth: error e (L, n), V, J (L,), ν (L, p)."""

    e: np.ndarray
    V: np.ndarray
    J: np.ndarray
    nu: np.ndarray
    stretches: list
    """e of each fold on its own."""


def held_out(twin, depth):
    """Held-out windows with the recorded state for a prior."""
    found = []
    for parts, x, y, first in folds(twin.parts):
        m = min(shortened(parts, depth, twin.n), len(y))
        window = twin.window(parts, m)
        at = np.arange(max(first + 1, m), len(y) + 1)
        if not len(at):
            continue
        outputs = np.array([y[k - m : k].ravel() for k in at])
        x_hat, J, L, nu = window.solve(x[at - m], outputs)
        found.append((x_hat - x[at], J + twin.lam * L, J, nu))
    stretches = [errors for errors, *_ in found]
    return Held(*(np.concatenate(part) for part in zip(*found, strict=True)), stretches)


def stretch(v):
    """s(v): what the squared error does with v = V/V0."""
    return np.where(v <= 1, v, v**1.5)


@dataclass
class Reference:
    """What the held-out windows of one depth say."""

    V0: float
    Vmax: float
    Jmax: float
    Q0: np.ndarray
    S0: np.ndarray
    h: np.ndarray


def calibrated(held, exact):
    """`exact`: nothing is scaled by V."""
    V0 = max(held.V.mean(), 1e-300)
    s = np.ones(len(held.V)) if exact else stretch(held.V / V0)
    Q = held.e.T @ held.e / max(s.sum(), 1e-300)
    ratio = np.abs(held.e) / np.sqrt(np.outer(s, np.diag(Q)) + 1e-300)
    c = np.maximum(1, np.quantile(ratio, 0.997, axis=0) / 3)
    S = np.diag(held.nu.T @ held.nu) / max(s.sum(), 1e-300)
    h = np.sqrt((held.e**2).mean(axis=0))
    return Reference(V0, held.V.max(), held.J.max(), Q * np.outer(c, c), S, h)


def mahalanobis(parts, x):
    """D of states x (L, n): squared distance from the mean of the recorded states, in units of
    their covariance."""
    X = np.vstack([states for states, _ in parts])
    n = X.shape[1]
    S = np.cov(X.T, bias=True).reshape(n, n)
    S = S + 1e-9 * np.trace(S) / n * np.eye(n)
    away = x - X.mean(axis=0)
    return (away * np.linalg.solve(S, away.T).T).sum(axis=1)


def farthest(twin):
    """D_max: the largest D of the recorded states, and of held-out ones under what they were
    estimated from."""
    own = mahalanobis(twin.parts, np.vstack([x for x, _ in twin.parts])).max()
    held = [mahalanobis(parts, x[first + 1 :]).max() for parts, x, _, first in folds(twin.parts)]
    return max(own, *held)


def growth(twin):
    """g: held-out errors of the last third of a stretch over those of its first; 1 for several
    recordings and for what is white and straight, 3 at least where noise hides it."""
    white, curved = one_step_tests(twin.parts)
    if len(twin.parts) > 1 or (white <= 0.3 and curved <= 5):
        return 1.0
    first, last = [], []
    for errors in held_out(twin, twin.M).stretches:
        third = len(errors) // 3
        first.append(errors[:third])
        last.append(errors[2 * third :])
    size = [np.mean((np.vstack(e) ** 2).mean(axis=0) / twin.spread**2) for e in (first, last)]
    g = float(np.sqrt(size[1] / size[0]))
    return max(g, 3.0) if white <= 0.3 else g


def one_step_tests(parts):
    """Of what an affine step leaves: the largest lag-1 autocorrelation, and the largest score of
    the F test that products of two states explain nothing (Wilson and Hilferty 1931)."""
    X = np.vstack([x[:-1] for x, _ in parts])
    Z = np.vstack([np.hstack([x[1:], y]) for x, y in parts])
    X, Z = (X - X.mean(axis=0)) / X.std(axis=0), Z - Z.mean(axis=0)
    left = Z - X @ np.linalg.lstsq(X, Z, rcond=None)[0]
    told = (left**2).mean(axis=0) > 1e-24 * (Z**2).mean(axis=0)
    if not told.any():
        return 0.0, -np.inf
    left = left[:, told]
    ends = np.cumsum([len(y) for _, y in parts])[:-1]
    pairs = np.setdiff1d(np.arange(1, len(left)), ends)
    lag = (left[pairs] * left[pairs - 1]).sum(axis=0) / (left**2).sum(axis=0)
    n = X.shape[1]
    P = np.column_stack([X[:, i] * X[:, j] for i in range(n) for j in range(i + 1)])
    P = P - P.mean(axis=0)
    P = P - X @ np.linalg.lstsq(X, P, rcond=None)[0]
    q, d = P.shape[1], len(X) - (n + 1 + P.shape[1])
    if d < 1:
        return float(lag.max()), -np.inf
    explained = ((P @ np.linalg.lstsq(P, left, rcond=None)[0]) ** 2).sum(axis=0)
    rest = np.maximum((left**2).sum(axis=0) - explained, 1e-16 * (left**2).sum(axis=0))
    F, a, b = np.cbrt((explained / q) / (rest / d)), 2 / (9 * q), 2 / (9 * d)
    score = ((1 - b) * F - (1 - a)) / np.sqrt(b * F**2 + a)
    return float(lag.max()), float(score.max())


class Evidence:
    """What the estimates of a twin say about themselves."""

    def __init__(self, twin: Twin, output_noise=None):
        """`output_noise`: stated deviation of online outputs (p), in the user's units."""
        self.twin, self.exact = twin, twin.lam == 0
        halved = [twin.M]
        while halved[-1] > 1:
            halved.append(halved[-1] // 2)
        self.held = {d: held_out(twin, d) for d in halved}
        self.reference = {d: calibrated(held, self.exact) for d, held in self.held.items()}
        self.P0 = np.diag(np.minimum(twin.noise_x, one_step(twin.parts)[: twin.n]))
        self.farthest = farthest(twin)
        self.growth = growth(twin)
        self.noise = None if output_noise is None else (output_noise / twin.scales.s_y) ** 2
        self.longest = np.max([[longest_run(c) for c in y.T] for _, y in twin.parts], axis=0)

    @property
    def h(self):
        """The promise (n)."""
        return self.reference[self.twin.M].h

    def of_depth(self, m):
        """The reference of the largest calibrated depth at most m."""
        return self.reference[max(d for d in self.reference if d <= m)]

    def added(self, m):
        """What the stated noise adds to the mean of V, to Q0 and to S0."""
        n, p, window = self.twin.n, self.twin.p, self.twin.windows[m]
        if self.noise is None:
            return 0.0, np.zeros((n, n)), np.zeros(p)
        R = np.tile(self.noise, m)
        deleted = window.loo @ (np.eye(n + m * p) - window.H)[-p:, n:]
        V = float(window.share[n:] @ R)
        return V, (window.Gamma * R) @ window.Gamma.T, deleted**2 @ R

    def sizes(self, m):
        """V0 and Q0 of depth m with the stated noise."""
        V, Q, _ = self.added(m)
        return self.of_depth(m).V0 + V, self.of_depth(m).Q0 + Q

    def stretches(self, trace, goes_on=True):
        """s (N,); `goes_on`: the log goes on from the recording's end."""
        if self.exact:
            return np.ones(len(trace.V))
        v = trace.V / np.array([self.sizes(m)[0] for m in trace.m])
        since = np.arange(1, len(v) + 1) if goes_on else np.full(len(v), self.twin.T)
        return np.array([self.stretched(*step) for step in zip(v, trace.x, since, strict=True)])

    def stretched(self, v, x, since):
        """s of a step with v = V/V0 that makes the estimate x, `since` samples after the
        recording's end: by V, by how far the motion may have changed unseen, by how far the
        estimate has left the recorded states."""
        twin = self.twin
        s = float(stretch(v)) if self.noise is None else max(float(stretch(v)), 1.0)
        if self.growth > 1.5:
            power = 2 * np.log(self.growth) / np.log(5)
            s = max(s, v * max(1.0, min(since, twin.T) / (0.1 * twin.T)) ** power)
        u = mahalanobis(twin.parts, x[None])[0] / (0.7 * self.farthest)
        return max(s, u**2 if u > 1 else 0.0)

    def covariance(self, trace, P0=None):
        """Σ(t) (N, n, n)."""
        twin, s = self.twin, self.stretches(trace)
        Sigma = np.zeros((len(s) + 1, twin.n, twin.n))
        Sigma[0] = self.P0 if P0 is None else P0
        for t in range(1, len(Sigma)):
            m = trace.m[t - 1]
            window = twin.windows[m]
            A, Q = window.Phi @ Sigma[t - m] @ window.Phi.T, s[t - 1] * self.sizes(m)[1]
            if self.exact and self.noise is None:
                Q = Q + self.shown(trace, t) * window.Gamma @ window.Gamma.T
            Sigma[t] = A + Q if self.exact else joined(A, Q, twin.spread)
        return Sigma[1:]

    def shown(self, trace, t):
        """Variance of the outputs' noise, scaled, that the last M minima show."""
        twin = self.twin
        last = slice(max(t - twin.M, 0), t)
        per_unit = sum(float(twin.windows[m].share[twin.n :].sum()) for m in trace.m[last])
        return float(trace.V[last].sum()) / per_unit

    def limits(self, m):
        """V and J beyond which a step of depth m is one that nothing held out was like."""
        noise = self.added(m)[0] * (1 + 3 * np.sqrt(2 / (m * self.twin.p)))
        return 3 * (self.of_depth(m).Vmax + noise), 3 * (self.of_depth(m).Jmax + noise)

    def beyond(self, trace):
        """(N,) whether V or J is."""
        V, J = np.array([self.limits(m) for m in trace.m]).T
        return (trace.V > V) | (trace.J > J)

    def novel(self, trace):
        """(N,) whether some step in the last M was beyond."""
        beyond, M = self.beyond(trace), self.twin.M
        return np.array([beyond[max(t - M + 1, 0) : t + 1].any() for t in range(len(beyond))])

    def uncertain(self, Sigma):
        """(N,) whether the deviation of a state is beyond half its spread and three promises."""
        limit = np.maximum(0.5 * self.twin.spread, 3 * self.h)
        return (np.sqrt(np.diagonal(Sigma, axis1=1, axis2=2)) > limit).any(axis=1)

    def outside(self, trace):
        """(N,) whether a state has left its recorded range by more than a quarter of it."""
        lo, hi = self.twin.lo[: self.twin.n], self.twin.hi[: self.twin.n]
        margin = 0.25 * (hi - lo)
        return ((trace.x < lo - margin) | (trace.x > hi + margin)).any(axis=1)

    def stuck(self, Y):
        """(N, p) whether an output has had its value for max(10, three of the longest recorded
        runs)."""
        limit = np.maximum(10, 3 * self.longest)
        run = np.ones(np.shape(Y), int)
        for t in range(1, len(run)):
            run[t] = np.where(Y[t] == Y[t - 1], run[t - 1] + 1, 1)
        return run >= limit

    def innovation_std(self, m):
        """√S0 of depth m (p), with the stated noise."""
        return np.sqrt(self.of_depth(m).S0 + self.added(m)[2])


def joined(A, Q, spread):
    """Covariance of a sum whose correlation is unknown: A(1 + 1/κ) + Q(1 + κ)."""
    a, q = np.diag(A) @ spread**-2, np.diag(Q) @ spread**-2
    kappa = np.sqrt(a / q) if a > 0 and q > 0 else 1.0
    return A * (1 + 1 / kappa) + Q * (1 + kappa)


def longest_run(channel):
    """Of equal values."""
    edges = np.flatnonzero(np.r_[True, np.diff(channel) != 0, True])
    return int(np.diff(edges).max())
