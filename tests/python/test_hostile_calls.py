"""A million calls with arguments of every kind, counted by what came of them:
`python tests/python/test_hostile_calls.py 1000000` prints the counts."""

import copy
import pickle
import sys
from collections import Counter

import numpy as np
import pytest

import ddmhe
from attacks import ODD, WRONG, Sequence, Unkind, dressed
from test_same_bits import case

WRONG_OR_WORSE = (*WRONG, Unkind(), Sequence())


def odd(rng, shape):
    """Numbers of every size that a double has, most of them sane."""
    values = rng.standard_normal(shape)
    where = rng.random(shape) < 0.3
    values[where] = np.array(ODD)[rng.integers(len(ODD), size=where.sum())]
    return values


def any_of(rng, things):
    return things[rng.integers(len(things))]


class Calls:
    """One estimator and what is asked of it."""

    def __init__(self, seed):
        self.rng, self.est, self.Y, self.U = case(seed)

    def inputs(self, rows):
        return () if self.U is None else (self.U[rows],)

    def step(self):
        k = int(self.rng.integers(len(self.Y)))
        return self.est.step(dressed(self.Y[k], int(self.rng.integers(10))), *self.inputs(k))

    def odd_step(self):
        return self.est.step(odd(self.rng, self.est.p), *self.inputs(0))

    def odd_input(self):
        return self.est.step(self.Y[1], odd(self.rng, self.est.m + self.rng.integers(2)))

    def boxed_step(self):
        shape = any_of(self.rng, [(), self.est.n, (self.est.next_depth + 1, self.est.n), 7])
        sides = odd(self.rng, shape), odd(self.rng, shape)
        return self.est.step(self.Y[2], *self.inputs(2), x_bounds=sides)

    def wrong_step(self):
        return self.est.step(any_of(self.rng, WRONG_OR_WORSE), *self.inputs(0))

    def run(self):
        size = int(self.rng.integers(5))
        return self.est.run(odd(self.rng, (size, self.est.p)), *self.inputs(slice(size)))

    def wrong_run(self):
        return self.est.run(any_of(self.rng, WRONG_OR_WORSE), any_of(self.rng, WRONG_OR_WORSE))

    def reset(self):
        start = any_of(self.rng, [None, None, "state", "recording", "unknown", "nowhere", 3])
        prior = any_of(self.rng, [None, None, odd(self.rng, self.est.n), *WRONG_OR_WORSE])
        self.est.reset(prior, start)

    def restore(self):
        blob = bytearray(self.est.snapshot())
        if self.rng.random() < 0.5:
            blob[self.rng.integers(len(blob))] ^= 1 << self.rng.integers(8)
        self.est = ddmhe.DdMhe.restore(bytes(blob))

    def copy(self):
        way = any_of(self.rng, [copy.copy, copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
        self.est = way(self.est)

    def history(self):
        x, y = odd(self.rng, (12, 2)), odd(self.rng, (11, 1))
        h = ddmhe.History(x, any_of(self.rng, [y, y, *WRONG_OR_WORSE]))
        return ddmhe.History.from_bytes(ddmhe.History.concat([h, h]).to_bytes())


CHANCES = {
    "step": 0.3,
    "odd_step": 0.25,
    "odd_input": 0.04,
    "boxed_step": 0.07,
    "wrong_step": 0.15,
    "run": 0.06,
    "wrong_run": 0.06,
    "reset": 0.03,
    "restore": 0.002,
    "copy": 0.008,
    "history": 0.03,
}


def outcome(call):
    """A word for what came of a call; nothing but an answer or an error of ours is one."""
    try:
        found = call()
    except ddmhe.DdmheError as e:
        return type(e).__name__
    if isinstance(found, ddmhe.Estimate):
        assert np.isfinite(found.window).all()
        assert found.status != "optimal" or np.isfinite(found.cost)
        return found.status
    if isinstance(found, ddmhe.Log):
        assert np.isfinite(found.x).all()
        return "log"
    return "done"


def hostile_calls(count, each=2000):
    """Counts by call and outcome of `count` calls, on a new estimator every `each` calls."""
    counts = Counter()
    for first in range(0, count, each):
        calls = Calls(9000 + first // each)
        names = calls.rng.choice(list(CHANCES), min(each, count - first), p=list(CHANCES.values()))
        for name in names:
            counts[str(name), outcome(getattr(calls, name))] += 1
    return counts


def test_hostile_calls():
    counts = hostile_calls(8000, each=800)
    found = {what for _, what in counts}
    assert {"optimal", "infeasible", "failed", "ShapeError", "NotFiniteError", "log"} <= found


@pytest.mark.long
def test_long_a_million_hostile_calls(capsys):
    counts = hostile_calls(1_000_000)
    assert sum(counts.values()) == 1_000_000
    with capsys.disabled():
        show(counts)


def show(counts):
    print(f"\n{sum(counts.values())} calls")
    for (name, what), number in sorted(counts.items()):
        print(f"{name:12} {what:16} {number:8}")


if __name__ == "__main__":
    show(hostile_calls(int(sys.argv[1])))
