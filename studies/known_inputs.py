"""What known inputs are worth, and which weights serve a driven system, on linear systems whose
Kalman filter is known.

Run with `make study-inputs` (a minute or two); writes docs/inputs-study.md. Systems are random and
stable; states are disturbed, outputs noisy. Every estimator starts from the last recorded state and
sees the same 200 samples after the recording. Errors are those of the Kalman filter that knows the
model, the noise and the inputs, times the figure in the table."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import ddmhe
from ddmhe.baselines import ErrorStateKalman
from ddmhe.report.page import markdown_table

REPORT = Path(__file__).resolve().parents[1] / "docs" / "inputs-study.md"
SEEDS = range(20)
ONLINE = 200
"""Samples that are estimated."""
OUTPUT_NOISE = 0.05


@dataclass(frozen=True)
class Kind:
    """What the systems of one row have in common."""

    T: int = 150
    """Samples of the recording."""
    m: int = 1
    """Inputs."""
    recorded: str = "white"
    """Inputs in the recording: white, steps of 15 samples, a sine."""
    online: str = "white"
    """Inputs after it,"""
    times: float = 1.0
    """and how much larger."""
    w: float = 0.01
    """Deviation of the disturbance on every state."""
    read: float = 0.0
    """Deviation of the reading noise on the recorded states."""
    hidden: int = 0
    """States of the three that the recording lacks."""


@dataclass(frozen=True)
class System:
    """x⁺ = A x + B u + e + w, y = C x + D u + r + v; n = 3 states, p = 2 outputs."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    e: np.ndarray
    r: np.ndarray

    def run(self, x, u, w, rng):
        """States (len(u)+1, n) from x on, outputs (len(u), p)."""
        states, outputs = [x], []
        for now in u:
            v = OUTPUT_NOISE * rng.standard_normal(len(self.r))
            outputs.append(self.C @ states[-1] + self.D @ now + self.r + v)
            moved = self.A @ states[-1] + self.B @ now + self.e
            states.append(moved + w * rng.standard_normal(len(self.A)))
        return np.array(states), np.array(outputs)

    def kalman(self, y, u, x, w, P):
        """x̂(k+1) from y(0…k) by the filter that knows all of it; P is the covariance of x."""
        found, n, p = [], len(self.A), len(self.C)
        for now, given in zip(y, u, strict=True):
            S = self.C @ P @ self.C.T + OUTPUT_NOISE**2 * np.eye(p)
            K = np.linalg.solve(S, self.C @ P).T
            x = x + K @ (now - self.C @ x - self.D @ given - self.r)
            x = self.A @ x + self.B @ given + self.e
            P = self.A @ (P - K @ self.C @ P) @ self.A.T + w**2 * np.eye(n)
            found.append(x)
        return np.array(found)


