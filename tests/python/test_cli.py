"""The command line as a user meets it: help, the demo, and every wrong usage."""

import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from commands import COLUMNS, PNG, in_a_process, in_here, printed_cells
from ddmhe.models import detumbling


def test_demo_writes_its_files_and_beats_a_constant(tmp_path):
    result = in_a_process("demo", "--out", "here", "--seed", 2, cwd=tmp_path)
    assert result.returncode == 0
    assert all(line.startswith("ddmhe: warning: ") for line in result.stderr.splitlines())
    truth = detumbling().simulate(620.0, 0.1, integrator="accurate").x[201:]
    norms = []
    for column, file in ((0, "estimate.csv"), (2, "rigid-body.csv")):
        written = pd.read_csv(tmp_path / "here" / file)
        np.testing.assert_allclose(written["time_s"], 0.1 * np.arange(201, 6201), rtol=1e-12)
        error = np.rad2deg(written.iloc[:, 1:4].to_numpy() - truth)
        for seconds in (20, 40, 100, 600):
            norm = np.sqrt(np.mean(np.sum(error[: 10 * seconds] ** 2, axis=1)))
            told = printed_cells(result, f"RMSE norm {seconds} s")[column]
            assert told == pytest.approx(norm, abs=1e-4)
            norms.append(norm)
    assert norms[2] < np.rad2deg(np.sqrt(truth[:1000].var(axis=0).sum()))
    assert max(norms[4:]) < 0.1
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
# a certificate from a file, an observer with a given gain
import ddmhe.baselines, ddmhe.design, ddmhe.interval
print(sorted({"cvxpy", "matplotlib"} & set(sys.modules)))
"""


def test_what_takes_long_to_import_is_imported_when_it_is_used():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS], capture_output=True, text=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("[]\n[]\n", "")


BASE = ["estimate", "log.csv", *COLUMNS, "--history", "20"]
WRONG = [
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
        ["estimate", "hole.csv", *COLUMNS, "--history", "20", "--gaps", "error"],
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
