"""Reading logs and splitting them: rows, times and every wrong file."""

import math

import numpy as np
import pytest

from ddmhe import DdmheError
from ddmhe.logs import LogError, read_log

HEADER = "time_s,w,q,torque"


def write(path, rows, header=HEADER):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def row(k, t=None):
    """State (k, -k) and output 10 k at 0.1 s steps: every number names its row."""
    return f"{0.1 * k if t is None else t:.4f},{k},{-k},{10 * k}"


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "log.csv", [row(k) for k in range(40)])


def read(path, **options):
    return read_log(path, **{"state": ["w", "q"], "output": ["torque"]} | options)


def test_history_and_what_follows_are_the_right_rows(path):
    log = read(path)
    history, Y, t, x_true = log.split(1.0)
    (x, y), = history.recordings  # fmt: skip
    assert (history.n, history.p, history.T) == (2, 1, 10)
    assert history.dt == pytest.approx(0.1, rel=1e-12)
    np.testing.assert_array_equal(x[:, 0], range(11))
    np.testing.assert_array_equal(x[:, 1], -x[:, 0])
    np.testing.assert_array_equal(y[:, 0], 10 * np.arange(10))
    np.testing.assert_array_equal(Y[:, 0], 10 * np.arange(10, 39))
    np.testing.assert_allclose(t, 0.1 * np.arange(11, 40))
    np.testing.assert_array_equal(x_true[:, 0], range(11, 40))


def test_rows_are_decimated_first_and_started_then(path):
    log = read(path, decimate=4, start=0.5)
    np.testing.assert_array_equal(log.x[:, 0], range(8, 40, 4))
    np.testing.assert_array_equal(log.lines, np.arange(8, 40, 4) + 2)
    assert log.dt == pytest.approx(0.4, rel=1e-12)
    assert read(path, start=-5.0).t[0] == 0.0


def test_time_column_may_stand_anywhere_and_a_state_may_be_an_output(tmp_path):
    path = write(tmp_path / "log.csv", [f"{k},{0.1 * k:.1f}" for k in range(9)], "w, clock")
    log = read_log(path, ["w"], ["w"], time="clock")
    np.testing.assert_array_equal(log.x, log.y)
    assert log.names.time == "clock"


def test_stamps_of_whole_milliseconds_are_regular_enough(tmp_path):
    """A 24.5 ms clock printed in milliseconds, with a step 1.4 times too long: still one sample a
    step."""
    t = np.round(np.cumsum(np.r_[0.0, np.full(99, 0.0245)]), 3)
    t[60:] += 0.010
    log = read(write(tmp_path / "log.csv", [row(k, t[k]) for k in range(100)]))
    assert log.split(1.0).history.T in (40, 41, 42)


def test_empty_cells_after_the_history_are_not_measured(tmp_path):
    rows = [row(k) for k in range(20)] + ["2.0,,,200", "2.1,,,nan", "2.2,22,,", "2.3"]
    split = read(write(tmp_path / "log.csv", rows)).split(1.9)
    np.testing.assert_array_equal(split.Y[:, 0], [190, 200, np.nan, np.nan])
    np.testing.assert_array_equal(split.x_true[:, 0], [np.nan, np.nan, 22, np.nan])


def test_a_live_log_without_states_has_no_truth(tmp_path):
    rows = [row(k) for k in range(20)] + [f"{0.1 * k:.1f},,,{k}" for k in range(20, 30)]
    assert read(write(tmp_path / "log.csv", rows)).split(1.9).x_true is None


def test_empty_lines_and_a_byte_order_mark_do_no_harm(tmp_path):
    path = write(
        tmp_path / "log.csv", [row(0), "", row(1), row(2), ",,,", row(3), "", ""], "\ufeff" + HEADER
    )
    np.testing.assert_array_equal(read(path).lines, [2, 4, 5, 7])


def gap_log(tmp_path, after, missing):
    """Row `after` is followed by a gap of `missing` samples; the cells name the sample, not the
    row."""
    rows = [row(k) for k in range(after + 1)] + [row(k) for k in range(after + 1 + missing, 40)]
    return read(write(tmp_path / "log.csv", rows))


