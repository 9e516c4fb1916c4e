"""Reading logs and splitting them: rows, times and every wrong file."""

import math
import os
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ddmhe import DdmheError
from ddmhe._core import wrapped_angle
from ddmhe.config import ConfigError, read_config, space_from_text
from ddmhe.logs import LogError, read_log
from ddmhe.oddities import far_out
from ddmhe.report import nrmse, pooled_nrmse, rmse, rmse_norm, root_mean_square

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
    ([*GOOD, "1.0,0,0,0,0"], HEADER, "expected a CSV table, found one that cannot be read"),
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
            r"history: expected less than 3.9 s, the 40 samples that .* holds from 0 s on, found 3.9 s",
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
    "wrong", [["x"], "x", [None], [float("nan")], [float("inf")], [True], [10**400], None, {1: 2}]
)
def test_wrong_missing_numbers(path, wrong):
    with pytest.raises(LogError, match="missing: expected"):
        read(path, missing=wrong)


def test_what_is_far_out_on_its_own():
    rng = np.random.default_rng(0)
    signal = np.sin(np.arange(3000) / 40) + 0.01 * rng.standard_normal(3000)
    for share in (0.001, 0.1, 0.4):
        low, high = rng.random(3000) < share, rng.random(3000) < 0.05
        low[7], high[9] = True, True
        spoiled = np.where(low, -9999.0, signal)
        np.testing.assert_array_equal(far_out(spoiled), np.flatnonzero(low))
        np.testing.assert_array_equal(
            far_out(np.where(high, 999.0, spoiled)), np.flatnonzero(low | high)
        )
    rest = 1e-3 * rng.standard_normal(2900)
    for motion in (
        np.sin(np.arange(100) / 4),  # sets out after a long rest
        1 + 1e-3 * rng.standard_normal(100),  # a step to another level
        np.cumsum(rng.standard_normal(100)),
    ):
        assert far_out(np.r_[rest, motion]).size == 0
        assert far_out(np.r_[np.zeros(2900), motion]).size == 0
    assert far_out(np.r_[signal, 400.0, 700.0, signal]).tolist() == [3000, 3001]
    assert far_out(np.full(100, np.nan)).size == 0


@pytest.mark.parametrize("full", [2 * np.pi, 360.0])
@pytest.mark.parametrize("offset", [0.0, 0.5, 0.25, -3.1])
def test_wrapped_angles_are_seen_and_made_continuous(tmp_path, full, offset):
    angle = full * np.cumsum(np.linspace(0.005, 0.02, 400))
    wrapped = angle % full - offset * full
    jump = int(np.flatnonzero(np.abs(np.diff(wrapped)) > full / 2)[0]) + 1
    assert wrapped_angle(wrapped) == (full, jump)
    gap = np.where(np.arange(400) < jump, np.nan, wrapped)  # what was not measured is left out
    following = int(np.flatnonzero(np.abs(np.diff(gap)) > full / 2)[0]) + 1
    assert wrapped_angle(gap) == (full, following)
    assert wrapped_angle(angle) is None
    assert wrapped_angle(0.49 * full * np.sin(np.arange(400) / 9)) is None
    for nothing in ([], [1.0], [np.nan] * 9, [np.inf] * 9):
        assert wrapped_angle(nothing) is None
    rows = [f"{0.1 * k:.1f},{wrapped[k]:.12f},{k},{wrapped[k]:.12f}" for k in range(400)]
    log = read(write(tmp_path / "log.csv", rows), decimate=2, unwrap=["w", "torque"])
    np.testing.assert_allclose(log.x[:, 0], angle[::2] - offset * full, atol=1e-9)
    np.testing.assert_allclose(log.y[:, 0], angle[::2] - offset * full, atol=1e-9)
    with pytest.raises(
        LogError, match="unwrap: expected a column of the states or outputs, found 'time_s'"
    ):
        read(tmp_path / "log.csv", unwrap=["time_s"])


