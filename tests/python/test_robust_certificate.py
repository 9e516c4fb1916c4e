"""Certificates for every system that a noisy recording allows, the true one among them."""

import numpy as np
import pytest

import ddmhe
from ddmhe.design import (
    RecordingNoise,
    consistent_set,
    ioss,
)
from reference import largest_eigenvalue

A_TRUE = np.array([[0.95, 0.3, 0.0], [-0.3, 0.95, 0.1], [0.0, 0.0, -0.99]])


C_TRUE = np.array([[1.0, 0.0, 0.5]])


E_TRUE, R_TRUE = np.array([0.1, -0.2, 0.3]), np.array([2.0])


def rich_recording(rng, noise, steps=150):
    """A motion in all directions, with errors at the stated bound (on its sphere) or Gaussian."""
    x = [rng.choice([-1.0, 1.0], 3) * rng.uniform(1.0, 2.0, 3)]
    for _ in range(steps):
        drive = rng.standard_normal(3)
        drive *= noise.w / np.linalg.norm(drive) if noise.kind == "bounded" else noise.w
        x.append(A_TRUE @ x[-1] + E_TRUE + drive)
    x = np.array(x)

    def errors(shape, size):
        e = rng.standard_normal(shape)
        return size * (
            e / np.linalg.norm(e, axis=1, keepdims=True) if noise.kind == "bounded" else e
        )

    y = x[:-1] @ C_TRUE.T + R_TRUE
    return ddmhe.History(x + errors(x.shape, noise.x), y + errors(y.shape, noise.y))


@pytest.mark.parametrize("kind", ["bounded", "gaussian"])
def test_the_true_system_is_always_among_the_consistent_ones(kind):
    rng = np.random.default_rng(0)
    noise = RecordingNoise(x=2e-3, y=2e-3, w=1e-3, kind=kind)
    for _ in range(1000):
        assert consistent_set(rich_recording(rng, noise), noise).contains(
            A_TRUE, E_TRUE, C_TRUE, R_TRUE
        )


def test_an_understated_noise_excludes_the_true_system():
    rng = np.random.default_rng(0)
    noise = RecordingNoise(x=2e-3, y=2e-3)
    missed = 0
    for _ in range(20):
        h = rich_recording(rng, noise)
        try:
            found = consistent_set(h, RecordingNoise(x=1e-4, y=1e-4))
            missed += not found.contains(A_TRUE, E_TRUE, C_TRUE, R_TRUE)
        except ddmhe.DdmheError as e:
            missed += "no linear system explains" in str(e)
    assert missed == 20


@pytest.mark.parametrize("recordings", [25, pytest.param(500, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["bounded", "gaussian"])
def test_a_robust_certificate_holds_for_the_true_system(kind, recordings):
    """The true system satisfies the inequality every time."""
    rng = np.random.default_rng(1)
    noise = RecordingNoise(x=1e-3, y=1e-3, kind=kind)
    for _ in range(recordings):
        c = ioss(rich_recording(rng, noise), 0.95, noise=noise)
        assert c.residual <= 0
        assert largest_eigenvalue(c, A_TRUE, C_TRUE) <= 0
        assert c.growth >= np.linalg.norm(
            np.linalg.cholesky(c.P).T @ A_TRUE @ np.linalg.inv(np.linalg.cholesky(c.P).T), 2
        )


def test_a_robust_certificate_holds_on_the_boundary_of_its_set():
    """Systems drawn on the boundary, ‖Γ‖ = 1: an independent look at the S-lemma. A nominal
    certificate fails there."""
    rng = np.random.default_rng(3)
    noise = RecordingNoise(x=3e-3, y=3e-3)
    h = rich_recording(rng, noise)
    allowed = consistent_set(h, noise)
    robust, nominal = ioss(h, 0.95, noise=noise), ioss(h, 0.95)
    values, vectors = np.linalg.eigh(allowed.shape)
    root = vectors * np.sqrt(values) @ vectors.T
    denied = 0
    for _ in range(2000):
        U, _, Vt = np.linalg.svd(rng.standard_normal((4, 3)), full_matrices=False)
        K = allowed.root @ U @ Vt @ root
        A, C = allowed.A + K[:3], allowed.C + K[3:]
        assert largest_eigenvalue(robust, A, C) <= 0
        denied += largest_eigenvalue(nominal, A, C) > 0
    assert denied > 0


def test_robust_bounds_hold_for_estimates_from_the_noisy_recording():
    """Noisy recording, default space: the windows are no one's trajectories, and the bound accounts
    for it."""
    rng = np.random.default_rng(5)
    noise = RecordingNoise(x=1e-3, y=1e-3)
    for _ in range(20):
        h = rich_recording(rng, noise)
        c = ioss(h, 0.95, noise=noise)
        x = [h.recordings[0][0][-1]]
        prior = x[0] + np.array([0.01, 0, 0])
        for _ in range(60):
            x.append(A_TRUE @ x[-1] + E_TRUE)
        x = np.array(x)
        y = x[:-1] @ C_TRUE.T + R_TRUE + rng.uniform(-0.01, 0.01, (60, 1))
        log = ddmhe.DdMhe(h, x_prior=prior, certificate=c, disturbance=(0.01, 0.0, 0.01)).run(y)
        assert (np.linalg.norm(log.x - x[1:], axis=1) <= log.bound).all()
        assert log.bound.max() < 0.2 * np.abs(x).max()  # and says something


def test_what_noise_costs():
    """More noise, larger weights; at none the robust certificate is the nominal one; at too much
    there is none."""
    rng = np.random.default_rng(6)
    h = rich_recording(rng, RecordingNoise(x=1e-3, y=1e-3))
    sizes = [np.trace(ioss(h, 0.95, noise=RecordingNoise(x=s, y=s)).Q) for s in (1e-3, 2e-3, 4e-3)]
    assert sizes == sorted(sizes)
    assert sizes[0] > np.trace(ioss(h, 0.95).Q)
    with pytest.raises(ddmhe.InfeasibleError, match="noise: expected a size that leaves"):
        ioss(h, 0.95, noise=RecordingNoise(x=1e-3, y=5.0))
    with pytest.raises(
        ddmhe.RankError, match="noise: expected a recording that moves every direction"
    ):
        ioss(h, 0.95, noise=RecordingNoise(x=10.0))
