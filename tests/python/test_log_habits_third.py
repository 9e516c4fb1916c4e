"""Habits of a third set, four of which were refused at first: all are read right."""

import json

import numpy as np
import pytest

from ddmhe.recordings import LogError, read
from odd_logs import DT, HEAD, HISTORY, ROWS, N, numbers, text
from odd_logs_third import third

COLUMNS = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}


@pytest.mark.parametrize("name", third())
def test_a_habit_is_read_right(tmp_path, name):
    plain = tmp_path / "plain.csv"
    plain.write_text(text())
    wanted = read(plain, **COLUMNS)
    ending, written, options = third()[name]
    odd = tmp_path / f"odd{ending}"
    odd.write_bytes(written.encode())
    found = read(odd, **COLUMNS | options)
    assert found.history.dt == pytest.approx(wanted.history.dt, abs=1e-6)
    for of, given in zip(found.history.recordings[0], wanted.history.recordings[0], strict=True):
        np.testing.assert_allclose(of, given, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.Y, wanted.Y, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.x_true, wanted.x_true, rtol=0, atol=1e-9)


def stamped(words):
    rows = [[word, *row[1:]] for word, row in zip(words, ROWS, strict=True)]
    return text(["time", *HEAD[1:]], rows)


LATER = {
    "ISO durations": (
        ".csv",
        stamped(f"PT{int(DT * k) // 60}M{DT * k % 60:.2f}S" for k in range(3000, 3000 + N)),
    ),
    "milliseconds behind a colon": (
        ".csv",
        stamped(f"12:00:{20 * k // 1000:02}:{20 * k % 1000:03}" for k in range(N)),
    ),
    "pandas' split": (
        ".json",
        json.dumps({"columns": HEAD, "index": [*range(N)], "data": numbers().tolist()}),
    ),
}
"""Refused of the second set, read since."""


@pytest.mark.parametrize("name", LATER)
def test_what_is_read_since(tmp_path, name):
    plain, odd = tmp_path / "plain.csv", tmp_path / f"odd{LATER[name][0]}"
    plain.write_text(text())
    odd.write_text(LATER[name][1])
    wanted, found = read(plain, **COLUMNS), read(odd, **COLUMNS)
    assert found.history.dt == pytest.approx(wanted.history.dt, abs=1e-6)
    np.testing.assert_allclose(found.Y, wanted.Y, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.x_true, wanted.x_true, rtol=0, atol=1e-8)


def test_frames_of_film_are_no_milliseconds(tmp_path):
    odd = tmp_path / "odd.csv"
    odd.write_text(stamped(f"12:00:{k // 25:02}:{k % 25:02}" for k in range(N)))
    with pytest.raises(LogError, match="time"):
        read(odd, **COLUMNS)


def test_there_are_eighteen():
    assert len(third()) == 18
