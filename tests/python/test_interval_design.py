"""Gains of the interval observer and the proof of their bounds."""

import numpy as np
import pytest

from ddmhe import interval


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


@pytest.mark.parametrize("entries", [6, pytest.param(8, marks=pytest.mark.long)])
def test_many_vertices(entries):
    rng = np.random.default_rng(0)
    A = 0.3 * rng.standard_normal((4, 4))
    bound = np.zeros((4, 4))
    bound.ravel()[rng.permutation(16)[:entries]] = 0.05
    s = interval.System(
        A, rng.standard_normal((2, 4)), np.eye(4), np.eye(2), None, None, -bound, bound
    )
    assert len(s.vertices()) == 2**entries
    assert interval.design_observer(s, 0.2).verified
