"""``ddmhe demo``: the satellite of Liu et al. 2026, Section IV-B, from the recording to the figure,
for ten minutes in the place of the paper's 100 s: without a model, and with Euler's equation as the
only prior knowledge."""

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
from ddmhe._core import DdMhe, RigidBodyMhe
from ddmhe.cases.satellite import BOX, DT, HISTORY, PAPER, T
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import directory_option
from ddmhe.cli.telling import in_words_of
from ddmhe.logs import Names
from ddmhe.reasons import Reason
from ddmhe.report.trust import Trust

Array = NDArray[np.float64]

__all__ = ["command"]


DURATION = HISTORY + 600.0
"""Length of the experiment, s."""
STEPS = round(DURATION / DT) - T
"""Steps that are estimated."""
SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "paper's weights": PAPER,
}
"""Keywords of DdMhe of each run."""
RIGID = "rigid body"
"""The run of RigidBodyMhe."""
KNOWN = "Euler's equation"
"""What that knows beside the recording."""
SPANS = (20.0, 40.0, 100.0, 600.0)
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
@click.option(
    "--rate-noise",
    type=click.FloatRange(min=0.0),
    default=1e-4,
    show_default=True,
    help="Noise of the recorded rates, rad/s.",
)
@answers
def command(answer: Answer, out: Path, seed: int, noise: float, rate_noise: float) -> None:
    """Estimate the spin of a tumbling satellite from the braking torque alone (the paper's 3-DOF
    case).

    Records 20 s, estimates the next 600 s step by step, without a model and as the rigid body that
    it is, and writes estimate.csv, rigid-body.csv and estimate.png into DIR."""
    total = STEPS * (len(SETTINGS) + 1)
    with answer.working("estimating") as advance:
        done = count(1)
        recording = _recorded(noise, rate_noise, seed)
        results = _runs(recording, lambda: advance(next(done), total))
    written = _write(out, recording, results)
    answer.show(_summary(recording, results, (noise, rate_noise)))
    runs = {}
    for name, result in results.items():
        error = np.rad2deg(result.x_hat - recording.x[T + 1 :])
        answer.say(f"{name}: {_trust_words(result, error)}")
        runs[name] = _facts(result, error)
    answer.facts(noise=noise, rate_noise=rate_noise, seed=seed, runs=runs)
    for name, result in results.items():
        for sentence in in_words_of(NAMES, result.est.warnings):
            answer.warn(f"{name}: {sentence}")
    answer.wrote(written)


@dataclass(frozen=True, eq=False)
class Run:
    """One estimator's way through the experiment."""

    est: DdMhe | RigidBodyMhe
    x_hat: Array
    """Estimates (STEPS, 3), rad/s."""
    seconds: Array
    """Wall time of each step (STEPS,), s."""
    status: list[str]
    active: list[int]
    trust: Trust
    """The evidence on them, rad/s."""


def _recorded(noise: float, rate_noise: float, seed: int) -> models.Recording:
    """The satellite's motion, solved accurately: no body moves by forward Euler, as the paper's
    Eq. (4) does. Noise in N·m on the torque, in rad/s on the recorded rates."""
    recording = models.detumbling().simulate(
        DURATION, DT, noise=noise, seed=seed, integrator="accurate"
    )
    read = np.random.default_rng([seed, 1]).standard_normal(recording.x.shape)
    return replace(recording, x_recorded=recording.x + rate_noise * read)


def _runs(recording: models.Recording, advance: Callable[[], None]) -> dict[str, Run]:
    """Estimates with each of SETTINGS and as a rigid body; `advance` is called every step."""
    history, Y = recording.history(T), recording.y[T:-1]
    about_history: dict[str, Any] = {"x_bounds": (-BOX, BOX), "x_center": "history"}
    runs = {
        name: _run(DdMhe(history, start="state", **about_history, **given), Y, advance)
        for name, given in SETTINGS.items()
    }
    runs[RIGID] = _run(RigidBodyMhe(history), Y, advance)
    return runs


