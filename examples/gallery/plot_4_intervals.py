"""
Guaranteed intervals
====================

The pendulum of the interval paper: bounds that hold for every motion that the stated disturbance
and noise allow, at every sample, rounding included.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

system = ddmhe.interval.pendulum()
gain = ddmhe.interval.design_observer(system)
observer = ddmhe.interval.IntervalObserver(
    system, gain, [0.98, 0.02], [0.1, 1.0], w_radius=0.006, v_radius=0.01
)
print("verified:", gain.verified)

rng = np.random.default_rng(0)
x, y = [np.array([1.0, 0.0])], []
for _ in range(200):
    y.append(system.C @ x[-1] + system.D2 @ rng.uniform(-0.01, 0.01, system.D2.shape[1]))
    x.append(
        system.A @ x[-1]
        + system.f(x[-1])
        + system.D1 @ rng.uniform(-0.006, 0.006, system.D1.shape[1])
    )
log = observer.run(np.array(y))
truth = np.array(x[1:])

# %%
fig, axes = plt.subplots(2, sharex=True, figsize=(8, 4.5), layout="constrained")
for i, (axis, name) in enumerate(zip(axes, ("angle (rad)", "rate (rad/s)"), strict=True)):
    axis.fill_between(np.arange(200), log.lower[:, i], log.upper[:, i], alpha=0.3, label="interval")
    axis.plot(truth[:, i], color="k", linewidth=1, label="true")
    axis.set_ylabel(name)
axes[1].set_xlabel("sample")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)

# %%
inside = (log.lower <= truth) & (truth <= log.upper)
print(f"{inside.all(axis=1).mean():.0%} of the states inside")
