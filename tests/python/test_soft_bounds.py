"""Bounds that may be left at a price, against the penalised problem solved by Clarabel."""

import copy
from dataclasses import replace

import numpy as np
import pytest

import ddmhe
from ddmhe._core import validate
from ddmhe.config import read_config, write_config
from ddmhe.design import ioss
from driven import random_driven
from priced import Problem, Window
from reference import hankel, random_system

N, P, M, RHO, MU = 3, 2, 6, 0.9, 1.0
UNITS = {"x_units": "a", "y_units": "b"}  # one scale for all states, one for all outputs


def recorded(rng, steps=24, noise=0.0):
    """A recording of a random system, and another motion with outputs that are noisy and, now and
    then, lost."""
    system = random_system(rng, N, P)
    x, y = system.simulate(rng.standard_normal(N) * 3, 60)
    truth, outputs = system.simulate(rng.standard_normal(N) * 2, steps)
    x, y = x + noise * rng.standard_normal(x.shape), y + noise * rng.standard_normal(y.shape)
    outputs = outputs + rng.uniform(-0.3, 0.3, outputs.shape)
    outputs[rng.random(outputs.shape) < 0.08] = np.nan
    return x, y, truth, outputs


def printed(x, y, prices, ridge=0.0):
    """The problem with the cost (17) as printed."""
    unit = np.mean(x.var(0))
    return Problem(x, y, RHO, np.ones(N), np.full(P, MU), unit, prices, ridge)


def compared(estimator, problem, x, outputs, x_bounds, v_bounds):
    """Every step beside its reference, from the same past; in how many of them a bound on a state
    was left, and any bound was active."""
    past, left, active = [x[-1]], 0, 0
    for k in range(len(outputs)):
        m = min(k + 1, M)
        e = estimator.step(outputs[k])
        window = Window(outputs[k + 1 - m : k + 1], past[k + 1 - m])
        states, cost = problem.minimiser(window, x_bounds, v_bounds)
        assert e.status == "optimal"
        assert np.abs((e.window - states) / x.std(0)).max() < 1e-6
        assert e.cost == pytest.approx(cost, rel=1e-8, abs=1e-8)
        outside = np.maximum(x_bounds[0] - e.window, e.window - x_bounds[1]) / x.std(0)
        left += outside.max() > 1e-6
        assert e.active >= (outside > 1e-6).sum()
        active += e.active > 0
        past.append(e.x)
    return left, active


BOXES = {
    "half": lambda truth: (0.5 * truth.min(0), 0.5 * truth.max(0)),
    "no window": lambda truth: (truth.max(0) + 1.0, truth.max(0) + 2.0),
    "a point": lambda truth: (truth[3], truth[3]),
    "one side": lambda truth: (np.full(N, -np.inf), truth.mean(0)),
}


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("price", [1e-2, 1.0, 1e4])
@pytest.mark.parametrize("v_bounds", [None, (-0.1, 0.2), (0.0, 0.0)])
def test_an_estimate_is_the_penalised_minimiser(box, price, v_bounds):
    rng = np.random.default_rng([7, list(BOXES).index(box), int(100 * price)])
    x, y, truth, outputs = recorded(rng, 14)
    x_bounds = BOXES[box](truth)
    settings = dict(x_bounds=x_bounds, v_bounds=v_bounds, soft=price, space=ddmhe.Truncated(N))
    estimator = ddmhe.DdMhe(ddmhe.History(x, y, **UNITS), M, RHO, MU, **settings, start="state")
    problem = printed(x, y, (price, price))
    left, active = compared(estimator, problem, x, outputs, x_bounds, v_bounds)
    assert active > len(outputs) / 3
    assert left > len(outputs) / 3 or (price > 1 and box in ("half", "one side"))


