"""
A circuit with a probe taken off
================================

A coil and a capacitor behind a known source. In the laboratory a probe reads the capacitor's
voltage; in the product only a shunt reads the current, with offset and noise. The recording has
both; no component is known by its value.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

DT, R, L, C = 1e-5, 20.0, 2e-3, 1e-6  # s, ohm, H, F: known to the simulation alone
rng = np.random.default_rng(0)
source = np.repeat(rng.uniform(-5, 5, 40), 25)[:, None]  # V
x = np.zeros((len(source) + 1, 2))  # current (A), voltage of the capacitor (V)
for k, v in enumerate(source[:, 0]):
    i, u = x[k]
    i = i + DT / L * (v - R * i - u)
    x[k + 1] = i, u + DT / C * i
shunt = 0.1 * x[:-1, :1] + 0.02 + 0.002 * rng.standard_normal((len(source), 1))  # V

probe = x + [5e-4, 0.02] * rng.standard_normal(x.shape)

T = 500
history = ddmhe.History(
    probe[: T + 1], shunt[:T], DT, source[:T], x_units=["A", "V"], y_units="V", u_units="V"
)
estimator = ddmhe.DdMhe(history)
log = estimator.run(shunt[T:], source[T:])

# %%
t, truth = 1e3 * DT * np.arange(T + 1, len(x)), x[T + 1 :]
fig, axes = plt.subplots(2, sharex=True, figsize=(8, 4.5), layout="constrained")
for i, (axis, name) in enumerate(zip(axes, ("current (A)", "capacitor (V)"), strict=True)):
    axis.plot(t, truth[:, i], color="0.5", linewidth=4, alpha=0.4, label="true")
    axis.plot(t, log.x[:, i], color="tab:blue", label="from the shunt and the source")
    axis.set_ylabel(name)
axes[-1].set_xlabel("time (ms)")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)

# %%
# The offset of the shunt was learnt with the rest:

amps, volts = np.sqrt(np.mean((log.x - truth) ** 2, axis=0))
print(f"rms errors {1e3 * amps:.2f} mA of {1e3 * truth[:, 0].std():.0f} mA")
print(f"and {1e3 * volts:.0f} mV of {1e3 * truth[:, 1].std():.0f} mV")
print(f"{np.mean(np.abs(log.x - truth) < 3 * log.std):.1%} within three standard deviations")
