"""Outward rounding: sets against exact rational arithmetic, at every size of number that a float
has."""

from fractions import Fraction

import numpy as np
import pytest

import ddmhe
from ddmhe import interval

INF = float("inf")


def exact(values):
    """The rationals that floats are."""
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=float))


def reach(center, generators, d):
    """max d·x over the set, all rational."""
    return d @ center + sum(abs(v) for v in d @ generators)


def parts(Z):
    return exact(Z.center), exact(Z.generators)


def directions(rng, n):
    """Axes both ways and some oblique, rational."""
    oblique = rng.integers(-8, 9, (4, n))
    return exact(np.vstack([np.eye(n), -np.eye(n), oblique]))


SIZES = {
    "ordinary": (-3, 3),
    "wide": (-30, 30),
    "tiny": (-300, -290),
    "denormal": (-323, -306),
    "huge": (280, 290),
}


def numbers(rng, shape, exponents):
    """Random floats of many magnitudes, some zero, some with few bits."""
    values = rng.standard_normal(shape) * 10.0 ** rng.uniform(*exponents, shape)
    values = np.where(rng.random(shape) < 0.1, 0.0, values)
    return np.where(rng.random(shape) < 0.1, np.round(values, 2), values)


def zonotope(rng, exponents, n=None, m=None):
    n = int(rng.integers(1, 5)) if n is None else n
    m = int(rng.integers(0, 3 * n + 3)) if m is None else m
    return ddmhe.Zonotope(numbers(rng, n, exponents), numbers(rng, (n, m), exponents))


def factors(kind, exponents):
    """Exponents of matrices whose products with such numbers are floats again, or fall below
    them."""
    return (-10, 10) if kind == "huge" else (-20, 3) if kind == "denormal" else (-3, 3)


def held(rng, image, found):
    """Is the exact set `image` in `found` (center, generators)?"""
    return all(reach(*image, d) <= reach(*found, d) for d in directions(rng, len(image[0])))


@pytest.mark.parametrize("kind", SIZES)
def test_maps_and_sums_hold_the_exact_sets(kind):
    rng = np.random.default_rng(0)
    for trial in range(150):
        Z = zonotope(rng, SIZES[kind])
        n = len(Z.center)
        A = numbers(rng, (int(rng.integers(1, n + 2)), n), factors(kind, SIZES[kind]))
        p, M = parts(Z)
        assert held(rng, (exact(A) @ p, exact(A) @ M), parts(Z.linear_map(A))), trial
        other = zonotope(rng, SIZES[kind], n)
        q, N = parts(other)
        assert held(rng, (p + q, np.hstack([M, N])), parts(Z.minkowski_sum(other))), trial
        assert held(rng, (p + q, M), parts(Z.translate(other.center))), trial


@pytest.mark.parametrize("kind", SIZES)
def test_interval_maps_hold_every_matrix(kind):
    rng = np.random.default_rng(1)
    for trial in range(100):
        Z = zonotope(rng, SIZES[kind])
        n, rows = len(Z.center), int(rng.integers(1, 4))
        A = numbers(rng, (rows, n), factors(kind, SIZES[kind]))
        width = np.abs(numbers(rng, (rows, n), factors(kind, SIZES[kind]))) * rng.choice(
            [0, 1e-17, 1e-3], (rows, n)
        )
        lo, hi = A - width, A + width
        found = parts(Z.interval_map(lo, hi))
        p, M = parts(Z)
        for _ in range(3):
            member = np.where(rng.random(lo.shape) < 0.5, exact(lo), exact(hi))
            assert held(rng, (member @ p, member @ M), found), trial


@pytest.mark.parametrize("method", ["girard", "combastel", "pca", "paper"])
@pytest.mark.parametrize("kind", SIZES)
def test_reductions_hulls_and_supports_hold_the_exact_set(kind, method):
    rng = np.random.default_rng(2)
    for trial in range(60):
        Z = zonotope(rng, SIZES[kind])
        n = len(Z.center)
        q = n + int(rng.integers(0, 3))
        reduced = Z.reduce(q, method)
        assert reduced.generators.shape[1] <= q
        assert held(rng, parts(Z), parts(reduced)), trial
        lo, hi = Z.interval_hull()
        for i, axis in enumerate(exact(np.eye(n))):
            assert reach(*parts(Z), axis) <= Fraction(hi[i]), trial
            assert -reach(*parts(Z), -axis) >= Fraction(lo[i]), trial
        for d in [*numbers(rng, (4, n), factors(kind, SIZES[kind])), *rng.integers(-3, 4, (2, n))]:
            assert reach(*parts(Z), exact(d)) <= Fraction(Z.support(d)), trial