def random_system(rng, m, n=3, p=2):
    """Spectral radius .95, all else drawn."""
    A = rng.standard_normal((n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    shapes = (n, m), (p, n), (p, m), (n,), (p,)
    return System(A, *(rng.standard_normal(shape) for shape in shapes))


def inputs(kind, samples, m, rng):
    """(samples, m) of one kind."""
    if kind == "sine":
        return np.sin(0.3 * np.arange(samples)[:, None] + np.arange(m))
    if kind == "steps":
        return np.repeat(rng.standard_normal((-(-samples // 15), m)), 15, axis=0)[:samples]
    return rng.standard_normal((samples, m))


@dataclass(frozen=True)
class Log:
    """A recording, and outputs Y (N, p), inputs U (N, m) and states (N, n) after it."""

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    Y: np.ndarray
    U: np.ndarray
    truth: np.ndarray
    least: float
    """Error of the Kalman filter that knows the model."""

    def error(self, x_hat):
        """Root mean square over the states, each over its deviation in the recording."""
        return relative(x_hat, self.truth, self.x)


def relative(x_hat, truth, recorded):
    return float(np.sqrt(np.mean((x_hat - truth) ** 2 / recorded.var(axis=0))))


def draw(kind, seed):
    """One system of a kind, recorded and run on."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, kind.m)
    n = len(system.A)
    u = inputs(kind.recorded, kind.T, kind.m, rng)
    x, y = system.run(rng.standard_normal(n), u, kind.w, rng)
    U = kind.times * inputs(kind.online, ONLINE, kind.m, rng)
    truth, Y = system.run(x[-1], U, kind.w, rng)
    read = x + kind.read * rng.standard_normal(x.shape)
    P = max(kind.read**2, 1e-12) * np.eye(n)
    seen = slice(n - kind.hidden)
    best = system.kalman(Y, U, read[-1], kind.w, P)[:, seen]
    truth, read = truth[1:, seen], read[:, seen]
    return Log(read, y, u, Y, U, truth, relative(best, truth, read))


def known(log):
    """A recording whose inputs the estimator knows, and what it is given online."""
    return ddmhe.History(log.x, log.y, u=log.u), (log.Y, log.U)


def ignored(log):
    return ddmhe.History(log.x, log.y), (log.Y,)


def as_outputs(log):
    """Inputs handed over as further outputs."""
    history = ddmhe.History(log.x, np.hstack([log.y, log.u]))
    return history, (np.hstack([log.Y, log.U]),)


SCALED = partial(ddmhe.DdMhe, weights="scaled")
RECORDED = partial(ddmhe.DdMhe, weights="recorded")

WAYS = {
    "u ignored": (ignored, ddmhe.DdMhe),
    "u ignored, scaled": (ignored, SCALED),
    "u as outputs": (as_outputs, ddmhe.DdMhe),
    "u as outputs, scaled": (as_outputs, SCALED),
    "u known": (known, ddmhe.DdMhe),
    "u known, scaled": (known, SCALED),
}
"""How u is handed over, and to whom: the default, and the weights of the scales."""
WEIGHTS = {
    "default": (known, ddmhe.DdMhe),
    "scaled": (known, SCALED),
    "recorded": (known, RECORDED),
    "ErrorStateKalman": (known, ErrorStateKalman),
}
"""All of them know u."""
EFFECTS = {
    "T = 60": Kind(T=60),
    "T = 150": Kind(),
    "T = 400": Kind(T=400),
    "T = 40, two inputs": Kind(T=40, m=2),
    "a sine recorded, steps online": Kind(recorded="sine", online="steps"),
    "three times larger online": Kind(times=3.0),
    "one of three states not recorded": Kind(hidden=1),
    "the same, T = 400": Kind(T=400, hidden=1),
    "the same, steps of 15 samples": Kind(recorded="steps", online="steps", hidden=1),
    "two of three states not recorded": Kind(hidden=2),
}
NOISES = {
    f"T = {T}, w {w:g}, x ± {read:g}": Kind(T=T, w=w, read=read)
    for T in (60, 150, 400)
    for w, read in ((0.0, 0.1), (0.01, 0.0), (0.01, 0.01), (0.01, 0.1), (0.1, 0.0), (0.1, 0.1))
}


def ratio(log, told, made):
    """Error over the Kalman filter's; infinite where the recording is refused."""
    history, online = told(log)
    try:
        return log.error(made(history).run(*online).x) / log.least
    except ddmhe.DdmheError:
        return np.inf


def taken(logs, ways):
    """How often the default takes the weights of the recording, for each way to hand u over."""
    counts = [
        sum(ddmhe.DdMhe(told(log)[0]).weights == "recorded" for log in logs)
        for told in dict.fromkeys(told for told, _ in ways.values())
    ]
    return f"{' · '.join(map(str, counts))} of {len(logs)}"


def table(ways, kinds, *, worst):
    """One row per kind: medians over the seeds, with the largest if `worst`."""
    rows = []
    for name, kind in kinds.items():
        logs = [draw(kind, seed) for seed in SEEDS]
        found = np.array([[ratio(log, *way) for way in ways.values()] for log in logs])
        pairs = zip(np.median(found, axis=0), found.max(axis=0), strict=True)
        cells = [f"{a:.3g} ({b:.3g})" if worst else f"{a:.3g}" for a, b in pairs]
        rows.append([name, *cells, taken(logs, ways)])
        print(*rows[-1], sep=" | ", flush=True)
    return markdown_table(["", *ways, "recorded by default"], rows)


def main():
    """Run everything, print it and write it to REPORT."""
    effects = table(WAYS, EFFECTS, worst=False)
    weights = table(WEIGHTS, NOISES, worst=True)
    lines = ["# Known inputs", "", PREFACE]
    lines += ["## What knowing them is worth", "", EFFECT_WORDS, *effects, ""]
    lines += ["## Which weights", "", WEIGHT_WORDS, *weights, ""]
    REPORT.write_text("\n".join(lines), encoding="utf-8")


PREFACE = """\
Printed by `make study-inputs` (studies/known_inputs.py). Random linear systems, n = 3, p = 2,
spectral radius .95, outputs ± .05, states disturbed by ± .01 and recorded exactly unless a row says
otherwise, one input. Medians over 20 seeds of the error over that of the Kalman filter that knows
model, noise and inputs; 200 samples after the recording, from its last state on; errors are root
mean squares over the states, each over its recorded deviation. Every estimator is `DdMhe(h)`,
*scaled* `DdMhe(h, weights="scaled")`; the last column counts how often the default takes the
weights of the recording.
"""
EFFECT_WORDS = """\
Recorded by default: u ignored · as outputs · known. Inputs are white unless a row says otherwise; a
state that is not recorded is missing in the errors, too.

Hand over what is known as an input, and with the whole state. Weights of the recording take what
disturbs the states and what disturbs the outputs for independent. An input that is ignored or
handed over as an output disturbs both at once, and so does a state that is not recorded. The
default refuses these weights where the two are nearly one signal ([defaults.md](defaults.md);
the limit was chosen on the systems of this page). Windows of the recording (*scaled*) hold that
dependence: where the recorded state may not be all there is, say `weights="scaled"`.
"""
WEIGHT_WORDS = """\
All of these know u. In brackets the worst of 20; w is the deviation of the disturbance, x ± that of
the reading noise on the recorded states. *ErrorStateKalman* is the Kalman filter of the identified
model with its raw residuals.

Reading noise of ± .1 is in most of these recordings more than .03 of what the states do in some
direction: the default then refuses weights of the recording that would have done as well or better.
"""

if __name__ == "__main__":
    main()
