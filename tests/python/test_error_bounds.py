"""Error bounds of certified estimators by simulation: where there is one, and where none."""

import numpy as np
import pytest

import ddmhe
from ddmhe.config import read_config, write_config
from ddmhe.design import (
    Certificate,
    ioss,
    scalar_certificate,
)
from reference import random_system


def disturbed(system, rng, x_0, steps, w, v):
    """States (steps+1, n) and outputs (steps, p) with ‖w(t)‖ <= w, ‖v(t)‖ <= v, random or in one
    direction all the
    time."""
    n, p = len(system.e), len(system.r)

    def ball(size, dimension):
        directions = rng.standard_normal((steps, dimension))
        if rng.random() < 0.5:
            directions[:] = directions[0]
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        return size * directions / lengths * (rng.random((steps, 1)) if rng.random() < 0.3 else 1.0)

    W, V = ball(w, n), ball(v, p)
    x = [x_0]
    for k in range(steps):
        x.append(system.A @ x[-1] + system.e + W[k])
    x = np.array(x)
    return x, x[:-1] @ system.C.T + system.r + V


def noisy_copy(rng, x, y, size):
    return ddmhe.History(
        x + size * rng.standard_normal(x.shape), y + size * rng.standard_normal(y.shape)
    )


SPACES = ["auto", ddmhe.Exact(), ddmhe.Truncated(), ddmhe.Ridge(1e-2, normalised=True)]


