"""The references of what an estimate says about itself estimate what the estimator does."""

import numpy as np
import pytest

import ddmhe
from disturbed import Noisy
from evidence_of_recorded import Noises, told
from evidence_of_spaces import Evidence
from evidence_reference import Twin
from gated_reference import Gated
from reference import random_system


def noisy(seed, T=150, steps=70):
    """A recording of a random system with disturbance and noise, and the outputs that follow."""
    case = Noisy.random(seed, inputs=False, x_noise=0.02, T=T, steps=steps)
    return case.history, case.Y


def hidden(seed, T=150, steps=70):
    """Half of the states of a random system alone."""
    rng = np.random.default_rng(seed)
    x, y = random_system(rng, 4, 2).simulate(rng.standard_normal(4), T + steps)
    y = y + 0.01 * rng.standard_normal(y.shape)
    return ddmhe.History(x[: T + 1, :2], y[:T], y_units="V"), y[T:]


def several(seed):
    """Two recordings of one system."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, 3, 2)
    parts = [system.simulate(rng.standard_normal(3), 90) for _ in range(3)]
    parts = [(x + 0.01 * rng.standard_normal(x.shape), y) for x, y in parts]
    history = ddmhe.History.concat([ddmhe.History(x, y, x_units="m") for x, y in parts[:2]])
    return history, parts[2][1]


@pytest.mark.parametrize("make", [noisy, hidden, several])
@pytest.mark.parametrize("seed", range(3))
def test_the_twin_is_the_estimator(make, seed):
    """Estimates and minima, from a state and from an unknown one."""
    history, Y = make(seed)
    est = ddmhe.DdMhe(history, weights="scaled", start="state")
    twin = Twin(history, est)
    last, log = history.recordings[-1][0][-1], est.run(Y)
    trace = twin.run(Y, last)
    np.testing.assert_allclose(trace.x, (log.x - twin.scales.mean_x) / twin.scales.s_x, atol=1e-9)
    np.testing.assert_allclose(trace.J, log.cost, rtol=1e-6, atol=1e-12)
    unknown = ddmhe.DdMhe(history, weights="scaled", start="unknown").run(Y).x
    run = Gated(Evidence(twin), gate=None).run(Y)
    np.testing.assert_allclose(twin.user(np.array(run.x[1:])), unknown, rtol=1e-7, atol=1e-7)


def test_a_gate_that_rejects_nothing_changes_nothing():
    """Also not the covariance, computed step by step or at once."""
    history, Y = noisy(1)
    twin = Twin(history, ddmhe.DdMhe(history, weights="scaled", start="state"))
    evidence, last = Evidence(twin), history.recordings[-1][0][-1]
    trace, run = twin.run(Y, last), Gated(evidence, gate=1e6).run(Y, last)
    np.testing.assert_allclose(np.array(run.x[1:]), trace.x, atol=1e-12)
    np.testing.assert_allclose(np.array(run.Sigma[1:]), evidence.covariance(trace), rtol=1e-9)


def test_a_rejected_output_is_one_that_was_not_measured():
    """By the core, which factors the problem anew."""
    history, Y = noisy(2)
    est = ddmhe.DdMhe(history, weights="scaled", start="state")
    twin, last = Twin(history, est), history.recordings[-1][0][-1]
    spoilt = Y.copy()
    spoilt[40, 0] += 1e3 * history.recordings[0][1].std()
    run = Gated(Evidence(twin)).run(spoilt, last)
    assert run.rejected.sum() == 1
    spoilt[40, 0] = np.nan
    np.testing.assert_allclose(
        twin.user(np.array(run.x[1:])), est.run(spoilt).x, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_filter_is_the_estimator(seed):
    """With the residual covariance for that of the disturbance."""
    history, Y = noisy(seed)
    est = ddmhe.DdMhe(history, weights="recorded", process_noise="residual", start="state")
    noises, last = Noises.of_residuals(history), history.recordings[-1][0][-1]
    found = told(noises, history.recordings, est.horizon, Y, last)
    np.testing.assert_allclose(found.x, est.run(Y).x, rtol=1e-7, atol=1e-7)
    assert (np.linalg.eigvalsh(found.Sigma - noises.P) > -1e-12).all()
