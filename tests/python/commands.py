"""The command line for tests: as a process of its own, and in this one, which saves the second that
imports take; and the columns of the log that conftest records."""

import contextlib
import io
import re
import subprocess
import sys

import pytest

from ddmhe.cli import main

STATE, OUTPUT = ["wx", "wy", "wz"], ["tx", "ty", "tz"]
COLUMNS = ["--state", "wx,wy,wz", "--output", "tx,ty,tz"]
T, N = 200, 600
PNG = b"\x89PNG\r\n\x1a\n"


def in_a_process(*arguments, cwd=None, timeout=120):
    command = [sys.executable, "-m", "ddmhe", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=timeout)


def in_here(*arguments, cwd=None):
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, "argv", ["ddmhe", *map(str, arguments)])
        if cwd is not None:
            patch.chdir(cwd)
        with pytest.raises(SystemExit) as ended:
            main()
    return subprocess.CompletedProcess(
        arguments, ended.value.code or 0, out.getvalue(), err.getvalue()
    )


def printed(result, label):
    """The number that a table prints beside `label`."""
    return float(re.search(rf"{re.escape(label)}\s*│\s*([-\d.e+]+)", result.stdout).group(1))


def printed_cells(result, label):
    """The numbers of all columns of a table beside `label`."""
    row = re.search(rf"│ {re.escape(label)}\s*│(.*)│$", result.stdout, re.MULTILINE).group(1)
    return [float(cell) for cell in row.split("│")]
