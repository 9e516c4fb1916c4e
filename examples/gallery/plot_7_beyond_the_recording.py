"""
Ten minutes after twenty seconds
================================

The same satellite, for ten minutes. ``DdMhe`` is affine and right near its recording;
``RigidBodyMhe`` knows Euler's equation beforehand, and nothing else: inertia, field, conductivity
and offsets are fitted to the same twenty seconds.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

record = ddmhe.models.detumbling().simulate(
    duration=620.0, dt=0.1, noise=0.01, integrator="accurate"
)
x = record.x[:201] + 1e-4 * np.random.default_rng(0).standard_normal((201, 3))  # read with noise
history = ddmhe.History(x, record.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
truth = record.x[201:]

affine = ddmhe.DdMhe(history).run(record.y[200:-1])
body = ddmhe.RigidBodyMhe(history)
rigid = body.run(record.y[200:-1])

# %%
t, deg = record.t[201:], np.rad2deg(1.0)
fig, axes = plt.subplots(2, sharex=True, figsize=(8, 5.5), layout="constrained")
axes[0].plot(t, deg * truth[:, 0], color="0.5", linewidth=4, alpha=0.4, label="true")
axes[0].plot(t, deg * affine.x[:, 0], color="tab:orange", label="DdMhe")
axes[0].plot(t, deg * rigid.x[:, 0], color="tab:blue", label="RigidBodyMhe")
axes[0].set_ylabel("$\\omega_x$ (deg/s)")
reach = 1.3 * deg * np.abs(truth[:, 0]).max()
axes[0].set_ylim(-reach, reach)
for log, color in ((affine, "tab:orange"), (rigid, "tab:blue")):
    axes[1].semilogy(t, deg * np.linalg.norm(log.x - truth, axis=1), color=color, linewidth=1)
axes[1].set_ylabel("error (deg/s)")
axes[1].set_xlabel("time (s)")
for axis in axes:
    axis.axvspan(0, 20, color="0.9")
    left = t[np.argmin(affine.trusted)]
    axis.axvline(left, color="0.3", linestyle=":", label="the motion leaves the recording")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)

# %%
# Root-mean-square errors of the rate's norm, deg/s:

for name, log in (("DdMhe", affine), ("RigidBodyMhe", rigid)):
    error = deg * np.linalg.norm(log.x - truth, axis=1)
    spans = (200, 400, 1000, 6000)
    words = ", ".join(f"{np.sqrt(np.mean(error[:k] ** 2)):.3f} over {k // 10} s" for k in spans)
    print(f"{name}: {words}")

# %%
# What it found out of the body:

for sentence in body.report().words:
    print(sentence)
