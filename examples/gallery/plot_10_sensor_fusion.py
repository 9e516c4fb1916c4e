"""
A camera for a minute
=====================

Beside the torque a camera reads the satellite's rates once a second, for the first minute; then it
is blinded for five, and comes back. What it saw is a measured entry of the state: ``X`` beside the
outputs, NaN where it saw nothing. It serves the minute of the camera, and after it through what was
learned of the body.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

record = ddmhe.models.detumbling().simulate(duration=440.0, dt=0.1, noise=0.05)
draw = np.random.default_rng(0)
read = record.x + 1e-3 * draw.standard_normal(record.x.shape)  # what a camera would read
history = ddmhe.History(read[:201], record.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
Y, truth, t = record.y[200:-1], record.x[201:], record.t[201:]

camera = np.full((len(Y), 3), np.nan)
for first, last in ((0, 600), (3600, len(Y))):
    camera[first:last:10] = read[200 + first : 200 + last : 10]

noise = dict(x_noise=1e-3, y_noise=0.05)
without = ddmhe.RigidBodyMhe(history, **noise).run(Y)
fused = ddmhe.RigidBodyMhe(history, **noise).run(Y, X=camera)

# %%
# ``DdMhe`` takes the camera as three more outputs, which are lost most of the time. It gains
# nothing after the camera has gone: its motion is that of the recording, and nothing is learned.

both = ddmhe.History(read[:201], np.hstack([record.y[:200], read[:200]]), dt=0.1)
affine = ddmhe.DdMhe(both).run(np.hstack([Y, camera]))

# %%
deg = np.rad2deg(1.0)


def error(log):
    """Norm of the rate's error (deg/s)."""
    return deg * np.linalg.norm(log.x - truth, axis=1)


fig, axis = plt.subplots(figsize=(8, 4), layout="constrained")
for log, color, words in (
    (affine, "tab:orange", "DdMhe, torque and camera"),
    (without, "tab:cyan", "RigidBodyMhe, torque"),
    (fused, "tab:blue", "RigidBodyMhe, torque and camera"),
):
    axis.semilogy(t, error(log), color=color, linewidth=1, label=words)
for first, last in ((20, 80), (380, 440)):
    axis.axvspan(first, last, color="0.9")
axis.set_xlabel("time (s); grey: the camera sees the body")
axis.set_ylabel("error (deg/s)")
fig.legend(loc="outside upper center", ncols=3, frameon=False)

# %%
# Root-mean-square errors, deg/s, in the camera's minute, in the last minute without it, and after
# it came back:

for words, log in (("DdMhe", affine), ("torque alone", without), ("torque and camera", fused)):
    spans = (slice(0, 600), slice(3000, 3600), slice(3600, None))
    print(words, [float(f"{np.sqrt(np.mean(error(log)[k] ** 2)):.2g}") for k in spans])
