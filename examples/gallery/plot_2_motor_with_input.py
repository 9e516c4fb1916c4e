"""
A motor whose voltage is known
==============================

The speed of a motor from its current. The voltage drives it and is known: without it, the same
current may mean any speed.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

rng = np.random.default_rng(0)
volts = np.repeat(rng.uniform(-1, 1, 60), 10)[:, None]
speed = np.zeros((601, 1))
for k in range(600):
    speed[k + 1] = 0.95 * speed[k] + 0.5 * volts[k] + 0.02 * rng.standard_normal()
current = volts - 0.09 * speed[:-1] + 0.02 * rng.standard_normal((600, 1))

known = ddmhe.History(speed[:301], current[:300], 0.1, volts[:300])
ignored = ddmhe.History(speed[:301], current[:300], 0.1)
with_u = ddmhe.DdMhe(known).run(current[300:], volts[300:])
without = ddmhe.DdMhe(ignored).run(current[300:])

# %%
t, truth = 0.1 * np.arange(301, 601), speed[301:, 0]
fig, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.plot(t, truth, color="0.5", linewidth=4, alpha=0.4, label="true")
axis.plot(t, without.x[:, 0], color="tab:orange", label="voltage ignored")
axis.plot(t, with_u.x[:, 0], color="tab:blue", label="voltage known")
axis.set_xlabel("time (s)")
axis.set_ylabel("speed (rad/s)")
fig.legend(loc="outside upper center", ncols=3, frameon=False)

# %%
for name, log in (("known", with_u), ("ignored", without)):
    print(f"voltage {name}: rms error {np.sqrt(np.mean((log.x[:, 0] - truth) ** 2)):.3f} rad/s")
