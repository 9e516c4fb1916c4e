"""A run finds out whether it goes on from the recording's end, and starts over from an unknown
state where it does not."""

import copy

import numpy as np
import pytest

import ddmhe
from disturbed import Noisy

T = 200
DT = 0.3


def masses(seed, steps, after=0, elsewhere=False, noise=0.02):
    """Two masses on springs: a recording, and what comes `after` so many samples, or from another
    state."""
    rng = np.random.default_rng(seed)
    K = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, -0.05, 0.02], [1, -2, 0.02, -0.05]])
    values, vectors = np.linalg.eig(K * DT)
    F = ((vectors * np.exp(values)) @ np.linalg.inv(vectors)).real
    x = [rng.uniform(-1, 1, 4)]
    for _ in range(T + after + steps):
        x.append(F @ x[-1])
    later = np.array(x[T + after :])
    if elsewhere:
        later = np.array(x[: steps + 1]) * -1.5
    x = np.array(x[: T + 1])
    y, Y = (part[:-1, :1] + noise * rng.standard_normal((len(part) - 1, 1)) for part in (x, later))
    history = ddmhe.History(x + noise * rng.standard_normal(x.shape), y, DT)
    return history, Y, later[1:]


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
@pytest.mark.parametrize("seed", range(3))
def test_a_log_that_goes_on_is_one_from_the_recording(weights, seed):
    """Bit for bit, and after M steps it says so."""
    history, Y, _ = masses(seed, 80)
    est = ddmhe.DdMhe(history, weights=weights)
    assert est.settings.start == "auto"
    log, expected = est.run(Y), ddmhe.DdMhe(history, weights=weights, start="recording").run(Y)
    np.testing.assert_array_equal(log.x, expected.x)
    np.testing.assert_array_equal(log.covariance, expected.covariance)
    assert est.settings.start == "recording"
    assert not any("does not go on" in w for w in est.warnings)
    est.reset()
    est.run(Y[: est.horizon - 1])
    assert est.settings.start == "auto"
    est.step(Y[est.horizon - 1])
    assert est.settings.start == "recording"


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
@pytest.mark.parametrize(
    "what", [{"elsewhere": True}, {"after": 30}, {"after": 3}], ids=["elsewhere", "gap 30", "gap 3"]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_log_that_does_not_go_on_starts_unknown(weights, what, seed):
    """Until that is found out the estimates are those that go on from the recording, then those of
    a run from an unknown state, bit for bit."""
    history, Y, x = masses(seed, 120, **what)
    est = ddmhe.DdMhe(history, weights=weights)
    unknown = ddmhe.DdMhe(history, weights=weights, start="unknown").run(Y)
    going_on = ddmhe.DdMhe(history, weights=weights, start="recording").run(Y)
    starts, steps = [], []
    for y in Y:
        steps.append(est.step(y))
        starts.append(est.settings.start)
    found = starts.index("unknown") + 1
    assert found <= est.horizon
    assert set(starts[: found - 1]) <= {"auto"}
    for k, e in enumerate(steps):
        of = going_on if k + 1 < found else unknown
        np.testing.assert_array_equal(e.x, of.x[k])
        np.testing.assert_array_equal(e.covariance, of.covariance[k])
    told = f"the log does not go on from the recording's end, as seen at step {found}: its first"
    assert est.warnings[-1].startswith("from") or len(est.warnings) == 1
    assert sum(w.startswith(told) for w in est.warnings) == 1
    error = [np.abs(log.x - x)[: 2 * est.horizon].mean() for log in (unknown, going_on)]
    if "elsewhere" in what:
        assert error[0] < error[1]


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
def test_runs_copies_and_snapshots_find_it_out_alike(weights):
    history, Y, _ = masses(1, 100, after=3)
    est = ddmhe.DdMhe(history, weights=weights)
    log = est.run(Y)
    stepped, restored = ddmhe.DdMhe(history, weights=weights), None
    for k, y in enumerate(Y):
        if stepped.settings.start == "auto":
            stepped = copy.copy(stepped) if k % 2 else ddmhe.DdMhe.restore(stepped.snapshot())
        elif restored is None:
            restored = stepped = ddmhe.DdMhe.restore(stepped.snapshot())
        np.testing.assert_array_equal(stepped.step(y).x, log.x[k])
    assert restored is not None
    assert stepped.warnings == est.warnings
    for _ in range(2):
        est.reset()
        assert est.settings.start == "auto"
        np.testing.assert_array_equal(est.run(Y).x, log.x)
    (many,) = ddmhe.run_many([ddmhe.DdMhe(history, weights=weights)], [Y])
    np.testing.assert_array_equal(many.x, log.x)


def test_a_known_state_is_no_question():
    history, Y, _ = masses(0, 60, elsewhere=True)
    prior = history.recordings[0][0][-1]
    est = ddmhe.DdMhe(history, x_prior=prior)
    assert est.settings.start == "state"
    state = ddmhe.DdMhe(history, start="state").run(Y).x
    np.testing.assert_array_equal(est.run(Y).x, state)
    est = ddmhe.DdMhe(history)
    est.reset(prior)
    assert est.settings.start == "state"
    np.testing.assert_array_equal(est.run(Y).x, state)
    est.reset(start="auto")
    assert est.settings.start == "auto"


def test_noise_that_the_recording_did_not_show_is_no_other_start():
    """A recording without noise does not tell how much later outputs have."""
    (history, _, _), (_, Y, _) = masses(2, 60, noise=0.0), masses(2, 60)
    noise = 0.02
    est = ddmhe.DdMhe(history)
    est.run(Y)
    assert est.settings.start == "recording"
    far = ddmhe.DdMhe(history)
    far.run(masses(2, 60, elsewhere=True)[1])
    assert far.settings.start == "unknown"
    stated = ddmhe.DdMhe(history, output_noise=noise)
    stated.run(Y)
    assert stated.settings.start == "recording"


@pytest.mark.parametrize("settings", [{}, {"x_bounds": (-30.0, 30.0), "v_bounds": (-3.0, 3.0)}])
def test_inputs_and_bounds_are_replayed(settings):
    case = Noisy.random(3, x_noise=0.02)
    Y = case.Y + 40 * case.history.recordings[0][1].std(0)
    logs = [
        ddmhe.DdMhe(case.history, start=start, **settings).run(Y, case.U)
        for start in (None, "unknown")
    ]
    np.testing.assert_array_equal(logs[0].x, logs[1].x)


def test_most_logs_that_go_on_are_taken_to():
    """Of 200 random systems that go on at most one in a hundred starts over."""
    wrong = 0
    for seed in range(200):
        case = Noisy.random(seed, inputs=False, x_noise=0.05, steps=60)
        est = ddmhe.DdMhe(case.history)
        est.run(case.Y)
        wrong += est.settings.start == "unknown"
    assert wrong <= 2
