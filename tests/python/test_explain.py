"""What is said of a recording: the first sentence is what was asked for."""

import json

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_here

DT = 0.05


def write(path, x, y):
    columns = {"time_s": DT * np.arange(len(y))}
    columns |= {f"x{i + 1}": column for i, column in enumerate(x.T)}
    columns |= {f"y{i + 1}": column for i, column in enumerate(y.T)}
    pd.DataFrame(columns).to_csv(path, index=False)


def oscillator(rng, N=600, seen=True):
    """Two masses of which one is measured, and a walk that no output shows, where asked for."""
    A = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]]) * 0.999
    x = np.ones((N, 2))
    for k in range(N - 1):
        x[k + 1] = A @ x[k] + 0.02 * rng.standard_normal(2)
    y = x[:, :1] + 0.01 * rng.standard_normal((N, 1))
    if not seen:
        x = np.column_stack([x, np.zeros(N)])
        for k in range(N - 1):
            x[k + 1, 2] = 0.8 * x[k, 2] + rng.standard_normal()
    return x, y


def explained(tmp_path, x, y, *options, history=15):
    write(tmp_path / "log.csv", x, y)
    state = ",".join(f"x{i + 1}" for i in range(x.shape[1]))
    return in_here(
        "explain", "log.csv", "--state", state, "--output", "y1", "--history", history, *options,
        cwd=tmp_path,
    )  # fmt: skip


def test_enough(tmp_path):
    result = explained(tmp_path, *oscillator(np.random.default_rng(0)))
    first, *rest = result.stdout.splitlines()
    assert first == "The recording is enough: every state can be estimated well from the outputs."
    assert any("are like the recording" in line for line in rest)
    assert "notation" not in result.stdout


def test_enough_for_a_part(tmp_path):
    x, y = oscillator(np.random.default_rng(0), seen=False)
    result = explained(tmp_path, x, y, "--json")
    found = json.loads(result.stdout)
    assert not found["enough"]
    first = found["sentences"][0]
    assert first.startswith("The recording is enough for a part: 'x1' and 'x2' can be estimated")
    assert "'x3' hardly better than by the mean" in first
    walk = found["states"]["x3"]
    assert walk["seen_by"] == []
    assert found["states"]["x1"]["seen_by"] == ["y1"]
    # the error to expect is that of the estimator, the spread that of the recording
    assert walk["spread"] == pytest.approx(x[:300, 2].std(), rel=0.02)
    h = ddmhe.History(x[:301], y[:300], DT)
    promise = ddmhe.DdMhe(h, start="recording").promise
    assert [s["rms"] for s in found["states"].values()] == pytest.approx(promise, rel=1e-9)


def test_too_short_is_an_answer_and_no_error(tmp_path):
    x, y = oscillator(np.random.default_rng(0))
    result = explained(tmp_path, x, y, history=0.1)
    assert result.returncode == 0
    assert result.stdout.startswith("The recording is not enough: history: expected at least")
    assert json.loads(explained(tmp_path, x, y, "--json", history=0.1).stdout)["enough"] is False


def test_the_papers_notation_is_there_on_request(tmp_path):
    x, y = oscillator(np.random.default_rng(0))
    result = explained(tmp_path, x, y, "-v")
    assert "rank condition (7), L = M │ 3 of n + 1 = 3" in result.stdout
    assert "(A, C) observable         │ yes" in result.stdout


def test_bench_times_steps_of_the_log_or_of_the_demo(log):
    told = in_here("bench", log, "--state", "wx,wy,wz", "--output", "tx,ty,tz", "--history", 20,
                   "--steps", 900, "--json")  # fmt: skip
    found = json.loads(told.stdout)
    step = found["step_seconds"]
    assert 0 < step["median"] <= step["p99"] <= step["max"]
    assert found["steps"] >= 900
    assert found["dt"] == pytest.approx(0.1)
    assert "the demo's satellite" in in_here("bench", "--steps", 10).stdout
    wrong = in_here("bench", log, "--history", 20)
    assert "Missing option '--state'" in wrong.stderr
