"""Guaranteed intervals: a zonotope around the pendulum of the interval paper, for every disturbance
in its bounds."""

import numpy as np

import ddmhe


def main() -> None:
    """Design the observer, run it, and check that no state leaves its interval."""
    dt, steps = 0.065, 200
    A = np.array([[1.0, dt], [0.0, 1.0]])
    system = ddmhe.interval.System(
        A, [[1.0, 0.0]], np.eye(2), [[1.0]],
        f=lambda x: np.array([0.0, -dt * np.sin(x[0])]),
        jacobian=lambda lo, hi: ([[0.0, 0.0], [-dt, 0.0]], [[0.0, 0.0], [dt, 0.0]]),
        j_lo=[[0.0, 0.0], [-dt, 0.0]], j_hi=[[0.0, 0.0], [dt, 0.0]],
    )  # fmt: skip
    design = ddmhe.interval.design_observer(system)
    w_radius, v_radius = np.array([1e-3, 1e-3]), np.array([1e-2])
    observer = ddmhe.interval.IntervalObserver(
        system, design, [0.5, 0.0], [0.2, 0.2], w_radius, v_radius
    )
    rng, x = np.random.default_rng(0), np.array([0.6, 0.1])
    outside, width = 0, np.inf
    for _ in range(steps):
        y = x[:1] + v_radius * rng.uniform(-1, 1, 1)
        found = observer.step(y)  # bounds of the next state
        x = A @ x + np.array([0.0, -dt * np.sin(x[0])]) + w_radius * rng.uniform(-1, 1, 2)
        outside += int(np.any((x < found.lower) | (x > found.upper)))
        width = float(found.upper[1] - found.lower[1])
    print(
        f"gain verified: {design.verified}; {steps} steps, {outside} states outside of their "
        "interval"
    )
    print(f"last width of the interval of the rate, which is not measured: {width:.3f} rad/s")


if __name__ == "__main__":
    main()