@pytest.mark.parametrize(
    "lost", [[61], [62], [60, 61], [60], [58, 59, 60, 61, 62], [61, 66, 75, 90]]
)
def test_lost_rows_leave_the_thinned_samples_in_their_places(tmp_path, lost):
    """Every fourth sample of the clock, whatever rows are lost: the ones that are there are those
    of the whole log."""
    whole = [row(k) for k in range(200)]
    path = write(tmp_path / "log.csv", [r for k, r in enumerate(whole) if k not in lost])
    log = read(path, decimate=4, start=0.8)
    with pytest.raises(
        LogError, match=rf"gap .* the history at {0.1 * min(lost) - 0.1:g} s .* about 0.1 s, found"
    ):
        log.split(4.0)
    full = read(write(tmp_path / "whole.csv", whole), decimate=4, start=0.8)
    filled = log.fill_gaps()
    np.testing.assert_allclose(filled.t, full.t, atol=1e-12)
    there = ~np.isin(np.arange(8, 200, 4), lost)
    np.testing.assert_array_equal(filled.y[there], full.y[there])
    np.testing.assert_array_equal(filled.x[there], full.x[there])
    assert np.isnan(filled.y[~there]).all()
    a, b = filled.split(4.0), full.split(4.0)
    assert a.history.T == b.history.T == 10
    np.testing.assert_array_equal(a.Y[there[10:-1]], b.Y[there[10:-1]])


def test_stamps_that_come_late_are_no_lost_rows(tmp_path):
    """A buffer read out late gives a long step and short ones after it; a lost row gives the long
    step alone."""
    k = np.arange(200)
    t = 0.1 * k
    t[50:56] = t[56] - 0.001 * np.arange(6, 0, -1)
    t[100] += 0.07
    rows = [row(i, t[i]) for i in k if i not in (151, 152)]
    log = read(write(tmp_path / "log.csv", rows), decimate=2)
    assert [(gap.line, round(gap.length, 6)) for gap in log.gaps] == [(152, 0.3)]
    filled = log.fill_gaps()
    assert len(filled.t) == 100
    np.testing.assert_array_equal(
        filled.y[:, 0], [10.0 * i if i != 152 else np.nan for i in range(0, 200, 2)]
    )


@pytest.mark.parametrize(("history", "where"), [(1.0, "after"), (2.0, "inside")])
def test_a_gap_is_an_error_that_says_where_and_how_long(tmp_path, history, where):
    with pytest.raises(
        LogError, match=rf"gap {where} the history at 1.5 s \(line 17\).* 0.1 s, found 0.3 s"
    ):
        gap_log(tmp_path, 15, 2).split(history)


def test_filled_gap_after_the_history_is_not_measured(tmp_path):
    log = gap_log(tmp_path, 15, 2).fill_gaps()
    _, Y, t, x_true = log.split(1.0)
    np.testing.assert_allclose(t, 0.1 * np.arange(11, 40), atol=1e-12)
    expected = 10.0 * np.arange(10, 39)
    expected[[6, 7]] = np.nan
    np.testing.assert_array_equal(Y[:, 0], expected)
    assert np.isnan(x_true[[5, 6]]).all()
    assert np.isfinite(np.delete(x_true, [5, 6], axis=0)).all()


@pytest.mark.parametrize("after", [3, 8, 9])
def test_filled_gap_inside_the_history_is_interpolated(tmp_path, after):
    """Also where the history's last row is one of the filled ones: every cell is linear in time."""
    (x, y), = gap_log(tmp_path, after, 3).fill_gaps().split(1.0).history.recordings  # fmt: skip
    np.testing.assert_allclose(x[:, 0], np.arange(11), atol=1e-12)
    np.testing.assert_allclose(y[:, 0], 10 * np.arange(10), atol=1e-12)


def test_gap_too_long_to_interpolate_or_to_fill(tmp_path):
    with pytest.raises(
        LogError, match=r"gap inside the history at 0.5 s \(line 7\): .*at most 10 .*found 11"
    ):
        gap_log(tmp_path, 5, 11).fill_gaps().split(2.0)
    rows = [row(k) for k in range(20)] + [row(k, 1e6 + 0.1 * k) for k in range(20)]
    with pytest.raises(LogError, match="gaps that can be filled, found 9999980 samples missing"):
        read(write(tmp_path / "log.csv", rows)).fill_gaps()


def test_a_log_without_gaps_is_its_own_filling(path):
    log = read(path)
    np.testing.assert_array_equal(log.fill_gaps().t, log.t)
    np.testing.assert_array_equal(log.fill_gaps().y, log.y)


