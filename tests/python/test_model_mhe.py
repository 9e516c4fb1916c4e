"""ModelMhe against DdMhe, Kalman's filter, a dense MAP estimate and the QP as written."""

from types import SimpleNamespace

import numpy as np
import pytest
import quadprog
import scipy.linalg

import ddmhe
from ddmhe.baselines import ModelMhe
from ddmhe.baselines.least_distance import least_distance
from forced import random_case

BOUND = 0.1
"""Online noise is uniform within it."""


def log_of(seed, inputs):
    """A case with bounded online noise and lost outputs, settings, and boxes about the truth."""
    case = random_case(seed, inputs=inputs)
    rng = np.random.default_rng(1000 + seed)
    Y = case.Y + rng.uniform(-BOUND, BOUND, case.Y.shape)
    Y[9:12] = Y[rng.random(Y.shape) < 0.15] = np.nan
    settings = (int(rng.integers(1, 9)), rng.uniform(0.6, 0.99), 10 ** rng.uniform(-1, 3))
    start = case.x[0] + 0.3 * rng.standard_normal(len(case.e))
    lo, hi = case.x.min(axis=0), case.x.max(axis=0)
    boxes = {
        "free": {},
        "x": {"x_bounds": (lo + 0.1 * (hi - lo), hi - 0.1 * (hi - lo))},
        "v": {"v_bounds": (-2 * BOUND, 2 * BOUND)},
        "x and v": {"x_bounds": (lo - 1e-9, hi + 1e-9), "v_bounds": (-BOUND, BOUND)},
    }
    return case, Y, settings, start, boxes


def agree_with_the_estimator(seed, inputs):
    """The steps at which bounds were active."""
    case, Y, settings, start, boxes = log_of(seed, inputs)
    held = 0
    for name, bounds in boxes.items():
        x_0 = case.x[0] if name == "x and v" else start
        theirs = ddmhe.DdMhe(
            case.history, *settings, space=ddmhe.Exact(), start="state", x_prior=x_0, **bounds
        )
        mine = ModelMhe(case.history, *settings, x_prior=x_0, **bounds)
        for k, y in enumerate(Y):
            u = None if case.U is None else case.U[k]
            one, other = theirs.step(y, u), mine.step(y, u)
            if "infeasible" in (one.status, other.status):
                assert one.status == other.status
                break
            size = max(1.0, np.abs(one.window).max())
            np.testing.assert_allclose(other.window, one.window, atol=1e-8 * size)
            np.testing.assert_allclose(other.v, one.v, atol=1e-8 * size)
            np.testing.assert_allclose(other.cost, one.cost, rtol=1e-7, atol=1e-8)
            np.testing.assert_array_equal(other.x, other.window[-1])
            held += other.active > 0
    return held


@pytest.mark.parametrize("inputs", [False, True], ids=["free", "forced"])
def test_on_exact_recordings_it_is_the_data_driven_estimator(inputs):
    held = [agree_with_the_estimator(seed, inputs) for seed in range(6)]
    assert min(held) > 0
    assert sum(held) > 100


@pytest.mark.long
@pytest.mark.parametrize("inputs", [False, True], ids=["free", "forced"])
@pytest.mark.parametrize("seed", range(100))
def test_long_on_exact_recordings_it_is_the_data_driven_estimator(seed, inputs):
    agree_with_the_estimator(seed, inputs)


def given_model(case, Q, R):
    """The true model with its noise, as any object."""
    noise = scipy.linalg.block_diag(Q, R)
    return SimpleNamespace(
        A=case.A, B=case.B, e=case.e, C=case.C, D=case.D, r=case.r, residual=noise
    )


