"""Verdicts on theorems: exact arithmetic, random searches and closed forms against the package."""

from fractions import Fraction

import numpy as np
import pytest

import ddmhe
from ddmhe.reproduce import (
    interval_theory,
    pendulum,
    theory,
)


def test_no_gain_of_an_affordable_brake_gives_the_printed_pair():
    """|A| ≤ √(ρ0/6) + √(μ0/6)|C|: the bound of the claim by a search over gains, with C just below
    and above it."""
    rho0, mu0 = 1.2705e-19, 3.3307e-14
    A, most = 1 - 0.01, np.sqrt(mu0 / 6)  # |L| ≤ √(μ0/6)
    least = (A - np.sqrt(rho0 / 6)) / most
    assert 1.2e7 < least < 1.4e7
    gains = np.linspace(-most, most, 100_001)
    assert (6 * (A + gains * 0.999 * least) ** 2).min() > 1e10 * rho0
    assert (6 * (A + gains * least) ** 2).min() == pytest.approx(rho0, rel=1e-4)


def test_the_rank_of_44_needs_the_rounding_of_the_differences():
    """Rank 5 at every sampling time; C has rank 2, so a sixth direction is rounding (3e-31 in 60
    digits)."""
    for dt in (0.1, 0.5, 1.0):
        record = ddmhe.models.detumbling().simulate(20.0, dt)
        assert (
            ddmhe.design.pole_placement(
                ddmhe.History(record.x, record.y[:-1], dt=dt), attempts=1
            ).rank
            == 5
        )
    noisy = record.y[:-1] + 1e-9 * np.random.default_rng(0).standard_normal(
        (20, 3)
    )  # of 5 N·m: no rounding
    assert ddmhe.design.pole_placement(ddmhe.History(record.x, noisy, dt=1.0), attempts=1).rank == 6


def times(X, Y):
    """Product of two matrices of rationals."""
    return [
        [sum(a * b for a, b in zip(row, column, strict=True)) for column in zip(*Y, strict=True)]
        for row in X
    ]


def solved(normal, right):
    """z of a 2 × 2 system of rationals by Cramer's rule."""
    determinant = normal[0][0] * normal[1][1] - normal[0][1] ** 2
    return [
        [(normal[1][1] * right[0] - normal[0][1] * right[1]) / determinant],
        [(normal[0][0] * right[1] - normal[1][0] * right[0]) / determinant],
    ]


def window_3_to_5(A, C, rho, mu, x):
    """x̂(6) and J* of the window y(3..5), y = C x, with the prior x̂(3) = 0: minimise
    2ρ³|z|² + Σ_j ρ^{j-1} μ C² |A^{3-j} z - x(6-j)|² over z = x̂(3)."""
    F, M = Fraction, 3
    power = [[F(1), F(0)], [F(0), F(1)]]
    normal, right = [[2 * rho**M, F(0)], [F(0), 2 * rho**M]], [F(0), F(0)]
    terms = []
    for age in (3, 2, 1):
        weight = rho ** (age - 1) * mu * C**2
        terms.append((weight, power, x[6 - age]))
        for i in range(2):
            right[i] += weight * sum(power[k][i] * x[6 - age][k][0] for k in range(2))
            for j in range(2):
                normal[i][j] += weight * sum(power[k][i] * power[k][j] for k in range(2))
        power = times(A, power)
    z = solved(normal, right)
    cost = 2 * rho**M * (z[0][0] ** 2 + z[1][0] ** 2)
    for weight, P, target in terms:
        cost += weight * sum((a[0] - b[0]) ** 2 for a, b in zip(times(P, z), target, strict=True))
    return times(power, z), cost


def test_the_counterexample_to_25_31_and_34_in_exact_arithmetic():
    """The window y(3..5) and the prior x̂(3) = x(3) = 0 by rational normal equations, under all of
    the conditions."""
    F = Fraction
    rho, mu, M, C = F(1, 20), F(6), 3, F(1000)
    A = [[F(1), F(10)], [F(0), F(1)]]
    # A + L C = 0 with L = -A/1000, and 6 λmax(LᵀL) ≤ 6 trace(LᵀL) ≤ μ; 4ρ^M < 1; 6 ≤ μ
    gain = [[-a / C for a in row] for row in A]
    assert all(
        a + C * g == 0 for ra, rg in zip(A, gain, strict=True) for a, g in zip(ra, rg, strict=True)
    )
    assert 6 * sum(g * g for row in gain for g in row) <= mu
    assert 4 * rho**M < 1
    x = [[[F(0)], [F(0)]]]
    for k in range(6):
        step = times(A, x[-1])
        x.append([step[0], [step[1][0] + (k == 4)]])
    last, cost = window_3_to_5(A, C, rho, mu, x)
    error = float(sum((a[0] - b[0]) ** 2 for a, b in zip(last, x[6], strict=True))) ** 0.5
    assert error == pytest.approx(8.49, abs=0.01)
    example = theory.Example.standard()
    assert example.run() == pytest.approx((error, float(cost)), rel=1e-6)
    assert example.allowed() == pytest.approx((0.3**0.5, (4 * 0.05**3) ** (1 / 6) * 6**0.5))
    assert error > max(example.allowed())
    assert cost > 0  # (31): J* ≤ 0


