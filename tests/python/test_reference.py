"""The estimator against independent formulations of the same problem."""

import numpy as np
import pytest

import ddmhe
from reference import hankel, model_based, random_system, recursive_least_squares, verbatim


def draw(rng):
    """A random system of the sizes that must work, a recording of it, and an online trajectory."""
    n, p, M = int(rng.integers(1, 7)), int(rng.integers(1, 4)), int(rng.integers(1, 41))
    system = random_system(rng, n, p)
    T = M + 3 * n + int(rng.integers(10, 40))
    x, y = system.simulate(rng.standard_normal(n) * 3, T)
    return system, n, p, M, x, y


def relative(a, b):
    return np.abs(a - b).max() / max(np.abs(b).max(), 1e-12)


@pytest.mark.parametrize("seed", range(60))
def test_noise_free_states_are_recovered(seed):
    """A new trajectory of the recorded system, the right prior, no noise: the states come out to
    1e-8."""
    rng = np.random.default_rng(seed)
    system, n, _, M, x, y = draw(rng)
    truth, outputs = system.simulate(rng.standard_normal(n) * 3, 2 * M + 5)
    for space in (ddmhe.Exact(), "auto"):
        estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, 0.9, 10.0, x_prior=truth[0], space=space)
        assert estimator.rank == n
        assert relative(estimator.run(outputs).x, truth[1:]) < 1e-8


@pytest.mark.parametrize("seed", range(20))
def test_a_wrong_prior_is_forgotten(seed):
    """With noise-free outputs the estimate converges to the true state whatever the prior."""
    rng = np.random.default_rng(1000 + seed)
    system, n, _, M, x, y = draw(rng)
    M = max(M, 2 * n)
    x, y = system.simulate(x[0], M + 3 * n + 20)
    truth, outputs = system.simulate(rng.standard_normal(n) * 3, 12 * M)
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, 0.5, 1e3, x_prior=truth[0] + 5.0)
    error = np.linalg.norm(estimator.run(outputs).x - truth[1:], axis=1)
    assert error[-1] < 1e-8 * np.abs(truth).max()


@pytest.mark.parametrize("seed", range(200))
def test_constrained_window_equals_verbatim_and_model_based(seed):
    """x̂ and cost at a random step, growing or full window, with boxes that cut off the
    unconstrained answer."""
    rng = np.random.default_rng(seed)
    system, n, p, M, x, y = draw(rng)
    steps = int(rng.integers(1, M + 6))
    truth, clean = system.simulate(rng.standard_normal(n), steps)
    sigma = 0.3
    outputs = clean + rng.uniform(-sigma, sigma, clean.shape)
    x_bounds = (truth.min(0) - rng.uniform(0, 0.1, n), truth.max(0) + rng.uniform(0, 0.1, n))
    v_bounds = (np.full(p, -sigma), np.full(p, sigma))
    if seed % 4 == 1:
        v_bounds = None
    if seed % 4 == 2:
        x_bounds = None
    rho, mu = rng.uniform(0.6, 0.98), 10 ** rng.uniform(-1, 2)
    prior = np.clip(truth[0] + 0.5 * rng.standard_normal(n), truth.min(0), truth.max(0))
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y),
        M,
        rho,
        mu,
        x_prior=prior,
        x_bounds=x_bounds,
        v_bounds=v_bounds,
        space=ddmhe.Exact(),
    )
    past = [prior]
    for sample in outputs:
        estimate = estimator.step(sample)
        past.append(estimate.x)
    assert estimate.status == "optimal"
    m = min(steps, M)
    arguments = (outputs[-m:], past[steps - m], rho, mu, x_bounds, v_bounds)
    window, v, cost = model_based(system, *arguments)
    assert relative(estimate.window, window) < 1e-6
    assert np.abs(estimate.v - v).max() < 1e-6
    assert estimate.cost == pytest.approx(cost, rel=1e-6, abs=1e-9)
    window, _, cost = verbatim(x, y, *arguments, near=window)
    assert relative(estimate.x, window[-1]) < 1e-6
    assert estimate.cost == pytest.approx(cost, rel=1e-6, abs=1e-8)


def test_the_boxes_of_the_comparison_do_bind():
    """The 200 problems above would prove little if their boxes never cut."""
    binding = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        system, n, _, M, x, y = draw(rng)
        _, clean = system.simulate(rng.standard_normal(n), M)
        outputs = clean + rng.uniform(-0.3, 0.3, clean.shape)
        estimator = ddmhe.DdMhe(
            ddmhe.History(x, y), M, 0.9, 1.0, v_bounds=(-0.3, 0.3), space=ddmhe.Exact()
        )
        log = estimator.run(outputs)
        binding += bool((log.active > 0).any())
    assert binding >= 20


