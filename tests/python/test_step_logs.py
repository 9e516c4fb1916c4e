"""Logs of the estimators that are written in Python answer as `Log` does."""

import numpy as np
import pandas as pd
import pytest

import ddmhe

NAMES = ["angle", "rate"]


def recorded(samples=120, seed=2):
    """A damped swing of two states, whose outputs see one of them."""
    rng = np.random.default_rng(seed)
    A = np.array([[1.0, 0.05], [-0.2, 0.98]])
    x = [np.array([1.0, 0.3])]
    for _ in range(samples):
        x.append(A @ x[-1] + 1e-3 * rng.normal(size=2))
    x = np.array(x)
    return x, x[:-1, :1] + 1e-3 * rng.normal(size=(samples, 1))


X, Y = recorded()
H = ddmhe.History(X[:81], Y[:80], dt=0.05)
LATER = Y[80:]
MAKERS = {
    "koopman": lambda: ddmhe.baselines.KoopmanMhe(H, horizon=5),
    "kalman": lambda: ddmhe.baselines.ErrorStateKalman(H),
    "arx": lambda: ddmhe.baselines.ArxKalman(H),
    "model": lambda: ddmhe.baselines.ModelMhe(H),
    "lifted": lambda: ddmhe.LiftedMhe(H),
}


@pytest.fixture(params=MAKERS)
def estimator(request):
    return MAKERS[request.param]()


def test_a_log_has_times_rows_and_slices(estimator):
    log = estimator.run(LATER)
    assert len(log) == 40
    assert log.t == pytest.approx(0.05 * np.arange(1, 41))
    rows = list(log)
    assert [row.t for row in rows] == pytest.approx(log.t)
    assert np.array_equal([row.x for row in rows], log.x)
    part = log[10:15]
    assert (len(part), part.t[0]) == (5, pytest.approx(0.05 * 11))
    assert np.array_equal(part.x, log.x[10:15])
    assert np.array_equal(log[-1].x, log.x[-1])
    assert part == log[10:15] != log[10:16]
    assert repr(log).startswith(f"{type(log).__name__}(N=40, n=2, t=0.05..2 s")
    with pytest.raises(IndexError):
        log[40]


def test_a_run_goes_on_where_the_last_one_ended(estimator):
    whole = estimator.run(LATER)
    estimator.reset()
    first, second = estimator.run(LATER[:15]), estimator.run(LATER[15:])
    assert np.array_equal(np.concatenate([first.x, second.x]), whole.x)
    assert np.concatenate([first.t, second.t]) == pytest.approx(whole.t)
    estimator.reset()
    estimator.step(LATER[0])
    assert estimator.run(LATER[1:]).t == pytest.approx(whole.t[1:])


def test_frames_hold_what_the_estimator_tells(estimator):
    log = estimator.run(LATER)
    frame = log.to_pandas(NAMES)
    assert frame.index.name == "t"
    assert np.array_equal(frame[NAMES].to_numpy(), log.x)
    assert ("status" in frame) == hasattr(log, "status")
    assert ("rate_std" in frame) == hasattr(log, "std")
    polar = log.to_polars(NAMES)
    assert polar.columns == ["t", *frame.columns]
    pd.testing.assert_frame_equal(
        polar.to_pandas().set_index("t"), frame, check_dtype=False, check_index_type=False
    )
    data = log.to_xarray(NAMES)
    assert np.array_equal(data.x, log.x)
    assert list(data.state.values) == NAMES
    assert ("std" in data) == hasattr(log, "std")
    with pytest.raises(ddmhe.DdmheError, match="names: expected 2 texts"):
        log.to_pandas(["angle"])


def test_one_output_needs_no_second_dimension(estimator):
    wanted = estimator.run(LATER).x
    estimator.reset()
    assert np.array_equal(estimator.run(LATER[:, 0]).x, wanted)
    estimator.reset()
    assert np.array_equal(estimator.run(LATER[:, 0].tolist()).x, wanted)


def test_plots_take_them(estimator):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    log = estimator.run(LATER)
    _, ax = pyplot.subplots()
    assert ddmhe.plot.states(log, ax, truth=X[81:], names=NAMES) is ax
    assert [line.get_label() for line in ax.get_lines()][1::2] == NAMES
    pyplot.close("all")
    _, ax = pyplot.subplots()
    assert ddmhe.plot.errors(log, X[81:], ax) is ax
    if not hasattr(log, "evidence"):
        with pytest.raises(ddmhe.DdmheError, match="log: expected one with evidence"):
            ddmhe.plot.evidence(log, ax)
    pyplot.close("all")


def test_the_clock_survives_a_snapshot():
    for maker in (MAKERS["model"], MAKERS["lifted"]):
        estimator = maker()
        estimator.run(LATER[:10])
        again = type(estimator).restore(estimator.snapshot())
        assert again.run(LATER[10:]) == estimator.run(LATER[10:])
        assert again.t == 40


def test_rigid_bodies_and_intervals_take_one_output_as_it_is():
    s = ddmhe.models.detumbling().simulate(20.0, 0.1, noise=1e-4, seed=1)
    body = ddmhe.RigidBodyMhe(ddmhe.History(s.x[:121], s.y[:120, :1], 0.1))
    wanted = body.run(s.y[120:, :1]).x
    body.reset()
    assert np.array_equal(body.run(s.y[120:, 0]).x, wanted)

    system = ddmhe.interval.System(
        np.array([[0.9, 0.1], [0.0, 0.8]]),
        np.array([[1.0, 0.0]]),
        np.eye(2),
        np.eye(1),
        None,
        None,
        np.zeros((2, 2)),
        np.zeros((2, 2)),
    )
    gain = ddmhe.interval.design_observer(system, lam=0.5)
    make = lambda: ddmhe.interval.IntervalObserver(  # noqa: E731
        system, gain, np.zeros(2), np.ones(2), 0.01 * np.ones(2), [0.01]
    )
    y = np.zeros(8)
    assert np.array_equal(make().run(y[:, None]).lower, make().run(y).lower)
