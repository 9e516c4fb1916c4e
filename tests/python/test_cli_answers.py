"""What every command has: JSON for programs, silence, bars on terminals, an end at Ctrl-C."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import numpy as np
import pytest

import ddmhe
from commands import COLUMNS, in_a_process, in_here, printed
from ddmhe.cli import COMMANDS as LINES
from ddmhe.cli import cli

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
RADII = ["--w-radius", "0.02", "--v-radius", "0.05", "--accept-wide"]
COMMANDS = {
    "demo": ["demo"],
    "estimate": ["estimate", "LOG", *COLUMNS, "--history", 20, "--rho", 0.9],
    "design": ["design", "LOG", *COLUMNS, "--history", 20],
    "tune": ["tune", "LOG", *COLUMNS, "--history", 8],
    "explain": ["explain", "LOG", *COLUMNS, "--history", 20],
    "bench": ["bench", "LOG", *COLUMNS, "--history", 20, "--steps", 500],
    "interval": ["interval", "LOG", *COLUMNS, "--history", 20, *RADII],
}


@pytest.fixture(scope="module")
def answered(log, tmp_path_factory):
    """Each command's result as tables and as JSON."""
    found = {}

    def run(name):
        if name not in found:
            command = [log if part == "LOG" else part for part in COMMANDS[name]]
            place = tmp_path_factory.mktemp(name)
            found[name] = [in_here(*command, *how, cwd=place) for how in ([], ["--json"])]
        return found[name]

    return run


def numbers_in(value):
    if isinstance(value, dict):
        return [n for one in value.values() for n in numbers_in(one)]
    if isinstance(value, list):
        return [n for one in value for n in numbers_in(one)]
    return [float(value)] if isinstance(value, int | float) else []


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"bench"}))  # times are never the same
def test_json_has_every_number_of_the_tables(answered, name):
    shown, told = answered(name)
    assert (shown.returncode, told.returncode) == (0, 0), told.stderr
    found = json.loads(told.stdout)
    assert told.stdout.count("\n") == 1
    assert (found["command"], found["stopped"]) == (name, False)
    numbers = np.array(numbers_in(found))
    cells = [
        cell
        for row in re.findall(r"^│(.*)│$", shown.stdout, re.MULTILINE)
        for cell in row.split("│")[1:]
    ]
    checked = 0
    # times differ from run to run
    cells = [cell for cell in cells if not cell.strip().endswith(" us")]
    for text in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]\d+)?(?=[%\s,)]|$)", "\n".join(cells)):
        # as many digits as are shown, in the unit that is shown: per cent, microseconds
        value, digits = float(text), len(re.sub(r"e.*|[-.]", "", text).lstrip("0")) or 1
        near = [np.abs(scale * numbers - value) for scale in (1.0, 100.0)]
        room = 0.51 * 10.0 ** (np.floor(np.log10(abs(value))) - digits + 1) if value else 1e-4
        assert min(part.min() for part in near) <= room, (text, name)
        checked += 1
    assert checked > 5


@pytest.mark.parametrize("name", COMMANDS)
def test_the_page_names_every_key(answered, name):
    found = json.loads(answered(name)[1].stdout)
    section = PAGE.split(f"### `ddmhe {name}")[1].split("\n### ")[0]
    everywhere = PAGE.split("### Every command")[1].split("\n### ")[0]
    rows = re.findall(r"^\|([^|]*)\|", section + everywhere, re.MULTILINE)
    named = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    assert set(found) - named == set()


def test_quiet_says_nothing_and_writes_all_the_same(log, tmp_path):
    options = [*COLUMNS, "--history", 20, "--out", "est.csv", "--quiet"]
    result = in_here("estimate", log, *options, cwd=tmp_path)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert (tmp_path / "est.csv").exists()
    wrong = in_here("estimate", log, "--state", "no", "--output", "tx", "--history", 20, "-q")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("ddmhe: error: state: ")


def test_verbose_says_why_and_how_long(log):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "-v")
    assert re.search(r"^ddmhe: estimating: [\d.]+ s$", result.stderr, re.MULTILINE)
    h = ddmhe.recordings.read(
        log, state=["wx", "wy", "wz"], output=["tx", "ty", "tz"], history=20
    ).history
    for key, sentence in ddmhe.DdMhe(h).settings.why.items():
        assert f"{key}: {sentence}" in result.stdout


def test_without_a_command_help_is_printed_and_no_help_is_cut():
    bare = in_a_process()
    assert (bare.returncode, bare.stdout) == (0, in_a_process("--help").stdout)
    assert "..." not in bare.stdout.partition("\n")[2]
    for name, (_, line) in LINES.items():
        assert f"  {name} " in bare.stdout
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        assert (command.name, command.get_short_help_str(99)) == (name, line)


def test_a_table_in_a_pipe_is_as_wide_as_it_is(frame, tmp_path):
    long = "a_state_with_quite_a_long_name_" * 6
    frame.rename(columns={"wx": long}).to_csv(tmp_path / "log.csv", index=False)
    columns = ["--state", f"{long},wy,wz", "--output", "tx,ty,tz", "--history", 20]
    result = in_a_process("estimate", "log.csv", *columns, cwd=tmp_path)
    assert f"│ NRMSE {long}" in result.stdout
    assert "…" not in result.stdout


def test_where_a_command_writes_is_checked_before_it_works(log, tmp_path):
    (tmp_path / "file").write_text("no folder")
    for name in ("tune", "design", "interval"):
        result = in_here(name, "no-such.csv", *COLUMNS, "--history", 20, "--out", tmp_path / "file")
        assert result.returncode == 2
        assert "file/any: expected to be able to write" in result.stderr


