"""Tuning a system with known inputs: they are part of what is held out, rehearsed and chosen on."""

import os
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe._core import validate
from ddmhe.tuning.folds import Recorded
from ddmhe.tuning.rehearsals import rehearsals_of
from ddmhe.tuning.surrogate import Surrogate, continued

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "input-logs"
)
REST = (np.array([0.5, 0.0]), np.array([0.5]), np.array([0.3]))


def moved(x_0, u):
    """States (T+1, 2) of a mass on a spring under a force u (T, 1), with a drag that bends over:
    quadratic, at rest in REST."""
    x = [np.asarray(x_0)]
    for force in u[:, 0]:
        q, w = x[-1][0] - REST[0][0], x[-1][1]
        pull = -0.1 * q - 0.05 * w + 0.2 * (force - REST[2][0]) - 0.02 * w * w
        x.append(x[-1] + np.array([0.3 * w, pull]))
    return np.array(x)


def driven(T, seed=0, noise=0.0):
    """x (T+1, 2), y (T, 1), u (T, 1) of that mass; the output sees the force."""
    rng = np.random.default_rng(seed)
    u = 0.3 + np.repeat(rng.uniform(-0.1, 0.1, T // 5 + 1), 5)[:T, None]
    x = moved([0.6, 0.1], u)
    y = x[:-1, :1] + 0.5 * (u - REST[2])
    return x, y + noise * rng.standard_normal(y.shape), u


@pytest.fixture(scope="module")
def tuned():
    x, y, u = driven(160, noise=2e-3)
    return ddmhe.tune(ddmhe.History(x, y, u=u), progress=False)


def test_inputs_go_on_with_the_recorded_ones_back_and_forth():
    u = np.arange(6.0).reshape(3, 2)
    expected = [0, 1, 2, 2, 1, 0, 0, 1, 2, 2]
    np.testing.assert_array_equal(continued(u, 10)[:, 0], 2.0 * np.array(expected))
    np.testing.assert_array_equal(continued(u, 2), u[:2])
    assert continued(np.zeros((4, 0)), 9).shape == (9, 0)


@pytest.mark.parametrize("rest", [None, REST])
def test_the_surrogate_is_the_driven_system_where_that_is_quadratic(rest):
    """Fitted to 150 samples, it goes on as the system itself under the same inputs."""
    x, y, u = driven(150)
    surrogate = Surrogate(x, y, rest, u)
    assert surrogate.misfit < 0.1
    again = continued(u, 450)
    truth = moved(x[0], again)
    motion, outputs = surrogate.motion(surrogate.best, 450)
    assert np.abs(motion - truth).max() < 1e-2 * np.ptp(truth)
    seen = truth[:-1, :1] + 0.5 * (again - REST[2])
    assert np.abs(outputs - seen).max() < 1e-2 * np.ptp(seen)
    blind = Surrogate(x, y, rest and rest[:2])
    assert blind.misfit > 100 * surrogate.misfit


def test_the_surrogates_slope_is_that_of_its_residuals():
    x, y, u = driven(60, noise=1e-3)
    x = x + 1e-3 * np.random.default_rng(1).standard_normal(x.shape)
    u = np.column_stack([u, np.random.default_rng(2).standard_normal(60)])
    for rest in (None, (*REST[:2], np.zeros(2))):
        surrogate = Surrogate(x, y, rest, u)
        parameters = surrogate.best
        slope = surrogate._jacobian(parameters)
        for k in range(len(parameters)):
            h = 1e-6 * max(abs(parameters[k]), 1e-3) * np.eye(len(parameters))[k]
            difference = (
                surrogate._residuals(parameters + h) - surrogate._residuals(parameters - h)
            ) / (2 * h[k])
            assert slope[:, k] == pytest.approx(difference, abs=1e-4 * np.abs(slope[:, k]).max())


def test_the_scores_are_those_of_estimators_fitted_by_hand(tuned):
    """Row by row: fit on three quarters as two recordings, estimate the fourth with its inputs."""
    x, y, u = driven(160, noise=2e-3)
    for row in (0, 7, 20):
        for q in (1, 2):
            a, z = 40 * q, 40 * (q + 1)
            rest = ddmhe.History.concat(
                [
                    ddmhe.History(x[z:], y[z:], u=u[z:]),
                    ddmhe.History(x[: a + 1], y[:a], u=u[:a]),
                ]
            )
            estimator = ddmhe.DdMhe(rest, **tuned.candidates[row], start="recording")
            error = estimator.run(y[a:z], u[a:z]).x - x[a + 1 : z + 1]
            relative = np.sqrt(np.mean(np.mean(error**2, axis=0) / x.var(axis=0)))
            assert tuned.table[f"quarter {q + 1}"].iloc[row] == pytest.approx(relative, rel=1e-9)


def test_the_settings_make_an_estimator_with_inputs(tuned):
    x, y, u = driven(400, noise=2e-3)
    history = ddmhe.History(x[:161], y[:160], u=u[:160])
    estimator = ddmhe.DdMhe(history, **tuned.settings, start=tuned.start)
    assert (estimator.horizon, estimator.m) == (tuned.horizon, 1)
    error = estimator.run(y[160:], u[160:]).x - x[161:]
    assert np.sqrt(np.mean(error**2 / x.var(axis=0))) < 0.1
    assert "response" not in tuned.settings  # the form of the inputs is no matter of scores


def test_rehearsals_are_driven_by_the_recorded_inputs(tuned):
    stable = tuned.table["spectral radius"] <= 1.005
    assert np.isfinite(tuned.table["rehearsed"][stable]).all()
    assert "driven by the recorded inputs back and forth" in tuned.words


def test_a_rehearsal_is_a_motion_under_its_inputs():
    x, y, u = driven(120)
    recorded = Recorded(ddmhe.History(x, y, u=u), 0, np.zeros(1))
    folds = rehearsals_of(recorded, lambda _: None)
    assert len(folds) == 8
    for fold in folds[:3]:
        np.testing.assert_array_equal(fold.history.inputs[0], u)
        np.testing.assert_array_equal(fold.inputs, continued(u, 120 + len(fold.outputs))[120:])
        expected = moved(fold.prior, fold.inputs)[1:]
        assert np.abs(fold.truth - expected).max() < 1e-2 * np.ptp(expected)


def test_units_of_inputs_do_not_matter(tuned):
    x, y, u = driven(160, noise=2e-3)
    scaled = ddmhe.tune(ddmhe.History(x, y, u=1e3 * u - 7.0), progress=False)
    assert (scaled.horizon, str(scaled.space)) == (tuned.horizon, str(tuned.space))
    assert scaled.score == pytest.approx(tuned.score, rel=1e-4)
    assert scaled.promise == pytest.approx(tuned.promise, rel=1e-4)


def test_the_promise_is_the_error_on_the_ends_with_their_inputs(tuned):
    x, y, u = driven(160, noise=2e-3)
    squares = []
    for share in (0.6, 0.7, 0.8, 0.9):
        k = int(share * 160)
        learnt = ddmhe.History(x[: k + 1], y[:k], u=u[:k])
        estimator = ddmhe.DdMhe(learnt, **tuned.settings, start="recording")
        squares.append(np.mean((estimator.run(y[k:], u[k:]).x - x[k + 1 :]) ** 2, axis=0))
    assert tuned.promise == pytest.approx(np.sqrt(np.mean(squares, axis=0)), rel=1e-9)


def test_stated_noise_and_a_rest_with_its_inputs_are_part_of_the_choice():
    x, y, u = driven(80, noise=2e-3)
    history = ddmhe.History(x, y, u=u)
    noisy = ddmhe.tune(history, output_noise=0.1, equilibrium=REST, progress=False)
    assert noisy.score > ddmhe.tune(history, progress=False).score + 0.3
    assert set(noisy.table["equilibrium"]) == {True, False}
    with pytest.raises(ddmhe.ShapeError, match=r"equilibrium: expected three items"):
        ddmhe.tune(history, equilibrium=REST[:2], progress=False)


def test_joined_recordings_keep_their_inputs():
    parts = [driven(T, seed=T) for T in (50, 90)]
    joined = ddmhe.History.concat([ddmhe.History(x, y, u=u) for x, y, u in parts])
    tuned = ddmhe.tune(joined, progress=False)
    x, y, u = parts[1]
    rest = ddmhe.History.concat(
        [
            ddmhe.History(*parts[0][:2], u=parts[0][2]),
            ddmhe.History(x[45:], y[45:], u=u[45:]),
            ddmhe.History(x[:23], y[:22], u=u[:22]),
        ]
    )
    default = int(np.flatnonzero(tuned.table["default"])[0])
    error = ddmhe.DdMhe(rest, start="recording").run(y[22:45], u[22:45]).x - x[23:46]
    relative = np.sqrt(np.mean(np.mean(error**2, axis=0) / x.var(axis=0)))
    assert tuned.table["quarter 2"].iloc[default] == pytest.approx(relative, rel=1e-6)


def test_folds_need_their_inputs():
    x, y, u = driven(40)
    fold = (ddmhe.History(x, y, u=u), x[0], y, None, x[1:], [40], np.ones(2))
    with pytest.raises(ddmhe.DdmheError, match="inputs: expected 40 numbers, found 0"):
        validate([fold], [])
    with pytest.raises(ddmhe.DdmheError, match="folds"):
        validate([(*fold[:3], u[:-1], *fold[4:])], [])


def measured(name, state, output, inputs):
    table = np.genfromtxt(DATA / f"{name}.csv", delimiter=",", names=True)
    return [np.column_stack([table[c] for c in group]) for group in (state, output, inputs)]


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_robot_arm():
    """Rates of the joints from angles and torques, in other recordings than the learnt ones."""
    columns = [
        [f"{c}{i}_{unit}" for i in (1, 2, 3)]
        for c, unit in (("w", "rad_s"), ("q", "rad"), ("tau", "Nm"))
    ]
    logs = {n: measured(f"robot_{n}", *columns) for n in ("01", "02", "11", "12", "13")}
    history = ddmhe.History.concat(
        [ddmhe.History(x, y[:-1], u=u[:-1]) for x, y, u in (logs["01"], logs["02"])]
    )
    settings = ddmhe.tune(history, progress=False).settings
    errors, truths = [], []
    for x, y, u in (logs[n] for n in ("11", "12", "13")):
        estimator = ddmhe.DdMhe(history, x_prior=x[0], **settings)
        errors.append(estimator.run(y[:-1], u[:-1]).x - x[1:])
        truths.append(x[1:])
    error = np.sqrt(np.mean(np.vstack(errors) ** 2, axis=0)) / np.vstack(truths).std(axis=0)
    assert np.sqrt(np.mean(error**2)) < 0.6
