"""
A tumbling satellite
====================

The paper's case: 20 s of angular velocity and torque are recorded, then the torque alone says how
the target spins. The band is three standard deviations; what is in doubt is shaded.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

record = ddmhe.models.detumbling().simulate(duration=120.0, dt=0.1, noise=0.01)
history = ddmhe.History(record.x[:201], record.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
estimator = ddmhe.DdMhe(history)
log = estimator.run(record.y[200:-1])

# %%
# Estimates are those of the states after each output.

t, deg = record.t[201:], np.rad2deg(1.0)
fig, axes = plt.subplots(3, sharex=True, figsize=(8, 6), layout="constrained")
for i, (axis, name) in enumerate(zip(axes, "xyz", strict=True)):
    x, std = deg * log.x[:, i], deg * log.std[:, i]
    axis.plot(record.t[:201], deg * record.x[:201, i], color="0.5", label="recorded")
    axis.plot(t, deg * record.x[201:, i], color="0.5", linewidth=4, alpha=0.4, label="true")
    axis.plot(t, x, color="tab:blue", label="estimated")
    axis.fill_between(t, x - 3 * std, x + 3 * std, color="tab:blue", alpha=0.2, label="± 3 sd")
    axis.axvspan(t[np.argmin(log.trusted)], t[-1], color="tab:orange", alpha=0.15, label="in doubt")
    axis.set_ylabel(f"$\\omega_{name}$ (deg/s)")
    axis.set_ylim(1.3 * deg * record.x[:, i].min() - 1, 1.3 * deg * record.x[:, i].max() + 1)
axes[-1].set_xlabel("time (s)")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False)

# %%
# What the estimator says of itself:

error = np.abs(log.x - record.x[201:])
print(f"{(error < 3 * log.std).mean():.1%} of the errors within three standard deviations")
for sentence in estimator.warnings:
    print(sentence)
