"""The paper in one call: where its theorem applies, by simulation, and where it does not."""

import numpy as np
import pytest

import ddmhe
from ddmhe.design import algorithm1, minimum_horizon
from driven import Driven, recorded, spheres
from reference import largest_eigenvalue


def full_output_system(rng, n=3, m=2):
    """Spectral radius 0.95 and a well-conditioned square C: (24) is possible."""
    A = rng.standard_normal((n, n))
    C = np.linalg.qr(rng.standard_normal((n, n)))[0] * rng.uniform(0.5, 2.0, n)
    A = A * 0.95 / np.abs(np.linalg.eigvals(A)).max()
    B, D = rng.standard_normal((n, m)), rng.standard_normal((n, m))
    return Driven(A, B, rng.standard_normal(n), C, D, rng.standard_normal(n))


def history(system, rng, steps=60, noise=0.0):
    """A recording of it, with known inputs where it has some."""
    if system.B.shape[1]:
        return recorded(system, rng, steps, noise, noise)
    x, y = system.simulate(rng.standard_normal(len(system.e)), np.zeros((steps, 0)))
    x, y = x + spheres(rng, steps + 1, x.shape[1], noise), y + spheres(rng, steps, len(y[0]), noise)
    return ddmhe.History(x, y)


@pytest.mark.parametrize("m", [0, 2])
@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=() if k < 3 else pytest.mark.long) for k in range(6)]
)
def test_where_the_theorem_applies_errors_obey_it(seed, m):
    """An exact recording of a system whose C has rank n: errors stay below the bound of each
    estimate, that below the one known in advance, and both shrink as (33) promises."""
    rng = np.random.default_rng(seed)
    system = full_output_system(rng, m=m)
    sizes = (0.5, 0.01, 0.05)
    found = algorithm1(history(system, rng), disturbance=sizes)
    assert found.feasible
    assert found.holds
    assert found.exact
    assert "Theorem 2 applies" in found.words
    assert found.design.rho0 < found.rho < 1
    assert found.design.mu0 < found.mu
    assert found.horizon == minimum_horizon(found.rho) == found.estimator.horizon
    assert found.contraction == pytest.approx(np.sqrt(4 * found.rho**found.horizon))
    assert found.contraction < 1
    # (24) for the true system, in numbers of our own
    closed = system.A + found.design.gain @ system.C
    assert 6 * np.linalg.norm(closed, 2) ** 2 <= found.rho * (1 + 1e-9)
    assert 6 * np.linalg.norm(found.design.gain, 2) ** 2 <= found.mu
    assert largest_eigenvalue(found.certificate, system.A, system.C) <= 1e-9
    prior_bound = found.certificate.error_bound(40, found.horizon, *sizes)
    for _ in range(20):
        x_0, u = rng.standard_normal(3), rng.standard_normal((40, m))
        drive = spheres(rng, 40, 3, sizes[1]), spheres(rng, 40, 3, sizes[2])
        x, y = system.simulate(x_0, u, *drive)
        found.estimator.reset(x_0 + spheres(rng, 1, 3, sizes[0])[0])
        log = found.estimator.run(y, u) if m else found.estimator.run(y)
        error = np.linalg.norm(log.x - x[1:], axis=1)
        assert (error <= log.bound * (1 + 1e-9) + 1e-9).all()
        assert (log.bound <= prior_bound[1:] * (1 + 1e-6) + 1e-8).all()
    quiet = found.certificate.error_bound(40 * found.horizon, found.horizon, 1.0, 0.0, 0.0)
    shrunk = quiet[30 * found.horizon] / quiet[20 * found.horizon]
    assert shrunk == pytest.approx(found.contraction**10, rel=1e-3)


@pytest.mark.parametrize("m", [0, 2])
def test_the_estimator_is_that_of_the_printed_weights(m):
    """(17) with ρ, μ and M, whether the weights come as numbers or as the certificate of (24)."""
    rng = np.random.default_rng(7)
    system = full_output_system(rng, m=m)
    h = history(system, rng)
    u = rng.standard_normal((30, m))
    _, y = system.simulate(rng.standard_normal(3), u)
    run = (y, u) if m else (y,)
    found = algorithm1(h, x_prior=np.zeros(3))
    own = ddmhe.DdMhe(h, found.horizon, found.rho, found.mu, x_prior=np.zeros(3)).run(*run)
    np.testing.assert_array_equal(found.estimator.run(*run).x, own.x)
    bounded = algorithm1(h, x_prior=np.zeros(3), disturbance=(2.0, 0.0, 0.0)).estimator.run(*run)
    np.testing.assert_allclose(bounded.x, own.x, atol=1e-9)


