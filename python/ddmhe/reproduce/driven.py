"""All estimators on measured logs of systems that are learnt from whole recordings, with known
inputs where there are any.

Every test starts from its own true state, or goes on where the recording ends. The score of a log
is the NRMSE, a state's rms error over its spread in the tests, root mean square over states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe._core import DdMhe, History
from ddmhe.baselines import ArxKalman, ErrorStateKalman, KoopmanMhe, ModelMhe, RidgeFir
from ddmhe.logs import Log, read_log
from ddmhe.report import root_mean_square
from ddmhe.reproduce.montecarlo import in_parallel

Array = NDArray[np.float64]

__all__ = ["ALL", "CASES", "Case", "driven_scores"]

ALL = "NRMSE"
"""The row of a log over all states; its other rows are rms errors in the states' units."""


@dataclass(frozen=True)
class Case:
    """Files of one system, by their names without ending, and their columns."""

    recorded: tuple[str, ...]
    tests: tuple[str, ...]
    """None where the one recorded log goes on."""
    state: tuple[str, ...]
    output: tuple[str, ...]
    input: tuple[str, ...]
    rows: int | None = None
    """Samples of the recording, of which the rest is the test."""

    @property
    def files(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.recorded, *self.tests)


Columns = tuple[str, ...]


def _columns(state: str, output: str, inputs: str) -> tuple[Columns, Columns, Columns]:
    return tuple(state.split()), tuple(output.split()), tuple(inputs.split())


CASES: dict[str, Case] = {
    "robot": Case(
        ("robot_01", "robot_02"),
        ("robot_11", "robot_12", "robot_13"),
        *_columns("w1_rad_s w2_rad_s w3_rad_s", "q1_rad q2_rad q3_rad", "tau1_Nm tau2_Nm tau3_Nm"),
    ),
    "f1tenth": Case(
        tuple(f"f1tenth_0{i}" for i in range(1, 9)),
        ("f1tenth_20", "f1tenth_21", "f1tenth_22"),
        *_columns("px_m py_m yaw_rad speed_m_s", "px_m py_m", "steering speed_set_m_s"),
    ),
    "circuit": Case(("circuit",), (), *_columns("nin2_V neg_V out_V", "out_V", "vin_V"), rows=400),
    "doublependulum": Case(
        tuple(f"doublependulum_id{i}" for i in range(3)),
        ("doublependulum_val0", "doublependulum_val1"),
        *_columns("th1_rad th2_rad w1_rad_s w2_rad_s", "th1_rad th2_rad", ""),
    ),
}
"""A robot arm and a model car (Liu and Althoff, IROS 2018), a circuit (both in AutoKoopman, CC0), a
double pendulum without inputs (dynamicslab/MultiArm-Pendulum, MIT)."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Samples of one recording or test: x (N+1, n), y (N, p), u (N, m)."""

    x: Array
    y: Array
    u: Array
    goes_on: bool = False
    """Whether the recording ends where it begins."""

    def blind(self) -> Signals:
        """Without the inputs."""
        return replace(self, u=self.u[:, :0])

    def measured(self) -> Signals:
        """With the inputs as further outputs."""
        return replace(self, y=np.hstack([self.y, self.u])).blind()


@dataclass(frozen=True, eq=False)
class Task:
    """What is learnt from, and what is estimated."""

    recorded: list[Signals]
    tests: list[Signals]
    dt: float
    units: dict[str, list[str]]
    """Of states, outputs and inputs."""

    def as_told(self, told: Callable[[Signals], Signals], *units: str) -> Task:
        """The same of other signals, whose outputs' units are those of the groups named."""
        joined = [unit for group in units for unit in self.units[group]]
        return Task(
            [told(s) for s in self.recorded],
            [told(s) for s in self.tests],
            self.dt,
            self.units | {"y": joined},
        )

    def history(self) -> History:
        """The recordings, joined."""
        kinds = {f"{name}_units": self.units[name] for name in "xy"}
        driven = self.recorded[0].u.shape[1] > 0
        return History.concat(
            [
                History(s.x, s.y, self.dt, s.u, **kinds, u_units=self.units["u"])
                if driven
                else History(s.x, s.y, self.dt, **kinds)
                for s in self.recorded
            ]
        )


