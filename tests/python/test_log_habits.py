"""One log in every habit of writing gives one estimate, and what was inferred is stated."""

import re

import numpy as np
import pytest

import ddmhe
from commands import in_a_process, in_here
from ddmhe.recordings import LogError, read, read_log
from odd_logs import DT, EPOCH, HEAD, HISTORY, ROWS, N, clock, comma, habits, numbers, text

COMMON = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}
HABITS = habits()
T = round(HISTORY / DT)
TRUE = np.array([[float(cell) for cell in row] for row in ROWS])
HOLES = {"missing-words", "sentinel", "words-for-nothing", "dashes"}


def written(path, data):
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


@pytest.mark.parametrize("name", HABITS)
def test_every_habit_gives_the_same_numbers(tmp_path, name):
    """To the last bit: the numbers are those of the cells."""
    data, options = HABITS[name]
    r = read(written(tmp_path / "log", data), **COMMON | options)
    (x, y), = r.history.recordings  # fmt: skip
    np.testing.assert_array_equal(x, TRUE[: T + 1, 1:3])
    np.testing.assert_array_equal(y, TRUE[:T, 3:])
    expected = TRUE[T:-1, 3:].copy()
    if name in HOLES:
        expected[[170 - T, 171 - T, 181 - T]] = np.nan
    np.testing.assert_array_equal(r.Y, expected)
    np.testing.assert_array_equal(r.x_true, TRUE[T + 1 :, 1:3])
    assert r.history.dt == pytest.approx(DT, rel=1e-4 if name == "serial-days" else 1e-9)
    np.testing.assert_allclose(np.diff(r.t), DT, rtol=1e-3)
    assert r.names.state == tuple(options.get("state", ["w1", "w2"])[-2:]) or "," in str(r.names)


STATED = {
    "semicolon": "separator ';'",
    "tab": "separator tab",
    "aligned": "separator spaces",
    "decimal-comma": "decimal comma",
    "comments": "2 comment lines left out",
    "units-row": "units in line 2",
    "latin-1": "encoding Windows-1252",
    "utf-16": "encoding UTF-16-LE",
    "lines-above": "3 lines before the header left out",
    "header-in-a-comment": "header in the comment of line 2",
    "iso": "time column 'time_s' with dates or times of the day",
    "milliseconds": "time column 'time_ms' in ms",
    "epoch-ns": "time column 'timestamp' in ns since 1970",
    "serial-days": "time column 'Timestamp' as serial days",
    "counter-first": "time column 'time_s' in s",
    "no-time": "rows 0.02 s apart",
    "duplicate": "1 repeated stamps, first taken",
    "swapped": "sorted by time, 2 rows moved",
    "missing-words": "taken as not measured: 'NA' (3)",
    "cut-in-the-last-row": "line 242, the last, is cut short and left out",
    "types-and-units": "words left out in line 2; units in line 3",
    "sec-and-nanosec": "time of columns 'header.stamp.sec' and 'header.stamp.nanosec'",
    "durations": "sec in the cells of 'Time'",
    "table-of-markdown": "a table of Markdown",
    "arff": "ARFF",
    "no-header": "no header line, columns are called 1, 2, …",
}


@pytest.mark.parametrize("name", STATED)
def test_what_was_inferred_is_stated(tmp_path, name):
    data, options = HABITS[name]
    notes = read(written(tmp_path / "log", data), **COMMON | options).notes
    assert STATED[name] in "; ".join(notes)


@pytest.mark.parametrize("name", ["units-row", "types-and-units", "long-names"])
def test_units_below_the_header_are_those_of_the_channels(tmp_path, name):
    r = read(written(tmp_path / "log", HABITS[name][0]), **COMMON)
    assert (r.history.x_units, r.history.y_units) == (["rad/s", "rad/s"], ["rad"])
    assert r.units == {"time_s": "s", "w1": "rad/s", "w2": "rad/s", "q1": "rad"}


