"""Known inputs on the command line: `--input`, with files as a user has them."""

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import PNG, in_here, printed
from ddmhe.cli.telling import in_words_of
from ddmhe.logs import Names

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "input-logs"
)
COLUMNS = ["--state", "position,rate", "--output", "gauge", "--input", "force_N"]
ROWS, T = 300, 120


@pytest.fixture(scope="module")
def cart():
    """A cart on a spring under a force that steps: x (ROWS, 2), y (ROWS, 1), u (ROWS, 1)."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, ROWS // 6), 6)[:, None]
    A, B = np.array([[0.98, 0.1], [-0.15, 0.95]]), np.array([0.02, 0.3])
    x = [np.zeros(2)]
    for k in range(ROWS - 1):
        x.append(A @ x[-1] + B * u[k])
    x = np.array(x)
    return x, x[:, :1] + 0.1 * u + 1e-3 * rng.standard_normal((ROWS, 1)), u


@pytest.fixture(scope="module")
def frame(cart):
    columns = ["t", "position", "rate", "gauge", "force_N"]
    return pd.DataFrame(np.hstack([0.1 * np.arange(ROWS)[:, None], *cart]), columns=columns)


@pytest.fixture(scope="module")
def log(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("driven") / "log.csv"
    frame.to_csv(path, index=False)
    return path


def history_of(cart):
    x, y, u = cart
    return ddmhe.History(x[: T + 1], y[:T], 0.1, u[:T])


def test_estimates_are_those_of_an_estimator_with_inputs(cart, log, tmp_path):
    out = tmp_path / "est.csv"
    result = in_here("estimate", log, *COLUMNS, "--history", 12, "--out", out)
    assert (result.returncode, result.stderr) == (0, "")
    _, y, u = cart
    expected = ddmhe.DdMhe(history_of(cart), start="recording").run(y[T:-1], u[T:-1]).x
    np.testing.assert_allclose(
        pd.read_csv(out)[["position", "rate"]], expected, rtol=1e-9, atol=1e-12
    )
    blind = in_here("estimate", log, *COLUMNS[:4], "--history", 12)
    assert printed(result, "NRMSE") < 0.1 * printed(blind, "NRMSE")


def test_settings_from_a_file_have_the_rests_inputs(cart, log, tmp_path):
    config, out = tmp_path / "est.toml", tmp_path / "est.csv"
    config.write_text("equilibrium = [[0.0, 0.0], [0.0], [0.0]]\nhorizon = 15\n")
    arguments = ["estimate", log, "--history", 12, "--config", config, "--out", out]
    result = in_here(*arguments, *COLUMNS)
    assert result.returncode == 0, result.stderr
    rest = ([0.0, 0.0], [0.0], [0.0])
    est = ddmhe.DdMhe(history_of(cart), 15, equilibrium=rest, start="recording")
    _, y, u = cart
    np.testing.assert_allclose(
        pd.read_csv(out)[["position", "rate"]], est.run(y[T:-1], u[T:-1]).x, rtol=1e-9, atol=1e-12
    )
    without = in_here(*arguments, *COLUMNS[:4])
    assert without.returncode == 2
    assert "equilibrium: expected a pair (x_e, y_e), found 3 items" in without.stderr


def test_what_the_estimator_says_of_inputs_is_printed(cart, frame, tmp_path):
    """Of the recording beforehand, of a run afterwards."""
    loud = frame.copy()
    loud["still"] = 2.0
    loud.loc[T + 50 :, "force_N"] *= 4
    loud.to_csv(tmp_path / "log.csv", index=False)
    columns = [*COLUMNS[:4], "--input", "force_N, still"]
    result = in_here("estimate", tmp_path / "log.csv", *columns, "--history", 12)
    assert result.returncode == 0, result.stderr
    first, *later = result.stderr.splitlines()
    assert first.startswith("ddmhe: warning: input 'still' never changed")
    (left,) = [line for line in later if "leaves its recorded range" in line]
    assert left.startswith("ddmhe: warning: input 'force_N' leaves its recorded range")
    assert "counted from 0" not in result.stderr


@pytest.mark.parametrize("k", [40, 200])
def test_an_unknown_input_ends_with_its_place(frame, tmp_path, k):
    holed = frame.copy()
    holed.loc[k, "force_N"] = np.nan
    holed.to_csv(tmp_path / "log.csv", index=False)
    result = in_here(
        "estimate", "log.csv", *COLUMNS, "--history", 12, "--out", "e.csv", cwd=tmp_path
    )
    assert (result.returncode, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert f"log.csv, line {k + 2}, column 'force_N': expected a number at every sample" in line
    assert not (tmp_path / "e.csv").exists()
    frame.drop(index=[k, k + 1]).to_csv(tmp_path / "log.csv", index=False)
    result = in_here("estimate", tmp_path / "log.csv", *COLUMNS, "--history", 12)
    assert result.returncode == 2
    assert f"gap at {0.1 * (k - 1):g} s (line {k + 1}), column 'force_N'" in result.stderr
    assert "found 2 samples missing" in result.stderr


def test_an_input_that_looks_wrong_is_pointed_out(frame, tmp_path):
    odd = frame.copy()
    odd.loc[30, "force_N"] = -9999
    odd.to_csv(tmp_path / "log.csv", index=False)
    arguments = ["estimate", "log.csv", *COLUMNS, "--history", 12]
    result = in_here(*arguments, cwd=tmp_path)
    assert "column 'force_N': -9999 in line 32 sits more than 50 deviations out" in result.stderr
    told = in_here(*arguments, "--missing", "-9999", cwd=tmp_path)
    assert (told.returncode, "line 32, column 'force_N'" in told.stderr) == (2, True)


def test_tune_and_its_settings(cart, log, tmp_path):
    result = in_here("tune", log, *COLUMNS, "--history", 12, "--rest", "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "tune.png").read_bytes().startswith(PNG)
    rest = (np.zeros(2), np.zeros(1), np.zeros(1))
    found = ddmhe.tune(history_of(cart), equilibrium=rest, progress=False)
    assert found.words.split(".")[0] in " ".join(result.stdout.split())
    config = ["--config", tmp_path / "tune.toml", "--out", tmp_path / "est.csv"]
    estimated = in_here("estimate", log, *COLUMNS, "--history", 12, *config)
    assert estimated.returncode == 0, estimated.stderr
    _, y, u = cart
    est = ddmhe.DdMhe(history_of(cart), **found.settings, start=found.start)
    np.testing.assert_allclose(
        pd.read_csv(tmp_path / "est.csv")[["position", "rate"]],
        est.run(y[T:-1], u[T:-1]).x,
        rtol=1e-6,
        atol=1e-9,
    )


def test_design_reads_inputs(log, tmp_path):
    result = in_here("design", log, *COLUMNS, "--history", 12, "--out", tmp_path)
    assert result.returncode == 0, result.stderr
    assert "n = 2, p = 1, m = 1" in result.stdout
    config = ["--config", tmp_path / "design.toml"]
    estimated = in_here("estimate", log, *COLUMNS, "--history", 12, *config)
    assert estimated.returncode == 0, estimated.stderr
    assert printed(estimated, "NRMSE") < 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("force", "input: expected a column of .* found 'force'; did you mean 'force_N'"),
        ("force_N,", "expected column names separated by commas, found 'force_N,'"),
        ("t", "input: expected columns other than the time column"),
    ],
)
def test_wrong_columns_are_one_clear_line(log, given, message):
    result = in_here("estimate", log, *COLUMNS[:4], "--input", given, "--history", 12)
    assert result.returncode == 2
    assert re.search(message, result.stderr)
    assert len(result.stderr.splitlines()) == 1


MEASURED = {
    "circuit": ("nin2_V,neg_V,out_V", "out_V", "vin_V", 400, 8e-6),
    "robot_01": (
        "w1_rad_s,w2_rad_s,w3_rad_s",
        "q1_rad,q2_rad,q3_rad",
        "tau1_Nm,tau2_Nm,tau3_Nm",
        150,
        0.016,
    ),
    "f1tenth_04": ("px_m,py_m,yaw_rad,speed_m_s", "px_m,py_m", "steering,speed_set_m_s", 80, 0.025),
}
"""State, output, input; samples of the history, step."""


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
@pytest.mark.parametrize("name", MEASURED)
def test_measured_logs(name, tmp_path):
    """As a user would: the file, its columns, a part of it as the recording."""
    state, output, inputs, T, dt = MEASURED[name]
    path, out = DATA / f"{name}.csv", tmp_path / "est.csv"
    columns = ["--state", state, "--output", output, "--input", inputs]
    result = in_here("estimate", path, *columns, "--history", T * dt, "--out", out)
    assert result.returncode == 0, result.stderr
    table = pd.read_csv(path)
    x, y, u = (table[group.split(",")].to_numpy() for group in (state, output, inputs))
    units = {
        key: [ddmhe.recordings.units.unit_of(column) for column in group.split(",")]
        for key, group in (("x_units", state), ("y_units", output), ("u_units", inputs))
    }
    history = ddmhe.History(x[: T + 1], y[:T], dt, u[:T], **units)
    est = ddmhe.DdMhe(history, start="recording")
    expected = est.run(y[T:-1], u[T:-1]).x
    written = pd.read_csv(out)
    assert len(written) == len(table) - T - 1
    np.testing.assert_allclose(written[state.split(",")], expected, rtol=1e-6, atol=1e-8)
    said = [line.removeprefix("ddmhe: warning: ") for line in result.stderr.splitlines()]
    names = Names("", *(tuple(group.split(",")) for group in (state, output, inputs)))
    t = table.iloc[T + 1 :, 0].to_numpy()
    assert set(in_words_of(names, est.warnings, t)) <= set(said)