def _run(est: DdMhe | RigidBodyMhe, Y: Array, advance: Callable[[], None]) -> Run:
    """Estimate step by step from torques Y (N, 3), as a spacecraft would."""
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


def _summary(
    recording: models.Recording, results: dict[str, Run], noise: tuple[float, float]
) -> Table:
    """Settings, errors in deg/s and times of every run, side by side; `noise` of torque (N·m) and
    recorded rates (rad/s)."""
    x_true = recording.x[T + 1 :]
    columns = {
        name: _column(result, np.rad2deg(result.x_hat - x_true)) for name, result in results.items()
    }
    title = (
        f"{HISTORY:g} s of history, noise {noise[0]:g} N m (torque), {noise[1]:g} rad/s (recorded "
        "rates); RMSE in deg/s"
    )
    return report.table(title, columns)


def _column(result: Run, error: Array) -> dict[str, str]:
    per_axis = {
        f"RMSE {axis}": f"{value:.4f}" for axis, value in zip(AXES, report.rmse(error), strict=True)
    }
    spans = {f"RMSE norm {s:g} s": f"{report.rmse_norm(error[: round(s / DT)]):.4f}" for s in SPANS}
    median, slow = np.percentile(result.seconds, [50, 99]) * 1e6
    trust = {"trusted": f"{np.mean(result.trust.trusted):.1%}"}
    trust |= result.trust.within(np.deg2rad(error))
    times = {"step median": _microseconds(median), "step 99 %": _microseconds(slow)}
    dd = result.est if isinstance(result.est, DdMhe) else None
    return {
        "known beforehand": "nothing" if dd else KNOWN,
        **(report.settings(dd) if dd else {}),
        **per_axis,
        **spans,
        **trust,
        **times,
        **report.outcome(result.status, result.active),
    }


def _microseconds(time: float) -> str:
    """Two digits at least."""
    return f"{time:.2g} us" if time < 100 else f"{time:.0f} us"


def _facts(result: Run, error: Array) -> dict[str, Any]:
    """The numbers of a column; errors in deg/s."""
    est, trust = result.est, result.trust
    median, slow = np.percentile(result.seconds, [50, 99])
    return {
        **(_settings(est) if isinstance(est, DdMhe) else {"explained": est.explained}),
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


def _settings(est: DdMhe) -> dict[str, Any]:
    """Settings in force."""
    return {
        "horizon": est.horizon,
        "rho": est.rho,
        "mu": est.mu,
        "weights": est.weights,
        "trajectory_space": {"directions": est.rank, "ridge": est.ridge},
        "spectral_radius": est.spectral_radius,
    }


def _trust_words(result: Run, error: Array) -> str:
    """How far it is to be trusted and since when not, with errors (STEPS, 3) in deg/s."""
    promise = result.est.promise if isinstance(result.est, DdMhe) else None
    words = f"{result.trust.words(promise)}."
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
    """Estimates of the defaults as estimate.csv, of the rigid body as rigid-body.csv (rad/s), and a
    figure of all runs as estimate.png; their paths."""
    from ddmhe.report.figures import Curve, beyond_figure

    directory.mkdir(parents=True, exist_ok=True)
    t, names = recording.t[T + 1 :], [f"{axis}_rad_s" for axis in AXES]
    files = {"defaults": directory / "estimate.csv", RIGID: directory / "rigid-body.csv"}
    for name, csv in files.items():
        beside = results[name].trust.columns("time_s", names)
        report.write_estimates(csv, "time_s", t, names, results[name].x_hat, beside)
    novel = np.flatnonzero(results["defaults"].trust.reasons & Reason.NOVEL)
    curves = {
        name: Curve(np.rad2deg(r.x_hat), np.rad2deg(r.trust.std) if name in files else None)
        for name, r in results.items()
    }
    figure = beyond_figure(
        (recording.t, np.rad2deg(recording.x)),
        curves,
        AXES,
        recorded=T + 1,
        novel=t[novel[0]] if novel.size else None,
    )
    png = directory / "estimate.png"
    report.save_figure(figure, png)
    return [*files.values(), png]
