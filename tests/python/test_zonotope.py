"""Zonotopes from Python."""

import numpy as np
import pytest

import ddmhe


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
