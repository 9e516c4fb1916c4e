"""All estimators on measured pendulum logs: gyroscope from accelerometer.

The task (RepoIMU logs): every fourth sample (about 24 ms), start 20 samples after |ω| first exceeds
0.5 rad/s, 3.6 s of history with state ω (3) and output specific force (3), then estimate ω from the
accelerometer alone until the log ends. The score is the NRMSE over all axes. Gaps of the log are
filled: outputs there count as not measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe import report
from ddmhe._core import DdMhe, DdmheError, History
from ddmhe.baselines import ArxKalman, ErrorStateKalman, KoopmanMhe, RidgeFir
from ddmhe.checks import file_words
from ddmhe.logs import read_log
from ddmhe.reproduce.montecarlo import estimates, in_parallel

Array = NDArray[np.float64]

__all__ = ["PendulumTask", "pendulum_scores", "pendulum_task"]

STATE, OUTPUT = (
    [f"{kind}_{axis}_{unit}" for axis in "xyz"]
    for kind, unit in (("omega", "rad_s"), ("acc", "m_s2"))
)
DECIMATE, HISTORY = 4, 3.6
SWING, LEAD = 0.5, 20
"""The task begins LEAD samples after |ω| first exceeds SWING, rad/s."""


@dataclass(frozen=True, eq=False)
class PendulumTask:
    """One log, ready to be estimated."""

    history: History
    Y: Array
    """Outputs after the history (N, 3), NaN in gaps, m/s²."""
    x: Array
    """True states (N, 3), NaN where unknown, rad/s."""


def pendulum_task(path: str | Path) -> PendulumTask:
    """Read a log and cut it as the task asks; DdmheError if it is not such a log."""
    log = read_log(path, STATE, OUTPUT, decimate=DECIMATE)
    swinging = np.linalg.norm(log.x, axis=1) > SWING
    if not swinging.any():
        raise DdmheError(
            f"path: expected a log in which |omega| exceeds {SWING:g} rad/s, "
            f"'{file_words(path)}' has none"
        )
    start = log.t[min(int(np.argmax(swinging)) + LEAD, len(log.t) - 1)]
    split = read_log(path, STATE, OUTPUT, decimate=DECIMATE, start=start).fill_gaps().split(HISTORY)
    if split.x_true is None:
        raise DdmheError(
            f"path: expected a log with states after the history, '{file_words(path)}' has none"
        )
    return PendulumTask(split.history, split.Y, split.x_true)


def estimators(history: History) -> Mapping[str, Callable[[], Any]]:
    """What takes part, by name; nothing is chosen with the truth."""

    def tuned() -> DdMhe:
        from ddmhe.tuning import tune

        found = tune(history, progress=False)
        return DdMhe(history, **found.settings, start=found.start)

    return {
        "Dd-MHE, defaults": lambda: DdMhe(history),
        "Dd-MHE, from the last state": lambda: DdMhe(history, start="state"),
        "Dd-MHE, tuned": tuned,
        "Dd-MHE, paper's weights": lambda: DdMhe(history, 20, 0.9, 1e5, start="state"),
        "Dd-KMHE, paper's weights": lambda: KoopmanMhe(history, 20, 0.9, 1e5),
        "Dd-KMHE, tuned": lambda: KoopmanMhe(history, 30, 0.95, 1e-2),
        "Dd-ESKF, Q = 1e5, R = 1e3": lambda: ErrorStateKalman(history, 1e5, 1e3),
        "Dd-ESKF, tuned": lambda: ErrorStateKalman(history),
        "ARX Kalman filter": lambda: ArxKalman(history),
        "ridge FIR": lambda: RidgeFir(history),
    }


def pendulum_scores(paths: list[Path], advance: Callable[[], None]) -> pd.DataFrame:
    """Pooled NRMSE, one row per log and one column per estimator; infinite where one diverges."""

    def table(rows: list[dict[str, float]]) -> pd.DataFrame:
        return pd.DataFrame(
            rows, index=pd.Index([path.stem for path in paths[: len(rows)]], name="log")
        )

    try:
        return table(in_parallel(_scores, paths, advance))
    except KeyboardInterrupt as e:
        e.finished = table(getattr(e, "finished", []))  # type: ignore[attr-defined]
        raise


def _scores(path: Path) -> dict[str, float]:
    task = pendulum_task(path)
    found = estimates(estimators(task.history), task.Y, 3)
    scores = {}
    for name, x_hat in found.items():
        with np.errstate(over="ignore", invalid="ignore"):
            score = report.pooled_nrmse(x_hat, task.x)
        scores[name] = score if np.isfinite(score) else np.inf
    return scores
