"""Guaranteed intervals: enclosures against high precision, designs, soundness, and a check that can
fail."""

import re

import mpmath
import numpy as np
import pytest
import scipy.optimize

import ddmhe
from ddmhe import interval
from ddmhe._core import interval_operation
from ddmhe.baselines import TahirIntervalObserver

W, V = 0.006, 0.01
START, RADIUS = np.array([0.98, 0.02]), np.array([0.1, 1.0])
INF = float("inf")


# --- interval arithmetic

UNARY = {
    "sqr": lambda x: x * x,
    "sqrt": mpmath.sqrt,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "exp": mpmath.exp,
}
BINARY = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
}
EDGES = [
    0.0,
    5e-324,
    2.3e-308,
    1e-160,
    0.5,
    1.0,
    np.pi / 2,
    np.pi,
    2 * np.pi,
    3e5,
    1e15,
    1e17,
    1e160,
    1.7e308,
]
EDGES = sorted(
    {s * x for x in EDGES for s in (-1, 1)} | {np.nextafter(np.pi, 4), -np.nextafter(np.pi, 4)}
)


def holds(found, exact, context):
    assert found[0] <= exact <= found[1], (*context, found)


def check_unary(op, lo, hi, inside):
    found = interval_operation(op, (lo, hi), (0.0, 0.0))
    for x in inside:
        if op == "sqrt" and x < 0:
            continue
        if op == "exp" and x > 1e6:
            assert found[1] == INF
            continue
        holds(found, UNARY[op](mpmath.mpf(x)), (op, lo, hi, x))
    return found


def test_elementary_functions_enclose_high_precision_values():
    rng = np.random.default_rng(0)
    with mpmath.workprec(400):
        for k in range(50_000):
            op = list(UNARY)[k % 5]
            center = rng.standard_normal() * 10.0 ** rng.uniform(-8, 3)
            width = abs(center) * 10.0 ** rng.uniform(-17, 1) * (k % 7 > 0)
            lo, hi = center - width, center + width
            inside = [lo, hi, min(max(lo + rng.random() * (hi - lo), lo), hi)]
            found = check_unary(op, lo, hi, inside)
            if op in ("sin", "cos") and width == 0 and abs(center) < 1e3:
                assert (
                    found[1] - found[0] <= 6 * np.spacing(max(abs(found[0]), 1e-300)) + 1e-300
                )  # and tight


def test_elementary_functions_at_every_edge():
    with mpmath.workprec(1400):
        for op in UNARY:
            for i, lo in enumerate(EDGES):
                for hi in EDGES[i:]:
                    check_unary(op, lo, hi, [x for x in EDGES if lo <= x <= hi])
                found = interval_operation(op, (lo, INF), (0.0, 0.0))
                assert found[0] <= found[1]
        # the extrema inside, by hand
        assert interval_operation("cos", (-0.1, 0.2), (0, 0))[1] == 1.0
        assert interval_operation("cos", (3.0, 3.2), (0, 0))[0] == -1.0
        assert interval_operation("sin", (1.5, 1.6), (0, 0))[1] == 1.0
        assert interval_operation("sin", (-1.6, -1.5), (0, 0))[0] == -1.0
        low, high = interval_operation("sin", (0.1, 0.2), (0, 0))
        assert 0 < np.sin(0.1) - low < 1e-15
        assert 0 < high - np.sin(0.2) < 1e-15
        assert np.isnan(interval_operation("sqrt", (-2.0, -1.0), (0, 0))).all()


