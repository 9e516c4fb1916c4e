"""Algorithm 2 as printed where it can work, and its limits where it cannot."""

import numpy as np
import pytest

import ddmhe
from ddmhe.design import Cone, Disc, HalfPlane, pole_placement


def full_output_system(rng, n=3):
    """A with spectral radius 0.95 and a square C that is well conditioned: rank C = n, so that (24)
    is possible."""
    A = rng.standard_normal((n, n))
    C = np.linalg.qr(rng.standard_normal((n, n)))[0] * rng.uniform(0.5, 2.0, n)
    return A * 0.95 / np.abs(np.linalg.eigvals(A)).max(), C


@pytest.mark.parametrize("seed", range(8))
def test_with_a_known_system_of_full_output_rank(seed):
    A, C = full_output_system(np.random.default_rng(seed))
    design = pole_placement(A=A, C=C, radius=0.6)
    closed = A + design.gain @ C
    assert design.feasible
    assert design.certified
    assert design.agree
    assert np.abs(np.linalg.eigvals(closed)).max() < design.radius
    assert 6 * np.linalg.norm(closed, 2) ** 2 == pytest.approx(design.rho0, rel=1e-6)
    assert design.rho0 < 1
    assert 6 * np.linalg.norm(design.gain, 2) ** 2 == pytest.approx(design.mu0, rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_noise_that_just_fills_the_rank(seed):
    """n + p columns of differences and noise of 1e-6: the printed way works, as the true system
    confirms."""
    rng = np.random.default_rng(seed)
    A, C = full_output_system(rng)
    x = [rng.standard_normal(3)]
    for _ in range(7):
        x.append(A @ x[-1] + 1e-6 * rng.standard_normal(3))
    x = np.array(x)
    design = pole_placement(ddmhe.History(x, x[:-1] @ C.T + 1e-6 * rng.standard_normal((7, 3))))
    assert design.rank == design.required_rank == 6
    assert design.feasible
    closed = A + design.gain @ C
    assert np.abs(np.linalg.eigvals(closed)).max() < design.radius
    assert 6 * np.linalg.norm(closed, 2) ** 2 == pytest.approx(design.rho0, rel=1e-3)
    assert 6 * np.linalg.norm(closed, 2) ** 2 < 1


def test_more_noisy_columns_make_the_printed_numbers_mean_nothing():
    """The optimum is A_L = 0, L = 0 for any system: ρ0 and μ0 are rounding, like the paper's
    1.3e-19 and 3.3e-14."""
    rng = np.random.default_rng(0)
    A, C = full_output_system(rng)
    x = [rng.standard_normal(3)]
    for _ in range(60):
        x.append(A @ x[-1] + 0.1 * rng.standard_normal(3))
    x = np.array(x)
    design = pole_placement(ddmhe.History(x, x[:-1] @ C.T + 0.01 * rng.standard_normal((60, 3))))
    assert design.rho0 < 1e-12
    assert design.mu0 < 1e-12
    assert not design.agree
    assert not design.certified
    assert "whatever the system is" in design.words
    assert design.rho0_identified == pytest.approx(6 * np.linalg.norm(A, 2) ** 2, rel=0.1)


def test_the_papers_satellite_cannot_meet_24():
    """C = f(ω x B) has kernel B, where A is nearly the identity: ρ0 >= 6.01 for every gain, at
    every sampling time."""
    record = ddmhe.models.detumbling().simulate(20.0, 0.1)
    B = np.array([41.0, 51.0, -41.0]) / np.linalg.norm([41.0, 51.0, -41.0])
    design = pole_placement(ddmhe.History(record.x, record.y[:-1], dt=0.1))
    assert design.output_rank == 2
    assert design.lower_bound > 5.9
    assert not design.certified
    assert not design.agree
    assert "(24) is impossible" in design.words
    # the Jacobian of the true motion at its start, by central differences: an independent A
    model = ddmhe.models.detumbling()
    ahead = lambda x: x + 0.1 * model.derivative(x)  # noqa: E731
    steps = np.eye(3) * 1e-6
    A = np.array([(ahead(model.omega_0 + s) - ahead(model.omega_0 - s)) / 2e-6 for s in steps]).T
    C = np.array(
        [(model.output(model.omega_0 + s) - model.output(model.omega_0 - s)) / 2e-6 for s in steps]
    ).T
    assert np.linalg.norm(C @ B) < 1e-6 * np.linalg.norm(C)
    exact = pole_placement(A=A, C=C)
    assert not exact.certified
    assert exact.lower_bound == pytest.approx(6 * np.linalg.norm(A @ B) ** 2, rel=1e-6)
    assert exact.lower_bound == pytest.approx(6.01, abs=0.01)


def test_noise_free_data_leave_one_gain():
    """Rank n < n + p: (44) fails, and the words say so."""
    rng = np.random.default_rng(4)
    A, C = full_output_system(rng)
    x = [rng.standard_normal(3)]
    for _ in range(12):
        x.append(A @ x[-1])
    x = np.array(x)
    design = pole_placement(ddmhe.History(x, x[:-1] @ C[:2].T))
    assert design.rank < design.required_rank == 5
    assert "(44) fails" in design.words
    assert not design.certified


@pytest.mark.parametrize(
    ("region", "inside"),
    [
        (Disc(0.2, centre=0.3), lambda z: abs(z - 0.3) < 0.2),
        (HalfPlane(-0.1), lambda z: z.real < -0.1),
        (HalfPlane(0.05, right=True), lambda z: z.real > 0.05),
        (Cone(0.5), lambda z: abs(np.angle(z)) < 0.5),
        (Cone(0.5, apex=0.2, right=False), lambda z: abs(np.angle(0.2 - z)) < 0.5),
    ],
)
def test_regions_hold_the_poles_and_nothing_else(region, inside):
    A, C = full_output_system(np.random.default_rng(7))
    design = pole_placement(A=A, C=C, region=region)
    assert all(inside(z) for z in np.linalg.eigvals(A + design.gain @ C))
    L, M = region.matrices()
    for z in np.random.default_rng(0).uniform(-1, 1, (200, 2)) @ [1, 1j]:
        assert (np.linalg.eigvalsh(L + z * M + np.conj(z) * M.T)[-1] < 0) == inside(z)


def test_the_disc_is_the_block_54():
    """[[-r S, Y], [Yᵀ, -r S]] written out is L ⊗ S + M ⊗ Y + Mᵀ ⊗ Yᵀ of the disc."""
    rng = np.random.default_rng(0)
    S, Y, r = np.eye(2) * 3, rng.standard_normal((2, 2)), 0.7
    L, M = Disc(r).matrices()
    block = np.kron(L, S) + np.kron(M, Y) + np.kron(M.T, Y.T)
    np.testing.assert_array_equal(block, np.block([[-r * S, Y], [Y.T, -r * S]]))


@pytest.mark.parametrize("seed", range(10))
def test_no_nan_leaves(seed):
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    x = rng.standard_normal((n + p + 12, n)) * 10.0 ** rng.uniform(-6, 6, n)
    y = rng.standard_normal((n + p + 11, p))
    if seed % 2:
        y[:] = y[:, :1]
    design = pole_placement(ddmhe.History(x, y))
    for name in ("rho0", "mu0", "beta", "rho0_identified", "lower_bound"):
        assert not np.isnan(getattr(design, name))
    for name in ("poles", "poles_identified", "singular_values"):
        assert np.isfinite(getattr(design, name)).all()


def test_errors_name_the_argument():
    A, C = np.diag([0.9, 0.5]), np.array([[1.0, 1.0]])
    x = np.random.default_rng(0).standard_normal((4, 2))
    cases = [
        (dict(A=A, C=C, radius=1.0), "radius: expected a number in"),
        (dict(A=A, C=C, radius=0.0), "radius: expected a number in"),
        (dict(A=A, C=C, Q=-np.eye(2)), "Q: expected a positive definite matrix"),
        (dict(A=A, C=C, R=np.eye(2)), "R: expected shape"),
        (dict(A=A, C=C, Q=np.array([[1.0, 0.5], [0.0, 1.0]])), "Q: expected a symmetric matrix"),
        (dict(A=A, C=C[:, :1]), "C: expected a matrix with 2 columns"),
        (dict(A=A[0], C=C), "A: expected a square matrix"),
        (dict(A=A * np.nan, C=C), "A: expected finite numbers"),
        (dict(A=A), "A, C: expected both"),
        (dict(), "history: expected either a recording or A and C"),
        (
            dict(history=ddmhe.History(x, x[:-1, :1]), A=A, C=C),
            "history: expected either a recording or A and C",
        ),
        (dict(history=ddmhe.History(x, x[:-1, :1])), "history: expected at least n"),
        (dict(A=A, C=np.array([[1.0, 0.0]])), "A, C: expected an observable pair"),
        (dict(A=A, C=C, attempts=0), "attempts: expected at least 1"),
    ]
    for arguments, message in cases:
        with pytest.raises(ddmhe.DdmheError, match=message):
            pole_placement(**arguments)
    with pytest.raises(ddmhe.DdmheError, match="angle: expected an angle"):
        Cone(2.0)
