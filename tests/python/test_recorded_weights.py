"""Weights taken from the recording: a Kalman filter without bounds, the most likely window always;
against a textbook filter, a dense estimate, a solver and ModelMhe."""

import copy
import pickle
from types import SimpleNamespace

import cvxpy as cp
import numpy as np
import pytest
import scipy.linalg

import ddmhe
from ddmhe.baselines import ModelMhe
from ddmhe.baselines.linear_model import LinearModel
from ddmhe.baselines.recorded_noise import recorded_noise
from disturbed import Fit, Noisy, by_model, fitted, kalman, most_likely, stationary
from driven import Driven
from forced import random_case


def covariance(seed, n):
    root = np.random.default_rng(seed).standard_normal((n, n))
    return 0.05**2 * (root @ root.T + 0.1 * np.eye(n))


def lost(Y, seed):
    """Some outputs lost, and three instants altogether."""
    Y = Y.copy()
    Y[np.random.default_rng(seed).random(Y.shape) < 0.1] = np.nan
    Y[20:23] = np.nan
    return Y


def estimator(case, Q, start, horizon=12, **settings):
    return ddmhe.DdMhe(
        case.history,
        horizon,
        weights="recorded",
        process_noise=Q,
        start="state",
        x_prior=start,
        **settings,
    )


def with_residual(model, Q):
    """The fit as `ModelMhe` takes it, its outputs' noises apart from each other."""
    return SimpleNamespace(**vars(model), residual=scipy.linalg.block_diag(Q, model.R))


def filtered(case, noise, horizons, *, seed, outputs_lost=False):
    """Against the textbook filter from the stationary P."""
    model = fitted(case.history)
    Q = model.gamma if noise == "residual" else covariance(seed, len(case.e))
    Y = lost(case.Y, seed) if outputs_lost else case.Y
    start = case.x[0] + 0.1
    expected, _ = kalman(model, Q, Y, case.U, start, stationary(model, Q))
    size = np.abs(expected).max()
    for horizon in horizons:
        given = "residual" if noise == "residual" else Q
        log = estimator(case, given, start, horizon).run(Y, case.U)
        assert set(log.status) == {"optimal"}
        np.testing.assert_allclose(log.x, expected, atol=1e-9 * size, err_msg=str(horizon))


@pytest.mark.parametrize("noise", ["given", "residual"])
@pytest.mark.parametrize("seed", range(8))
def test_without_bounds_it_is_the_kalman_filter(seed, noise):
    """At every horizon, with offsets, feed-through and inputs."""
    filtered(Noisy.random(seed, inputs=seed % 2 == 0), noise, (1, 3, 12, 40), seed=seed)


@pytest.mark.parametrize("seed", range(8))
def test_with_lost_outputs_it_is_the_kalman_filter(seed):
    """Its covariance grows where outputs are lost, and settles again."""
    case = Noisy.random(seed, inputs=seed % 2 == 0)
    filtered(case, "given", (1, 3, 12), seed=seed, outputs_lost=True)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100))
def test_long_it_is_the_kalman_filter(seed):
    case = Noisy.random(100 + seed, inputs=seed % 2 == 0)
    filtered(case, "given", (7,), seed=seed)
    filtered(case, "residual", (20,), seed=seed, outputs_lost=True)


