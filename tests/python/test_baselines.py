"""Baselines against independent implementations: filterpy, NumPy's lstsq, SciPy's RBFInterpolator,
closed forms."""

import numpy as np
import pytest
import scipy.linalg
from scipy.interpolate import RBFInterpolator

import ddmhe
from ddmhe.baselines import ArxKalman, ErrorStateKalman, KoopmanMhe, Oracle, RidgeFir, thin_plate
from reference import random_system


def linear_case(seed=0, n=3, p=2, noise=0.02, T=80):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, p)
    x, y = system.simulate(rng.standard_normal(n), T + 60)
    noisy = y + noise * rng.standard_normal(y.shape)
    return ddmhe.History(x[: T + 1], noisy[:T]), noisy[T:], x[T + 1 :], rng


@pytest.mark.parametrize("seed", range(5))
def test_the_error_state_filter_is_filterpys_kalman_filter(seed):
    from filterpy.kalman import KalmanFilter

    history, Y, _, _ = linear_case(seed)
    baseline = ErrorStateKalman(history, Q=0.3, R=0.2)
    (x, y) = history.recordings[0]
    ones = np.ones((len(y), 1))
    theta = np.linalg.lstsq(np.hstack([x[:-1], ones]), np.hstack([x[1:], y]), rcond=None)[0].T
    n = x.shape[1]
    kf = KalmanFilter(n, y.shape[1], 1)
    kf.F, kf.B, kf.H = theta[:n, :n], theta[:n, n:], theta[n:, :n]
    kf.Q, kf.R = 0.3 * np.eye(n), 0.2 * np.eye(y.shape[1])
    kf.x, kf.P = x[-1][:, None].copy(), 1e-12 * kf.Q
    expected = []
    for row in Y:
        kf.update(row - theta[n:, n])
        kf.predict(u=np.ones((1, 1)))
        expected.append(kf.x[:, 0].copy())
    np.testing.assert_allclose(baseline.run(Y).x, expected, rtol=1e-8, atol=1e-10)


def test_the_linear_error_state_filter_has_no_offsets():
    history, _, _, _ = linear_case()
    baseline = ErrorStateKalman(history, 1.0, 1.0, affine=False)
    (x, y) = history.recordings[0]
    np.testing.assert_allclose(baseline.A, (np.linalg.pinv(x[:-1]) @ x[1:]).T, atol=1e-9)
    np.testing.assert_allclose(baseline.C, (np.linalg.pinv(x[:-1]) @ y).T, atol=1e-9)
    assert not baseline.e.any()


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_oracles_are_filterpys(kind):
    from filterpy.kalman import ExtendedKalmanFilter, JulierSigmaPoints, UnscentedKalmanFilter

    model, dt, noise = ddmhe.models.detumbling(), 0.5, 0.05
    record = model.simulate(30.0, dt, noise=noise, seed=2)
    start = record.x[0] + 0.02
    mine = Oracle(model, dt, start, noise, prior=0.03, motion=1e-4, kind=kind).run(record.y[:-1]).x

    def forward(x, _=None):
        return x + dt * model.derivative(x)

    def slope(f, x):  # exact: forward and output are polynomials of degree two
        return np.array([(f(x + d) - f(x - d)) / 2 for d in np.eye(3)]).T

    if kind == "ekf":
        kf = ExtendedKalmanFilter(3, 3)
    else:
        points = JulierSigmaPoints(3, kappa=0.0)
        kf = UnscentedKalmanFilter(3, 3, dt, model.output, forward, points)
    kf.x, kf.P, kf.Q, kf.R = (
        start.copy(),
        0.03**2 * np.eye(3),
        1e-8 * np.eye(3),
        noise**2 * np.eye(3),
    )
    expected = []
    if (
        kind == "ukf"
    ):  # filterpy predicts first: the first output meets the sigma points of the prior
        kf.sigmas_f = points.sigma_points(kf.x, kf.P)
    for y in record.y[:-1]:
        if kind == "ekf":
            kf.update(y, lambda x: slope(model.output, x), model.output)
            kf.F = slope(forward, kf.x)
            kf.x, kf.P = forward(kf.x), kf.F @ kf.P @ kf.F.T + kf.Q
        else:
            kf.sigmas_f = points.sigma_points(kf.x, kf.P)
            kf.update(y)
            kf.predict()
        expected.append(kf.x.copy())
    np.testing.assert_allclose(mine, expected, rtol=1e-6, atol=1e-9)


