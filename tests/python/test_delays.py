"""Outputs that are late: what `read_log` and `--delay` do with a known delay."""

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import COLUMNS, OUTPUT, STATE, T, in_here, printed
from ddmhe.logs import LogError, read_log

LATE = 7
"""Samples by which the outputs of `late` are late, of .1 s."""


def delayed(frame, **by):
    """The log with each output so many rows later; the first rows repeat the first output."""
    moved = frame.copy()
    for name, rows in by.items():
        values = frame[name].to_numpy()
        moved[name] = values[np.clip(np.arange(len(values)) - rows, 0, None)]
    return moved


@pytest.fixture(scope="module")
def late(frame):
    return delayed(frame, **dict.fromkeys(OUTPUT, LATE))


def saved(frame, path):
    frame.to_csv(path, index=False)
    return path


def test_outputs_are_moved_back_to_their_instant(frame, late, tmp_path):
    path = saved(late, tmp_path / "late.csv")
    log = read_log(path, STATE, OUTPUT, delay=LATE * 0.1)
    whole = read_log(saved(frame, tmp_path / "log.csv"), STATE, OUTPUT)
    np.testing.assert_array_equal(log.x, whole.x)
    np.testing.assert_array_equal(log.t, whole.t)
    np.testing.assert_array_equal(log.y[:-LATE], whole.y[:-LATE])
    assert np.isnan(log.y[-LATE:]).all()
    assert log.delay == dict.fromkeys(OUTPUT, pytest.approx(0.7))
    split = log.split(20.0)
    assert split.history.T == T
    assert len(split.Y) == len(whole.split(20.0).Y)
    assert np.isnan(split.Y[1 - LATE :]).all()


def test_each_output_has_its_own_delay(frame, tmp_path):
    path = saved(delayed(frame, ty=3), tmp_path / "one.csv")
    log = read_log(path, STATE, OUTPUT, delay={"ty": 0.3})
    np.testing.assert_array_equal(log.y[:-3], frame[OUTPUT].to_numpy()[:-3])
    np.testing.assert_array_equal(log.y[-3:, [0, 2]], frame[OUTPUT].to_numpy()[-3:, [0, 2]])
    assert np.isnan(log.y[-3:, 1]).all()


def test_a_state_that_is_also_an_output_stays_in_place(frame, tmp_path):
    path = saved(frame, tmp_path / "log.csv")
    log = read_log(path, STATE, ["wx"], delay=0.2)
    np.testing.assert_array_equal(log.x, frame[STATE])
    np.testing.assert_array_equal(log.y[:-2, 0], frame["wx"][2:])


def test_a_delay_of_the_file_s_samples_is_taken_off_before_thinning(late, frame, tmp_path):
    path = saved(late, tmp_path / "late.csv")
    log = read_log(path, STATE, OUTPUT, delay=0.7, decimate=4, start=1.0)
    assert log.dt == pytest.approx(0.4)
    rows = np.arange(12, len(frame) - LATE, 4)  # the first of every fourth sample from 1 s on
    np.testing.assert_array_equal(log.y[: len(rows)], frame[OUTPUT].to_numpy()[rows])
    np.testing.assert_array_equal(log.x[: len(rows)], frame[STATE].to_numpy()[rows])


def test_outputs_that_come_early_are_moved_ahead(frame, tmp_path):
    early = frame.copy()
    early[OUTPUT] = frame[OUTPUT].shift(-2).ffill()
    log = read_log(saved(early, tmp_path / "early.csv"), STATE, OUTPUT, delay=-0.2)
    np.testing.assert_array_equal(log.x, frame[STATE].to_numpy()[2:])
    np.testing.assert_array_equal(log.y, frame[OUTPUT].to_numpy()[2:])
    assert log.lines[0] == 4


@pytest.mark.parametrize(
    ("delay", "words"),
    [
        (0.13, "delay: expected whole samples of .*log.csv, 0.1 s each, found 0.13 s for output"),
        ({"tx": 0.2, "wx": 0.1}, "delay: expected the name of an output column, found 'wx'"),
        (float("nan"), "delay: expected finite seconds, .* found nan"),
        ("0.2", "delay: expected finite seconds, .* found '0.2'"),
        (True, "delay: expected finite seconds, .* found True"),
        ({"tx": None}, "delay: expected finite seconds, .* found None"),
        (70.0, "delay: expected less than the 60 s of .*log.csv, found 70 s for output 'tx'"),
    ],
)
def test_a_wrong_delay_is_named(frame, tmp_path, delay, words):
    path = saved(frame, tmp_path / "log.csv")
    with pytest.raises(LogError, match=words):
        read_log(path, STATE, OUTPUT, delay=delay)


def test_what_is_wrong_in_a_late_output_is_told_at_its_own_line(late, tmp_path):
    late = late.copy()
    late.loc[49, "ty"] = np.nan
    path = saved(late, tmp_path / "late.csv")
    with pytest.raises(LogError, match="line 51, column 'ty': expected a number inside the histor"):
        read_log(path, STATE, OUTPUT, delay=0.7).split(20.0)


