"""Independent reference of runs that doubt outputs, restart, and find out where a log begins.

On the twin of evidence_reference.py, in its scaled units. A rejected output is one that takes its
leave-out prediction: f_q ← f_q - (I - H_qq)⁻¹ e_q, e = f - H f, which is the problem solved without
it."""

from dataclasses import dataclass, field

import numpy as np

from evidence_of_spaces import Evidence, joined
from evidence_reference import Opening

GATE = 4.0
RESTART = 4


@dataclass
class Run:
    """What a gated run has seen so far; x, past and Sigma start at t = 0."""

    x: list
    Sigma: list
    past: list
    """x as later windows remember it: smoothed by those that grow from an unknown state."""
    start: int = 0
    growing: bool = False
    c2: float = 1.0
    V: list = field(default_factory=list)
    smoothed: list = field(default_factory=list)
    rejected: list = field(default_factory=list)
    restarts: list = field(default_factory=list)
    count: np.ndarray | None = None
    sign: np.ndarray | None = None


class Gated:
    """Runs of a twin from a state or, with x_prior None, from an unknown one."""

    def __init__(self, evidence: Evidence, gate=GATE):
        """`gate`: k, or None for every output to be believed."""
        self.evidence, self.twin, self.gate = evidence, evidence.twin, gate

    def run(self, Y, x_prior=None):
        """A Run over Y (N, p), in the user's units; estimates are scaled."""
        twin, scales = self.twin, self.twin.scales
        self.y = (np.asarray(Y) - scales.mean_y) / scales.s_y
        self.goes_on = x_prior is not None and np.array_equal(x_prior, twin.last)
        if x_prior is None:
            run = Run([np.zeros(twin.n)], [10 * twin.Sigma_x], [np.zeros(twin.n)], growing=True)
        else:
            x = (x_prior - scales.mean_x) / scales.s_x
            run = Run([x], [self.evidence.P0], [x])
        run.count, run.sign = np.zeros(twin.p, int), np.zeros(twin.p)
        self.kept = np.ones(self.y.shape, bool)
        for t in range(1, len(self.y) + 1):
            self.step(run, t)
        run.rejected = ~self.kept
        return run

    def setup(self, run, t):
        """The window of step t, its prior and the covariance of that; None where the window's own
        posterior says what the prior is worth."""
        twin, outputs = self.twin, min(t - run.start, self.twin.M)
        m = max(d for d in twin.depths if d <= outputs)
        after = t - run.start - m  # samples since such a window was full for the first time
        if run.growing and after == 0:
            return twin.openings[m], run.past[run.start], None
        if run.growing and after <= m and t - run.start <= 2 * twin.M:
            prior, Sigma = run.smoothed[after]
            return twin.windows[m], prior, Sigma
        return twin.windows[m], run.x[t - m], run.Sigma[t - m]

    def step(self, run, t):
        """One output more."""
        n, p = self.twin.n, self.twin.p
        window, prior, Sigma = self.setup(run, t)
        first = run.growing and t - run.start == 1
        if self.gate is not None and not first and self.doubt(run, t, window, prior):
            window, prior, Sigma = self.setup(run, t)
        m = window.m
        f = np.r_[prior, self.y[t - m : t].ravel()] - window.c_seen
        out = n + np.flatnonzero(~self.kept[t - m : t].ravel())
        f[out] -= deleted(window, f, out)
        a = window.K @ f
        left = f - window.B_seen @ a
        V = (left @ window.W @ left + window.lam * a @ a) * m * p / max(m * p - len(out), 1)
        x = window.c_x + window.B_x @ a
        V0, Q0 = self.evidence.sizes(m)
        Q = self.evidence.stretched(V / V0, x, self.since(run, t)) * Q0
        run.V.append(V)
        run.x.append(x)
        run.past.append(x)
        if Sigma is not None:
            A = window.Phi @ Sigma @ window.Phi.T
            run.Sigma.append(joined(A, Q, self.twin.spread))
            return
        spread, states = self.twin.spread, (window.c + window.B @ a)[: (m + 1) * n].reshape(-1, n)
        told = [joined(window.posterior(k), Q, spread) for k in range(m + 1)]
        run.past[run.start + 1 : t] = states[1:-1]
        run.smoothed = list(zip(states, told, strict=True))
        run.Sigma.append(told[-1])

    def since(self, run, t):
        """Samples since the recording's end; its length for a run that did not begin there."""
        return t if self.goes_on and not run.restarts else self.twin.T

    def doubt(self, run, t, window, prior):
        """Rejects what is far from what all others say; whether that made the run start again."""
        n, p, m, M = self.twin.n, self.twin.p, window.m, self.twin.M
        f = np.r_[prior, self.y[t - m : t].ravel()] - window.c_seen
        kept = self.kept[t - m : t].copy()
        kept[-1] = False
        nu = deleted(window, f, n + np.flatnonzero(~kept.ravel()))[-p:]
        size = self.evidence.innovation_std(m)
        if isinstance(window, Opening) and not run.restarts:  # its prior knows nothing
            size = np.maximum(size, window.innovation_std)
        r = np.abs(nu) / (np.sqrt(run.c2) * size)
        run.c2 = max(1.0, run.c2 + (np.minimum(r**2, 9).mean() - 1) * run.c2 / M)
        bad = r > self.gate
        sign = np.sign(nu) * bad
        run.count = np.where(bad, np.where(sign == run.sign, run.count + 1, 1), 0)
        run.sign, self.kept[t - 1] = sign, ~bad
        if run.count.max() < RESTART:
            return False
        run.start, run.growing, run.c2 = t - RESTART, True, 1.0
        run.Sigma[run.start] = 10 * self.twin.Sigma_x
        run.restarts.append(t)
        run.count[:] = 0
        self.kept[run.start : t] = True
        return True


def deleted(window, f, rows):
    """Residuals of these rows of f when the problem is solved without them."""
    e = f - window.H @ f
    return np.linalg.solve(np.eye(len(rows)) - window.H[np.ix_(rows, rows)], e[rows])


def goes_on(evidence, Y):
    """The step at which a log turns out not to go on from the recording's end; 0 if it goes on."""
    twin = evidence.twin
    M, p, window = twin.M, twin.p, twin.windows[twin.M]
    x, y = twin.parts[-1]
    outputs = np.vstack([y[-M:], (np.asarray(Y) - twin.scales.mean_y) / twin.scales.s_y])
    limits, sizes = np.array(evidence.limits(M)) / 2, evidence.innovation_std(M)
    for t in range(1, M + 1):
        f = np.r_[x[len(x) - 1 - M + t], outputs[t : t + M].ravel()] - window.c_seen
        a = window.K @ f
        left = f - window.B_seen @ a
        J = float(left @ window.W @ left)
        far = np.abs(window.loo @ left[-p:]) > 5 * sizes
        if J + window.lam * a @ a > limits[0] or limits[1] < J or far.any():
            return t
    return 0
