"""Tuning knows fitted disturbances: what it tries, when it leaves the default rule for one, and
what a stated noise of the outputs does to the weights of the recording."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import ddmhe
from ddmhe.config import read_config, write_config
from ddmhe.tuning.disturbance import stated_noise
from ddmhe.tuning.folds import Recorded
from disturbed import fitted, kalman, stationary


def masses(seed, *, x_noise=0.003, T=100, N=300):
    """Two masses between springs, positions measured, w 1e-3: a recording, the outputs (N, 2) and
    the states (N, 4) that follow."""
    rates = [[0, 1, 0, 0], [-1.7, -0.05, 0.7, 0], [0, 0, 0, 1], [0.7, 0, -1.7, -0.05]]
    A, C = scipy.linalg.expm(0.1 * np.array(rates)), np.eye(4)[[0, 2]]
    rng = np.random.default_rng([seed, 9])
    x = [np.array([1.0, 0.0, -0.5, 0.0])]
    for _ in range(T + N):
        x.append(A @ x[-1] + 1e-3 * rng.standard_normal(4))
    x = np.array(x)
    y = x[:-1] @ C.T + 0.02 * rng.standard_normal((T + N, 2))
    read = x[: T + 1] + x_noise * rng.standard_normal((T + 1, 4))
    return ddmhe.History(read, y[:T], dt=0.1), y[T:], x[T + 1 :]


def noise_driven(seed, *, v=0.5, online=0.5, T=150, N=300):
    """A state that noise drives, seen through noise."""
    rng = np.random.default_rng([seed, 10])
    x = [np.zeros(1)]
    for _ in range(T + N):
        x.append(0.95 * x[-1] + 0.3 * rng.standard_normal(1))
    x = np.array(x)
    noise = np.where(np.arange(T + N) < T, v, online)[:, None]
    y = x[:-1] + noise * rng.standard_normal((T + N, 1))
    return ddmhe.History(x[: T + 1], y[:T]), y[T:], x[T + 1 :]


def pendulum(T=120, N=200):
    """A pendulum that swings widely, its states read with little noise."""
    record = ddmhe.models.pendulum().simulate((T + N + 1) * 0.05, 0.05, noise=0.01, seed=2)
    x = record.x[: T + 1] + 1e-3 * np.random.default_rng(2).standard_normal((T + 1, 2))
    return ddmhe.History(x, record.y[:T], dt=0.05), record.y[T : T + N], record.x[T + 1 :][:N]


def undisturbed(seed, T=120, N=300):
    """A slow oscillator without any disturbance, read and measured with noise."""
    A = 0.999 * np.array([[np.cos(0.15), -np.sin(0.15)], [np.sin(0.15), np.cos(0.15)]])
    x = np.array([np.linalg.matrix_power(A, k) @ [1.0, 0.5] for k in range(T + N + 1)])
    rng = np.random.default_rng([seed, 12])
    y = x[:-1] @ [[1.0], [0.3]] + 0.05 * rng.standard_normal((T + N, 1))
    read = x[: T + 1] + 0.01 * rng.standard_normal((T + 1, 2))
    return ddmhe.History(read, y[:T]), y[T:], x[T + 1 :]


CASES = {
    "masses": masses(0),
    "noise-driven": noise_driven(0),
    "pendulum": pendulum(),
    "undisturbed": undisturbed(0),
}


@pytest.fixture(scope="module", params=CASES)
def tuned(request):
    history, outputs, truth = CASES[request.param]
    return ddmhe.tune(history, progress=False), history, outputs, truth


def stated(history, noise):
    return Recorded(history, 0, np.zeros(history.p), noise)


def error(history, settings, outputs, truth):
    x = ddmhe.DdMhe(history, **settings, start="recording").run(outputs).x
    return np.sqrt(np.mean(np.mean((x - truth) ** 2, axis=0) / truth.var(axis=0)))


def test_what_is_tried_beside_the_default_rule(tuned):
    """Weights by scales and a disturbance of either kind; weights of the recording where the
    default rule takes them, and nowhere else."""
    found, history, _, _ = tuned
    beside = found.table[found.table["space"] == "auto"]
    default = ddmhe.DdMhe(history).weights
    tried = set(zip(beside["weights"], beside["disturbance"], strict=True))
    expected = {("scaled", "none"), ("scaled", "recorded"), ("scaled", "residual")}
    if default == "recorded":
        expected |= {("recorded", "recorded"), ("recorded", "residual")}
    assert tried == expected
    assert len(beside) == len(expected)
    (own,) = beside[beside["default"]].to_dict("records")
    fits = {"recorded": "recorded", "scaled": "none"}[default]
    assert (own["weights"], own["disturbance"]) == (default, fits)
    assert ("takes the weights of the recording" in found.words) == (default == "recorded")
    # a curved surrogate that nothing drives is not a linear motion that noise drives
    assert default == "scaled" or found.table["rehearsed"].isna().all()


def test_the_default_rule_is_no_worse_later_than_what_is_chosen(tuned):
    found, history, outputs, truth = tuned
    chosen = error(history, found.settings, outputs, truth)
    assert chosen <= 1.001 * error(history, {}, outputs, truth)


def test_the_returned_settings_are_the_estimator_that_was_scored(tuned):
    """Settings may be shorter than what was scored, never another estimator."""
    found, history, outputs, _ = tuned
    scored = ddmhe.DdMhe(history, **found.candidates[0], start=found.start)
    again = ddmhe.DdMhe(history, **found.settings, start=found.start)
    np.testing.assert_array_equal(scored.run(outputs).x, again.run(outputs).x)


def test_states_that_show_no_disturbance_are_tuned():
    """Recorded exactly, of a decay that nothing drives: a disturbance cannot be asked for."""
    x = 0.98 ** np.arange(101.0)[:, None]
    y = x[:-1] + 0.05 * np.random.default_rng(0).standard_normal((100, 1))
    history = ddmhe.History(x[:51], y[:50])
    found = ddmhe.tune(history, progress=False)
    asked = found.table["disturbance"].isin(["recorded", "residual"]) & ~found.table["default"]
    assert asked.any()
    assert not np.isfinite(found.table["rated"][asked]).any()
    assert error(history, found.settings, y[50:], x[51:]) < 1.0


def test_disturbances_are_scored_as_estimators_fitted_by_hand(tuned):
    found, history, _, _ = tuned
    ((x, y),) = history.recordings
    a, z = len(y) // 4, len(y) // 2
    rest = ddmhe.History.concat([ddmhe.History(x[z:], y[z:]), ddmhe.History(x[: a + 1], y[:a])])
    rows = [k for k, space in enumerate(found.table["space"]) if space == "auto"]
    for row in rows:
        estimator = ddmhe.DdMhe(rest, **found.candidates[row], start="recording")
        off = estimator.run(y[a:z]).x - x[a + 1 : z + 1]
        relative = np.sqrt(np.mean(np.mean(off**2, axis=0) / x.var(axis=0)))
        assert found.table["quarter 2"].iloc[row] == pytest.approx(relative, rel=1e-9)
    assert len({round(score, 9) for score in found.table["quarter 2"].iloc[rows]}) > 1


def test_a_stated_noise_is_handed_to_the_weights_of_the_recording(tmp_path):
    """A Kalman filter with the recording's model and disturbance and the stated R, which knows both
    covariances, is hardly better; the recording's own R costs a third of the error and more."""
    for seed in (1, 2):
        history, outputs, truth = noise_driven(seed, v=0.05, online=1.0, T=100)
        assert ddmhe.DdMhe(history).weights == "recorded"
        found = ddmhe.tune(history, output_noise=1.0, progress=False)
        assert set(found.settings) == {"weights", "process_noise"}
        assert "the stated noise of the outputs is not that of the recording" in found.words
        ours = error(history, found.settings, outputs, truth)
        assert ours < 0.75 * error(history, {}, outputs, truth)
        model = replace(fitted(history), R=np.eye(1))
        Q = np.array([[0.3**2]])
        start = history.recordings[0][0][-1]
        known, _ = kalman(model, Q, outputs, None, start, stationary(model, Q))
        assert ours < 1.1 * np.sqrt(np.mean((known - truth) ** 2) / truth.var())
        write_config(tmp_path / "tune.toml", found.settings)
        assert read_config(tmp_path / "tune.toml") == found.settings


def test_two_channels_share_the_stated_noise_in_geometric_mean():
    """Against Q and R of the recording, which are the truth's: w 1e-3, v .02."""
    history, _, _ = masses(1, x_noise=0.0, T=400)
    Q, times = stated_noise(stated(history, [0.2, 0.02]))
    assert times == pytest.approx(10.0, rel=0.15)
    assert np.sqrt(np.diag(Q) * times) == pytest.approx(np.full(4, 1e-3), rel=0.15)


@pytest.mark.parametrize("noise", [None, 0.02, [0.03, 0.01], 0.0])
def test_a_stated_noise_like_that_of_the_recording_is_not_handed_on(noise):
    history, _, _ = masses(1, x_noise=0.0)
    assert stated_noise(stated(history, noise)) is None
