"""A log's bytes, and how to read them, from a fuzzer: a log, or one sentence that says what is
wrong with it.

The first byte chooses the options; the rest is the file. Run by `tests/fuzz/run.sh`."""

import os
import sys
import tempfile

import atheris

with atheris.instrument_imports(include=["ddmhe.recordings"]):
    from ddmhe import DdmheError
    from ddmhe.recordings import read_log

FOLDER = tempfile.mkdtemp(
    prefix="ddmhe-fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None
)
PATH = os.path.join(FOLDER, "log.csv")


def options(choice):
    """Arguments of `read_log` for a byte."""
    return {
        "state": ["a", "b"] if choice & 1 else ["a"],
        "output": ["y"],
        "input": ["u"] if choice & 2 else [],
        "decimate": 1 + (choice >> 2 & 1),
        "start": 0.2 if choice & 8 else None,
        "missing": [-9999.0] if choice & 16 else [],
        "unwrap": ["y"] if choice & 32 else [],
    }


def said(call):
    """What a call returns, or None where it says in one sentence what is wrong."""
    try:
        return call()
    except DdmheError as e:
        words = str(e)
    assert words
    assert "\n" not in words
    return None


def read(data):
    """Everything that the command line does with a log before it estimates."""
    with open(PATH, "wb") as f:
        f.write(data[1:])
    log = said(lambda: read_log(PATH, **options(data[0] if data else 0)))
    if log is not None:
        said(lambda: log.split(0.5))
        said(lambda: log.fill_gaps().split(0.5))


if __name__ == "__main__":
    atheris.Setup(sys.argv, read)
    atheris.Fuzz()