def test_basic_operations_enclose_exact_values():
    rng = np.random.default_rng(1)
    ends = rng.standard_normal((50_000, 4)) * 10.0 ** rng.integers(-12, 12, (50_000, 4))
    ends[::11, 0] = 0.0
    ends[::13, 2] = 0.0
    edges = [
        (a, b, c, d) for a in EDGES[::3] for b in EDGES[::3] for c in EDGES[::4] for d in EDGES[::4]
    ]
    with mpmath.workprec(2500):
        for k, (a, b, c, d) in enumerate([*map(tuple, ends), *edges]):
            x, y = (min(a, b), max(a, b)), (min(c, d), max(c, d))
            op = list(BINARY)[k % 4]
            found = interval_operation(op, x, y)
            corners = {
                (u, v): BINARY[op](mpmath.mpf(u), mpmath.mpf(v))
                for u in x
                for v in y
                if op != "div" or v != 0
            }
            for at, exact in corners.items():
                holds(found, exact, (op, x, y, *at))
            if k < len(ends) and not (op == "div" and y[0] <= 0 <= y[1]):  # and tight
                assert found[0] >= min(corners.values()) - 2 * np.spacing(abs(found[0]))
                assert found[1] <= max(corners.values()) + 2 * np.spacing(abs(found[1]))


# --- design


def test_gain_of_the_paper_and_of_the_exact_inequality():
    s = interval.pendulum()
    paper = interval.design_observer(s, 0.5, lmi="paper")
    np.testing.assert_allclose(paper.gain.ravel(), [1.5029, 7.7372], rtol=1e-3)
    np.testing.assert_allclose([paper.mu_w, paper.mu_v, paper.gamma], 15.7526, rtol=1e-3)
    np.testing.assert_allclose(paper.P, [[15.2664, -0.9930], [-0.9930, 0.12834]], rtol=1e-3)
    exact = interval.design_observer(s, 0.5)
    np.testing.assert_allclose([exact.mu_w, exact.mu_v], 15.6196, rtol=1e-4)
    np.testing.assert_allclose(exact.gain.ravel(), [1.50297, 7.73797], rtol=1e-4)
    assert paper.verified
    assert exact.verified
    assert min(paper.slack, exact.slack) >= 0
    searched = interval.design_observer(s)
    assert searched.mu < interval.design_observer(s, 0.2).mu * (1 + 1e-6)
    assert 0.1 < searched.lam < 0.3
    assert interval.design_observer(s, 0.2).mu_w == pytest.approx(12.93, rel=2e-2)


@pytest.mark.parametrize("lmi", ["paper", "exact"])
def test_gamma_is_confirmed_by_eigenvalues_of_random_members(lmi):
    """(41) at 500 random matrices of the interval, computed here."""
    s = interval.van_der_pol(dt=0.02, mu=0.5, bound=1.5)
    g = interval.design_observer(s, 0.2, lmi=lmi)
    rng = np.random.default_rng(0)
    G = np.hstack([s.D1, -g.gain @ s.D2])
    for _ in range(500):
        J = rng.choice([s.j_lo, s.j_hi, rng.uniform(s.j_lo, s.j_hi)])
        map_ = np.hstack([s.A - g.gain @ s.C + J, G])
        size = np.zeros((5, 5))
        size[:2, :2], size[2:, 2:] = (1 - g.lam) * g.P, g.gamma * np.eye(3)
        assert np.linalg.eigvalsh(size - map_.T @ g.P @ map_)[0] > -1e-9 * g.gamma
    assert g.mu_w >= g.gamma
    assert g.mu_v >= g.gamma
    assert np.linalg.eigvalsh(g.lam * g.P - np.eye(2) / g.mu)[0] >= 0


def test_weights_only_scale_the_coordinates():
    """A system in other units with the weights that undo them has the same design."""
    s = interval.pendulum()
    T = np.diag([1.0, 1000.0])
    T_inv = np.diag([1.0, 1e-3])
    scaled = interval.System(
        T @ s.A @ T_inv,
        s.C @ T_inv,
        T @ s.D1,
        s.D2,
        None,
        None,
        T @ s.j_lo @ T_inv,
        T @ s.j_hi @ T_inv,
    )
    a = interval.design_observer(s, 0.4)
    b = interval.design_observer(scaled, 0.4, weights=[1.0, 1e-3])
    np.testing.assert_allclose(b.gain.ravel(), (T @ a.gain).ravel(), rtol=1e-4)
    assert b.mu == pytest.approx(a.mu, rel=1e-6)


