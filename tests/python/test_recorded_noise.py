"""The share of a recording's errors that drives the system, against a dense Gaussian and truths."""

import numpy as np
import pytest
import scipy.linalg
from scipy.stats import multivariate_normal

import ddmhe
from ddmhe.baselines import ErrorStateKalman, ModelMhe
from ddmhe.baselines.linear_model import LinearModel
from ddmhe.baselines.recorded_noise import log_likelihood


def test_the_likelihood_is_that_of_all_readings_together():
    """One large Gaussian: [y(0); x(1); y(1); …] given the first reading."""
    rng = np.random.default_rng(0)
    n, p, T = 2, 1, 6
    A, C = np.array([[0.9, 0.3], [-0.3, 0.8]]), np.array([[1.0, 0.5]])
    Q, N, R = (S @ S.T for S in (rng.standard_normal((k, k)) for k in (n, n, p)))
    x, y = rng.standard_normal((T + 1, n)), rng.standard_normal((T, p))
    start = np.eye(n, n * (T + 1))  # true states as rows of [x(0); w(0); …]
    rows, at = [], start
    for k in range(T):
        rows.append(C @ at if k == 0 else np.vstack([at, C @ at]))
        at = A @ at
        at[:, n * (k + 1) : n * (k + 2)] += np.eye(n)
    G = np.vstack(rows)
    S = G @ scipy.linalg.block_diag(N, *[Q] * T) @ G.T
    S += scipy.linalg.block_diag(R, *[scipy.linalg.block_diag(N, R)] * (T - 1))
    e, r, u = rng.standard_normal(n), rng.standard_normal(p), rng.standard_normal((T, 1))
    B, D = rng.standard_normal((n, 1)), rng.standard_normal((p, 1))
    readings = np.concatenate([y[0], *(np.append(x[k], y[k]) for k in range(1, T))])
    mean, states = [], x[0]
    for k in range(T):
        now = C @ states + D @ u[k] + r
        mean.append(now if k == 0 else np.append(states, now))
        states = A @ states + B @ u[k] + e
    expected = multivariate_normal(np.concatenate(mean), S).logpdf(readings)
    expected += 0.5 * len(readings) * np.log(2 * np.pi)
    model = LinearModel(A, B, e, C, D, r)
    np.testing.assert_allclose(log_likelihood(model, [(x, y, u)], Q, N, R), expected, rtol=1e-10)


def masses(seed, x_noise, *, forced=False):
    """Two masses between springs, positions measured: w 1e-3, v .02; recording and what follows."""
    k_1, k_2, c, dt = 1.0, 0.7, 0.05, 0.1
    rates = [[0, 1, 0, 0], [-k_1 - k_2, -c, k_2, 0], [0, 0, 0, 1], [k_2, 0, -k_1 - k_2, -c]]
    A, C = scipy.linalg.expm(np.array(rates) * dt), np.eye(4)[[0, 2]]
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((1200, 1)) if forced else np.zeros((1200, 1))
    x = [np.array([1.0, 0.0, -0.5, 0.0])]
    for k in range(1200):
        x.append(A @ x[-1] + [0.0, 0.1 * u[k, 0], 0.0, 0.0] + 1e-3 * rng.standard_normal(4))
    x = np.array(x)
    y = x[:-1] @ C.T + 0.02 * rng.standard_normal((1200, 2))
    read = x[:201] + x_noise * rng.standard_normal((201, 4))
    history = ddmhe.History(read, y[:200], dt, u=u[:200] if forced else None)
    return history, y[200:], u[200:] if forced else None, x[201:]


@pytest.mark.parametrize("forced", [False, True], ids=["free", "forced"])
@pytest.mark.parametrize("x_noise", [0.0, 0.01])
def test_disturbance_and_noise_are_found(x_noise, forced):
    history, _, _, _ = masses(1, x_noise, forced=forced)
    mhe = ModelMhe(history, weights="recorded", process_noise="recorded")
    w = np.sqrt(np.trace(mhe.Q) / 4)
    assert 0.5e-3 < w < 2e-3
    np.testing.assert_allclose(np.sqrt(np.diag(mhe.model.residual)[4:]), 0.02, rtol=0.2)
    raw = ModelMhe(history, weights="recorded", process_noise="residual")
    assert (np.trace(raw.Q) > 20 * np.trace(mhe.Q)) == (x_noise > 0)


@pytest.mark.parametrize("forced", [False, True], ids=["free", "forced"])
def test_recorded_weights_gain_where_the_recorded_states_are_noisy(forced):
    """Over raw residuals, as the error-state filter has them."""
    errors = []
    for seed in range(3):
        history, Y, U, truth = masses(seed, 0.01, forced=forced)
        for each in (
            ModelMhe(history, weights="recorded", process_noise="recorded"),
            ErrorStateKalman(history),
        ):
            errors.append(np.sqrt(np.mean(np.sum((each.run(Y, U).x - truth) ** 2, axis=1))))
    recorded, raw = np.median(np.reshape(errors, (3, 2)), axis=0)
    assert recorded < 0.9 * raw
