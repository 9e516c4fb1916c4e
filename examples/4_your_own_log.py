"""Your own log: a CSV with a line of units, its first seconds as the recording, estimates of the
rest.

Writes a small log to a temporary folder first, so that it runs by itself; with a log of your own,
give its path and the names of its columns."""

import tempfile
from pathlib import Path

import numpy as np

import ddmhe
from ddmhe.logs import read_log


def write_log(path: Path) -> None:
    """A pendulum of 1 Hz whose rate is logged beside the accelerations along and across the rod;
    some are lost."""
    t = 0.02 * np.arange(1500)
    angle = 0.4 * np.exp(-0.01 * t) * np.cos(2 * np.pi * t)
    rate = np.gradient(angle, t)
    noise = 0.02 * np.random.default_rng(0).standard_normal((2, t.size))
    along, across = 9.81 * np.cos(angle) + rate**2 / 4 + noise[0], 9.81 * np.sin(angle) + noise[1]
    across[700:720] = -9999  # the logger's word for "not measured"
    rows = "\n".join(
        f"{a:.2f},{b:.6f},{c:.4f},{d:.4f}"
        for a, b, c, d in zip(t, rate, along, across, strict=True)
    )
    path.write_text(f"time,rate,along,across\ns,rad/s,m/s2,m/s2\n{rows}\n")


def main() -> None:
    """Read, split, estimate, compare."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        write_log(path)
        log = read_log(path, state=["rate"], output=["along", "across"], missing=[-9999])
    split = log.fill_gaps().split(history=10.0)
    estimator = ddmhe.DdMhe(
        split.history, start="recording"
    )  # the log goes on where its history ends
    found = estimator.run(split.Y)
    assert split.x_true is not None
    error = float(ddmhe.report.nrmse(found.x, split.x_true)[0])
    print(
        f"recorded {split.history.T} samples, estimated {len(found.x)}, horizon {estimator.horizon}"
    )
    print(f"NRMSE of the rate: {error:.3f}; statuses: {', '.join(np.unique(found.status))}")
    for sentence in estimator.warnings:
        print(f"warning: {sentence}")


if __name__ == "__main__":
    main()
