"""Campaigns as processes, for tests: begun, watched, killed, compared."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

SMALL = """
seeds = 8
batch = 2
[systems.bench]
recorded = 0.3
duration = 1
[systems.pendulum]
recorded = 3.9
duration = 5.2
[noise.low]
x = 1e-4
y = 1e-3
[faults.none]
[faults.gaps]
missing = 0.1
[estimators.DdMhe]
knows_noise = true
[estimators.ErrorStateKalman]
[keep]
spans = [1]
traces = [0, 3]
"""


def command(*arguments):
    return [sys.executable, "-m", "ddmhe", "campaign", *map(str, arguments)]


def begin(*arguments):
    """A command that goes on, in a group of its own, its lines of JSON to be read."""
    return subprocess.Popen(
        command("run", *arguments, "--json"), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip


def at(process, share):
    """The first line that tells of this share of the cases; fails where it ends before."""
    for line in process.stdout:
        stand = json.loads(line)
        if stand.get("event") == "progress" and stand["done"] >= share * stand["total"]:
            return stand
    raise AssertionError(process.stderr.read())


def children(process):
    """Processes that it started: the workers of a local cluster."""
    found = psutil.Process(process.pid).children()
    alive = [one for one in found if one.status() != psutil.STATUS_ZOMBIE]
    return [one.pid for one in alive if any("spawn_main" in word for word in one.cmdline())]


def kill_worker(process):
    """Kill a worker of its local cluster, and wait until the worker has let go of all files."""
    worker = children(process)[0]
    os.kill(worker, signal.SIGKILL)
    while psutil.pid_exists(worker):  # a dead one may have threads that are not
        time.sleep(0.01)


def contents(folder):
    """SHA-256 of every file that is reproducible, by its name: rows and traces, not times."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for kind in ("rows", "traces.zarr")
        for path in sorted(Path(folder, kind).rglob("*"))
        if path.is_file()
    }
