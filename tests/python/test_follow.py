"""A log that is still being written: lines in, estimates out; stopped and resumed bit for bit."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_here
from ddmhe.recordings import read
from odd_logs import HEAD, HISTORY, ROWS, N, habits, text

COLUMNS = ["--state", "w1,w2", "--output", "q1", "--history", str(HISTORY)]
FOLLOW = [sys.executable, "-m", "ddmhe", "estimate", "--follow"]
T = 150


def rows_of(output):
    return pd.read_csv(pd.io.common.StringIO(output), keep_default_na=False)


def followed(data, *options, log="-"):
    command = [*FOLLOW, log, *COLUMNS, *map(str, options)]
    return subprocess.run(command, input=data, capture_output=True, text=True, timeout=120)


def expected():
    r = read({n: np.array(c, float) for n, c in zip(HEAD, zip(*ROWS, strict=True), strict=True)},
             state=["w1", "w2"], output=["q1"], history=HISTORY)  # fmt: skip
    y = np.array([float(row[3]) for row in ROWS])[:, None]
    return ddmhe.DdMhe(r.history).run(y[T:])


@pytest.mark.parametrize("name", ["plain", "decimal-comma", "json-lines", "epoch-ns", "no-time"])
def test_a_stream_gives_the_estimates_of_the_whole_log(name):
    data, options = habits()[name]
    more = [part for key, value in options.items() for part in (f"--{key}", value)]
    result = followed(data.decode(), *more)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    if name == "json-lines":
        rows = pd.DataFrame([json.loads(line) for line in lines])
    else:
        rows = rows_of(result.stdout)
    run = expected()
    np.testing.assert_array_equal(rows[["w1", "w2"]].to_numpy(), run.x)
    np.testing.assert_array_equal(rows[["w1_std", "w2_std"]].to_numpy(), run.std)
    np.testing.assert_array_equal(rows["trusted"], run.trusted)
    if name == "epoch-ns":
        assert (np.diff(rows["timestamp"]) == 20_000_000).all()
        assert rows["timestamp"][0] == 1_700_000_020_223_456_854 + 20_000_000 * (T + 1)
    elif name == "plain":
        assert rows["time_s"].tolist() == pytest.approx([0.02 * k for k in range(T + 1, N + 1)])
    assert "standard input: " in result.stderr


def test_bad_lines_are_told_and_left_out_and_lost_ones_stepped_over():
    lines = text().splitlines()
    lines[171] = "3.4,what,1"
    lines[181] = "3.6,1,2,oops"
    lines[191] = lines[190]
    del lines[201:204]
    result = followed("\n".join([*lines, ""]))
    assert result.returncode == 0, result.stderr
    warnings = [w for w in result.stderr.splitlines() if "left out" in w or "lost" in w]
    assert [w.split("line ")[1].split(":")[0] for w in warnings] == [
        *("182", "183", "192", "193", "202")
    ]
    assert "column 'q1': expected a finite number, found 'oops'" in warnings[0]
    rows = rows_of(result.stdout)
    y = np.array([float(row[3]) for row in ROWS])
    y[[170, 180, 190, 200, 201, 202]] = np.nan
    r = read(dict(zip(HEAD, np.array(ROWS, float).T, strict=True)), state=["w1", "w2"],
             output=["q1"], history=HISTORY)  # fmt: skip
    run = ddmhe.DdMhe(r.history).run(y[T:, None])
    np.testing.assert_array_equal(rows[["w1", "w2"]].to_numpy(), run.x)
    lost = np.isin(np.arange(T, N), [180, 190, 200, 201, 202])
    np.testing.assert_array_equal(rows["measured"], ~lost)


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_growing_file_stopped_and_resumed(tmp_path):
    """Stopped in the middle of a line; the same bytes come out as without a stop."""
    whole = text()
    log, out, snapshot = (tmp_path / name for name in ("log.csv", "est.csv", "here.snapshot"))
    cut = len(whole) * 3 // 4
    log.write_text(whole[:cut])
    command = [*FOLLOW, log, *COLUMNS, "--out", out, "--resume", snapshot]
    expected_rows = rows_of(followed(whole).stdout)
    known = whole[:cut].count("\n") - 1 - T
    for size, more in ((known, ""), (len(expected_rows), whole[cut:])):
        with open(log, "a") as file:
            file.write(more)
        run = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

        def written(size=size):
            return out.exists() and out.read_text().count("\n") == size + 1

        wait_for(written)
        run.send_signal(signal.SIGTERM)
        _, said = run.communicate(timeout=60)
        assert run.returncode == 0, said
        assert f"--resume {snapshot} goes on from here" in said
    pd.testing.assert_frame_equal(rows_of(out.read_text()), expected_rows)


def test_an_estimate_comes_out_before_the_next_line_goes_in():
    lines = text().splitlines()
    command = [*FOLLOW, "-", *COLUMNS]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **pipes, text=True, bufsize=1) as run:
        run.stdin.write("\n".join(lines[: T + 3]) + "\n")
        run.stdin.flush()
        for _ in range(3):
            last = run.stdout.readline()
        for line in lines[T + 3 : T + 9]:
            run.stdin.write(line + "\n")
            run.stdin.flush()
            row = run.stdout.readline()
            assert row != last
            last = row
        run.stdin.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.csv", "--follow"], "none.csv: expected a readable log file"),
        (["log.csv", "--resume", "x"], "--resume: expected with --follow"),
        (
            ["log.csv", "--follow", "--resume", "log.csv"],
            "log.csv: expected a snapshot",
        ),
        (["log.csv", "--follow", "--sort"], "--follow: expected without --unwrap, --sort"),
        (["log.csv", "--follow", "--plot", "a.png"], "expected without --follow"),
        (
            ["log.csv", "--follow", "--state", "w9"],
            "state: expected a column of log.csv",
        ),
    ],
)
def test_wrong_use_of_follow_is_one_line(tmp_path, arguments, words):
    (tmp_path / "log.csv").write_text(text())
    handlers = [signal.getsignal(kind) for kind in (signal.SIGTERM, signal.SIGINT)]
    try:
        result = in_here("estimate", *COLUMNS, *arguments, cwd=tmp_path)
    finally:
        signal.set_wakeup_fd(-1)
        for kind, handler in zip((signal.SIGTERM, signal.SIGINT), handlers, strict=True):
            signal.signal(kind, handler)
    assert result.returncode == 2
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
@pytest.mark.long
def test_long_a_stream_takes_no_more_memory():
    """Three hundred thousand lines: what the process holds at the end is what it held early on."""
    command = [*FOLLOW, "-", *COLUMNS, "--no-evidence"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    sizes = []
    with subprocess.Popen(command, **pipes, text=True) as run:
        run.stdin.write(",".join(HEAD) + "\n")
        for k in range(300_000):
            row = ROWS[k % N]
            run.stdin.write(f"{0.02 * k:.2f},{','.join(row[1:])}\n")
            if k in (50_000, 299_999):
                run.stdin.flush()
                with open(f"/proc/{run.pid}/status") as status:
                    words = status.read()
                sizes.append(int(words.split("VmRSS:")[1].split()[0]))
        run.stdin.close()
    assert run.returncode == 0
    assert sizes[1] < sizes[0] + 4_000  # kB