def test_no_point_of_a_thin_set_is_refused():
    """Dyadic numbers: p + M ξ is exact. Sets flat or nearly so, rows in several units."""
    rng = np.random.default_rng(7)
    outside = 0
    for trial in range(2000):
        n, m = int(rng.integers(2, 6)), int(rng.integers(1, 9))
        rank = int(rng.integers(1, n + 1))
        M = (rng.integers(-8, 9, (n, rank)) @ rng.integers(-8, 9, (rank, m))).astype(float)
        M += (
            rng.integers(-2, 3, (n, m))
            * 0.5 ** int(rng.choice([20, 30, 36, 40]))
            * (rng.random() < 0.7)
        )
        M *= 2.0 ** rng.integers(-3, 4, (n, 1))
        center, xi = (
            rng.integers(-4, 5, n).astype(float),
            rng.choice([-1.0, -1.0, 0.5, 1.0, 1.0], m),
        )
        Z, x = ddmhe.Zonotope(center, M), center + M @ xi
        assert Z.contains(x), trial
        # and a point well beyond it in the direction of one of its supports is
        d = rng.standard_normal(n)
        far = (
            center
            + (M * np.where(d @ M >= 0, 1, -1)).sum(axis=1)
            + 0.01 * (1 + np.abs(M).sum(axis=1).max()) * d
        )
        outside += not Z.contains(far)
    assert outside == 2000


def test_what_rounds_nothing_stays_as_it_is():
    Z = ddmhe.Zonotope([1.0, -2.5], [[0.5, 3.0, 0.0], [0.25, -1.0, 7.0]])
    turned = Z.linear_map([[0.0, -2.0], [4.0, 0.0]])
    np.testing.assert_array_equal(turned.center, [5.0, 4.0])
    np.testing.assert_array_equal(turned.generators, [[-0.5, 2.0, -14.0], [2.0, 12.0, 0.0]])
    np.testing.assert_array_equal(Z.minkowski_sum(Z).generators, np.hstack([Z.generators] * 2))
    np.testing.assert_array_equal(Z.translate([0.5, 0.5]).generators, Z.generators)
    assert Z.support([1.0, 0.0]) == 4.5


def test_rounding_neither_grows_the_order_nor_the_set():
    """A thousand maps and sums of full sets: as many generators as without rounding, and as wide to
    1e-12 of a map."""
    rng = np.random.default_rng(3)
    Z = ddmhe.Zonotope(rng.standard_normal(3), rng.standard_normal((3, 9)))
    center, M = Z.center, Z.generators
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    for _ in range(1000):
        Z = Z.linear_map(turn).translate([0.1, 0.2, 0.3])
        center, M = turn @ center + [0.1, 0.2, 0.3], turn @ M
    assert Z.generators.shape == (3, 9)
    np.testing.assert_allclose(Z.center, center, rtol=0, atol=1e-9)
    np.testing.assert_allclose(Z.generators, M, rtol=0, atol=1e-9)
    flat = ddmhe.Zonotope([0.1, 0.2], [[0.3], [0.7]]).linear_map(turn[:, :2])
    assert flat.generators.shape[1] <= 4


EDGES = [0.0, 5e-324, 1e-310, 2.3e-308, 1e-170, 1.0, 1e154, 1e285, 1e308, 1.7976931348623157e308]


def edges(rng, *shape):
    return rng.choice(EDGES, shape) * rng.choice([-1, 1], shape)


def answer(call, *arguments):
    """What it returns, or None after a DdmheError that says what was expected."""
    try:
        return call(*arguments)
    except ddmhe.DdmheError as error:
        message = str(error)
    assert "expected" in message
    return None


