"""RigidBodyMhe ten minutes beyond its recording: how far it is off, and whether it knows that."""

import numpy as np
import pytest

import ddmhe

DEG = 180 / np.pi
DT, RECORDED, ONLINE = 0.1, 200, 6000

SLOW = dict(
    inertia=[[4280.6, 287.7, -160.8], [287.7, 4992.7, -635.2], [-160.8, -635.2, 4737.7]],
    M_eff=[
        [259340.0, -18950.0, 20260.0],
        [-18950.0, 278300.0, -280.0],
        [20260.0, -280.0, 347390.0],
    ],
    B=[-0.00683, 0.00492, 0.00465],
    r=[0.024, 0.028, 0.609],
    Lambda=[[9e-05, -0.00549, -0.0071], [-0.00549, -0.00242, 0.00663], [-0.0071, 0.00663, 0.00233]],
    omega_0=[0.09293, -0.03863, 0.04161],
)
"""Nearly spherical, 6 deg/s: its possible motions lie along a valley."""
FAST = dict(
    inertia=[[2408.6, -29.1, -165.2], [-29.1, 2394.3, 77.8], [-165.2, 77.8, 3045.2]],
    M_eff=[
        [232030.0, -4190.0, -132710.0],
        [-4190.0, 205190.0, -90270.0],
        [-132710.0, -90270.0, 443950.0],
    ],
    B=[0.00409, -0.0029, 0.00354],
    r=[0.098, -0.234, 0.835],
    Lambda=[[0.01418, 0.00125, -0.00784], [0.00125, 0.0113, 0.0032], [-0.00784, 0.0032, -0.02548]],
    omega_0=[-0.30907, -0.10256, 0.02151],
)
"""Two of its moments of inertia are almost the same."""


def run(body, rate_noise, torque_noise, later_noise, seed, **settings):
    """The log, and the true rates beside it."""
    settings = dict(x_noise=rate_noise, y_noise=torque_noise, output_noise=later_noise) | settings
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in body.items()})
    record = model.simulate((RECORDED + ONLINE) * DT, DT, integrator="accurate")
    draw = np.random.default_rng(seed)
    x = record.x[: RECORDED + 1] + rate_noise * draw.standard_normal((RECORDED + 1, 3))
    y = record.y + torque_noise * draw.standard_normal(record.y.shape)
    later = record.y[RECORDED:-1] + later_noise * draw.standard_normal((ONLINE, 3))
    history = ddmhe.History(x, y[:RECORDED], dt=DT)
    log = ddmhe.RigidBodyMhe(history, **settings).run(later)
    return log, record.x[RECORDED + 1 :]


@pytest.mark.parametrize("seed", range(4))
def test_bars_hold_for_ten_minutes(seed):
    """Between fits the filter is linear about the last one: it finds no information that a fit to
    the same data does not have. An extended filter's bars hold a quarter of these errors."""
    log, truth = run(SLOW, 1e-4, 0.01, 0.01, seed)
    assert np.mean(np.abs(log.x - truth) <= 2 * log.std) > 0.75


def test_a_fit_without_noise_goes_on_to_its_end():
    """Its steps are short where the valley is narrow: their gains alone would end it .03 deg/s
    off."""
    log, truth = run(FAST, 0.0, 0.0, 0.01, 0)
    error = np.linalg.norm(log.x - truth, axis=1)
    assert DEG * np.sqrt(np.mean(error[:1000] ** 2)) < 0.001
    assert DEG * np.sqrt(np.mean(error**2)) < 0.003


def test_a_copy_goes_on_between_late_fits():
    """About the same motion of the same fit."""
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in SLOW.items()})
    record = model.simulate(100.0, DT, integrator="accurate")
    y = record.y + 0.01 * np.random.default_rng(5).standard_normal(record.y.shape)
    history = ddmhe.History(record.x[: RECORDED + 1], y[:RECORDED], dt=DT)
    est = ddmhe.RigidBodyMhe(history, output_noise=0.01)
    est.run(y[RECORDED:-150])
    other = ddmhe.RigidBodyMhe.restore(est.snapshot())
    a, b = est.run(y[-150:-1]), other.run(y[-150:-1])
    assert np.array_equal(a.x, b.x)
    assert np.array_equal(a.covariance, b.covariance)
