"""Channels of one unit share a scale, all others have each their own: no unit of a channel decides
anything."""

import numpy as np
import pytest

import ddmhe
from ddmhe.recordings.units import shared, unit_of


def recording(noise, n=3, p=2, T=160, seed=3):
    """A damped oscillation of n states seen through p outputs, recorded and running on."""
    rng = np.random.default_rng(seed)
    A = np.linalg.qr(rng.standard_normal((n, n)))[0] * 0.99
    C = rng.standard_normal((p, n))
    x = [rng.standard_normal(n)]
    for _ in range(T + 100):
        x.append(A @ x[-1] + noise * rng.standard_normal(n))
    x = np.array(x)
    y = x @ C.T + noise * rng.standard_normal((len(x), p)) + 0.3
    return x[: T + 1], y[:T], y[T:-1]


def run(x, y, outputs, x_units=None, y_units=None, **settings):
    return (
        ddmhe.DdMhe(ddmhe.History(x, y, x_units=x_units, y_units=y_units), **settings)
        .run(outputs)
        .x
    )


@pytest.mark.parametrize("factor", [1e-9, 1e-3, 7.0, 1e9])
@pytest.mark.parametrize(
    ("noise", "settings", "tolerance"),
    [
        (0.0, {"space": ddmhe.Exact()}, 1e-8),
        (0.0, {}, 1e-8),
        (0.02, {}, 1e-6),
        (0.2, {}, 1e-6),
        (
            0.02,
            {
                "horizon": 12,
                "rho": 0.9,
                "mu": 0.5,
                "weights": "scaled",
                "space": ddmhe.Truncated(4),
            },
            1e-6,
        ),
        (
            0.02,
            {
                "horizon": 12,
                "mu": 0.5,
                "weights": "scaled",
                "space": ddmhe.Ridge(1e-4, normalised=True),
            },
            1e-6,
        ),
    ],
)
def test_rescaling_one_channel_changes_no_estimate(noise, settings, tolerance, factor):
    x, y, outputs = recording(noise)
    expected = run(x, y, outputs, **settings)
    size = np.abs(expected).max(axis=0)
    for i in range(y.shape[1]):
        scale = np.where(np.arange(y.shape[1]) == i, factor, 1.0)
        assert (
            np.max(np.abs(run(x, y * scale, outputs * scale, **settings) - expected) / size)
            < tolerance
        )
    for i in range(x.shape[1]):
        scale = np.where(np.arange(x.shape[1]) == i, factor, 1.0)
        assert (
            np.max(np.abs(run(x * scale, y, outputs, **settings) / scale - expected) / size)
            < tolerance
        )


@pytest.mark.parametrize("samples", [60, pytest.param(160, marks=pytest.mark.long)])
def test_tune_sees_no_units(samples):
    x, y, _ = recording(0.02, T=samples)
    plain = ddmhe.tune(ddmhe.History(x, y), progress=False)
    for scale in ([1e5, 1.0], [1.0, 1e5]):
        scaled = ddmhe.tune(ddmhe.History(x * [1e-4, 1.0, 10.0], y * scale), progress=False)
        assert str(scaled.settings) == str(plain.settings)
        assert scaled.score == pytest.approx(plain.score, abs=1e-6)
        assert scaled.promise == pytest.approx(plain.promise * [1e-4, 1.0, 10.0], rel=1e-6)
        for ours, theirs in zip(scaled.range, plain.range, strict=True):
            assert ours == pytest.approx(theirs * [1e-4, 1.0, 10.0], rel=1e-5)


def test_channels_of_one_unit_share_a_scale():
    """With common units the estimates are those of pooled scales, and a common factor changes
    nothing."""
    x, y, outputs = recording(0.05)
    y, outputs = y * [1.0, 40.0], outputs * [1.0, 40.0]
    rule = {"process_noise": None}  # weights by scales, not by the noise of the recording
    together = run(x, y, outputs, x_units="rad/s", y_units="V", **rule)
    assert np.allclose(
        run(1e3 * x, 1e-2 * y, 1e-2 * outputs, "rad/s", "V", **rule) / 1e3, together, atol=1e-9
    )
    assert np.allclose(run(x, y, outputs, ["rad/s"] * 3, ["V", "V"], **rule), together, atol=0)
    assert np.abs(run(x, y, outputs, "rad/s", ["V", "mV"], **rule) - together).max() > 1e-4
    # (17) in the units of pooled scales is what one unit means
    mu = 0.1 * np.mean(x.var(axis=0)) / np.mean(y.var(axis=0))
    default = ddmhe.DdMhe(ddmhe.History(x, y, x_units="rad/s", y_units="V"), **rule)
    assert (default.weights, default.mu) == ("scaled", pytest.approx(0.1))
    stated = {"horizon": default.horizon, "rho": default.rho, "mu": mu, "space": "auto"}
    printed = ddmhe.DdMhe(ddmhe.History(x, y, x_units="rad/s", y_units="V"), **stated)
    assert (printed.weights, printed.mu) == ("paper", pytest.approx(mu))
    assert np.allclose(printed.run(outputs).x, together, atol=1e-8)