def noisy_case(seed, inputs=True):
    """A case with disturbance and noise of known, full covariances, and lost outputs."""
    rng = np.random.default_rng(2000 + seed)
    case = random_case(seed, inputs=inputs, noise=0.1, disturbance=0.05)
    n, p = len(case.e), len(case.r)
    root_Q, root_R = rng.standard_normal((n, n)), rng.standard_normal((p, p))
    Q, R = 0.01 * root_Q @ root_Q.T, 0.05 * root_R @ root_R.T + 0.01 * np.eye(p)
    Y = case.Y.copy()
    Y[rng.random(Y.shape) < 0.1] = np.nan
    Y[20:23] = np.nan
    return case, Q, R, Y


def kalman(case, Q, R, Y, x, P):
    """Predicted means and covariances by the textbook filter in information form."""
    means, covariances = [], []
    for k, y in enumerate(Y):
        seen = ~np.isnan(y)
        u = np.zeros(0) if case.U is None else case.U[k]
        C, S = case.C[seen], np.linalg.inv(R[np.ix_(seen, seen)])
        information = np.linalg.inv(P) + C.T @ S @ C
        error = y[seen] - (case.C @ x + case.D @ u + case.r)[seen]
        x = x + np.linalg.solve(information, C.T @ S @ error)
        x = case.A @ x + case.B @ u + case.e
        P = case.A @ np.linalg.inv(information) @ case.A.T + Q
        means.append(x)
        covariances.append(P)
    return np.array(means), covariances


