"""`design.output_delay`: a recording says by how much its outputs lag its states, or nothing; and
what the commands make of it."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_here
from ddmhe.design import output_delay
from ddmhe.models import detumbling
from ddmhe.reproduce.driven import CASES, task_of
from ddmhe.reproduce.real import pendulum_task

DATA = Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="measured logs are kept elsewhere")
T = 200


def driven(seed, n=2, T=T, u_share=0.0):
    """States that noise drives, and an input if it has a share; outputs of all of them."""
    rng = np.random.default_rng([seed, 61])
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A, C = (
        V @ np.diag(0.9 * np.linspace(1, 0.7, n)) @ V.T,
        np.linalg.qr(rng.standard_normal((n, n)))[0],
    )
    x, u, rows = np.zeros(n), rng.standard_normal(T + 100), []
    for now in u:
        rows.append(x)
        x = A @ x + 0.1 * rng.standard_normal(n) + u_share * now
    x = np.array(rows)[: T + 61]
    y = x @ C.T + 0.02 * rng.standard_normal(x.shape) + u_share * u[: T + 61, None]
    return x, y, u[: T + 61, None]


def late(x, y, samples, u=None):
    """The recording from sample 60 on with outputs of `samples` earlier."""
    rows = np.arange(60, 60 + T)
    driven = {} if u is None else {"u": u[rows]}
    return ddmhe.History(x[60 : 61 + T], y[rows - samples], 0.1, **driven)


@pytest.mark.parametrize("samples", [1, 2, 3, 5, 10, 20, 30])
@pytest.mark.parametrize("seed", range(3))
def test_a_lag_of_driven_states_is_told(seed, samples):
    x, y, _ = driven(seed)
    found = output_delay(late(x, y, samples))
    assert found.samples == (samples, samples)
    assert found.seconds == pytest.approx((0.1 * samples,) * 2)
    assert found.words[1].startswith("output 1 (counted from 0) lags the recorded states by about")
    assert found.unexplained.shape == (2, len(found.lags))
    assert (found.lags[found.unexplained.argmin(axis=1)] == samples).all()


def test_a_long_recording_tells_it_by_a_part_of_its_samples():
    x, y, _ = driven(11, T=20_000)
    assert output_delay(ddmhe.History(x[60:], y[53:-8], 0.1)).samples == (7, 7)


def test_each_output_has_its_own_lag():
    x, y, _ = driven(4)
    rows = np.arange(60, 60 + T)
    mixed = np.column_stack([y[rows, 0], y[rows - 4, 1]])
    found = output_delay(ddmhe.History(x[60 : 61 + T], mixed, 0.1))
    assert found.samples == (0, 4)
    assert found.words == (
        "output 1 (counted from 0) lags the recorded states by about 0.4 s (4 samples)",
    )


def test_outputs_that_come_early_are_told():
    x, y, _ = driven(5)
    rows = np.arange(50, 50 + T)
    found = output_delay(ddmhe.History(x[50 : 51 + T], y[rows + 3]))
    assert found.samples == (-3, -3)
    words = "output 0 (counted from 0) leads the recorded states by about 3 s (3 samples)"
    assert found.words[0] == words


def test_inputs_are_part_of_what_an_output_is_read_from():
    x, y, u = driven(6, u_share=0.3)
    assert output_delay(late(x, y, 0, u)).samples == (0, 0)
    rows = np.arange(60, 60 + T)
    # the sensor is late, the input is not: y(k) = C x(k-4) + D u(k-4)
    found = output_delay(ddmhe.History(x[60 : 61 + T], y[rows - 4], 0.1, u[rows]))
    assert found.samples == (4, 4)


def test_nothing_is_told_of_what_explains_itself():
    """Motions that nothing disturbs are read out as well at any lag; a phase and a filter are no
    lags."""
    t = np.arange(T + 1)
    noise = 0.01 * np.random.default_rng(0).standard_normal((T, 1))
    swing = np.column_stack([np.sin(0.2 * t), np.cos(0.2 * t)])
    whole = ddmhe.History(swing, swing[:T, :1] + noise)
    rate_alone = ddmhe.History(swing[:, 1:], swing[:T, :1] + noise)
    decay = ddmhe.History(np.exp(-0.02 * t)[:, None], np.exp(-0.02 * t[:T])[:, None] + 0.1 * noise)
    for history in (whole, rate_alone, decay):
        assert output_delay(history).samples == (None,)
        assert output_delay(history).words == ()
    x, _, _ = driven(7)
    low = np.zeros(len(x))
    for k in range(len(x) - 1):
        low[k + 1] = low[k] + (x[k, 0] - low[k]) / 5
    filtered = ddmhe.History(x[60 : 61 + T, :1], low[60 : 60 + T, None] + noise)
    assert output_delay(filtered).samples == (None,)


def test_curved_motions_in_step_are_not_called_late():
    for seed in range(4):
        record = detumbling().simulate(20.1, 0.1, noise=0.01, seed=seed)
        assert not any(output_delay(record.history(T)).samples)


def test_short_recordings_and_wrong_arguments():
    x, y, _ = driven(8)
    assert output_delay(ddmhe.History(x[:31], y[:30])).samples == (None, None)
    assert output_delay(late(x, y, 3), most=5).lags.tolist() == list(range(-5, 6))
    with pytest.raises(ddmhe.DdmheError, match="most: expected a whole number"):
        output_delay(late(x, y, 3), most=0)
    with pytest.raises(ddmhe.DdmheError, match="history: expected"):
        output_delay(y)


def test_an_output_that_never_moves_has_no_lag():
    x, y, _ = driven(9)
    still = y.copy()
    still[:, 0] = 2.5
    assert output_delay(late(x, still, 3)).samples == (None, 3)


@needs_data
def test_measured_logs_in_step_are_not_called_late():
    for path in sorted((DATA / "repoimu-pendulum").glob("*.csv")):
        assert not any(output_delay(pendulum_task(path).history).samples)
    for case in CASES.values():
        assert not any(output_delay(task_of(case, DATA / "input-logs").history()).samples)


@needs_data
def test_measured_outputs_that_are_late_are_told_and_moved_back(tmp_path):
    """The circuit's output voltage, 5 rows late in the whole file: `estimate` says so with the
    option that takes it off, which is as good as the file without the lag."""
    frame = pd.read_csv(DATA / "input-logs" / "circuit.csv")
    frame["out_y"] = frame["out_V"]
    frame.to_csv(tmp_path / "whole.csv", index=False)
    moved = frame.assign(out_y=frame["out_V"].shift(5).bfill())
    moved.to_csv(tmp_path / "late.csv", index=False)
    columns = ["--state", "nin2_V,neg_V,out_V", "--output", "out_y", "--input", "vin_V"]
    options = [*columns, "--history", 0.0032]
    told = in_here("estimate", "late.csv", *options, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    words = "output 'out_y' lags the recorded states by about 4e-05 s (5 samples): --delay out_y=4e"
    assert words in told.stderr
    option = told.stderr.split("--delay ")[1].split()[0]
    runs = {"late.csv": ["--delay", option], "whole.csv": []}
    for name, more in runs.items():
        result = in_here("estimate", name, *options, *more, "--out", f"out-{name}", cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert "lags the recorded states" not in result.stderr
    x = [pd.read_csv(tmp_path / f"out-{name}")["nin2_V"].to_numpy() for name in runs]
    np.testing.assert_allclose(x[0][:-5], x[1][:-5], rtol=1e-9)


def test_commands_tell_it_where_it_is_sure(tmp_path):
    x, y, _ = driven(10, T=400)
    rows = np.arange(60, 400)
    names = ["a", "b"]
    for name, lag in (("late", 12), ("whole", 0)):
        columns = dict(zip([*names, "p", "q"], [*x[rows].T, *y[rows - lag].T], strict=True))
        columns["q"] = y[rows, 1]
        frame = pd.DataFrame({"t": 0.01 * np.arange(len(rows)), **columns})
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    options = ["--state", "a,b", "--output", "p,q", "--history", 2]
    words = "output 'p' lags the recorded states by about 0.12 s (12 samples): --delay p=0.12\n"
    for command in ("estimate", "design"):
        into = ["--out", "made"] if command == "design" else []
        assert words in in_here(command, "late.csv", *options, *into, cwd=tmp_path).stderr
        told = in_here(command, "whole.csv", *options, *into, cwd=tmp_path)
        assert told.returncode == 0
        assert "lags" not in told.stderr
        moved = in_here(command, "late.csv", *options, *into, "--delay", "p=0.12", cwd=tmp_path)
        assert moved.returncode == 0
        assert "lags" not in moved.stderr