def test_many_vertices():
    rng = np.random.default_rng(0)
    A = 0.3 * rng.standard_normal((4, 4))
    bound = np.zeros((4, 4))
    bound.ravel()[rng.permutation(16)[:8]] = 0.05
    s = interval.System(
        A, rng.standard_normal((2, 4)), np.eye(4), np.eye(2), None, None, -bound, bound
    )
    assert len(s.vertices()) == 256
    assert interval.design_observer(s, 0.2).verified


# --- the observer


def trajectory(rng, steps, kind):
    """x (steps+1, 2), y (steps, 1) of the pendulum (60) with one kind of disturbance."""
    s = interval.pendulum()
    if kind == "uniform":
        w, v = rng.uniform(-W, W, (steps, 2)), rng.uniform(-V, V, (steps, 1))
    elif kind == "extreme":
        w, v = W * rng.choice([-1, 1], (steps, 2)), V * rng.choice([-1, 1], (steps, 1))
    elif kind == "constant":
        w, v = (
            np.tile(W * rng.choice([-1, 1], 2), (steps, 1)),
            np.full((steps, 1), V * rng.choice([-1, 1])),
        )
    else:  # switching every few samples
        period = int(rng.integers(2, 20))
        sign = np.where((np.arange(steps) // period) % 2, 1, -1)[:, None]
        w, v = W * sign * rng.choice([-1, 1], 2), V * sign * rng.choice([-1, 1], 1)
    x = [START + RADIUS * (rng.choice([-1, 1], 2) if rng.random() < 0.5 else rng.uniform(-1, 1, 2))]
    for k in range(steps):
        x.append(s.A @ x[-1] + s.f(x[-1]) + w[k])
    x = np.array(x)
    return x, x[:-1, :1] + 0.1 * v


KINDS = ("uniform", "extreme", "constant", "switching")
METHODS = (("paper", "girard"), ("tight", "girard"), ("tight", "pca"), ("tight", "combastel"))


def outside(x, lower, upper):
    return bool(((x < lower) | (x > upper)).any())


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


class NumpyObserver:
    """(45)-(50) written down once more with NumPy; `broken` leaves a part of it out, `design` adds
    (44) and (59)."""

    def __init__(self, system, gain, order, broken=None, design=None):
        self.s, self.L, self.q, self.broken, self.design = system, gain, order, broken, design

    def run(self, Y):
        s, scale = self.s, lambda part, M: 0.99 * M if self.broken == part else M
        x, M = START.copy(), scale("start", np.diag(RADIUS))
        halves, centers, balls = [], [], []
        if g := self.design:
            V0 = max(e @ g.P @ e for e in (RADIUS, RADIUS * [1, -1]))
        for k, y in enumerate(Y):
            r = np.abs(M).sum(axis=1)
            J_lo, J_hi = (np.asarray(J) for J in s.jacobian(x - r, x + r))
            middle, radius = 0.5 * (J_lo + J_hi), 0.5 * (J_hi - J_lo)
            D_s = np.diag(radius @ r)
            T = [middle @ M] + ([] if self.broken == "no D^s" else [D_s])
            parts = [scale("propagated", (s.A - self.L @ s.C) @ M)] + (
                [] if self.broken == "no T" else T
            )
            parts += [scale("process", s.D1 * W), scale("noise", self.L @ s.D2 * V)]
            M = np.hstack(parts)
            if M.shape[1] > self.q:
                ranked = M[:, np.argsort(-np.linalg.norm(M, axis=0), kind="stable")]
                keep, rest = ranked[:, : self.q - s.n], ranked[:, self.q - s.n :]
                M = np.hstack([keep, np.diag(np.abs(rest).sum(axis=1))])
            x = s.A @ x + s.f(x) + self.L @ (y - s.C @ x)
            centers.append(x)
            halves.append(np.abs(M).sum(axis=1))
            if g:
                fade = (1 - g.lam) ** (k + 1)
                phi = np.sqrt(g.mu * (g.lam * fade * V0 + g.mu_w * 2 * W**2 + g.mu_v * V**2))
                balls.append(
                    [np.maximum(x - halves[-1], x - phi), np.minimum(x + halves[-1], x + phi)]
                )
        if g:
            return np.array(balls).transpose(1, 0, 2)
        centers, halves = np.array(centers), np.array(halves)
        return centers - halves, centers + halves


def adversary(system, L, steps, direction):
    """A trajectory that drives the last error along `direction`: signs from the adjoint of the
    error dynamics."""
    w, v, e0 = np.zeros((steps, 2)), np.zeros((steps, 1)), np.zeros(2)
    for _ in range(4):
        x, x_hat, J = [START + e0], START, []
        for k in range(steps):
            J.append(np.asarray(system.jacobian(*2 * [0.5 * (x[-1] + x_hat)])[0]))
            y = system.C @ x[-1] + system.D2 @ v[k]
            x_hat = system.A @ x_hat + system.f(x_hat) + L @ (y - system.C @ x_hat)
            x.append(system.A @ x[-1] + system.f(x[-1]) + w[k])
        p = np.array(direction, dtype=float)
        for k in reversed(range(steps)):
            w[k], v[k] = W * np.sign(system.D1.T @ p), -V * np.sign((L @ system.D2).T @ p)
            p = (system.A - L @ system.C + J[k]).T @ p
        e0 = RADIUS * np.sign(p)
    x = [START + e0]
    for k in range(steps):
        x.append(system.A @ x[-1] + system.f(x[-1]) + w[k])
    x = np.array(x)
    return x, x[:-1] @ system.C.T + v @ system.D2.T


def adversaries(system, L):
    """Adversarial runs of 1 to 60 samples in several directions."""
    for steps in (1, 2, 3, 4, 6, 10, 60):
        for direction in ([1, 0], [0, 1], [-1, 0], [0, -1]):
            yield adversary(system, L, steps, direction)


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


# --- systems


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


# --- from a recording

A_TRUE, C_TRUE = np.array([[0.95, 0.2], [-0.15, 0.9]]), np.array([[1.0, 0.5]])


def affine(rng, x, steps, w, v):
    X, Y = [x], []
    for _ in range(steps):
        Y.append(C_TRUE @ X[-1] + 0.3 + v * rng.uniform(-1, 1, 1))
        X.append(A_TRUE @ X[-1] + [0.1, -0.05] + w * rng.uniform(-1, 1, 2))
    return np.array(X), np.array(Y)


def test_intervals_from_a_recording_hold():
    widths = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x, y = affine(rng, np.array([2.0, -1.0]), 60, 0.01, 0.02)
        model = interval.from_history(ddmhe.History(x, y), 0.01, 0.02)
        # the true system is in the set: what its parameters differ by fits into each row's box
        s = model.system
        for i, (row, found) in enumerate(zip([*A_TRUE, *C_TRUE], [*s.A, *s.C], strict=True)):
            G = np.array(s.kind[1][i]).reshape(-1, 3).T
            offset = [0.1, -0.05, 0.3][i] - ([*s.kind[2], *s.offset])[i]
            assert np.abs(np.linalg.solve(G, [*(row - found), offset])).max() <= 1.0
        truth, online = affine(rng, x[-1], 100, 0.01, 0.02)
        log = model.observer().run(online)
        assert not outside(truth[1:], log.lower, log.upper)
        assert not outside(truth[:-1], *log.filtered)
        widths.append((log.upper - log.lower)[50:].mean(axis=0))
    assert (np.mean(widths, axis=0) < [0.13, 0.3]).all()
    assert "Guaranteed for every system" in model.words
    assert "0.01" in model.words


def test_bounds_that_contradict_the_recording():
    x, y = affine(np.random.default_rng(0), np.array([2.0, -1.0]), 60, 0.01, 0.02)
    with pytest.raises(ddmhe.ModelViolationError, match="w_radius"):
        interval.from_history(ddmhe.History(x, y), 0.001, 0.02)
    with pytest.raises(ddmhe.ModelViolationError, match="v_radius"):
        interval.from_history(ddmhe.History(x, y), 0.01, 0.002)
    still = ddmhe.History(np.ones((30, 2)), np.ones((29, 1)))
    with pytest.raises(ddmhe.RankError, match="history"):
        interval.from_history(still, 0.01, 0.02)


def chebyshev(X, target):
    """The smallest bound of one row, as a linear programme in θ itself."""
    Z = np.hstack([X, np.ones((len(X), 1))])
    rows = np.block([[Z, -np.ones((len(Z), 1))], [-Z, -np.ones((len(Z), 1))]])
    cost = np.append(np.zeros(Z.shape[1]), 1.0)
    found = scipy.optimize.linprog(
        cost, rows, np.concatenate([target, -target]), bounds=(None, None)
    )
    assert found.status == 0
    return found.fun


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e6])
def test_smallest_radii_are_chebyshev_fits_and_below_the_truth(size):
    for seed in range(100 if size == 1.0 else 5):
        x, y = affine(np.random.default_rng(seed), np.array([2.0, -1.0]), 60, 0.01, 0.02)
        w, v = interval.smallest_radii(ddmhe.History(size * x, size * y))
        assert (w <= 0.01 * size).all()
        assert (v <= 0.02 * size).all()
        if seed < 5:
            expected = [chebyshev(x[:-1], x[1:, i]) for i in range(2)] + [
                chebyshev(x[:-1], y[:, 0])
            ]
            np.testing.assert_allclose(np.concatenate([w, v]) / size, expected, rtol=1e-6)


