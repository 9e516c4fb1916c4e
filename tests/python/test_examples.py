"""The programs in `examples`, as a reader would run them; the Rust ones are run by
tests/rust/examples.rs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def output(name):
    command = [sys.executable, "-W", "error", str(EXAMPLES / name)]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout


def number(pattern, text):
    return float(re.search(pattern, text)[1])


def test_every_example_is_run():
    names = sorted(path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".rs"))
    assert [name[0] for name in names] == sorted({name[0] for name in names})
    rust = (Path(__file__).parents[1] / "rust" / "examples.rs").read_text()
    here = Path(__file__).read_text()
    assert all(name in (rust if name.endswith(".rs") else here) for name in names)


def test_your_own_log():
    printed = output("4_your_own_log.py")
    assert number(r"NRMSE of the rate: (\S+);", printed) < 0.05
    assert "statuses: optimal" in printed
    assert "recorded 500 samples, estimated 999" in printed


def test_tune_and_certify():
    printed = output("5_tune_and_certify.py")
    assert number(r"inequality (\S+),", printed) <= 0
    assert number(r"over its bound: (\S+)", printed) <= 1
    assert 0 < number(r"promised error (\S+)", printed) < 0.1


@pytest.mark.parametrize("name", ["6_intervals.py"])
def test_intervals(name):
    printed = output(name)
    assert "gain verified: True; 200 steps, 0 states outside" in printed
    assert number(r"not measured: (\S+) rad/s", printed) < 0.2
