"""
Forty benches, two estimators
=============================

One run says little. A campaign draws many cases, here the paper's single-axis bench with another
target, magnet, speed and noise each time, and keeps a row for every one. ``ddmhe.campaign`` runs
them on all cores, or on a cluster, and goes on where it was stopped.
"""

import tempfile

import matplotlib.pyplot as plt
import numpy as np

import ddmhe

spec = {
    "seeds": 40,
    "batch": 10,
    "systems": {"bench": {}},
    "noise": {"usual": {"x": 1e-3, "y": 1e-3}},
    "estimators": {"DdMhe": {"knows_noise": True}, "ErrorStateKalman": {}},
}


def main():
    """Runs all cases; draws how large the errors are."""
    with tempfile.TemporaryDirectory() as folder:
        rows = ddmhe.campaign.run(spec, f"{folder}/benches", workers=2).rows
    _, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    by_estimator = rows.groupby("estimator")
    for color, (name, own) in zip(("tab:blue", "tab:orange"), by_estimator, strict=True):
        errors = np.sort(own["rmse_all"])
        axis.step(errors, np.arange(1, len(errors) + 1) / len(errors), color=color, label=name)
        print(f"{name}: median {np.median(errors):.4f} rad/s, worst {errors[-1]:.4f}")
    axis.set_xscale("log")
    axis.set_xlabel("root-mean-square error of a case (rad/s)")
    axis.set_ylabel("share of cases below")
    axis.legend(frameon=False)


# %%
# Processes are started, so that a script runs under this line:

if __name__ == "__main__":
    main()
