"""`ddmhe reproduce real` on measured logs with known inputs."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_here
from ddmhe.reproduce import driven, driven_logs, pendulum_logs, reproduce_real

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "input-logs"
)
measured = pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
ROBOT = [f"robot_{n}" for n in ("01", "02", "11", "12", "13")]


def robot(name):
    """States (N+1, 3), outputs (N, 3), inputs (N, 3) by column number, another reading."""
    table = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=1)
    return table[:, 1:4], table[:-1, 4:7], table[:-1, 7:10]


def score(way):
    """NRMSE over states of the defaults: whole recordings learnt, tests from their own start."""

    def signals(name):
        x, y, u = robot(name)
        return x, np.hstack([y, u]) if way == "outputs" else y, u if way == "inputs" else None

    units = {"x_units": "rad/s", "y_units": ["rad"] * 3 + ["Nm"] * 3 * (way == "outputs")}
    recorded = [signals(name) for name in ROBOT[:2]]
    history = ddmhe.History.concat([ddmhe.History(x, y, 0.016, u, **units) for x, y, u in recorded])
    errors, truths = [], []
    for x, y, u in map(signals, ROBOT[2:]):
        estimator = ddmhe.DdMhe(history, x_prior=x[0])
        errors.append((estimator.run(y) if u is None else estimator.run(y, u)).x - x[1:])
        truths.append(x[1:])
    rms = np.sqrt(np.mean(np.vstack(errors) ** 2, axis=0))
    return np.sqrt(np.mean((rms / np.vstack(truths).std(axis=0)) ** 2)), rms


@measured
def test_a_measured_robot_arm(tmp_path):
    """Through the command, against another reading of the files."""
    for name in ROBOT:
        (tmp_path / f"{name}.csv").symlink_to(DATA / f"{name}.csv")
    done = in_here("reproduce", "real", "--data", tmp_path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"real-inputs.csv", "real.md"}
    scores = pd.read_csv(tmp_path / "out" / "real-inputs.csv", index_col=[0, 1])
    assert list(scores.index) == [
        ("robot", row) for row in ("NRMSE", "w1_rad_s", "w2_rad_s", "w3_rad_s")
    ]
    for column, way in (
        ("Dd-MHE, u ignored", "ignored"),
        ("Dd-MHE, u as outputs", "outputs"),
        ("Dd-MHE, defaults", "inputs"),
    ):
        total, rms = score(way)
        assert scores[column].to_numpy() == pytest.approx([total, *rms], rel=1e-6)
    assert scores["Dd-MHE, defaults"].iloc[0] < 0.85
    assert scores["Dd-MHE, tuned"].iloc[0] < 0.6
    page = (tmp_path / "out" / "real.md").read_text(encoding="utf-8")
    assert "| Dd-MHE, defaults | 0.3" in page
    assert "| robot: w1_rad_s | 0.01" in page


@measured
def test_the_circuit_goes_on_where_its_recording_ends():
    task = driven.task_of(driven.CASES["circuit"], DATA)
    (recorded,), (test,) = task.recorded, task.tests
    assert (len(recorded.x), len(recorded.y), len(test.y)) == (401, 400, 2598)
    assert test.goes_on
    np.testing.assert_array_equal(recorded.x[-1], test.x[0])
    assert task.units == {"x": ["V"] * 3, "y": ["V"], "u": ["V"]}
    assert task.as_told(driven.Signals.measured, "y", "u").history().p == 2


@measured
def test_logs_with_inputs_are_no_pendulum_logs(tmp_path, monkeypatch):
    assert pendulum_logs(DATA) == []
    assert [name for name, _ in driven_logs(DATA)] == list(driven.CASES)
    assert driven_logs(DATA.parent) == driven_logs(DATA)
    monkeypatch.setenv("DDMHE_DATA", str(DATA))
    assert driven_logs(None) == driven_logs(DATA)
    for name in ROBOT[:4]:
        (tmp_path / f"{name}.csv").symlink_to(DATA / f"{name}.csv")
    assert driven_logs(tmp_path) == []  # a file is missing
    with pytest.raises(ddmhe.DdmheError, match="--data: expected a directory with pendulum logs"):
        pendulum_logs(tmp_path)


class Taking:
    """An estimator that repeats the first input, and whose first state diverges."""

    def reset(self, x_prior):
        self.x = np.asarray(x_prior)

    def run(self, Y, U):
        return ddmhe.baselines.Log(np.tile([np.nan, U[0, 0] + self.x[1]], (len(Y), 1)))


def test_errors_are_those_of_all_tests_together():
    rng = np.random.default_rng(0)
    x, y, u = rng.standard_normal((41, 2)), rng.standard_normal((40, 1)), np.ones((40, 2))
    case = driven.Case(("a",), ("b",), ("x1", "x2"), ("y",), ("u1", "u2"))
    tests = [driven.Signals(x, y, u), driven.Signals(x, y, 2 * u)]
    found = driven._errors(Taking(), tests, case)
    squares = np.r_[[(x[1:, 1] - x[0, 1] - k) ** 2 for k in (1, 2)]]
    assert found == {"NRMSE": np.inf, "x1": np.inf, "x2": pytest.approx(np.sqrt(squares.mean()))}


def test_every_estimator_takes_inputs():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((60, 1))
    x = np.zeros((61, 2))
    for k in range(60):
        x[k + 1] = x[k] @ np.array([[0.9, -0.2], [0.2, 0.9]]) + u[k]
    y = x[:-1, :1] + 0.01 * rng.standard_normal((60, 1))
    case = driven.Case(("a",), ("b",), ("x1", "x2"), ("y",), ("u",))
    test = driven.Signals(x, y, u)
    found = {
        name: driven._errors(make(), [test], case)["NRMSE"]
        for name, make in driven.estimators(ddmhe.History(x, y, u=u), False).items()
    }
    assert len(found) == 7
    assert found["Dd-MHE, defaults"] < 0.01
    assert np.isfinite(list(found.values())).all()


def test_interrupted_cases_leave_the_table_of_those_before(monkeypatch, tmp_path):
    def interrupted(*_):
        e = KeyboardInterrupt()
        e.finished = [{"Dd-MHE": {"NRMSE": 0.5} | dict.fromkeys(driven.CASES["robot"].state, 1.0)}]
        raise e

    jobs = [("robot", tmp_path), ("circuit", tmp_path)]
    monkeypatch.setattr(driven, "in_parallel", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        reproduce_real([], tmp_path, lambda: None, jobs)
    _, written = caught.value.finished
    assert [path.name for path in written] == ["real-inputs.csv", "real.md"]
    assert written[0].read_text().splitlines()[:2] == ["log,state,Dd-MHE", "robot,NRMSE,0.5"]
    monkeypatch.setattr(driven, "in_parallel", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt) as caught:
        reproduce_real([], tmp_path, lambda: None, jobs)
    assert caught.value.finished is None