def test_the_filters_covariance_settles_at_the_riccati_solution():
    history, Y, _, _ = linear_case(3)
    baseline = ErrorStateKalman(history, Q=0.1, R=0.5)
    baseline.run(np.tile(Y, (40, 1)))
    P = scipy.linalg.solve_discrete_are(baseline.A.T, baseline.C.T, baseline.Q, baseline.R)
    np.testing.assert_allclose(baseline._P, P, rtol=1e-8, atol=1e-12)


def test_thin_plate_splines_are_scipys_kernel():
    """One centre, no polynomial: RBFInterpolator's coefficients times r² log r gives the kernel
    back."""
    rng = np.random.default_rng(0)
    centres, points = rng.standard_normal((6, 2)), rng.standard_normal((40, 2))
    values = rng.standard_normal(6)
    theirs = RBFInterpolator(centres, values, kernel="thin_plate_spline", degree=1)
    kernel = thin_plate(centres, centres)
    system = np.block(
        [[kernel, np.ones((6, 1)), centres], [np.vstack([np.ones(6), centres.T]), np.zeros((3, 3))]]
    )
    solution = np.linalg.solve(system, np.concatenate([values, np.zeros(3)]))
    mine = thin_plate(points, centres) @ solution[:6] + solution[6] + points @ solution[7:]
    np.testing.assert_allclose(mine, theirs(points), atol=1e-10)
    assert thin_plate(centres[0], centres)[0] == 0


def test_edmd_is_least_squares_on_the_lifted_recording():
    record = ddmhe.models.pendulum().simulate(6.5, 0.065)
    history = ddmhe.History(record.x, record.y[:-1])
    baseline = KoopmanMhe(history, 5, 0.9, 1.0, dimension=8, cut=1e-13)
    lifted = baseline.lift(record.x)
    assert lifted.shape == (101, 8)
    np.testing.assert_allclose(lifted[:, :3], np.hstack([record.x, np.ones((101, 1))]))
    K = np.linalg.lstsq(lifted[:-1], lifted[1:], rcond=None)[0].T
    np.testing.assert_allclose(baseline.K @ lifted[:-1].T, K @ lifted[:-1].T, atol=1e-7)
    np.testing.assert_allclose(baseline.C @ lifted[:-1].T, record.y[:-1].T, atol=1e-7)


def test_the_koopman_window_is_the_minimum_of_its_cost():
    """Against a general minimiser on the cost as written, with full windows and with a lacking
    output."""
    from scipy.optimize import minimize

    record = ddmhe.models.pendulum().simulate(13.0, 0.065, noise=0.01, seed=1)
    history = ddmhe.History(record.x[:101], record.y[:100])
    M, rho, mu = 3, 0.8, 5.0
    baseline = KoopmanMhe(history, M, rho, mu, dimension=6)
    Y = record.y[100:108].copy()
    Y[4] = np.nan
    priors = [baseline.lift(record.x[100])]
    for t, x_hat in enumerate(baseline.run(Y).x, start=1):
        m = min(t, M)
        prior = priors[t - m]

        def cost(z, t=t, m=m, prior=prior):
            total = 2 * rho**m * np.sum((z - prior) ** 2)
            for j in range(m, 0, -1):
                if np.isfinite(Y[t - j]).all():
                    total += rho ** (j - 1) * mu * np.sum((Y[t - j] - baseline.C @ z) ** 2)
                z = baseline.K @ z
            return total

        z = minimize(cost, prior, tol=1e-14).x
        for _ in range(m):
            z = baseline.K @ z
        np.testing.assert_allclose(x_hat, z[:2], atol=1e-5)
        priors.append(baseline.lift(x_hat))