@pytest.mark.parametrize("seed", range(4))
def test_a_ridge_on_a_noisy_recording(seed):
    rng = np.random.default_rng([8, seed])
    x, y, truth, outputs = recorded(rng, noise=10.0 ** -rng.uniform(1, 4))
    x_bounds, weight, price = BOXES["half"](truth), 10.0 ** -rng.uniform(0, 4), 3.0 ** (2 - seed)
    settings = dict(x_bounds=x_bounds, v_bounds=(-0.1, 0.1), space=ddmhe.Ridge(weight), soft=price)
    estimator = ddmhe.DdMhe(ddmhe.History(x, y, **UNITS), M, RHO, MU, **settings, start="state")
    problem = printed(x, y, (price, price), weight)
    _, active = compared(estimator, problem, x, outputs, x_bounds, (-0.1, 0.1))
    assert active > len(outputs) / 3


@pytest.mark.parametrize("name", ["x", "v"])
def test_a_bound_that_is_not_named_stays_hard(name):
    rng = np.random.default_rng(9)
    x, y, truth, outputs = recorded(rng)
    wide, tight = (truth.min(0) - 9.0, truth.max(0) + 9.0), BOXES["half"](truth)
    boxes = {"x": (tight, (-9.0, 9.0)), "v": (wide, (-0.1, 0.1))}[name]
    settings = dict(soft={name: 0.5}, space=ddmhe.Truncated(N))
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y, **UNITS),
        M,
        RHO,
        MU,
        x_bounds=boxes[0],
        v_bounds=boxes[1],
        **settings,
        start="state",
    )
    prices = (0.5, None) if name == "x" else (None, 0.5)
    left, active = compared(estimator, printed(x, y, prices), x, outputs, *boxes)
    assert active > 8
    assert left > 8 if name == "x" else left == 0
    other = {"x": ((-99.0, -98.0), (-9.0, 9.0)), "v": ((98.0, 99.0), (-0.1, 0.1))}[name]
    hard = {"x": "v", "v": "x"}[name]
    failing = ddmhe.DdMhe(
        ddmhe.History(x, y),
        M,
        x_bounds=other[0],
        v_bounds=(50.0, 51.0) if hard == "v" else other[1],
        space=ddmhe.Truncated(N),
        soft={name: 0.5},
        start="state",
    )
    log = failing.run(outputs)
    assert (log.status == "infeasible").any()
    inside = (log.x >= other[0][0]) & (log.x <= other[0][1])
    # what is handed out is moved into a hard box, and into no other
    assert inside[log.status == "infeasible"].all() == (hard == "x")
    if hard == "x":  # no output is at fault
        np.testing.assert_array_equal(np.isnan(failing.estimate.v), np.isnan(outputs[-M:]))


