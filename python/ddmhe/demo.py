"""The paper's main job: the 3-DOF case of Liu et al. 2026, Section IV-B, from the recording to the
figure."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from ddmhe import models, report
from ddmhe._core import DdMhe, History
from ddmhe.cases.satellite import BOX, DT, DURATION, HISTORY, PAPER, T

Array = NDArray[np.float64]

__all__ = ["DURATION", "STEPS", "Run", "run", "runs", "summary", "write"]

STEPS = round(DURATION / DT) - T
SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "paper's weights": PAPER,
}
SPANS = (20.0, 40.0, 100.0)
AXES = ("omega_x", "omega_y", "omega_z")


@dataclass(frozen=True, eq=False)
class Run:
    """One estimator's way through the experiment."""

    est: DdMhe
    x_hat: Array
    """Estimates (STEPS, 3), rad/s."""
    seconds: Array
    """Wall time of each step (STEPS,), s."""
    status: list[str]
    active: list[int]


def runs(
    noise: float, seed: int, advance: Callable[[], None]
) -> tuple[models.Recording, dict[str, Run]]:
    """Simulate with `noise` (N·m) on the torque and estimate with each of SETTINGS; `advance` is
    called every step."""
    recording = models.detumbling().simulate(DURATION, DT, noise=noise, seed=seed)
    history = recording.history(T)
    return recording, {
        name: run(history, recording.y[T:-1], given, advance) for name, given in SETTINGS.items()
    }


def run(history: History, Y: Array, given: dict[str, Any], advance: Callable[[], None]) -> Run:
    """Estimate step by step from torques Y (N, 3), as a spacecraft would."""
    est = DdMhe(history, x_bounds=(-BOX, BOX), x_center="history", start="state", **given)
    estimates, seconds = [], []
    for y_t in Y:
        begin = time.perf_counter()
        estimates.append(est.step(y_t))
        seconds.append(time.perf_counter() - begin)
        advance()
    x_hat = np.array([e.x for e in estimates])
    return Run(
        est, x_hat, np.array(seconds), [e.status for e in estimates], [e.active for e in estimates]
    )


def summary(recording: models.Recording, results: dict[str, Run], noise: float) -> Table:
    """Settings, errors in deg/s and times of every run, side by side."""
    x_true = recording.x[T + 1 :]
    columns = {
        name: _column(result, np.rad2deg(result.x_hat - x_true)) for name, result in results.items()
    }
    title = f"{HISTORY:g} s of history, torque noise {noise:g} N m; RMSE in deg/s"
    return report.table(title, columns)


def _column(result: Run, error: Array) -> dict[str, str]:
    per_axis = {
        f"RMSE {axis}": f"{value:.4f}" for axis, value in zip(AXES, report.rmse(error), strict=True)
    }
    spans = {f"RMSE norm {s:g} s": f"{report.rmse_norm(error[: round(s / DT)]):.4f}" for s in SPANS}
    median, slow = np.percentile(result.seconds, [50, 99]) * 1e6
    times = {"step median": f"{median:.2g} us", "step 99 %": f"{slow:.2g} us"}
    return {
        **report.settings(result.est),
        **per_axis,
        **spans,
        **times,
        **report.outcome(result.status, result.active),
    }


def write(directory: Path, recording: models.Recording, results: dict[str, Run]) -> list[Path]:
    """The defaults' estimates as estimate.csv (rad/s) and a figure of all runs as estimate.png;
    their paths."""
    from ddmhe.report.figures import estimate_figure

    directory.mkdir(parents=True, exist_ok=True)
    csv, png = directory / "estimate.csv", directory / "estimate.png"
    t, x_true, x_hat = recording.t[T + 1 :], recording.x[T + 1 :], results["defaults"].x_hat
    report.write_estimates(csv, "time_s", t, [f"{axis}_rad_s" for axis in AXES], x_hat)
    errors = {
        name: np.linalg.norm(np.rad2deg(r.x_hat - x_true), axis=1) for name, r in results.items()
    }
    figure = estimate_figure(
        t,
        np.rad2deg(x_hat),
        np.rad2deg(x_true),
        history=(recording.t[: T + 1], np.rad2deg(recording.x[: T + 1])),
        names=AXES,
        quantity="angular velocity (deg/s)",
        errors=errors,
    )
    report.save_figure(figure, png)
    return [csv, png]