@pytest.mark.parametrize("seed", range(20))
def test_growing_window_is_recursive_least_squares(seed):
    """Unconstrained and t <= M: the estimate is that of least squares with forgetting factor ρ."""
    rng = np.random.default_rng(seed)
    system, n, p, M, x, y = draw(rng)
    _, clean = system.simulate(rng.standard_normal(n), M)
    outputs = clean + 0.1 * rng.standard_normal((M, p))
    rho, mu, prior = rng.uniform(0.6, 0.98), 10 ** rng.uniform(-1, 2), rng.standard_normal(n)
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, rho, mu, x_prior=prior, space=ddmhe.Exact())
    expected = recursive_least_squares(system, outputs, prior, rho, mu)
    assert relative(estimator.run(outputs).x, expected) < 1e-8


@pytest.mark.parametrize("seed", range(10))
def test_missing_outputs_equal_least_squares_without_them(seed):
    rng = np.random.default_rng(seed)
    system, n, p, M, x, y = draw(rng)
    M = max(M, 4)
    x, y = system.simulate(x[0], M + 3 * n + 20)
    _, clean = system.simulate(rng.standard_normal(n), M)
    outputs = clean + 0.1 * rng.standard_normal((M, p))
    outputs[rng.random((M, p)) < 0.3] = np.nan
    outputs[2] = np.nan
    prior, rho, mu = rng.standard_normal(n), 0.9, 3.0
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, rho, mu, x_prior=prior, space=ddmhe.Exact())
    for sample in outputs:
        estimate = estimator.step(sample)
    A_k, o_k, rows, values, weights = (
        np.eye(n),
        np.zeros(n),
        [np.eye(n)],
        [prior],
        [np.full(n, 2 * rho**M)],
    )
    for k, sample in enumerate(outputs):
        seen = np.isfinite(sample)
        rows.append((system.C @ A_k)[seen])
        values.append((sample - system.C @ o_k - system.r)[seen])
        weights.append(np.full(seen.sum(), mu * rho ** (M - 1 - k)))
        A_k, o_k = system.A @ A_k, system.A @ o_k + system.e
    w = np.sqrt(np.concatenate(weights))
    x_0 = np.linalg.lstsq(w[:, None] * np.vstack(rows), w * np.concatenate(values), rcond=None)[0]
    assert relative(estimate.x, A_k @ x_0 + o_k) < 1e-8
    assert np.array_equal(np.isnan(estimate.v), np.isnan(outputs))


@pytest.mark.parametrize("seed", range(8))
def test_ridge_weight_is_that_of_the_printed_problem(seed):
    """Ridge(w) minimises (17) + w‖α‖² over α with 1ᵀα = 1: checked by solving for α itself, at
    every depth.

    The data are two noisy recordings, so every window counts, and windows across the seam would
    show."""
    rng = np.random.default_rng(seed)
    n, p, M = 2, 2, 6
    system = random_system(rng, n, p)
    recordings = []
    for T in (30, 9):
        x, y = system.simulate(rng.standard_normal(n) * 3, T)
        recordings.append(
            (x + 0.1 * rng.standard_normal(x.shape), y + 0.1 * rng.standard_normal(y.shape))
        )
    outputs, prior, rho, mu, weight = (
        rng.standard_normal((M, p)),
        rng.standard_normal(n),
        0.8,
        2.0,
        0.7,
    )
    history = ddmhe.History.concat([ddmhe.History(x, y) for x, y in recordings])
    estimator = ddmhe.DdMhe(history, M, rho, mu, x_prior=prior, space=ddmhe.Ridge(weight))
    for depth in range(1, M + 1):
        estimate = estimator.step(outputs[depth - 1])
        H_x = np.hstack([hankel(x, depth + 1) for x, _ in recordings])
        H_y = np.hstack([hankel(y, depth) for _, y in recordings])
        N, seen = H_y.shape[1], outputs[:depth].ravel()
        noise = np.repeat(mu * rho ** np.arange(depth - 1, -1, -1.0), p)
        hessian = (
            2 * rho**depth * H_x[:n].T @ H_x[:n]
            + H_y.T @ (noise[:, None] * H_y)
            + weight * np.eye(N)
        )
        gradient = 2 * rho**depth * H_x[:n].T @ prior + H_y.T @ (noise * seen)
        kkt = np.block([[hessian, np.ones((N, 1))], [np.ones((1, N)), np.zeros((1, 1))]])
        alpha = np.linalg.solve(kkt, np.append(gradient, 1.0))[:N]
        assert np.allclose(estimate.window.ravel(), H_x @ alpha, rtol=0, atol=1e-9)
        assert np.allclose(estimate.v.ravel(), seen - H_y @ alpha, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_exact_space_of_a_noisy_recording_takes_the_least_norm_alpha(seed):
    """More directions than the cost sees: among the minimisers the shortest α, here by a
    pseudo-inverse."""
    rng = np.random.default_rng(seed)
    n, p, M, T = 2, 1, 4, 30
    x, y = (
        rng.standard_normal((T + 1, n)),
        rng.standard_normal((T, p)),
    )  # no model fits: every window is possible
    outputs, prior, rho, mu = rng.standard_normal((M, p)), rng.standard_normal(n), 0.8, 2.0
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), M, rho, mu, x_prior=prior, space=ddmhe.Exact())
    for sample in outputs:
        estimate = estimator.step(sample)
    # all of prior and outputs can be met: minimise ‖α‖ subject to that and 1ᵀα = 1
    H_x, H_y = hankel(x, M + 1), hankel(y, M)
    rows = np.vstack([H_x[:n], H_y, np.ones((1, H_y.shape[1]))])
    alpha = np.linalg.pinv(rows) @ np.concatenate([prior, outputs.ravel(), [1.0]])
    assert np.allclose(estimate.window.ravel(), H_x @ alpha, rtol=0, atol=1e-8)
    assert estimate.cost < 1e-15


