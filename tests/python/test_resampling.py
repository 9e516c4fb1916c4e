"""A log on even steps, where that is asked for."""

import numpy as np
import pytest

import ddmhe
from commands import in_here
from ddmhe.recordings import LogError, read

COLUMNS = {"state": ["x"], "output": ["y"], "history": 1.0}


def uneven(rng, N=400):
    """Stamps that wander, of motions that are straight lines: their samples are known exactly."""
    t = np.cumsum(rng.uniform(0.005, 0.035, N))
    return {"time_s": t - t[0], "x": 3.0 - 2.0 * (t - t[0]), "y": 0.5 * (t - t[0])}


def test_straight_lines_are_kept_and_it_is_said():
    r = read(uneven(np.random.default_rng(0)), **COLUMNS, resample=0.02)
    assert r.history.dt == pytest.approx(0.02, rel=1e-12)
    np.testing.assert_allclose(np.diff(r.t), 0.02, rtol=1e-9)
    np.testing.assert_allclose(r.x_true[:, 0], 3.0 - 2.0 * r.t, atol=1e-9)
    np.testing.assert_allclose(r.Y[:, 0], 0.5 * (r.t - 0.02), atol=1e-9)
    assert "resampled to 0.02 s, on straight lines between measured values" in r.notes


def test_without_it_the_log_is_refused_and_the_option_named():
    with pytest.raises(LogError, match="--resample SECONDS puts the log on even steps"):
        read(uneven(np.random.default_rng(0)), **COLUMNS)


def test_nothing_is_known_where_values_are_far_apart():
    log = uneven(np.random.default_rng(0))
    log["y"][300:320] = np.nan
    r = read(log, **COLUMNS, resample=0.02)
    at = r.t - 0.02
    lost = (at > log["time_s"][299] + 1e-9) & (at < log["time_s"][320] - 1e-9)
    np.testing.assert_array_equal(np.isnan(r.Y[:, 0]), lost)
    assert lost.sum() > 10


def test_inputs_are_held_until_they_change():
    log = uneven(np.random.default_rng(0))
    log["u"] = np.floor(np.arange(400) / 40)
    r = read(log, **COLUMNS, input=["u"], resample=0.01)
    at = r.t - 0.01
    latest = log["u"][np.searchsorted(log["time_s"], at + 1e-12, side="right") - 1]
    np.testing.assert_array_equal(r.U[:, 0], latest)
    assert any("inputs held" in note for note in r.notes)


@pytest.mark.parametrize("kind", ["ns", "dates"])
def test_clocks_stay_what_they_are(kind, tmp_path):
    log = uneven(np.random.default_rng(0))
    ns = 1_700_000_020_223_456_854 + np.rint(1e9 * log["time_s"]).astype(np.int64)
    if kind == "ns":
        stamps, first = [str(k) for k in ns], "1700000020223456854"
    else:
        stamps, first = [f"{np.datetime64(int(k), 'ns')}Z" for k in ns], None
    rows = [f"{t},{x:.12g},{y:.12g}" for t, x, y in zip(stamps, log["x"], log["y"], strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["timestamp,x,y", *rows, ""]))
    r = read(path, **COLUMNS, resample=0.02)
    np.testing.assert_allclose(r.x_true[:, 0], 3.0 - 2.0 * r.t, atol=1e-6)
    k = len(r.history.recordings[0][0])  # the row of the first estimate
    later = 1_700_000_020_223_456_854 + 20_000_000 * k
    wanted = later if first else f"{np.datetime64(later, 'ns')}Z"
    assert r.stamps[0] == wanted


@pytest.mark.parametrize("step", [0, -1, np.nan, "x", True, 1e6, 1e-12])
def test_wrong_steps(step):
    with pytest.raises(LogError, match=r"^resample: expected"):
        read(uneven(np.random.default_rng(0)), **COLUMNS, resample=step)


def test_on_the_command_line(tmp_path):
    log = uneven(np.random.default_rng(0), 800)
    rng = np.random.default_rng(1)
    log["x"] = np.sin(3 * log["time_s"])
    log["y"] = log["x"] + 0.01 * rng.standard_normal(800)
    np.savez(tmp_path / "log.npz", **log)
    options = ["--state", "x", "--output", "y", "--history", 6, "--resample", 0.02]
    result = in_here("estimate", "log.npz", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "resampled to 0.02 s" in result.stdout
    both = in_here("estimate", "log.npz", *options, "--follow", cwd=tmp_path)
    assert "log.npz: expected lines of CSV or JSON in UTF-8 with --follow" in both.stderr


# --- how late outputs are, in a file of settings


def test_a_delay_in_the_settings_file(log, tmp_path):
    columns = ["--state", "wx,wy,wz", "--output", "tx,ty,tz", "--history", 20]
    for text, option in (("0.2", "0.2"), ("{ tx = 0.1 }", "tx=0.1")):
        (tmp_path / "est.toml").write_text(f"delay = {text}\n")
        by_file = in_here("estimate", log, *columns, "--config", tmp_path / "est.toml")
        by_option = in_here("estimate", log, *columns, "--delay", option)
        assert by_file.returncode == 0, by_file.stderr
        assert by_file.stdout == by_option.stdout
    for wrong in ('"late"', "nan", "{ tx = true }", "[0.1]"):
        (tmp_path / "est.toml").write_text(f"delay = {wrong}\n")
        with pytest.raises(ddmhe.config.ConfigError, match=r"est\.toml, delay: expected seconds"):
            ddmhe.config.read_config(tmp_path / "est.toml")
