"""Bounds: tolerances in each channel's own units, and the count of bounds that are touched."""

import copy
from collections import Counter

import numpy as np
import pytest
import scipy.optimize

import ddmhe
from reference import hankel, random_system


def recorded(rng, steps=120):
    """A noise-free recording of a random system with 3 states and 2 outputs, and noisy outputs of
    another motion."""
    system = random_system(rng, 3, 2)
    x, y = system.simulate(rng.standard_normal(3) * 3, 60)
    truth, outputs = system.simulate(rng.standard_normal(3) * 2, steps)
    return x, y, truth, outputs + rng.uniform(-0.3, 0.3, outputs.shape)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("small", [1e-8, 1e-6, 1.0])
def test_a_small_channel_is_bounded_as_sharply_as_a_large_one(seed, small):
    """Two states and one output in units 1e8 times as large: bounds hold to 1e-8 deviations of
    their own."""
    rng = np.random.default_rng(seed)
    x, y, truth, outputs = recorded(rng)
    x_units, y_units = np.array([1.0, small, small]), np.array([1.0, small])
    deviation, noise = x.std(0) * x_units, y.std(0) * y_units
    lo, hi = 0.6 * truth.min(0) * x_units, 0.6 * truth.max(0) * x_units
    for x_bounds, v_bounds in (((lo, hi), None), (None, (-0.3 * y_units, 0.3 * y_units))):
        estimator = ddmhe.DdMhe(
            ddmhe.History(x * x_units, y * y_units),
            20,
            0.9,
            1.0,
            x_bounds=x_bounds,
            v_bounds=v_bounds,
            start="state",
        )
        bound = 0
        for sample in outputs * y_units:
            estimate = estimator.step(sample)
            if estimate.status != "optimal":
                continue
            bound += estimate.active > 0
            if x_bounds is not None:
                excess = np.maximum(lo - estimate.window, estimate.window - hi) / deviation
            else:
                excess = (np.abs(estimate.v) - 0.3 * y_units) / noise
            assert excess.max() < 1e-8
        assert bound > 10


@pytest.mark.parametrize("mean", [0.0, 1e3, 1e6, 1e9])
def test_touched_bounds_are_counted_whatever_the_mean(mean):
    """`active` and the estimate are those of the same problem about 0: the mean costs only the
    rounding of the data."""
    rng = np.random.default_rng(3)
    x, y, truth, outputs = recorded(rng)
    # a grid on which adding the mean is exact
    grid = 2.0**-20
    x, outputs = np.round(x / grid) * grid, np.round(outputs / grid) * grid
    lo, hi = np.round(0.6 * truth.min(0) / grid) * grid, np.round(0.6 * truth.max(0) / grid) * grid

    def run(shift):
        return ddmhe.DdMhe(
            ddmhe.History(x + shift, y),
            8,
            0.9,
            1.0,
            x_bounds=(lo + shift, hi + shift),
            space=ddmhe.Truncated(3),
        ).run(outputs)

    near, far = run(0.0), run(mean)
    assert (near.active > 0).sum() > 20
    assert (near.status == far.status).all()
    assert (near.active == far.active).mean() > 0.98
    solved = near.status == "optimal"
    assert np.abs(far.x - mean - near.x)[solved].max() < 1e-7 + 1e-14 * mean


def test_bounds_on_an_output_that_never_moved():
    """No window moves it: noise within its bounds costs nothing, noise beyond them leaves no
    window."""
    rng = np.random.default_rng(0)
    x, y, _, outputs = recorded(rng)
    y, outputs = (np.column_stack([values, np.full(len(values), 5.1)]) for values in (y, outputs))
    free = ddmhe.DdMhe(ddmhe.History(x, y), 8, 0.9, 1.0).run(outputs)
    for width in (1e-9, 0.0):
        bounds = np.array([9.0, 9.0, width])
        estimator = ddmhe.DdMhe(ddmhe.History(x, y), 8, 0.9, 1.0, v_bounds=(-bounds, bounds))
        log = estimator.run(outputs)
        assert (log.status == "optimal").all()
        assert np.abs(log.x - free.x).max() < 1e-9
        assert estimator.step(outputs[-1] + [0.0, 0.0, 1e-6]).status == "infeasible"


