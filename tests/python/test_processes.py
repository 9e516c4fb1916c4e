"""Signals, forks and killed workers, with real processes: where the old behaviour returns, a time
limit ends the test.

The limits leave room for a loaded machine: what took minutes, or for ever, must take seconds.
"""

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

import ddmhe
from ddmhe.reproduce import real, reproduce_real
from ddmhe.reproduce.montecarlo import in_parallel

if sys.platform == "win32":
    pytest.skip("POSIX signals", allow_module_level=True)

SETUP = """
    import os, signal, sys, time
    import numpy as np
    import ddmhe
    rng = np.random.default_rng(0)
    x = np.cumsum(rng.standard_normal((201, 3)), axis=0)
    h = ddmhe.History(x, x[:-1] @ rng.standard_normal((3, 2)), dt=0.1)
    def ready():
        print("ready", flush=True)
"""


def run(program, limit=120, stop_after=None, to=signal.SIGINT):
    """(seconds from the signal to the end, exit code, stdout, stderr) of a program that prints
    "ready" first."""
    code = textwrap.dedent(SETUP) + textwrap.dedent(program)
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        preexec_fn=lambda: signal.signal(
            signal.SIGINT, signal.SIG_DFL
        ),  # a shell's background job ignores it
    )
    try:
        if stop_after is not None:
            assert child.stdout.readline() == "ready\n", child.stderr.read()
            time.sleep(stop_after)
            child.send_signal(to)
        begin = time.monotonic()
        out, err = child.communicate(timeout=limit)
        return time.monotonic() - begin, child.returncode, out, err
    finally:
        child.kill()


FORKED = """
    import pandas  # which has a thread of its own where pyarrow is installed
    def threads():
        return len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1
    usual = threads()
    def work():
        logs = ddmhe.run_many(ddmhe.DdMhe(h), [h.recordings[0][1]] * 4)
        return ddmhe.tune(h30, progress=False).score, logs[3].x.sum()
    h30 = ddmhe.History(x[:31], h.recordings[0][1][:30])
    before = work()
    child = os.fork()
    if child == 0:
        os._exit(0 if work() == before else 1)
    _, status = os.waitpid(child, 0)
    print(os.waitstatus_to_exitcode(status))
    assert threads() == usual, f"{threads() - usual} threads are left"
"""


def test_a_forked_process_can_run_and_tune_again():
    """What rayon's global pool made impossible: its threads are not in the child, which waited for
    them for ever."""
    _, code, out, err = run(FORKED)
    assert (code, out) == (0, "0\n"), err


def test_multiprocessing_by_fork_after_run_many():
    program = """
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    def work(k):
        return ddmhe.run_many(ddmhe.DdMhe(h), [h.recordings[0][1]] * 3)[0].x.sum()
    expected = work(0)
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
        print(list(pool.map(work, range(4))) == [expected] * 4)
    """
    _, code, out, err = run(program)
    assert (code, out) == (0, "True\n"), err


LONG = "np.tile(h.recordings[0][1], (20_000, 1))"

STOPPED = {
    "run": f"""
    est, Y = ddmhe.DdMhe(h, 40), {LONG}
    out = np.full((len(Y), 3), np.nan)
    ready()
    try:
        est.run(Y, out=out)
    except KeyboardInterrupt as e:
        log = e.finished
        assert 0 < est.t == len(log.status) < len(Y)
        assert np.array_equal(log.x, out[:est.t])
        assert np.isnan(out[est.t:]).all()
        again = ddmhe.DdMhe(h, 40)
        again.run(Y[:est.t])
        assert np.array_equal(again.step([0.0, 0.0]).x, est.step([0.0, 0.0]).x)
        print("kept")
    """,
    "run_many, copies": f"""
    est, Y = ddmhe.DdMhe(h, 40), {LONG}
    ready()
    try:
        ddmhe.run_many(est, [Y[:100], Y, Y, Y])
    except KeyboardInterrupt as e:
        done = [len(log.status) for log in e.finished]
        assert done[0] == 100 and 0 < done[1] < len(Y) and len(done) == 4, done
        print("kept")
    """,
    "run_many, estimators": f"""
    ests, Y = [ddmhe.DdMhe(h, 40) for _ in range(3)], {LONG}
    ready()
    try:
        ddmhe.run_many(ests, [Y, Y, Y])
    except KeyboardInterrupt as e:
        assert [est.t for est in ests] == [len(log.status) for log in e.finished]
        print("kept")
    """,
    "run_many, recordings": f"""
    Y = {LONG}
    ready()
    try:
        ddmhe.run_many([h, h, h], [Y, Y, Y])
    except KeyboardInterrupt as e:
        assert len(e.finished) == 3
        print("kept")
    """,
    "tune": """
    def told(done, total):
        if done == 0:
            ready()
    record = ddmhe.models.detumbling().simulate(61.0, 0.1, noise=0.01)
    try:
        ddmhe.tune(ddmhe.History(record.x[:601], record.y[:600]), progress=told)
    except KeyboardInterrupt:
        print("kept")
    """,
    "IntervalObserver.run": """
    from ddmhe import interval
    s = interval.pendulum()
    gain = interval.fixed_gain(s, [[0.3], [0.3]])
    o = interval.IntervalObserver(s, gain, [0, 0], 0.1, 1e-3, 1e-2)
    Y = np.full((5_000_000, 1), np.nan)
    ready()
    try:
        o.run(Y)
    except KeyboardInterrupt as e:
        assert 0 < len(e.finished.lower) < len(Y)
        print("kept")
    """,
    "a Python baseline": f"""
    b, Y = ddmhe.baselines.ErrorStateKalman(h), {LONG}
    ready()
    try:
        b.run(Y)
    except KeyboardInterrupt as e:
        assert 0 < len(e.finished.x) < len(Y)
        print("kept")
    """,
}


