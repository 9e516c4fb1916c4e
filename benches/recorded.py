"""What a step costs with the weights of the recording: `python benches/recorded.py`.

Two coupled modes and a slow one, n = 3, p = 2, M = 20, interleaved with the default rule's ridge;
without evidence, save for one row. Medians and 99th percentiles of 60 rounds of 20 000 steps, in
nanoseconds a step."""

from time import perf_counter

import numpy as np

import ddmhe

ROUNDS, STEPS, SAMPLES, DISTURBANCE, NOISE = 60, 20_000, 400, 0.05, 0.05


def signals(rng, steps):
    """States (N+1, n) that noise drives, and outputs (N, p) with noise."""
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    A = np.zeros((3, 3))
    A[:2, :2], A[2, 2], A[0, 2] = 0.98 * turn, 0.9, 0.2
    C = np.array([[1.0, 0.0, 0.3], [0.0, 0.5, 1.0]])
    x = [np.ones(3)]
    for _ in range(steps):
        x.append(A @ x[-1] + DISTURBANCE * rng.standard_normal(3))
    states = np.array(x)
    return states, states[:-1] @ C.T + NOISE * rng.standard_normal((steps, 2))


def main():
    rng = np.random.default_rng(0)
    x, y = signals(rng, SAMPLES + STEPS)
    history = ddmhe.History(x[: SAMPLES + 1], y[:SAMPLES])
    recorded = {"weights": "recorded", "horizon": 20}
    scaled = {"weights": "scaled", "horizon": 20}
    kinds = {
        "x alone": recorded,
        "boxes far away": {**recorded, "x_bounds": (-1e3, 1e3)},
        "ridge, x and window": scaled,
        "ridge and disturbance": {**scaled, "process_noise": "residual"},
    }
    kinds = {name: {**given, "evidence": False} for name, given in kinds.items()}
    kinds["x and evidence"] = recorded
    estimators = {name: ddmhe.DdMhe(history, **given) for name, given in kinds.items()}
    gaps = y[SAMPLES:].copy()
    gaps[::50, 0] = np.nan
    logs = {name: y[SAMPLES:] for name in kinds} | {"lost outputs": gaps}
    estimators["lost outputs"] = ddmhe.DdMhe(history, **recorded, evidence=False)
    times = {name: [] for name in estimators}
    for _ in range(ROUNDS):
        for name, estimator in estimators.items():
            start = perf_counter()
            estimator.run(logs[name])
            times[name].append((perf_counter() - start) / STEPS * 1e9)
    for name, of in times.items():
        print(f"{name:22s} {np.median(of):7.0f} ns, p99 {np.percentile(of, 99):7.0f}")


if __name__ == "__main__":
    main()