@pytest.mark.parametrize("seed", range(25))
def test_errors_never_exceed_either_bound(seed):
    """400 trajectories of each of 25 systems, n 1…5: 10 000 in all, not one violation."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 5
    system = random_system(rng, n, 1 + (seed // 5) % 4)
    h = ddmhe.History(*system.simulate(rng.standard_normal(n), 60))
    c = ioss(h, float(rng.choice([0.6, 0.8, 0.9])))
    initial, w, v = 0.5, float(rng.choice([0.0, 0.02])), float(rng.choice([0.0, 0.1]))
    estimator = ddmhe.DdMhe(
        h, c.horizon + seed % 3, space=ddmhe.Exact(), certificate=c, disturbance=(initial, w, v)
    )
    prior_bound = c.error_bound(30, estimator.horizon, initial, w, v)
    for _ in range(400):
        x_0, offset = rng.standard_normal(n), rng.standard_normal(n)
        x, y = disturbed(system, rng, x_0, 30, w, v)
        estimator.reset(x_0 + initial * offset / np.linalg.norm(offset))
        log = estimator.run(y)
        error = np.linalg.norm(log.x - x[1:], axis=1)
        assert (error <= log.bound * (1 + 1e-9) + 1e-9).all()
        assert (log.bound <= prior_bound[1:] * (1 + 1e-6) + 1e-8).all()


def test_halving_the_weights_breaks_the_bound():
    """An unstable system with its own R and P: the certificate that claims to do with a thousandth
    of R promises too
    little."""
    A, C = np.array([[1.2]]), np.array([[1.0]])
    c = ioss(A=A, C=C, eta=0.5)
    false = Certificate(c.P, c.Q, c.R * 1e-3, c.eta, 0.0)
    assert false.verify(A, C) > 0
    x = 1.2 ** np.arange(31.0)[:, None]
    h = ddmhe.History(x, x[:-1])
    error, bound = [], []
    for claim in (c, false):
        estimator = ddmhe.DdMhe(
            h, 3, space=ddmhe.Exact(), certificate=claim, disturbance=(0.5, 0.0, 0.01)
        )
        truth = 1.2 ** np.arange(21.0)[:, None]
        estimator.reset([1.5])
        log = estimator.run(truth[:-1] + 0.01)
        error.append(np.abs(log.x - truth[1:])[:, 0])
        bound.append(log.bound)
    assert (error[0] <= bound[0]).all()
    assert (error[1] > bound[1]).any()


def test_bounds_grow_with_everything_they_are_made_of():
    rng = np.random.default_rng(0)
    system = random_system(rng, 3, 2)
    h = ddmhe.History(*system.simulate(rng.standard_normal(3), 60))
    c = ioss(h, 0.8)
    _, y = disturbed(system, rng, rng.standard_normal(3), 30, 0.01, 0.05)

    def both(*sizes):
        log = ddmhe.DdMhe(h, space=ddmhe.Exact(), certificate=c, disturbance=sizes).run(y)
        return np.concatenate([log.bound, c.error_bound(30, 8, *sizes)])

    base = both(0.5, 0.01, 0.05)
    for larger in ((0.6, 0.01, 0.05), (0.5, 0.02, 0.05), (0.5, 0.01, 0.06)):
        assert (both(*larger) >= base - 1e-9).all()
        assert (both(*larger) > base).any()


def test_without_disturbances_the_error_vanishes_at_the_promised_rate():
    rng = np.random.default_rng(1)
    system = random_system(rng, 3, 1)
    h = ddmhe.History(*system.simulate(rng.standard_normal(3), 60))
    c = ioss(h, 0.7)
    bound = c.error_bound(400, c.horizon + 1, 1.0, 0.0, 0.0)
    kappa = 4 * 0.7 ** (c.horizon + 1)
    assert bound[-1] == pytest.approx(bound[400 - 5 * (c.horizon + 1)] * kappa**2.5, rel=1e-4)
    x, y = system.simulate(rng.standard_normal(3), 400)
    estimator = ddmhe.DdMhe(h, c.horizon + 1, space=ddmhe.Exact(), certificate=c)
    estimator.reset(x[0] + np.array([0.6, 0.0, -0.8]))
    assert (np.linalg.norm(estimator.run(y).x - x[1:], axis=1) <= bound[1:]).all()
    assert bound[-1] < 1e-6


def test_a_lost_output_is_bridged_by_the_growth():
    rng = np.random.default_rng(2)
    system = random_system(rng, 2, 2)
    h = ddmhe.History(*system.simulate(rng.standard_normal(2), 60))
    c = ioss(h, 0.8)
    x_0 = rng.standard_normal(2)
    x, y = disturbed(system, rng, x_0, 40, 0.01, 0.05)
    y[10:13] = np.nan
    y[20, 0] = np.nan
    estimator = ddmhe.DdMhe(
        h, space=ddmhe.Exact(), x_prior=x_0, certificate=c, disturbance=(0.0, 0.01, 0.05)
    )
    log = estimator.run(y)
    assert np.isfinite(log.bound).all()
    assert (np.linalg.norm(log.x - x[1:], axis=1) <= log.bound).all()


def test_a_snapshot_carries_the_bound():
    rng = np.random.default_rng(2)
    system = random_system(rng, 2, 1)
    h = ddmhe.History(*system.simulate(rng.standard_normal(2), 60))
    _, y = disturbed(system, rng, rng.standard_normal(2), 30, 0.01, 0.05)
    one = ddmhe.DdMhe(h, certificate=ioss(h, 0.8), disturbance=(0.5, 0.01, 0.05))
    one.run(y[:15])
    two = ddmhe.DdMhe.restore(one.snapshot())
    np.testing.assert_array_equal(one.run(y[15:]).bound, two.run(y[15:]).bound)


def test_matrix_weights_solve_the_stated_problem():
    """min 2η^M‖x - x̄‖²_P + Σ η^{j-1}‖v‖²_R over the true model by dense least squares, outputs
    missing here and
    there."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        system = random_system(rng, 3, 2)
        h = ddmhe.History(*system.simulate(rng.standard_normal(3), 60))
        c = ioss(h, 0.6)
        estimator = ddmhe.DdMhe(h, 4, space=ddmhe.Exact(), certificate=c)
        _, y = disturbed(system, rng, rng.standard_normal(3), 4, 0.01, 0.1)
        y[2, 0] = np.nan
        prior = rng.standard_normal(3)
        estimator.reset(prior)
        for sample in y:
            estimate = estimator.step(sample)
        rows, target = (
            [np.linalg.cholesky(2 * 0.6**4 * c.P).T],
            [np.linalg.cholesky(2 * 0.6**4 * c.P).T @ prior],
        )
        power, offset = np.eye(3), np.zeros(3)
        for k in range(4):
            seen = np.isfinite(y[k])
            # a free entry of v leaves the marginal precision of the others
            weight = np.linalg.inv(np.linalg.inv(c.R)[np.ix_(seen, seen)])
            U = np.linalg.cholesky(0.6 ** (3 - k) * weight).T
            rows.append(U @ (system.C @ power)[seen])
            target.append(U @ (y[k] - system.C @ offset - system.r)[seen])
            power, offset = system.A @ power, system.A @ offset + system.e
        F, f = np.vstack(rows), np.concatenate(target)
        x_0 = np.linalg.lstsq(F, f, rcond=None)[0]
        np.testing.assert_allclose(estimate.window[0], x_0, atol=1e-7)
        np.testing.assert_allclose(estimate.x, power @ x_0 + offset, atol=1e-7)
        assert estimate.cost == pytest.approx(np.sum((F @ x_0 - f) ** 2), rel=1e-5, abs=1e-9)