@pytest.mark.parametrize("method", ["girard", "combastel", "pca", "paper"])
def test_numbers_at_the_edge_give_sets_or_errors(method):
    """Never NaN, never unsound: a set that holds the exact one, or a DdmheError."""
    rng = np.random.default_rng(4)
    answered = supported = measured = 0
    for trial in range(200):
        n, m = int(rng.integers(1, 4)), int(rng.integers(0, 7))
        Z = ddmhe.Zonotope(edges(rng, n), edges(rng, n, m))
        other = ddmhe.Zonotope(edges(rng, n), edges(rng, n, 2))
        A, d = edges(rng, 2, n), edges(rng, n)
        p, M = parts(Z)
        q, N = parts(other)
        lo, hi = Z.interval_hull()
        assert (lo <= hi).all()
        assert not np.isnan(Z.radius)
        top = Z.support(d)
        if top < INF:
            supported += 1
            assert reach(p, M, exact(d)) <= Fraction(top)
        assert Z.contains(Z.center)
        assert isinstance(Z.contains(edges(rng, n)), bool)
        for name, arguments, image in (
            ("linear_map", (A,), (exact(A) @ p, exact(A) @ M)),
            ("interval_map", (A, A), (exact(A) @ p, exact(A) @ M)),
            ("minkowski_sum", (other,), (p + q, np.hstack([M, N]))),
            ("translate", (other.center,), (p + q, M)),
            ("reduce", (n, method), (p, M)),
        ):
            found = answer(getattr(Z, name), *arguments)
            if found is not None:
                answered += 1
                assert held(rng, image, parts(found)), (trial, name)
        volume = answer(Z.volume)
        if volume is not None:
            measured += 1
            assert 0 <= volume < INF
    assert answered > 200
    assert supported > 50  # by a number: above every sum stands infinity, too
    assert measured > 50


def test_principal_axes_of_a_huge_set():
    Z = ddmhe.Zonotope([0.0, 0.0], 1e285 * np.array([[1.0, 1.0, 0.5, 2.0], [0.0, 1.0, -0.5, 1.0]]))
    small = ddmhe.Zonotope([0.0, 0.0], Z.generators / 1e285)
    np.testing.assert_allclose(
        Z.reduce(3, "pca").generators, 1e285 * small.reduce(3, "pca").generators, rtol=1e-12
    )
    assert ddmhe.Zonotope([0.0, 0.0], 1e-200 * small.generators).volume() == 0.0
    assert ddmhe.Zonotope([0.0, 0.0], [[1e200, 0.0], [0.0, 1e-200]]).volume() == pytest.approx(4.0)
    with pytest.raises(
        ddmhe.DdmheError, match="generators: expected a result within the range of floats"
    ):
        ddmhe.Zonotope([0.0], [[1e308, 1e308]]).reduce(1, "pca")
    with pytest.raises(ddmhe.DdmheError, match="A: expected a result within the range of floats"):
        Z.linear_map(1e200 * np.eye(2))


# --- the observer


def linear_observer(A, C, w, v, start, radius, method, size=1.0):
    n = len(A)
    zero = np.zeros((n, n))
    s = interval.System(A, C, np.eye(n), np.eye(len(C)), None, None, zero, zero)
    try:
        design = interval.design_observer(s, 0.3)
    except ddmhe.InfeasibleError:
        design = interval.fixed_gain(s, np.zeros((n, len(C))))
    return interval.IntervalObserver(s, design, start, radius, w, v, order=3 * n, method=method)


