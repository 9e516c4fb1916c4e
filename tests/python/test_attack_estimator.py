"""Calls in any order, with any arguments: each estimate is a plain estimator's, each error is ours
and changes nothing, and whatever saves or copies an estimator goes on with the same bits."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import ddmhe
from attacks import (
    HUGE,
    ODD,
    WRONG,
    KalmanFilter,
    LeastSquares,
    Sequence,
    Unkind,
    bits,
    dressed,
    known_system,
    noisy_system,
)

WAYS = (
    copy.copy,
    copy.deepcopy,
    lambda est: pickle.loads(pickle.dumps(est)),
    lambda est: ddmhe.DdMhe.restore(est.snapshot()),
)
KNOWN = {seed: known_system(seed) for seed in range(4)}
NOISY = {seed: noisy_system(seed) for seed in range(4)}
PRIORS = [*(wrong for wrong in WRONG[1:] if not isinstance(wrong, np.float64)), Unkind()]
LOST = st.sampled_from([(), (0,), (1,), (0, 1)])


class Attack(RuleBasedStateMachine):
    """What both machines do; `twin` is an estimator that was saved, copied or restored on the way
    and is given the same."""

    def begin(self, est, Y, U):
        self.est, self.twin, self.Y, self.U, self.k = est, copy.copy(est), Y, U, 0

    def u(self):
        return {} if self.U is None else {"u": self.U[self.k % 200]}

    def both(self, y, **given):
        """A step of both, with the same bits."""
        e, other = (est.step(y, **self.u(), **given) for est in (self.est, self.twin))
        assert bits(e) == bits(other)
        assert np.isfinite(e.window).all()
        assert np.isfinite(e.x).all()
        assert e.status != "optimal" or np.isfinite(e.cost)
        return e

    @rule(lost=LOST, kind=st.integers(0, 9))
    def step(self, lost, kind):
        y = self.Y[self.k % 200].copy()
        y[list(lost)] = np.nan
        e = self.both(dressed(y, kind))
        assert e.status == "optimal"
        self.expect(e, y)
        self.k += 1

    @rule(channel=st.integers(0, 1), value=st.sampled_from([HUGE, -HUGE, 1e300, 1e40, -1e25]))
    def step_beyond_reach(self, channel, value):
        """As if it had not been measured, but for the status."""
        y = self.Y[self.k % 200].copy()
        y[channel] = value
        e = self.both(y)
        assert e.status == "failed"
        y[channel] = np.nan
        self.expect(e, y)
        self.k += 1

    @rule(count=st.integers(1, 40), where=st.integers(0, 8), kind=st.integers(0, 9))
    def run(self, count, where, kind):
        rows = (self.k + np.arange(count)) % 200
        Y = self.Y[rows].copy()
        Y[where % count, where % 2] = np.nan
        U = () if self.U is None else (self.U[rows],)
        log = self.est.run(dressed(Y, kind), *U)
        for y, x, status in zip(Y, log.x, log.status, strict=True):
            e = self.twin.step(y, **self.u())
            np.testing.assert_array_equal(e.x, x)
            assert e.status == status == "optimal"
            self.expect(e, y)
            self.k += 1
        assert bits(self.est.estimate) == bits(e)

    @rule(wrong=st.sampled_from([*WRONG, Unkind(), Sequence()]), also=st.booleans())
    def a_wrong_sample(self, wrong, also):
        before = self.est.snapshot()
        for call in (self.est.step, self.est.run):
            given = () if self.U is None else (self.U[0] if call == self.est.step else self.U[:1],)
            if also and self.U is not None:
                given = (wrong,)
            if wrong is None and also:
                continue
            with pytest.raises(ddmhe.DdmheError):
                call(wrong, *given)
        assert self.est.snapshot() == before

    @rule(box=st.sampled_from(["x", None, (1,), (2, 1), (np.nan, 1), ([0] * 9, [1] * 9), 7, [[]]]))
    def a_wrong_box(self, box):
        before = self.est.snapshot()
        if box is not None:
            with pytest.raises(ddmhe.DdmheError):
                self.est.step(self.Y[0], **self.u(), x_bounds=box)
        for blob in (b"", before[:-1], before + b"\0", b"\xff" + before[1:], box):
            with pytest.raises(ddmhe.DdmheError):
                ddmhe.DdMhe.restore(blob)
        assert self.est.snapshot() == before

    @rule(wrong=st.sampled_from(PRIORS), start=st.sampled_from(["", "nowhere", 3]))
    def a_wrong_reset(self, wrong, start):
        before = self.est.snapshot()
        for call in ((wrong,), (None, start), ([np.nan] * self.est.n,), ([HUGE] * self.est.n,)):
            with pytest.raises(ddmhe.DdmheError):
                self.est.reset(*call)
        assert self.est.snapshot() == before

    @rule(way=st.sampled_from(WAYS), swap=st.booleans())
    def save_and_go_on(self, way, swap):
        self.twin = way(self.est)
        if swap:
            self.est, self.twin = self.twin, self.est

    @invariant()
    def counts(self):
        if hasattr(self, "est"):
            assert self.est.t == self.twin.t
            assert self.est.next_depth <= self.est.horizon


class PlainCost(Attack):
    """(17) as printed on an exact recording, beside least squares with the true system."""

    @initialize(seed=st.sampled_from(list(KNOWN)), M=st.integers(1, 8), rho=st.floats(0.5, 0.99))
    def made(self, seed, M, rho):
        system, history, Y = KNOWN[seed]
        self.settings, self.system = (M, rho, 3.0), system
        self.prior = np.full(history.n, 0.5)
        est = ddmhe.DdMhe(
            history, *self.settings, x_prior=self.prior, space=ddmhe.Truncated(), start="state"
        )
        self.begin(est, Y, None)
        self.model = LeastSquares(system, *self.settings, self.prior)

    def expect(self, e, y):
        states = self.model.step(y, len(e.v))
        size = 1 + np.abs(states).max()
        np.testing.assert_allclose(e.window, states, rtol=0, atol=1e-6 * size)

    @rule(offset=st.one_of(st.none(), st.floats(-3, 3)))
    def reset(self, offset):
        prior = self.prior if offset is None else self.prior + offset
        for est in (self.est, self.twin):
            est.reset(None if offset is None else prior)
        self.model = LeastSquares(self.system, *self.settings, prior)

    @rule(side=st.floats(0.01, 30), center=st.floats(-1, 1), every=st.booleans())
    def step_in_a_box(self, side, center, every):
        """Inside of it; the plain estimator goes on with what was found."""
        shape = (self.est.next_depth + 1, self.est.n) if every else self.est.n
        box = (np.full(shape, center - side), np.full(shape, center + side))
        y = self.Y[self.k % 200]
        e = self.both(y, x_bounds=box)
        slack = 1e-8 * (1 + np.abs(self.Y).max()) if "optimal" in e.status else 1e-12 * side
        assert (np.abs(e.window - center) <= side + slack).all()
        self.model.step(y, len(e.v))
        if e.status == "optimal":
            self.model.states[-1] = np.array(e.x)
        else:  # what goes on is the minimiser without the box of this step
            self.made_anew()
        self.k += 1

    def made_anew(self):
        self.reset(None)


class RecordedWeights(Attack):
    """The weights of a noisy recording, beside a textbook Kalman filter."""

    @initialize(
        seed=st.sampled_from(list(NOISY)),
        M=st.integers(1, 8),
        start=st.sampled_from(["state", "state", "recording", "unknown"]),
    )
    def made(self, seed, M, start):
        case, Q = NOISY[seed]
        self.prior, self.stated = case.x[0] + 0.1, start == "state"
        self.known = self.stated
        given = {"x_prior": self.prior} if self.stated else {}
        est = ddmhe.DdMhe(
            case.history, M, weights="recorded", process_noise=Q, start=start, **given
        )
        self.begin(est, case.Y, case.U)
        self.model = KalmanFilter(case, Q)
        self.model.start(self.prior)

    def expect(self, e, y):
        if not self.known:
            return  # the filter has no start; what is saved, copied and run is held all the same
        u = np.zeros(0) if self.U is None else self.U[self.k % 200]
        x = self.model.step(y, u)
        np.testing.assert_allclose(e.x, x, rtol=0, atol=1e-7 * (1 + np.abs(x).max()))

    @rule(offset=st.one_of(st.none(), st.floats(-3, 3)))
    def reset(self, offset):
        prior = self.prior if offset is None else self.prior + offset
        for est in (self.est, self.twin):
            est.reset(None if offset is None else prior)
        # without a state it starts as it was made to
        self.known = self.stated or offset is not None
        self.model.start(prior)

    @precondition(lambda self: self.U is not None)
    @rule(value=st.sampled_from(ODD[:6]), channel=st.integers(0, 9))
    def an_unknown_input(self, value, channel):
        u, before = self.U[0].copy(), self.est.snapshot()
        u[channel % len(u)] = value
        with pytest.raises(ddmhe.DdmheError):
            self.est.step(self.Y[0], u)
        with pytest.raises(ddmhe.DdmheError):
            self.est.step(self.Y[0])
        assert self.est.snapshot() == before


def profile(examples, steps):
    """Without a clock: the machine may be busy."""
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        deadline=None,
        derandomize=True,
        database=None,
    )


TestPlainCost = PlainCost.TestCase
TestPlainCost.settings = profile(50, 20)
TestRecordedWeights = RecordedWeights.TestCase
TestRecordedWeights.settings = profile(50, 20)


@pytest.mark.long
class TestLongPlainCost(PlainCost.TestCase):
    settings = profile(400, 50)


@pytest.mark.long
class TestLongRecordedWeights(RecordedWeights.TestCase):
    settings = profile(400, 50)