@pytest.mark.parametrize("outputs_lost", [False, True], ids=["all", "lost"])
@pytest.mark.parametrize("seed", range(8))
def test_the_window_is_the_most_likely_one(seed, outputs_lost):
    """By covariances: states, disturbance and noise given the outputs seen, and twice the negative
    logarithm of their density."""
    case = Noisy.random(seed)
    model, Q, M = fitted(case.history), covariance(seed, len(case.e)), 6
    Y = lost(case.Y, seed) if outputs_lost else case.Y
    start, P_0 = case.x[0] + 0.1, stationary(model, Q)
    means, covariances = kalman(model, Q, Y, case.U, start, P_0)
    means, covariances = np.vstack([start, means]), [P_0, *covariances]
    mhe = estimator(case, Q, start, M)
    for t in range(1, 31):
        e = mhe.step(Y[t - 1], case.U[t - 1])
        m = min(t, M)
        window = slice(t - m, t)
        prior = means[t - m], covariances[t - m], Q
        x, w, v, cost = most_likely(model, prior, Y[window], case.U[window])
        size = np.abs(means).max()
        np.testing.assert_allclose(e.window.ravel(), x, atol=1e-9 * size)
        np.testing.assert_allclose(e.w.ravel(), w, atol=1e-9 * size)
        np.testing.assert_allclose(e.v.ravel(), v, atol=1e-9 * size)
        np.testing.assert_allclose(e.cost, cost, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("inputs", [False, True], ids=["free", "forced"])
@pytest.mark.parametrize("seed", range(4))
def test_without_words_q_and_r_are_the_most_likely_split(seed, inputs):
    """As `ModelMhe` finds them; "auto" is "recorded"; two recordings, none across the seam."""
    first, second = (Noisy.random(seed, inputs=inputs, x_noise=0.05, T=T) for T in (60, 110))
    history = ddmhe.History.concat([first.history, second.history])
    settings = {"weights": "recorded", "x_prior": second.x[0]}
    expected = ModelMhe(history, 9, process_noise="recorded", **settings).run(second.Y, second.U)
    auto = ddmhe.DdMhe(history, 9, start="state", **settings)
    stated = ddmhe.DdMhe(history, 9, start="state", process_noise="recorded", **settings)
    found = auto.run(second.Y, second.U)
    size = np.abs(expected.x).max()
    np.testing.assert_allclose(found.x, expected.x, atol=1e-8 * size)
    np.testing.assert_allclose(found.cost, expected.cost, rtol=1e-6)
    np.testing.assert_array_equal(stated.run(second.Y, second.U).x, found.x)
    assert (auto.weights, stated.weights) == ("recorded", "recorded")


def of_windows(history, depth=7):
    """The model that moves the n strongest directions of the recorded windows on, by an SVD."""
    (x, y), n = history.recordings[0], history.n
    size = np.concatenate([x.std(axis=0), y.std(axis=0)])
    z = np.hstack([x[:-1], y]) / size
    windows = [np.append(z[k : k + depth], x[k + depth] / size[:n]) for k in range(len(y) - 6)]
    directions = np.linalg.svd(np.array(windows) - np.mean(windows, axis=0))[2][:n]
    strength = np.linalg.svd(np.array(windows) - np.mean(windows, axis=0))[1][:n]
    steps = (directions * strength[:, None])[:, : depth * len(size)].reshape(n, depth, -1)
    last = (directions * strength[:, None])[:, depth * len(size) :]
    after = np.concatenate([steps[:, 1:, :n], last[:, None]], axis=1).reshape(-1, n)
    targets = np.hstack([after, steps[:, :, n:].reshape(-1, len(size) - n)])
    theta = np.linalg.lstsq(steps[:, :, :n].reshape(-1, n), targets, rcond=None)[0].T
    theta = theta * np.append(size[:n], size[n:])[:, None] / size[:n]
    now, then = x[:-1], np.hstack([x[1:], y])
    offset = then.mean(axis=0) - theta @ now.mean(axis=0)
    errors = then - now @ theta.T - offset
    residual = errors.T @ errors / (len(y) - n - 1)
    none = np.zeros((n, 0)), np.zeros((len(size) - n, 0))
    return LinearModel(theta[:n], none[0], offset[:n], theta[n:], none[1], offset[n:], residual)


@pytest.mark.parametrize("seed", [1, 8, 13, 15, 18])
def test_a_model_of_windows_where_states_are_read_with_much_noise(seed):
    """Least squares would damp it; without inputs. Seeds whose N needs no cut to a covariance: the
    cut depends on the scales."""
    case = Noisy.random(seed, inputs=False, x_noise=0.5)
    model = of_windows(case.history)
    said = recorded_noise(case.history, model)
    assert np.trace(said.N) > 0.1 * case.history.n * 0.5**2
    fit = Fit(*(getattr(model, name) for name in "ABeCDr"), gamma=said.Q, R=said.R)
    start = case.x[0]
    expected, _ = kalman(fit, said.Q, case.Y, None, start, stationary(fit, said.Q))
    found = ddmhe.DdMhe(case.history, weights="recorded", start="state", x_prior=start).run(case.Y)
    np.testing.assert_allclose(found.x, expected, atol=1e-7 * np.abs(expected).max())


def boxes_about(case):
    """Boxes that the log touches, by name."""
    lo, hi = case.x.min(axis=0), case.x.max(axis=0)
    x_box = lo + 0.1 * (hi - lo), hi - 0.1 * (hi - lo)
    return {
        "x": {"x_bounds": x_box},
        "v": {"v_bounds": (-0.15, 0.12)},
        "w": {"w_bounds": (-0.03, np.full(len(case.e), 0.02))},
        "all": {"x_bounds": x_box, "v_bounds": (-0.5, 0.4), "w_bounds": (-0.3, 0.3)},
    }


@pytest.mark.parametrize("outputs_lost", [False, True], ids=["all", "lost"])
@pytest.mark.parametrize("name", ["x", "v", "w", "all"])
def test_bounds_are_those_of_model_based_estimation(name, outputs_lost):
    held = 0
    for seed in range(5):
        case = Noisy.random(seed, inputs=seed % 2 == 0)
        Q, start, box = covariance(seed, len(case.e)), case.x[0] + 0.1, boxes_about(case)[name]
        Y = lost(case.Y, seed) if outputs_lost else case.Y
        settings = {"weights": "recorded", "process_noise": Q, "x_prior": start}
        ours = estimator(case, Q, start, 7, **box)
        model = ModelMhe(with_residual(fitted(case.history), Q), 7, **settings, **box)
        for k, y in enumerate(Y):
            u = None if case.U is None else case.U[k]
            one, other = ours.step(y, u), model.step(y, u)
            assert one.status == other.status
            if one.status != "optimal":
                break
            size = max(1.0, np.abs(other.window).max())
            for part in ("window", "v", "w"):
                found, expected = getattr(one, part), getattr(other, part)
                np.testing.assert_allclose(found, expected, atol=1e-8 * size, err_msg=part)
            np.testing.assert_allclose(one.cost, other.cost, rtol=1e-7, atol=1e-8)
            held += one.active > 0
            for part, kind in (("window", "x"), ("v", "v"), ("w", "w")):
                lo, hi = box.get(f"{kind}_bounds", (-np.inf, np.inf))
                seen = getattr(one, part)[~np.isnan(getattr(one, part)).any(axis=1)]
                assert (seen >= lo - 1e-9 * size).all()
                assert (seen <= hi + 1e-9 * size).all()
    assert held > 20


def held_as_written(seed):
    """The steps at which bounds were active."""
    case = Noisy.random(seed)
    n, model, M = len(case.e), fitted(case.history), 5
    Q, start = covariance(seed, n), case.x[0] + 0.1
    P, R = stationary(model, Q), model.R
    box = {"x_bounds": (-0.9 * np.abs(case.x).max(), 0.9 * np.abs(case.x).max())}
    box |= {"v_bounds": (-0.3, 0.3), "w_bounds": (-0.03, 0.02)}
    mhe, priors, held = estimator(case, Q, start, M, **box), [start], 0
    roots = [np.linalg.inv(np.linalg.cholesky(S)) for S in (P, Q, R)]
    for t in range(1, 13):
        e = mhe.step(case.Y[t - 1], case.U[t - 1])
        m = min(t, M)
        moved, x_rest, y_rest = by_model(model, m, case.U[t - m : t])
        z = cp.Variable(n * (m + 1))
        x, v, w = (
            moved.x @ z + x_rest,
            case.Y[t - m : t].ravel() - y_rest - moved.y @ z,
            moved.w @ z,
        )
        terms = [roots[0] @ (x[:n] - priors[t - m])]
        terms += [np.kron(np.eye(m), roots[1]) @ w, np.kron(np.eye(m), roots[2]) @ v]
        limits = []
        for part, name in ((x, "x"), (v, "v"), (w, "w")):
            lo, hi = box[f"{name}_bounds"]
            limits += [part >= lo, part <= hi]
        problem = cp.Problem(cp.Minimize(sum(cp.sum_squares(each) for each in terms)), limits)
        problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        assert e.status == "optimal"
        np.testing.assert_allclose(e.cost, problem.value, rtol=1e-6)
        np.testing.assert_allclose(e.window.ravel(), x.value, atol=1e-5 * np.abs(case.x).max())
        np.testing.assert_allclose(e.w.ravel(), w.value, atol=1e-5)
        priors.append(e.x)
        held += e.active > 0
    return held


def test_bounded_windows_minimise_the_cost_as_written():
    """‖x̂(0) - x̄‖²_{P⁻¹} + Σ‖v̂‖²_{R⁻¹} + Σ‖ŵ‖²_{Q⁻¹} in all boxes, by an interior-point solver."""
    assert sum(held_as_written(seed) for seed in range(4)) > 10


SETTINGS = {
    "free": {},
    "boxed": {"w_bounds": (-0.02, 0.02), "x_bounds": (-50.0, 50.0)},
    "residual": {"process_noise": "residual", "horizon": 9},
    "from the recording": {"start": "recording"},
    "unknown": {"start": "unknown", "horizon": 11},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_steps_runs_snapshots_and_copies_are_the_same_numbers(name):
    """Also in the middle of lost outputs, where a covariance goes along."""
    case = Noisy.random(11, x_noise=0.02, n=3)
    Y = lost(case.Y, 0)
    Y[35:38] = np.nan
    made = ddmhe.DdMhe(case.history, weights="recorded", **SETTINGS[name])
    log = made.run(Y, case.U)
    assert np.isfinite(log.x).all()
    assert set(log.status) == {"optimal"}
    made.reset()
    for k in range(37):
        e = made.step(Y[k], case.U[k])
        np.testing.assert_array_equal(e.x, log.x[k])
        assert e.w.shape == (len(e.window) - 1, 3)
    for again in (
        ddmhe.DdMhe.restore(made.snapshot()),
        pickle.loads(pickle.dumps(made)),
        copy.copy(made),
        copy.deepcopy(made),
    ):
        assert again.weights == "recorded"
        np.testing.assert_array_equal(again.run(Y[37:], case.U[37:]).x, log.x[37:])
        again.reset()
        np.testing.assert_array_equal(again.run(Y, case.U).x, log.x)


def test_a_start_that_is_not_known_is_soon_forgotten():
    """From far away, the filter that knows the start is met again; a believed start is not."""
    case = Noisy.random(4, inputs=False, n=3)
    known = estimator(case, "residual", case.x[0]).run(case.Y).x
    anywhere = ddmhe.DdMhe(
        case.history, 12, weights="recorded", process_noise="residual", start="unknown"
    )
    apart = np.abs(anywhere.run(case.Y).x - known).max(axis=1) / case.x.std()
    assert apart[-10:].max() < 0.05


@pytest.mark.parametrize("what", ["states", "outputs"])
def test_units_do_not_matter(what):
    case = Noisy.random(11, inputs=False, x_noise=0.02, n=3)
    (x, y), s_x, s_y = case.history.recordings[0], np.ones(3), np.ones(case.history.p)
    if what == "states":
        s_x = np.array([1e-5, 1.0, 1e3])
    else:
        s_y = np.array([1e6, 1e-3])[: len(s_y)]
    expected = ddmhe.DdMhe(case.history, weights="recorded").run(case.Y).x
    scaled = ddmhe.DdMhe(ddmhe.History(x * s_x, y * s_y), weights="recorded")
    found = scaled.run(case.Y * s_y).x / s_x
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


@pytest.fixture(scope="module")
def recording():
    return Noisy.random(2, inputs=False, n=2).history


REST = ([0.0, 0.0], None)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rho": 0.9}, "rho: expected none beside weights"),
        ({"mu": 1.0}, "mu: expected none beside weights"),
        ({"space": ddmhe.Exact()}, "space: expected .*beside weights"),
        ({"space": ddmhe.Ridge(1.0)}, "space: expected .*beside weights"),
        ({"space": ddmhe.Truncated(2)}, "space: expected .*beside weights"),
        ({"x_center": "history", "x_bounds": (-1, 1)}, "x_center: expected none beside weights"),
        ({"equilibrium": REST}, "equilibrium: expected none beside weights"),
        ({"process_noise": None}, "process_noise: expected a disturbance beside weights"),
        ({"process_noise": np.zeros((2, 2))}, "process_noise: expected a covariance"),
        ({"process_noise": np.eye(3)}, "process_noise: expected shape"),
        ({"weights": "record"}, r"weights: expected .*\"recorded\""),
        ({"w_bounds": (1.0, -1.0)}, "w_bounds: "),
    ],
)
def test_what_the_weights_of_the_recording_do_not_leave_open(settings, words, recording):
    if settings.get("equilibrium") is REST:
        settings = {"equilibrium": (np.zeros(2), np.zeros(recording.p))}
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.DdMhe(recording, **({"weights": "recorded"} | settings))