# --- every setting is an option

OPTIONS = {
    "x_bounds": (["--x-bounds", "-1:1"], "-1 to 1"),
    "one a column": (["--x-bounds", "-1:1,-2:2,:3"], "-1 -2 -inf to 1 2 3"),
    "by name": (["--x-bounds", "wy=-2:2"], "-inf -2 -inf to inf 2 inf"),
    "v_bounds": (["--v-bounds", "tx=-1:1"], "-1 -inf -inf to 1 inf inf"),
    "w_bounds": (["--w-bounds", "-1:1", "--process-noise", "recorded"], "-1 to 1"),
    "soft": (["--soft", "x=2", "--x-bounds", "-1:1"], "x: 2"),
    "weights": (["--weights", "scaled"], "scaled"),
    "drift": (["--drift", "1e-9,1e-9,1e-9"], "1e-09 0 0; 0 1e-09 0; 0 0 1e-09"),
    "equilibrium": (["--equilibrium", "0,0,0:0,0,0"], "0, 0, 0, 0, 0, 0"),
    "x_prior": (["--x-prior", "0.1,0.2,0.3"], "0.1, 0.2, 0.3"),
    "disturbance": (["--disturbance", "0.1,0.1,0.1"], "0.1, 0.1, 0.1"),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_every_setting_is_an_option_and_is_marked(log, name, tmp_path):
    options, words = OPTIONS[name]
    if name == "disturbance":
        in_here("design", log, *COLUMNS, "--history", 20, "--out", tmp_path)
        options = [*options, "--certificate", tmp_path / "design.toml"]
    result = in_here("estimate", log, *COLUMNS, "--history", 20, *options)
    assert result.returncode == 0, result.stderr
    label = options[0].removeprefix("--").replace("-", " ")
    (row,) = [line for line in result.stdout.splitlines() if line.startswith(f"│ {label} ")]
    assert words in row
    assert "(given)" in row


def test_a_box_of_the_command_line_is_that_of_python(log):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--x-bounds", "wx=-0.01:0.01")
    read = ddmhe.recordings.read(
        log, state=["wx", "wy", "wz"], output=["tx", "ty", "tz"], history=20
    )
    box = ([-0.01, -np.inf, -np.inf], [0.01, np.inf, np.inf])
    x = ddmhe.DdMhe(read.history, x_bounds=box).run(read.Y).x
    rmse = np.sqrt(np.mean((x - read.x_true) ** 2, axis=0))
    assert printed(result, "RMSE wx") == pytest.approx(rmse[0], rel=1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--x-bounds", "1"], ["--x-bounds", "LO:HI", "'1'"]),
        (["--x-bounds", "no=1:2"], ["--x-bounds", "wx, wy, wz", "'no'"]),
        (["--x-bounds", "wx=1:2,3:4"], ["--x-bounds", "different names, or none"]),
        (["--soft", "dear"], ["--soft", "'dear'"]),
        (["--equilibrium", "0"], ["--equilibrium", "'0'"]),
        (["--certificate", "none.toml"], ["none.toml", "no such file"]),
    ],
    ids=lambda value: str(value[0]),
)
def test_wrong_settings(log, options, words, tmp_path):
    result = in_here("estimate", log, *COLUMNS, "--history", 20, *options, cwd=tmp_path)
    assert result.returncode == 2
    assert all(word in result.stderr for word in words), result.stderr


# --- terminals and interrupts

SLOW = """
import sys, time
from ddmhe.cli.answer import Answer
answer = Answer("slow", False, False, False)
with answer.working("thinking") as advance:
    for k in range(20):
        advance(k, 20)
        time.sleep(float(sys.argv[1]))
"""


@pytest.mark.parametrize(("pause", "shown"), [(0.1, True), (0.005, False)])
def test_long_work_has_a_bar_with_the_time_left_on_a_terminal(pause, shown):
    above, below = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", SLOW, str(pause)], stderr=below, timeout=60, check=True,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "100"},
    )  # fmt: skip
    assert done.returncode == 0
    os.close(below)
    text = b""
    try:
        while chunk := os.read(above, 65536):
            text += chunk
    except OSError:
        pass  # the end of a terminal
    os.close(above)
    assert (b"thinking" in text) == shown
    assert (b"left" in text) == shown


def test_no_bar_in_a_pipe():
    done = subprocess.run(
        [sys.executable, "-c", SLOW, "0.1"], capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("", "")


NATIVE = """
import sys, click, numpy, ddmhe.cli
@click.command("stuck")
def stuck():
    print("begun", flush=True)
    numpy.linalg.eigvals(numpy.random.default_rng(0).standard_normal((6000, 6000)))
ddmhe.cli.cli.add_command(stuck)
sys.argv = ["ddmhe", "stuck"]
ddmhe.cli.main()
"""


def test_an_interrupt_ends_what_python_cannot():
    """A product of LAPACK that takes minutes and returns to Python only then."""
    process = subprocess.Popen([sys.executable, "-c", NATIVE], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"begun\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) == 130
    process.stdout.close()


DROPPED = """
import sys, time, click, ddmhe.cli
class Slow:
    def __del__(self):
        print("begun", flush=True)
        time.sleep(60)
@click.command("stuck")
def stuck():
    Slow()
    time.sleep(60)
ddmhe.cli.cli.add_command(stuck)
sys.argv = ["ddmhe", "stuck"]
ddmhe.cli.main()
"""


def test_an_interrupt_that_python_drops_comes_again():
    """Exceptions of `__del__` are dropped, this one with them."""
    command = [sys.executable, "-c", DROPPED]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert (process.returncode, "Traceback" in err) == (130, False)