def test_times_come_back_digit_for_digit(tmp_path):
    """Whole numbers and texts, also of rows that were filled in."""
    for name, expected in (
        ("epoch-ns", [EPOCH + 20_000_000 * k for k in range(N)]),
        ("iso", [f"2024-05-01T12:00:{DT * k:09.6f}+02:00" for k in range(N)]),
        ("milliseconds", [20 * k for k in range(N)]),
        ("epoch-seconds", [f"{1_700_000_020 + DT * k:.3f}" for k in range(N)]),
    ):
        lines = HABITS[name][0].decode().splitlines()
        del lines[200:202]  # samples 199 and 200
        r = read(written(tmp_path / "log", "\n".join(lines)), **COMMON)
        known = [k for k in range(T + 1, N) if k not in (199, 200)]
        assert [list(r.stamps)[k - T - 1] for k in known] == [expected[k] for k in known]
        if name != "epoch-seconds":
            assert list(r.stamps) == expected[T + 1 :]
        assert np.isnan(r.Y[[199 - T, 200 - T]]).all()


def test_a_start_may_be_a_date_or_count_from_the_first_row(tmp_path):
    iso = written(tmp_path / "iso", HABITS["iso"][0])
    epoch = written(tmp_path / "epoch", HABITS["epoch-ns"][0])
    for path, start in (
        (iso, "2024-05-01T12:00:01.000000+02:00"),
        (iso, 1.0),
        (epoch, 1.0),
        (epoch, (EPOCH + 1e9) / 1e9),
    ):
        log = read_log(path, ["w1", "w2"], ["q1"], start=start)
        np.testing.assert_array_equal(log.x[0], TRUE[50, 1:3])
    assert any("start 1 s after" in note for note in log.notes) is False
    assert "start 1 s after the first row" in read_log(epoch, ["w1"], ["q1"], start=1.0).notes


COUNTED = [str(k) for k in range(N)]
ASKED = {
    "a counter and no clock": (clock(COUNTED, "i"), "'i'.*may count rows.*--dt"),
    "an unnamed index": (clock(COUNTED, ""), "may count rows.*--dt.*--time"),
    "whole numbers named time": (
        clock([str(20 * k) for k in range(N)], "time"),
        "'time' holds whole numbers.*--time-unit",
    ),
    "long steps named t": (
        clock([f"{20.0 * k + 0.5:.1f}" for k in range(N)], "t"),
        "'t' has long steps and no unit.*--time-unit",
    ),
    "seconds that look like milliseconds": (
        clock([str(1_700_000_020_223 + 20 * k) for k in range(N)], "time_s"),
        "says s and looks like ms since 1970.*--time-unit",
    ),
    "two clocks": (
        text(["time", "clock", *HEAD[1:]], [[f"{float(r[0]) + 0.5}", *r] for r in ROWS]),
        "'time', 'clock' may each be the clock; --time",
    ),
    "a time that stands": (
        text(["exposure_time_ms", *HEAD[1:]], [["8", *r[1:]] for r in ROWS]),
        "no column is known as the time.*--dt",
    ),
    "newest first": (text(rows=ROWS[::-1]), "line 3.*--sort puts the rows in the order of time"),
    "no clock": (text(HEAD[1:], [r[1:] for r in ROWS]), "no column is known as the time.*--dt"),
    "dates that begin with day or month": (
        clock([f"{1 + k // 200}/5/2024 12:00:{DT * k % 60:05.2f}" for k in range(N)], "time"),
        "may begin with the day or the month",
    ),
    "groups or fractions": (
        text(rows=[[r[0], f"{k % 9 + 1},234", *r[2:]] for k, r in enumerate(ROWS)], sep=";"),
        "'w1'.*can be read in two ways; --decimal",
    ),
    "both marks": (
        text(rows=[[r[0], *c[1:]] for r, c in zip(ROWS, comma(), strict=True)], sep=";"),
        "can be read in two ways; --decimal",
    ),
    "decimal and separating commas": (text(rows=comma()), "line 2: expected 4 cells.*with ';'"),
    "a repeated stamp": (
        text(rows=[*ROWS[:99], ROWS[98], *ROWS[99:]]),
        "line 101.*found the same; --duplicates first, last or mean",
    ),
    "swapped rows": (
        text(rows=[*ROWS[:99], ROWS[100], ROWS[99], *ROWS[101:]]),
        "line 102.*--sort",
    ),
    "two recordings": (text(rows=ROWS + ROWS), r"line 242.*starts anew.*#1 to #2"),
}


