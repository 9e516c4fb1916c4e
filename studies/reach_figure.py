"""The figure of docs/measured/reach.md: errors over time after a recording's end."""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt

from bodies import DT, RECORDED
from ddmhe.report.palette import COLORS, HISTORY

OUT = Path(__file__).parents[1] / "docs" / "measured" / "reach.png"
WINDOW = 50
"""Samples of one point: root-mean-square over 5 s."""


def points(size):
    """Of |error| (N, B): 5th, 50th and 95th percentile of bodies at each point (3, points)."""
    parts = size[: len(size) // WINDOW * WINDOW].reshape(-1, WINDOW, size.shape[1])
    return np.percentile(np.sqrt(np.mean(parts**2, axis=1)), (5, 50, 95), axis=1)


def draw(level):
    """Median and 90 % of the bodies at one noise level."""
    made, ax = plt.subplots(figsize=(9, 4.2), layout="constrained")
    ax.axvspan(-RECORDED * DT, 0, color=HISTORY, alpha=0.25, linewidth=0)
    ax.text(-RECORDED * DT / 2, 1.3e-3, "recorded", ha="center", va="bottom", rotation=90,
            color="0.3")  # fmt: skip
    curves = {name: np.array([one.size for one in level.found[name]]).T.astype(float)
              for name in ("DdMhe", "now")}  # fmt: skip
    for name, color, size in (
        ("DdMhe", COLORS[1], curves["DdMhe"]),
        ("RigidBodyMhe", COLORS[0], curves["now"]),
        ("Cramér-Rao bound", "0.15", level.bound),
    ):
        low, middle, high = points(size)
        t = (np.arange(len(middle)) + 0.5) * WINDOW * DT
        if name != "Cramér-Rao bound":
            ax.fill_between(t, low, high, color=color, alpha=0.15, linewidth=0)
        dashed = {"linestyle": "--"} if name == "Cramér-Rao bound" else {}
        ax.plot(t, middle, color=color, linewidth=1.6, **dashed, label=name)
    ax.set(yscale="log", xlim=(-RECORDED * DT, 600), ylim=(1e-3, 50))
    ax.set(xlabel="time after the recording's end (s)", ylabel="error of the spin (deg/s)")
    ax.spines[["top", "right"]].set_visible(False)
    made.legend(loc="outside upper center", ncols=3, frameon=False)
    made.savefig(OUT, dpi=120)
