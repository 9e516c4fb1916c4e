"""A fitted disturbance beside the weights of (17): against ModelMhe on exact recordings, against
the problem as written on noisy ones, and what it is worth."""

import copy
import pickle

import numpy as np
import pytest
import quadprog
import scipy.linalg

import ddmhe
from ddmhe.baselines import ModelMhe
from disturbed import Noisy, blocks, by_recording, fitted
from driven import Driven
from forced import random_case


def covariance(rng, n, rank=None):
    root = rng.standard_normal((n, n if rank is None else rank))
    return 0.05**2 * root @ root.T


def boxes_about(case, rng):
    """Boxes that the log touches, by name."""
    lo, hi = case.x.min(axis=0), case.x.max(axis=0)
    x_box = (lo + 0.1 * (hi - lo), hi - 0.1 * (hi - lo))
    w_box = (-0.02, 0.03 * rng.uniform(0.5, 1, len(case.e)))
    return {
        "free": {},
        "x": {"x_bounds": x_box},
        "v": {"v_bounds": (-0.12, 0.1)},
        "w": {"w_bounds": w_box},
        "x and w": {"x_bounds": x_box, "w_bounds": w_box},
        "v and w": {"v_bounds": (-0.4, 0.4), "w_bounds": (-0.2, 0.2)},
    }


def same_estimate(one, other, size):
    """Everything about a step, to 1e-8 of the states' size."""
    assert one.status == other.status
    for name in ("x", "window", "v", "w"):
        found, expected = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(found, expected, atol=1e-8 * size, err_msg=name)
    np.testing.assert_allclose(one.cost, other.cost, rtol=1e-7, atol=1e-8)


def stable_settings(case, Q, rng):
    """M, ρ and μ at which the prior is forgotten: otherwise rounding grows as errors do."""
    while True:
        M, rho, mu = int(rng.integers(1, 14)), rng.uniform(0.6, 0.99), 10 ** rng.uniform(-1, 3)
        made = ddmhe.DdMhe(case.history, M, rho, mu, space=ddmhe.Exact(), process_noise=Q)
        if made.spectral_radius < 1:
            return M, rho, mu


