"""What known inputs cost a step: `python benches/inputs.py`.

The same outputs with and without their inputs, n = 3, p = 2, m = 2, M = 20, interleaved; medians of
30 rounds of 20 000 steps, and the 99th percentile of their ratios. A fourth state that is not
recorded makes a response of two instants."""

from time import perf_counter

import numpy as np

import ddmhe

N, P, M_INPUTS, STEPS, ROUNDS, NOISE = 3, 2, 2, 20_000, 30, 0.01
RANK_3 = ddmhe.Truncated(3)
SETTINGS = {
    "default space": {},
    "default space, boxes": {"x_bounds": (-1e3, 1e3)},
    "rank 3": {"space": RANK_3, "evidence": False},
    "rank 3, evidence": {"space": RANK_3},
}


def signals(rng, steps, matrices, x):
    """States (N+1, n), outputs (N, p) with noise, and white inputs (N, m)."""
    A, B, C, D = matrices
    u, states, outputs = rng.standard_normal((steps, M_INPUTS)), [x], []
    for k in range(steps):
        outputs.append(C @ states[-1] + D @ u[k] + NOISE * rng.standard_normal(P))
        states.append(A @ states[-1] + B @ u[k])
    return np.array(states), np.array(outputs), u


def system(rng, n):
    """A, B, C and D of n states; the largest eigenvalue of A has modulus .95."""
    A = rng.standard_normal((n, n))
    shapes = ((n, M_INPUTS), (P, n), (P, M_INPUTS))
    return (A * 0.95 / max(abs(np.linalg.eigvals(A))), *map(rng.standard_normal, shapes))


def microseconds(estimator, *log):
    start = perf_counter()
    estimator.run(*log)
    return (perf_counter() - start) / STEPS * 1e6


def main():
    cases = {
        "noisy states": (N, NOISE),
        "exact states": (N, 0.0),
        "two instants": (N + 1, NOISE),
    }
    for kind, (n, noise) in cases.items():
        rng = np.random.default_rng(0)
        matrices = system(rng, n)
        x, y, u = signals(rng, 200, matrices, np.ones(n))
        _, Y, U = signals(rng, STEPS, matrices, x[-1])
        recorded = x[:, :N]
        h = ddmhe.History(recorded + noise * rng.standard_normal(recorded.shape), y, u=u)
        for name, settings in SETTINGS.items():
            given = ddmhe.DdMhe(h, 20, start="recording", **settings)
            free = ddmhe.DdMhe(h.without_inputs(), 20, start="recording", **settings)
            times = [(microseconds(given, Y, U), microseconds(free, Y)) for _ in range(ROUNDS)]
            ratios = [a / b for a, b in times]
            one, other = np.median(times, axis=0)
            print(
                f"{kind}, {name}: {one:.2f} against {other:.2f} us, {np.median(ratios):.2f}, "
                f"p99 {np.percentile(ratios, 99):.2f}"
            )


if __name__ == "__main__":
    main()