def test_radii_below_the_smallest_are_refused_with_them_by_name():
    x, y = affine(np.random.default_rng(0), np.array([2.0, -1.0]), 60, 0.01, 0.02)
    h = ddmhe.History(x, y)
    w, v = interval.smallest_radii(h)
    with pytest.raises(
        ddmhe.ModelViolationError,
        match=r"w_radius: .* at least [\d.e-]+ for roll, [\d.e-]+ for yaw",
    ) as e:
        interval.from_history(h, [0.01, 0.9 * w[1]], 0.02, names=(("roll", "yaw"), ("gyro",)))
    stated = [float(number) for number in re.findall(r"([\d.e-]+) for", str(e.value))]
    np.testing.assert_allclose(stated, w, rtol=1e-3)
    # what the message says is admissible, and nothing much below is
    assert interval.from_history(h, stated, 1.0001 * v).w_radius == pytest.approx(stated)
    with pytest.raises(ddmhe.ModelViolationError, match=r"v_radius: .* for y1"):
        interval.from_history(h, stated, 0.999 * v)
    m = interval.from_history(h, kappa=1.2)
    np.testing.assert_allclose([*m.w_radius, *m.v_radius], [*(1.2 * w), *(1.2 * v)], rtol=1e-9)
    np.testing.assert_array_equal([*m.w_least, *m.v_least], [*w, *v])


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda h: interval.from_history(h, "best"), ddmhe.DdmheError, 'w_radius: expected "auto"'),
        (lambda h: interval.from_history(h, None, 0.1), ddmhe.DdmheError, "w_radius:"),
        (lambda h: interval.from_history(h, [0.1] * 3, 0.1), ddmhe.ShapeError, "w_radius:"),
        (lambda h: interval.from_history(h, INF, 0.1), ddmhe.NotFiniteError, "w_radius:"),
        (lambda h: interval.from_history(h, kappa=0.5), ddmhe.DdmheError, "kappa:"),
        (lambda h: interval.from_history(h, kappa="x"), ddmhe.DdmheError, "kappa:"),
        (lambda h: interval.from_history(h, gain=np.eye(3)), ddmhe.ShapeError, "gain:"),
        (lambda h: interval.from_history(h, names=(("a",), ("b",))), ddmhe.ShapeError, "names:"),
        (
            lambda h: interval.from_history(h, 1e300, 1e300),
            ddmhe.DdmheError,
            "_radius:|gain:|history:",
        ),
        (lambda h: interval.from_history(scaled(h, 1e200)), ddmhe.DdmheError, "history: "),
        (
            lambda h: interval.from_history(scaled(h, 1e-300), 1e10, 1e10),
            ddmhe.DdmheError,
            "history:",
        ),
        (lambda h: interval.smallest_radii(3), ddmhe.DdmheError, "history:"),
        (
            lambda h: interval.kalman_gain(system(C=[[0.0, 0.0]], A=2 * np.eye(2)), 1.0, 1.0),
            ddmhe.DdmheError,
            "gain:",
        ),
        (
            lambda h: interval.kalman_gain(interval.pendulum(), 1e200, 1e-200),
            ddmhe.DdmheError,
            "gain:",
        ),
    ],
)
def test_wrong_input_for_a_recording_is_an_error_of_this_package(call, error, words):
    x, y = affine(np.random.default_rng(0), np.array([2.0, -1.0]), 60, 0.01, 0.02)
    with pytest.raises(error, match=words) as caught:
        call(ddmhe.History(x, y))
    assert "expected" in str(caught.value)


