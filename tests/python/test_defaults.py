"""The default rule where a one-step model says little: against a plain regression, which needs no
rule."""

import os
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe.baselines import RidgeFir

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "input-logs"
)


def driven(phi, seed, T=800, N=800, dt=0.05):
    """A state that noise drives, and its running sum as output: a rate and a measured angle."""
    rng = np.random.default_rng([seed, 41])
    x = np.zeros(T + N + 1)
    for k in range(T + N):
        x[k + 1] = phi * x[k] + np.sqrt(1 - phi**2) * rng.standard_normal()
    y = np.r_[0.0, np.cumsum(dt * x[:-1])] + 1e-3 * rng.standard_normal(T + N + 1)
    return x[:, None], y[:, None]


@pytest.mark.parametrize("phi", [0.8, 0.9, 0.97, 0.99])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_state_driven_by_noise_is_read_off_a_short_window(phi, seed):
    """As good as 20 taps of regression, which is what the outputs' differences can tell."""
    x, y = driven(phi, seed)
    history = ddmhe.History(x[:801], y[:800])
    estimator = ddmhe.DdMhe(history, warm_start=True)

    def error(x_hat):
        return np.sqrt(np.mean((x_hat - x[801:]) ** 2))

    assert estimator.horizon == 20
    assert error(estimator.run(y[800:-1]).x) < 1.1 * error(RidgeFir(history, 20).run(y[800:-1]).x)


def test_a_complete_state_keeps_the_rule():
    """A small misfit: nothing challenges the rule, and its settings are the stated ones."""
    rng = np.random.default_rng(0)
    A = 0.99 * np.linalg.qr(rng.standard_normal((3, 3)))[0]
    x = [rng.standard_normal(3)]
    for _ in range(200):
        x.append(A @ x[-1] + 0.01 * rng.standard_normal(3))
    x = np.array(x)
    estimator = ddmhe.DdMhe(ddmhe.History(x, x[:-1, :2]), weights="scaled")
    assert (estimator.mu, estimator.rho, estimator.horizon) == (pytest.approx(0.1), 0.95, 20)


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_robot_arm():
    """Joint rates from angles in other recordings than the learnt ones: the rule alone had .77."""

    def log(number):
        table = np.genfromtxt(DATA / f"robot_{number}.csv", delimiter=",", names=True)
        x, y = (
            np.column_stack([table[f"{c}{i}_{unit}"] for i in (1, 2, 3)])
            for c, unit in (("w", "rad_s"), ("q", "rad"))
        )
        return x, y[:-1]

    for units in ({}, {"x_units": "rad/s", "y_units": "rad"}):
        history = ddmhe.History.concat([ddmhe.History(*log(n), **units) for n in ("01", "02")])
        tests = [log(n) for n in ("11", "12", "13")]
        errors = [ddmhe.DdMhe(history, x_prior=x[0]).run(y).x - x[1:] for x, y in tests]
        error = np.sqrt(np.mean(np.vstack([e[20:] for e in errors]) ** 2, axis=0))
        spread = np.vstack([x[1:] for x, _ in tests]).std(axis=0)
        assert np.sqrt(np.mean((error / spread) ** 2)) < 0.35
