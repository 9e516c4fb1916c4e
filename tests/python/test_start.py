"""Where a run starts: the recording's end, a state, anywhere."""

import numpy as np
import pytest

import ddmhe

A = 0.999 * np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])
T = 200


def oscillator(start, steps, noise, seed):
    x = [np.array(start)]
    for _ in range(steps):
        x.append(A @ x[-1])
    x = np.array(x)
    return x, x[:-1, :1] + noise * np.random.default_rng(seed).standard_normal((steps, 1))


def recorded(seed=0, noise=0.01, x_noise=0.0):
    x, y = oscillator([1.0, 0.0], T, noise, seed)
    return ddmhe.History(x + x_noise * np.random.default_rng(seed + 50).standard_normal(x.shape), y)


def nrmse(x_hat, x):
    return np.sqrt(np.mean(np.mean((x_hat - x) ** 2, axis=0) / x.var(axis=0)))


@pytest.mark.parametrize("how", ["argument", "reset"])
def test_a_given_state_counts_also_where_the_recording_s_end_was_asked_for(how):
    x, y = oscillator([-0.8, 1.0], T, 0.0, 0)
    h = recorded(noise=0.0)
    if how == "argument":
        est = ddmhe.DdMhe(h, 20, x_prior=x[0], warm_start=True)
    else:
        est = ddmhe.DdMhe(h, 20, start="recording")
        est.reset(x[0])
    assert est.next_depth == 1
    assert np.abs(est.run(y).x - x[1:]).max() < 1e-8
    est.reset(start="state", x_prior=x[0])
    assert np.abs(est.run(y).x - x[1:]).max() < 1e-8


def test_reset_without_anything_is_as_constructed():
    h, (_, y) = recorded(), oscillator([-0.8, 1.0], 60, 0.01, 9)
    for start in ("recording", "state", "unknown"):
        expected = ddmhe.DdMhe(h, 12, start=start).run(y).x
        est = ddmhe.DdMhe(h, 12, start=start)
        for other in ("recording", "state", "unknown"):
            est.reset(start=other)
            np.testing.assert_array_equal(est.run(y).x, ddmhe.DdMhe(h, 12, start=other).run(y).x)
            est.reset()
            np.testing.assert_array_equal(est.run(y).x, expected)


def test_the_old_name():
    h, (_, y) = recorded(), oscillator([1.0, 0.0], 40, 0.01, 9)
    for warm, start in ((True, "recording"), (False, "state")):
        old, new = ddmhe.DdMhe(h, warm_start=warm), ddmhe.DdMhe(h, start=start)
        np.testing.assert_array_equal(old.run(y).x, new.run(y).x)
    without = ddmhe.DdMhe(h, evidence=False)
    np.testing.assert_array_equal(without.run(y).x, ddmhe.DdMhe(h, start="state").run(y).x)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"start": "recording", "x_prior": [0, 0]}, "start: .*beside x_prior.*recording"),
        ({"start": "unknown", "x_prior": [0, 0]}, "start: .*beside x_prior.*unknown"),
        ({"start": "recording", "warm_start": True}, "warm_start: .*beside start"),
        ({"start": "recording", "warm_start": False}, "warm_start: .*beside start"),
        ({"start": "auto", "evidence": False}, 'start: expected evidence .*"auto".*evidence=False'),
        ({"start": 1}, "start: expected"),
    ],
)
def test_contradictions_name_both(given, words):
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.DdMhe(recorded(), **given)
    if not {"warm_start", "evidence"} & set(given):
        est = ddmhe.DdMhe(recorded())
        with pytest.raises(ddmhe.DdmheError, match=words):
            est.reset(**given)


@pytest.mark.parametrize("x_noise", [0.0, 0.01])
def test_an_oscillator_from_an_unknown_state(x_noise):
    """From the last recorded state the error is of the size of the motion, from an unknown one of
    that of the noise."""
    errors, from_last = [], []
    for seed in range(3):
        h, (x, y) = recorded(seed, x_noise=x_noise), oscillator([-0.8, 1.0], 200, 0.01, 100 + seed)
        x_hat = ddmhe.DdMhe(h, start="unknown").run(y).x
        spread = np.abs(h.recordings[0][0]).max(axis=0)
        assert np.isfinite(x_hat).all()
        assert (np.abs(x_hat) < 3 * spread).all()
        errors.append(nrmse(x_hat[20:], x[21:]))
        from_last.append(nrmse(ddmhe.DdMhe(h, start="state").run(y).x[20:], x[21:]))
    assert np.median(errors) < 0.02, errors
    assert np.median(errors) < 0.5 * np.median(from_last)


def test_the_first_estimate_is_the_minimiser_with_the_spread_as_prior():
    """One output, exact space: a Bayesian estimate by hand, μ and ρ as given."""
    mu, (x, y) = 2.0, recorded(3).recordings[0]
    h = ddmhe.History(x, y, x_units=["m", "m"])  # one scale, their pooled deviation
    s_x, s_y = np.sqrt(np.mean(x.var(axis=0))), y.std()
    regressor = np.column_stack([x[:-1], np.ones(T)])
    noise = y - regressor @ np.linalg.lstsq(regressor, y, rcond=None)[0]
    sigma = np.sum(noise**2) / (T - 3) / s_y**2
    mean, cov = x.mean(axis=0), np.cov(x.T, bias=True)
    P = 10 * (cov + 1e-9 * np.trace(cov) / 2 * np.eye(2))
    windows = np.column_stack([x[:-1], y, x[1:]])
    c = windows.mean(axis=0)
    _, _, V = np.linalg.svd(
        (windows - c) / np.array([s_x, s_x, s_y, s_x, s_x]), full_matrices=False
    )
    basis = (V[:2] * np.array([s_x, s_x, s_y, s_x, s_x])).T
    # scaled cost in units of s_x²: μ' σ_v² ‖x(0) - x̄‖² over P (user's units), μ' = μ s_y²/s_x²
    mu_scaled = mu * s_y**2 / s_x**2
    W = np.sqrt(mu_scaled * sigma) * np.linalg.inv(np.linalg.cholesky(P))
    y_0 = np.array([0.4])
    F = np.vstack([W @ basis[:2], np.sqrt(mu_scaled) / s_y * basis[2:3]])
    f = np.concatenate([W @ (mean - c[:2]), np.sqrt(mu_scaled) / s_y * (y_0 - c[2])])
    b = np.linalg.lstsq(F, f, rcond=None)[0]
    est = ddmhe.DdMhe(h, 5, 0.9, mu, space=ddmhe.Truncated(2), start="unknown")
    np.testing.assert_allclose(est.step(y_0).x, c[3:] + basis[3:] @ b, rtol=1e-8)


def test_a_snapshot_goes_on_at_every_time_of_an_unknown_start():
    h, (_, y) = recorded(), oscillator([-0.8, 1.0], 60, 0.01, 9)
    expected = ddmhe.DdMhe(h, 12, start="unknown").run(y).x
    for k in (0, 1, 11, 12, 13, 20, 24, 30):
        for est in (ddmhe.DdMhe(h, 12, start="unknown"), ddmhe.DdMhe(h, 12, start="recording")):
            est.reset(start="unknown")
            est.run(y[:k])
            np.testing.assert_array_equal(
                ddmhe.DdMhe.restore(est.snapshot()).run(y[k:]).x, expected[k:]
            )


def test_tune_keeps_the_start_apart():
    tuned = ddmhe.tune(recorded(x_noise=0.01))
    assert not {"start", "warm_start"} & set(tuned.settings)
    assert tuned.start in ("recording", "state")