@pytest.mark.parametrize("name", ASKED)
def test_what_is_not_clear_is_asked_about(tmp_path, name):
    data, words = ASKED[name]
    path = written(tmp_path / "log.csv", data)
    with pytest.raises(LogError) as e:
        read(path, **COMMON)
    assert re.search(words, str(e.value)), str(e.value)
    assert str(path) in str(e.value)
    assert "\n" not in str(e.value)


def test_repeated_stamps_first_last_and_mean(tmp_path):
    double = [*ROWS[:99], [ROWS[98][0], "5", "", "7"], *ROWS[99:]]
    path = written(tmp_path / "log.csv", text(rows=double))
    row = TRUE[98, 1:]
    for how, expected in (
        ("first", row),
        ("last", [5, np.nan, 7]),
        ("mean", [(row[0] + 5) / 2, row[1], (row[2] + 7) / 2]),
    ):
        log = read_log(path, ["w1", "w2"], ["q1"], duplicates=how)
        np.testing.assert_array_equal(log.t, TRUE[:, 0])
        np.testing.assert_array_equal(np.r_[log.x[98], log.y[98]], expected)
        np.testing.assert_array_equal(np.delete(log.y[:, 0], 98), np.delete(TRUE[:, 3], 98))


def test_pieces_of_a_log_whose_clock_starts_anew(tmp_path):
    path = written(tmp_path / "log.csv", text(rows=ROWS[:150] + ROWS))
    whole = read(f"{path}#2", **COMMON)
    np.testing.assert_array_equal(whole.history.recordings[0][0], TRUE[: T + 1, 1:3])
    both = read(f"{path}#2", **COMMON, recording=f"{path}#1")
    assert [len(y) for _, y in both.history.recordings] == [149, T]
    with pytest.raises(LogError, match=r"#3: expected a piece from 1 to 2"):
        read(f"{path}#3", **COMMON)


def test_recordings_from_elsewhere(tmp_path):
    """Parts of files, frames; with a history of the log itself or without."""
    path = written(tmp_path / "a.csv", text())
    frame = dict(zip(HEAD, numbers().T, strict=True))
    asked = {"state": ["w1", "w2"], "output": ["q1"]}
    for recording in (f"{path}:1..3", (path, 1.0, 3.0), [f"{path}:1..3"], [(frame, 1, 3.0)]):
        r = read(path, **asked, recording=recording)
        (x, _), = r.history.recordings  # fmt: skip
        np.testing.assert_allclose(x, TRUE[50:151, 1:3], rtol=1e-8)
        np.testing.assert_array_equal(r.Y, TRUE[:-1, 3:])
        np.testing.assert_array_equal(r.t, TRUE[1:, 0])
        assert not r.goes_on
    assert any("errors that look too good" in note for note in read(
        path, **asked, recording=f"{path}:..3").notes)  # fmt: skip
    several = read([path, frame, path], **asked, history=HISTORY)
    assert [len(y) for _, y in several.history.recordings] == [N - 1, N - 1, T]
    assert several.goes_on
    slow = written(tmp_path / "slow.csv", text(rows=ROWS[::2]))
    with pytest.raises(LogError, match=r"recording: expected the step .* 0.02 s, found 0.04 s"):
        read(path, **asked, recording=slow)
    with pytest.raises(LogError, match="history: expected the length of the recording"):
        read(path, **asked)


def test_blank_cells_inside_the_history_are_bridged_and_said(tmp_path):
    rows = [[r[0], "" if k in (40, 41) else r[1], *r[2:]] for k, r in enumerate(ROWS)]
    path = written(tmp_path / "log.csv", text(rows=rows))
    r = read(path, **COMMON)
    (x, _), = r.history.recordings  # fmt: skip
    np.testing.assert_allclose(x[39:43, 0], np.linspace(*TRUE[[39, 42], 1], 4))
    np.testing.assert_array_equal(
        np.delete(x, [40, 41], 0), np.delete(TRUE[: T + 1, 1:3], [40, 41], 0)
    )
    assert "2 blank cells inside the history interpolated" in r.notes
    with pytest.raises(LogError, match="line 42, column 'w1': expected a number"):
        read(path, **COMMON, gaps="error")
    for lost in (range(40, 51), range(1), range(0, 150, 3)):
        rows = [[r[0], "" if k in lost else r[1], *r[2:]] for k, r in enumerate(ROWS)]
        with pytest.raises(LogError, match="column 'w1': expected at most 10 cells in a row"):
            read(written(path, text(rows=rows)), **COMMON)


