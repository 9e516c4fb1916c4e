"""The mixed-monotone observer of Tahir, against which the zonotope is measured."""

import numpy as np
import pytest

import ddmhe
from ddmhe import interval
from ddmhe.baselines import TahirIntervalObserver
from pendulum_case import KINDS, RADIUS, START, V, W, outside, trajectory


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
