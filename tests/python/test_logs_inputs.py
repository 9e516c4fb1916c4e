"""Known inputs in a log: they travel with their samples, and are known at every one of them."""

import numpy as np
import pytest

import ddmhe
from ddmhe.logs import LogError, read_log

HEADER = "time_s,w,torque,volt_V,duty"


def write(path, rows, header=HEADER):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def row(k, u=None):
    """State k, output 10 k, inputs 100 k and -k: every number names its row."""
    return f"{0.1 * k:.4f},{k},{10 * k},{100 * k if u is None else u},{-k}"


def read(path, **options):
    return read_log(
        path, **{"state": ["w"], "output": ["torque"], "input": ["volt_V", "duty"]} | options
    )


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "log.csv", [row(k) for k in range(40)])


def test_inputs_are_those_of_the_outputs_rows(path):
    log = read(path, start=0.5)
    assert log.names.input == ("volt_V", "duty")
    split = log.split(1.0)
    assert (split.history.m, split.history.u_units) == (2, ["V", ""])
    np.testing.assert_array_equal(split.history.inputs[0][:, 0], 100 * np.arange(5, 15))
    np.testing.assert_array_equal(split.U, np.outer(np.arange(15, 39), [100, -1]))
    np.testing.assert_array_equal(split.U[:, 0], 10 * split.Y[:, 0])
    history, Y, t, x_true = split
    assert history.T == 10
    assert len(Y) == len(t) == len(x_true) == len(split.U)


def test_a_log_without_inputs_has_none(path):
    log = read_log(path, ["w"], ["torque"])
    assert log.u is None
    assert (log.split(1.0).U, log.split(1.0).history.m) == (None, 0)
    assert log.fill_gaps().u is None


def test_inputs_are_thinned_with_their_samples(path):
    split = read(path, decimate=3).split(2.0)
    np.testing.assert_array_equal(split.history.inputs[0][:, 1], -3 * np.arange(7))
    np.testing.assert_array_equal(split.U[:, 0], 10 * split.Y[:, 0])


def test_units_below_the_header_are_those_of_the_inputs(tmp_path):
    rows = ["s,m,N,mV,-", *[row(k) for k in range(20)]]
    history = read(write(tmp_path / "log.csv", rows)).split(1.0).history
    assert history.u_units == ["mV", "-"]


@pytest.mark.parametrize("cell", ["", "nan", "-9999"])
@pytest.mark.parametrize("k", [3, 10, 30])
def test_a_missing_input_is_named_with_column_and_line(tmp_path, cell, k):
    """In the history, at its end and after it."""
    rows = [row(i, cell if i == k else None) for i in range(40)]
    log = read(write(tmp_path / "log.csv", rows), missing=[-9999])
    with pytest.raises(LogError) as e:
        log.split(1.0)
    assert f"log.csv, line {k + 2}, column 'volt_V': expected a number at every sample" in str(
        e.value
    )


def test_the_last_input_acts_on_nothing_that_is_estimated(tmp_path):
    rows = [row(i, "" if i == 39 else None) for i in range(40)]
    split = read(write(tmp_path / "log.csv", rows)).split(1.0)
    assert np.isfinite(split.U).all()
    assert split.U[-1, 0] == 3800


@pytest.mark.parametrize("lost", [(5, 6), (25,)])
def test_a_gap_leaves_inputs_unknown(tmp_path, lost):
    """Outputs there count as not measured; an input does not stop to act."""
    rows = [row(i) for i in range(40) if i not in lost]
    log = read(write(tmp_path / "log.csv", rows))
    with pytest.raises(LogError, match="fill the gaps"):
        log.split(1.0)
    with pytest.raises(LogError) as e:
        log.fill_gaps().split(1.0)
    before = lost[0] - 1
    assert f"log.csv: gap at {0.1 * before:g} s (line {before + 2}), column 'volt_V'" in str(
        e.value
    )
    assert f"found {len(lost)} samples missing" in str(e.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"input": ["amps"]}, "input: expected a column of .* found 'amps'"),
        ({"input": ["volt"]}, "did you mean 'volt_V'"),
        ({"input": ["duty", "duty"]}, "input: expected different columns, found 'duty'"),
        ({"input": ["time_s"]}, "input: expected columns other than the time column"),
        ({"input": "duty"}, "input: expected a list of column names, found 'duty'"),
        ({"unwrap": ["x"]}, "unwrap: expected a column of the states, outputs or inputs"),
    ],
)
def test_wrong_names_are_one_clear_error(path, options, message):
    with pytest.raises(ddmhe.DdmheError, match=message):
        read(path, **options)


def test_an_input_that_jumps_by_a_turn_can_be_unwrapped(tmp_path):
    angle = (0.3 * np.arange(60) + np.pi) % (2 * np.pi) - np.pi
    rows = [row(k, f"{a:.9f}") for k, a in enumerate(angle)]
    log = read(write(tmp_path / "log.csv", rows), unwrap=["volt_V"])
    np.testing.assert_allclose(np.diff(log.u[:, 0]), 0.3, atol=1e-8)