def test_34_as_printed_is_too_small():
    """x⁺ = 0.9 x + w, y = 100 x, L = -0.009: μ0 = 6 L² = 4.9e-4. w(t-1) is in no output up to t-1,
    so the error
    reaches |w|, but
    (34) allows √μ |w| per step and decays at once. Our bound holds.
    """
    A, C, L = np.array([[0.9]]), np.array([[100.0]]), np.array([[-0.009]])
    rho, mu, M, w = 0.1, 1e-3, 1, 0.1
    assert 6 * (A + L @ C)[0, 0] ** 2 <= rho
    assert 6 * L[0, 0] ** 2 <= mu
    x = 0.9 ** np.arange(31.0)[:, None]
    h = ddmhe.History(x, x[:-1] @ C.T)
    truth = [np.array([1.0])]
    for _ in range(20):
        truth.append(A @ truth[-1] + w)
    truth = np.array(truth)
    c = scalar_certificate(A, C, L, rho, mu)
    estimator = ddmhe.DdMhe(
        h, M, certificate=c, disturbance=(0.0, w, 0.0), x_prior=[1.0], space=ddmhe.Exact()
    )
    log = estimator.run(truth[:-1] @ C.T)
    error = np.abs(log.x - truth[1:])[:, 0]
    kappa = 4 * rho**M
    printed = np.array(
        [
            sum(np.sqrt(kappa) ** (t - 1 - j) * np.sqrt(mu) * w for j in range(t))
            for t in range(1, 21)
        ]
    )
    assert (error > printed).all()
    assert (error <= log.bound).all()
    assert (error <= c.error_bound(20, M, 0.0, w, 0.0)[1:]).all()


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=() if k % 4 == 0 else pytest.mark.long) for k in range(12)]
)
def test_bounds_over_noisy_recordings_hold_where_they_are_given(seed):
    """Every kind of certificate over recordings with noise: with the true model never exceeded,
    else there is none."""
    rng = np.random.default_rng(seed)
    n, p = 1 + seed % 3, 1 + (seed // 3) % 3
    system = random_system(rng, n, p)
    x, y = system.simulate(rng.standard_normal(n), 150)
    given = np.zeros(3, dtype=int)
    for size in (1e-10, 1e-6, 1e-3, 0.05):
        h = noisy_copy(rng, x, y, size)
        bare = ioss(A=system.A, C=system.C, eta=0.9)
        full = ioss(A=system.A, C=system.C, e=system.e, r=system.r, eta=0.9)
        fitted = ioss(h, 0.9)
        assert fitted.identified
        np.testing.assert_array_equal(full.P, bare.P)
        for space in SPACES:
            initial, w, v = 0.2, 0.01, 0.05
            x_0 = rng.standard_normal(n)
            truth, outputs = disturbed(system, rng, x_0, 100, w, v)
            outputs[40:43] = np.nan
            offset = rng.standard_normal(n)
            prior = x_0 + initial * offset / np.linalg.norm(offset)
            for k, c in enumerate((bare, full, fitted)):
                estimator = ddmhe.DdMhe(
                    h, space=space, x_prior=prior, certificate=c, disturbance=(initial, w, v)
                )
                log = estimator.run(outputs)
                said = [
                    words
                    for words in estimator.warnings
                    if words.startswith("certificate: no error bound")
                ]
                assert (log.bound is None) == (len(said) == 1)
                if log.bound is not None:
                    given[k] += 1
                    error = np.linalg.norm(log.x - truth[1:], axis=1)
                    assert (error <= log.bound * (1 + 1e-9) + 1e-9).all()
                else:
                    assert estimator.estimate.bound is None
                    assert (
                        "e and r with A and C" if k == 0 else "state the recording's noise"
                    ) in said[0]
    assert list(given) == [0, 16, 0]


@pytest.mark.parametrize("seed", range(8))
def test_offsets_are_read_off_a_recording_without_noise(seed):
    """A known (A, C) alone: the recording is its trajectory, so there is a bound, far from zero as
    near it."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    system = random_system(rng, n, 2)
    for far in (0.0, 1e3):
        moved = type(system)(system.A, system.e + far, system.C, system.r - far)
        rest = np.linalg.solve(np.eye(n) - moved.A, moved.e)
        x_0 = rest + rng.standard_normal(n)
        h = ddmhe.History(*moved.simulate(x_0, 80))
        truth, outputs = disturbed(moved, rng, x_0, 60, 0.01, 0.05)
        c = ioss(A=system.A, C=system.C, eta=0.8)
        estimator = ddmhe.DdMhe(h, x_prior=x_0, certificate=c, disturbance=(0.0, 0.01, 0.05))
        log = estimator.run(outputs)
        assert (np.linalg.norm(log.x - truth[1:], axis=1) <= log.bound).all()
        # of another system than the recorded one: its windows are none of its trajectories
        other = ioss(A=system.A * 0.99, C=system.C, eta=0.8)
        estimator = ddmhe.DdMhe(h, x_prior=x_0, certificate=other, disturbance=(0.0, 0.01, 0.05))
        assert estimator.run(outputs).bound is None


def test_a_certificate_without_a_model_needs_a_recording_without_noise():
    rng = np.random.default_rng(0)
    x, y = random_system(rng, 2, 2).simulate(rng.standard_normal(2), 60)
    c = ioss(ddmhe.History(x, y), 0.8)
    assert not c.identified
    bare = Certificate(c.P, c.Q, c.R, c.eta, c.residual)
    for h, bounded in ((ddmhe.History(x, y), True), (noisy_copy(rng, x, y, 1e-6), False)):
        estimator = ddmhe.DdMhe(h, certificate=bare, disturbance=(0.1, 0.01, 0.01))
        assert (estimator.warnings == []) == bounded
        assert (estimator.step(y[0]).bound is not None) == bounded


def test_no_bound_in_advance_from_a_model_of_a_noisy_recording(tmp_path):
    rng = np.random.default_rng(0)
    x, y = random_system(rng, 2, 2).simulate(rng.standard_normal(2), 60)
    c = ioss(noisy_copy(rng, x, y, 1e-3), 0.8)
    assert "no error bound follows" in c.words
    with pytest.raises(ddmhe.DdmheError, match="certificate: expected one of a known system"):
        c.error_bound(10, 10, 0.1, 0.0, 0.0)
    write_config(tmp_path / "c.toml", {"certificate": c})
    assert read_config(tmp_path / "c.toml")["certificate"].identified


def test_the_estimator_checks_its_certificate():
    x = np.random.default_rng(0).standard_normal((30, 2))
    h = ddmhe.History(x, x[:-1, :1])
    good = Certificate(np.eye(2), 2 * np.eye(2), np.eye(1), 0.5, 0.0)
    cases = [
        (dict(certificate=good, rho=0.9), "rho: expected none beside a certificate"),
        (dict(certificate=good, mu=1.0), "mu: expected none beside a certificate"),
        (dict(certificate=good, horizon=2), "horizon: expected at least 3"),
        (dict(disturbance=(0.0, 0.0, 0.0)), "disturbance: expected a certificate"),
        (dict(certificate=good, disturbance=(0.0, -1.0, 0.0)), "disturbance: expected a finite w"),
        (dict(certificate=good, disturbance=1.0), "disturbance: expected three numbers"),
        (dict(certificate="c"), "certificate: expected a ddmhe.design.Certificate"),
        (
            dict(certificate=Certificate(-np.eye(2), np.eye(2), np.eye(1), 0.5, 0.0)),
            "symmetric positive definite P",
        ),
        (
            dict(certificate=Certificate(np.eye(3), np.eye(2), np.eye(1), 0.5, 0.0)),
            "certificate: expected a matrix",
        ),
        (dict(certificate=Certificate(np.eye(2), np.eye(2), np.eye(1), 1.5, 0.0)), "eta in"),
    ]
    for arguments, message in cases:
        with pytest.raises(ddmhe.DdmheError, match=message):
            ddmhe.DdMhe(h, **arguments)
