"""Tuning from the recording alone: what it promises of its choice, and how it goes about it."""

import os
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe._core import validate
from ddmhe.report import pooled_nrmse
from ddmhe.reproduce import pendulum_task
from ddmhe.tuning.surrogate import Surrogate
from reference import random_system

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "repoimu-pendulum"
)


def detumbling(noise=0.01, seed=1, sigma_x=0.0):
    record = ddmhe.models.detumbling().simulate(60.0, 0.1, noise=noise, seed=seed)
    x = record.x[:201] + sigma_x * np.random.default_rng(seed).standard_normal((201, 3))
    return ddmhe.History(x, record.y[:200], dt=0.1), record


@pytest.fixture(scope="module")
def tuned():
    history, _ = detumbling()
    return ddmhe.tune(history)


LENGTHS = [80, pytest.param(200, marks=pytest.mark.long)]


@pytest.fixture(scope="module", params=LENGTHS)
def first(request):
    """A recording and its tuning, for what compares it with another one; short, and as long as that
    of `tuned`."""
    x, y = detumbling()[0].recordings[0]
    history = ddmhe.History(x[: request.param + 1], y[: request.param], dt=0.1)
    return history, ddmhe.tune(history)


def test_the_settings_make_a_stable_estimator_that_is_near_the_best_in_hindsight(tuned):
    """Every setting that was tried, run over the 40 s that follow: at most 1.3 times the least
    error, a quarter of the way to the worst."""
    history, record = detumbling()
    estimator = ddmhe.DdMhe(history, **tuned.settings)
    assert (estimator.horizon, estimator.rho, estimator.mu) == (tuned.horizon, tuned.rho, tuned.mu)
    assert estimator.spectral_radius <= 1.005

    def error(settings):
        log = ddmhe.DdMhe(history, start=tuned.start, **settings).run(record.y[200:-1])
        return np.linalg.norm(log.x - record.x[201:], axis=1).mean()

    stable = tuned.table["spectral radius"] <= 1.005
    tried = [error(c) for c, use in zip(tuned.candidates, stable, strict=True) if use]
    assert max(tried) > 2.2 * min(tried)  # the choice matters
    assert error(tuned.settings) < 1.3 * min(tried)


def test_the_table_ranks_what_was_tried(tuned):
    table = tuned.table
    assert len(table) == len(tuned.candidates) > 50
    assert table["rated"].iloc[1:].is_monotonic_increasing  # after the chosen one
    assert tuned.score == table["score"].iloc[0]
    assert np.isfinite(table["rehearsed"][table["spectral radius"] <= 1.005]).all()
    stable = table[table["spectral radius"] <= 1.005]
    assert np.isfinite(stable["score"]).all()
    assert not np.isfinite(table["rated"][table["spectral radius"] > 1.005]).any()
    quarters = table[[f"quarter {q}" for q in (1, 2, 3, 4)]].iloc[0]
    assert np.log(quarters).mean() == pytest.approx(tuned.score)
    assert "held-out quarters" in tuned.words
    assert "rehearsals" in tuned.words


def test_the_scores_are_those_of_estimators_fitted_by_hand(tuned):
    """Row by row: fit on three quarters as two recordings, estimate the fourth, relative to the
    spread."""
    history, _ = detumbling()
    (x, y) = history.recordings[0]
    for row in (0, 5, 20):
        for q in (1, 2):
            a, z = 50 * q, 50 * (q + 1)
            rest = ddmhe.History.concat(
                [ddmhe.History(x[z:], y[z:]), ddmhe.History(x[: a + 1], y[:a])]
            )
            estimator = ddmhe.DdMhe(rest, **tuned.candidates[row], start="recording")
            error = estimator.run(y[a:z]).x - x[a + 1 : z + 1]
            relative = np.sqrt(np.mean(np.mean(error**2, axis=0) / x.var(axis=0)))
            assert tuned.table[f"quarter {q + 1}"].iloc[row] == pytest.approx(relative, rel=1e-9)


