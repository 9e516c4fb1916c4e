"""Seeds of one experiment: their errors, their scatter, and what an estimator that fails leaves."""

import numpy as np
import pytest

import ddmhe
from ddmhe.reproduce.montecarlo import Trial, Trials, estimates


def test_trials_know_their_errors():
    """Two seeds, an estimator that is off by 1 and one that fails half way."""
    t = np.arange(1, 5) * 0.5
    x = np.zeros((4, 2))
    wrong, failed = np.full((4, 2), [0.6, 0.8]), np.zeros((4, 2))
    failed[2:] = np.nan
    trials = Trials([Trial(t, x, x, {"wrong": k * wrong, "failed": failed}) for k in (1, 3)])
    assert trials.rms("wrong").tolist() == pytest.approx([1.0, 3.0])
    assert np.isinf(trials.rms("failed")).all()
    assert trials.rms("failed", 0.0, 1.0).tolist() == [0.0, 0.0]
    assert np.isinf(trials.rms("failed", 1.0, 1.5)).all()
    assert trials.band("wrong")[[0, 2], 0].tolist() == pytest.approx([1.0, 3.0])


def test_an_estimator_that_raises_is_reported_as_failed():
    class Broken:
        def run(self, Y):
            raise np.linalg.LinAlgError("singular")

    found = estimates({"broken": Broken}, np.zeros((3, 1)), 2)
    assert np.isnan(found["broken"]).all()
    assert found["broken"].shape == (3, 2)


def test_scatter_is_free_of_bias_and_drift():
    t = np.linspace(0.01, 1, 100)
    noise = 0.1 * np.random.default_rng(0).standard_normal((100, 1))
    x = np.zeros((100, 1))
    drift = 3 + 5 * (t - 0.3)[:, None] ** 3
    failed = noise.copy()
    failed[60:] = np.nan
    trials = Trials([Trial(t, x, x, {"still": noise, "drifts": noise + drift, "failed": failed})])
    assert trials.scatter("drifts", 0, 1) == pytest.approx(trials.scatter("still", 0, 1), rel=1e-9)
    assert trials.scatter("still", 0, 1)[0] == pytest.approx(0.1, rel=0.15)
    assert np.isinf(trials.scatter("failed", 0, 1)[0])


class _Raising:
    def __init__(self, error):
        self.error = error

    def run(self, Y):
        raise self.error


def test_only_numbers_out_of_bounds_count_as_diverged():
    """A wrong shape, a wrong argument or a fault of the code is an error, not an estimator that
    diverged."""
    from ddmhe.baselines import ErrorStateKalman
    from ddmhe.reproduce.montecarlo import estimates

    rng = np.random.default_rng(0)
    history, Y = (
        ddmhe.History(rng.standard_normal((41, 2)), rng.standard_normal((40, 1))),
        np.zeros((9, 1)),
    )
    wild = ErrorStateKalman(history, Q=1.0, R=1e300)
    wild.A *= 1e90
    found = estimates(
        {"wild": lambda: wild, "lost": lambda: _Raising(np.linalg.LinAlgError("singular"))}, Y, 2
    )
    assert np.isnan(found["wild"][-1]).all()
    assert np.isnan(found["lost"]).all()
    for make, kind in (
        (lambda: ddmhe.DdMhe(history, horizon=0), ddmhe.DdmheError),
        (lambda: _Raising(ValueError("operands could not be broadcast together")), ValueError),
        (lambda: _Raising(ddmhe.ShapeError("Y: expected 2 columns")), ddmhe.ShapeError),
        (
            lambda: ErrorStateKalman(
                ddmhe.History(rng.standard_normal((41, 2)), np.zeros((40, 3)))
            ),
            ddmhe.ShapeError,
        ),
        (
            lambda: ErrorStateKalman(
                ddmhe.History(rng.standard_normal((41, 3)), np.zeros((40, 1)))
            ),
            ddmhe.ShapeError,
        ),
    ):
        with pytest.raises(kind):
            estimates({"wrong": make}, Y, 2)