def test_no_certificate_goes_beside_them():
    case = random_case(4, inputs=False)
    certificate = ddmhe.design.ioss(case.history, eta=0.95)
    with pytest.raises(ddmhe.DdmheError, match=r"weights: expected .*certificate"):
        ddmhe.DdMhe(case.history, weights="recorded", certificate=certificate)


def test_a_mode_that_grows_unseen_has_no_filter():
    """The outputs do not show it: no covariance is stationary."""
    rng = np.random.default_rng(0)
    none = np.zeros((2, 0)), np.zeros((1, 0))
    system = Driven(
        np.diag([1.02, 0.5]), none[0], np.zeros(2), np.array([[0.0, 1.0]]), none[1], np.zeros(1)
    )
    w, v = 0.1 * rng.standard_normal((100, 2)), 0.1 * rng.standard_normal((100, 1))
    x, y = system.simulate([1.0, 1.0], np.zeros((100, 0)), w, v)
    y = 1e-3 * rng.standard_normal((100, 1)) + 0 * y  # of nothing at all
    model = fitted(ddmhe.History(x, y))
    assert np.abs(np.linalg.eigvals(model.A)).max() > 1.0
    blind = np.zeros((100, 1))
    with pytest.raises(ddmhe.DdmheError, match="process_noise: expected one with a stationary"):
        ddmhe.DdMhe(ddmhe.History(x, blind), weights="recorded", process_noise=np.eye(2))