def scaled(h, factor):
    ((x, y, *_),) = h.recordings
    return ddmhe.History(factor * x, factor * y)


def test_verdicts():
    t = np.arange(10.0)
    low, high = np.zeros((10, 3)), np.tile([0.1, 0.7, 1.5], (10, 1))
    high[6:, 0] = 3.0
    high[8:, 1] = INF
    v = interval.judge(low, high, (np.zeros(3), np.ones(3)), t, ("a", "b", "c"))
    np.testing.assert_allclose(v.share, [0.1, 0.7, 1.5])
    np.testing.assert_array_equal(v.grows, [6.0, 8.0, np.nan])
    np.testing.assert_array_equal(v.unbounded, [np.nan, 8.0, np.nan])
    assert not v.useful
    assert "a 0.1 of the recorded range, grows beyond it from 6 s on" in v.words
    assert "b says little: median width 0.7" in v.words
    assert "no bound from 8 s on" in v.words
    assert "c says nothing beyond the recorded range (median width 1.5 of it)" in v.words
    assert "inf" not in v.words
    endless = interval.judge(-high[:, 1:2] * 1e4 ** t[:, None], high[:, 1:2], ([0], [1]), t, ("b",))
    assert (
        "median width above 1000 of it), grows beyond it from 0 s on, no bound from 8 s on"
        in endless.words
    )
    assert interval.judge(low[:, :1], high[:, :1], ([0], [1]), t, ("a",)).useful
    with pytest.raises(ddmhe.DdmheError, match="recorded:"):
        interval.judge(low, high, (np.zeros(3), np.zeros(3)), t, ("a", "b", "c"))
    with pytest.raises(ddmhe.ShapeError, match="upper:"):
        interval.judge(low, high[1:], (np.zeros(3), np.ones(3)), t, ("a", "b", "c"))


