"""What known inputs cost a step: `python benches/inputs.py`.

The same outputs with and without their inputs, n = 3, p = 2, m = 2, M = 20, interleaved; medians of
30 rounds of 20 000 steps."""

from time import perf_counter

import numpy as np

import ddmhe

N, P, M_INPUTS, STEPS, ROUNDS, NOISE = 3, 2, 2, 20_000, 30, 0.01
SETTINGS = {
    "default space": {},
    "default space, boxes": {"x_bounds": (-1e3, 1e3)},
    "rank 3": {"space": ddmhe.Truncated()},
}


def signals(rng, steps, matrices, x):
    """States (N+1, n), outputs (N, p) with noise, and white inputs (N, m)."""
    A, B, C, D = matrices
    u, states, outputs = rng.standard_normal((steps, M_INPUTS)), [x], []
    for k in range(steps):
        outputs.append(C @ states[-1] + D @ u[k] + NOISE * rng.standard_normal(P))
        states.append(A @ states[-1] + B @ u[k])
    return np.array(states), np.array(outputs), u


def microseconds(call):
    start = perf_counter()
    call()
    return (perf_counter() - start) / STEPS * 1e6


def main():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((N, N))
    shapes = ((N, M_INPUTS), (P, N), (P, M_INPUTS))
    matrices = (A * 0.95 / max(abs(np.linalg.eigvals(A))), *map(rng.standard_normal, shapes))
    x, y, u = signals(rng, 200, matrices, np.ones(N))
    _, Y, U = signals(rng, STEPS, matrices, x[-1])
    for states, noise in (("noisy", NOISE), ("exact", 0.0)):
        h = ddmhe.History(x + noise * rng.standard_normal(x.shape), y, u=u)
        for name, settings in SETTINGS.items():
            given = ddmhe.DdMhe(h, 20, start="recording", **settings)
            free = ddmhe.DdMhe(h.without_inputs(), 20, start="recording", **settings)
            times = [
                (microseconds(lambda e=given: e.run(Y, U)), microseconds(lambda e=free: e.run(Y)))
                for _ in range(ROUNDS)
            ]
            ratio = np.median([a / b for a, b in times])
            one, other = np.median(times, axis=0)
            print(f"{states} states, {name}: {one:.2f} against {other:.2f} us, {ratio:.2f}")


if __name__ == "__main__":
    main()
