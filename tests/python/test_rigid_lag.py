"""RigidBodyMhe of outputs that lag behind the motion: bodies and sensors are SciPy's to move."""

import copy
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ddmhe

DT, RECORDED = 0.1, 200
NOISE = dict(x_noise=1e-4, y_noise=1e-3)


def lagging_body(seed, lag, *, on=30.0, seconds=70.0):
    """Rates and outputs of a random body that is braked across one direction; the sensors, of first
    order, were switched on so long before. Lag 0: they show what is."""
    draw = np.random.default_rng(seed)

    def turned():
        return np.linalg.qr(draw.standard_normal((3, 3)))[0]

    axes, plane = turned(), turned()[:, :2]
    J = axes @ np.diag(draw.uniform([0.5, 0.9, 1.2], [0.7, 1.1, 1.4])) @ axes.T
    D = plane @ np.diag(draw.uniform(0.002, 0.01, 2)) @ plane.T
    C = draw.standard_normal((3, 2)) @ plane.T
    C *= 5 / np.linalg.norm(C)
    w = draw.standard_normal(3)
    w *= 0.25 / np.linalg.norm(w)

    def f(_, state):
        w, shown = state[:3], state[3:]
        slower = np.linalg.solve(J, D @ w + np.cross(w, J @ w))
        return np.r_[-slower, (C @ w - shown) / (lag or 1.0)]

    times = DT * np.arange(round(seconds / DT) + 1)
    found = solve_ivp(f, (-on, times[-1]), np.r_[w, C @ w], "DOP853", times, rtol=1e-11, atol=1e-13)
    x, shown = found.y[:3].T, found.y[3:].T
    return x, shown if lag else x @ C.T


def read(seed, lag, **sensors):
    """Noisy rates of a recording, noisy outputs, and the true rates after the recording."""
    x, y = lagging_body(seed, lag, **sensors)
    draw = np.random.default_rng([seed, 1])
    seen = x[: RECORDED + 1] + NOISE["x_noise"] * draw.standard_normal((RECORDED + 1, 3))
    return seen, y + NOISE["y_noise"] * draw.standard_normal(y.shape), x[RECORDED + 1 :]


def case(seed, lag, **sensors):
    """The recording, the outputs that follow it, and the true rates then."""
    seen, y, truth = read(seed, lag, **sensors)
    return ddmhe.History(seen, y[:RECORDED], dt=DT), y[RECORDED:-1], truth


def off(log, truth):
    """Root mean square of the error, deg/s."""
    return np.rad2deg(np.sqrt(np.mean(np.sum((log.x - truth) ** 2, axis=1))))


@pytest.mark.parametrize("lag", [0.05, 0.3, 1.0])
def test_without_noise_the_lag_is_that_of_the_sensors(lag):
    x, y = lagging_body(3, lag)
    history = ddmhe.History(x[: RECORDED + 1], y[:RECORDED], dt=DT)
    est = ddmhe.RigidBodyMhe(history, output_lag=True)
    log = est.run(y[RECORDED:-1])
    report = est.report()
    assert est.explained
    assert report.lag == pytest.approx(lag, rel=2e-3)
    assert f"lag behind the motion by {report.lag:.3f} s" in report.words[-1]
    assert off(log, x[RECORDED + 1 :]) < 1e-3


@pytest.mark.parametrize("refit", ["now", "sliced"])
@pytest.mark.parametrize(("seed", "on"), [(0, 30.0), (1, 30.0), (2, 0.0), (4, 0.0)])
def test_where_sensors_may_lag_errors_are_as_stated(seed, on, refit):
    """Also of sensors that were switched on with the recording."""
    history, Y, truth = case(seed, 1.0, on=on)
    est = ddmhe.RigidBodyMhe(history, **NOISE, output_lag=True, refit=refit)
    log = est.run(Y)
    assert off(log, truth) < 0.05
    assert np.mean(np.abs(log.x - truth) < 3 * log.std) > 0.95
    assert log.trusted.mean() > 0.9
    report = est.report()
    assert abs(report.lag - 1.0) < 4 * report.lag_std


def test_a_lag_is_fitted_where_no_body_explains_the_recording_without():
    history, Y, truth = case(1, 1.0)
    plain = ddmhe.RigidBodyMhe(history, **NOISE, output_lag=False)
    assert not plain.explained
    assert plain.report().lag is plain.report().lag_std is None
    est = ddmhe.RigidBodyMhe(history, **NOISE)
    assert est.explained
    assert est.report().lag == pytest.approx(1.0, abs=0.2)
    assert off(est.run(Y), truth) < min(0.05, off(plain.run(Y), truth) / 5)


def test_outputs_that_do_not_lag_are_not_taken_to():
    """Where a body explains the recording without a lag, the estimates are those without one."""
    history, Y, _ = case(0, 0.0)
    logs = []
    for output_lag in (None, False):
        est = ddmhe.RigidBodyMhe(history, **NOISE, output_lag=output_lag)
        logs.append(est.run(Y))
        assert est.report().lag is None
    assert np.array_equal(logs[0].x, logs[1].x)
    assert np.array_equal(logs[0].covariance, logs[1].covariance)


@pytest.mark.parametrize(("lag", "refit"), [(1.0, "now"), (1.0, "sliced"), (0.2, "now")])
def test_a_lag_that_only_later_outputs_show_is_fitted_then(lag, refit):
    """Of .2 s fits without it explain all data, but one with it does far better."""
    history, Y, truth = case(2, lag, seconds=120.0)
    est = ddmhe.RigidBodyMhe(history, **NOISE, refit=refit)
    assert est.explained
    assert est.report().lag is None
    log = est.run(Y)
    report = est.report()
    assert abs(report.lag - lag) < 4 * report.lag_std
    assert any("they lag behind" in words for words in est.warnings)
    last = slice(len(Y) - 200, None)
    assert np.mean(np.abs(log.x - truth)[last] < 3 * log.std[last]) > 0.95
    # copies, also of the process that was left
    others = [copy.deepcopy(est), pickle.loads(pickle.dumps(est))]
    after = est.run(Y[:50])
    for other in others:
        assert np.array_equal(other.run(Y[:50]).x, after.x)
        assert other.warnings == est.warnings
    # a new run knows nothing of it
    for one in (est, others[1]):
        one.reset()
        assert one.report().lag is None
        assert np.array_equal(one.run(Y).x, log.x)


def test_a_lag_needs_three_rates_and_few_outputs():
    seen, y, _ = read(0, 1.0)
    wide = ddmhe.History(seen, np.hstack([y, y[:, :1]])[:RECORDED], dt=DT)
    words = "output_lag: expected no true but with three rates, at most 3 outputs and no field"
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.RigidBodyMhe(wide, output_lag=True)
    assert ddmhe.RigidBodyMhe(wide).report().lag is None