def least_excess(x, y, window, lo, hi, width):
    """By how many deviations all bounds on a window must be exceeded (noise-free data): a linear
    programme."""
    M, n = len(window), x.shape[1]
    stack = np.vstack([hankel(x, M + 1), hankel(y, M)])
    unit = np.concatenate([np.tile(x.std(0), M + 1), np.tile(y.std(0), M)])
    mean = stack.mean(1)
    basis = np.linalg.svd((stack - mean[:, None]) / unit[:, None])[0][:, :n]
    noise = np.full(y.shape[1], np.inf) if width is None else width
    lo = (np.concatenate([lo.ravel(), (window - noise).ravel()]) - mean) / unit
    hi = (np.concatenate([hi.ravel(), (window + noise).ravel()]) - mean) / unit
    rows, limits = np.vstack([basis, -basis]), np.concatenate([hi, -lo])
    bounded = np.isfinite(limits)
    A = np.column_stack([rows[bounded], -np.ones(bounded.sum())])
    free = [(None, None)] * n
    sharp = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    found = scipy.optimize.linprog(
        [*np.zeros(n), 1.0], A, limits[bounded], bounds=[*free, (0, None)], options=sharp
    )
    assert found.status == 0
    return found.fun


def hostile_box(rng, window, deviation):
    """Bounds on some states of a window: about it, touching, fixing; now and then one it does not
    satisfy."""
    room = np.where(
        rng.random((2, *window.shape)) < 0.5, 0.0, rng.uniform(0, 0.3, (2, *window.shape))
    )
    lo, hi = window - room[0] * deviation, window + room[1] * deviation
    free = rng.random(window.shape) < 0.7
    lo[free], hi[free] = -np.inf, np.inf
    if rng.random() < 0.3:
        at = rng.integers(window.shape[0]), rng.integers(window.shape[1])
        lo[at] = hi[at] = window[at] + 10.0 ** rng.uniform(-6, 0) * deviation[at[1]]
    return lo, hi


@pytest.mark.parametrize("seed", range(8))
def test_every_status_is_a_true_statement(seed):
    """Boxes that touch, fix and contradict, spikes, unlike units: a linear programme confirms what
    is said."""
    rng = np.random.default_rng(seed)
    said = Counter()
    for _ in range(12):
        x, y, truth, outputs = recorded(rng, 20)
        x_units, y_units = 10.0 ** rng.integers(-4, 1, 3), 10.0 ** rng.integers(-4, 1, 2)
        x, truth, y, outputs = x * x_units, truth * x_units, y * y_units, outputs * y_units
        width = None if rng.random() < 0.5 else 0.5 * y_units
        bounds = None if width is None else (-width, width)
        estimator = ddmhe.DdMhe(
            ddmhe.History(x, y), 6, 0.9, 1.0, v_bounds=bounds, space=ddmhe.Truncated(3)
        )
        estimator.run(outputs[:6])
        used = outputs.copy()  # NaN where an output was left out: it bounds nothing then
        used[:6][np.isnan(estimator.estimate.v)] = np.nan
        for k in range(6, 20):
            lo, hi = hostile_box(rng, truth[k - 5 : k + 2], x.std(0))
            if rng.random() < 0.2:
                outputs[k] = outputs[k] + 10.0 ** rng.uniform(1, 6) * y.std(0)
            estimate = copy.copy(estimator).step(outputs[k], x_bounds=(lo, hi))
            used[k] = outputs[k]
            excess = least_excess(x, y, used[k - 5 : k + 1], lo, hi, width)
            estimator.step(outputs[k])
            used[k - 5 : k + 1][np.isnan(estimator.estimate.v)] = np.nan
            said[estimate.status] += 1
            if estimate.status in ("optimal", "almost_optimal"):
                tolerance = 1e-9 if estimate.status == "optimal" else 1e-6
                off = np.maximum(lo - estimate.window, estimate.window - hi) / x.std(0)
                assert off.max() < 1.1 * tolerance
                if width is not None:
                    assert (
                        np.nanmax((np.abs(estimate.v) - width) / y.std(0), initial=-np.inf)
                        < 1.1 * tolerance
                    )
                assert excess < 1e-6
            elif estimate.status == "infeasible":
                assert excess > 1e-10
    assert said["failed"] + said["almost_optimal"] <= 2, said
    assert said["infeasible"] > 10, said
    assert said["optimal"] > 30, said