@pytest.mark.parametrize("m", [0, 2])
def test_noise_voids_the_theorem(m):
    rng = np.random.default_rng(3)
    found = algorithm1(
        history(full_output_system(rng, m=m), rng, noise=1e-3), disturbance=(0.1, 0, 0.01)
    )
    assert found.feasible
    assert not found.exact
    assert not found.holds
    assert found.certificate.identified
    assert "Theorem 2 does not apply and no error bound follows" in found.words
    assert "Theorem 2 applies" not in found.words
    assert found.estimator.run(np.zeros((5, 3)), *[np.zeros((5, m))] * (m > 0)).bound is None
    with pytest.raises(ddmhe.DdmheError, match="expected one of a known system"):
        found.certificate.error_bound(5, 5, 0.1, 0.0, 0.0)


def test_the_recordings_own_dual_data_are_used_where_24_holds_with_them():
    """n + p columns and noise of 1e-6: the printed way works, and is taken."""
    rng = np.random.default_rng(0)
    system = full_output_system(rng, m=0)
    found = algorithm1(history(system, rng, 7, 1e-6), horizon=3, rho=0.6)
    assert found.design is found.printed
    assert "Algorithm 2 on the recording's dual data gives" not in found.words
    other = algorithm1(history(system, rng, 60))
    assert other.design is not other.printed
    assert other.words.startswith("Algorithm 2 on the recording's dual data gives no gain")


def test_the_papers_satellite_runs_and_is_promised_nothing():
    """C has rank 2: (24) is impossible whatever Algorithm 2 prints, and the words say so."""
    record = ddmhe.models.detumbling().simulate(20.0, 0.1)
    found = algorithm1(ddmhe.History(record.x, record.y[:-1], dt=0.1))
    assert found.feasible
    assert found.design is found.printed
    assert found.certificate is None
    assert not found.holds
    assert "(24) is impossible" in found.words
    assert "(24) does not hold in the identified system with these weights" in found.words
    later = ddmhe.models.detumbling().simulate(40.0, 0.1)
    log = found.estimator.run(later.y[200:-1])
    assert np.abs(log.x - later.x[201:]).max() < 0.2 * np.abs(later.x).max()


def test_a_rank_of_C_that_is_noise_is_no_rank():
    """An output that shows noise alone: the fitted C has rank n, and any gain would pass there."""
    rng = np.random.default_rng(8)
    full = full_output_system(rng, m=0)
    C = full.C * np.array([[1.0], [1.0], [0.0]])
    found = algorithm1(history(Driven(full.A, full.B, full.e, C, full.D, full.r), rng, noise=1e-3))
    assert np.linalg.matrix_rank(found.model.C) == 3
    assert "(24) is impossible" in found.words
    assert found.design is found.printed
    assert found.certificate is None


def test_without_a_feasible_design_there_is_no_estimator():
    """One output of an exact recording: (44) fails, and (24) is impossible."""
    rng = np.random.default_rng(4)
    full = full_output_system(rng, m=0)
    system = Driven(full.A, full.B, full.e, full.C[:1], full.D[:1], full.r[:1])
    found = algorithm1(history(system, rng))
    assert not found.feasible
    assert not found.holds
    assert (found.rho, found.mu, found.horizon, found.certificate) == (None,) * 4
    assert "No rho in (rho0, 1) exists" in found.words
    assert found.contraction == np.inf
    with pytest.raises(ddmhe.InfeasibleError, match="estimator: expected a feasible Algorithm 2"):
        _ = found.estimator


def test_a_ridge_voids_the_theorem_too():
    rng = np.random.default_rng(5)
    h = history(full_output_system(rng, m=0), rng)
    found = algorithm1(h, space=ddmhe.Ridge(1e-2, normalised=True))
    assert found.exact
    assert not found.holds
    assert "Theorem 2 does not apply; it does with space=Exact()" in found.words
    assert algorithm1(h, space=ddmhe.Exact()).holds


def test_errors_name_the_argument():
    rng = np.random.default_rng(6)
    h = history(full_output_system(rng, m=0), rng)
    design = algorithm1(h).design
    rho_0, mu_0 = design.rho0, design.mu0
    cases = [
        (dict(rho=0.9 * rho_0), r"rho: expected a number in \(rho0, 1\) = \(0\.\d+, 1\), found"),
        (dict(rho=1.0), "rho: expected a number in"),
        (dict(mu=0.9 * mu_0), "mu: expected a number above mu0 = "),
        (dict(rho=0.5, horizon=2), "horizon: expected at least 3, for which 4 rho"),
        (dict(weights="scaled"), "weights: expected none beside Algorithm 1"),
        (dict(certificate=None), "certificate: expected none beside Algorithm 1"),
        (dict(radius=2.0), "radius: expected a number in"),
        (dict(history=np.eye(2)), "history: expected a History"),
        (dict(horizont=3), "horizont"),
    ]
    for arguments, message in cases:
        with pytest.raises((ddmhe.DdmheError, TypeError), match=message):
            algorithm1(**({"history": h} | arguments))
