"""Outputs, bounds and settings that no sane log has: nothing panics, what is optimal is finite, and
it recovers."""

import numpy as np
import pytest

import ddmhe
from reference import random_system

HUGE = np.finfo(float).max


def case(seed, n=3, p=2, noise=0.05):
    """A noisy recording and what follows it, with a box that holds all of it."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, p)
    x, y = system.simulate(rng.standard_normal(n) * 2, 120)
    x = x + 0.1 * noise * rng.standard_normal(x.shape)
    y = y + noise * np.clip(rng.standard_normal(y.shape), -2.5, 2.5)
    truth, clean = system.simulate(x[-1], 90)
    outputs = clean + noise * np.clip(rng.standard_normal(clean.shape), -2.5, 2.5)
    return ddmhe.History(x, y), outputs, 1.3 * np.abs(np.vstack([truth, x])).max(), y.std()


def steps(h, outputs, **settings):
    """All estimates of a log."""
    est = ddmhe.DdMhe(h, horizon=12, **settings)
    return [est.step(sample) for sample in outputs]


@pytest.mark.parametrize("space", ["auto", ddmhe.Truncated()])
@pytest.mark.parametrize("size", [1e2, 1e4, 1e6])
def test_a_spike_leaves_the_answer_inside_its_box(space, size):
    """The box does not depend on the outputs: what satisfies it satisfies it after a spike."""
    for seed in range(3):
        h, outputs, limit, deviation = case(seed)
        outputs[30] += size * deviation
        found = steps(h, outputs, space=space, x_bounds=(-limit, limit))
        assert {e.status for e in found} == {"optimal"}
        for e in found:
            assert np.abs(e.window).max() <= limit * (1 + 1e-8)


@pytest.mark.parametrize("space", [ddmhe.Ridge(1e-6), ddmhe.Truncated()])
@pytest.mark.parametrize("size", [1e9, 1e12, 1e15])
def test_what_is_optimal_beside_a_huge_spike_is_inside_its_box(space, size):
    """Where rounding takes the digits that a bound is to hold to, the answer is moved inside and
    not called optimal."""
    for seed in range(6):
        h, outputs, limit, deviation = case(seed)
        outputs[30] += size * deviation
        for e in steps(h, outputs, space=space, x_bounds=(-limit, limit)):
            beyond = (np.abs(e.window).max() - limit) / deviation
            assert beyond <= (2e-9 if e.status == "optimal" else 0), (seed, e.status, beyond)


@pytest.mark.parametrize("size", [30, 1e3, 1e6, 1e12])
def test_a_spike_is_no_worse_with_bounded_noise(size):
    """No window of the system explains it: it is left out, said once, and nothing of it stays."""
    off = np.zeros(2, int)
    for seed in range(4):
        h, outputs, limit, deviation = case(seed)
        spiked = outputs.copy()
        spiked[30] += size * deviation
        for k, v_bounds in enumerate([None, (-0.25, 0.25)]):
            settings = dict(space=ddmhe.Truncated(), x_bounds=(-limit, limit), v_bounds=v_bounds)
            clean, found = steps(h, outputs, **settings), steps(h, spiked, **settings)
            assert {e.status for e in clean} == {"optimal"}
            off[k] += sum(
                np.abs(a.x - b.x).max() > 0.2 * limit for a, b in zip(clean, found, strict=True)
            )
            if v_bounds:
                assert [k for k, e in enumerate(found) if e.status != "optimal"] == [30]
                assert np.isnan(found[30].v[-1]).all()
                assert np.isfinite(found[29].v).all()
    assert off[1] == 0
    assert off[0] > 0


def test_a_spike_at_the_start_does_not_lock_the_others_out():
    """The first output contradicts nothing; the three after it are doubted in its place, then it is
    given up."""
    h, outputs, limit, deviation = case(0)
    spiked = outputs.copy()
    spiked[0] += 50 * deviation
    settings = dict(space=ddmhe.Truncated(), v_bounds=(-0.25, 0.25), start="state")
    clean, found = steps(h, outputs, **settings), steps(h, spiked, **settings)
    assert [k for k, e in enumerate(found) if e.status != "optimal"] == [1, 2, 3, 4]
    assert all(
        np.abs(a.x - b.x).max() < 0.05 * limit for a, b in zip(clean[8:], found[8:], strict=True)
    )


def test_an_infeasible_box_of_one_step_is_kept_and_not_remembered():
    """What is handed out is inside of it; the estimates that follow are those without it."""
    h, outputs, _, _ = case(1)
    est, free = (ddmhe.DdMhe(h, 8, 0.9, 1.0, space=ddmhe.Truncated()) for _ in range(2))
    est.run(outputs[:10])
    free.run(outputs[:10])
    lo, hi = np.full((9, 3), -np.inf), np.full((9, 3), np.inf)
    lo[0], hi[0], lo[-1] = -1, 1, 5000
    e = est.step(outputs[10], x_bounds=(lo, hi))
    assert e.status == "infeasible"
    assert (e.window >= lo).all()
    assert (e.window <= hi).all()
    free.step(outputs[10])
    np.testing.assert_array_equal(est.run(outputs[11:]).x, free.run(outputs[11:]).x)


@pytest.mark.parametrize("value", [HUGE, -HUGE, 1e300, 1e154, 1e20])
@pytest.mark.parametrize("bounded", [False, True])
def test_an_output_that_cannot_be_computed_with_counts_as_lost(value, bounded):
    """Status "failed" for its step, and the same numbers as if it had not been measured."""
    h, outputs, limit, _ = case(2)
    settings = dict(x_bounds=(-limit, limit), v_bounds=(-1, 1)) if bounded else {}
    hostile, lost = outputs.copy(), outputs.copy()
    hostile[20, 1], lost[20, 1] = value, np.nan
    found, expected = steps(h, hostile, **settings), steps(h, lost, **settings)
    assert [k for k, e in enumerate(found) if e.status != "optimal"] == [20]
    assert found[20].status == "failed"
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a.window, b.window, rtol=0, atol=1e-12 * limit)
        assert np.isfinite(a.window).all()
        assert np.isfinite(a.cost)


@pytest.mark.parametrize(
    "setting",
    [
        {"mu": 1e-150},
        {"mu": 1e308},
        {"space": ddmhe.Ridge(1e-40)},
        {"x_prior": [1e300, 0, 0]},
        {"x_bounds": (1e200, np.inf)},
    ],
)
def test_settings_that_cannot_be_computed_with_are_refused(setting):
    h, outputs, _, _ = case(3)
    (name,) = setting
    with pytest.raises(ddmhe.DdmheError, match=rf"^{name}: expected"):
        ddmhe.DdMhe(h, **setting)
    est = ddmhe.DdMhe(h)
    if name == "x_prior":
        est.run(outputs[:5])
        with pytest.raises(ddmhe.DdmheError, match=r"^x_prior: expected"):
            est.reset(setting["x_prior"])
        assert est.t == 5


@pytest.mark.parametrize("scale", [1e154, 1e-154])
def test_recordings_that_cannot_be_computed_with_are_refused(scale):
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((41, 2)), rng.standard_normal((40, 1))
    with pytest.raises(ddmhe.DdmheError, match=r"^history: expected x"):
        ddmhe.DdMhe(ddmhe.History(scale * x, y))
    with pytest.raises(ddmhe.DdmheError, match=r"^history: expected y1"):
        ddmhe.DdMhe(ddmhe.History(x, scale * y))
    ddmhe.DdMhe(ddmhe.History(1e50 * x, 1e-50 * y)).run(1e-50 * y)


def hostile(rng, shape, scale):
    """Numbers of every size that a double has."""
    values = scale * rng.standard_normal(shape)
    for where, other in [
        (0.05, np.nan),
        (0.03, HUGE),
        (0.03, -HUGE),
        (0.03, 5e-324),
        (0.05, 0.0),
        (0.05, 1e15 * scale),
        (0.05, -1e8 * scale),
    ]:
        values[rng.random(shape) < where] = other
    odd = rng.random(shape) < 0.05
    values[odd] = 10.0 ** rng.uniform(-300, 300, odd.sum())
    return values


def hostile_settings(rng, scale):
    """Settings of every kind; `scale` is that of the states."""
    sides = sorted(10.0 ** rng.uniform(-2, 2) * scale for _ in range(2))
    return {
        "horizon": int(rng.integers(1, 12)),
        "x_bounds": [None, (-sides[1], sides[1]), (sides[0], sides[1]), (-HUGE, HUGE)][
            rng.integers(4)
        ],
        "v_bounds": [None, (-0.1, 0.1), (-HUGE, 1e-300)][rng.integers(3)],
        "x_center": [None, None, "history"][rng.integers(3)],
        "mu": [None, None, 10.0 ** rng.uniform(-200, 200)][rng.integers(3)],
        "rho": [None, None, 1e-200, 1 - 1e-16][rng.integers(4)],
        "space": ["auto", ddmhe.Exact(), ddmhe.Truncated(), ddmhe.Ridge(1e-3 * scale**2)][
            rng.integers(4)
        ],
        "warm_start": bool(rng.integers(2)),
    }


def test_no_data_make_it_panic_or_lie():
    """Whatever comes: an error that is ours, or numbers; and after M sane samples it is optimal
    again."""
    rng = np.random.default_rng(0)
    refused = ran = failed = optimal = rejected = recovered = 0
    for k in range(250):
        n, p, scale = (
            rng.integers(1, 4),
            rng.integers(1, 3),
            10.0 ** rng.choice([0, 0, -40, 40, 80]),
        )
        system = random_system(rng, int(n), int(p))
        x, y = system.simulate(rng.standard_normal(n), 60)
        x, y = scale * x, y + 0.01 * rng.standard_normal(y.shape)
        settings = hostile_settings(rng, scale)
        try:
            est = ddmhe.DdMhe(ddmhe.History(x, y), **settings)
        except ddmhe.DdmheError:
            refused += 1
            continue
        ran += 1
        for sample in hostile(rng, (40, p), 1.0):
            box = (-abs(hostile(rng, n, scale)), np.inf) if rng.random() < 0.1 else None
            try:
                e = est.step(sample, x_bounds=box)
            except ddmhe.DdmheError:
                rejected += 1
                continue
            failed += e.status == "failed"
            assert np.isfinite(e.window).all(), (k, e.status)
            assert np.isfinite(e.x).all()
            if e.status == "optimal":
                optimal += 1
                assert np.isfinite(e.cost)
                assert not np.isinf(e.v).any()
        again = ddmhe.DdMhe.restore(est.snapshot())
        np.testing.assert_array_equal(again.run(y[:20]).x, est.run(y[:20]).x)
        if (
            settings["x_bounds"] is None
            and settings["v_bounds"] is None
            and est.spectral_radius < 1
        ):
            assert est.estimate.status == "optimal", k
            recovered += 1
    assert ran > 100
    assert refused > 5
    assert failed > 100
    assert optimal > 1000
    assert rejected > 20
    assert recovered > 5