def test_scaled_weights_and_units():
    """A price is one of deviations: in other units of x and y nothing changes."""
    rng = np.random.default_rng(10)
    x, y, truth, outputs = recorded(rng)
    lo, hi = BOXES["half"](truth)
    pooled = np.sqrt(np.mean(x.var(0))), np.sqrt(np.mean(y.var(0)))
    weights = np.full(N, pooled[0] ** -2), np.full(P, MU / pooled[1] ** 2)
    problem = Problem(x, y, RHO, *weights, 1.0, (0.3, 0.3))

    def made(s_x, s_y):
        return ddmhe.DdMhe(
            ddmhe.History(x * s_x, y * s_y, **UNITS),
            M,
            RHO,
            MU,
            weights="scaled",
            x_bounds=(lo * s_x, hi * s_x),
            v_bounds=(-0.1 * s_y, 0.1 * s_y),
            soft=0.3,
            space=ddmhe.Truncated(N),
            start="state",
        )

    left, _ = compared(made(1.0, 1.0), problem, x, outputs, (lo, hi), (-0.1, 0.1))
    assert left > 8
    near, far = made(1.0, 1.0).run(outputs), made(1e6, 1e-3).run(outputs * 1e-3)
    np.testing.assert_allclose(far.x / 1e6, near.x, atol=1e-9 * np.abs(near.x).max())
    np.testing.assert_allclose(far.cost, near.cost, rtol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_at_a_large_price_it_is_the_estimate_of_hard_bounds(seed):
    """Bit for bit where these can be met: the price is exact."""
    rng = np.random.default_rng([11, seed])
    x, y, truth, outputs = recorded(rng, 60)
    bounds = dict(x_bounds=(0.8 * truth.min(0), 0.8 * truth.max(0)), space=ddmhe.Truncated(N))
    hard, soft, cheap = (
        ddmhe.DdMhe(ddmhe.History(x, y), M, RHO, MU, **bounds, soft=price, start="state").run(
            outputs
        )
        for price in (None, 1e6, 1e-3)
    )
    assert (hard.status == "optimal").all()
    assert (hard.active > 0).sum() > 10
    for name in ("x", "cost", "status", "active"):
        np.testing.assert_array_equal(getattr(soft, name), getattr(hard, name))
    assert np.abs(cheap.x - hard.x).max() > 1e-3


def test_bounds_about_the_centre_and_of_a_step():
    """Each row of the window has its own bounds; those of a step are soft as well."""
    rng = np.random.default_rng(12)
    x, y, truth, outputs = recorded(rng, 12)
    outputs = np.nan_to_num(outputs, nan=0.1)
    history, problem = ddmhe.History(x, y, **UNITS), printed(x, y, (0.5, None))
    settings = dict(space=ddmhe.Truncated(N), soft=0.5)
    free, width = np.full(N, np.inf), 0.02 * x.std(0)
    centred = ddmhe.DdMhe(
        history, M, RHO, MU, x_bounds=(-width, width), x_center="history", **settings, start="state"
    )
    stepped = ddmhe.DdMhe(history, M, RHO, MU, x_bounds=(-free, free), **settings, start="state")
    pasts = [x[-1]], [x[-1]]
    for k in range(len(outputs)):
        m = min(k + 1, M)
        y_m = outputs[k + 1 - m : k + 1]
        # x_c(t): the window of states that belongs to the outputs nearest to these
        H_x, H_y = hankel(x, m + 1), hankel(y, m)
        c_x, c_y = H_x.mean(1), H_y.mean(1)
        alpha = np.linalg.lstsq(H_y - c_y[:, None], y_m.ravel() - c_y, rcond=1e-10)[0]
        x_c = (c_x + (H_x - c_x[:, None]) @ alpha).reshape(m + 1, N)
        own = truth[k + 1 - m : k + 2] + rng.uniform(-0.5, 0.5, (2, m + 1, N))
        own = own.min(0), own.max(0)
        cases = (
            (centred.step(outputs[k]), (x_c - width, x_c + width), pasts[0]),
            (stepped.step(outputs[k], x_bounds=own), own, pasts[1]),
        )
        for e, bounds, past in cases:
            states, cost = problem.minimiser(Window(y_m, past[k + 1 - m]), bounds)
            assert e.status == "optimal"
            assert e.active > 0
            assert np.abs((e.window - states) / x.std(0)).max() < 1e-6
            assert e.cost == pytest.approx(cost, rel=1e-7, abs=1e-8)
            past.append(e.x)


def test_known_inputs_move_what_the_bounds_are_on():
    """The box on the states is one on the free motion about the forced one."""
    rng = np.random.default_rng(13)
    system = random_driven(rng, N, P, 1)
    u = rng.standard_normal((160, 1))
    x, y = system.simulate(rng.standard_normal(N), u)
    x, y, outputs = x[:121], y[:120], y[120:] + rng.uniform(-0.2, 0.2, (40, P))
    mean = u[:120].mean(0)
    at_rest = replace(system, e=0 * system.e, r=0 * system.r)
    free = replace(system, e=system.e + system.B @ mean, r=system.r + system.D @ mean)
    free = replace(free, B=0 * system.B, D=0 * system.D)
    box = 0.5 * x.min(0), 0.5 * x.max(0)
    history = ddmhe.History(x, y, 1.0, u[:120], **UNITS)
    settings = dict(x_bounds=box, soft=0.4, space=ddmhe.Truncated(N))
    estimator = ddmhe.DdMhe(history, M, RHO, MU, **settings, start="state")
    problem = replace(
        printed(x, y, (0.4, None)),
        deviations=(x.std(0), y.std(0)),
        **dict(zip("xy", free.simulate(rng.standard_normal(N), np.zeros((90, 1))), strict=True)),
    )
    past, active = [x[-1]], 0
    for k in range(len(outputs)):
        m = min(k + 1, M)
        first = 120 + k + 1 - m
        x_f, y_f = at_rest.simulate(np.zeros(N), u[first : first + m] - mean)
        e = estimator.step(outputs[k], u[120 + k])
        window = Window(outputs[k + 1 - m : k + 1] - y_f, past[k + 1 - m])
        states, _ = problem.minimiser(window, (box[0] - x_f, box[1] - x_f))
        assert e.status == "optimal"
        assert np.abs((e.window - x_f - states) / x.std(0)).max() < 1e-6
        active += e.active > 0
        past.append(e.x)
    assert active > 10


def test_no_output_is_left_out_for_a_bound_that_may_be_left():
    """An outlier beside hard bounds on the noise counts as lost; beside soft ones it is a noise."""
    rng = np.random.default_rng(14)
    x, y, _, outputs = recorded(rng)
    outputs = np.nan_to_num(outputs, nan=0.0)
    outputs[15] += 500.0
    settings = dict(v_bounds=(-5.0, 5.0), space=ddmhe.Truncated(N))
    hard = ddmhe.DdMhe(ddmhe.History(x, y, **UNITS), M, RHO, MU, **settings, start="state")
    soft = ddmhe.DdMhe(
        ddmhe.History(x, y, **UNITS), M, RHO, MU, soft=1.0, **settings, start="state"
    )
    hard.run(outputs[:15]), soft.run(outputs[:15])
    refused, kept = hard.step(outputs[15]), soft.step(outputs[15])
    assert refused.status == "infeasible"
    assert np.isnan(refused.v[-1]).all()
    assert kept.status == "optimal"
    assert np.isfinite(kept.v).all()
    assert np.abs(kept.v[-1]).max() > 5


def test_copies_snapshots_and_many_go_on_alike():
    rng = np.random.default_rng(15)
    x, y, truth, outputs = recorded(rng, 40)
    for start in ("state", "recording", "unknown"):
        for price in (1.0, {"x": 2.0}, {"x": 1e3, "v": 0.1}):
            settings = dict(x_bounds=BOXES["half"](truth), v_bounds=(-99.0, 0.5), start=start)
            estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, **settings, soft=price)
            whole = copy.copy(estimator).run(outputs)
            assert (whole.active > 0).sum() > 10
            (many,) = ddmhe.run_many([copy.copy(estimator)], [outputs])
            np.testing.assert_array_equal(many.x, whole.x)
            estimator.run(outputs[:17])
            for other in (copy.deepcopy(estimator), ddmhe.DdMhe.restore(estimator.snapshot())):
                rest = other.run(outputs[17:])
                np.testing.assert_array_equal(rest.x, whole.x[17:])
                np.testing.assert_array_equal(rest.cost, whole.cost[17:])
            estimator.reset()
            np.testing.assert_array_equal(estimator.run(outputs).x, whole.x)