@pytest.mark.parametrize("lost", [False, True], ids=["all", "lost"])
@pytest.mark.parametrize("seed", range(8))
def test_with_recorded_weights_and_no_bounds_it_is_the_kalman_filter(seed, lost):
    """Stationary without lost outputs, time-varying with them; at every horizon."""
    case, Q, R, Y = noisy_case(seed, inputs=seed % 2 == 0)
    Y = Y if lost else case.Y
    P = scipy.linalg.solve_discrete_are(case.A.T, case.C.T, Q, R)
    expected, _ = kalman(case, Q, R, Y, case.x[0] + 0.1, P)
    for horizon in (1, 3, 12):
        mhe = ModelMhe(
            given_model(case, Q, R),
            horizon,
            weights="recorded",
            process_noise=Q,
            x_prior=case.x[0] + 0.1,
        )
        np.testing.assert_allclose(mhe.run(Y, case.U).x, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_the_window_is_the_dense_map_estimate(seed):
    """By covariances: everything in the window given the outputs that were seen."""
    case, Q, R, Y = noisy_case(seed)
    n, M = len(case.e), 6
    start = case.x[0] + 0.1
    P_0 = scipy.linalg.solve_discrete_are(case.A.T, case.C.T, Q, R)
    means, covariances = kalman(case, Q, R, Y, start, P_0)
    means, covariances = np.vstack([start, means]), [P_0, *covariances]
    mhe = ModelMhe(given_model(case, Q, R), M, weights="recorded", process_noise=Q, x_prior=start)
    for t in range(1, 31):
        estimate = mhe.step(Y[t - 1], case.U[t - 1])
        m = min(t, M)
        x, P = means[t - m], covariances[t - m]
        # [x(0); w(0); …; w(m-1)] to the states
        prior = scipy.linalg.block_diag(P, *[Q] * m)
        rows, mean = [np.eye(n, n * (m + 1))], [x]
        for k in range(m):
            rows.append(case.A @ rows[-1])
            rows[-1][:, n * (k + 1) : n * (k + 2)] += np.eye(n)
            mean.append(case.A @ mean[-1] + case.B @ case.U[t - m + k] + case.e)
        S, mean_x = np.vstack(rows), np.concatenate(mean)
        Theta = scipy.linalg.block_diag(*[case.C] * m) @ S[:-n]
        mean_y = np.concatenate(
            [case.C @ mean[k] + case.D @ case.U[t - m + k] + case.r for k in range(m)]
        )
        window = Y[t - m : t].ravel()
        seen = ~np.isnan(window)
        noise = scipy.linalg.block_diag(*[R] * m)[np.ix_(seen, seen)]
        innovation = np.linalg.solve(
            Theta[seen] @ prior @ Theta[seen].T + noise, window[seen] - mean_y[seen]
        )
        z = prior @ Theta[seen].T @ innovation
        np.testing.assert_allclose(estimate.window.ravel(), mean_x + S @ z, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(estimate.w.ravel(), z[n:], atol=1e-9)
        np.testing.assert_allclose(
            estimate.cost, (window[seen] - mean_y[seen]) @ innovation, rtol=1e-8
        )


def written_qp(case, m, prior, weight_x, weight_y, weight_w, Y, U, boxes, block):
    """The window's QP over [x(0); w of each block] for quadprog, and its minimiser's window."""
    n, p = len(case.e), len(case.r)
    blocks = -(-m // block)
    rows, mean, outputs, mean_y = [np.eye(n, n * (1 + blocks))], [np.zeros(n)], [], []
    drive = []
    for k in range(m):
        b = k // block
        drive.append(np.zeros((n, n * (1 + blocks))))
        drive[-1][:, n * (b + 1) : n * (b + 2)] = np.eye(n)
        outputs.append(case.C @ rows[-1])
        mean_y.append(case.C @ mean[-1] + case.D @ U[k] + case.r)
        rows.append(case.A @ rows[-1] + drive[-1])
        mean.append(case.A @ mean[-1] + case.B @ U[k] + case.e)
    S, Theta, W = np.vstack(rows), np.vstack(outputs), np.vstack(drive)
    mean_x, rest = np.concatenate(mean), Y.ravel() - np.concatenate(mean_y)
    seen = ~np.isnan(rest)
    V = np.repeat(weight_y, p)[seen]
    lengths = [min(block, m - k) for k in range(0, m, block)]
    H = scipy.linalg.block_diag(weight_x * np.eye(n), *[b * weight_w for b in lengths])
    H = H + Theta[seen].T @ (V[:, None] * Theta[seen])
    g = Theta[seen].T @ (V * rest[seen])
    g[:n] += weight_x * prior
    G, limits = [], []
    (x_lo, x_hi), (v_lo, v_hi), (w_lo, w_hi) = boxes
    G += [S, -S, -Theta[seen], Theta[seen], W, -W]
    limits += [x_lo - mean_x, mean_x - x_hi, v_lo - rest[seen], rest[seen] - v_hi]
    limits += [np.full(len(W), w_lo), np.full(len(W), -w_hi)]
    try:
        z = quadprog.solve_qp(H, g, np.vstack(G).T.copy(), np.concatenate(limits))[0]
    except ValueError:  # no window is inside of all bounds
        return None
    v = rest - Theta @ z
    cost = weight_x * np.sum((z[:n] - prior) ** 2) + np.sum(V * v[seen] ** 2)
    w = W @ z
    d = z[n:].reshape(blocks, n)
    cost += sum(b * di @ weight_w @ di for b, di in zip(lengths, d, strict=True))
    return S @ z + mean_x, v, w, cost


@pytest.mark.parametrize("block", [1, 2])
@pytest.mark.parametrize("seed", range(5))
def test_with_a_disturbance_it_minimises_the_cost_as_stated(seed, block):
    """Paper weights, all three boxes, lost outputs: against the QP as written, window by window."""
    case, Q, R, Y = noisy_case(seed)
    n, p = len(case.e), len(case.r)
    Q = Q + 1e-3 * np.eye(n)
    M, rho, mu = 5, 0.9, 3.0
    half = np.abs(case.x).max()
    boxes = ((-half, 0.9 * half), (-0.25, 0.3), (-0.1, 0.08))
    mhe = ModelMhe(
        given_model(case, Q, R),
        M,
        rho,
        mu,
        process_noise=Q,
        x_prior=case.x[0],
        x_bounds=boxes[0],
        v_bounds=boxes[1],
        w_bounds=boxes[2],
        block=block,
    )
    unit = mu * np.trace(R) / p
    priors, held = [case.x[0]], 0
    for t in range(1, len(Y) + 1):
        estimate = mhe.step(Y[t - 1], case.U[t - 1])
        priors.append(estimate.x)
        m = min(t, M)

        def as_written(t=t, m=m):
            return written_qp(
                case,
                m,
                priors[t - m],
                2 * rho**m,
                mu * rho ** np.arange(m - 1, -1, -1.0),
                unit * np.linalg.inv(Q),
                Y[t - m : t],
                case.U[t - m : t],
                boxes,
                block,
            )

        expected = as_written()
        assert (expected is None) == (estimate.status == "infeasible")
        if expected is None:  # the newest output is left out, now and later
            Y[t - 1] = np.nan
            expected = as_written()
        if expected is None:
            continue
        window, v, w, cost = expected
        np.testing.assert_allclose(estimate.window.ravel(), window, atol=1e-8 * half)
        np.testing.assert_allclose(estimate.v.ravel(), v, atol=1e-8 * half)
        np.testing.assert_allclose(estimate.w.ravel(), w, atol=1e-8)
        np.testing.assert_allclose(estimate.cost, cost, rtol=1e-7, atol=1e-9)
        held += estimate.active > 0
    assert held >= 3


@pytest.mark.parametrize("seed", range(30))
def test_least_distance_is_quadprogs(seed):
    rng = np.random.default_rng(seed)
    k, r = int(rng.integers(1, 60)), int(rng.integers(1, 12))
    N = rng.standard_normal((k, r)) * 10 ** rng.uniform(-2, 2, (k, 1))
    inside = N @ (3 * rng.standard_normal(r))
    width = np.abs(N).max(axis=1) * rng.uniform(0, 1, k)
    lo, hi = inside - width, inside + width
    hi[rng.random(k) < 0.2] = np.inf
    finite = np.isfinite(hi)
    G, limits = np.vstack([N, -N[finite]]), np.concatenate([lo, -hi[finite]])
    expected = quadprog.solve_qp(np.eye(r), np.zeros(r), G.T.copy(), limits)[0]
    found = least_distance(N, lo, hi)
    assert found.status == "optimal"
    np.testing.assert_allclose(found.t, expected, atol=1e-9 * (1 + np.abs(expected).max()))
    lost = least_distance(np.vstack([N, N[:1]]), np.append(lo, hi[0] + 1), np.append(hi, np.inf))
    assert lost.status == ("infeasible" if finite[0] else "optimal") or not finite[0]


def test_a_model_of_design_is_the_recordings_own():
    case, Y, settings, start, _ = log_of(3, False)
    from ddmhe import design

    identified = ModelMhe(design.identify(case.history), *settings, x_prior=start).run(Y)
    np.testing.assert_array_equal(
        identified.x, ModelMhe(case.history, *settings, x_prior=start).run(Y).x
    )


def test_defaults_start_at_the_last_recorded_state_with_mu_from_the_recording():
    case = random_case(4, inputs=False)
    mhe = ModelMhe(case.history)
    x, y = case.history.recordings[0]
    assert (mhe.horizon, mhe.rho) == (20, ddmhe._core.DEFAULT_RHO)
    np.testing.assert_allclose(mhe.mu, 0.1 * x.var(axis=0).mean() / y.var(axis=0).mean())
    assert np.abs(mhe.run(case.Y).x - case.x[1:]).max() < 1e-9 * np.abs(case.x).max()
    mhe.reset(case.x[5])
    assert np.abs(mhe.run(case.Y[5:]).x - case.x[6:]).max() < 1e-9 * np.abs(case.x).max()


def test_an_outlier_beyond_all_windows_is_left_out():
    """Bounded noise: one status, and the estimate of the log without this output."""
    case = random_case(5)
    Y = case.Y.copy()
    Y[15] += 100.0
    settings = {"x_prior": case.x[0], "v_bounds": (-0.2, 0.2)}
    log = ModelMhe(case.history, 3, 0.9, 1.0, **settings).run(Y, case.U)
    Y[15] = np.nan
    without = ModelMhe(case.history, 3, 0.9, 1.0, **settings).run(Y, case.U)
    assert list(np.flatnonzero(log.status != "optimal")) == [15]
    assert log.status[15] == "infeasible"
    np.testing.assert_array_equal(log.x, without.x)
    assert (without.status == "optimal").all()


def test_a_box_that_holds_no_window_keeps_the_estimate_inside():
    case = random_case(6)
    outside = case.x.max() + 1.0
    log = ModelMhe(case.history, 4, 0.9, 1.0, x_bounds=(outside, outside + 1e-3)).run(
        case.Y, case.U
    )
    assert (log.status[5:] == "infeasible").any()
    assert (log.x >= outside).all()
    assert (log.x <= outside + 1e-3).all()


SNAPSHOTS = {
    "paper": {"horizon": 5, "rho": 0.9, "mu": 2.0, "x_bounds": (-1.0, 1.5)},
    "disturbed": {"horizon": 6, "process_noise": "residual", "w_bounds": (-1, 1), "block": 2},
    "recorded": {"horizon": 4, "weights": "recorded", "process_noise": "residual"},
}


@pytest.mark.parametrize("name", SNAPSHOTS)
def test_step_run_reset_and_snapshots_agree(name):
    case, _, _, Y = noisy_case(2)
    (x, y), u = case.history.recordings[0], case.history.inputs[0]
    rng = np.random.default_rng(0)
    history = ddmhe.History(
        x + 0.01 * rng.standard_normal(x.shape), y + 0.01 * rng.standard_normal(y.shape), u=u
    )
    mhe = ModelMhe(history, **SNAPSHOTS[name])
    log = mhe.run(Y, case.U)
    assert np.isfinite(log.x).all()
    assert "failed" not in log.status
    mhe.reset()
    steps = [mhe.step(y, u) for y, u in zip(Y[:25], case.U[:25], strict=True)]
    np.testing.assert_array_equal([e.x for e in steps], log.x[:25])
    np.testing.assert_array_equal([e.cost for e in steps], log.cost[:25])
    assert (steps[0].w is None) == (name == "paper")
    assert [len(e.window) for e in steps[:3]] == [2, 3, 4]
    assert np.isnan(steps[22].v[-1]).all()
    restored = ModelMhe.restore(mhe.snapshot())
    np.testing.assert_array_equal(restored.run(Y[25:], case.U[25:]).x, log.x[25:])
    restored.reset()
    np.testing.assert_array_equal(restored.run(Y, case.U).x, log.x)


def test_an_estimate_beyond_all_bounds_has_failed_until_the_next_reset():
    model = SimpleNamespace(A=[[1e200]], e=[0.0], C=[[1.0]], r=[0.0])
    mhe = ModelMhe(model, 1, 0.9, 1.0, x_prior=[1.0])
    assert mhe.step([np.nan]).status == "optimal"
    assert mhe.step([np.nan]).status == "failed"
    restored = ModelMhe.restore(mhe.snapshot())
    for each in (mhe, restored):
        log = each.run(np.zeros((2, 1)))
        assert set(log.status) == {"failed"}
        assert np.isnan(log.x).all()
        each.reset()
        assert each.step([np.nan]).x == 1e200


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda h, m: ModelMhe("x"), "model: expected a History or an object with .A"),
        (lambda h, m: ModelMhe(h, 0), "horizon: expected a whole number of at least 1"),
        (lambda h, m: ModelMhe(h, 5, 1.0), r"rho: expected a number in \(0, 1\)"),
        (lambda h, m: ModelMhe(h, 5, 0.9, -1), "mu: expected a positive finite number"),
        (lambda h, m: ModelMhe(m, 5, x_prior=[0, 0]), "mu: .* since the model is given"),
        (lambda h, m: ModelMhe(m, 5, mu=1.0), "x_prior: expected 2 numbers"),
        (lambda h, m: ModelMhe(h, weights="x"), "weights: expected one of paper, recorded"),
        (lambda h, m: ModelMhe(h, weights="recorded"), "process_noise: expected a covariance"),
        (
            lambda h, m: ModelMhe(h, rho=0.9, weights="recorded", process_noise=np.eye(2)),
            "rho: expected none beside",
        ),
        (
            lambda h, m: ModelMhe(m, weights="recorded", process_noise=np.eye(2), x_prior=[0, 0]),
            "weights: expected a model with .residual",
        ),
        (lambda h, m: ModelMhe(h, process_noise=-np.eye(2)), "process_noise: expected a cov"),
        (lambda h, m: ModelMhe(h, process_noise=np.zeros((2, 2))), "process_noise: expected a"),
        (lambda h, m: ModelMhe(h, process_noise=np.eye(3)), "process_noise: expected shape"),
        (
            lambda h, m: ModelMhe(h, process_noise="x"),
            "process_noise: expected one of residual, rec",
        ),
        (
            lambda h, m: ModelMhe(
                SimpleNamespace(**vars(m), residual=np.eye(3)),
                mu=1.0,
                x_prior=[0, 0],
                process_noise="recorded",
            ),
            "process_noise: .* since the model is given",
        ),
        (lambda h, m: ModelMhe(h, w_bounds=(-1, 1)), "w_bounds: expected none without"),
        (lambda h, m: ModelMhe(h, x_bounds=(1, 0)), "x_bounds: expected lo <= hi in every entry"),
        (lambda h, m: ModelMhe(h, x_bounds=(np.nan, 0)), "x_bounds: expected lo <= hi"),
        (lambda h, m: ModelMhe(h, v_bounds=3), r"v_bounds: expected a pair \(lo, hi\), found 3"),
        (lambda h, m: ModelMhe(h, x_bounds=([1, 2, 3], 4)), "x_bounds: expected a scalar, 2 n"),
        (lambda h, m: ModelMhe(h, block=0), "block: expected a whole number"),
        (lambda h, m: ModelMhe(h, x_prior=[0.0]), "x_prior: expected shape"),
        (lambda h, m: ModelMhe(h).step([0.0]), "u: expected 1 numbers, the inputs at the instant"),
        (lambda h, m: ModelMhe(h).step([0.0], [1.0, 2.0]), "u: expected 1 numbers, found a 1-D"),
        (lambda h, m: ModelMhe.restore(b"hello"), "blob: expected a snapshot of a ModelMhe"),
        (lambda h, m: ModelMhe.restore("hello"), "blob: expected bytes"),
        (lambda h, m: ModelMhe.restore(ModelMhe(h).snapshot()[:-9]), "blob: expected a snapshot"),
    ],
)
def test_wrong_arguments_are_one_clear_error(make, words):
    rng = np.random.default_rng(0)
    history = ddmhe.History(
        rng.standard_normal((41, 2)), rng.standard_normal((40, 1)), u=rng.standard_normal((40, 1))
    )
    bare = SimpleNamespace(A=0.5 * np.eye(2), e=np.zeros(2), C=np.ones((1, 2)), r=np.zeros(1))
    with pytest.raises(ddmhe.DdmheError, match=words):
        make(history, bare)


def test_a_disturbance_that_no_filter_can_bound_is_named():
    """A growing mode that the outputs do not show."""
    model = SimpleNamespace(
        A=np.diag([1.1, 0.5]), e=np.zeros(2), C=np.array([[0.0, 1.0]]), r=np.zeros(1)
    )
    model.residual = np.eye(3)
    with pytest.raises(ddmhe.DdmheError, match="process_noise: expected one with a stationary"):
        ModelMhe(model, weights="recorded", process_noise=np.eye(2), x_prior=[0.0, 0.0])