GOOD = [row(k) for k in range(10)]
WRONG_FILES = [
    ([], HEADER, "expected samples after the header line, found none"),
    (GOOD, "time_s,w,w,torque", "expected one column named 'w', found 2"),
    ([*GOOD, "1.0,x,0,0"], HEADER, "line 12, column 'w': expected a finite number, found 'x'"),
    (
        [*GOOD, "1.0,0,0,-inf"],
        HEADER,
        "line 12, column 'torque': expected a finite number, found '-inf'",
    ),
    ([*GOOD, ",0,0,0"], HEADER, "line 12, column 'time_s': expected a time in seconds, found none"),
    (
        [*GOOD, "0.9,0,0,0"],
        HEADER,
        "line 12, column 'time_s': expected a time after the 0.9 s of the line before",
    ),
    ([*GOOD, "1.0,0,0,0,0"], HEADER, "line 12: expected 4 cells as in the header, found 5"),
    (GOOD[:2], HEADER, "expected at least 3 samples from the start on, found 2"),
    (
        [row(k, 0.1 * k + 0.05 * (k % 2)) for k in range(30)],
        HEADER,
        "expected regular sampling, found",
    ),
]


@pytest.mark.parametrize(("rows", "header", "text"), WRONG_FILES)
def test_wrong_file_is_an_error_that_names_it(tmp_path, rows, header, text):
    path = write(tmp_path / "bad.csv", rows, header)
    with pytest.raises(LogError) as e:
        read(path)
    assert text in str(e.value)
    assert str(path) in str(e.value)
    assert "\n" not in str(e.value)


def test_files_that_are_no_logs(tmp_path):
    (tmp_path / "empty.csv").touch()
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00" * 99)
    for name, text in (
        ("none.csv", "found no such file"),
        (".", "Is a directory"),
        ("empty.csv", "an empty file"),
        ("binary.csv", "UTF-8"),
    ):
        with pytest.raises(LogError, match=text):
            read(tmp_path / name)


@pytest.mark.parametrize(
    ("header", "name"),
    [
        ("b,y,a,b", "b"),
        (",y,a,", ""),
        ("sec,nanosec,a,sec,y", "sec"),
        ("secs,nsec,a,nsec,y", "nsec"),
    ],
)
def test_a_clock_whose_name_is_there_twice_is_refused(tmp_path, header, name):
    rows = [f"{k},{k % 2},{k},{k},{k}"[: 2 * len(header.split(",")) - 1] for k in range(9)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    with pytest.raises(LogError, match=f"one column named '{name}', found 2"):
        read_log(tmp_path / "log.csv", ["a"], ["y"])


def test_a_separator_that_ends_each_line_makes_no_column(tmp_path):
    rows = [f"{0.1 * k:.1f},{k % 5},{k % 3}," for k in range(9)]
    (tmp_path / "log.csv").write_text("\n".join(["t,a,y,", *rows]))
    log = read_log(tmp_path / "log.csv", ["a"], ["y"])
    assert log.x[:4, 0].tolist() == [0, 1, 2, 3]
    (tmp_path / "log.csv").write_text("\n".join([",a,y,", *rows]))
    assert read_log(tmp_path / "log.csv", ["a"], ["y"]).t[1] == pytest.approx(0.1)


@pytest.mark.parametrize("tiny", [1e-320, 1e-310, 1e-300, 1e-200])
def test_steps_next_to_nothing_are_one_sentence(tmp_path, tiny):
    rows = [f"{t},1,{k % 2}" for k, t in enumerate([0, tiny, 2, 3])]
    (tmp_path / "log.csv").write_text("\n".join(["t,a,y", *rows]))
    with pytest.raises(LogError, match="expected regular sampling"):
        read_log(tmp_path / "log.csv", ["a"], ["y"])


@pytest.mark.parametrize("text", [",\n", ",", ";;\n\n;\n", '"",""\n', "# a,y\n,\n", "\t\n,\n"])
def test_a_file_of_empty_cells_alone_is_one_sentence(tmp_path, text):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(LogError, match="expected") as e:
        read(tmp_path / "log.csv")
    assert "\n" not in str(e.value)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            {"state": ["w", "torqe"]},
            r"state: .* found 'torqe'; did you mean 'torque'\? \(columns: time_s, w, q, torque\)",
        ),
        ({"output": ["zzz"]}, r"output: .* found 'zzz' \(columns:"),
        ({"time": "tme_s"}, "time: .* did you mean 'time_s'"),
        ({"state": []}, "state: expected at least one column name"),
        ({"state": ["w", "w"]}, "state: expected different columns, found 'w' more than once"),
        ({"output": ["time_s"]}, "output: expected columns other than the time column"),
        ({"start": 4.0}, r"start: expected at most 3.9 s, the last time of .*, found 4.0 s"),
        ({"start": float("nan")}, "start: .* found nan s"),
        ({"decimate": 0}, "decimate: expected a whole number of at least 1, found 0"),
        ({"decimate": 1.5}, "decimate: expected a whole number of at least 1, found 1.5"),
        ({"decimate": 30}, "at least 3 samples from the start on, every 30 rows, found 2"),
    ],
)
def test_wrong_option_is_an_error_that_names_it(path, options, text):
    with pytest.raises(LogError, match=text):
        read(path, **options)


