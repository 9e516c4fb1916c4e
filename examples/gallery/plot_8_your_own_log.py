"""
A pendulum's log, read as it is
===============================

A logger wrote a CSV: a line of units, German decimals, -9999 where it lost a sample. The first ten
seconds have the angular rate beside two accelerations; from then on the accelerations alone are
used. With a log of your own, give its path and the names of its columns.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

t = 0.02 * np.arange(1500)
angle = 0.4 * np.exp(-0.01 * t) * np.cos(2 * np.pi * t)
rate = np.gradient(angle, t)
noise = 0.02 * np.random.default_rng(0).standard_normal((2, t.size))
along = 9.81 * np.cos(angle) + rate**2 / 4 + noise[0]
across = 9.81 * np.sin(angle) + noise[1]
across[1000:1025] = -9999
rows = [
    f"{a:.2f};{b:.6f};{c:.4f};{d:.4f}".replace(".", ",")
    for a, b, c, d in zip(t, rate, along, across, strict=True)
]
folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "pendulum.csv"
path.write_text("\n".join(["time;rate;along;across", "s;rad/s;m/s2;m/s2", *rows]), encoding="utf-8")

# %%
# Reading says what it inferred; ``gaps`` and ``missing`` become "not measured".

read = ddmhe.recordings.read(
    path, state=["rate"], output=["along", "across"], history=10.0, missing=[-9999]
)
folder.cleanup()
print(read.history.T, "samples recorded,", len(read.Y), "to estimate,", read.units)

estimator = ddmhe.DdMhe(read.history)
log = estimator.run(read.Y)
error = ddmhe.report.nrmse(log.x, read.x_true)
print(f"NRMSE {error[0]:.3f}, promised {estimator.promise[0]:.3f} rad/s rms")

# %%
shown = (read.t > 18) & (read.t < 24)
fig, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.plot(read.t[shown], read.x_true[shown], color="0.5", linewidth=4, alpha=0.4, label="gyroscope")
axis.plot(read.t[shown], log.x[shown], color="tab:blue", label="from accelerations")
band = 3 * log.std[shown, 0]
axis.fill_between(
    read.t[shown], log.x[shown, 0] - band, log.x[shown, 0] + band, color="tab:blue", alpha=0.2
)
axis.axvspan(20.0, 20.5, color="tab:orange", alpha=0.2, label="one accelerometer lost")
axis.set_xlabel("time (s)")
axis.set_ylabel("rate (rad/s)")
fig.legend(loc="outside upper center", ncols=3, frameon=False)