@pytest.mark.parametrize("threads", ["1", "3"])
def test_the_number_of_threads_makes_no_other_choice(first, threads, monkeypatch):
    history, tuned = first
    monkeypatch.setenv("RAYON_NUM_THREADS", threads)
    again = ddmhe.tune(history)
    assert repr(again.settings) == repr(tuned.settings)
    np.testing.assert_array_equal(again.table["score"], tuned.table["score"])


def test_another_rounding_makes_no_other_choice(first):
    """One unit in the last digit of every state moves no score that decides by more than 1e-5."""
    history, tuned = first
    (x, y) = history.recordings[0]
    signs = np.random.default_rng(0).choice([-1.0, 1.0], x.shape)
    again = ddmhe.tune(ddmhe.History(np.nextafter(x, np.inf * signs), y, dt=0.1))
    stable = tuned.table["spectral radius"] <= 1.005
    assert again.table["rated"][stable].to_numpy() == pytest.approx(
        tuned.table["rated"][stable].to_numpy(), abs=1e-5
    )
    assert (again.horizon, str(again.space)) == (tuned.horizon, str(tuned.space))


def test_units_do_not_matter(first):
    history, tuned = first
    (x, y) = history.recordings[0]
    scaled = ddmhe.tune(ddmhe.History(1e3 * x + 5.0, 1e-4 * y - 1.0, dt=0.1))
    assert scaled.horizon == tuned.horizon
    assert str(scaled.space) == str(tuned.space)
    assert scaled.mu == tuned.mu
    assert scaled.score == pytest.approx(tuned.score, rel=1e-4)
    assert scaled.promise == pytest.approx(1e3 * tuned.promise, rel=1e-4)
    assert np.array(scaled.range) == pytest.approx(1e3 * np.array(tuned.range), rel=1e-3)


def test_stated_output_noise_is_part_of_the_validation(first):
    """A hundred times the recorded noise: the held-out errors grow, and more smoothing is chosen or
    tied."""
    history, tuned = first
    noisy = ddmhe.tune(history, output_noise=1.0)
    assert noisy.score > tuned.score + 0.5
    assert ddmhe.tune(history, output_noise=[1e-9] * 3).score == tuned.score


def test_a_known_rest_is_taken_where_it_helps():
    """A brake whose torque bends over: the known rest tells where the motion goes, the recording
    does not."""
    speed = np.linspace(0.0, 100.0, 60)
    curve = ddmhe.models.TorqueCurve(speed, 60.0 * 2 * (speed / 80) / (1 + (speed / 80) ** 2))
    record = ddmhe.models.spin_down(omega_0=60.0, inertia=0.6, torque_curve=curve).simulate(
        4.5, 0.01, noise=0.5
    )
    x = record.x[:51] + 0.1 * np.random.default_rng(0).standard_normal((51, 1))
    history = ddmhe.History(x, record.y[:50], dt=0.01)
    with_rest = ddmhe.tune(history, equilibrium=([0.0], [0.0]))
    assert set(with_rest.table["equilibrium"]) == {True, False}

    def error(settings):
        return np.sqrt(
            np.mean((ddmhe.DdMhe(history, **settings).run(record.y[50:-1]).x - record.x[51:]) ** 2)
        )

    assert "equilibrium" in with_rest.settings
    assert "rest was chosen" in with_rest.words
    assert error(with_rest.settings) < 0.5 * error(ddmhe.tune(history).settings)


def test_the_surrogate_is_the_system_where_that_is_quadratic():
    """Euler's equations by forward Euler are quadratic: fitted to 20 s, the surrogate predicts the
    next 80 s to five
    per cent."""
    history, _ = detumbling(noise=0.0)
    (x, y) = history.recordings[0]
    surrogate = Surrogate(x, y, (np.zeros(3), np.zeros(3)))
    assert surrogate.misfit < 0.1
    motion, outputs = surrogate.motion(surrogate.best, 1000)
    truth = ddmhe.models.detumbling().simulate(100.0, 0.1)
    assert np.abs(motion - truth.x).max() < 0.05 * np.abs(truth.x).max()
    assert np.abs(outputs - truth.y[:-1]).max() < 0.05 * np.abs(truth.y).max()