def test_one_step_is_19():
    """The smallest eigenvalue decides (19): compared with the inequality at random differences,
    both ways."""
    rng = np.random.default_rng(0)
    A, C = np.array([[0.3, 0.1], [0.0, 0.2]]), np.eye(2)
    for rho, mu in ((0.9, 6.0), (0.9, 1.5), (0.05, 0.1)):
        holds = theory.one_step(A, C, rho, mu) >= 0
        worst = np.inf
        for _ in range(4000):
            x, e, w, r, v = rng.standard_normal((5, 2)) * 10.0 ** rng.uniform(-2, 1, (5, 1))
            e = w if rng.random() < 0.5 else e
            y = C @ x + r + v
            right = rho * x @ x + mu * (y @ y + r @ r + v @ v + e @ e + w @ w)
            worst = min(worst, right - (A @ x + e + w) @ (A @ x + e + w))
        assert (worst >= 0) == holds


def test_lemma_1_needs_its_row_of_ones():
    """The lemma holds on random systems; without 1ᵀα = 1 the offsets are scaled."""
    assert max(theory.lemma_1(40)) < 1e-8
    assert theory.lemma_1(40, ones=False)[1] > 0.1


def test_the_sign_of_48():
    """Positive definite it never is; negative definite for poles inside, not for poles outside of
    the disc."""
    A = np.array([[0.5, 0.2], [0.0, -0.3]])
    low, high = theory.region_sign(A, 0.9, np.eye(2))
    assert low < high < 0
    assert theory.region_sign(A, 0.4, np.eye(2))[1] > 0
    assert theory.region_sign(A, 0.4, np.eye(2))[0] < 0


def test_the_linearisation_by_hand():
    """Euler's equations are quadratic: w = dt J⁻¹(-δ × J δ), and the torque is linear, v = 0."""
    model = ddmhe.models.detumbling()
    x = model.simulate(40.0, 0.1).x[200:]
    inertia = np.array([4513.2, 4138.1, 3282.5])
    off = x - x[0]
    w = -0.1 * np.cross(off, off * inertia) / inertia
    (row,) = theory.linearisation((20.0,))
    assert row[1] == pytest.approx(np.rad2deg(np.linalg.norm(w[:-1], axis=1).max()), rel=1e-4)
    assert row[2] < 1e-10
    kappa = (4 * 0.8**10) ** 0.1
    sizes = np.linalg.norm(w[:-1], axis=1)
    allowed = sum(kappa ** ((199 - j) / 2) * 1e5**0.5 * sizes[j] for j in range(200))
    assert row[3] == pytest.approx(np.rad2deg(allowed), rel=1e-3)


def test_where_the_printed_phi_0_comes_from():
    """V0 = eᵀPe at e = (0.1, 1) with P = [[15.2664, -.9930], [·, .12834]], μ = 31.505 and λ = .5,
    by hand."""
    P, mu, mu_w, e = (
        np.array([[15.2664, -0.9930], [-0.9930, 0.12834]]),
        31.5052,
        15.7526,
        np.array([0.1, 1.0]),
    )
    level = e @ P @ e
    assert level == pytest.approx(0.0824, abs=2e-4)
    phi = (mu * (0.5 * level + mu_w * (2 * 0.006**2 + 0.001**2))) ** 0.5
    assert phi == pytest.approx(1.155, abs=1e-3)
    assert pendulum.radii(level)[0] == pytest.approx(1.176, abs=2e-3)
    worst = max(a @ P @ a for a in (np.array([0.1, 1.0]), np.array([0.1, -1.0])))
    assert pendulum.worst_V0() == pytest.approx(worst, rel=1e-3)
    assert pendulum.left_the_ball(pendulum.worst_V0()) == 0.0  # the sound ball is never left
    assert pendulum.left_the_ball(pendulum.V0_of(1.15)) == 1.0


def test_the_statements_of_the_interval_paper_by_independent_arithmetic():
    apart, outside = interval_theory.equality(50)
    assert apart < 1e-14
    assert outside <= 0
    # (24): P = γI with γ = 1/√(2λ) satisfies (22) for Ã = 0: V⁺ = γ‖w‖² ≤ (1-λ)V + γ‖w‖²; (23):
    # λγ·2γ = 1
    gamma = 1 / (2 * 0.9) ** 0.5
    product = 2 * 0.9 * gamma**2
    assert product == pytest.approx(1.0)
    assert interval_theory.worst_single_step() == pytest.approx((2.0, 2 / 0.9, 1 / 0.9))
    assert interval_theory.from_norm(1.15) == pytest.approx(1.3225)
    assert interval_theory.mean_value_point() == pytest.approx(2 * np.pi)
    M = np.array([[2.0, 1.0, -1.0]])
    np.testing.assert_array_equal(interval_theory.reduced_as_printed(M, 2), [[2.0, 0.0]])
    assert ddmhe.Zonotope([0.0], M).reduce(2).interval_hull()[1][0] >= 4.0


def test_figures_1_and_2_start_at_k_0():
    one = pendulum.trial(0)
    for name, half in ((pendulum.ZONOTOPE, [0.1, 1.0]), (pendulum.PRINTED_BALL, [1.15, 1.15])):
        lower, upper = pendulum.from_start(one, name)
        assert lower.shape == one.x.shape
        assert 0.5 * (upper[0] - lower[0]) == pytest.approx(half)
    # the intervals at k = 1, 2, 3 on x2: the printed ball is the tighter one, the sound one is not
    ball, sound, zonotope = (
        0.5 * np.subtract(*pendulum.from_start(one, name)[::-1])[1:4, 1]
        for name in (pendulum.PRINTED_BALL, pendulum.BALL, pendulum.ZONOTOPE)
    )
    late = 31.5052 * 15.7526 * (2 * 0.006**2 + 0.01**2)
    assert ball == pytest.approx(
        [((1.15**2 - late) / 2**k + late) ** 0.5 for k in (1, 2, 3)], rel=1e-3
    )
    assert zonotope == pytest.approx([1.792, 0.961, 0.546], abs=0.01)
    assert (ball < zonotope).all()
    assert (sound > zonotope).all()