@pytest.mark.parametrize("size", [1e-310, 1e-200, 1e-170, 1.0, 1e150, 1e200, 1e290])
@pytest.mark.parametrize("method", ["tight", "paper"])
def test_the_observer_holds_an_exactly_computed_motion_in_any_unit(method, size):
    """Extreme disturbances in rational arithmetic; only y is a float, its rounding part of v."""
    rng = np.random.default_rng(5)
    A, C = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.5]])
    bound = 0.01 * size
    o = linear_observer(A, C, bound, bound, [size, -size], 0.1 * size, method)
    for _ in range(10):
        o.reset()
        x = exact([size, -size]) + exact(0.1 * size) * exact(rng.choice([-1, 1], 2))
        for _ in range(25):
            y = float((exact(C) @ x)[0] + Fraction(bound) * Fraction(0.9 * rng.choice([-1, 1])))
            if abs((exact(C) @ x)[0] - Fraction(y)) > Fraction(bound):
                y = float((exact(C) @ x)[0])
            e, now = o.step([y]), x
            x = exact(A) @ x + Fraction(bound) * exact(rng.choice([-1, 1], 2))
            for found, state in (
                ((e.lower, e.upper), x),
                (e.ball, x),
                (e.ellipsoid, x),
                (e.filtered, now),
            ):
                assert np.isfinite(found).all()
                for lo, value, hi in zip(found[0], state, found[1], strict=True):
                    assert Fraction(lo) <= value <= Fraction(hi)


@pytest.mark.parametrize("size", [1e-300, 1e-170, 1e160, 1e300])
def test_the_peak_to_peak_bound_scales_with_the_unit(size):
    """No level underflows: the bound in one unit is that in another."""
    A, C = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.5]])
    for method in ("paper", "tight"):
        logs = []
        for unit in (1.0, size):
            o = linear_observer(A, C, 0.01 * unit, 0.01 * unit, [unit, 0.0], 0.1 * unit, method)
            logs.append(
                [
                    np.array(side) / unit
                    for side in (*o.run(np.zeros((1, 1))).ball, *o.run(np.zeros((1, 1))).ellipsoid)
                ]
            )
        np.testing.assert_allclose(logs[1], logs[0], rtol=1e-9)


def observer_at_the_edge(rng):
    n, p = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    given = [edges(rng, *shape) for shape in ((n, n), (p, n), (n, 1), (p, 1))]
    s = interval.System(*given, None, None, np.zeros((n, n)), np.zeros((n, n)))
    design = interval.fixed_gain(s, edges(rng, n, p))
    radii = [np.abs(edges(rng, k)) for k in (n, 1, 1)]
    method, reduction = rng.choice(["tight", "paper"]), rng.choice(["pca", "girard", "combastel"])
    return interval.IntervalObserver(
        s, design, edges(rng, n), *radii, n + 1, str(method), str(reduction)
    )


def test_the_observer_answers_or_errs_at_the_edge():
    rng = np.random.default_rng(6)
    steps = 0
    for trial in range(300):
        o = answer(observer_at_the_edge, rng)
        for _ in range(6 if o else 0):
            before, p = o.bounds, o.system.p
            e = answer(o.step, np.where(rng.random(p) < 0.3, np.nan, edges(rng, p)))
            if e is None:
                np.testing.assert_array_equal(o.bounds, before)
                continue
            steps += 1
            for lo, hi in ((e.lower, e.upper), e.filtered, e.ball, e.ellipsoid):
                assert (lo <= hi).all(), trial  # so none is NaN
    assert steps > 300


def test_a_run_ends_at_a_violation_and_keeps_what_it_had():
    s = interval.pendulum()
    design = interval.fixed_gain(s, [[1.5], [7.7]])

    def make():
        return interval.IntervalObserver(s, design, [0.98, 0.02], [0.1, 1.0], 0.006, 0.01)

    Y = 1.0 - 0.002 * np.arange(20.0)[:, None] ** 2
    o, whole = make(), make().run(Y[:12])
    assert whole.violation is None
    assert len(whole) == 12
    Y[12] = 9.0
    log = o.run(Y)
    assert len(log) == len(log.lower) == len(log.ball[0]) == len(log.filtered[1]) == 12
    np.testing.assert_array_equal([log.lower, log.upper], [whole.lower, whole.upper])
    assert isinstance(log.violation, ddmhe.ModelViolationError)
    assert "step 12 leaves state 1" in str(log.violation)
    assert "violation" in repr(log)
    # the observer stands before that sample: the same again, or on without it
    with pytest.raises(ddmhe.ModelViolationError, match="step 12"):
        o.step(Y[12])
    assert len(o.run(Y[12:])) == 0
    Y[12] = np.nan
    rest = o.run(Y[12:])
    np.testing.assert_array_equal(rest.upper, make().run(Y).upper[12:])