def test_what_is_read_says_its_sizes(tmp_path):
    path = written(tmp_path / "log.csv", text())
    r = read(path, **COMMON)
    assert repr(r) == f"Recorded({str(path)!r}, T=150, N=89, n=2, p=1, dt=0.02 s)"
    assert (len(r), len(r.log)) == (N - T - 1, N)
    assert repr(r.log) == f"Log({str(path)!r}, N=240, n=2, p=1, dt=0.02 s)"


def test_the_end_of_a_path_is_a_name_and_is_said(tmp_path):
    path = written(tmp_path / "log.csv", text(["time_s", "arm.w1", "arm.w2", "q1"]))
    r = read(path, **COMMON)
    assert "columns: w1 is arm.w1, w2 is arm.w2" in r.notes
    assert r.names.state == ("w1", "w2")
    path = written(path, text(["time_s", "arm.w1", "leg.w1", "q1"]))
    with pytest.raises(LogError, match=r"found 'w1', which may be 'arm.w1' or 'leg.w1'"):
        read(path, **COMMON | {"state": ["w1"]})


def estimate(path, options, run=in_here, out=None, stdin=None):
    columns = ["--state", options.pop("state", "w1,w2"), "--output", "q1", "--history", HISTORY]
    more = [part for pair in options.items() for part in pair if part is not True]
    return run("estimate", path, *columns, *more, "--out", out)


@pytest.mark.parametrize("name", ["decimal-comma", "utf-16", "epoch-ns"])
def test_the_command_line_gives_the_same_estimates(tmp_path, name):
    plain = written(tmp_path / "plain.csv", HABITS["plain"][0])
    path = written(tmp_path / "odd.csv", HABITS[name][0])
    assert estimate(plain, {}, in_here, tmp_path / "a.csv").returncode == 0
    run = in_a_process if name == "epoch-ns" else in_here
    result = estimate(path, {}, run, tmp_path / "b.csv")
    assert (result.returncode, result.stderr) == (
        0,
        estimate(plain, {}, out=tmp_path / "c.csv").stderr,
    )
    assert STATED[name] in result.stdout
    a, b = ((tmp_path / f).read_text().splitlines() for f in ("a.csv", "b.csv"))
    assert [row.split(",")[1:] for row in a] == [row.split(",")[1:] for row in b]
    if name == "epoch-ns":
        assert b[1].split(",")[0] == str(EPOCH + 20_000_000 * (T + 1))


def test_wrong_options_of_reading(tmp_path):
    path = written(tmp_path / "log.csv", text())
    for options, words in (
        ({"sep": ",,"}, "sep: expected one character"),
        ({"decimal": "x"}, "decimal: expected '.' or ','"),
        ({"encoding": "utf-99"}, "encoding: expected one like utf-8"),
        ({"time_unit": "fortnights"}, "time_unit: expected one of"),
        ({"dt": 0.0}, "dt: expected a positive number"),
        ({"dt": 0.1, "time": "time_s"}, "dt: expected without time"),
        ({"duplicates": "all"}, "duplicates: expected one of error, first"),
        ({"sort": 1}, "sort: expected True or False"),
        ({"gaps": "maybe"}, "gaps: expected one of error, fill"),
        ({"start": "noon"}, "start: expected a time like the log's"),
        ({"recording": f"{path}:a..b"}, "recording: expected|no such file"),
        ({"recording": (path, 0.0, 0.01)}, "recording: expected at least 3 samples"),
        ({"comment": ""}, "comment: expected a text, found an empty one"),
    ):
        with pytest.raises(ddmhe.DdmheError, match=words):
            read(path, **COMMON | options)


def test_blanks_in_names_part_no_cells(tmp_path):
    """A name in part, `w1` of `w1 [rad/s]`: the commas part the cells, and the whole name is
    suggested."""
    head = "t [s],w1 [rad/s],w2 [rad/s],q1 [N m]"
    rows = [",".join(row) for row in ROWS]
    path = written(tmp_path / "log.csv", "\n".join([head, *rows]))
    with pytest.raises(LogError, match=r"did you mean 'w1 \[rad/s\]'"):
        read(path, **COMMON)