def test_drawn_motions_fit_the_recording_and_spread_beyond():
    history, _ = detumbling(sigma_x=1e-3)
    (x, y) = history.recordings[0]
    surrogate = Surrogate(x, y, (np.zeros(3), np.zeros(3)))
    assert surrogate.noise_x == pytest.approx(1e-3, rel=0.15)
    assert surrogate.noise_y == pytest.approx(0.01, rel=0.15)
    assert 0.7 < surrogate.misfit < 1.3
    drawn = [surrogate.motion(surrogate.draw(np.random.default_rng(k)), 300)[0] for k in range(8)]
    inside = [np.sqrt(np.mean((d[:201] - x) ** 2)) for d in drawn]
    assert np.median(inside) < 1.1e-3  # the noise, and little more
    beyond, within = (
        np.std([d[300] for d in drawn], axis=0),
        np.std([d[100] for d in drawn], axis=0),
    )
    assert (beyond > 3 * within).any()


def test_hidden_states_are_not_rehearsed():
    """A pendulum of which only the rate was recorded: the quarters alone decide, and the words say
    so."""
    record = ddmhe.models.pendulum().simulate(12.0, 0.05)
    history = ddmhe.History(record.x[:201, 1:], record.x[:200, 1:] ** 2, dt=0.05)
    tuned = ddmhe.tune(history)
    assert tuned.table["rehearsed"].isna().all()
    assert "Nothing here tests motion outside" in tuned.words


def test_several_recordings():
    rng = np.random.default_rng(0)
    system = random_system(rng, 2, 1)
    parts = []
    for steps in (30, 80):
        x, y = system.simulate(rng.standard_normal(2), steps)
        parts.append(ddmhe.History(x + 1e-3 * rng.standard_normal(x.shape), y, dt=1.0))
    tuned = ddmhe.tune(ddmhe.History.concat(parts))
    assert np.isfinite(tuned.score)
    assert ddmhe.DdMhe(ddmhe.History.concat(parts), **tuned.settings).spectral_radius <= 1.005


def linear(seed, noise=0.0, T=120):
    """A recording of a random linear system with its state, and what follows; noise relative to the
    spread."""
    rng = np.random.default_rng([seed, 11])
    x, y = random_system(rng, 2, 1).simulate(rng.standard_normal(2), 2 * T)
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    recorded = x[: T + 1] + noise * x.std(axis=0) * rng.standard_normal((T + 1, 2))
    return ddmhe.History(recorded, y[:T]), y[T:], x[T + 1 :]


@pytest.mark.parametrize("recorded", [{"seed": 1, "T": 60}, {"seed": 1, "noise": 0.1, "T": 30}])
def test_the_default_rule_is_kept_bit_for_bit_where_nothing_is_shown(recorded):
    """Everything is exact without noise, and a short noisy recording shows nothing beyond doubt."""
    history, outputs, _ = linear(**recorded)
    tuned = ddmhe.tune(history)
    assert tuned.settings == {}
    assert "cannot tell" in tuned.words
    assert tuned.ratio.tolist() == [1.0, 1.0]
    for start in ({}, {"start": tuned.start}):
        expected = ddmhe.DdMhe(history, **start).run(outputs).x
        np.testing.assert_array_equal(
            ddmhe.DdMhe(history, **tuned.settings, **start).run(outputs).x, expected
        )
    default = ddmhe.DdMhe(history)
    assert (tuned.horizon, tuned.rho, tuned.mu, tuned.space) == (
        default.horizon,
        default.rho,
        default.mu,
        "auto",
    )