def task_of(case: Case, folder: Path) -> Task:
    """Read the files of a case; DdmheError for one that is not such a log."""

    def read(name: str) -> Log:
        return read_log(folder / f"{name}.csv", case.state, case.output, input=case.input)

    def signals(log: Log, first: int, last: int) -> Signals:
        u = np.zeros((len(log.t), 0)) if log.u is None else log.u
        return Signals(log.x[first : last + 1], log.y[first:last], u[first:last], first > 0)

    logs = [read(name) for name in case.recorded]
    cuts = [len(log.t) - 1 if case.rows is None else case.rows for log in logs]
    recorded = [signals(log, 0, cut) for log, cut in zip(logs, cuts, strict=True)]
    tests = [signals(log, 0, len(log.t) - 1) for log in map(read, case.tests)]
    if case.rows is not None:
        tests = [signals(logs[0], case.rows, len(logs[0].t) - 1)]
    groups = {"x": case.state, "y": case.output, "u": case.input}
    units = {group: [logs[0].unit(name) for name in names] for group, names in groups.items()}
    return Task(recorded, tests, logs[0].dt, units)


def estimators(history: History, goes_on: bool) -> Mapping[str, Callable[[], Any]]:
    """What takes part with the signals as they are, by name; nothing is chosen with the truth."""
    start: Any = "recording" if goes_on else "state"

    def tuned() -> DdMhe:
        from ddmhe.tuning import tune

        return DdMhe(history, **tune(history, progress=False).settings, start=start)

    return {
        "Dd-MHE, defaults": lambda: DdMhe(history, start=start),
        "Dd-MHE, tuned": tuned,
        "MHE, identified model": lambda: ModelMhe(history),
        "Dd-KMHE, tuned": lambda: KoopmanMhe(history, 30, 0.95, 1e-2),
        "Dd-ESKF, tuned": lambda: ErrorStateKalman(history),
        "ARX Kalman filter": lambda: ArxKalman(history),
        "ridge FIR": lambda: RidgeFir(history),
    }


def scores(job: tuple[str, Path]) -> dict[str, dict[str, float]]:
    """Of each estimator on one case: the NRMSE and the rms error of each state; infinite where it
    diverges."""
    name, folder = job
    case = CASES[name]
    task = task_of(case, folder)
    history, goes_on = task.history(), task.tests[0].goes_on
    found = {}
    if case.input:
        ways = {
            "Dd-MHE, u ignored": task.as_told(Signals.blind, "y"),
            "Dd-MHE, u as outputs": task.as_told(Signals.measured, "y", "u"),
        }
        for way, told in ways.items():
            default = estimators(told.history(), goes_on)["Dd-MHE, defaults"]
            found[way] = _errors(default(), told.tests, case)
    for label, make in estimators(history, goes_on).items():
        found[label] = _errors(make(), task.tests, case)
    return found


def _errors(estimator: Any, tests: Iterable[Signals], case: Case) -> dict[str, float]:
    """NRMSE over all tests together, and rms errors state by state."""
    x_hat = np.vstack([_run(estimator, test) for test in tests])
    x = np.vstack([test.x[1:] for test in tests])
    with np.errstate(over="ignore", invalid="ignore"):
        rms = np.sqrt(np.mean((x_hat - x) ** 2, axis=0))
        rms = np.where(np.isfinite(rms), rms, np.inf)
        total = float(root_mean_square(rms / x.std(axis=0)))
    return {ALL: total} | dict(zip(case.state, map(float, rms), strict=True))


def _run(estimator: Any, test: Signals) -> Array:
    """Estimates (N, n) of one test; NaN for numbers that have left all bounds."""
    if not test.goes_on:
        estimator.reset(test.x[0])
    signals = (test.y, test.u) if test.u.shape[1] else (test.y,)
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.asarray(estimator.run(*signals).x)
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError):
        return np.full_like(test.x[1:], np.nan)


def driven_scores(jobs: list[tuple[str, Path]], advance: Callable[[], None]) -> pd.DataFrame:
    """Scores of cases (name, folder of its files): one row per log and state, and per log over all
    of them, one column per estimator.

    A KeyboardInterrupt has the same of the cases that were finished as its `finished`."""
    try:
        return _table(jobs, in_parallel(scores, jobs, advance))
    except KeyboardInterrupt as e:
        e.finished = _table(jobs, getattr(e, "finished", []))  # type: ignore[attr-defined]
        raise


def _table(jobs: list[tuple[str, Path]], found: list[dict[str, dict[str, float]]]) -> pd.DataFrame:
    rows = {
        (name, row): {label: errors[row] for label, errors in each.items()}
        for (name, _), each in zip(jobs, found, strict=False)
        for row in (ALL, *CASES[name].state)
    }
    index = pd.MultiIndex.from_tuples(rows, names=["log", "state"]) if rows else None
    return pd.DataFrame(list(rows.values()), index=index)
