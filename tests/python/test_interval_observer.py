"""Bounds of the interval observer: soundness, widths, a second implementation, and a check that can
fail."""

import numpy as np
import pytest

import ddmhe
from ddmhe import interval
from pendulum_case import (
    KINDS,
    METHODS,
    RADIUS,
    START,
    NumpyObserver,
    V,
    W,
    adversaries,
    outside,
    trajectory,
)


@pytest.mark.parametrize(("method", "reduction"), METHODS)
def test_no_trajectory_leaves_its_bounds(method, reduction):
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5, lmi="paper")
    o = interval.IntervalObserver(s, g, START, RADIUS, W, V, method=method, reduction=reduction)
    rng = np.random.default_rng(7)
    for k in range(400):
        x, y = trajectory(rng, 100, KINDS[k % 4])
        o.reset()
        log = o.run(y)
        assert not outside(x[1:], log.lower, log.upper), k
        assert not outside(x[:-1], *log.filtered), k
        assert not outside(x[1:], *log.ball), k
        assert not outside(x[1:], *log.ellipsoid), k


@pytest.mark.parametrize("method", ["paper", "tight"])
def test_widths_on_the_pendulum(method):
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5, lmi="paper")
    o = interval.IntervalObserver(s, g, START, RADIUS, W, V, method=method)
    rng = np.random.default_rng(0)
    predicted, filtered = [], []
    for k in range(200):
        log = (o.reset(), o.run(trajectory(rng, 100, KINDS[k % 4])[1]))[1]
        predicted.append((log.upper - log.lower)[50:].mean(axis=0))
        filtered.append((log.filtered[1] - log.filtered[0])[50:].mean(axis=0))
    if method == "paper":
        np.testing.assert_allclose(np.mean(predicted, axis=0), [0.0307, 0.2703], rtol=1e-2)
    else:
        assert (np.mean(predicted, axis=0) <= [0.022, 0.135]).all()
        assert (np.mean(filtered, axis=0) <= [0.0020, 0.124]).all()


def test_with_the_printed_start_the_peak_to_peak_bound_is_left():
    """φ0 = 1.15 belongs to a V0 that the stated box exceeds: the worst vertex starts outside of
    it."""
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5, lmi="paper")
    power = 2 * W**2 + V**2
    e = np.array([0.1, -1.0])
    V0 = e @ g.P @ e
    assert pytest.approx(0.4796, rel=1e-3) == V0
    sound = np.sqrt(g.mu * (g.lam * V0 + g.mu_w * power))
    assert sound == pytest.approx(2.7641, rel=1e-2)
    x = [START + e]
    for _ in range(3):
        x.append(s.A @ x[-1] + s.f(x[-1]))
    o = interval.IntervalObserver(s, g, START, RADIUS, W, V, method="paper")
    log = o.run(np.array(x)[:-1, :1])
    error = np.linalg.norm(np.array(x)[1:] - log.center, axis=1)
    printed = np.sqrt(
        np.maximum(g.mu * (g.lam * (1 - g.lam) ** np.arange(1, 4) * V0 * (1.15 / sound) ** 2), 0)
    )
    assert not outside(np.array(x)[1:], *log.ball)
    assert np.linalg.norm(e) < sound
    assert printed[0] < error[0]


STIFF = interval.pendulum(ddmhe.models.pendulum(stiffness=12.0))


@pytest.mark.parametrize("system", [interval.pendulum(), STIFF], ids=["paper", "stiff"])
def test_adversarial_disturbances_stay_inside_every_method(system):
    design = interval.design_observer(system, 0.2)
    for method, reduction in METHODS:
        o = interval.IntervalObserver(
            system, design, START, RADIUS, W, V, order=40, method=method, reduction=reduction
        )
        for x, y in adversaries(system, design.gain):
            o.reset()
            log = o.run(y)
            assert not outside(x[1:], log.lower, log.upper)
            assert not outside(x[:-1], *log.filtered)


@pytest.mark.parametrize("broken", ["start", "propagated", "process", "noise", "no D^s", "no T"])
def test_the_adversary_catches_a_broken_observer(broken):
    """The containment check above can fail: 1 % off any generator, D^s or T left out."""
    L = interval.design_observer(STIFF, 0.2).gain
    whole, part = NumpyObserver(STIFF, L, 40), NumpyObserver(STIFF, L, 40, broken)
    runs = list(adversaries(STIFF, L))
    # NumPy does not round outward, and an adversary meets the linear first row's bound to the last
    # bit
    kept = [(x, *whole.run(y)) for x, y in runs]
    assert not any(outside(x[1:], lower - 1e-12, upper + 1e-12) for x, lower, upper in kept)
    assert any(outside(x[1:], *part.run(y)) for x, y in runs)


def test_paper_method_agrees_with_numpy():
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5, lmi="paper")
    reference, both = NumpyObserver(s, g.gain, 20), NumpyObserver(s, g.gain, 20, design=g)
    rng = np.random.default_rng(3)
    for k in range(20):
        _, y = trajectory(rng, 60, KINDS[k % 4])
        lower, upper = reference.run(y)
        o = interval.IntervalObserver(s, g, START, RADIUS, W, V, method="paper")
        log = o.run(y)
        np.testing.assert_allclose([log.lower, log.upper], both.run(y), rtol=0, atol=1e-9)
        o.reset()
        for k, sample in enumerate(y):
            lo, hi = o.step(sample).zonotope.interval_hull()
            np.testing.assert_allclose(lo, lower[k], rtol=0, atol=1e-11)
            np.testing.assert_allclose(hi, upper[k], rtol=0, atol=1e-11)


def test_python_functions_and_built_in_dynamics_agree():
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5)
    own = interval.System(s.A, s.C, s.D1, s.D2, s.f, s.jacobian, s.j_lo, s.j_hi)
    _, y = trajectory(np.random.default_rng(0), 40, "extreme")
    a, b = (interval.IntervalObserver(q, g, START, RADIUS, W, V).run(y) for q in (s, own))
    np.testing.assert_allclose(b.lower, a.lower, atol=1e-11)
    np.testing.assert_allclose(b.upper, a.upper, atol=1e-11)


def test_steps_and_run_are_the_same_and_lost_samples_widen():
    s = interval.pendulum()
    g = interval.design_observer(s, 0.5)
    x, y = trajectory(np.random.default_rng(1), 40, "uniform")
    y[20:24] = np.nan
    o = interval.IntervalObserver(s, g, START, RADIUS, W, V)
    np.testing.assert_allclose(o.bounds, [START - RADIUS, START + RADIUS], rtol=1e-15)
    log = o.run(y)
    o.reset()
    for k, sample in enumerate(y):
        b = o.step(sample)
        np.testing.assert_array_equal([b.lower, b.upper], [log.lower[k], log.upper[k]])
        np.testing.assert_array_equal(b.center, log.center[k])
    assert not outside(x[1:], log.lower, log.upper)
    width = log.upper - log.lower
    assert (width[23] > width[19]).all()
