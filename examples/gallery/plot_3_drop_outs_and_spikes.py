"""
Drop-outs and spikes
====================

Two masses on springs of which one position is measured. For a while nothing is measured (NaN); one
output in fifty is a spike. A gate leaves the spikes out, and the bars grow where nothing is known.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

rng = np.random.default_rng(1)
A = np.eye(4)
step = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, -0.1, 0], [1, -2, 0, -0.1]])
for _ in range(100):  # the exponential of 0.2 times the matrix
    A = A + 0.002 * step @ A
x = [np.array([1.0, -0.5, 0.0, 0.0])]
for _ in range(500):
    x.append(A @ x[-1] + 0.02 * rng.standard_normal(4))
x = np.array(x)
y = x[:-1, :1] + 0.02 * rng.standard_normal((500, 1))

history = ddmhe.History(x[:251], y[:250], dt=0.2)
Y = y[250:].copy()
Y[rng.random(250) < 0.02] += 3.0
Y[100:130] = np.nan
plain = ddmhe.DdMhe(history).run(Y)
gated = ddmhe.DdMhe(history, gate="auto").run(Y)

# %%
t = 0.2 * np.arange(251, 501)
fig, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.axvspan(t[100], t[129], color="0.9", label="not measured")
axis.plot(t, x[251:, 1], color="0.5", linewidth=4, alpha=0.4, label="true")
axis.plot(t, plain.x[:, 1], color="tab:orange", linewidth=1, label="without a gate")
axis.plot(t, gated.x[:, 1], color="tab:blue", label="with a gate")
band = 3 * gated.std[:, 1]
axis.fill_between(t, gated.x[:, 1] - band, gated.x[:, 1] + band, color="tab:blue", alpha=0.2)
axis.set_xlabel("time (s)")
axis.set_ylabel("second position (m)")
fig.legend(loc="outside upper center", ncols=4, frameon=False)

# %%
found = gated.evidence.gated.any(axis=1)
print(f"{found.sum()} outputs left out")
for name, log in (("without a gate", plain), ("with a gate", gated)):
    print(f"{name}: rms error {np.sqrt(np.mean((log.x - x[251:]) ** 2)):.3f}")
