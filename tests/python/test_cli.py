"""The command line as a user meets it: files in a temporary directory, and of each command a
process of its own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_a_process, in_here
from ddmhe.models import detumbling

STATE, OUTPUT = ["wx", "wy", "wz"], ["tx", "ty", "tz"]
COLUMNS = ["--state", "wx,wy,wz", "--output", "tx,ty,tz"]
T, N = 200, 600
PNG = b"\x89PNG\r\n\x1a\n"


def printed(result, label):
    """The number that a table prints beside `label`."""
    return float(re.search(rf"{re.escape(label)}\s*│\s*([-\d.e+]+)", result.stdout).group(1))


@pytest.fixture(scope="module")
def recording():
    return detumbling().simulate(60.0, 0.1, noise=0.01, seed=1)


@pytest.fixture(scope="module")
def frame(recording):
    return pd.DataFrame(
        np.hstack([recording.t[:, None], recording.x, recording.y]), columns=["t", *STATE, *OUTPUT]
    )


@pytest.fixture(scope="module")
def log(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    frame.to_csv(path, index=False)
    return path


def estimates_of(recording, **settings):
    history = ddmhe.History(recording.x[: T + 1], recording.y[:T], dt=0.1)
    return ddmhe.DdMhe(history, **{"start": "recording"} | settings).run(recording.y[T:-1])


def test_estimate_writes_what_the_estimator_gives(recording, log, tmp_path):
    out = tmp_path / "est.csv"
    result = in_a_process("estimate", log, *COLUMNS, "--history", 20, "--out", out)
    assert (result.returncode, result.stderr) == (0, "")
    written = pd.read_csv(out)
    assert list(written.columns) == ["t", *STATE]
    np.testing.assert_allclose(written["t"], recording.t[T + 1 :], rtol=1e-12)
    expected = estimates_of(recording).x
    np.testing.assert_allclose(written[STATE], expected, rtol=1e-9, atol=1e-12)
    error = expected - recording.x[T + 1 :]
    relative = np.sqrt(np.mean(error**2, axis=0)) / recording.x[T + 1 :].std(axis=0)
    assert printed(result, "RMSE wy") == pytest.approx(np.sqrt(np.mean(error[:, 1] ** 2)), rel=1e-3)
    assert printed(result, "NRMSE wy") == pytest.approx(relative[1], abs=1e-4)
    assert printed(result, "NRMSE") == pytest.approx(np.sqrt(np.mean(relative**2)), abs=1e-4)
    assert "pooled" not in result.stdout
    assert f"wrote {out}" in result.stdout


def test_estimate_into_a_directory_with_a_figure(log, tmp_path):
    result = in_a_process(
        "estimate", log, *COLUMNS, "--history", 20, "--out", tmp_path / "new" / "dir"
    )
    assert result.returncode == 0, result.stderr
    assert len(pd.read_csv(tmp_path / "new" / "dir" / "estimate.csv")) == N - T
    assert (tmp_path / "new" / "dir" / "estimate.png").read_bytes().startswith(PNG)


def test_estimate_without_truth_prints_no_error_measures(frame, tmp_path):
    live = frame.copy()
    live.loc[T + 1 :, STATE] = np.nan
    live.to_csv(tmp_path / "live.csv", index=False)
    result = in_here(
        "estimate",
        "live.csv",
        *COLUMNS,
        "--history",
        20,
        "--out",
        "est.csv",
        "--plot",
        "est.svg",
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
    assert "RMSE" not in result.stdout
    assert len(pd.read_csv(tmp_path / "est.csv")) == N - T
    assert "<svg" in (tmp_path / "est.svg").read_text()


def test_options_override_the_configuration(recording, log, tmp_path):
    config = tmp_path / "est.toml"
    config.write_text(
        "horizon = 12\nrho = 0.9\nmu = 3.0\nx_bounds = [-0.5, 0.5]\nspace = 'exact'\n"
    )
    options = [
        "--config",
        config,
        "--horizon",
        8,
        "--space",
        "truncated:4",
        "--start-from",
        "state",
    ]
    result = in_here(
        "estimate", log, *COLUMNS, "--history", 20, *options, "--out", tmp_path / "est.csv"
    )
    assert result.returncode == 0, result.stderr
    settings = {"horizon": 8, "rho": 0.9, "mu": 3.0, "x_bounds": (-0.5, 0.5), "start": "state"}
    expected = estimates_of(recording, **settings, space=ddmhe.Truncated(rank=4)).x
    np.testing.assert_allclose(
        pd.read_csv(tmp_path / "est.csv")[STATE], expected, rtol=1e-9, atol=1e-12
    )
    assert printed(result, "horizon M") == 8


def test_start_decimate_and_time_choose_the_rows(frame, recording, tmp_path):
    moved = frame[[*STATE, "t", *OUTPUT]].assign(t=frame["t"] + 100.0)
    moved.to_csv(tmp_path / "log.csv", index=False)
    options = [
        "--time",
        "t",
        "--start",
        105,
        "--decimate",
        2,
        "--history",
        20,
        "--out",
        tmp_path / "est.csv",
    ]
    result = in_here("estimate", tmp_path / "log.csv", *COLUMNS, *options)
    assert result.returncode == 0, result.stderr
    x, y = recording.x[50::2], recording.y[50::2]
    expected = (
        ddmhe.DdMhe(ddmhe.History(x[:101], y[:100], dt=0.2), start="recording").run(y[100:-1]).x
    )
    written = pd.read_csv(tmp_path / "est.csv")
    np.testing.assert_allclose(written["t"], 100 + recording.t[50::2][101:], rtol=1e-12)
    np.testing.assert_allclose(written[STATE], expected, rtol=1e-6, atol=1e-9)


def test_filled_gaps_give_one_row_per_row_of_the_log(frame, log, tmp_path):
    holed = frame.drop(index=[90, 91, 300, 301, 302, 303])
    holed.to_csv(tmp_path / "log.csv", index=False)
    arguments = [
        "estimate",
        tmp_path / "log.csv",
        *COLUMNS,
        "--history",
        20,
        "--out",
        tmp_path / "est.csv",
    ]
    assert in_here(*arguments, "--gaps", "error").returncode == 2
    result = in_here(*arguments)
    assert result.returncode == 0, result.stderr
    written = pd.read_csv(tmp_path / "est.csv")
    np.testing.assert_allclose(written["t"], holed["t"][holed.index > T], rtol=1e-12)
    assert printed(result, "gaps filled") == 6
    whole = in_here("estimate", log, *COLUMNS, "--history", 20)
    assert printed(result, "NRMSE") < 1.1 * printed(whole, "NRMSE") < 0.3


def test_numbers_that_say_not_measured(frame, tmp_path):
    """With --missing they are blanks; without it they are pointed out, by column, line and value,
    and still used."""
    holes = [(250, "ty"), (251, "ty"), (400, "wz"), (500, "tx")]
    blank, coded = frame.copy(), frame.copy()
    for k, name in holes:
        blank.loc[k, name], coded.loc[k, name] = np.nan, -9999.0 if name == "ty" else 999.0
    coded.loc[500, "tx"] = -9999.0
    blank.to_csv(tmp_path / "blank.csv", index=False)
    coded.to_csv(tmp_path / "coded.csv", index=False)
    (tmp_path / "est.toml").write_text("missing = [-9999, 999.0]\n")
    options = [*COLUMNS, "--history", 20]
    expected = in_here(
        "estimate", tmp_path / "blank.csv", *options, "--out", tmp_path / "blank-est.csv"
    )
    assert (expected.returncode, expected.stderr) == (0, "")
    for given in (["--missing", "-9999,999"], ["--config", tmp_path / "est.toml"]):
        result = in_here(
            "estimate", tmp_path / "coded.csv", *options, *given, "--out", tmp_path / "est.csv"
        )
        assert (result.returncode, result.stderr) == (0, "")
        assert (tmp_path / "est.csv").read_bytes() == (tmp_path / "blank-est.csv").read_bytes()
    result = in_here("estimate", tmp_path / "coded.csv", *options)
    assert result.returncode == 0
    for name, value, line in (
        ("ty", "-9999", "252, 253"),
        ("tx", "-9999", "502"),
        ("wz", "999", "402"),
    ):
        told = f"column '{name}': {value} in line {line} sits more than 50 deviations out"
        assert sum(told in sentence for sentence in result.stderr.splitlines()) == 1
    assert "--missing -9999" in result.stderr


@pytest.mark.parametrize("wrong", ["x", "", "1,,2", "nan", "1e999"])
def test_wrong_missing_option(log, wrong):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--missing", wrong)
    assert result.returncode == 2
    assert re.fullmatch(
        r"ddmhe: error: .*--missing.*expected finite numbers [^\n]+\n", result.stderr
    ), result.stderr


def test_a_wrapped_angle_is_pointed_out_and_can_be_unwrapped(tmp_path):
    k = np.arange(600)
    angle = 0.9 * 0.05 * k + 0.5 * np.sin(k / 9)
    frame = pd.DataFrame(
        {"t": 0.05 * k, "heading": angle % (2 * np.pi), "rate": 0.9 + np.cos(k / 9) / 0.9}
    )
    frame["seen"] = frame["heading"] + 0.001 * np.random.default_rng(0).standard_normal(600)
    frame.to_csv(tmp_path / "log.csv", index=False)
    options = [
        "--state",
        "heading,rate",
        "--output",
        "seen,rate",
        "--history",
        15,
        "--out",
        tmp_path / "est.csv",
    ]
    result = in_here("estimate", tmp_path / "log.csv", *options)
    assert result.returncode == 0, result.stderr
    for name in ("heading", "seen"):
        (said,) = re.findall(
            rf"warning: .*'{name}', line (\d+): .*full turn of 6.28.*--unwrap {name}\n",
            result.stderr,
        )
        jump = frame[name].diff().abs() > np.pi
        assert int(said) == jump.idxmax() + 2
    assert (
        "counted from 0" not in result.stderr
    )  # the estimator knows no columns: it would say the same again
    result = in_here("estimate", tmp_path / "log.csv", *options, "--unwrap", "heading,seen")
    assert result.returncode == 0, result.stderr
    assert "full turn" not in result.stderr
    assert np.abs(pd.read_csv(tmp_path / "est.csv")["heading"] - angle[301:]).max() < 0.1


def test_what_the_estimator_warns_of_is_on_stderr(log):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--space", "exact")
    history = log and pd.read_csv(log)
    x, y = history[STATE].to_numpy(), history[OUTPUT].to_numpy()
    est = ddmhe.DdMhe(ddmhe.History(x[: T + 1], y[:T], dt=0.1), space=ddmhe.Exact())
    est.run(y[T:-1])
    assert est.warnings
    assert result.stderr == "".join(f"ddmhe: warning: {sentence}\n" for sentence in est.warnings)


def test_demo_writes_its_files_and_beats_a_constant(tmp_path):
    result = in_a_process("demo", "--out", "here", "--seed", 2, cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    truth = detumbling().simulate(120.0, 0.1).x[201:]
    written = pd.read_csv(tmp_path / "here" / "estimate.csv")
    np.testing.assert_allclose(written["time_s"], 0.1 * np.arange(201, 1201), rtol=1e-12)
    error = np.rad2deg(written.iloc[:, 1:].to_numpy() - truth)
    norm = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    assert printed(result, "RMSE norm 100 s") == pytest.approx(norm, abs=1e-4)
    assert norm < np.rad2deg(np.sqrt(truth.var(axis=0).sum()))
    assert (tmp_path / "here" / "estimate.png").read_bytes().startswith(PNG)


def test_help_and_version():
    assert in_a_process("--version").stdout.startswith("ddmhe, version ")
    for command in ([], ["demo"], ["estimate"]):
        result = in_here(*command, "--help")
        assert result.returncode == 0
        assert "Usage: ddmhe" in result.stdout


IMPORTS = """
import sys
import ddmhe.cli
print(sorted({"cvxpy", "matplotlib", "scipy"} & set(sys.modules)))
import ddmhe.baselines, ddmhe.design, ddmhe.interval  # a certificate from a file, an observer with a given gain
print(sorted({"cvxpy", "matplotlib"} & set(sys.modules)))
"""


def test_what_takes_long_to_import_is_imported_when_it_is_used():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS], capture_output=True, text=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("[]\n[]\n", "")


BASE = ["estimate", "log.csv", *COLUMNS, "--history", "20"]
WRONG = [
    ([], ["Missing command"]),
    (["estimat"], ["No such command", "estimat"]),
    (["demo", "--bogus"], ["No such option", "--bogus"]),
    (["demo", "--noise", "-1"], ["noise", "at least 0", "-1"]),
    (["demo", "--seed", "x"], ["--seed", "'x'"]),
    (["demo", "--out", "log.csv"], ["log.csv"]),
    (["estimate"], ["Missing argument", "LOG"]),
    (["estimate", "log.csv", "--state", "wx", "--output", "tx"], ["Missing option", "--history"]),
    (["estimate", "none.csv", *COLUMNS, "--history", "20"], ["none.csv", "no such file"]),
    (
        ["estimate", "log.csv", "--state", "wx,,wy", "--output", "tx", "--history", "20"],
        ["--state", "wx,,wy"],
    ),
    (
        ["estimate", "log.csv", "--state", "wxx", "--output", "tx", "--history", "20"],
        ["state", "'wxx'", "did you mean 'wx'"],
    ),
    ([*BASE, "--time", "clock"], ["time", "'clock'", "columns: t, wx"]),
    ([*BASE, "--history", "x"], ["--history", "'x'"]),
    ([*BASE, "--history", "60"], ["history", "less than 60 s", "601 samples"]),
    ([*BASE, "--history", "0.1"], ["history", "at least 2 samples"]),
    ([*BASE, "--history", "0.5", "--horizon", "9"], ["horizon", "found 9"]),
    ([*BASE, "--start", "61"], ["start", "at most 60 s", "61"]),
    ([*BASE, "--decimate", "0"], ["decimate", "at least 1", "0"]),
    ([*BASE, "--decimate", "1.5"], ["--decimate", "1.5"]),
    ([*BASE, "--gaps", "maybe"], ["--gaps", "maybe"]),
    ([*BASE, "--rho", "1.5"], ["rho", "(0, 1)", "1.5"]),
    ([*BASE, "--mu", "-1"], ["mu", "positive", "-1"]),
    ([*BASE, "--horizon", "0"], ["horizon", "0"]),
    ([*BASE, "--space", "best"], ["space", "'best'", "truncated:RANK"]),
    ([*BASE, "--config", "none.toml"], ["none.toml", "no such file"]),
    ([*BASE, "--config", "bad.toml"], ["bad.toml", "'horizn'", "horizon, rho, mu"]),
    ([*BASE, "--config", "bounds.toml"], ["x_bounds", "lo <= hi"]),
    ([*BASE, "--out", "log.csv"], ["--out", "other than the log"]),
    ([*BASE, "--out", "log.csv/est"], ["log.csv"]),
    ([*BASE, "--plot", "est.gif"], ["--plot", ".png", "est.gif"]),
    (
        ["estimate", "cell.csv", *COLUMNS, "--history", "20"],
        ["cell.csv", "line 12", "'tx'", "'n/a?'"],
    ),
    (
        ["estimate", "hole.csv", *COLUMNS, "--history", "20"],
        ["hole.csv", "line 12", "'wy'", "inside the history"],
    ),
    (
        ["estimate", "gap.csv", *COLUMNS, "--history", "20", "--gaps", "error"],
        ["gap.csv", "gap inside the history", "line 52", "--gaps"],
    ),
    (
        ["estimate", "back.csv", *COLUMNS, "--history", "20"],
        ["back.csv", "line 22", "'t'", "expected a time after"],
    ),
    (["estimate", "still.csv", *COLUMNS, "--history", "20"], ["state x that changes"]),
]


@pytest.fixture(scope="module")
def wrong_files(frame, tmp_path_factory):
    directory = tmp_path_factory.mktemp("wrong")
    frame.to_csv(directory / "log.csv", index=False)
    text = frame.astype(object)
    text.loc[10, "tx"] = "n/a?"
    text.to_csv(directory / "cell.csv", index=False)
    frame.assign(wy=frame["wy"].where(frame.index != 10)).to_csv(
        directory / "hole.csv", index=False
    )
    frame.drop(index=[51, 52]).to_csv(directory / "gap.csv", index=False)
    frame.assign(t=frame["t"].where(frame.index != 20, 0.0)).to_csv(
        directory / "back.csv", index=False
    )
    frame.assign(wx=1.0, wy=2.0, wz=3.0).to_csv(directory / "still.csv", index=False)
    (directory / "bad.toml").write_text("horizn = 3\n")
    (directory / "bounds.toml").write_text("x_bounds = [1.0, -1.0]\n")
    return directory


def check_wrong_usage(run, directory, arguments, words):
    before = sorted(os.listdir(directory))
    result = run(*arguments, cwd=directory)
    assert result.returncode == 2, result.stdout + result.stderr
    assert re.fullmatch(r"ddmhe: error: [^\n]+\n", result.stderr), result.stderr
    for word in words:
        assert word in result.stderr
    assert result.stdout.strip() == ""
    assert sorted(os.listdir(directory)) == before


@pytest.mark.parametrize(("arguments", "words"), WRONG, ids=lambda value: " ".join(value)[:60])
def test_wrong_usage_is_one_line_and_exit_code_2(wrong_files, arguments, words):
    check_wrong_usage(in_here, wrong_files, arguments, words)


@pytest.mark.parametrize(
    "case",
    [pytest.param(k, marks=() if k % 12 == 0 else pytest.mark.long) for k in range(len(WRONG))],
)
def test_wrong_usage_in_a_process_of_its_own(wrong_files, case):
    check_wrong_usage(in_a_process, wrong_files, *WRONG[case])


DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "repoimu-pendulum"
)


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
@pytest.mark.parametrize("trial", ["Test03", "Test04", "Test05", "Test06", "Test07", "Test08"])
def test_measured_pendulum_logs(trial, tmp_path):
    """From the accelerometer alone the rate of a swinging pendulum is known better than by its
    mean."""
    path = DATA / f"{trial}_Trial1_Segment_1.csv"
    log = pd.read_csv(path).iloc[::4]
    rates = ["omega_x_rad_s", "omega_y_rad_s", "omega_z_rad_s"]
    moving = int(np.argmax(np.linalg.norm(log[rates], axis=1) > 0.5))
    start = log["time_s"].iloc[moving + 20]
    columns = ["--state", ",".join(rates), "--output", "acc_x_m_s2,acc_y_m_s2,acc_z_m_s2"]
    options = ["--history", 3.6, "--decimate", 4, "--start", start, "--out", tmp_path / "est.csv"]
    result = in_here("estimate", path, *columns, *options)
    assert result.returncode == 0, result.stderr
    assert (
        printed(result, "NRMSE pooled") < 0.6
    )  # all three rates in rad/s, by their columns' names
    t, clock = pd.read_csv(tmp_path / "est.csv")["time_s"], pd.read_csv(path)["time_s"]
    assert t.isin(clock).all()
    # after lost rows, too, samples stand on the grid of four steps of the clock: late stamps and
    # all
    step = clock.diff()[clock.diff() < 0.009].mean()
    off = (t.diff().dropna() / (4 * step) + 0.5) % 1 - 0.5
    assert off.abs().max() < 0.2  # a row off is a quarter


def test_design_writes_a_certificate_that_estimate_takes(log, tmp_path):
    result = in_a_process("design", log, *COLUMNS, "--history", 20, "--eta", 0.9, "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "rho0, mu0 as printed" in result.stdout
    assert "(24) is impossible" in result.stdout
    assert (tmp_path / "poles.png").read_bytes().startswith(PNG)
    config = tmp_path / "design.toml"
    estimated = in_here(
        "estimate", log, *COLUMNS, "--history", 20, "--config", config, "--out", tmp_path / "e.csv"
    )
    assert (estimated.returncode, estimated.stderr) == (0, "")
    assert printed(estimated, "rho") == 0.9
    short = in_here("estimate", log, *COLUMNS, "--history", 20, "--config", config, "--horizon", 13)
    assert short.returncode == 2
    assert "horizon: expected at least 14" in short.stderr


def test_a_certificate_survives_its_file(tmp_path):
    """Also a robust one, whose uncertainty widens the error bound: the bounds are the same to the
    last digit."""
    from ddmhe.config import read_config, write_config
    from ddmhe.design import RecordingNoise, ioss

    rng = np.random.default_rng(0)
    A, C = np.array([[0.95, 0.3], [-0.3, 0.95]]), np.array([[1.0, 0.5]])
    x = np.array([np.linalg.matrix_power(A, k) @ [1.0, 0.0] for k in range(121)])
    x, y = x + rng.uniform(-1e-3, 1e-3, x.shape), x[:-1] @ C.T
    history = ddmhe.History(x, y)
    for noise in (None, RecordingNoise(x=2e-3)):
        settings = {"certificate": ioss(history, 0.9, noise=noise), "disturbance": (0.1, 0.0, 0.01)}
        write_config(tmp_path / "c.toml", settings | {"space": ddmhe.Ridge(1e-6, normalised=True)})
        read = read_config(tmp_path / "c.toml")
        assert read["space"] == ddmhe.Ridge(1e-6, normalised=True)
        bounds = [
            ddmhe.DdMhe(history, **s).run(y[:30]).bound
            for s in (settings | {"space": read["space"]}, read)
        ]
        np.testing.assert_array_equal(*bounds)
        assert (read["certificate"].uncertainty is None) == (noise is None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("certificate = 3", "certificate: expected a table"),
        ("[certificate]\neta = 0.9", "certificate: expected eta, P, Q and R, found no P"),
        ("[certificate]\ncolour = 1", "certificate: expected one of"),
        ("[certificate]\neta = 'x'", "certificate: expected numbers for eta"),
        (
            "[certificate]\neta=0.9\nP=[[1.0],[2.0,3.0]]\nQ=[[1.0]]\nR=[[1.0]]",
            "expected rectangular matrices",
        ),
        (
            "[certificate]\neta=0.9\nP=[[1.0]]\nQ=[[1.0]]\nR=[[1.0]]",
            "certificate: expected a matrix (3, 3)",
        ),
        (
            "space = {kind = 'ridge', weight = 1.0, normalised = 1}",
            "expected true or false for normalised",
        ),
    ],
)
def test_wrong_certificates_in_a_file(log, tmp_path, text, message):
    (tmp_path / "c.toml").write_text(text)
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--config", tmp_path / "c.toml")
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_design_reports_what_cannot_be(log, tmp_path):
    for options, message in (
        (["--radius", 1.5], "radius: expected a number in (0, 1)"),
        (["--condition", 0.5], "condition: expected a number above 1"),
        (["--noise-x", 1.0], "noise: expected a recording that moves every direction"),
        (["--noise-y", -1.0], "noise: expected a finite y"),
    ):
        result = in_here("design", log, *COLUMNS, "--history", 20, "--out", tmp_path, *options)
        assert result.returncode == 2
        assert message in result.stderr
        assert result.stderr.count("\n") == 1


def test_tune_writes_settings_that_estimate_takes(log, tmp_path):
    result = in_a_process("tune", log, *COLUMNS, "--history", 8, "--rest", "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "held-out quarters" in result.stdout
    assert (tmp_path / "tune.png").read_bytes().startswith(PNG)
    assert len(pd.read_csv(tmp_path / "tune.csv")) > 100
    # of each state, by its column: what to expect, and whether the settings are better than the
    # default rule's
    for column in COLUMNS[COLUMNS.index("--state") + 1].split(","):
        (row,) = [
            line for line in result.stdout.splitlines() if line.strip("│ ").startswith(f"{column} ")
        ]
        assert re.search(
            r"│ +[\d.e-]+ +│ +[\d.e-]+ to [\d.e-]+ +│ +(cannot tell|[\d.e-]+ times its error)", row
        )
    assert ddmhe.config.read_config(tmp_path / "tune.toml")["start"] == "recording"
    estimated = in_here(
        "estimate", log, *COLUMNS, "--history", 8, "--config", tmp_path / "tune.toml"
    )
    assert estimated.returncode == 0
    # chosen for accuracy, not for contraction, and said
    assert all("4 rho^M" in line for line in estimated.stderr.splitlines())
    assert printed(estimated, "horizon M") == pd.read_csv(tmp_path / "tune.csv")["horizon"][0]


def test_interval_of_the_pendulum(tmp_path):
    result = in_a_process("interval", "pendulum", "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "1.5029, 7.7372" in result.stdout
    assert "15.753, 15.753" in result.stdout
    row = re.search(r"tight, PCA\s+│ ([\d.]+)\s+│ ([\d.]+)\s+│ (\d+)", result.stdout).groups()
    assert float(row[0]) < 0.024
    assert float(row[1]) < 0.16
    assert row[2] == "0"
    assert (tmp_path / "pendulum-fig1.png").read_bytes().startswith(PNG)


def test_bounds_that_say_nothing_are_refused(tmp_path):
    """A swing of growing size that no affine system follows: the smallest radii are a large part of
    the motion."""
    t = 0.1 * np.arange(300)
    a = np.sin(t * (1 + 0.02 * t))
    frame = pd.DataFrame({"t": t, "a": a, "b": np.cos(3 * a), "y": a**2})
    log = tmp_path / "log.csv"
    frame.to_csv(log, index=False)
    options = ["--state", "a,b", "--output", "y", "--history", 10]
    result = in_here("interval", log, *options, "--out", tmp_path / "out")
    assert result.returncode == 2
    assert "verdict: " in result.stdout
    assert "says nothing beyond the recorded range" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert "smallest admissible" in result.stdout
    result = in_here("interval", log, *options, "--accept-wide", "--out", tmp_path / "out")
    assert (result.returncode, result.stderr) == (0, "")
    assert "says nothing beyond the recorded range" in result.stdout
    for written in (result.stdout, (tmp_path / "out" / "interval.csv").read_text()):
        assert not re.search(r"\b(inf|nan)\b", written)


def test_interval_of_a_log(tmp_path):
    """A linear system with bounded noise: the log's states stay inside, and the files hold the
    bounds."""
    rng = np.random.default_rng(0)
    x, y = [np.array([2.0, -1.0])], []
    for _ in range(200):
        y.append(x[-1] @ [1.0, 0.5] + 0.3 + 0.02 * rng.uniform(-1, 1))
        x.append(np.array([[0.95, 0.2], [-0.15, 0.9]]) @ x[-1] + 0.01 * rng.uniform(-1, 1, 2))
    log = tmp_path / "log.csv"
    frame = pd.DataFrame(
        {"t": 0.1 * np.arange(200), "a": np.array(x)[:-1, 0], "b": np.array(x)[:-1, 1], "y": y}
    )
    frame.to_csv(log, index=False)
    options = ["--state", "a,b", "--output", "y", "--history", 6]
    result = in_a_process(
        "interval", log, *options, "--w-radius", 0.01, "--v-radius", 0.02, "--out", tmp_path
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "Guaranteed for every system" in result.stdout
    assert re.search(
        r"verdict: a 0\.\d+ of the recorded range; b 0\.\d+ of the recorded range", result.stdout
    )
    assert printed(result, "samples of the log outside") == 0
    written = pd.read_csv(tmp_path / "interval.csv")
    truth = frame.set_index("t").loc[written["t"]]
    for name in ("a", "b"):
        assert (truth[name].to_numpy() >= written[f"{name} lower"]).all()
        assert (truth[name].to_numpy() <= written[f"{name} upper"]).all()
    assert (written["b upper"] - written["b lower"]).iloc[50:].mean() < 0.5
    blind = frame.copy()
    blind.loc[61:, ["a", "b"]] = np.nan  # the states end with the history
    blind.to_csv(tmp_path / "blind.csv", index=False)
    again = ["--w-radius", 0.01, "--v-radius", 0.02, "--out", tmp_path / "blind"]
    result = in_here("interval", tmp_path / "blind.csv", *options, *again)
    assert (result.returncode, result.stderr) == (0, "")
    assert "outside" not in result.stdout.split("Guaranteed")[0]
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "blind" / "interval.csv"), written)
    assert (tmp_path / "interval.png").read_bytes().startswith(PNG)
    for changed, words in (
        (
            ["--w-radius", 1e-4, "--v-radius", 0.02],
            "w_radius: expected a bound that an affine system satisfies",
        ),
        (["--w-radius", "1e-4,1", "--v-radius", 0.02], "for a, "),
        (["--w-radius", 0.01], "--v-radius: expected with a log"),
        (["--w-radius", "x", "--v-radius", 0.02], "--w-radius"),
    ):
        result = in_here("interval", log, *options, *changed, "--out", tmp_path)
        assert result.returncode == 2
        assert words in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
