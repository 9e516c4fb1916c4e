"""Independent reference of what an estimate says about itself: a NumPy twin of the estimator with
the default rule (no bounds, no inputs).

Horizon, ρ, μ and λ are read off an estimator; scales are computed here, as docs/defaults.md has
them. All matrices are in scaled units, rows of a window ordered [x(0) … x(m), y(0) … y(m-1)].
Covariance and doubts of its estimates: evidence_of_spaces.py."""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

DELTA = np.array([-1.0, 5.0, -10.0, 10.0, -5.0, 1.0])


# --- scales ------------------------------------------------------------------------------------


def groups(units):
    """Number of the group of each channel: channels of one unit share one."""
    return [units.index(unit) if unit else i for i, unit in enumerate(units)]


def shared(values, group):
    """Each channel's mean over its group."""
    group = np.asarray(group)
    return np.array([values[group == g].mean() for g in group])


def fifth_differences(signals):
    """Variance of the white noise on each channel of some signals (N, k)."""
    found = [sum(c * z[j : len(z) - 5 + j] for j, c in enumerate(DELTA)) for z in signals]
    found = np.vstack([d for d in found if len(d)] or [np.zeros((1, signals[0].shape[1]))])
    return (found**2).mean(axis=0) / 252


def one_step(recordings):
    """What an affine step leaves of x(k+1) and y(k) (n + p), as a variance; its residuals."""
    X = np.vstack([x[:-1] for x, _ in recordings])
    Z = np.vstack([np.hstack([x[1:], y]) for x, y in recordings])
    samples, n = X.shape
    if samples <= n + 1:
        return np.ones(Z.shape[1])
    X, Z = X - X.mean(axis=0), Z - Z.mean(axis=0)
    left = Z - X @ np.linalg.lstsq(X, Z, rcond=None)[0]
    return (left**2).sum(axis=0) / (samples - n - 1)


def levelled(squares, pooled):
    """Roots of squared scales, brought to the geometric mean of the deviations."""
    return np.exp(np.mean(np.log(pooled) - 0.5 * np.log(squares))) * np.sqrt(squares)


@dataclass(frozen=True)
class Scales:
    """Mean and scale of every channel; all channels move."""

    mean_x: np.ndarray
    mean_y: np.ndarray
    s_x: np.ndarray
    s_y: np.ndarray

    @classmethod
    def of(cls, history, est):
        """Those of the rule, or of the challenger that took its place (μ is no longer .1)."""
        parts = history.recordings
        X, Y = (np.vstack([part[i] for part in parts]) for i in (0, 1))
        n = X.shape[1]
        of_x, of_y = groups(list(history.x_units)), groups(list(history.y_units))
        var_x, var_y = shared(X.var(axis=0), of_x), shared(Y.var(axis=0), of_y)
        left = shared(one_step(parts)[:n], of_x)
        s_x = levelled(np.sqrt(np.maximum(left, 1e-10 * var_x) * var_x), np.sqrt(var_x))
        noise = fifth_differences([y for _, y in parts])
        s_y = levelled(shared(np.maximum(noise, 1e-4 * Y.var(axis=0)), of_y), np.sqrt(var_y))
        own = cls(X.mean(axis=0), Y.mean(axis=0), s_x, s_y)
        if abs(est.mu - 0.1) < 1e-9:
            return own
        noise = np.maximum(noise, 1e-10 * Y.var(axis=0))
        error = held_out_error(own.scaled(parts), X.std(axis=0) / s_x, est, noise / s_y**2)
        return cls(own.mean_x, own.mean_y, s_x * np.sqrt(error), np.sqrt(noise))

    def scaled(self, parts):
        """Recordings [(x, y)] as scaled deviations."""
        return [((x - self.mean_x) / self.s_x, (y - self.mean_y) / self.s_y) for x, y in parts]


