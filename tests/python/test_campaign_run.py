"""Campaigns on real workers: whatever is killed, what comes out at last is the same, bit for
bit."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys

import distributed
import pytest

from campaigns import SMALL, at, begin, children, command, contents, kill_worker
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


def test_stopped_killed_and_resumed_elsewhere_it_is_the_same(spec, whole, tmp_path):
    """Ctrl-C at a fifth; a worker is killed at two fifths, the client at the half; the rest is run
    on a scheduler that is there already."""
    folder = tmp_path / "killed"
    check_stop(begin(spec, "--out", folder, "--workers", 1), folder, whole)
    again = begin("--resume", folder, "--workers", 1)
    stand = at(again, 0)
    assert stand["done"] > 0
    assert stand["dashboard"].startswith("http://127.0.0.1:")
    assert "memory of each: " in stand["workers"]
    at(again, 0.4)
    kill_worker(again)
    at(again, 0.5)
    again.kill()
    again.communicate()
    with open(folder / "manifest.jsonl", "a") as manifest:
        manifest.write('{"part": 1')  # as an end in the middle of a line leaves it
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, host="127.0.0.1", protocol="tcp",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        made = campaign.run(None, folder, resume=True, scheduler=cluster.scheduler_address)
    assert made.complete
    assert contents(folder) == contents(whole)


def test_workers_leave_an_interrupt_to_the_command(spec, whole, tmp_path):
    """A terminal sends it to them too; one that acted on it was gone for good."""
    process = begin(spec, "--out", tmp_path / "made", "--workers", 2)
    at(process, 0.2)
    for worker in children(process):
        os.kill(worker, signal.SIGINT)
    _, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert contents(tmp_path / "made") == contents(whole)


def check_stop(process, folder, whole):
    """Ctrl-C ends a campaign and keeps what is finished."""
    at(process, 0.2)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (130, "")
    assert json.loads(out.splitlines()[-1])["stopped"]
    kept = campaign.open(folder)
    assert 0 < len(kept.rows) < 64
    assert not kept.complete
    frame = campaign.open(whole).rows
    same = frame[frame["case"].isin(kept.rows["case"])].reset_index(drop=True)
    assert same.equals(kept.rows)


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
    with dask("scheduler", *place) as scheduler, dask(*worker), dask(*worker):
        yield address, scheduler


@pytest.mark.long
def test_a_killed_scheduler_takes_no_more_than_what_was_in_flight(spec, whole, tmp_path):
    folder = tmp_path / "remote"
    with scheduler_with_workers(tmp_path) as (address, scheduler):
        client = begin(spec, "--out", folder, "--scheduler", address)
        at(client, 0.4)
        scheduler.kill()
        _, err = client.communicate(timeout=300)
    assert client.returncode == 2
    assert len(err.splitlines()) == 1
    assert "it was lost; finished parts are kept" in err
    kept = contents(folder)
    assert 0.4 <= len(campaign.open(folder).rows) / 64 < 1
    with scheduler_with_workers(tmp_path) as (address, _):
        assert ended(begin("--resume", folder, "--scheduler", address))["finished"] == 64
    assert contents(folder) == contents(whole)
    assert kept.items() <= contents(folder).items()


@pytest.mark.long
def test_a_worker_that_dies_thrice_on_a_part_marks_it(spec, frame, tmp_path):
    """One log is a pipe: who reads it waits, and is killed there."""
    for name in "ac":  # the first and the last are tried before the campaign begins
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    os.mkfifo(tmp_path / "b.csv")
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
        with open(tmp_path / "b.csv", "wb"):  # opens when a worker reads
            kill_worker(process)
    assert ended(process)["outcomes"] == {"WorkerDied": 1, "done": 2}
    failed = campaign.open(tmp_path / "died").failed
    assert "died 3 times" in failed["error"].iloc[0]


def test_what_is_kept_is_what_a_case_comes_to(whole):
    found = campaign.open(whole)
    assert found.complete
    assert list(found.rows["case"]) == list(range(64))
    assert set(found.rows["system"]) == {"bench", "pendulum"}
    assert (found.rows["spec_hash"] == found.spec.hash).all()
    assert list(found.timing["case"]) == list(range(64))
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
    other.write_text(SMALL.replace("seeds = 8", "seeds = 9"))
    for arguments, words in (
        ((other, "--resume", whole), "another: seeds was 8, is 9"),
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
    done = in_here("campaign", "run", spec, "--dry-run", "--json")
    told = json.loads(done.stdout)
    assert told["cases"] == 64
    assert told["parts"] == 16
    assert told["timed"] >= 3
    assert told["seconds"] > 0
    assert told["bytes"] > 0


def check_kills(spec, whole, folder):
    """The client is killed at a third, a worker at two thirds."""
    client = begin(spec, "--out", folder)
    at(client, 1 / 3)
    client.kill()
    client.communicate()
    left = len((folder / "manifest.jsonl").read_text().splitlines())
    again = begin("--resume", folder)
    at(again, 2 / 3)
    kill_worker(again)
    answer = ended(again, 3600)
    parts = len(campaign.open(folder).spec.parts)
    assert left < parts
    assert answer["finished"] == answer["cases"]
    assert set(answer["outcomes"]) == {"done"}
    assert contents(folder) == contents(whole)


@pytest.mark.long
def test_ten_thousand_cases_killed_and_resumed_are_the_same(tmp_path):
    spec = tmp_path / "spec.toml"
    spec.write_text(LONG)
    first = begin(spec, "--out", tmp_path / "whole", "--workers", 2)
    assert ended(first, 3600)["finished"] == 10_000
    check_kills(spec, tmp_path / "whole", tmp_path / "killed")
    with scheduler_with_workers(tmp_path) as (address, _):
        ended(begin(spec, "--out", tmp_path / "remote", "--scheduler", address), 3600)
    assert contents(tmp_path / "remote") == contents(tmp_path / "whole")
