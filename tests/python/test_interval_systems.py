"""Systems that ship with the interval observer."""

import numpy as np
import pytest

import ddmhe
from ddmhe import interval
from pendulum_case import outside


@pytest.mark.parametrize("uncertainty", [0.0, 0.02])
def test_detumbling_target_with_uncertain_parameters(uncertainty):
    """Truth with parameters drawn from the bounds, forward Euler as the system says."""
    s = interval.detumbling(uncertainty=uncertainty)
    nominal = ddmhe.models.detumbling()
    g = interval.fixed_gain(s, interval.kalman_gain(s, 1e-6, 0.01))
    rng = np.random.default_rng(0)
    J = np.diag(nominal.inertia)
    ratios = 0.1 * (np.roll(J, -1) - np.roll(J, -2)) / J
    N = s.A - np.eye(3)
    for trial in range(8):
        off = [
            1 + uncertainty * rng.choice([-1, 1, rng.uniform(-1, 1)], M.shape)
            for M in (ratios, N, s.C)
        ]
        a, damping, G = (M * o for M, o in zip((ratios, N, s.C), off, strict=True))
        x = [nominal.omega_0 + 1e-3 * rng.choice([-1, 1], 3)]
        for _ in range(300):
            p, q, r = x[-1]
            x.append(
                x[-1] + a * [q * r, r * p, p * q] + damping @ x[-1] + 1e-7 * rng.choice([-1, 1], 3)
            )
        x = np.array(x)
        y = x[:-1] @ G.T + 0.01 * rng.choice([-1, 1], (300, 3))
        for method in ("tight", "paper"):
            o = interval.IntervalObserver(
                s, g, nominal.omega_0, 1e-3, 1e-7, 0.01, order=40, method=method
            )
            log = o.run(y)
            assert not outside(x[1:], log.lower, log.upper), (trial, method)
            if method == "tight":
                assert np.rad2deg(log.upper - log.lower)[200].max() < (0.7 if uncertainty else 0.25)


def test_the_nominal_torque_matrix_is_the_models():
    s, m = interval.detumbling(), ddmhe.models.detumbling()
    x = np.array([0.2, -0.1, 0.05])
    np.testing.assert_allclose(s.C @ x, m.output(x), rtol=1e-12)
    np.testing.assert_allclose(s.A @ x + s.f(x), x + 0.1 * m.derivative(x), rtol=1e-13)


def test_linear_system_with_an_uncertain_matrix_and_van_der_pol():
    A_lo, A_hi = np.array([[0.9, 0.1], [-0.25, 0.8]]), np.array([[0.95, 0.15], [-0.2, 0.85]])
    s = interval.linear(A_lo, A_hi, [[1.0, 0.0]], np.eye(2), [[1.0]], C_radius=[[0.02, 0.0]])
    g = interval.design_observer(s, 0.1)
    rng = np.random.default_rng(0)
    for _ in range(30):
        A, C = rng.uniform(A_lo, A_hi), [[rng.uniform(0.98, 1.02), 0.0]]
        x = [np.array([1.0, -1.0])]
        for _ in range(80):
            x.append(A @ x[-1] + 0.01 * rng.choice([-1, 1], 2))
        x = np.array(x)
        y = x[:-1] @ np.transpose(C) + 0.01 * rng.choice([-1, 1], (80, 1))
        for method in ("paper", "tight"):
            log = interval.IntervalObserver(s, g, [1.0, -1.0], 0.1, 0.01, 0.01, method=method).run(
                y
            )
            assert not outside(x[1:], log.lower, log.upper)
            assert not outside(x[1:], *log.ball)
            assert not outside(x[1:], *log.ellipsoid)
    s = interval.van_der_pol(bound=2.5)
    g = interval.fixed_gain(s, interval.kalman_gain(s, 0.001, 0.01))
    for _ in range(30):
        x = [np.array([1.0, 0.5]) + 0.1 * rng.choice([-1, 1], 2)]
        for _ in range(200):
            x.append(s.A @ x[-1] + s.f(x[-1]) + 0.001 * rng.choice([-1, 1], 2))
        x = np.array(x)
        y = x[:-1, :1] + 0.01 * rng.choice([-1, 1], (200, 1))
        log = interval.IntervalObserver(s, g, [1.0, 0.5], 0.1, 0.001, 0.01).run(y)
        assert not outside(x[1:], log.lower, log.upper)
        assert (log.upper - log.lower)[50:].max() < 0.2


def test_the_pendulum_of_the_core_is_numpys():
    s = interval.pendulum()
    gain = s.j_hi[1, 0]
    rng = np.random.default_rng(0)
    for _ in range(2000):
        x = rng.normal(0, 3, 2)
        np.testing.assert_allclose(s.f(x), [0.0, -gain * np.sin(x[0])], rtol=1e-15)
        lo, hi = x, x + rng.uniform(0, 2, 2)
        inside = -gain * np.cos(np.linspace(lo[0], hi[0], 200))
        J_lo, J_hi = s.jacobian(lo, hi)
        assert (J_lo[[0, 0, 1], [0, 1, 1]] == 0).all()
        assert (J_hi[[0, 0, 1], [0, 1, 1]] == 0).all()
        assert J_lo[1, 0] <= inside.min()
        assert inside.max() <= J_hi[1, 0]
        # and no wider than what 200 points of a curve of curvature at most `gain` can miss
        ends = [inside.min(), inside.max()]
        np.testing.assert_allclose([J_lo[1, 0], J_hi[1, 0]], ends, rtol=0, atol=1e-5)


@pytest.mark.parametrize("uncertainty", [0.0, 0.02])
def test_eulers_equations_of_the_core_are_numpys(uncertainty):
    s = interval.detumbling(uncertainty=uncertainty)
    inertia = np.diag(ddmhe.models.detumbling().inertia)
    a = 0.1 * (np.roll(inertia, -1) - np.roll(inertia, -2)) / inertia
    rng = np.random.default_rng(0)
    for _ in range(500):
        x = rng.uniform(-0.3, 0.3, 3)
        f = a * [x[1] * x[2], x[2] * x[0], x[0] * x[1]]
        # what the linear part is uncertain by is symmetric: it cancels to rounding
        np.testing.assert_allclose(s.f(x), f, rtol=1e-13, atol=1e-17)
        Df = [[0, a[0] * x[2], a[0] * x[1]], [a[1] * x[2], 0, a[1] * x[0]]]
        Df.append([a[2] * x[1], a[2] * x[0], 0])
        J_lo, J_hi = s.jacobian(x - 0.01, x + 0.01)
        assert (J_lo <= Df).all()
        assert (J_hi >= Df).all()


def test_dynamics_that_do_not_fit_the_system_are_refused():
    core = interval.pendulum().dynamics
    zero = np.zeros((3, 3))
    s = interval.System(
        zero, np.eye(3), np.eye(3), np.eye(3), None, None, zero, zero, dynamics=core
    )
    with pytest.raises(ddmhe.ShapeError, match="dynamics: expected those of a system with 3"):
        interval.IntervalObserver(s, interval.fixed_gain(s, zero), zero[0], 0.1, 0.1, 0.1)
    with pytest.raises(ddmhe.DdmheError, match="dynamics: expected a Dynamics"):
        interval.System(*[np.eye(2)] * 4, None, None, *[np.zeros((2, 2))] * 2, dynamics=("linear",))