@pytest.mark.parametrize("seed", range(40))
def test_active_bounds_leave_the_least_norm_to_the_minimisers_of_the_cost(seed):
    """A noisy recording, more directions than the cost sees, active bounds: cost first, then ‖α‖,
    proved over α."""
    rng = np.random.default_rng(seed)
    n, p, M = int(rng.integers(1, 4)), int(rng.integers(1, 3)), int(rng.integers(2, 8))
    system = random_system(rng, n, p)
    x, y = system.simulate(rng.standard_normal(n) * 3, 60)
    x, y = (signal + 0.1 * rng.standard_normal(signal.shape) for signal in (x, y))
    truth, clean = system.simulate(rng.standard_normal(n) * 2, M + 20)
    outputs = clean + rng.uniform(-0.5, 0.5, clean.shape)
    x_bounds = (0.5 * truth.min(0) - 0.1, 0.5 * truth.max(0) + 0.1)
    v_bounds = None if seed % 2 else (np.full(p, -0.2), np.full(p, 0.2))
    rho, mu, prior = rng.uniform(0.7, 0.95), 10 ** rng.uniform(-1, 2), np.clip(truth[0], *x_bounds)
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y),
        M,
        rho,
        mu,
        x_prior=prior,
        x_bounds=x_bounds,
        v_bounds=v_bounds,
        space=ddmhe.Exact(),
    )
    past, bound = [prior], 0
    for k, sample in enumerate(outputs, 1):
        estimate = estimator.step(sample)
        past.append(estimate.x)
        assert estimate.status == "optimal"
        if estimate.active == 0:
            continue
        bound += 1
        m = min(k, M)
        arguments = (outputs[k - m : k], past[k - m], rho, mu, x_bounds, v_bounds)
        window, v, cost = verbatim(x, y, *arguments, near=estimate.window, near_v=estimate.v)
        size = np.abs(window).max()
        assert np.abs(estimate.window - window).max() < 1e-8 * size
        assert np.abs(estimate.v - v).max() < 1e-8 * max(size, np.abs(v).max())
        assert estimate.cost == pytest.approx(cost, rel=1e-8, abs=1e-12)
    assert bound > 3


def test_history_center_is_the_affine_pseudo_inverse():
    """x_c = H_x H_y† y in affine form: with a box of zero width around it, the window must be x_c
    itself."""
    rng = np.random.default_rng(0)
    system = random_system(rng, 3, 2)
    x, y = system.simulate(rng.standard_normal(3) * 3, 40)
    M = 8
    _, clean = system.simulate(rng.standard_normal(3), M)
    outputs = clean + 0.1 * rng.standard_normal(clean.shape)
    width = 1e-9
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y),
        M,
        0.9,
        1.0,
        x_bounds=(-width, width),
        x_center="history",
        space=ddmhe.Exact(),
    )
    for sample in outputs:
        estimate = estimator.step(sample)
    H_x, H_y = hankel(x, M + 1), hankel(y, M)
    c_x, c_y = H_x.mean(1, keepdims=True), H_y.mean(1, keepdims=True)
    expected = c_x[:, 0] + (H_x - c_x) @ np.linalg.pinv(H_y - c_y, rcond=1e-10) @ (
        outputs.ravel() - c_y[:, 0]
    )
    assert np.allclose(estimate.window.ravel(), expected, atol=1e-7)
