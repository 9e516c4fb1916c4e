"""
The same in Rust
================

The program ``examples/1_first_estimate.rs`` of the crate ``ddmhe-core``: a pendulum near its rest
is recorded, then its state comes from the angle alone. It is run here, and what it prints is drawn.
"""

import shutil
import subprocess
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

HERE = Path.cwd().resolve()  # somewhere in a clone of the repository
ROOT = next(p for p in (HERE, *HERE.parents) if (p / "Cargo.lock").exists())
PROGRAM = ROOT / "target" / "release" / "examples" / "first_estimate"
if not PROGRAM.exists():
    cargo = shutil.which("cargo") or "cargo"
    build = [cargo, "build", "--release", "--locked", "--workspace", "--example", "first_estimate"]
    subprocess.run(build, cwd=ROOT, check=True)

# %%
printed = subprocess.run([PROGRAM], capture_output=True, text=True, check=True).stdout
print(printed)

# %%
rows = [line.split() for line in printed.splitlines()]
table = np.array([[float(cell) for cell in row] for row in rows if row[0][0].isdigit()])
t, angle, angle_hat, rate, rate_hat = table.T
fig, axes = plt.subplots(2, sharex=True, figsize=(8, 4), layout="constrained")
for axis, true, found, name in (
    (axes[0], angle, angle_hat, "angle (rad)"),
    (axes[1], rate, rate_hat, "rate (rad/s)"),
):
    axis.plot(t, true, "o", color="0.5", markersize=8, alpha=0.5, label="true")
    axis.plot(t, found, "x-", color="tab:blue", label="estimated")
    axis.set_ylabel(name)
axes[-1].set_xlabel("time (s)")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)

# %%
# The program:

print((ROOT / "examples" / "1_first_estimate.rs").read_text(encoding="utf-8"))