@pytest.mark.parametrize("seed", range(6))
def test_an_error_bound_holds_beside_a_box_that_is_wrong(seed):
    """The bound follows the window that is handed out, whatever cost it is the minimiser of."""
    rng = np.random.default_rng([16, seed])
    system = random_system(rng, N, P)
    x, y = system.simulate(rng.standard_normal(N), 80)
    truth, outputs = system.simulate(x[-1] + 0.1, 60)
    outputs = outputs + rng.uniform(-0.01, 0.01, outputs.shape)
    certificate = ioss(A=system.A, C=system.C, eta=0.9)
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y),
        space=ddmhe.Exact(),
        certificate=certificate,
        disturbance=(0.1 * np.sqrt(N), 0.0, 0.01 * np.sqrt(P)),
        x_bounds=(0.3 * truth.min(0), 0.3 * truth.max(0)),
        soft=0.1,
        start="state",
    )
    log = estimator.run(outputs)
    assert (log.status == "optimal").all()
    assert (log.active > 0).any()
    assert np.isfinite(log.bound).all()
    assert (np.linalg.norm(log.x - truth[1:], axis=1) <= log.bound).all()


@pytest.mark.parametrize("seed", range(20))
def test_hostile_data_leave_a_soft_window_feasible(seed):
    """Spikes, lost outputs, fixed states, prices of every size: finite, and never infeasible. What
    is less than optimal is so because spikes take the digits."""
    rng = np.random.default_rng([17, seed])
    x, y, truth, outputs = recorded(rng, 60, 10.0 ** -rng.uniform(1, 8))
    spikes = rng.random(outputs.shape) < 0.05
    outputs[spikes] = 10.0 ** rng.uniform(1, 6, spikes.sum()) * rng.choice([-1, 1], spikes.sum())
    box = BOXES[list(BOXES)[seed % 4]](truth)
    space = ("auto", ddmhe.Truncated(N), ddmhe.Ridge(1e-3), ddmhe.Exact())[rng.integers(4)]
    price = {"x": 10.0 ** rng.uniform(-6, 6), "v": 10.0 ** rng.uniform(-6, 6)}
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y),
        M,
        x_bounds=box,
        v_bounds=(-0.1, 0.1),
        soft=price,
        space=space,
        start="state",
    )
    log = estimator.run(outputs)
    assert np.isfinite(log.x).all()
    assert np.isfinite(log.cost).all()
    assert set(log.status) <= {"optimal", "almost_optimal"}
    assert (log.status == "optimal").sum() > 30


