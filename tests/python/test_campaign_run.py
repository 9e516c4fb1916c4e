"""Campaigns on real workers: whatever is killed, what comes out at last is the same, bit for
bit."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys

import pytest

from campaigns import SMALL, at, begin, command, contents, kill_worker
from commands import in_here
from ddmhe import campaign
from ddmhe.campaign.store import Store
from ddmhe.campaign.work import run_part

LONG = """
seeds = 10000
batch = 50
[systems.bench]
duration = 0.2
[noise.low]
x = 1e-3
y = 1e-4
[estimators.DdMhe]
[keep]
traces = [0, 9999]
"""


@pytest.fixture(scope="session")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("campaign") / "spec.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="session")
def whole(spec):
    """The campaign, part after part in this process, without Dask."""
    read = campaign.read_spec(spec)
    store = Store.create(spec.parent / "whole", read)
    for part in read.parts:
        store.add(run_part(read, part))
    return store.folder


def ended(process, timeout=600):
    out, err = process.communicate(timeout=timeout)
    assert process.returncode == 0, err
    return json.loads(out.splitlines()[-1])


def check_kills(spec, whole, folder, later):
    """The client is killed at a third, a worker at a later share."""
    client = begin(spec, "--out", folder)
    at(client, 1 / 3)
    client.kill()
    client.communicate()
    left = len((folder / "manifest.jsonl").read_text().splitlines())
    with open(folder / "manifest.jsonl", "a") as manifest:
        manifest.write('{"part": 1')  # as an end in the middle of a line leaves it
    again = begin("--resume", folder)
    stand = at(again, 0)
    assert stand["done"] > 0
    assert stand["dashboard"].startswith("http://127.0.0.1:")
    assert "memory of each: " in stand["workers"]
    at(again, later)
    kill_worker(again)
    answer = ended(again, 3600)
    parts = len(campaign.open(folder).spec.parts)
    assert left < parts
    assert answer["finished"] == answer["cases"]
    assert set(answer["outcomes"]) == {"done"}
    assert contents(folder) == contents(whole)


def test_killed_and_resumed_it_is_the_same(spec, whole, tmp_path):
    check_kills(spec, whole, tmp_path / "killed", later=0.4)


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextlib.contextmanager
def dask(*arguments):
    """A process of `dask` by itself."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, arguments)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def scheduler_with_workers(folder):
    address = f"tcp://127.0.0.1:{free_port()}"
    place = ("--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")
    worker = ("worker", address, "--nthreads", 1, "--no-dashboard", "--local-directory", folder)
    with dask("scheduler", *place), dask(*worker), dask(*worker):
        yield address


def test_on_a_scheduler_started_by_itself_it_is_the_same(spec, whole, tmp_path):
    with scheduler_with_workers(tmp_path) as address:
        answer = ended(begin(spec, "--out", tmp_path / "remote", "--scheduler", address))
    assert answer["outcomes"] == {"done": 96}
    assert contents(tmp_path / "remote") == contents(whole)


def test_ctrl_c_ends_it_and_keeps_what_is_finished(spec, whole, tmp_path):
    folder = tmp_path / "stopped"
    process = begin(spec, "--out", folder, "--workers", 1)
    at(process, 0.2)
    os.killpg(process.pid, signal.SIGINT)
    out, _ = process.communicate(timeout=300)
    assert process.returncode == 130
    assert json.loads(out.splitlines()[-1])["stopped"]
    kept = campaign.open(folder)
    assert 0 < len(kept.rows) < 96
    assert not kept.complete
    frame = campaign.open(whole).rows
    same = frame[frame["case"].isin(kept.rows["case"])].reset_index(drop=True)
    assert same.equals(kept.rows)


def test_a_worker_that_dies_thrice_on_a_part_marks_it(spec, frame, tmp_path):
    """One log is a pipe: who reads it waits, and is killed there."""
    frame.to_csv(tmp_path / "b.csv", index=False)
    os.mkfifo(tmp_path / "a.csv")
    table = f"""
        batch = 1
        [systems.log]
        files = "{tmp_path}/*.csv"
        state = ["wx", "wy", "wz"]
        output = ["tx", "ty", "tz"]
        history = 20
        [estimators.DdMhe]
        """
    (tmp_path / "spec.toml").write_text(table)
    process = begin(tmp_path / "spec.toml", "--out", tmp_path / "died", "--workers", 1)
    for _ in range(3):
        with open(tmp_path / "a.csv", "wb"):  # opens when a worker reads
            kill_worker(process)
    assert ended(process)["outcomes"] == {"WorkerDied": 1, "done": 1}
    failed = campaign.open(tmp_path / "died").failed
    assert "died 3 times" in failed["error"].iloc[0]


def test_what_is_kept_is_what_a_case_comes_to(whole):
    found = campaign.open(whole)
    assert found.complete
    assert list(found.rows["case"]) == list(range(96))
    assert set(found.rows["system"]) == {"bench", "pendulum"}
    assert (found.rows["spec_hash"] == found.spec.hash).all()
    assert list(found.timing["case"]) == list(range(96))
    assert (found.timing["seconds"] > 0).all()
    trace = found.traces[3]
    error = trace["x_hat"] - trace["x"]
    rmse = float((error**2).sum("state").mean() ** 0.5)
    assert found.rows["rmse_all"][3] == pytest.approx(rmse, rel=1e-12)
    made = found.to_xarray()
    assert made["rmse"].sel(case=3, span="all").item() == found.rows["rmse_all"][3]
    assert set(made.dims) == {"case", "span", "state"}


def test_a_changed_spec_and_a_used_folder_are_refused(spec, whole, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(SMALL.replace("seeds = 12", "seeds = 13"))
    for arguments, words in (
        ((other, "--resume", whole), "another: seeds was 12.0, is 13.0"),
        ((spec, "--out", whole), "--resume goes on with it"),
        (("--resume", tmp_path), "expected the folder of a campaign"),
        ((spec,), "'--out' and '--resume'"),
    ):
        done = in_here("campaign", "run", *arguments)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert words in done.stderr


@pytest.mark.long
def test_a_scheduler_that_does_not_answer_is_named(spec, tmp_path):
    address = f"tcp://127.0.0.1:{free_port()}"
    done = subprocess.run(
        command("run", spec, "--out", tmp_path / "x", "--scheduler", address),
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert f"answers at {address}" in done.stderr


def test_a_dry_run_counts(spec):
    done = subprocess.run(
        command("run", spec, "--dry-run", "--json"), capture_output=True, text=True
    )
    told = json.loads(done.stdout)
    assert told["cases"] == 96
    assert told["parts"] == 24
    assert told["timed"] >= 3
    assert told["seconds"] > 0
    assert told["bytes"] > 0


@pytest.mark.long
def test_ten_thousand_cases_killed_and_resumed_are_the_same(tmp_path):
    spec = tmp_path / "spec.toml"
    spec.write_text(LONG)
    first = begin(spec, "--out", tmp_path / "whole", "--workers", 2)
    assert ended(first, 3600)["finished"] == 10_000
    check_kills(spec, tmp_path / "whole", tmp_path / "killed", later=2 / 3)
    with scheduler_with_workers(tmp_path) as address:
        ended(begin(spec, "--out", tmp_path / "remote", "--scheduler", address), 3600)
    assert contents(tmp_path / "remote") == contents(tmp_path / "whole")