def test_ridge_regression_is_that_of_the_normal_equations():
    history, Y, _, _ = linear_case(5)
    (x, y) = history.recordings[0]
    fir = RidgeFir(history, length=4, weight=1e-3)
    windows = np.array([y[k : k + 4].ravel() for k in range(len(y) - 3)])
    centred, target = windows - windows.mean(0), x[4:] - x[4:].mean(0)
    weight = 1e-3 * np.linalg.norm(centred, 2) ** 2
    W = np.linalg.solve(
        centred.T @ centred + weight * np.eye(centred.shape[1]), centred.T @ target
    ).T
    np.testing.assert_allclose(fir.W, W, atol=1e-10)
    window = np.concatenate([y[-3:].ravel(), Y[0]])
    np.testing.assert_allclose(
        fir.step(Y[0]).x, x[4:].mean(0) + W @ (window - windows.mean(0)), atol=1e-10
    )


def test_arx_finds_hidden_lags():
    """x depends on a state that is neither recorded nor measured: one lag is not enough, several
    are."""
    rng = np.random.default_rng(1)
    A = np.array([[0.95, 0.2, 0.0], [-0.2, 0.95, 0.1], [0.0, -0.1, 0.97]])
    s = [rng.standard_normal(3)]
    for _ in range(300):
        s.append(A @ s[-1])
    s = np.array(s)
    history = ddmhe.History(s[:151, :1], s[:150, 2:])
    baseline = ArxKalman(history)
    assert baseline.order > 1
    error = baseline.run(s[150:-1, 2:]).x - s[151:, :1]
    assert np.sqrt(np.mean(error**2)) < 0.01 * s[:, 0].std()


MAKERS = {
    "eskf": lambda h: ErrorStateKalman(h),
    "arx": lambda h: ArxKalman(h),
    "koopman": lambda h: KoopmanMhe(h, 5, 0.9, 1.0, dimension=8),
    "fir": lambda h: RidgeFir(h),
}


@pytest.mark.parametrize("name", MAKERS)
def test_step_run_reset_and_lacking_outputs(name):
    history, Y, x, _ = linear_case(7, noise=1e-3)
    baseline = MAKERS[name](history)
    log = baseline.run(Y)
    assert log.x.shape == x.shape
    baseline.reset()
    steps = np.array([baseline.step(y).x for y in Y])
    np.testing.assert_array_equal(steps, log.x)
    Y[3] = np.nan
    Y[7, 0] = np.nan
    baseline.reset()
    assert np.isfinite(baseline.run(Y).x).all()
    with pytest.raises(ddmhe.ShapeError, match="y_t: expected shape"):
        baseline.step(np.zeros(5))
    with pytest.raises(ddmhe.NotFiniteError, match="y_t: expected finite"):
        baseline.step(np.full(2, np.inf))
    with pytest.raises(ddmhe.ShapeError, match="x_prior: expected shape"):
        baseline.reset(np.zeros(9))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda h: ErrorStateKalman(h, Q=-1.0), "Q: expected a positive"),
        (lambda h: ErrorStateKalman("x"), "history: expected a History"),
        (lambda h: KoopmanMhe(h, 0), "horizon: expected at least 1"),
        (lambda h: KoopmanMhe(h, rho=1.5), "rho, mu: expected"),
        (lambda h: KoopmanMhe(h, dimension=2), "dimension: expected more than"),
        (lambda h: ArxKalman(h, order=0), "order: expected at least 1"),
        (lambda h: RidgeFir(h, length=0), "length: expected at least 1"),
        (lambda h: RidgeFir(h, length=200), "history: expected at least"),
        (lambda h: RidgeFir(h, weight=-1.0), "weight: expected"),
        (
            lambda h: Oracle(ddmhe.models.pendulum(), 0.1, [0.0, 0.0], 0.1, kind="x"),
            "kind: expected",
        ),
    ],
)
def test_wrong_arguments_are_one_clear_error(make, words):
    history, _, _, _ = linear_case()
    with pytest.raises(ddmhe.DdmheError, match=words):
        make(history)


def _pieces(noise):
    """Two recordings of one linear system from far-apart starts, and what follows the second."""
    rng = np.random.default_rng(5)
    A, C = np.array([[0.95, 0.2], [-0.2, 0.95]]), np.array([[1.0, 0.3]])
    pieces = []
    for start, steps in (([3.0, -1.0], 60), ([-40.0, 25.0], 300)):
        x = [np.array(start)]
        for _ in range(steps):
            x.append(A @ x[-1])
        x = np.array(x)
        pieces.append((x, x[:-1] @ C.T + noise * rng.standard_normal((steps, 1))))
    (x_1, y_1), (x_2, y_2) = pieces
    both = ddmhe.History.concat([ddmhe.History(x_1, y_1), ddmhe.History(x_2[:61], y_2[:60])])
    return both, y_2[60:], x_2[61:], (A, C)