def agree_with_the_model(seed, inputs):
    """The steps at which bounds were active, over all boxes."""
    case = random_case(seed, inputs=inputs, noise=0.1, disturbance=0.05)
    rng = np.random.default_rng(3000 + seed)
    n, Y = len(case.e), case.Y.copy()
    Y[9:12] = Y[rng.random(Y.shape) < 0.15] = np.nan
    Q = covariance(rng, n, rank=int(rng.integers(1, n + 1)))
    M, rho, mu = stable_settings(case, Q, rng)
    start = case.x[0] + 0.3 * rng.standard_normal(n)
    held = {}
    for name, boxes in boxes_about(case, rng).items():
        common = {"x_prior": start, "process_noise": Q, **boxes}
        ours = ddmhe.DdMhe(case.history, M, rho, mu, space=ddmhe.Exact(), start="state", **common)
        model = ModelMhe(case.history, M, rho, mu, block=max(1, M // 4), **common)
        held[name] = 0
        for k, y in enumerate(Y):
            u = None if case.U is None else case.U[k]
            one, other = ours.step(y, u), model.step(y, u)
            if "infeasible" in (one.status, other.status):
                assert one.status == other.status
                break
            same_estimate(one, other, max(1.0, np.abs(other.window).max()))
            held[name] += one.active > 0
    return held


@pytest.mark.parametrize("inputs", [False, True], ids=["free", "forced"])
def test_on_exact_recordings_it_is_model_based_estimation(inputs):
    """Offsets, feed-through, lost outputs, boxes on everything, Q of any rank."""
    held = [agree_with_the_model(seed, inputs) for seed in range(6)]
    for name in ("x", "v", "w", "x and w", "v and w"):
        assert sum(each[name] for each in held) > 10, name


@pytest.mark.long
@pytest.mark.parametrize("inputs", [False, True], ids=["free", "forced"])
@pytest.mark.parametrize("seed", range(100))
def test_long_on_exact_recordings_it_is_model_based_estimation(seed, inputs):
    agree_with_the_model(seed, inputs)


def as_written(problem, prior, y, boxes):
    """Minimiser over [α; one w for each block], 1ᵀα = 1, by quadprog: states, noise, w and cost.

    `problem`: (windows as z moves them, ρ, μ, weight on ‖α‖², price of ‖w‖²_{Q⁻¹}, Q, b)."""
    moved, rho, mu, weight, price, Q, b = problem
    n = len(Q)
    m = len(moved.w) // n
    N = moved.x.shape[1] - m * n
    spread, lengths = blocks(m, b, n)
    to_z = scipy.linalg.block_diag(np.eye(N), spread)
    X, Yz, W = moved.x @ to_z, moved.y @ to_z, moved.w @ to_z
    seen = ~np.isnan(y)
    V = np.repeat(mu * rho ** np.arange(m - 1, -1, -1.0), len(y) // m)[seen]
    paid = [weight * np.eye(N), *[b * price * np.linalg.inv(Q) for b in lengths]]
    penalty = scipy.linalg.block_diag(*paid)
    H = penalty + 2 * rho**m * X[:n].T @ X[:n] + Yz[seen].T @ (V[:, None] * Yz[seen])
    g = 2 * rho**m * X[:n].T @ prior + Yz[seen].T @ (V * y[seen])
    rows, limits = [np.append(np.ones(N), np.zeros(len(H) - N))[None]], [np.ones(1)]
    for name, at, sign in (("x", X, 1), ("v", Yz, -1), ("w", W, 1)):
        if name in boxes:
            lo, hi = boxes[name]
            if name == "v":  # y - Y z in [lo, hi]
                at, rest = at[seen], y[seen]
                rows += [-at, at]
                limits += [lo - rest, rest - hi]
            else:
                rows += [sign * at, -sign * at]
                limits += [np.full(len(at), lo), np.full(len(at), -hi)]
    z = quadprog.solve_qp(H, g, np.vstack(rows).T.copy(), np.concatenate(limits), meq=1)[0]
    v = y - Yz @ z
    cost = 2 * rho**m * np.sum((X[:n] @ z - prior) ** 2) + np.sum(V * v[seen] ** 2)
    cost += z[N:] @ penalty[N:, N:] @ z[N:]
    return X @ z, v, W @ z, cost


@pytest.mark.parametrize("noise", ["given", "residual"])
@pytest.mark.parametrize("seed", range(6))
def test_on_a_noisy_recording_it_minimises_the_cost_as_written(seed, noise):
    """Two recordings, a ridge on ‖α‖², growing windows, lost outputs, boxes, blocks of b."""
    first, second = (Noisy.random(seed, inputs=False, T=T, n=2) for T in (30, 22))
    history = ddmhe.History.concat([first.history, second.history])
    rng, model = np.random.default_rng(seed), fitted(history)
    Q = model.gamma if noise == "residual" else covariance(rng, 2)
    M, rho, mu, weight = int(rng.integers(5, 11)), 0.9, 3.0, 0.5
    price, b = mu * np.trace(model.R) / history.p, max(1, M // 4)
    Y = second.Y[:25].copy()
    Y[rng.random(Y.shape) < 0.1] = np.nan
    half = np.abs(second.x).max()
    boxes = {} if seed % 2 else {"x": (-0.8 * half, half), "v": (-0.25, 0.3), "w": (-0.1, 0.06)}
    settings = {f"{name}_bounds": box for name, box in boxes.items()}
    estimator = ddmhe.DdMhe(
        history,
        M,
        rho,
        mu,
        x_prior=second.x[0],
        space=ddmhe.Ridge(weight),
        process_noise="residual" if noise == "residual" else Q,
        **settings,
    )
    priors, held = [second.x[0]], 0
    for t, y in enumerate(Y, 1):
        estimate = estimator.step(y)
        priors.append(estimate.x)
        if estimate.status != "optimal":
            pytest.fail(f"step {t}: {estimate.status}")
        m = min(t, M)
        problem = by_recording(history, model, m), rho, mu, weight, price, Q, b
        window, v, w, cost = as_written(problem, priors[t - m], Y[t - m : t].ravel(), boxes)
        np.testing.assert_allclose(estimate.window.ravel(), window, atol=1e-7 * half)
        np.testing.assert_allclose(estimate.v.ravel(), v, atol=1e-7 * half)
        np.testing.assert_allclose(estimate.w.ravel(), w, atol=1e-7 * half)
        # the price of α is no part of it
        np.testing.assert_allclose(estimate.cost, cost, rtol=1e-6, atol=1e-9)
        held += estimate.active > 0
    assert (held > 3) == bool(boxes)


def test_from_the_recording_s_end_the_first_window_is_full():
    """Priors are recorded states, outputs recorded ones, until the log's own fill the window."""
    case = Noisy.random(3, inputs=False, T=40, n=2)
    (x, y), model = case.history.recordings[0], fitted(case.history)
    M, rho, mu, weight = 8, 0.9, 3.0, 0.5
    estimator = ddmhe.DdMhe(
        case.history,
        M,
        rho,
        mu,
        space=ddmhe.Ridge(weight),
        start="recording",
        process_noise="residual",
    )
    price = mu * np.trace(model.R) / case.history.p
    problem = by_recording(case.history, model, M), rho, mu, weight, price, model.gamma, M // 4
    priors, outputs = list(x[-M - 1 :]), list(y[-M:])
    for sample in case.Y[:20]:
        estimate = estimator.step(sample)
        outputs.append(sample)
        window, _, w, _ = as_written(problem, priors[-M], np.concatenate(outputs[-M:]), {})
        np.testing.assert_allclose(estimate.window.ravel(), window, atol=1e-8)
        np.testing.assert_allclose(estimate.w.ravel(), w, atol=1e-8)
        priors.append(estimate.x)


SETTINGS = {
    "residual": {"process_noise": "residual"},
    "recorded": {"process_noise": "recorded"},
    "given": {"process_noise": 1e-3 * np.eye(3), "horizon": 9, "rho": 0.9, "mu": 2.0},
    "scaled": {"process_noise": "residual", "weights": "scaled", "mu": 0.3},
    "truncated": {"process_noise": "residual", "space": ddmhe.Truncated(3), "horizon": 6},
    "boxed": {"process_noise": "residual", "horizon": 8, "w_bounds": (-2e-4, [3e-4, 3e-4, 0.1])},
    "unknown": {"process_noise": "recorded", "start": "unknown", "horizon": 7},
}


@pytest.fixture(scope="module")
def driven_case():
    return Noisy.random(11, x_noise=0.02, n=3)


@pytest.mark.parametrize("name", SETTINGS)
def test_steps_runs_snapshots_and_copies_are_the_same_numbers(name, driven_case):
    case, settings = driven_case, SETTINGS[name]
    Y = case.Y.copy()
    Y[20:23] = np.nan
    estimator = ddmhe.DdMhe(case.history, **settings)
    log = estimator.run(Y, case.U)
    assert np.isfinite(log.x).all()
    assert set(log.status) == {"optimal"}
    estimator.reset()
    steps = [estimator.step(y, u) for y, u in zip(Y[:25], case.U[:25], strict=True)]
    np.testing.assert_array_equal([e.x for e in steps], log.x[:25])
    for made in (
        ddmhe.DdMhe.restore(estimator.snapshot()),
        pickle.loads(pickle.dumps(estimator)),
        copy.copy(estimator),
        copy.deepcopy(estimator),
    ):
        np.testing.assert_array_equal(made.estimate.w, estimator.estimate.w)
        np.testing.assert_array_equal(made.run(Y[25:], case.U[25:]).x, log.x[25:])
    for e in steps:
        depth = len(e.window) - 1
        assert e.w.shape == (depth, 3)
        assert e.v.shape == (depth, case.history.p)
        np.testing.assert_array_equal(e.x, e.window[-1])
    if name == "boxed":
        w = np.concatenate([e.w for e in steps])
        assert (w >= -2e-4 - 1e-9).all()
        assert (w <= np.array([3e-4, 3e-4, 0.1]) + 1e-9).all()
        assert sum(e.active > 0 for e in steps) > 3
    again = ddmhe.DdMhe(case.history, **settings).run(Y, case.U)
    np.testing.assert_array_equal(again.x, log.x)


def test_without_one_nothing_is_fitted_and_nothing_changes(driven_case):
    """None is what was there before, and "auto" beside stated weights is None."""
    case = driven_case
    stated = {"horizon": 8, "rho": 0.9, "mu": 2.0}
    for settings in (stated, stated | {"space": ddmhe.Truncated(4)}, {"weights": "scaled"}):
        plain = ddmhe.DdMhe(case.history, process_noise=None, **settings)
        auto = ddmhe.DdMhe(case.history, **settings)
        np.testing.assert_array_equal(
            plain.run(case.Y, case.U).x, auto.run(case.Y, case.U).x, err_msg=str(settings)
        )
        assert plain.estimate.w is None
        assert auto.estimate.w is None


def test_a_small_one_changes_little_and_a_large_one_all(driven_case):
    case, settings = driven_case, {"horizon": 8, "rho": 0.9, "mu": 2.0}
    plain = ddmhe.DdMhe(case.history, process_noise=None, **settings).run(case.Y, case.U).x
    moved = []
    for size in (1e-14, 1e-7, 1.0):
        each = ddmhe.DdMhe(case.history, process_noise=size * np.eye(3), **settings)
        moved.append(np.abs(each.run(case.Y, case.U).x - plain).max())
    assert moved[0] < 1e-8 < moved[1] < 1e-2 < moved[2]


@pytest.mark.parametrize("settings", [{"weights": "scaled"}, {"horizon": 6, "weights": "scaled"}])
def test_units_of_states_and_outputs_do_not_matter(settings):
    case = Noisy.random(11, inputs=False, x_noise=0.02, n=3)
    (x, y), s_x = case.history.recordings[0], np.array([1e-4, 1.0, 30.0])
    s_y = np.array([1e3, 0.1])[: case.history.p]
    Q = covariance(np.random.default_rng(0), 3)
    scaled = ddmhe.History(x * s_x, y * s_y)
    for ours, theirs in (("recorded", "recorded"), (Q, Q * np.outer(s_x, s_x))):
        one = ddmhe.DdMhe(case.history, process_noise=ours, **settings)
        other = ddmhe.DdMhe(scaled, process_noise=theirs, **settings)
        expected = one.run(case.Y).x
        found = other.run(case.Y * s_y).x / s_x
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_allclose(
            other.estimate.w / s_x, one.estimate.w, atol=1e-6 * np.abs(one.estimate.w).max()
        )


def test_only_what_q_reaches_is_moved():
    """A disturbance of one state alone: no other state has one, and rows of the model say so."""
    case = random_case(21, inputs=False, noise=0.1, disturbance=0.05)
    n, Q = len(case.e), np.zeros((len(case.e),) * 2)
    Q[0, 0] = 0.05**2
    settings = {"space": ddmhe.Exact(), "start": "state", "x_prior": case.x[0]}
    estimator = ddmhe.DdMhe(case.history, 8, 0.9, 10.0, process_noise=Q, **settings)
    assert n > 1
    for y in case.Y:
        e = estimator.step(y)
        assert (e.w[:, 1:] == 0).all()
        model = e.window[:-1] @ case.A.T + case.e + e.w
        np.testing.assert_allclose(e.window[1:], model, atol=1e-9 * np.abs(case.x).max())
    assert np.abs(e.w[:, 0]).max() > 1e-3


def test_a_kick_that_was_never_recorded_is_forgotten_sooner():
    """A jump of the state: the windows of the recording cannot hold it, a disturbance can."""
    A = 0.999 * np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])
    system = Driven(A, np.zeros((2, 0)), np.zeros(2), np.eye(1, 2), np.zeros((1, 0)), np.zeros(1))
    rng, steps = np.random.default_rng(0), 300
    w = 1e-3 * rng.standard_normal((steps, 2))
    w[230] += [0.3, -0.2]
    v = 0.02 * rng.standard_normal((steps, 1))
    x, y = system.simulate([1.0, 0.0], np.zeros((steps, 0)), w, v)
    history = ddmhe.History(x[:201], y[:200])

    def late(noise):
        found = ddmhe.DdMhe(history, horizon=20, weights="scaled", process_noise=noise)
        return np.sqrt(np.mean((found.run(y[200:]).x - x[201:])[35:] ** 2))

    assert late(np.diag([0.1**2, 0.1**2])) < 0.5 * late(None)


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(0)
    return ddmhe.History(rng.standard_normal((61, 2)), rng.standard_normal((60, 1)))


LOPSIDED = np.array([[1.0, 0.5], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            {"process_noise": "some"},
            'process_noise: expected .*"recorded" or "residual", found "some"',
        ),
        ({"process_noise": np.eye(3)}, r"process_noise: expected shape \(2, 2\), found \(3, 3\)"),
        ({"process_noise": [1.0, 2.0]}, r"process_noise: expected .*\(n, n\)"),
        ({"process_noise": 0.1}, r"process_noise: expected .*\(n, n\)"),
        ({"process_noise": LOPSIDED}, "process_noise: expected a covariance, symmetric"),
        ({"process_noise": np.diag([1.0, -0.1])}, "process_noise: expected a covariance"),
        ({"process_noise": [[1.0, 2.0], [2.0, 1.0]]}, "process_noise: expected a covariance"),
        ({"process_noise": np.zeros((2, 2))}, "process_noise: expected a covariance, .* not 0"),
        ({"process_noise": np.diag([1.0, np.nan])}, "process_noise: .*finite"),
        ({"process_noise": np.diag([1.0, np.inf])}, "process_noise: .*finite"),
        ({"w_bounds": (-1, 1)}, "w_bounds: expected none without process_noise"),
        ({"w_bounds": (-1, 1), "process_noise": None}, "w_bounds: expected none without"),
        ({"w_bounds": (1, 0), "process_noise": "residual"}, "w_bounds: .*lo"),
        ({"w_bounds": ([0, 0, 0], 1), "process_noise": "residual"}, "w_bounds: "),
        ({"w_bounds": 3, "process_noise": "residual"}, r"w_bounds: expected .*\(lo, hi\)"),
        ({"w_bounds": (np.nan, 1), "process_noise": "residual"}, "w_bounds: "),
    ],
)
def test_wrong_arguments_are_one_clear_error(settings, words, recording):
    settings = {"rho": 0.9, "mu": 1.0} | settings
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.DdMhe(recording, 5, **settings)


def test_it_does_not_go_beside_a_certificate():
    case = random_case(4, inputs=False)
    certificate = ddmhe.design.ioss(case.history, eta=0.95)
    with pytest.raises(ddmhe.DdmheError, match="process_noise: expected none beside a certificate"):
        ddmhe.DdMhe(case.history, certificate=certificate, process_noise=np.eye(len(case.e)))


def test_an_exact_recording_shows_no_disturbance():
    case = random_case(5, inputs=False)
    for noise in ("residual", "recorded"):
        with pytest.raises(ddmhe.DdmheError, match=r"process_noise: expected .*disturbance"):
            ddmhe.DdMhe(case.history, process_noise=noise)