# --- the baseline


def test_reconstruction_of_tahir_holds():
    s = interval.pendulum()
    o = TahirIntervalObserver(s, START, RADIUS, W, V)
    widths = []
    for k in range(60):
        x, y = trajectory(np.random.default_rng(k), 100, KINDS[k % 4])
        o.reset()
        log = o.run(y)
        assert not outside(x[1:], log.lower, log.upper)
        widths.append((log.upper - log.lower)[50:].mean(axis=0))
    # the range that an independent reconstruction found
    assert 0.03 < np.mean(widths, axis=0)[0] < 0.09
    assert 0.3 < np.mean(widths, axis=0)[1] < 0.75


@pytest.mark.parametrize("lam", [None, 0.02, 0.5])
def test_a_mixed_monotone_gain_whose_widths_grow_is_refused(lam):
    """(A - L C)_22 = 1 for every L, (A - L C)_12 = F_21 = 0.065: no own-coordinates gain of the
    pendulum contracts."""
    with pytest.raises(ddmhe.InfeasibleError, match=r"rho\(\|A - L C\| \+ F\) = 1\.0"):
        TahirIntervalObserver(interval.pendulum(), START, RADIUS, W, V, transform=False, lam=lam)
    # where own coordinates do, they are taken
    A = np.array([[0.7, 0.1], [0.05, 0.8]])
    s = interval.System(
        A, [[1.0, 0.0]], np.eye(2), [[1.0]], None, None, np.zeros((2, 2)), np.zeros((2, 2))
    )
    o = TahirIntervalObserver(s, START, RADIUS, W, V, transform=False, lam=lam)
    closed = np.abs(A - o.gain @ s.C)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1
    log = o.run(np.zeros((400, 1)))
    width = log.upper - log.lower
    assert (width[399] <= width[100] * (1 + 1e-9)).all()