@pytest.mark.parametrize("name", STOPPED)
def test_ctrl_c_stops_within_seconds_and_keeps_what_was_finished(name):
    seconds, code, out, err = run(STOPPED[name], stop_after=0.4)
    assert (code, out) == (0, "kept\n"), err
    assert seconds < 5, seconds


def test_another_signals_exception_passes_as_it_is():
    program = f"""
    class Enough(Exception):
        pass
    def enough(*_):
        raise Enough("time is up")
    signal.signal(signal.SIGALRM, enough)
    est = ddmhe.DdMhe(h, 40)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        est.run({LONG})
    except Enough as e:
        print(type(e.finished).__name__, est.t > 0)
    """
    _, code, out, err = run(program)
    assert (code, out) == (0, "Log True\n"), err


def test_a_run_in_another_thread_does_not_wait_for_signals():
    """Only the main thread runs handlers; a run beside it goes on to its end."""
    estimator = ddmhe.DdMhe(
        ddmhe.History(np.sin(np.arange(40.0))[:, None], np.cos(np.arange(39.0))[:, None]), 5
    )
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(2) as pool:
        runs = [pool.submit(ddmhe.run_many, estimator, [np.zeros((50_000, 1))]) for _ in range(2)]
        del estimator
        counts, refused = [], []
        for each in runs:
            try:
                counts.append(len(each.result()[0].x))
            except ddmhe.DdmheError as e:
                refused.append(str(e))  # the second came while the first was at work
    assert counts
    assert all("thread" in words for words in refused)
    assert set(counts) == {50_000}


