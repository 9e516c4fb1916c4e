"""`ddmhe estimate` as a user meets it: files in a directory, one row per row of the log."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import COLUMNS, OUTPUT, PNG, STATE, N, T, in_a_process, in_here, printed


def estimates_of(recording, **settings):
    history = ddmhe.History(recording.x[: T + 1], recording.y[:T], dt=0.1)
    return ddmhe.DdMhe(history, **{"start": "recording"} | settings).run(recording.y[T:-1])


def test_estimate_writes_what_the_estimator_gives(recording, log, tmp_path):
    out = tmp_path / "est.csv"
    result = in_a_process("estimate", log, *COLUMNS, "--history", 20, "--out", out)
    assert result.returncode == 0, result.stderr
    written = pd.read_csv(out)
    beside = [*(f"{name}_std" for name in STATE), "trusted", "reasons"]
    assert list(written.columns)[: 4 + len(beside)] == ["t", *STATE, *beside]
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
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--out", tmp_path / "new" / "dir")
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


def test_filled_gaps_give_a_row_for_every_step(frame, log, tmp_path):
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
    np.testing.assert_allclose(written["t"], frame["t"][frame.index > T], rtol=1e-12)
    np.testing.assert_array_equal(written["filled"], ~frame.index[T + 1 :].isin(holed.index))
    assert np.isfinite(written[STATE]).all(axis=None)
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
    assert expected.returncode == 0
    assert "--missing" not in expected.stderr
    for given in (["--missing", "-9999,999"], ["--config", tmp_path / "est.toml"]):
        result = in_here(
            "estimate", tmp_path / "coded.csv", *options, *given, "--out", tmp_path / "est.csv"
        )
        assert (result.returncode, result.stderr) == (0, expected.stderr)
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


@pytest.mark.parametrize("wrong", ["", "x, ", "1,,2", "nan", "1e999"])
def test_wrong_missing_option(log, wrong):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--missing", wrong)
    assert result.returncode == 2
    assert re.fullmatch(
        r"ddmhe: error: .*--missing.*expected finite numbers or words [^\n]+\n", result.stderr
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
    expected = []
    for sentence in est.warnings:  # with the columns' names, on the log's clock
        named = re.sub(
            r"state (\d) \(counted from 0\)",
            lambda found: f"state {STATE[int(found[1])]!r}",
            sentence,
        )
        clock = re.sub(
            r"from (\S+) s on", lambda found: f"from {20 + float(found[1]):g} s on", named
        )
        expected.append(f"ddmhe: warning: {clock}")
    assert sorted(result.stderr.splitlines()) == sorted(expected)
    steps = [int(step) for step in re.findall(r"\(step (\d+)\)", result.stderr)]
    assert steps == sorted(steps)
    assert len(steps) > 1


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
    rows, clock = pd.read_csv(tmp_path / "est.csv"), pd.read_csv(path)["time_s"]
    t = rows["time_s"][rows["filled"] == 0]
    assert t.isin(clock).all()
    # after lost rows, too, samples stand on the grid of four steps of the clock: late stamps and
    # all
    step = clock.diff()[clock.diff() < 0.009].mean()
    off = (t.diff().dropna() / (4 * step) + 0.5) % 1 - 0.5
    assert off.abs().max() < 0.2  # a row off is a quarter


def test_more_directions_than_there_are_are_told(log):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--space", "truncated:999")
    assert re.search(
        r"trajectory space +│ \d+ directions, no more are there \(given: 999\)", result.stdout
    )


def test_the_lifted_estimator(tmp_path):
    """The same numbers as in Python; settings that it has not are those of DdMhe in its place."""
    record = ddmhe.models.pendulum().simulate(40.0, 0.05, noise=0.002)
    rows = np.column_stack([record.t, record.x, record.y])
    np.savetxt(tmp_path / "log.csv", rows, "%.17g", ",", header="time_s,a,w,y", comments="")
    columns = ["log.csv", "--state", "a,w", "--output", "y", "--history", 15]
    options = ["--estimator", "lifted", "--horizon", 12, "--out", "est.npz"]
    result = in_here("estimate", *columns, *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    h = ddmhe.History(record.x[:301], record.y[:300], dt=0.05)
    est = ddmhe.LiftedMhe(h, fallback={"horizon": 12, "start": "recording"})
    log = est.run(record.y[300:-1])
    assert est.chosen
    found = np.load(tmp_path / "est.npz")
    np.testing.assert_array_equal(np.column_stack([found["a"], found["w"]]), log.x)
    np.testing.assert_array_equal(np.column_stack([found["a_std"], found["w_std"]]), log.std)
    np.testing.assert_array_equal(found["status"], log.status)
    for words in (r"polynomial model +│ degree 3", r"horizon +│ 12 \(given\)"):
        assert re.search(words, result.stdout)
    told = json.loads(in_here("estimate", *columns, *options, "--json", cwd=tmp_path).stdout)
    assert (told["estimator"], told["chosen"], told["degree"]) == ("lifted", True, 3)
    live = in_here("estimate", *columns, *options, "--follow", cwd=tmp_path)
    assert "--estimator: expected dd with --follow" in live.stderr


def test_logs_written_in_python_are_joined():
    """What a progress bar runs in pieces is what one run is."""
    from ddmhe.cli.running import _joined

    record = ddmhe.models.pendulum().simulate(20.0, 0.05, noise=0.002)
    h = ddmhe.History(record.x[:201], record.y[:200], dt=0.05)
    est, again = ddmhe.LiftedMhe(h), ddmhe.LiftedMhe(h)
    parts = [est.run(record.y[200:230]), est.run(record.y[230:300])]
    assert _joined(parts) == again.run(record.y[200:300])
