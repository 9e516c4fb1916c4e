"""When the weights of the recording are the default, and what they gain."""

import numpy as np
import pytest
import scipy.linalg

import ddmhe
from driven import Driven
from forced import random_case


def masses(seed, x_noise, T=200):
    """Two masses between springs, positions measured: w 1e-3, v .02."""
    k_1, k_2, c, dt = 1.0, 0.7, 0.05, 0.1
    rates = [[0, 1, 0, 0], [-k_1 - k_2, -c, k_2, 0], [0, 0, 0, 1], [k_2, 0, -k_1 - k_2, -c]]
    A, C = scipy.linalg.expm(np.array(rates) * dt), np.eye(4)[[0, 2]]
    none = np.zeros((4, 0)), np.zeros((2, 0))
    system = Driven(A, none[0], np.zeros(4), C, none[1], np.zeros(2))
    rng, steps = np.random.default_rng(seed), T + 1000
    w, v = 1e-3 * rng.standard_normal((steps, 4)), 0.02 * rng.standard_normal((steps, 2))
    x, y = system.simulate([1.0, 0.0, -0.5, 0.0], np.zeros((steps, 0)), w, v)
    read = x[: T + 1] + x_noise * rng.standard_normal((T + 1, 4))
    return ddmhe.History(read, y[:T], dt), y[T:], x[T + 1 :]


def error(made, Y, truth):
    return np.sqrt(np.mean(np.sum((made.run(Y).x - truth)[100:] ** 2, axis=1)))


@pytest.mark.parametrize(("x_noise", "gain"), [(0.0, 1.05), (0.01, 0.7)])
def test_they_gain_over_raw_residuals_where_recorded_states_are_noisy(x_noise, gain):
    ratios = []
    for seed in range(40, 45):
        history, Y, truth = masses(seed, x_noise)
        ours = error(ddmhe.DdMhe(history, weights="recorded"), Y, truth)
        ratios.append(ours / error(ddmhe.baselines.ErrorStateKalman(history), Y, truth))
    assert np.median(ratios) < gain


@pytest.mark.parametrize("x_noise", [0.0, 0.003, 0.01])
def test_by_default_a_noisy_recording_of_a_linear_system_has_its_own_weights(x_noise):
    history, Y, _ = masses(50, x_noise)
    default = ddmhe.DdMhe(history)
    assert default.weights == "recorded"
    stated = ddmhe.DdMhe(history, weights="recorded")
    np.testing.assert_array_equal(default.run(Y[:100]).x, stated.run(Y[:100]).x)


@pytest.mark.parametrize(
    "settings",
    [{"rho": 0.9}, {"mu": 1.0}, {"space": ddmhe.Truncated(6)}, {"process_noise": None}],
    ids=["rho", "mu", "space", "process_noise"],
)
def test_what_is_stated_keeps_the_weights_of_the_paper(settings):
    history, _, _ = masses(50, 0.003)
    assert ddmhe.DdMhe(history, **settings).weights in ("paper", "scaled")


def test_by_default_no_curved_exact_or_hidden_recording_has_them():
    """A tumbling satellite, noise-free linear data, part of a state."""
    record = ddmhe.models.detumbling().simulate(30.0, 0.1, noise=0.01, seed=3)
    rng = np.random.default_rng(3)
    for noise in (1e-4, 1e-3, 1e-2):
        x = record.x[:201] + noise * rng.standard_normal((201, 3))
        assert ddmhe.DdMhe(ddmhe.History(x, record.y[:200])).weights == "scaled"
    assert ddmhe.DdMhe(random_case(3, inputs=False).history).weights == "scaled"
    history, _, _ = masses(51, 0.0)
    (x, y) = history.recordings[0]
    assert ddmhe.DdMhe(ddmhe.History(x[:, :1], y[:, 1:])).weights == "scaled"


@pytest.mark.parametrize("x_noise", [0.003, 0.01])
def test_by_default_an_output_that_is_a_recorded_state_costs_nothing(x_noise):
    """The log's columns serve as states and as outputs: their reading noise is one and the same."""
    ratios = []
    for seed in range(40, 44):
        history, _, truth = masses(seed, x_noise)
        x, _ = history.recordings[0]
        at, rng = [0, 2], np.random.default_rng(seed)
        read = truth[:-1, at] + x_noise * rng.standard_normal((len(truth) - 1, 2))
        again = ddmhe.History(x, x[:-1, at])
        Y = np.vstack([x[-1:, at], read])
        default, plain = ddmhe.DdMhe(again), ddmhe.DdMhe(again, process_noise=None)
        ratios.append(error(default, Y, truth) / error(plain, Y, truth))
    assert np.median(ratios) < 1.05


def test_the_default_reads_one_recording_as_it_reads_several():
    history, Y, _ = masses(52, 0.003)
    (x, y) = history.recordings[0]
    parts = ddmhe.History.concat([ddmhe.History(x[:121], y[:120]), ddmhe.History(x[120:], y[120:])])
    assert ddmhe.DdMhe(parts).weights == ddmhe.DdMhe(history).weights == "recorded"
    together = ddmhe.DdMhe(parts).run(Y[:50]).x
    np.testing.assert_allclose(together, ddmhe.DdMhe(history).run(Y[:50]).x, atol=0.05)


@pytest.mark.parametrize("hidden", ["input", "state"])
def test_where_one_signal_drives_states_and_outputs_they_are_refused(hidden):
    """A white input that is handed over as an output, a state that is not recorded."""
    refused = 0
    for seed in range(10):
        rng = np.random.default_rng(700 + seed)
        A = np.diag([0.9, 0.7, 0.5]) + 0.1 * rng.standard_normal((3, 3))
        B, C = rng.standard_normal((3, 1)), rng.standard_normal((2, 3))
        D = rng.standard_normal((2, 1))
        system = Driven(A, B, np.zeros(3), C, D, np.zeros(2))
        u = rng.standard_normal((300, 1))
        w, v = 0.01 * rng.standard_normal((300, 3)), 0.05 * rng.standard_normal((300, 2))
        x, y = system.simulate(np.zeros(3), u, w, v)
        if hidden == "input":
            history = ddmhe.History(x[:151], np.hstack([y, u])[:150])
        else:
            history = ddmhe.History(x[:151, :2], y[:150])
        est = ddmhe.DdMhe(history)
        assert est.weights == "scaled"
        refused += "nearly the outputs' noise" in est.settings.why["weights"]
        known = ddmhe.DdMhe(ddmhe.History(x[:151], y[:150], u=u[:150]))
        assert known.weights == "recorded"
    assert refused >= 5  # others are refused for another reason