@pytest.mark.parametrize(
    ("history", "text"),
    [
        (0.0, "history: expected a positive number of seconds, found 0.0"),
        (float("inf"), "history: expected a positive number of seconds, found inf"),
        (0.1, r"history: expected at least 2 samples \(0.2 s\), found 0.1 s"),
        (
            3.9,
            "history: expected less than 3.9 s, "
            "the 40 samples that .* holds from 0 s on, found 3.9 s",
        ),
    ],
)
def test_history_must_fit_the_log(path, history, text):
    with pytest.raises(LogError, match=text):
        read(path).split(history)


def test_cells_missing_inside_the_history(tmp_path):
    rows = [row(k) for k in range(20)]
    for cells, text in (
        ("0.5,5,,50", "line 7, column 'q'"),
        ("0.5,5,-5,", "line 7, column 'torque'"),
    ):
        log = read(write(tmp_path / "log.csv", [*rows[:5], cells, *rows[6:]]))
        with pytest.raises(
            LogError, match=f"{text}: expected a number inside the history, found an empty cell"
        ):
            log.split(1.0)
        assert log.split(0.4).history.T == 4  # the same cell after the history is fine


def test_numbers_and_words_that_say_not_measured(tmp_path):
    words = ["", "NA", "n/a", "null", "None", "nan", "-9999", "-9999.0", "999"]
    rows = [row(k) for k in range(20)] + [
        f"{0.1 * (20 + k):.1f},{w},1,{w}" for k, w in enumerate(words)
    ]
    path = write(tmp_path / "log.csv", [*rows, row(29)])
    for missing, known in (((), 3), ((-9999,), 1), ((-9999, 999.0), 0)):
        split = read(path, missing=missing).split(1.9)
        assert np.isfinite(split.Y[1:10, 0]).sum() == known
        assert np.isfinite(split.x_true[:9, 0]).sum() == known
    log = read(
        write(tmp_path / "inside.csv", [*rows[:5], "0.5,5,-5,-9999", *rows[6:20]]), missing=[-9999]
    )
    with pytest.raises(
        LogError, match=r"line 7, column 'torque': .* a number that stands for not measured"
    ):
        log.split(1.0)


@pytest.mark.parametrize(
    "wrong", [[""], " ", [None], [float("nan")], [float("inf")], [True], [10**400], None, {1: 2}]
)
def test_wrong_missing_numbers(path, wrong):
    with pytest.raises(LogError, match="missing: expected"):
        read(path, missing=wrong)


def test_errors_are_package_errors():
    assert issubclass(LogError, DdmheError)


def test_a_line_of_units_below_the_header(tmp_path):
    header = "time,a,b,torque,spare"
    rows = [f"{0.1 * k:.1f},{math.sin(k)},{math.cos(k)},{math.sin(0.3 * k)},0" for k in range(40)]
    path = tmp_path / "log.csv"
    for units in ("s,rad/s,rad/s,N m,", "[s],[rad/s],(rad/s),[N m],-"):
        path.write_text("\n".join([header, units, *rows]) + "\n")
        log = read_log(path, ["a", "b"], ["torque"])
        assert len(log.t) == 40
        assert log.lines[0] == 3
        history = log.split(2.0).history
        assert (history.x_units, history.y_units) == (["rad/s", "rad/s"], ["N m"])
    path.write_text(
        "\n".join(["time,a_rad_s,b,torque", "s,,V,", *(row.rsplit(",", 1)[0] for row in rows)])
        + "\n"
    )
    history = read_log(path, ["a_rad_s", "b"], ["torque"]).split(2.0).history
    assert (history.x_units, history.y_units) == (["rad/s", "V"], [""])
    path.write_text("\n".join([header, "ms,rad/s,rad/s,N m,", *rows]) + "\n")
    assert read_log(path, ["a", "b"], ["torque"]).dt == pytest.approx(1e-4)
    path.write_text("\n".join([header, "ticks,rad/s,rad/s,N m,", *rows]) + "\n")
    with pytest.raises(LogError, match=r"column 'time' has the unit 'ticks' .* --time-unit"):
        read_log(path, ["a", "b"], ["torque"])
    path.write_text("\n".join([header, "s,rad/s,1.5,N m,", *rows]) + "\n")
    with pytest.raises(
        LogError, match="line 2, column 'time': expected a finite number, found 's'"
    ):
        read_log(path, ["a", "b"], ["torque"])
