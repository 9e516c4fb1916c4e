"""Arrays as people have them: without a second dimension, transposed, bounds as SciPy has them.
They are taken, or asked about."""

import numpy as np
import pytest
import scipy.optimize

import ddmhe
from reference import random_system

RNG = np.random.default_rng(4)


def recorded(n, p, T=60):
    x, y = random_system(RNG, n, p).simulate(RNG.standard_normal(n), T + 20)
    return x + 1e-3 * RNG.standard_normal(x.shape), y


def test_one_channel_needs_no_second_dimension():
    x, y = recorded(1, 1)
    u = RNG.standard_normal(60)
    flat = ddmhe.History(x[:61, 0], y[:60, 0], u=u)
    assert flat == ddmhe.History(x[:61], y[:60], u=u[:, None])
    h = ddmhe.History(x[:61], y[:60])
    known = ddmhe.DdMhe(h).run(y[60:])
    assert ddmhe.DdMhe(h).run(y[60:, 0]) == known
    assert ddmhe.run_many([h], [y[60:, 0]])[0] == known
    driven = ddmhe.DdMhe(flat).run(y[60:, 0], u[:20])
    assert driven == ddmhe.DdMhe(flat).run(y[60:], u[:20, None])


def test_several_channels_do():
    x, y = recorded(2, 2)
    est = ddmhe.DdMhe(ddmhe.History(x[:61], y[:60]))
    with pytest.raises(ddmhe.ShapeError, match=r"^Y: expected a 2-D array \(N, p\)"):
        est.run(y[60])


@pytest.mark.parametrize(("n", "p"), [(2, 1), (3, 3), (1, 2)])
def test_transposed_arrays_are_asked_about(n, p):
    x, y = recorded(n, p)
    with pytest.raises(ddmhe.ShapeError, match="which look transposed"):
        ddmhe.History(x[:61].T, y[:60].T)
    with pytest.raises(ddmhe.ShapeError, match=r"^y: .*transposed beside the other: y\.T"):
        ddmhe.History(x[:61], y[:60].T)
    with pytest.raises(ddmhe.ShapeError, match=r"^x: .*transposed beside the other: x\.T"):
        ddmhe.History(x[:61].T, y[:60])
    if p > 1:
        est = ddmhe.DdMhe(ddmhe.History(x[:61], y[:60]))
        with pytest.raises(ddmhe.ShapeError, match=r"^Y: expected .* looks transposed"):
            est.run(y[60:].T)


def test_pairs_of_bounds_one_a_state():
    x, y = recorded(3, 2)
    h = ddmhe.History(x[:61], y[:60])
    pairs = [(-0.1, 0.2), (-0.3, 0.4), (-np.inf, 0.5)]
    lo, hi = np.transpose(pairs)
    same = ddmhe.DdMhe(h, x_bounds=(lo, hi)).run(y[60:])
    assert ddmhe.DdMhe(h, x_bounds=pairs).run(y[60:]) == same
    one, other = ddmhe.DdMhe(h), ddmhe.DdMhe(h)
    assert one.step(y[60], x_bounds=pairs) == other.step(y[60], x_bounds=(lo, hi))
    assert ddmhe.DdMhe(h, x_bounds=[*pairs[:2], (None, 0.5)]).run(y[60:]) == same


def test_bounds_as_scipy_s_optimisers_take_them():
    x, y = recorded(3, 2)
    h = ddmhe.History(x[:61], y[:60])
    lo, hi = np.array([-0.1, -0.3, -np.inf]), np.array([0.2, 0.4, 0.5])
    same = ddmhe.DdMhe(h, x_bounds=(lo, hi)).run(y[60:])
    assert ddmhe.DdMhe(h, x_bounds=scipy.optimize.Bounds(lo, hi)).run(y[60:]) == same
    above = ddmhe.DdMhe(h, x_bounds=(-np.inf, 0.1)).run(y[60:])
    assert above == ddmhe.DdMhe(h, x_bounds=scipy.optimize.Bounds(ub=0.1)).run(y[60:])
    assert above.x.max() <= 0.1 + 1e-12


def test_two_pairs_can_be_read_in_two_ways():
    x, y = recorded(2, 2)
    h = ddmhe.History(x[:61], y[:60])
    with pytest.raises(ddmhe.ShapeError, match=r"two ways; .* \(\[-1.0, 0.0\], \[1.0, 2.0\]\)"):
        ddmhe.DdMhe(h, x_bounds=[(-1, 1), (0, 2)])
    # as a settings file has them, and as arrays: (lo, hi)
    for bounds in ([[-1, -1], [1, 2]], (np.array([-1, -1]), np.array([1, 2])), ((-1, -1), (1, 2))):
        ddmhe.DdMhe(h, x_bounds=bounds)
