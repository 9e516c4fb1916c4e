"""Baselines with known inputs: exact where they can be, better than without u, wrong u is an
error."""

import numpy as np
import pytest

import ddmhe
from ddmhe.baselines import ArxKalman, ErrorStateKalman, KoopmanMhe, ModelMhe, RidgeFir
from reference import random_system

MAKERS = {
    "eskf": ErrorStateKalman,
    "eskf-linear": lambda h: ErrorStateKalman(h, affine=False),
    "arx": lambda h: ArxKalman(h, 2),
    "koopman": lambda h: KoopmanMhe(h, 5, 0.9, 1.0, dimension=6, cut=1e-13),
    "koopman-linear": lambda h: KoopmanMhe(h, 5, 0.9, 1.0, dimension=6, cut=1e-13, relift=False),
    "fir": lambda h: RidgeFir(h, 2, 0.0),
}
ACCURACY = {"arx": 1e-3}  # the others: 1e-9; ARX regresses with a ridge


def forced_case(seed, noise=0.0, *, m=2, offsets=True, seam=False):
    """n = 2, p = 1, feed-through, offsets; a recording and what follows, inputs of changed kind."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, 2, 1)
    B, D = rng.standard_normal((2, m)), rng.standard_normal((1, m))
    u = np.vstack([rng.standard_normal((120, m)), 2 + np.sign(rng.standard_normal((80, m)))])
    x, y = [rng.standard_normal(2)], []
    for k in range(200):
        y.append(system.C @ x[-1] + D @ u[k] + offsets * system.r)
        x.append(system.A @ x[-1] + B @ u[k] + offsets * system.e)
    x, y = np.array(x), np.array(y) + noise * rng.standard_normal((200, 1))
    history = ddmhe.History(x[:121], y[:120], 0.1, u=u[:120])
    if seam:
        parts = [(slice(0, 51), slice(0, 50)), (slice(70, 121), slice(70, 120))]
        history = ddmhe.History.concat([ddmhe.History(x[a], y[b], 0.1, u=u[b]) for a, b in parts])
    return history, y[120:], u[120:], x[121:]


@pytest.mark.parametrize("seam", [False, True], ids=["one", "two"])
@pytest.mark.parametrize("name", MAKERS)
def test_an_exact_system_with_inputs_is_followed_exactly(name, seam):
    for seed in range(3):
        offsets = name != "eskf-linear"
        history, Y, U, truth = forced_case(seed, offsets=offsets, seam=seam)
        error = MAKERS[name](history).run(Y, U).x - truth
        assert np.abs(error).max() < ACCURACY.get(name, 1e-9) * np.abs(truth).max()


@pytest.mark.parametrize("name", MAKERS)
def test_each_beats_itself_without_inputs(name):
    for seed in range(3):
        history, Y, U, truth = forced_case(seed, noise=0.02, offsets=name != "eskf-linear")
        informed = MAKERS[name](history).run(Y, U).x - truth
        ignorant = MAKERS[name](history.without_inputs()).run(Y).x - truth
        assert np.sqrt(np.mean(informed**2)) < 0.5 * np.sqrt(np.mean(ignorant**2))


def test_the_error_state_filter_with_inputs_is_filterpys():
    from filterpy.kalman import KalmanFilter

    history, Y, U, _ = forced_case(4, noise=0.05)
    (x, y), u = history.recordings[0], history.inputs[0]
    before = np.hstack([x[:-1], u, np.ones((len(y), 1))])
    theta = np.linalg.lstsq(before, np.hstack([x[1:], y]), rcond=None)[0].T
    kf = KalmanFilter(2, 1, 3)
    kf.F, kf.B, kf.H = theta[:2, :2], theta[:2, 2:], theta[2:, :2]
    kf.Q, kf.R = 0.3 * np.eye(2), 0.2 * np.eye(1)
    kf.x, kf.P = x[-1][:, None].copy(), 1e-12 * kf.Q
    expected = []
    for row, now in zip(Y, U, strict=True):
        known = np.append(now, 1.0)
        kf.update(row - theta[2:, 2:] @ known)
        kf.predict(u=known[:, None])
        expected.append(kf.x[:, 0].copy())
    found = ErrorStateKalman(history, Q=0.3, R=0.2).run(Y, U).x
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10)
    error = np.hstack([x[1:], y]) - before @ theta.T
    np.testing.assert_allclose(
        ErrorStateKalman(history).R, [[np.mean(error[:, 2] ** 2)]], rtol=1e-9
    )


def test_the_arx_model_with_inputs_is_least_squares_row_by_row():
    """States do not depend on u(k), outputs do; offsets are those of the means."""
    rng = np.random.default_rng(6)
    A = np.array([[0.5, 0.2], [-0.2, 0.6]])
    pieces = []
    for T in (150, 90):
        u, x, y = 3 + rng.standard_normal((T, 1)), [rng.standard_normal(2)], []
        for k in range(T):
            y.append([x[-1][0] + 0.7 * u[k, 0] + rng.standard_normal()])
            x.append(A @ x[-1] + [0.3 * u[k, 0], 1.0] + rng.standard_normal(2))
        pieces.append(ddmhe.History(x, y, u=u))
    baseline = ArxKalman(ddmhe.History.concat(pieces), 2)
    z = [np.hstack([h.recordings[0][0][:-1], h.recordings[0][1]]) for h in pieces]
    u = [h.inputs[0] for h in pieces]
    mean_z, mean_u = np.vstack(z).mean(0), np.vstack(u).mean(0)  # the model passes through them
    rows, now = [], []
    for s, v in zip([part - mean_z for part in z], [part - mean_u for part in u], strict=True):
        for k in range(2, len(s)):
            rows.append(np.concatenate([s[k - 1], s[k - 2], v[k - 1], v[k - 2], v[k]]))
            now.append(s[k])
    rows, now = np.array(rows), np.array(now)
    by_x = np.linalg.lstsq(rows[:, :-1], now[:, :2], rcond=None)[0].T
    by_y = np.linalg.lstsq(rows, now[:, 2:], rcond=None)[0].T
    both = np.vstack([by_x, by_y[:, :-1]])
    np.testing.assert_allclose(baseline._A[:3], both[:, :6], atol=1e-6)
    np.testing.assert_allclose(baseline._B, both[:, 6:], atol=1e-6)
    np.testing.assert_allclose(baseline._D, by_y[:, -1:], atol=1e-6)
    past = np.concatenate([mean_z, mean_z, mean_u, mean_u])
    expected = mean_z - both @ past - [0.0, 0.0, by_y[0, -1] * mean_u[0]]
    np.testing.assert_allclose(baseline._offset, expected, atol=1e-5)
    error = now - np.hstack([rows[:, :-1] @ by_x.T, rows @ by_y.T])
    noise = error.T @ error / (len(rows) - 9)
    np.testing.assert_allclose(baseline._Q[:3, :3], noise, rtol=1e-5)


def test_units_of_inputs_do_not_matter():
    history, Y, U, _ = forced_case(7, noise=0.02)
    (x, y), u = history.recordings[0], history.inputs[0]
    scaled = ddmhe.History(x, y, 0.1, u=u * [1e4, 1e-4])
    for name, make in MAKERS.items():
        if name == "fir":
            make = RidgeFir
        np.testing.assert_allclose(
            make(scaled).run(Y, U * [1e4, 1e-4]).x, make(history).run(Y, U).x, atol=1e-6
        )


@pytest.mark.parametrize("name", MAKERS)
def test_step_and_run_agree_with_inputs_and_gaps(name):
    history, Y, U, _ = forced_case(8, noise=0.02)
    Y = Y.copy()
    Y[[3, 4, 20]] = np.nan
    baseline = MAKERS[name](history)
    assert baseline.m == 2
    log = baseline.run(Y, U)
    assert np.isfinite(log.x).all()
    baseline.reset()
    steps = [baseline.step(y, u).x for y, u in zip(Y, U, strict=True)]
    np.testing.assert_array_equal(steps, log.x)


WRONG_STEPS = {
    "lacking": (None, ddmhe.ShapeError),
    "too long": ([1.0, 2.0, 3.0], ddmhe.ShapeError),
    "single": (3.0, ddmhe.ShapeError),
    "square": (np.zeros((2, 2)), ddmhe.ShapeError),
    "NaN": ([1.0, np.nan], ddmhe.NotFiniteError),
    "infinite": ([-np.inf, 1.0], ddmhe.NotFiniteError),
    "None": ([1.0, None], ddmhe.NotFiniteError),
    "text": ("a", ddmhe.ShapeError),
}
WRONG_RUNS = {
    "lacking": (None, ddmhe.ShapeError),
    "too short": (np.zeros((79, 2)), ddmhe.ShapeError),
    "one channel": (np.zeros((80, 1)), ddmhe.ShapeError),
    "flat": (np.zeros(80), ddmhe.ShapeError),
    "NaN": (np.full((80, 2), np.nan), ddmhe.NotFiniteError),
    "masked": (np.ma.array(np.zeros((80, 2)), mask=True), ddmhe.NotFiniteError),
}


def _message(call, kind):
    with pytest.raises(kind) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize("wrong", WRONG_STEPS)
def test_wrong_inputs_of_a_step_are_the_estimators_errors(wrong):
    history, Y, _, _ = forced_case(9)
    u, kind = WRONG_STEPS[wrong]
    expected = _message(lambda: ddmhe.DdMhe(history, 5).step(Y[0], u), kind)
    assert expected.startswith("u: expected ")
    for make in MAKERS.values():
        assert _message(lambda make=make: make(history).step(Y[0], u), kind) == expected


@pytest.mark.parametrize("wrong", WRONG_RUNS)
def test_wrong_inputs_of_a_run_are_the_estimators_errors(wrong):
    history, Y, _, _ = forced_case(9)
    U, kind = WRONG_RUNS[wrong]
    expected = _message(lambda: ddmhe.DdMhe(history, 5).run(Y, U), kind)
    assert expected.startswith("U: expected ")
    for make in MAKERS.values():
        assert _message(lambda make=make: make(history).run(Y, U), kind) == expected


def test_inputs_that_nobody_asked_for_are_an_error():
    history, Y, U, _ = forced_case(9)
    free = history.without_inputs()
    for make in MAKERS.values():
        for call in ("step", "run"):
            args = (Y[0], U[0]) if call == "step" else (Y, U)
            expected = _message(
                lambda c=call, a=args: getattr(ddmhe.DdMhe(free, 5), c)(*a), ddmhe.ShapeError
            )
            found = _message(
                lambda c=call, a=args, make=make: getattr(make(free), c)(*a), ddmhe.ShapeError
            )
            assert found == expected


def test_a_rejected_step_changes_nothing():
    history, Y, U, _ = forced_case(10, noise=0.02)
    for make in MAKERS.values():
        baseline, other = make(history), make(history)
        baseline.run(Y[:9], U[:9])
        other.run(Y[:9], U[:9])
        with pytest.raises(ddmhe.DdmheError):
            baseline.step(Y[9], [1.0, np.nan])
        np.testing.assert_array_equal(baseline.run(Y[9:], U[9:]).x, other.run(Y[9:], U[9:]).x)


def test_too_few_samples_for_the_effects_of_inputs():
    rng = np.random.default_rng(0)
    short = ddmhe.History(rng.standard_normal((5, 2)), np.zeros((4, 1)), u=np.ones((4, 2)))
    with pytest.raises(ddmhe.RankError, match="history: expected at least 5 outputs"):
        ErrorStateKalman(short)


@pytest.mark.parametrize("name", [*MAKERS, "model"])
def test_an_input_that_never_changed_is_told_from_nothing_and_refused_by_nobody(name):
    others = {"model": lambda h: ModelMhe(h, 5, 0.9, 1.0), "fir": RidgeFir}
    make = (MAKERS | others)[name]
    history, Y, U, _ = forced_case(11, noise=0.02)
    (x, y), u = history.recordings[0], history.inputs[0]
    still = ddmhe.History(x, y, 0.1, u=np.column_stack([u, np.full(len(u), 3.0)]))
    found = make(still).run(Y, np.column_stack([U, np.full(len(U), 3.0)])).x
    expected = make(history).run(Y, U).x
    if name == "eskf-linear":  # a constant input is the offset that this model lacks
        assert np.isfinite(found).all()
    else:
        np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())