def test_the_default_rule_is_left_where_another_setting_is_better_beyond_doubt():
    """A slow oscillator recorded almost without noise: the default rule would trust outputs that
    are noisy later."""
    A = 0.997 * np.array([[np.cos(0.15), -np.sin(0.15)], [np.sin(0.15), np.cos(0.15)]])
    x = np.array([np.linalg.matrix_power(A, k) @ [1.0, 0.5] for k in range(201)])
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        recorded = x[:101] + 1e-4 * rng.standard_normal((101, 2))
        y = x @ [1.0, 0.3]
        noise = np.where(np.arange(201) < 100, 1e-4, 0.2)
        y = (y + noise * rng.standard_normal(201))[:, None]
        history = ddmhe.History(recorded, y[:100])
        tuned = ddmhe.tune(history, output_noise=0.2)
        assert tuned.settings
        assert "was left" in tuned.words

        def error(settings, history=history, y=y, start=tuned.start):
            return np.sqrt(
                np.mean(
                    (ddmhe.DdMhe(history, **settings, start=start).run(y[100:-1]).x - x[101:]) ** 2
                )
            )

        assert error(tuned.settings) < 0.5 * error({})
        assert (tuned.ratio < 0.6).all()


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize(
    "which", [slice(9, 16, 6), pytest.param(slice(None), marks=pytest.mark.long)]
)
def test_no_measured_pendulum_is_worse_than_with_the_defaults(stated, which):
    """Logs 9 and 15: all four quarters prefer a short window by a third, and it loses
    afterwards."""
    paths = sorted(DATA.glob("*.csv"))[which]
    assert paths
    for path in paths:
        task = pendulum_task(path)
        ((x, y),) = task.history.recordings
        history = ddmhe.History(
            x, y, **({"x_units": "rad/s", "y_units": "m/s^2"} if stated else {})
        )
        tuned = ddmhe.tune(history)
        chosen, default = (
            pooled_nrmse(ddmhe.DdMhe(history, **settings).run(task.Y).x, task.x)
            for settings in (tuned.settings | {"start": tuned.start}, {"start": "recording"})
        )
        assert chosen <= default
        assert (tuned.range[0] <= tuned.promise).all()
        assert (tuned.promise <= tuned.range[1]).all()


def test_the_promise_is_the_error_on_ends_of_the_recording():
    history, _, _ = linear(5, noise=0.05, T=80)
    tuned = ddmhe.tune(history)
    ((x, y),) = history.recordings
    squares = []
    for share in (0.6, 0.7, 0.8, 0.9):
        k = int(share * 80)
        learnt = ddmhe.DdMhe(ddmhe.History(x[: k + 1], y[:k]), **tuned.settings, start="recording")
        squares.append(np.mean((learnt.run(y[k:]).x - x[k + 1 :]) ** 2, axis=0))
    assert tuned.promise == pytest.approx(np.sqrt(np.mean(squares, axis=0)), rel=1e-9)


