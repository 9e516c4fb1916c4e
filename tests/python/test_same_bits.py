"""The same input gives the same bits: however a log is split between `step`, `run` and snapshots,
and on however many threads."""

import copy
import pickle

import numpy as np
import pytest

import ddmhe
from attacks import noisy_system
from disturbed import Noisy

SPLITS = (
    copy.copy,
    lambda est: ddmhe.DdMhe.restore(est.snapshot()),
    lambda est: pickle.loads(pickle.dumps(est)),
    lambda est: est,
)


def case(seed):
    """A random system, settings of every kind, and 60 outputs, some of them lost."""
    rng = np.random.default_rng(seed)
    system = Noisy.random(seed, inputs=bool(rng.integers(2)), x_noise=0.02, T=60)
    Y = system.Y.copy()
    Y[rng.random(Y.shape) < 0.05] = np.nan
    size = np.abs(system.x).max() * 10 ** rng.uniform(-0.5, 0.5)
    settings = {
        "horizon": int(rng.integers(1, 12)),
        "weights": ["auto", "recorded", "scaled", "paper"][rng.integers(4)],
        "start": ["state", "recording", "unknown"][rng.integers(3)],
        "x_bounds": [None, None, (-size, size)][rng.integers(3)],
        "v_bounds": [None, None, (-0.5, 0.5)][rng.integers(3)],
        "process_noise": ["auto", "residual", None][rng.integers(3)],
    }
    if settings["x_bounds"] and rng.integers(2):
        settings["soft"] = 3.0
    try:
        return rng, ddmhe.DdMhe(system.history, **settings), Y, system.U
    except ddmhe.DdmheError:
        return case(seed + 100_000)


def split(rng, est, Y, U):
    """x̂ of all samples, by pieces of random length, each run or stepped, saved or not."""
    found, k = [], 0
    while k < len(Y):
        est = SPLITS[rng.integers(len(SPLITS))](est)
        rows = slice(k, k + int(rng.integers(1, 20)))
        u = None if U is None else U[rows]
        if rng.integers(2):
            found.extend(est.run(Y[rows], u).x)
        else:
            inputs = [None] * len(Y[rows]) if u is None else u
            found.extend(est.step(y, v).x for y, v in zip(Y[rows], inputs, strict=True))
        k = rows.stop
    return np.array(found)


def however_it_is_split(seeds):
    for seed in seeds:
        rng, est, Y, U = case(seed)
        whole = copy.copy(est).run(Y, U).x
        np.testing.assert_array_equal(split(rng, est, Y, U), whole, err_msg=str(seed))


def on_any_threads(seeds, monkeypatch):
    for seed in seeds:
        _, est, Y, U = case(seed)
        parts = [slice(k, k + 15) for k in range(0, 60, 5)]
        inputs = None if U is None else [U[part] for part in parts]
        alone = [copy.copy(est).run(Y[part], None if U is None else U[part]).x for part in parts]
        for threads in ("1", "2", "7"):
            monkeypatch.setenv("RAYON_NUM_THREADS", threads)
            logs = ddmhe.run_many(est, [Y[part] for part in parts], inputs)
            for log, x in zip(logs, alone, strict=True):
                np.testing.assert_array_equal(log.x, x, err_msg=f"{seed}, {threads} threads")


def test_however_it_is_split():
    however_it_is_split(range(40))


def test_on_any_number_of_threads(monkeypatch):
    on_any_threads(range(8), monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("block", range(8))
def test_long_however_it_is_split(block):
    however_it_is_split(range(1000 + 125 * block, 1000 + 125 * (block + 1)))


@pytest.mark.long
def test_long_on_any_number_of_threads(monkeypatch):
    on_any_threads(range(5000, 5200), monkeypatch)


@pytest.mark.parametrize("seed", range(4))
def test_a_snapshot_before_the_first_step(seed):
    """From "recording", whose samples no filter has seen yet."""
    system, _ = noisy_system(seed)
    est = ddmhe.DdMhe(system.history, 5, weights="recorded", start="recording")
    again = ddmhe.DdMhe.restore(est.snapshot())
    expected = est.run(system.Y, system.U).x
    np.testing.assert_array_equal(again.run(system.Y, system.U).x, expected)