@pytest.mark.parametrize(
    "make",
    [
        ErrorStateKalman,
        lambda h: ErrorStateKalman(h, affine=False),
        lambda h: ArxKalman(h, 2),
        lambda h: RidgeFir(h, 6),
        lambda h: KoopmanMhe(h, 20, 0.95, 1e2, cut=1e-6),
    ],
    ids=["eskf", "eskf-linear", "arx", "fir", "koopman"],
)
def test_no_row_crosses_the_seam_of_joined_recordings(make):
    """Noise-free: one row across the seam, a jump of 40, would spoil a fit that is exact
    otherwise."""
    history, Y, truth, _ = _pieces(0.0)
    error = make(history).run(Y).x - truth
    assert np.abs(error[20:]).max() < 2e-3 * np.abs(truth).max()


def test_the_models_of_joined_recordings_are_exact():
    from ddmhe import design

    history, _, _, (A, C) = _pieces(0.0)
    model = design.identify(history)
    np.testing.assert_allclose(model.A, A, atol=1e-9)
    np.testing.assert_allclose(model.C, C, atol=1e-9)
    assert design.pole_placement(history).rank == 2
    assert "quarter" in str(list(ddmhe.tune(history, progress=False).table.columns))


def test_a_last_recording_shorter_than_the_window():
    history, _, _, _ = _pieces(0.0)
    (x, y), _ = history.recordings
    short = ddmhe.History.concat([ddmhe.History(x, y), ddmhe.History(x[:3], y[:2])])
    assert np.isfinite(RidgeFir(short, 6).run(y).x).all()
    assert np.isfinite(ArxKalman(short).run(y).x).all()
    with pytest.raises(
        ddmhe.RankError, match="history: expected more than 6 samples, also in the last"
    ):
        ArxKalman(short, 5)


def test_what_is_masked_or_none_is_not_measured():
    history, Y, _, _ = _pieces(0.01)
    Y = Y[:40].copy()
    Y[[3, 7, 8]] = np.nan
    masked = np.ma.array(np.where(np.isnan(Y), -9999.0, Y), mask=np.isnan(Y))
    objects = np.where(np.isnan(Y), None, Y.astype(object))
    for make in (ErrorStateKalman, ArxKalman, RidgeFir):
        expected = make(history).run(Y).x
        for given in (masked, objects, objects.tolist()):
            np.testing.assert_array_equal(make(history).run(given).x, expected)
        each = make(history)
        np.testing.assert_array_equal([each.step(y).x for y in masked], expected)
        with pytest.raises(
            ddmhe.NotFiniteError, match=r"x_prior: .* missing \(masked, None or NA\) at entry 1"
        ):
            make(history).reset([1.0, None])


def test_an_unstable_fit_does_not_explode():
    """A state that the outputs do not show and that grew while it was recorded: the fit is
    unstable, the filter not."""
    k = np.arange(120)
    rng = np.random.default_rng(0)
    growing = 0.1 * 1.1 ** (k / 2) * np.cos(k / 3)
    seen = np.cos(k / 5)
    x = np.column_stack([seen, growing]) + 1e-3 * rng.standard_normal((120, 2))
    y = x[:, :1] + 1e-3 * rng.standard_normal((120, 1))
    gap = np.vstack([np.cos(np.arange(120, 900)[:, None] / 5), np.full((900, 1), np.nan)])
    for order in (None, 1, 2, 5):
        log = ArxKalman(ddmhe.History(x, y[:-1]), order).run(gap)
        assert np.abs(log.x).max() < 10 * np.abs(x).max()
    stable = ddmhe.models.pendulum().simulate(13.0, 0.065, integrator="accurate")
    free = ArxKalman(ddmhe.History(stable.x, stable.y[:-1]), 2)
    assert np.abs(np.linalg.eigvals(free._A)).max() <= 1