def test_tune_tells_how_far_it_is():
    x = np.cumsum(np.random.default_rng(1).standard_normal((41, 2)), axis=0)
    told = []
    ddmhe.tune(ddmhe.History(x, x[:-1]), progress=lambda done, total: told.append((done, total)))
    assert told[-1][0] == told[-1][1] > 0
    assert [done for done, _ in told] == sorted(done for done, _ in told)

    def enough(done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        ddmhe.tune(ddmhe.History(x, x[:-1]), progress=enough)


def test_tune_keeps_the_horizons_that_were_scored_in_full():
    record = ddmhe.models.detumbling().simulate(9.0, 0.1, noise=1e-4)
    h = ddmhe.History(record.x[:81], record.y[:80], dt=0.1)

    def stop(done, total):
        if done > 0.6 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        ddmhe.tune(h, progress=stop)
    finished = caught.value.finished
    assert finished.words.startswith("Stopped: ")
    assert 1 < len(finished.table) < len(ddmhe.tune(h, progress=False).table)
    assert np.isfinite(ddmhe.DdMhe(h, **finished.settings).step(record.y[80]).x).all()


def test_an_interrupted_tune_keeps_the_default_where_others_take_too_long(monkeypatch):
    """The ends of the recording are asked before the search, and no other setting after it."""
    record = ddmhe.models.detumbling().simulate(9.0, 0.1, noise=1e-4)
    h = ddmhe.History(record.x[:81], record.y[:80], dt=0.1)
    monkeypatch.setattr("ddmhe.tuning.search.HURRY", 0.0)
    made = []
    of = ddmhe.tuning.result.DdMhe

    def counted(*args, **given):
        made.append(given)
        return of(*args, **given)

    def stop(done, total):
        if done > 0.6 * total:
            monkeypatch.setattr("ddmhe.tuning.result.DdMhe", counted)
            monkeypatch.setattr("ddmhe.tuning.promise.DdMhe", counted)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        ddmhe.tune(h, progress=stop)
    finished = caught.value.finished
    assert "is kept: there was no time to try the best of the others" in finished.words
    assert not made
    assert finished.settings == {}
    whole = ddmhe.tune(h, progress=False)
    assert whole.settings != {} or (finished.promise == whole.promise).all()


def slow(job):
    time.sleep(0.05 if job < 3 else 300)
    return job


def killed(job):
    if job == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return job


def threads(job):
    from threadpoolctl import threadpool_info

    return (
        job,
        max(info["num_threads"] for info in threadpool_info()),
        os.environ["RAYON_NUM_THREADS"],
    )


def test_workers_work():
    ticks = []
    assert in_parallel(threads, [1, 2, 3], lambda: ticks.append(1)) == [
        (k, 1, "1") for k in (1, 2, 3)
    ]
    assert len(ticks) == 3
    assert in_parallel(abs, [], lambda: None) == []


def test_a_killed_worker_is_one_clear_error():
    with pytest.raises(ddmhe.DdmheError, match="found one that was killed") as caught:
        in_parallel(killed, range(6), lambda: None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_worker_killed_while_the_next_one_starts_is_that_error_too(when):
    """The pool breaks before the next worker has its pipe, or before the pool knows of the worker:
    what was left of either was an OSError, or a process that nobody ended."""
    program = f"""
    import multiprocessing
    from ddmhe.reproduce import montecarlo
    Process = montecarlo._context().Process
    launch, started = Process._Popen, []
    def kill_the_first():
        os.kill(started[0].pid, signal.SIGKILL)
        time.sleep(1)
    def second_while_the_first_is_killed(process):
        if started and {when == "before"}:
            kill_the_first()
        started.append(launch(process))
        if len(started) == 2 and {when == "after"}:
            kill_the_first()
        return started[-1]
    Process._Popen = staticmethod(second_while_the_first_is_killed)
    os.cpu_count = lambda: 2
    try:
        montecarlo.in_parallel(abs, range(9), lambda: None)
    except ddmhe.DdmheError as e:
        for child in multiprocessing.active_children():
            child.join(30)
        print("killed" in str(e), len(multiprocessing.active_children()))
    """
    _, code, out, err = run(program)
    assert (code, out, err) == (0, "True 0\n", "")


def test_an_interrupt_ends_the_workers_at_once():
    ticks = []

    def stop():
        ticks.append(1)
        if len(ticks) == 3:
            raise KeyboardInterrupt

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt) as caught:
        in_parallel(slow, range(8), stop)
    assert time.monotonic() - begin < 60
    assert caught.value.finished == [0, 1, 2]


def test_interrupted_logs_leave_the_table_of_those_before(monkeypatch, tmp_path):
    def interrupted(*_):
        e = KeyboardInterrupt()
        e.finished = [{"mean": 1.0}, {"mean": 0.5}]
        raise e

    paths = [tmp_path / f"{name}.csv" for name in "abc"]
    monkeypatch.setattr(real, "in_parallel", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        reproduce_real(paths, tmp_path, lambda: None)
    _, written = caught.value.finished
    assert written[0].read_text().splitlines() == ["log,mean", "a,1.0", "b,0.5"]
    monkeypatch.setattr(real, "in_parallel", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt) as caught:
        reproduce_real(paths, tmp_path, lambda: None)
    assert caught.value.finished is None


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_reproduce_ends_with_its_signal_or_with_a_killed_worker(end, tmp_path):
    """Ctrl-C: exit 130 in seconds. A worker killed: exit 2 with one line."""
    program = f"""
    import threading
    from ddmhe.cli import main
    sys.argv = ["ddmhe", "reproduce", "detumbling", "--out", {str(tmp_path)!r}]
    import multiprocessing
    def kill():
        while not multiprocessing.active_children():
            time.sleep(0.05)
        ready()
        if {end == signal.SIGKILL}:
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)
    threading.Thread(target=kill, daemon=True).start()
    main()
    """
    if end == signal.SIGKILL:
        _, code, _, err = run(program)
        assert code == 2, err
        assert len(err.splitlines()) == 1
        assert "killed" in err
    else:
        seconds, code, _, err = run(program, stop_after=0.5)
        assert code == 130, err
        assert "Traceback" not in err
        assert seconds < 10


def test_estimate_writes_the_samples_that_were_estimated(tmp_path):
    t = np.arange(200_000) * 0.1
    log = tmp_path / "log.csv"
    with log.open("w") as file:
        file.write("t,x,y\n")
        np.savetxt(file, np.column_stack([t, np.sin(t), np.cos(t)]), fmt="%.4f", delimiter=",")
    out = tmp_path / "est.csv"
    program = f"""
    from ddmhe.cli import estimate, main
    def told(*given, make=estimate.choose):
        chosen = make(*given)
        ready()
        return chosen
    estimate.choose = told
    sys.argv = ["ddmhe", "estimate", {str(log)!r}, "--state", "x", "--output", "y"]
    sys.argv += ["--history", "20", "--horizon", "90", "--space", "ridge:1e-3"]
    sys.argv += ["--out", {str(out)!r}]
    main()
    """
    _, code, printed, err = run(program, stop_after=0.1, limit=200)
    assert code == 130, err
    assert "samples were estimated" in err
    assert "wrote" in printed
    with out.open() as file:
        assert 1 < sum(1 for _ in file) < 190_000
