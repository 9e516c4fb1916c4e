"""What the attacks on the Python interface share: arrays that no sane caller gives, and plain
estimators beside which each step is held."""

import numpy as np

import ddmhe
from disturbed import Noisy, fitted, following, stationary
from reference import random_system

HUGE = np.finfo(float).max
ODD = (np.nan, np.inf, -np.inf, HUGE, -HUGE, 1e300, 5e-324, -0.0, 1e15, 2**63, 1e-154)

WRONG = (
    None,
    "outputs",
    b"\x00\x01",
    object(),
    {},
    [[]],
    [],
    [None, "x", 3],
    np.array(["1", "2"]),
    np.array([object(), object()], dtype=object),
    np.zeros(0),
    np.zeros(7),
    np.zeros((2, 2, 2)),
    np.zeros((3, 5)),
    np.array([1j, 2.0]),
    np.full(2, np.inf),
    np.array(["2026-01-01"], dtype="datetime64[s]"),
    np.float64(3.0),
    float,
    10**400,
    [10**400, 1.0],
    lambda: 0,
)
"""No sample of two or more channels."""


class Unkind:
    """Something that says that it is an array and fails when it is asked for it."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("no")


class Sequence:
    """A sequence whose length is not what it holds."""

    def __len__(self):
        return 2

    def __getitem__(self, k):
        return [1.0, 2.0, 3.0][k]


def dressed(values, kind):
    """The same numbers as another kind of array."""
    values = np.asarray(values, float)
    wide = np.zeros((*values.shape, 3))
    wide[..., 1] = values
    return [
        values,
        values.tolist(),
        tuple(values.tolist()),
        wide[..., 1],
        np.asfortranarray(values),
        values[::-1].copy()[::-1],
        values.astype(object),
        values.astype(">f8"),
        np.ma.masked_invalid(values),
        values.astype(np.longdouble),
    ][kind % 10]


class LeastSquares:
    """(16), (17) of a known system without bounds, by least squares on the oldest state of the
    window; nothing of the package in it."""

    def __init__(self, system, M, rho, mu, prior):
        self.system, self.M, self.rho, self.mu = system, M, rho, mu
        self.states, self.outputs = [np.asarray(prior, float)], []

    def step(self, y, depth):
        """x̂(t) and the window from the last `depth` outputs, NaN: not measured."""
        s, n = self.system, len(self.system.e)
        self.outputs.append(np.array(y, float))
        window = self.outputs[len(self.outputs) - depth :]
        prior = self.states[len(self.outputs) - depth]
        root = np.sqrt(2 * self.rho**depth)
        rows, right = [root * np.eye(n)], [root * prior]
        power, offset = np.eye(n), np.zeros(n)
        motion = [(power, offset)]
        for k, sample in enumerate(window):
            seen, root = ~np.isnan(sample), np.sqrt(self.mu * self.rho ** (depth - 1 - k))
            rows.append(root * (s.C @ power)[seen])
            right.append(root * (sample - s.C @ offset - s.r)[seen])
            power, offset = s.A @ power, s.A @ offset + s.e
            motion.append((power, offset))
        first = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
        states = np.array([power @ first + offset for power, offset in motion])
        self.states.append(states[-1])
        return states


class KalmanFilter:
    """Of a model fitted to a recording, one step at a time; NaN: not measured."""

    def __init__(self, case, Q):
        self.model, self.Q = fitted(case.history), Q
        self.P_0 = stationary(self.model, Q)

    def start(self, x):
        self.x, self.P = np.asarray(x, float), self.P_0

    def step(self, y, u):
        model, seen = self.model, ~np.isnan(y)
        C, R = model.C[seen], model.R[np.ix_(seen, seen)]
        gain = self.P @ C.T @ np.linalg.inv(C @ self.P @ C.T + R)
        x = self.x + gain @ (y - model.C @ self.x - model.D @ u - model.r)[seen]
        self.x = model.A @ x + model.B @ u + model.e
        self.P = following(model, self.Q, self.P, seen)
        return self.x


def known_system(seed):
    """A system, an exact recording of it, and 200 noisy outputs that follow."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, int(rng.integers(1, 4)), 2)
    x, y = system.simulate(rng.standard_normal(len(system.e)) * 2, 60)
    _, later = system.simulate(x[-1], 200)
    return system, ddmhe.History(x, y), later + 0.05 * rng.standard_normal(later.shape)


def noisy_system(seed):
    """A noisy recording of two outputs or more, with and without inputs, and the noise Q."""
    for number in range(100 * seed, 100 * seed + 100):
        case = Noisy.random(number, inputs=seed % 2 == 0, steps=200)
        if case.Y.shape[1] == 2:
            root = np.random.default_rng(seed).standard_normal((len(case.e), len(case.e)))
            return case, 0.05**2 * (root @ root.T + 0.1 * np.eye(len(case.e)))
    raise AssertionError("no case")


def bits(e):
    """Of every number of an estimate, one for all NaN."""
    parts = [e.x, e.window, e.v, [e.cost], [] if e.w is None else e.w]
    numbers = np.concatenate([np.ravel(part) for part in parts])
    return np.where(np.isnan(numbers), np.nan, numbers).tobytes(), e.status, e.active
