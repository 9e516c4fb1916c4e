"""Many threads: each with an estimator or a copy of its own, and all of them on one."""

import copy
import threading
from collections import Counter

import numpy as np
import pytest

import ddmhe
from attacks import noisy_system


def in_threads(works):
    """Runs them at once; what they returned, in order. What one raises is raised."""
    found, failed = [None] * len(works), []
    ready = threading.Barrier(len(works))

    def one(k):
        try:
            ready.wait()
            found[k] = works[k]()
        except BaseException as e:
            failed.append(e)

    threads = [threading.Thread(target=one, args=(k,)) for k in range(len(works))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for e in failed:
        raise e
    return found


def stepped(est, Y, times):
    return [est.step(y).x for _ in range(times) for y in Y]


def own_estimators(threads, times):
    """Estimators that share what was computed at construction, each stepped by a thread of its
    own: the numbers of one thread."""
    case, _ = noisy_system(1)
    est = ddmhe.DdMhe(case.history, 6, x_bounds=(-3, 3), start="unknown")
    est.step(case.Y[0])
    expected = np.array(stepped(copy.copy(est), case.Y, times))

    def work(k):
        def run():
            own = copy.copy(est) if k % 2 else ddmhe.DdMhe.restore(est.snapshot())
            return stepped(own, case.Y, times)

        return run

    for found in in_threads([work(k) for k in range(threads)]):
        np.testing.assert_array_equal(found, expected)


def one_estimator(threads, calls):
    """All on one: an answer, or the error that says what to do; every answer is a step that was
    made."""
    case, _ = noisy_system(1)
    est = ddmhe.DdMhe(case.history, 12)
    rows = np.tile(case.Y, (50, 1))

    def work(k):
        def run():
            counts = Counter()
            for i in range(calls):
                try:
                    if (i + k) % 3:
                        est.step(case.Y[i % len(case.Y)])
                        counts["steps"] += 1
                    else:
                        counts["steps"] += len(est.run(rows).x)
                except ddmhe.DdmheError as e:
                    counts["refused", str(e)] += 1
            return counts

        return run

    counts = sum(in_threads([work(k) for k in range(threads)]), Counter())
    assert est.t == counts.pop("steps") > 0
    assert np.isfinite(est.estimate.x).all()
    assert all("thread" in words and "copy.copy" in words for _, words in counts)
    return sum(counts.values())


def test_many_threads_with_estimators_of_their_own():
    own_estimators(8, 2)


def test_many_threads_on_one_estimator():
    one_estimator(4, 30)


@pytest.mark.long
def test_long_many_threads_with_estimators_of_their_own():
    own_estimators(32, 100)


@pytest.mark.long
def test_long_many_threads_on_one_estimator():
    assert one_estimator(16, 500) > 0
