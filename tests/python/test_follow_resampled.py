"""A log that is still being written, on even steps: the estimates of the whole log, bit for bit."""

import signal
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from commands import in_here

FOLLOW = [sys.executable, "-m", "ddmhe", "estimate", "--follow"]
COLUMNS = ["--state", "a,b", "--output", "y,z", "--history", 4, "--resample", "0.02"]
N = 700


def uneven(seed=3, inputs=False):
    """Times, s, and rows as texts: steps that wander, blank cells, a stretch without rows."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.004, 0.03, N)) - 0.004
    t[430:] += 0.31
    x = np.column_stack([np.sin(2 * t), 2 * np.cos(2 * t)]) + 0.01 * rng.standard_normal((N, 2))
    y = x @ [[1.0, 0.4], [0.2, -0.7]] + 0.005 * rng.standard_normal((N, 2))
    cells = np.column_stack([x, y, np.floor(t)]) if inputs else np.column_stack([x, y])
    rows = [[f"{v:.9g}" for v in row] for row in cells]
    for k in [*range(390, 394), 450, 470, 471, *range(500, 540), N - 1]:
        rows[k][2] = ""
    return t, rows


def log_of(stamps, rows, name="time_s", inputs=False):
    head = [name, "a", "b", "y", "z", *(["u"] if inputs else [])]
    lines = [",".join([stamp, *row]) for stamp, row in zip(stamps, rows, strict=True)]
    return "\n".join([",".join(head), *lines, ""])


def dated(t, kind):
    ns = 1_700_000_020_223_456_854 + np.rint(1e9 * t).astype(np.int64)
    return {
        "s": [f"{v:.6f}" for v in t],
        "min": [f"{v / 60:.12f}" for v in t],
        "ms": [str(round(1e3 * v)) for v in t],
        "ns": [str(k) for k in ns],
        "dates": [f"{np.datetime64(int(k), 'ns')}Z" for k in ns],
        "epoch": [f"{k // 10**9}.{k % 10**9:09d}" for k in ns],
        "midnight": [str(np.datetime64(int((86395 + v) * 1e6), "us"))[11:] for v in t],
    }[kind]


NAMES = {"min": "time_min", "ms": "time_ms"}


def offline(path, out, *options):
    result = in_here("estimate", path, *COLUMNS, *options, "--out", out)
    assert result.returncode == 0, result.stderr
    return pd.read_csv(out, keep_default_na=False)


def live(text, *options):
    command = [*FOLLOW, "-", *map(str, [*COLUMNS, *options])]
    run = subprocess.run(command, input=text, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    return pd.read_csv(pd.io.common.StringIO(run.stdout), keep_default_na=False)


def same(found, wanted, name):
    """Live there is one row more: the estimate of the instant after the last sample."""
    assert len(found) == len(wanted) + 1
    for column in ("a", "b", "a_std", "b_std", "trusted", "reasons", "status"):
        np.testing.assert_array_equal(found[column][:-1], wanted[column], err_msg=column)
    np.testing.assert_array_equal(found[name][:-1], wanted[name])


@pytest.mark.parametrize("kind", ["s", "min", "ms", "ns", "dates", "epoch", "midnight"])
def test_live_estimates_on_even_steps_are_those_of_the_whole_log(tmp_path, kind):
    t, rows = uneven()
    name = NAMES.get(kind, "time_s" if kind == "s" else "time")
    text = log_of(dated(t, kind), rows, name)
    (tmp_path / "log.csv").write_text(text)
    same(live(text), offline(tmp_path / "log.csv", tmp_path / "out.csv"), name)


@pytest.mark.parametrize(
    "options",
    [
        ["--decimate", 3],
        ["--start", "0.5"],
        ["--start", "0.5", "--decimate", 2],
        ["--resample", "0.007"],
        ["--resample", "0.05"],
    ],
)
def test_with_inputs_and_other_options(tmp_path, options):
    t, rows = uneven(inputs=True)
    text = log_of(dated(t, "s"), rows, inputs=True)
    (tmp_path / "log.csv").write_text(text)
    options = ["--input", "u", *options]
    found = live(text, *options)
    same(found, offline(tmp_path / "log.csv", tmp_path / "out.csv", *options), "time_s")
    assert 0 < (found["measured"] == 0).sum() < len(found) / 4 or "0.05" in options


def test_rows_without_times(tmp_path):
    _, rows = uneven()
    text = "\n".join(["a,b,y,z", *(",".join(row) for row in rows), ""])
    (tmp_path / "log.csv").write_text(text)
    found = live(text, "--dt", 0.015)
    same(found, offline(tmp_path / "log.csv", tmp_path / "out.csv", "--dt", 0.015), "time_s")


def test_stopped_and_resumed_the_bytes_are_the_same(tmp_path):
    """Stopped twice, each time in the middle of a line; the log's end is that of the stream."""
    t, rows = uneven(inputs=True)
    text = log_of(dated(t, "s"), rows, inputs=True)
    command = [*FOLLOW, "-", *map(str, COLUMNS), "--input", "u", "--out", tmp_path / "whole.csv"]
    subprocess.run(command, input=text, text=True, check=True, timeout=120)
    parts = command[-1] = tmp_path / "parts.csv"
    command += ["--resume", tmp_path / "here"]
    edges = [0, len(text) * 6 // 10, len(text) * 8 // 10, len(text)]
    for a, b in pairwise(edges):
        begun = parts.stat().st_size if parts.exists() else 0
        pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen(command, **pipes, text=True) as run:
            run.stdin.write(text[a:b])
            run.stdin.flush()
            if b < len(text):
                quiet, before = 0, begun
                while quiet < 5:  # all that came in is worked through
                    time.sleep(0.2)
                    size = parts.stat().st_size if parts.exists() else 0
                    quiet = quiet + 1 if begun < size == before else 0
                    before = size
                run.send_signal(signal.SIGTERM)
                assert "goes on from here" in run.stderr.read()
            else:
                run.stdin.close()
                run.wait(60)
    assert parts.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_a_log_that_ends_early_says_what_is_lacking(tmp_path):
    t, rows = uneven()
    text = "\n".join(log_of(dated(t, "s"), rows).splitlines()[:60])
    command = [*FOLLOW, "-", *map(str, COLUMNS)]
    run = subprocess.run(command, input=text, capture_output=True, text=True, timeout=120)
    assert run.returncode == 2
    assert "history: expected less than" in run.stderr
    assert run.stderr.count("\n") == 1