def test_a_lost_row_leaves_its_late_outputs_unknown(frame, late, tmp_path):
    """The row of sample 107 had what was so at 100; that of sample 400 what was so at 393."""
    path = saved(late.drop(index=[107, 400]), tmp_path / "late.csv")
    log = read_log(path, STATE, OUTPUT, delay=0.7).fill_gaps()
    y = frame[OUTPUT].to_numpy()
    unknown = np.flatnonzero(np.isnan(log.y).any(axis=1))
    lost_rows, lost_outputs, end = [107, 400], [100, 393], range(len(frame) - LATE, len(frame))
    assert set(unknown) == {*lost_rows, *lost_outputs, *end}
    known = np.setdiff1d(np.arange(len(frame)), unknown)
    np.testing.assert_array_equal(log.y[known], y[known])
    recorded = log.split(20.0).history.recordings[0][1]
    np.testing.assert_allclose(recorded[100], (y[99] + y[101]) / 2)


def test_a_history_that_a_delay_leaves_without_outputs_is_refused(late, tmp_path):
    path = saved(late.iloc[:210], tmp_path / "late.csv")
    with pytest.raises(
        LogError, match=r"outputs for all of it, found that a delay of 0\.7 s of 'tx"
    ):
        read_log(path, STATE, OUTPUT, delay=0.7).split(20.5)


def test_the_command_takes_a_known_delay_off(frame, late, tmp_path):
    """As good as the log without it up to the samples that have no output."""
    saved(late, tmp_path / "late.csv")
    saved(frame, tmp_path / "log.csv")
    read = [*COLUMNS, "--history", 20]
    ways = {
        "moved": ("late.csv", "--delay", 0.7),
        "named": ("late.csv", "--delay", "tx=0.7, ty=0.7, tz=0.7"),
        "whole": ("log.csv",),
    }
    for name, (file, *options) in ways.items():
        result = in_here("estimate", file, *read, *options, "--out", f"{name}.csv", cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        if options:
            assert printed(result, "delay of ty") == 0.7
    found = {name: pd.read_csv(tmp_path / f"{name}.csv") for name in ways}
    pd.testing.assert_frame_equal(found["moved"], found["named"])
    assert len(found["moved"]) == len(found["whole"])
    known = slice(0, len(found["whole"]) - LATE)
    np.testing.assert_array_equal(found["moved"][STATE][known], found["whole"][STATE][known])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.13", "delay: expected whole samples of log.csv, 0.1 s each, found 0.13 s"),
        ("wx=0.2", "delay: expected the name of an output column, found 'wx'"),
        ("tx=0.2,tx=0.3", "expected different NAME=SECONDS parted by commas"),
        ("0.2,0.3", "expected seconds, or NAME=SECONDS"),
        ("nan", "expected seconds, or NAME=SECONDS"),
        ("tx=inf", "expected different NAME=SECONDS parted by commas"),
        ("=0.2", "expected different NAME=SECONDS parted by commas"),
    ],
)
def test_a_delay_that_cannot_be_taken_off_ends_with_one_line(frame, tmp_path, text, words):
    saved(frame, tmp_path / "log.csv")
    read = ["estimate", "log.csv", *COLUMNS, "--history", 20]
    result = in_here(*read, "--delay", text, cwd=tmp_path)
    assert result.returncode != 0
    assert words in " ".join(result.stderr.split()).replace("│ ", "").replace(" │", "")
    assert "Traceback" not in result.stderr


def test_other_commands_take_it_off_too(late, frame, tmp_path):
    """A design is that of the recording without the delay."""
    saved(late, tmp_path / "late.csv")
    saved(frame, tmp_path / "log.csv")
    read = [*COLUMNS, "--history", 20]
    moved = in_here("design", "late.csv", *read, "--delay", 0.7, "--out", "moved", cwd=tmp_path)
    whole = in_here("design", "log.csv", *read, "--out", "whole", cwd=tmp_path)
    assert moved.returncode == whole.returncode == 0, moved.stderr
    texts = [(tmp_path / name / "design.toml").read_text() for name in ("moved", "whole")]
    assert texts[0] == texts[1]


def test_an_estimator_of_a_moved_recording_is_that_of_the_recording(frame, late, tmp_path):
    log = read_log(saved(late, tmp_path / "late.csv"), STATE, OUTPUT, delay=0.7)
    est = ddmhe.DdMhe(log.split(20.0).history)
    x, y = frame[STATE].to_numpy(), frame[OUTPUT].to_numpy()
    other = ddmhe.DdMhe(ddmhe.History(x[: T + 1], y[:T], 0.1))
    rows = slice(T, -LATE - 1)
    np.testing.assert_array_equal(est.run(log.y[rows]).x, other.run(y[rows]).x)