# --- wrong input


def system(**changed):
    given = {
        "A": np.eye(2),
        "C": [[1.0, 0.0]],
        "D1": np.eye(2),
        "D2": [[1.0]],
        "f": None,
        "jacobian": None,
    }
    given |= {"j_lo": np.zeros((2, 2)), "j_hi": np.zeros((2, 2))}
    return interval.System(**(given | changed))


def observer(**changed):
    s = interval.pendulum()
    design = interval.fixed_gain(s, [[1.5], [7.7]])
    given = {
        "system": s,
        "design": design,
        "x0_center": START,
        "x0_radius": RADIUS,
        "w_radius": W,
        "v_radius": V,
    }
    return interval.IntervalObserver(**(given | changed))


def python_system(f, jacobian):
    s = interval.pendulum()
    return interval.System(s.A, s.C, s.D1, s.D2, f, jacobian, s.j_lo, s.j_hi)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: system(A=np.ones((2, 3))), ddmhe.ShapeError, "A:"),
        (lambda: system(A=[[1, np.nan], [0, 1]]), ddmhe.NotFiniteError, "A:"),
        (lambda: system(C=[[1.0]]), ddmhe.ShapeError, "C:"),
        (lambda: system(D1=np.eye(3)), ddmhe.ShapeError, "D1:"),
        (lambda: system(D2=np.eye(2)), ddmhe.ShapeError, "D2:"),
        (lambda: system(B=np.eye(3)), ddmhe.ShapeError, "B:"),
        (lambda: system(r=[1.0, 2.0]), ddmhe.ShapeError, "r:"),
        (lambda: system(j_lo=np.ones((2, 2))), ddmhe.DdmheError, "j_lo:"),
        (lambda: system(f=np.sin), ddmhe.DdmheError, "f, jacobian:"),
        (lambda: system(f=1, jacobian=2), ddmhe.DdmheError, "f:"),
        (
            lambda: interval.linear(np.ones((2, 2)), np.zeros((2, 2)), [[1, 0]], np.eye(2), [[1]]),
            ddmhe.DdmheError,
            "A_lo",
        ),
        (lambda: interval.detumbling(uncertainty=-1), ddmhe.DdmheError, "uncertainty"),
        (lambda: interval.design_observer(3), ddmhe.DdmheError, "system:"),
        (lambda: interval.design_observer(interval.pendulum(), 1.5), ddmhe.DdmheError, "lam:"),
        (
            lambda: interval.design_observer(interval.pendulum(), 0.5, lmi="x"),
            ddmhe.DdmheError,
            "lmi:",
        ),
        (
            lambda: interval.design_observer(interval.pendulum(), 0.5, weights=[1, 0]),
            ddmhe.DdmheError,
            "weights:",
        ),
        (
            lambda: interval.design_observer(system(C=[[0.0, 0.0]]), 0.5),
            ddmhe.InfeasibleError,
            "smaller",
        ),
        (
            lambda: interval.design_observer(system(j_hi=np.full((2, 2), INF)), 0.5),
            ddmhe.DdmheError,
            "j_lo, j_hi",
        ),
        (lambda: observer(x0_center=[1.0]), ddmhe.ShapeError, "x0_center"),
        (lambda: observer(x0_radius=[0.1, -1.0]), ddmhe.DdmheError, "x0_radius"),
        (lambda: observer(w_radius=-1.0), ddmhe.DdmheError, "w_radius"),
        (lambda: observer(v_radius=np.nan), ddmhe.NotFiniteError, "v_radius"),
        (lambda: observer(order=1), ddmhe.DdmheError, "order"),
        (lambda: observer(method="best"), ddmhe.DdmheError, "method"),
        (lambda: observer(reduction="best"), ddmhe.DdmheError, "method"),
        (lambda: observer(design=np.eye(2)), ddmhe.DdmheError, "design"),
        (lambda: observer().step([1.0, 2.0]), ddmhe.ShapeError, "y:"),
        (lambda: observer().step([INF]), ddmhe.NotFiniteError, "y:"),
        (lambda: observer().step([1.0], u=[1.0]), ddmhe.ShapeError, "u:"),
        (lambda: observer().step([5.0]), ddmhe.ModelViolationError, "step 0 leaves state 1"),
        (lambda: observer().run(np.ones((3, 2))), ddmhe.ShapeError, "Y:"),
        (
            lambda: observer(system=python_system(lambda x: [1.0], lambda lo, hi: (0, 0))).step(
                [1.0]
            ),
            ddmhe.DdmheError,
            "jacobian",
        ),
        (
            lambda: observer(
                system=python_system(lambda x: 1 / 0, interval.pendulum().jacobian)
            ).step([1.0]),
            ddmhe.DdmheError,
            "ZeroDivisionError",
        ),
        (lambda: ddmhe.Zonotope([1.0], np.ones((2, 2))), ddmhe.ShapeError, "generators"),
        (lambda: ddmhe.Zonotope([np.nan], np.ones((1, 2))), ddmhe.NotFiniteError, "center"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).reduce(1), ddmhe.DdmheError, "q:"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).reduce(2, "x"), ddmhe.DdmheError, "method"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).contains([1.0]), ddmhe.ShapeError, "x:"),
        (lambda: interval.from_history(1, 0.1, 0.1), ddmhe.DdmheError, "history"),
    ],
)
def test_wrong_input_is_one_clear_error(call, error, words):
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "expected" in str(caught.value)


