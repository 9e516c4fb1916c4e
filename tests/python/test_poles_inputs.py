"""Algorithm 2 over recordings with known inputs: what u explains is no motion of A."""

import numpy as np
import pytest

import ddmhe
from ddmhe.design import pole_placement
from driven import Driven, random_driven, recorded


def full_output_system(rng, n=3, m=2):
    """Spectral radius 0.95 and a well-conditioned square C: (24) is possible."""
    A = rng.standard_normal((n, n))
    C = np.linalg.qr(rng.standard_normal((n, n)))[0] * rng.uniform(0.5, 2.0, n)
    A = A * 0.95 / np.abs(np.linalg.eigvals(A)).max()
    B, D = rng.standard_normal((n, m)), rng.standard_normal((n, m))
    return Driven(A, B, rng.standard_normal(n), C, D, rng.standard_normal(n))


@pytest.mark.parametrize("seed", range(8))
def test_noise_that_just_fills_the_rank(seed):
    """n + p + m columns of differences and noise of 1e-6: the gain does in the true (A, C) what the
    data say; with u left out of account it does not."""
    rng = np.random.default_rng(seed)
    system = full_output_system(rng)
    h = recorded(system, rng, 9, x_noise=1e-6, y_noise=1e-6)
    design = pole_placement(h)
    assert design.rank == design.required_rank == 6
    assert design.feasible
    assert not design.arbitrary
    closed = system.A + design.gain @ system.C
    assert np.abs(np.linalg.eigvals(closed)).max() < design.radius
    assert 6 * np.linalg.norm(closed, 2) ** 2 == pytest.approx(design.rho0, rel=1e-2)
    assert design.rho0_identified == pytest.approx(design.rho0, rel=1e-2)
    blind = pole_placement(h.without_inputs())
    closed = system.A + (0.0 if blind.gain is None else blind.gain @ system.C)
    assert 6 * np.linalg.norm(closed, 2) ** 2 != pytest.approx(blind.rho0, rel=0.1)


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=() if k < 6 else pytest.mark.long) for k in range(12)]
)
def test_exact_recordings_leave_the_rank_of_the_free_system(seed):
    """Rank n as (44) has it without inputs; poles and the lower bound are those of the true
    (A, C)."""
    rng = np.random.default_rng(seed)
    n, p, m = 2 + seed % 3, 1 + seed % 2, 1 + seed % 3
    system = random_driven(rng, n, p, m)
    h = ddmhe.History.concat([recorded(system, rng, 60) for _ in range(2)])
    design = pole_placement(h)
    assert (design.rank, design.required_rank) == (n, n + p)
    assert "(44) fails" in design.words
    assert not design.arbitrary
    assert design.singular_values[n] < 1e-9 * design.singular_values[n - 1]
    known = pole_placement(A=system.A, C=system.C)
    assert design.output_rank == known.output_rank
    assert design.lower_bound == pytest.approx(known.lower_bound, rel=1e-6)
    # noise-free data leave one gain, L = A⁻ᵀCᵀ: its poles in the true system
    one = np.linalg.solve(system.A.T, system.C.T)
    if design.gain is not None:
        np.testing.assert_allclose(design.gain, one, rtol=1e-4, atol=1e-4 * np.abs(one).max())


def test_large_and_small_inputs_do_not_decide_the_rank():
    """Inputs of a million or a millionth of the states' size, or of an unknown offset."""
    rng = np.random.default_rng(1)
    system = random_driven(rng, 3, 2, 2)
    h = recorded(system, rng, 80)
    (x, y), u = h.recordings[0], h.inputs[0]
    for scale, offset in ((1.0, 0.0), (1e6, 0.0), (1e-6, 0.0), (1.0, 1e6)):
        design = pole_placement(ddmhe.History(x, y, u=scale * u + offset))
        assert design.rank == 3
        assert design.lower_bound == pytest.approx(
            pole_placement(A=system.A, C=system.C).lower_bound, rel=1e-5
        )


def test_more_noisy_columns_are_arbitrary_as_ever():
    rng = np.random.default_rng(0)
    system = full_output_system(rng)
    design = pole_placement(recorded(system, rng, 60, x_noise=0.05, y_noise=0.01))
    assert design.arbitrary
    assert design.rho0 < 1e-12
    assert not design.agree
    assert design.rho0_identified == pytest.approx(6 * np.linalg.norm(system.A, 2) ** 2, rel=0.1)


def test_errors_name_the_argument():
    rng = np.random.default_rng(0)
    system = full_output_system(rng)
    with pytest.raises(
        ddmhe.RankError, match=r"history: expected at least n \+ p \+ m \+ 1 = 9 outputs, found 8"
    ):
        pole_placement(recorded(system, rng, 8))
    h = recorded(system, rng, 30)
    (x, y), u = h.recordings[0], h.inputs[0]
    u = np.column_stack([u[:, 0], x[:-1, 1]])
    with pytest.raises(ddmhe.RankError, match="u follows the state"):
        pole_placement(ddmhe.History(x, y, u=u))
