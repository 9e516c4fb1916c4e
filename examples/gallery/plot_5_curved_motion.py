"""
A polynomial in the place of the lines
======================================

Lorenz's system, of which the first state is measured. ``DdMhe`` is affine and loses what curves;
``LiftedMhe`` fits a polynomial to the recording and is used where held-out parts say that it is
better.
"""

import matplotlib.pyplot as plt
import numpy as np

import ddmhe


def slope(x):
    """Lorenz's equations."""
    return np.array([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])


x = [np.array([1.0, 1.0, 20.0])]
for _ in range(2000):
    z, h = x[-1], 0.01
    a = slope(z)
    b = slope(z + h / 2 * a)
    c = slope(z + h / 2 * b)
    x.append(z + h / 6 * (a + 2 * b + 2 * c + slope(z + h * c)))
x = np.array(x)[::2]
y = x[:-1, :1] + 0.1 * np.random.default_rng(0).standard_normal((1000, 1))

history = ddmhe.History(x[:501], y[:500], dt=0.02)
lifted = ddmhe.LiftedMhe(history)
log, affine = lifted.run(y[500:]), ddmhe.DdMhe(history).run(y[500:])
print(lifted.warnings[0])

# %%
t = 0.02 * np.arange(501, 1001)
fig, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.plot(t, x[501:, 2], color="0.5", linewidth=4, alpha=0.4, label="true")
axis.plot(t, affine.x[:, 2], color="tab:orange", linewidth=1, label="affine")
axis.plot(t, log.x[:, 2], color="tab:blue", linewidth=1, label="lifted")
axis.set_xlabel("time (s)")
axis.set_ylabel("third state")
fig.legend(loc="outside upper center", ncols=3, frameon=False)

# %%
for name, found in (("affine", affine), ("lifted", log)):
    print(name, ddmhe.report.nrmse(found.x, x[501:]).round(3))