MEASURED = Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.mark.skipif(
    not MEASURED.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_nothing_odd_is_seen_in_measured_logs():
    """Pendulums, cars, arms and circuits, whole and thinned: no value far out, no wrapped angle."""
    paths = sorted([*MEASURED.glob("repoimu-pendulum/*.csv"), *MEASURED.glob("input-logs/*.csv")])
    assert len(paths) > 18
    for path in paths:
        frame = pd.read_csv(path)
        for name, step in product(frame.columns[1:], (1, 4)):
            values = frame[name].to_numpy(dtype=float)[::step]
            assert far_out(values).size == 0, (path, name)
            assert wrapped_angle(values) is None, (path, name)


def test_errors_are_package_errors():
    assert issubclass(LogError, DdmheError)
    assert issubclass(ConfigError, DdmheError)


def test_config_reads_every_key(tmp_path):
    path = tmp_path / "est.toml"
    path.write_text(
        "horizon = 7\nrho = 0.9\nmu = 1\nx_prior = [0, 1.5]\nx_bounds = [-1, [2, inf]]\nx_center = 'history'\n"
        "v_bounds = [-1.0, 1.0]\nequilibrium = [[0, 0], [0]]\nwarm_start = true\n"
        "space = { kind = 'truncated', rank = 5 }\n"
    )
    settings = read_config(path)
    assert repr(settings.pop("space")) == "Truncated(rank=5)"
    assert settings == {
        "horizon": 7,
        "rho": 0.9,
        "mu": 1,
        "x_prior": [0, 1.5],
        "x_bounds": [-1, [2, float("inf")]],
        "x_center": "history",
        "v_bounds": [-1.0, 1.0],
        "equilibrium": [[0, 0], [0]],
        "warm_start": True,
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("auto", "'auto'"),
        ("exact", "Exact()"),
        ("truncated:3", "Truncated(rank=3)"),
        ("ridge:0.5", "Ridge(5e-1)"),
    ],
)
def test_space_from_text(text, expected):
    assert repr(space_from_text(text)) == expected


@pytest.mark.parametrize(
    "text", ["", "Auto", "auto:", "exact:1", "truncated", "truncated:-1", "truncated:x", "ridge:"]
)
def test_space_from_wrong_text(text):
    with pytest.raises(
        ConfigError, match="space: expected auto, exact, truncated:RANK or ridge:WEIGHT"
    ):
        space_from_text(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("horizn = 3", "expected one of the keys horizon, rho, mu, .* found 'horizn'"),
        ("horizon = true", "horizon: expected a whole number, found True"),
        ("horizon = 1e99", "horizon: expected a whole number"),
        ("rho = '0.9'", "rho: expected a number, found '0.9'"),
        ("warm_start = 1", "warm_start: expected true or false, found 1"),
        ("x_bounds = ['a', 'b']", "x_bounds: expected a list"),
        ("space = 'ridge'", "space: expected auto, exact"),
        (
            "space = { kind = 'best' }",
            "space: expected kind 'exact', 'truncated', 'ridge', found 'best'",
        ),
        ("space = { kind = 'ridge' }", "space: expected a weight for ridge"),
        (
            "space = { kind = 'truncated', rank = 1.5 }",
            "space: expected a whole number for rank, found 1.5",
        ),
        (
            "space = { kind = 'exact', rank = 1 }",
            "space: expected no argument for exact, found 'rank'",
        ),
        ("missing = -9999", "missing: expected a list of finite numbers, found -9999"),
        ("missing = [nan]", "missing: expected a list of finite numbers"),
        ("horizon = ", "expected a TOML file, found an error in it"),
    ],
)
def test_wrong_config_is_an_error_that_names_file_and_key(tmp_path, text, expected):
    path = tmp_path / "est.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=expected) as e:
        read_config(path)
    assert str(path) in str(e.value)


def test_error_measures_leave_out_what_is_unknown():
    error = np.array([[3.0, 4.0], [np.nan, 0.0], [3.0, 4.0]])
    np.testing.assert_allclose(rmse(error), [3.0, np.sqrt(32 / 3)])
    assert rmse_norm(error) == pytest.approx(5.0)
    assert np.isnan(rmse(np.full((2, 1), np.nan)))
    x = np.array([[1.0, 10.0], [3.0, np.nan], [5.0, 20.0]])
    np.testing.assert_array_equal(nrmse(x, x), [0.0, 0.0])
    assert pooled_nrmse(x, x) == 0.0
    mean = np.tile([3.0, 15.0], (3, 1))
    np.testing.assert_allclose(nrmse(mean, x), [1.0, 1.0])
    assert pooled_nrmse(mean, x) == pytest.approx(1.0)


def test_each_state_has_its_own_nrmse():
    """A large state does not hide a small one, as it does in the pooled number."""
    x = np.column_stack([1000 * np.sin(np.arange(50.0)), np.cos(np.arange(50.0)), np.ones(50)])
    x_hat = x + np.array([0.0, 2 * np.std(x[:, 1]), 0.0])
    relative = nrmse(x_hat, x)
    np.testing.assert_allclose(relative[:2], [0.0, 2.0], atol=1e-12)
    assert np.isnan(relative[2])
    assert root_mean_square(relative) == pytest.approx(np.sqrt(2.0))
    assert pooled_nrmse(x_hat, x) < 0.003


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
    with pytest.raises(
        LogError, match="line 2, column 'time': expected a time in seconds, found the unit 'ms'"
    ):
        read_log(path, ["a", "b"], ["torque"])
    path.write_text("\n".join([header, "s,rad/s,1.5,N m,", *rows]) + "\n")
    with pytest.raises(
        LogError, match="line 2, column 'time': expected a finite number, found 's'"
    ):
        read_log(path, ["a", "b"], ["torque"])
