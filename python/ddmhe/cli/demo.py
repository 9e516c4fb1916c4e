"""``ddmhe demo``: the 3-DOF case of Liu et al. 2026, Section IV-B, from the recording to the
figure."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from ddmhe import models, report
from ddmhe._core import DdMhe, History
from ddmhe.cases.satellite import BOX, DT, DURATION, HISTORY, PAPER, T
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import directory_option
from ddmhe.cli.telling import in_words_of
from ddmhe.logs import Names
from ddmhe.reasons import Reason
from ddmhe.report.trust import BARS, Trust

Array = NDArray[np.float64]

__all__ = ["command"]


STEPS = round(DURATION / DT) - T
"""Steps that are estimated."""
SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "paper's weights": PAPER,
}
"""Keywords of DdMhe of each run."""
SPANS = (20.0, 40.0, 100.0)
"""What errors are taken over, s from the end of the recording."""
AXES = ("omega_x", "omega_y", "omega_z")
"""Names of the states."""
NAMES = Names("time", AXES, ("torque_x", "torque_y", "torque_z"))
"""What warnings call them and the outputs."""


@click.command("demo", short_help="The paper's satellite: simulated, recorded, estimated.")
@directory_option("ddmhe-demo")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the torque noise.",
)
@click.option("--noise", type=float, default=0.01, show_default=True, help="Torque noise, N m.")
@answers
def command(answer: Answer, out: Path, seed: int, noise: float) -> None:
    """Estimate the spin of a tumbling satellite from the braking torque alone (the paper's 3-DOF
    case).

    Records 20 s, estimates the next 100 s step by step, and writes estimate.csv and estimate.png
    into DIR."""
    total = STEPS * len(SETTINGS)
    with answer.working("estimating") as advance:
        done = count(1)
        recording, results = _runs(noise, seed, lambda: advance(next(done), total))
    written = _write(out, recording, results)
    answer.show(_summary(recording, results, noise))
    runs = {}
    for name, result in results.items():
        error = np.rad2deg(result.x_hat - recording.x[T + 1 :])
        answer.say(f"{name}: {_trust_words(result, error)}")
        runs[name] = _facts(result, error)
    answer.facts(noise=noise, seed=seed, runs=runs)
    for name, result in results.items():
        for sentence in in_words_of(NAMES, result.est.warnings):
            answer.warn(f"{name}: {sentence}")
    answer.wrote(written)


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
    trust: Trust
    """The evidence on them, rad/s."""


def _runs(
    noise: float, seed: int, advance: Callable[[], None]
) -> tuple[models.Recording, dict[str, Run]]:
    """Simulate with `noise` (N·m) on the torque and estimate with each of SETTINGS; `advance` is
    called every step."""
    recording = models.detumbling().simulate(DURATION, DT, noise=noise, seed=seed)
    history = recording.history(T)
    return recording, {
        name: _run(history, recording.y[T:-1], given, advance) for name, given in SETTINGS.items()
    }


def _run(history: History, Y: Array, given: dict[str, Any], advance: Callable[[], None]) -> Run:
    """Estimate step by step from torques Y (N, 3), as a spacecraft would."""
    est = DdMhe(history, x_bounds=(-BOX, BOX), x_center="history", start="state", **given)
    estimates, seconds = [], []
    for y_t in Y:
        begin = time.perf_counter()
        estimates.append(est.step(y_t))
        seconds.append(time.perf_counter() - begin)
        advance()
    return Run(
        est,
        np.array([e.x for e in estimates]),
        np.array(seconds),
        [e.status for e in estimates],
        [e.active for e in estimates],
        Trust.of_estimates(estimates),
    )


def _summary(recording: models.Recording, results: dict[str, Run], noise: float) -> Table:
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
    trust = {"trusted": f"{np.mean(result.trust.trusted):.1%}"}
    trust |= result.trust.within(np.deg2rad(error))
    times = {"step median": f"{median:.2g} us", "step 99 %": f"{slow:.2g} us"}
    return {
        **report.settings(result.est),
        **per_axis,
        **spans,
        **trust,
        **times,
        **report.outcome(result.status, result.active),
    }


def _facts(result: Run, error: Array) -> dict[str, Any]:
    """The numbers of a column; errors in deg/s."""
    est, trust = result.est, result.trust
    median, slow = np.percentile(result.seconds, [50, 99])
    return {
        "horizon": est.horizon,
        "rho": est.rho,
        "mu": est.mu,
        "weights": est.weights,
        "trajectory_space": {"directions": est.rank, "ridge": est.ridge},
        "spectral_radius": est.spectral_radius,
        "rmse_deg_s": dict(zip(AXES, report.rmse(error), strict=True)),
        "rmse_norm_deg_s": {f"{s:g}": report.rmse_norm(error[: round(s / DT)]) for s in SPANS},
        "trusted": float(np.mean(trust.trusted)),
        "within_3_std": [
            {"of": of, "share": share, "count": size}
            for of, share, size in trust.shares(np.deg2rad(error))
        ],
        "step_seconds": {"median": median, "p99": slow},
        "status": Counter(result.status),
        "no_bound_active": float(np.mean(np.equal(result.active, 0))),
    }


def _trust_words(result: Run, error: Array) -> str:
    """How far it is to be trusted and since when not, with errors (STEPS, 3) in deg/s."""
    words = f"{result.trust.words(result.est.promise)}."
    novel = np.flatnonzero(result.trust.reasons & Reason.NOVEL)
    if not novel.size:
        return f"{words} It finds the motion like the recording throughout."
    size, first = np.linalg.norm(error, axis=1), novel[0]
    before = f"at most {size[:first].max():.3f} deg/s before and " if first else ""
    return (
        f"{words} From {DT * (first + 1):.1f} s on it says itself that the motion is unlike the "
        f"recording: the error is {before}up to {size[first:].max():.3f} deg/s after."
    )


def _write(directory: Path, recording: models.Recording, results: dict[str, Run]) -> list[Path]:
    """The defaults' estimates as estimate.csv (rad/s) and a figure of all runs as estimate.png;
    their paths."""
    from ddmhe.report.figures import estimate_figure

    directory.mkdir(parents=True, exist_ok=True)
    csv, png = directory / "estimate.csv", directory / "estimate.png"
    shown = results["defaults"]
    t, x_true, x_hat = recording.t[T + 1 :], recording.x[T + 1 :], shown.x_hat
    names = [f"{axis}_rad_s" for axis in AXES]
    beside = shown.trust.columns("time_s", names)
    report.write_estimates(csv, "time_s", t, names, x_hat, beside)
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
        trust=replace(shown.trust, std=np.rad2deg(shown.trust.std)),
        bars={
            name: np.rad2deg(BARS * np.linalg.norm(r.trust.std, axis=1))
            for name, r in results.items()
        },
    )
    report.save_figure(figure, png)
    return [csv, png]