def held_out_error(parts, spread, est, noise):
    """Variances of the error that an estimate has, held out, once its prior carries that error."""
    M, rho, n = est.horizon, est.rho, parts[0][0].shape[1]
    starts = [(x, y, k) for x, y in parts for k in range(len(y) - M + 1)]
    fading = np.sqrt(rho ** np.arange(M - 1, -1, -1.0))[:, None] / np.sqrt(noise)
    U = np.array([(y[k : k + M] * fading).ravel() for _, y, k in starts])
    A = np.array([np.r_[x[k], x[k + M]] for x, _, k in starts])
    N = len(U)
    edges, gap = [-(-b * N // 6) for b in range(7)], min(3, N // 12)
    blocks = []
    for first, end in itertools.pairwise(edges):
        learnt = np.r_[0 : max(first - gap, 0), min(end + gap, N) : N]
        u, a, k = U[learnt] - U[learnt].mean(0), A[learnt] - A[learnt].mean(0), len(learnt)
        W = np.linalg.solve(u.T @ u / k + np.eye(u.shape[1]), u.T @ a / k)
        left = A[first:end] - A[learnt].mean(0) - (U[first:end] - U[learnt].mean(0)) @ W
        count = end - first
        blocks.append(((a.T @ a - a.T @ u @ W) / k, left.T @ left / count, count / N))
    P = np.diag(spread**2)
    for _ in range(12):
        following = np.zeros((n, n))
        for C, Xi, share in blocks:
            G = C[:n, :n] + P + 1e-14 * np.diag(spread**2)
            K = np.linalg.solve(G, C[:n, n:])
            cross = K.T @ Xi[:n, n:]
            following += share * (Xi[n:, n:] - cross - cross.T + K.T @ (Xi[:n, :n] + P) @ K)
        P = np.clip(0.5 * (following + following.T), -1e30, 1e30)
    return np.maximum(np.diag(P), 1e-10 * spread**2)


# --- the estimator -----------------------------------------------------------------------------


class Window:
    """The problem of depth m from scaled recordings: z = K ([x̄; y] - c), x̂(t) = c_x + B_x z.

    Phi (n, n) is the prior map, Gamma (n, m p) the gain on outputs, H (n + m p square) the hat
    matrix: fitted [x̂(0); ŷ] = c + H ([x̄; y] - c); H_nn (p, p) is the newest output's block."""

    def __init__(self, parts, m, rho, mu, lam, rounding=0.0):
        """λ = lam on ‖a‖² in scaled units, 0: exact."""
        n, p = parts[0][0].shape[1], parts[0][1].shape[1]
        self.m, self.n, self.p, self.lam = m, n, p, lam
        rows = [np.r_[x[k : k + m + 1].ravel(), y[k : k + m].ravel()]
                for x, y in parts for k in range(len(y) - m + 1)]  # fmt: skip
        W = np.array(rows)
        self.N, c = len(W), W.mean(axis=0)
        W = W - c
        if W.shape[1] < self.N:
            W = np.linalg.qr(W, mode="r")
        S, V = np.linalg.svd(W, full_matrices=False)[1:]
        floor = max(S[0] * np.finfo(float).eps * max(self.N, len(c)), rounding * self.N**0.5)
        S, V = S[floor < S], V[floor < S]
        nx = (m + 1) * n
        seen = np.r_[0:n, nx : nx + m * p]
        age = np.repeat(np.arange(m - 1, -1, -1.0), p)
        self.w = np.r_[np.full(n, 2 * rho**m), mu * rho**age]
        self.W = np.diag(self.w)
        root = np.sqrt(self.w)
        self.B = V.T * (S / np.sqrt(self.N))
        F = self.B[seen] * root[:, None]
        if lam > 0:
            normal = scipy.linalg.cho_factor(F.T @ F + lam * np.eye(len(S)))
            self.K = scipy.linalg.cho_solve(normal, F.T * root)
        else:
            self.K = np.linalg.lstsq(F, np.diag(root), rcond=1e-13)[0]
        self.rank, self.c = len(S), c
        self.c_seen, self.c_x = c[seen], c[nx - n : nx]
        self.B_seen, self.B_x = self.B[seen], self.B[nx - n : nx]
        gain = self.B_x @ self.K
        self.Phi, self.Gamma = gain[:, :n], gain[:, n:]
        self.H = self.B_seen @ self.K
        self.H_nn = self.H[-p:, -p:]
        self.loo = np.linalg.inv(np.eye(p) - self.H_nn)
        self.D = self.loo @ self.H[-p:, :n]

    def solve(self, priors, outputs):
        """Of L windows, priors (L, n), outputs (L, m p): x̂, J, ‖a‖², deleted residual ν."""
        f = np.hstack([priors, outputs]) - self.c_seen
        a = f @ self.K.T
        left = f - a @ self.B_seen.T
        J = (left**2) @ self.w
        nu = left[:, -self.p :] @ self.loo.T
        return self.c_x + a @ self.B_x.T, J, (a**2).sum(axis=1), nu

    @cached_property
    def share(self):
        """(n + m p): what a unit of variance on each entry of [x̄; y] adds to the mean of V."""
        left = np.eye(len(self.w)) - self.H
        return (self.w[:, None] * left**2).sum(axis=0) + self.lam * (self.K**2).sum(axis=0)


class Opening(Window):
    """The problem of depth m of a run from an unknown state: x̂(0) - mean weighs unit/10 Σ_x⁻¹, at
    every depth; a fitted noise of its own deviation costs `unit` = μ σ_v²."""

    def __init__(self, window, Sigma_x, unit):
        """From the window of the same depth that starts from a state."""
        self.__dict__.update(window.__dict__)
        n = self.n
        own = np.linalg.inv(np.linalg.cholesky(Sigma_x)) * np.sqrt(unit / 10)
        W = scipy.linalg.block_diag(own, np.diag(np.sqrt(window.w[n:])))
        F = W @ self.B_seen
        if self.lam > 0:
            self.K = np.linalg.solve(F.T @ F + self.lam * np.eye(self.rank), F.T @ W)
        else:
            self.K = np.linalg.lstsq(F, W, rcond=1e-13)[0]
        self.W, self.H = W.T @ W, self.B_seen @ self.K
        self.loo = np.linalg.inv(np.eye(self.p) - self.H[-self.p :, -self.p :])
        self.innovation_std = np.sqrt(unit * np.diag(self.loo) / window.w[-1])
        normal = F.T @ F + self.lam * np.eye(self.rank)
        self.covariance = unit * np.linalg.pinv(normal, rcond=1e-15, hermitian=True)

    def posterior(self, k):
        """Covariance (n, n) of x̂(k) in the window, if the problem is right."""
        B = self.B[k * self.n : (k + 1) * self.n]
        return B @ self.covariance @ B.T


def depths(M):
    """Depths that a run with the default weights grows through, ascending."""
    kept = [M]
    while kept[-1] > 1:
        d = kept[-1]
        kept.append(d - 1 if d <= 20 else max(d - -(-d // 3), 20))
    return kept[::-1]


@dataclass
class Trace:
    """A run: estimates x (N, n) of x(1), …; V, J, ‖a‖², ν (N, p), the depth of each step."""

    x: np.ndarray
    V: np.ndarray
    J: np.ndarray
    L: np.ndarray
    nu: np.ndarray
    m: np.ndarray


class Twin:
    """The estimator of `est`, built on `history` with weights="scaled" in force."""

    def __init__(self, history, est):
        """Scales and the problem of every kept depth."""
        self.scales = Scales.of(history, est)
        self.parts = self.scales.scaled(history.recordings)
        self.n, self.p, self.M = history.n, history.p, est.horizon
        self.last = history.recordings[-1][0][-1]  # where a log that goes on begins
        self.rho, self.mu, self.lam = est.rho, est.mu, est.ridge
        X, Y = (np.vstack([part[i] for part in self.parts]) for i in (0, 1))
        self.spread, self.T = X.std(axis=0), sum(len(y) for _, y in self.parts)
        self.lo, self.hi = (np.r_[f(X, axis=0), f(Y, axis=0)] for f in (np.min, np.max))
        self.noise_x = fifth_differences([x for x, _ in self.parts])
        self.noise_y = fifth_differences([y for _, y in self.parts])
        reach = [np.abs(np.vstack([part[i] for part in history.recordings])).max(0) for i in (0, 1)]
        self._reach = [((np.finfo(float).eps * r / s) ** 2).sum()
                       for r, s in zip(reach, (self.scales.s_x, self.scales.s_y),
                                       strict=True)]  # fmt: skip
        self.depths = depths(self.M)
        self.windows = {m: self.window(self.parts, m) for m in self.depths}

    def window(self, parts, m):
        """The problem of depth m from some scaled recordings."""
        x, y = self._reach
        rounding = 8 * np.sqrt(m * (x + y) + x)
        return Window(parts, m, self.rho, self.mu, self.lam, rounding)

    @cached_property
    def Sigma_x(self):
        """Covariance of the recorded states (n, n)."""
        S = np.cov(np.vstack([x for x, _ in self.parts]).T, bias=True).reshape(self.n, self.n)
        return S + 1e-9 * np.trace(S) / self.n * np.eye(self.n)

    @cached_property
    def openings(self):
        """The growing windows of a run from an unknown state, by depth."""
        deviation = np.vstack([y for _, y in self.parts]).std(axis=0)
        left = np.maximum(one_step(self.parts)[self.n :], (1e-4 * deviation) ** 2)
        unit = self.mu * left.mean()
        return {m: Opening(window, self.Sigma_x, unit) for m, window in self.windows.items()}

    def run(self, Y, x_prior):
        """From a state, through the growing windows; in scaled units but for Y and x_prior."""
        y = (np.asarray(Y) - self.scales.mean_y) / self.scales.s_y
        N, M = len(y), self.M
        x = np.zeros((N + 1, self.n))
        x[0] = (x_prior - self.scales.mean_x) / self.scales.s_x
        J, L, nu, depth = np.zeros(N), np.zeros(N), np.zeros((N, self.p)), np.zeros(N, int)
        t = 1
        while t <= N:
            m = max(d for d in self.depths if d <= t)
            end = min(t + 1 if t < M else t + M, N + 1)
            at = np.arange(t, end)
            windows = np.array([y[k - m : k].ravel() for k in at])
            x[at], J[at - 1], L[at - 1], nu[at - 1] = self.windows[m].solve(x[at - m], windows)
            depth[at - 1] = m
            t = end
        return Trace(x[1:], J + self.lam * L, J, L, nu, depth)

    def user(self, x):
        """Scaled states in the user's units."""
        return x * self.scales.s_x + self.scales.mean_x
