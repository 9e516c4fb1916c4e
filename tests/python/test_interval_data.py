"""Intervals from a recording alone."""

import re

import numpy as np
import pytest
import scipy.optimize

import ddmhe
from ddmhe import interval
from pendulum_case import outside

INF = float("inf")
A_TRUE, C_TRUE = np.array([[0.95, 0.2], [-0.15, 0.9]]), np.array([[1.0, 0.5]])


def affine(rng, x, steps, w, v):
    X, Y = [x], []
    for _ in range(steps):
        Y.append(C_TRUE @ X[-1] + 0.3 + v * rng.uniform(-1, 1, 1))
        X.append(A_TRUE @ X[-1] + [0.1, -0.05] + w * rng.uniform(-1, 1, 2))
    return np.array(X), np.array(Y)


@pytest.mark.parametrize("recordings", [20, pytest.param(60, marks=pytest.mark.long)])
def test_intervals_from_a_recording_hold(recordings):
    widths = []
    for seed in range(recordings):
        rng = np.random.default_rng(seed)
        x, y = affine(rng, np.array([2.0, -1.0]), 60, 0.01, 0.02)
        model = interval.from_history(ddmhe.History(x, y), 0.01, 0.02)
        # the true system is in the set: what its parameters differ by fits into each row's box
        s = model.system
        for i, (row, found) in enumerate(zip([*A_TRUE, *C_TRUE], [*s.A, *s.C], strict=True)):
            G = np.array(s.dynamics.rows[i]).reshape(-1, 3).T
            offset = [0.1, -0.05, 0.3][i] - ([*s.dynamics.offset, *s.offset])[i]
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


def blind():
    """A growing system that no output sees."""
    zero = np.zeros((2, 2))
    given = 2 * np.eye(2), [[0.0, 0.0]], np.eye(2), [[1.0]]
    return interval.System(*given, None, None, zero, zero)


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
            lambda h: interval.kalman_gain(blind(), 1.0, 1.0),
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


def test_inputs_are_refused_in_one_sentence():
    """Intervals from data know no inputs; what these do would pass for motion of the states."""
    rng = np.random.default_rng(0)
    u, x = rng.standard_normal((60, 1)), [np.zeros(2)]
    for k in range(60):
        x.append(np.array([[0.9, 0.1], [-0.1, 0.8]]) @ x[-1] + [0.3, 0.1] * u[k])
    history = ddmhe.History(np.array(x), np.array(x)[:-1, :1], u=u)
    with pytest.raises(ddmhe.DdmheError, match="history: expected a recording without inputs"):
        ddmhe.interval.from_history(history, 1.0, 1.0)