def test_later_errors_stay_in_the_range():
    """Of 40 states of 20 oscillators, with and without noise that drives them; nine in ten are
    promised."""
    inside, factors = [], []
    for seed in range(20):
        rng = np.random.default_rng([seed, 4])
        T, angle, drive = (60, 100)[seed % 2], rng.uniform(0.05, 0.4), (0.0, 0.05)[seed // 2 % 2]
        A = rng.uniform(0.985, 1.0) * np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        x = [rng.standard_normal(2)]
        for _ in range(2 * T):
            x.append(A @ x[-1] + drive * rng.standard_normal(2))
        x = np.array(x)
        noise = (0.01, 0.1)[seed // 4 % 2]
        y = x @ rng.standard_normal((2, 1)) + noise * rng.standard_normal((2 * T + 1, 1))
        history = ddmhe.History(x[: T + 1] + noise * rng.standard_normal((T + 1, 2)), y[:T])
        tuned = ddmhe.tune(history)
        estimates = ddmhe.DdMhe(history, **tuned.settings, start=tuned.start).run(y[T:-1]).x
        error = np.sqrt(np.mean((estimates - x[T + 1 :]) ** 2, axis=0))
        lo, hi = tuned.range
        inside += ((lo <= error) & (error <= hi)).tolist()
        factors += (hi / tuned.promise).tolist()
        assert ((lo <= tuned.promise) & (tuned.promise <= hi)).all()
    assert np.mean(inside) >= 0.9
    assert np.median(factors) < 5.0


def test_a_recording_too_short_to_tell_promises_nothing_of_a_state_that_it_hardly_shows():
    x = np.random.default_rng(3).standard_normal((23, 6)).cumsum(axis=0)
    tuned = ddmhe.tune(ddmhe.History(x, x[:-1, :1]))
    assert tuned.settings == {}
    assert "cannot tell" in tuned.words
    beyond = tuned.range[1] > x.std(axis=0)
    assert beyond.any()
    assert "of such a state the recording promises nothing" in tuned.words
    assert (tuned.range[0] < tuned.promise).all()
    assert (tuned.promise < tuned.range[1]).all()


def test_errors_name_the_argument():
    history, _ = detumbling()
    x = np.random.default_rng(0).standard_normal((15, 1))
    cases = [
        (dict(history=x), "history: expected a History"),
        (
            dict(history=ddmhe.History(x, x[:-1])),
            "history: expected a recording of at least 20 samples",
        ),
        (
            dict(history=history, output_noise=[1.0, 2.0]),
            "output_noise: expected a number or 3 numbers",
        ),
        (dict(history=history, output_noise=-1.0), "output_noise: expected finite numbers"),
        (dict(history=history, equilibrium=([0.0], [0.0])), "equilibrium: expected 3 numbers"),
    ]
    for arguments, message in cases:
        with pytest.raises(ddmhe.DdmheError, match=message):
            ddmhe.tune(**arguments)


def test_validate_checks_its_folds():
    history, _ = detumbling()
    good = (history, np.zeros(3), np.zeros((2, 3)), None, np.zeros((2, 3)), [1, 2], np.ones(3))
    assert validate([good], [(0, {"horizon": 10_000})]) == [
        ([np.inf, np.inf], np.inf)
    ]  # too long: no error, no use
    for fold, jobs, message in (
        ((history, np.zeros(2), *good[2:]), [], "folds: expected 3 numbers"),
        ((*good[:4], np.zeros((3, 3)), [1], good[6]), [], "truth: expected 6 numbers"),
        ((*good[:5], [3], good[6]), [], "spans: expected 1 to 2 estimates"),
        ((*good[:6], [1.0, 0.0, 1.0]), [], "spread: expected positive numbers"),
        ((*good[:3], np.zeros((2, 1)), *good[4:]), [], "folds: expected"),
        (good, [(1, {})], "jobs: expected folds below 1"),
        (good, [(0, {"colour": 1})], "jobs: expected a setting of DdMhe"),
    ):
        with pytest.raises(ddmhe.DdmheError, match=message):
            validate([fold], jobs)


def test_the_surrogates_slope_is_that_of_its_residuals():
    history, _ = detumbling(sigma_x=1e-3)
    (x, y) = history.recordings[0]
    for rest in (None, (np.zeros(3), np.zeros(3))):
        surrogate = Surrogate(x, y, rest)
        parameters = surrogate.best
        slope = surrogate._jacobian(parameters)
        for k in range(0, len(parameters), 4):
            h = 1e-6 * max(abs(parameters[k]), 1e-3) * np.eye(len(parameters))[k]
            difference = (
                surrogate._residuals(parameters + h) - surrogate._residuals(parameters - h)
            ) / (2 * h[k])
            assert slope[:, k] == pytest.approx(difference, abs=1e-4 * np.abs(slope[:, k]).max())


def test_a_surrogate_whose_sensitivities_overflow_explains_nothing():
    x = np.random.default_rng(3).standard_normal((401, 2)).cumsum(0)
    x[:351, 1] = 0.0  # at rest, then away
    with pytest.raises(ddmhe.RankError, match="three quarters"):
        ddmhe.tune(ddmhe.History(x, x[:-1, :1]))