def test_zonotopes_from_python():
    Z = ddmhe.Zonotope([1.0, 2.0], [[1.0, 0.5, 0.0], [0.0, 0.5, 2.0]])
    np.testing.assert_array_equal(Z.generators, [[1.0, 0.5, 0.0], [0.0, 0.5, 2.0]])
    lo, hi = Z.interval_hull()
    np.testing.assert_allclose([lo, hi], [[-0.5, -0.5], [2.5, 4.5]])
    assert Z.order == 1.5
    assert Z.radius == pytest.approx(2.5)
    assert Z.support([1.0, 0.0]) == pytest.approx(2.5)
    assert Z.volume() == pytest.approx(4 * (0.5 + 2.0 + 1.0))
    np.testing.assert_allclose(Z.linear_map([[2.0, 0.0]]).generators, [[2.0, 1.0, 0.0]])
    np.testing.assert_allclose(Z.translate([1.0, 1.0]).center, [2.0, 3.0])
    assert Z.minkowski_sum(Z).generators.shape == (2, 6)
    assert Z.reduce(2, "pca").contains([2.4, 4.4])
    assert not Z.contains([2.5, 0.0])
    assert Z.interval_map([[0.9, 0.0]], [[1.1, 0.0]]).contains([1.1 * 2.5])