@pytest.mark.parametrize("units", [None, "one"])
def test_explicit_weights_mean_the_cost_as_printed(units):
    """mu and rho in the units of x and y, whatever the scales: against (17) written down in
    NumPy."""
    x, y, outputs = recording(0.1)
    x, y, outputs = x * [1.0, 30.0, 0.1], y * [5.0, 0.02], outputs * [5.0, 0.02]
    M, rho, mu, weight = 6, 0.8, 3.0, 1e-2
    history = ddmhe.History(x, y, x_units=units, y_units=units)
    estimator = ddmhe.DdMhe(history, M, rho, mu, x_prior=x[-1], space=ddmhe.Ridge(weight))
    estimator.run(outputs[: M - 1])
    estimate = estimator.step(outputs[M - 1])
    windows = np.array(
        [np.r_[x[k : k + M + 1].ravel(), y[k : k + M].ravel()] for k in range(len(y) - M + 1)]
    ).T
    N, n, p = windows.shape[1], 3, 2
    seen = np.r_[np.arange(n), (M + 1) * n + np.arange(M * p)]
    root = np.sqrt(
        np.r_[np.full(n, 2 * rho**M), mu * np.repeat(rho ** np.arange(M - 1, -1, -1.0), p)]
    )
    # alpha sums to one: alpha = 1/N + delta
    basis = np.linalg.svd(np.ones((1, N)))[2][1:].T
    F = np.vstack([root[:, None] * (windows[seen] @ basis), np.sqrt(weight) * basis])
    target = root * (np.r_[x[-1], outputs[:M].ravel()] - windows[seen].mean(axis=1))
    alpha = 1 / N + basis @ np.linalg.lstsq(F, np.r_[target, np.zeros(N)], rcond=None)[0]
    window = windows @ alpha
    assert np.allclose(estimate.window, window[: (M + 1) * n].reshape(-1, n), rtol=1e-7, atol=1e-7)
    misfit = root * (np.r_[x[-1], outputs[:M].ravel()] - window[seen])
    assert estimate.cost == pytest.approx(np.sum(misfit**2), rel=1e-7)


def test_a_channel_that_hardly_moves_does_not_blow_up_its_noise():
    """A constant, one up to rounding, and a little noise of the same unit beside a good output: its
    estimate stays."""
    x, y, outputs = recording(0.01, p=1)
    rng = np.random.default_rng(0)
    alone = np.sqrt(np.mean((run(x, y, outputs)) ** 2))

    def beside(extra_y, extra_outputs):
        both = run(x, np.column_stack([y, extra_y]), np.column_stack([outputs, extra_outputs]))
        return np.sqrt(np.mean((both - run(x, y, outputs)) ** 2)) / alone

    assert beside(np.full(len(y), 1e3), np.full(len(outputs), 1e3)) < 1e-6
    rounding = 1e3 + 1e-13 * rng.standard_normal(len(y) + len(outputs))
    assert beside(rounding[: len(y)], rounding[len(y) :]) < 1e-6
    # whose unit is that of the other: next to nothing in it is next to nothing
    noise = 1e-6 * rng.standard_normal((len(y) + len(outputs), 1))

    def moved(**settings):
        noisy, still = (
            run(
                x,
                np.hstack([y, part[: len(y)]]),
                np.hstack([outputs, part[len(y) :]]),
                y_units="V",
                **settings,
            )
            for part in (noise, 0 * noise)
        )
        return np.sqrt(np.mean((noisy - still) ** 2)) / alone

    assert moved(weights="scaled") < 1e-4
    # the weights of the recording know the noise of every output, in any unit: what is left is what
    # its regression on the state finds by chance, 1/T of what the state tells
    assert moved() < 0.1


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("omega_x_rad_s", "rad/s"),
        ("tz_N_m", "N m"),
        ("torque_kN_m", "kN m"),
        ("acc_z_m_s2", "m/s2"),
        ("nin2_V", "V"),
        ("px_m", "m"),
        ("rate [deg/s]", "deg/s"),
        ("torque (N m)", "N m"),
        ("x", ""),
        ("m_s", "s"),
        ("steering", ""),
        ("state_A2x", ""),
    ],
)
def test_units_of_column_names(name, unit):
    assert unit_of(name) == unit


def test_shared_is_the_mean_over_a_unit():
    assert shared(np.array([1.0, 3.0, 10.0, 20.0]), ["V", "V", "", ""]).tolist() == [
        2.0,
        2.0,
        10.0,
        20.0,
    ]


def test_units_of_a_history():
    x, y, _ = recording(0.1)
    h = ddmhe.History(x, y, x_units="m", y_units=["V", None])
    assert (h.x_units, h.y_units) == (["m"] * 3, ["V", ""])
    assert ddmhe.History(x, y).y_units == ["", ""]
    assert ddmhe.History.concat([h, h]).x_units == ["m"] * 3
    with pytest.raises(ddmhe.ShapeError, match="y_units: expected 1 or 2 names, found 3"):
        ddmhe.History(x, y, y_units=["V", "V", "V"])
    with pytest.raises(ddmhe.DdmheError, match="x_units: expected a string or a list of strings"):
        ddmhe.History(x, y, x_units=3)
    with pytest.raises(ddmhe.DdmheError, match="histories: expected x_units"):
        ddmhe.History.concat([h, ddmhe.History(x, y)])


def test_weights_are_checked():
    x, y, _ = recording(0.1)
    with pytest.raises(ddmhe.DdmheError, match='weights: expected "auto", "paper", "scaled" or'):
        ddmhe.DdMhe(ddmhe.History(x, y), weights="other")
    blob = ddmhe.DdMhe(ddmhe.History(x, y, x_units="m"), weights="scaled", mu=0.3).snapshot()
    again = ddmhe.DdMhe.restore(blob)
    assert (again.weights, again.mu) == ("scaled", pytest.approx(0.3))
