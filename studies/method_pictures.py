"""The figures of docs/pictures.md: windows of a recording, a new window made of them, its state."""

import os
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "agg")

import matplotlib.pyplot as plt
import numpy as np

from ddmhe.report.palette import COLORS, HISTORY

DOCS = Path(__file__).parents[1] / "docs"
M, T = 12, 60


def motion(start, samples, seed):
    """A swing of two states; its first is measured, with noise."""
    rng = np.random.default_rng(seed)
    A = np.array([[0.99, 0.15], [-0.15, 0.97]])
    x = [np.array(start)]
    for _ in range(samples):
        x.append(A @ x[-1])
    x = np.array(x)
    return x, x[:-1, 0] + 0.04 * rng.standard_normal(samples)


def windows(x, y):
    """Every window of M outputs and of the M+1 states around them, a row each."""
    starts = range(len(y) - M + 1)
    Y = np.array([y[k : k + M] for k in starts])
    X = np.array([x[k : k + M + 1] for k in starts])
    return Y, X


def recorded(ax, x, y):
    """The recording, and the window that slides over it."""
    t = np.arange(len(x))
    ax.plot(t, x[:, 1], color=HISTORY, label="state, recorded")
    ax.plot(t[:-1], y, ".", color="0.25", label="output, recorded")
    for k in (4, 18, 36):
        ax.axvspan(k, k + M, color=COLORS[4], alpha=0.25, linewidth=0)
    ax.set(title="1. Cut the recording into windows", xlabel="sample")
    ax.legend(frameon=False, loc="lower right", fontsize="small")


def combined(ax, Y, y):
    """Recorded windows of outputs, and the combination that fits the new outputs."""
    k = np.arange(M)
    ax.plot(k, Y[::4].T, color=HISTORY, linewidth=0.6, alpha=0.6)
    alpha = best(Y, y)
    ax.plot(k, y, ".", color="0.1", label="outputs, now")
    ax.plot(k, alpha @ Y, color=COLORS[0], linewidth=2, label="combination")
    ax.set(title="2. Combine them to fit the last outputs", xlabel="sample in the window")
    ax.legend(frameon=False, loc="lower right", fontsize="small")
    return alpha


def best(Y, y):
    """The combination nearest to y: coefficients that sum to one, steadied by a ridge."""
    mean = Y.mean(0)
    D = (Y - mean).T
    a = np.linalg.solve(D.T @ D + 0.1 * np.eye(len(Y)), D.T @ (y - mean))
    return 1 / len(Y) + a - a.mean()


def read_off(ax, alpha, X, truth):
    """The same combination of the recorded states: its end is the estimate."""
    k = np.arange(M + 1)
    ax.plot(k, X[::4, :, 1].T, color=HISTORY, linewidth=0.6, alpha=0.6)
    ax.plot(k, truth[:, 1], color="0.25", linewidth=5, alpha=0.3, label="state, true")
    states = np.tensordot(alpha, X, 1)[:, 1]
    ax.plot(k, states, color=COLORS[0], linewidth=2, label="the same combination")
    ax.plot(k[-1], states[-1], "o", color=COLORS[1], markersize=9, label="the estimate")
    ax.set(title="3. Read the state off it", xlabel="sample in the window")
    ax.legend(frameon=False, loc="lower right", fontsize="small")


def main():
    x, y = motion((1.0, 0.0), T, 0)
    truth, outputs = motion((-0.7, 0.5), M, 1)
    Y, X = windows(x, y)
    fig, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained", sharey=True)
    recorded(axes[0], x, y)
    alpha = combined(axes[1], Y, outputs)
    read_off(axes[2], alpha, X, truth)
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    fig.savefig(DOCS / "pictures-method.png", dpi=110)
    print(f"error of the state {abs((np.tensordot(alpha, X, 1) - truth)[-1, 1]):.3f}")


if __name__ == "__main__":
    main()
