"""Habits that were refused once are read right, and what resembles them is not misread."""

import json

import numpy as np
import pytest

from ddmhe.recordings import LogError, read
from odd_logs import DT, HEAD, HISTORY, ROWS, N, text
from odd_logs_fourth import HOLES, TIMES, checksummed, clocked, fourth, lines

HABITS = fourth()
COLUMNS = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}
LACKING = {"words for an overload", "points for nothing", "dashes and a point", "\\N"}


@pytest.mark.parametrize("name", HABITS)
def test_a_habit_is_read_right(tmp_path, name):
    plain = tmp_path / "plain.csv"
    plain.write_text(text())
    wanted = read(plain, **COLUMNS)
    data, options = HABITS[name]
    odd = tmp_path / ("odd.mat" if name == "trajectory" else "odd")
    odd.write_bytes(data)
    found = read(odd, **COLUMNS | options)
    assert found.history.dt == pytest.approx(DT, abs=1e-6)
    for of, given in zip(found.history.recordings[0], wanted.history.recordings[0], strict=True):
        np.testing.assert_allclose(of, given, rtol=0, atol=1e-9)
    outputs = wanted.Y.copy()
    if name in LACKING:
        outputs[[k - len(wanted.history.recordings[0][1]) for k in HOLES]] = np.nan
    np.testing.assert_allclose(found.Y, outputs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.x_true, wanted.x_true, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diff(found.t), DT, rtol=1e-3)


STATED = {
    "digits of the time": "hours, minutes and seconds in the digits of 'utc'",
    "day of the year": "time of columns 'YEAR', 'DOY' and 'SOD'",
    "units in the cells": "rad in the cells of 'q1'",
    "vectors in the cells": "2 numbers in each cell of 'w'",
    "zeros behind the end": "777 zeros behind the end left out",
    "statistics below": "3 lines below the samples left out",
    "a value a row": "a value a row: names in 'signal', values in 'value'",
    "a line a channel": "a line a channel",
    "pairs behind a logger's words": "1 lines without them left out",
    "times of receiving": "times of receiving before the lines",
    "a time by its unit": "time column (by its unit) 'T' in s",
}


@pytest.mark.parametrize("name", STATED)
def test_what_was_inferred_is_stated(tmp_path, name):
    data, options = HABITS[name]
    (tmp_path / "odd").write_bytes(data)
    assert STATED[name] in "; ".join(read(tmp_path / "odd", **COLUMNS | options).notes)


def changed(column, cells):
    rows = [[*r[:column], c, *r[column + 1 :]] for r, c in zip(ROWS, cells, strict=True)]
    return lines(HEAD, *rows)


PAIRS = [[f"{n}={c}" for n, c in zip(HEAD, r, strict=True)] for r in ROWS]
ALIKE = {
    "frames of film": (
        clocked(f"12:00:{k // 25:02}:{k % 25:02}" for k in range(N)), "expected a finite number",
    ),
    "times of the day with dots": (
        clocked(f"12.{1 + k // 28:02}.{1 + k % 28:02}" for k in range(N)), "finite number",
    ),
    "seconds with a gap": (
        clocked(f"{(100057.9 if k < 100 else 100100) + DT * k:.2f}" for k in range(N)),
        "gaps that can be filled",
    ),
    "milliseconds beside a date": (
        lines(["Date", "Time", *HEAD[1:]],
              *(["20240501", str(100 * k), *r[1:]] for k, r in enumerate(ROWS))),
        "holds whole numbers without a unit",
    ),
    "two units": (
        changed(1, [f"{r[1]} {'mV' if k % 50 == 9 else 'V'}" for k, r in enumerate(ROWS)]),
        "found '0.8 V'",
    ),
    "thousands by a letter": (changed(1, [f"{r[1]}k" for r in ROWS]), "found '0.8k'"),
    "groups of two digits": (changed(1, ["12\N{NO-BREAK SPACE}34"] * N), "finite number"),
    "a last column without a name": (
        lines(HEAD, *([*r, "5"] for r in ROWS)), "expected 4 cells as in the header, found 5",
    ),
    "counting, and a last column without a name": (
        lines(HEAD, *([str(k + 1), *r[1:], "5"] for k, r in enumerate(ROWS))),
        "may count rows",
    ),
    "pairs in another order": (
        lines(*(p if k % 9 else [p[0], p[2], p[1], p[3]] for k, p in enumerate(PAIRS)), sep=" "),
        "expected a column",
    ),
    "zeros within": (text().encode()[:3000] + bytes(9) + text().encode()[3000:], "neither"),
    "series at other times": (
        json.dumps([
            {"target": n, "points": [[t + (0.01 if n == "q1" else 0), float(r[k])]
                                     for t, r in zip(TIMES, ROWS, strict=True)]}
            for k, n in enumerate(HEAD) if k
        ]),
        "expected series at the same times",
    ),
    "two values at once": (
        lines(["time_s", "signal", "value"],
              *([r[0], HEAD[i], r[i]] for r in [*ROWS, ROWS[7]] for i in (1, 2, 3))),
        "expected one value of 'w1' at '0.14', found another",
    ),
    "dates of two digits that change": (
        clocked(f"0{5 + k // 200}/06/07 12:00:{DT * k:05.2f}" for k in range(N)),
        "may begin with the day or the month",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ALIKE)
def test_what_is_alike_is_not_misread(tmp_path, name):
    data, words = ALIKE[name]
    (tmp_path / "odd").write_bytes(data if isinstance(data, bytes) else data.encode())
    with pytest.raises(LogError, match=words) as e:
        read(tmp_path / "odd", **COLUMNS)
    assert "\n" not in str(e.value)


def test_a_line_with_a_wrong_checksum_is_left_out_and_said(tmp_path):
    rows = [checksummed(row) for row in ROWS]
    rows[180] = rows[180].replace("$RIG,3.6,", "$RIG,3.6,9")
    (tmp_path / "odd").write_text(lines(*rows))
    r = read(tmp_path / "odd", **COLUMNS | {"state": ["3", "4"], "output": ["5"], "time": "2"})
    assert "1 lines with another one left out" in "; ".join(r.notes)
    assert np.flatnonzero(np.isnan(r.Y[:, 0])).tolist() == [180 - 150]


def test_a_stream_wants_lines_that_stand_alone(tmp_path):
    from ddmhe.recordings.csv_log import clocked as table_of
    from ddmhe.recordings.csv_log import log_of_clocked
    from ddmhe.recordings.options import Reading
    from ddmhe.recordings.stream import Stream

    for name in ("units in the cells", "pairs", "parts of a date", "digits of the time"):
        (tmp_path / "odd").write_bytes(HABITS[name][0])
        found = table_of(tmp_path / "odd", (["w1", "w2"], ["q1"], []), Reading())
        with pytest.raises(LogError, match="expected lines that can be read one by one"):
            Stream.after(log_of_clocked(found, Reading()), found, Reading(), 0)