@pytest.mark.parametrize(
    ("soft", "message"),
    [
        (0.0, "soft: expected a positive finite price, .*, found 0"),
        (-1.0, "soft: expected a positive finite price, .*, found -1"),
        (np.nan, "soft: expected a positive finite price, .*, found NaN"),
        (np.inf, "soft: expected a positive finite price, .*, found inf"),
        ({"x": 0.0}, "soft: expected a positive finite price, .*, found 0"),
        ("high", "soft: expected a real number, found 'high'"),
        (True, "soft: expected a real number, found True"),
        ([1.0, 2.0], "soft: expected a real number"),
        ({"v": 1.0}, "soft: expected bounds beside it that it is the price of leaving"),
        ({}, "soft: expected bounds beside it that it is the price of leaving"),
        ({"y": 1.0}, 'soft: expected prices by "x", "v" or "w", found "y"'),
        ({"x": None}, "soft: expected a real number, found None"),
        ({1: 1.0}, "soft: expected a text, found 1"),
    ],
)
def test_a_price_that_is_none_is_one_error(soft, message):
    history = ddmhe.History(*recorded(np.random.default_rng(0))[:2])
    with pytest.raises(ddmhe.DdmheError, match=message):
        ddmhe.DdMhe(history, M, x_bounds=(-1.0, 1.0), soft=soft, start="state")
    with pytest.raises(ddmhe.DdmheError, match="soft: expected bounds beside it"):
        ddmhe.DdMhe(history, M, soft=1.0, start="state")
    with pytest.raises(ddmhe.DdmheError, match="x_bounds: expected lo <= hi"):
        ddmhe.DdMhe(history, M, x_bounds=(1.0, -1.0), soft=1.0, start="state")


def test_a_file_and_validation_know_prices(tmp_path):
    rng = np.random.default_rng(18)
    x, y, truth, outputs = recorded(rng)
    history, path = ddmhe.History(x, y), tmp_path / "est.toml"
    for price in (2.5, {"x": 1.0, "v": 30.0}, {"x": 4.0}):
        settings = {"horizon": M, "x_bounds": [-0.5, 0.5], "v_bounds": [-0.1, 0.1], "soft": price}
        write_config(path, settings)
        assert read_config(path) == settings
        log = ddmhe.DdMhe(history, **read_config(path), x_prior=x[-1]).run(outputs)
        fold = (history, x[-1], outputs, None, truth[1:], [len(outputs)], np.ones(N))
        ((errors, _),) = validate([fold], [(0, settings)])
        assert errors[0] == pytest.approx(np.mean((log.x - truth[1:]) ** 2), rel=1e-12)
    path.write_text("horizon = 4\nx_bounds = [-1, 1]\nsoft = { z = 1.0 }")
    with pytest.raises(
        ddmhe.DdmheError, match=r"est.toml, soft: expected prices by \"x\", \"v\" or \"w\""
    ):
        read_config(path)
