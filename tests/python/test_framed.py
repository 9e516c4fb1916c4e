"""Recordings from frames: by the names of columns, and what frames in the place of arrays hide."""

import numpy as np
import pandas as pd
import polars as pl
import pytest

import ddmhe

STATES, OUTPUTS = ["w1", "w2"], ["q"]


@pytest.fixture(scope="module")
def frame():
    rng = np.random.default_rng(3)
    t = 0.05 * np.arange(80)
    w = np.stack([np.sin(t), np.cos(t)], axis=1) + 1e-3 * rng.normal(size=(80, 2))
    return pd.DataFrame(
        {"time_s": t, "q": w @ [1.0, 2.0], "w2": w[:, 1], "tau": np.cos(3 * t), "w1": w[:, 0]}
    )


def plain(frame, inputs=False):
    x, y = frame[STATES].to_numpy(), frame[OUTPUTS].to_numpy()[:-1]
    u = frame[["tau"]].to_numpy()[:-1] if inputs else None
    return ddmhe.History(x, y, 0.05, u)


@pytest.mark.parametrize("kind", [pd.DataFrame, pl.from_pandas, lambda f: f.to_dict("series")])
def test_a_frame_is_read_by_the_names_of_its_columns(frame, kind):
    made = ddmhe.History(kind(frame), state=STATES, output=OUTPUTS, input=["tau"])
    wanted = plain(frame, inputs=True)
    assert (made.n, made.p, made.m, made.T) == (2, 1, 1, 79)
    assert made.dt == pytest.approx(0.05, rel=1e-9)
    for (x, y), (x_wanted, y_wanted) in zip(made.recordings, wanted.recordings, strict=True):
        assert np.array_equal(x, x_wanted)
        assert np.array_equal(y, y_wanted)
    assert np.array_equal(made.inputs[0], wanted.inputs[0])


def test_a_clock_is_found_stated_or_asked_about(frame):
    bare = frame.drop(columns="time_s")
    assert ddmhe.History(bare, state=STATES, output=OUTPUTS, dt=0.1).dt == 0.1
    with pytest.raises(ddmhe.DdmheError, match="no column is known as the time"):
        ddmhe.History(bare, state=STATES, output=OUTPUTS)
    # the index of pandas is one where it says so
    indexed = frame.set_index("time_s")
    assert ddmhe.History(indexed, state=STATES, output=OUTPUTS).dt == pytest.approx(0.05)


def test_units_are_those_that_are_stated(frame):
    named = {"state": STATES, "output": OUTPUTS}
    made = ddmhe.History(frame, **named, x_units="rad/s", y_units=["Nm"])
    assert (made.x_units, made.y_units) == (["rad/s", "rad/s"], ["Nm"])
    with pytest.raises(ddmhe.ShapeError, match="x_units"):
        ddmhe.History(frame, **named, x_units=["rad/s", "rad", "s"])


@pytest.mark.parametrize(
    ("arguments", "named", "words"),
    [
        ((), {"state": STATES}, "output: expected names of the frame's columns"),
        (
            (),
            {"state": ["w1", "w3"], "output": OUTPUTS},
            "state: .* of the DataFrame, found 'w3'",
        ),
        (([1.0, 2.0],), {"state": STATES, "output": OUTPUTS}, "y: expected none beside state="),
        ((), {}, "y: expected outputs"),
        ((), {"state": ["time_s"], "output": OUTPUTS}, "other than the time column"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(frame, arguments, named, words):
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.History(frame, *arguments, **named)
    with pytest.raises(ddmhe.DdmheError, match="x: expected a frame"):
        ddmhe.History(np.ones((9, 2)), state=STATES, output=OUTPUTS)


def test_lost_rows_and_blank_cells_are_filled_as_read_does(frame):
    holed = frame.drop(index=40)
    made = ddmhe.History(holed, state=STATES, output=OUTPUTS)
    assert made.T == 79
    read = ddmhe.recordings.read(holed, state=STATES, output=OUTPUTS, history=3.9)
    assert np.array_equal(made.recordings[0][0][:79], read.history.recordings[0][0])


def test_frames_in_the_place_of_arrays_hold_no_clock_and_rows_of_one_instant(frame):
    x, y = frame[STATES], frame["q"]
    made = ddmhe.History(x, y.iloc[:-1], 0.05)
    assert np.array_equal(made.recordings[0][1], plain(frame).recordings[0][1])
    ddmhe.History(pl.from_pandas(x), pl.from_pandas(y)[:-1], 0.05)
    with pytest.raises(ddmhe.DdmheError, match=r"x: .*'time_s', which looks like the clock"):
        ddmhe.History(frame[["time_s", *STATES]], y.iloc[:-1], 0.05)
    with pytest.raises(ddmhe.DdmheError, match=r"y: .*'time_s', which looks like the clock"):
        ddmhe.History(pl.from_pandas(x), pl.from_pandas(frame[["time_s", "q"]])[:-1], 0.05)
    with pytest.raises(ddmhe.ShapeError, match="y: expected rows of the same index"):
        ddmhe.History(x, y.iloc[1:], 0.05)
    ddmhe.History(x, y.iloc[1:].to_numpy(), 0.05)
