"""
Beside your own filter
======================

An extended Kalman filter that knows the pendulum's equation, its damping wrong by a factor of
three, beside ``DdMhe``, which has a recording in the place of the equation.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

rng = np.random.default_rng(0)
dt, gravity = 0.05, 9.81
x = [np.array([0.6, 0.0])]
for _ in range(800):
    angle, rate = x[-1]
    rate = rate + dt * (-gravity * np.sin(angle) - 0.3 * rate)
    x.append(np.array([angle + dt * rate, rate]))
x = np.array(x)
y = np.sin(x[:-1, :1]) + 0.01 * rng.standard_normal((800, 1))


def kalman_filter(outputs, x_0, damping):
    """Rates and angles by an extended Kalman filter with this damping."""
    state, P, found = x_0.copy(), 1e-4 * np.eye(2), []
    for output in outputs:
        C = np.array([[np.cos(state[0]), 0.0]])
        K = P @ C.T / (C @ P @ C.T + 1e-4)
        state = state + K[:, 0] * (output[0] - np.sin(state[0]))
        P = P - K @ C @ P
        rate = state[1] + dt * (-gravity * np.sin(state[0]) - damping * state[1])
        slope = -dt * gravity * np.cos(state[0])
        A = np.array([[1 + dt * slope, dt * (1 - dt * damping)], [slope, 1 - dt * damping]])
        state, P = np.array([state[0] + dt * rate, rate]), A @ P @ A.T + 1e-6 * np.eye(2)
        found.append(state)
    return np.array(found)


history = ddmhe.History(x[:301], y[:300], dt=dt)
ours = ddmhe.DdMhe(history).run(y[300:])
theirs = {d: kalman_filter(y[300:], x[300], d) for d in (0.3, 0.1)}

# %%
t = dt * np.arange(301, 801)
fig, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.plot(
    t, np.abs(theirs[0.1][:, 1] - x[301:, 1]), label="filter, damping wrong", color="tab:orange"
)
axis.plot(t, np.abs(theirs[0.3][:, 1] - x[301:, 1]), label="filter, equation exact", color="0.5")
axis.plot(t, np.abs(ours.x[:, 1] - x[301:, 1]), label="DdMhe", color="tab:blue")
axis.set_xlabel("time (s)")
axis.set_ylabel("error of the rate (rad/s)")
fig.legend(loc="outside upper center", ncols=3, frameon=False)

# %%
for name, found in (("exact", theirs[0.3]), ("damping wrong", theirs[0.1]), ("DdMhe", ours.x)):
    print(f"{name}: rms error of the rate {np.sqrt(np.mean((found[:, 1] - x[301:, 1]) ** 2)):.4f}")
