"""The picture of the README: a satellite's spin beyond its recording, by both estimators.

Writes docs/first-picture.png and prints the errors that stand below it.
"""

import os
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "agg")

import matplotlib.pyplot as plt
import numpy as np

import ddmhe
from ddmhe.report.palette import COLORS, HISTORY

OUT = Path(__file__).parents[1] / "docs" / "first-picture.png"
RECORDED, SECONDS, AXIS, DEG = 200, 120, 1, float(np.rad2deg(1.0))


def estimates():
    """The record, and the logs of DdMhe and RigidBodyMhe from 20 s on."""
    record = ddmhe.models.detumbling().simulate(
        duration=SECONDS, dt=0.1, noise=0.01, integrator="accurate"
    )
    noise = 1e-4 * np.random.default_rng([0, 1]).standard_normal((RECORDED + 1, 3))
    history = ddmhe.History(
        record.x[: RECORDED + 1] + noise,
        record.y[:RECORDED],
        dt=0.1,
        x_units="rad/s",
        y_units="N m",
    )
    outputs = record.y[RECORDED:-1]
    return record, ddmhe.DdMhe(history).run(outputs), ddmhe.RigidBodyMhe(history).run(outputs)


def draw(record, affine, rigid):
    """Rates and their bands above, errors below."""
    t = record.t[RECORDED + 1 :]
    fig, (above, below) = plt.subplots(
        2, sharex=True, figsize=(9, 5.2), height_ratios=(2, 1), layout="constrained"
    )
    above.axvspan(0, record.t[RECORDED], color=HISTORY, alpha=0.25, linewidth=0)
    below.axvspan(0, record.t[RECORDED], color=HISTORY, alpha=0.25, linewidth=0)
    truth = DEG * record.x[:, AXIS]
    above.plot(record.t, truth, color="0.25", linewidth=4, alpha=0.35, label="true")
    for log, color, name in ((affine, COLORS[1], "DdMhe"), (rigid, COLORS[0], "RigidBodyMhe")):
        x, std = DEG * log.x[:, AXIS], DEG * log.std[:, AXIS]
        above.fill_between(t, x - 3 * std, x + 3 * std, color=color, alpha=0.18, linewidth=0)
        above.plot(t, x, color=color, linewidth=1.3, label=f"{name}, band ± 3 sd")
        error = DEG * np.linalg.norm(log.x - record.x[RECORDED + 1 :], axis=1)
        below.semilogy(t, error, color=color, linewidth=0.9)
    doubt = t[np.argmin(affine.trusted)]
    for axis in (above, below):
        axis.axvline(doubt, color="0.3", linestyle=":")
        axis.spines[["top", "right"]].set_visible(False)
    low, high = truth.min(), truth.max()
    low, high = low - 0.35 * (high - low), high + 0.35 * (high - low)
    above.set(ylim=(low, high), ylabel="spin about y (deg/s)", xlim=(0, record.t[-1]))
    below.set(ylabel="error (deg/s)", xlabel="time (s)", ylim=(1e-3, 30))
    middle = record.t[RECORDED] / 2
    room = 0.03 * (high - low)
    above.text(middle, high - room, "recorded", ha="center", va="top", color="0.3")
    above.text(doubt + 1, low + room, "from here on DdMhe says: unlike the recording", color="0.3")
    fig.legend(loc="outside upper center", ncols=3, frameon=False)
    fig.savefig(OUT, dpi=120)


def main():
    record, affine, rigid = estimates()
    draw(record, affine, rigid)
    for name, log in (("DdMhe", affine), ("RigidBodyMhe", rigid)):
        error = DEG * np.linalg.norm(log.x - record.x[RECORDED + 1 :], axis=1)
        rms = [float(np.sqrt(np.mean(error[:k] ** 2))) for k in (200, 400, 1000)]
        inside = np.mean(np.abs(log.x - record.x[RECORDED + 1 :]) < 3 * log.std)
        print(f"{name}: {rms[0]:.3f}, {rms[1]:.3f}, {rms[2]:.3f} deg/s, 3 sd hold {inside:.1%}")
    print(f"in doubt from {history_end(affine):.1f} s after the recording on")


def history_end(log):
    """Seconds after the recording at which the log is in doubt first."""
    return 0.1 * (int(np.argmin(log.trusted)) + 1)


if __name__ == "__main__":
    main()
