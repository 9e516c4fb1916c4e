"""What the Rerun viewer is given, read back with its own library."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ddmhe
from commands import in_here
from ddmhe.report.viewer import turned

rr = pytest.importorskip("rerun", reason="rerun-sdk is not installed (pip install 'ddmhe[rerun]')")
DT = 0.1


@pytest.fixture(scope="module")
def run():
    s = ddmhe.models.detumbling().simulate(30.0, DT, noise=1e-3, seed=4)
    est = ddmhe.DdMhe(ddmhe.History(s.x[:201], s.y[:200], DT, x_units="rad/s"))
    return est, est.run(s.y[200:300]), s.x[201:301]


def verified(path):
    """Whether Rerun's own reader takes every chunk of the file."""
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return found.returncode == 0, found.stdout + found.stderr


def printed(path):
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vv", str(path)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout


def test_a_run_is_a_recording_that_reruns_reader_takes(run, tmp_path):
    est, log, truth = run
    made = ddmhe.report.rerun(
        est, log, tmp_path / "run.rrd", truth=truth, names=["wx", "wy", "<wz>"], units=["rad/s"] * 3
    )
    good, said = verified(made)
    assert good, said
    text = printed(made)
    for entity in ("/states/0_wx/estimate", "/states/2_wz/true", "/states/1_wy/upper", "/doubt"):
        assert entity in text
    for entity in ("/body/estimate/turn", "/body/true/turn"):
        assert entity in text


def test_states_in_other_units_turn_no_box(run, tmp_path):
    est, log, _ = run
    made = ddmhe.report.rerun(est, log, tmp_path / "run.rrd", units=["V", "A", "A"])
    assert "/body" not in printed(made)


def test_attitudes_are_those_of_scipy():
    rng = np.random.default_rng(5)
    rates, steps = rng.normal(size=(50, 3)), rng.uniform(0.05, 0.2, size=50)
    rates[7] = 0.0
    q, turn = turned(rates, steps), Rotation.identity()
    for k in range(50):
        turn = turn * Rotation.from_rotvec(rates[k] * steps[k])
        assert (Rotation.from_quat(q[k]).inv() * turn).magnitude() < 1e-12


def test_wrong_places_are_told_before_the_work(run, tmp_path, monkeypatch):
    est, log, _ = run
    with pytest.raises(ddmhe.DdmheError, match=r"path: expected a file ending in \.rrd"):
        ddmhe.report.rerun(est, log, tmp_path / "run.html")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ddmhe.DdmheError, match=r"rerun-sdk .*ddmhe\[rerun\]"):
        ddmhe.report.rerun(est, log, tmp_path / "run.rrd")


def test_on_the_command_line(run, tmp_path):
    s = ddmhe.models.detumbling().simulate(30.0, DT, noise=1e-3, seed=4)
    t = DT * np.arange(len(s.x))
    rows = np.column_stack([t, s.x, s.y])
    head = "time_s,wx,wy,wz,tx,ty,tz"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="")
    columns = ["--state", "wx,wy,wz", "--output", "tx,ty,tz", "--history", 20]
    result = in_here("estimate", "log.csv", *columns, "--rerun", "run.rrd", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "wrote run.rrd" in result.stdout
    good, said = verified(tmp_path / "run.rrd")
    assert good, said
