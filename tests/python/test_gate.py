"""Outputs that cannot be right are left out, jumps start the run again, and stuck outputs count as
not measured: against an independent reference, and on faults that were put in."""

import pickle
from functools import partial

import numpy as np
import pytest

import ddmhe
from disturbed import Noisy
from evidence_of_spaces import Evidence
from evidence_reference import Twin
from gated_reference import Gated
from reference import random_system


def case(seed, T=150, steps=90):
    """A noisy recording of a random system, and the outputs that follow."""
    case = Noisy.random(seed, inputs=False, x_noise=0.02, T=T, steps=steps)
    return case.history, case.Y


def spiked(history, Y, rng, share=0.03, times=30):
    """`Y` with spikes of so many recorded deviations, and where they are; none at the first."""
    at = rng.random(Y.shape) < share
    at[0] = False
    return Y + at * times * history.recordings[0][1].std(0) * rng.choice([-1, 1], Y.shape), at


@pytest.mark.parametrize("seed", range(4))
def test_a_gated_run_is_the_reference(seed):
    """Estimates, what is rejected, and where the run starts again."""
    history, Y = case(seed)
    rng = np.random.default_rng(seed)
    spoilt, _ = spiked(history, Y, rng)
    spoilt[50:] += 5 * history.recordings[0][1].std(0)  # a jump
    est = ddmhe.DdMhe(history, weights="scaled", start="state", gate="auto")
    twin = Twin(history, est)
    run = Gated(Evidence(twin)).run(spoilt, history.recordings[0][0][-1])
    log = est.run(spoilt)
    assert len(run.restarts) > 0
    assert list(np.flatnonzero(log.evidence.restarted) + 1) == run.restarts
    kept = ~np.isnan(spoilt)
    rejected = log.evidence.gated & kept
    for restart in run.restarts:  # what led to a restart is taken back in
        rejected[restart - 4 : restart] = False
    np.testing.assert_array_equal(rejected, run.rejected)
    np.testing.assert_allclose(twin.user(np.array(run.x[1:])), log.x, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
@pytest.mark.parametrize("start", ["recording", "state", "unknown"])
def test_spikes_are_rejected_and_count_as_not_measured(weights, start):
    """The run is the one in which they are NaN, bit for bit."""
    history, Y = case(5)
    spoilt, at = spiked(history, Y, np.random.default_rng(0))
    at[:30], spoilt[:30] = False, Y[:30]
    settings = dict(weights=weights, start=start)
    est = ddmhe.DdMhe(history, gate="auto", **settings)
    log = est.run(spoilt)
    np.testing.assert_array_equal(log.evidence.gated, at)
    assert not log.evidence.restarted.any()
    missing = ddmhe.DdMhe(history, **settings).run(np.where(at, np.nan, spoilt))
    np.testing.assert_array_equal(log.x, missing.x)
    told = [w for w in est.warnings if "rejected" in w]
    assert len(told) == sum(at.any(axis=0))
    assert all(f"{n} time" in " ".join(told) or n < 2 for n in at.sum(axis=0))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("weights", ["scaled", "recorded"])
def test_known_inputs_and_bounds(weights, seed):
    """Known motion is no reason to reject, whatever is lost beside it."""
    case = Noisy.random(seed, x_noise=0.02, steps=90)
    rng = np.random.default_rng(seed)
    spoilt, at = spiked(case.history, case.Y, rng, times=60)
    at[:40], spoilt[:40] = False, case.Y[:40]
    lost = rng.random(spoilt.shape) < 0.05
    spoilt, at = np.where(lost, np.nan, spoilt), at & ~lost
    settings = {"weights": weights, "x_bounds": (-500.0, 500.0), "start": "recording"}
    log = ddmhe.DdMhe(case.history, gate=6.0, **settings).run(spoilt, case.U)
    np.testing.assert_array_equal(log.evidence.gated, at)
    missing = ddmhe.DdMhe(case.history, **settings).run(np.where(at, np.nan, spoilt), case.U)
    np.testing.assert_array_equal(log.x, missing.x)


def test_where_nothing_is_rejected_nothing_changes():
    history, Y = case(6)
    for settings in ({}, {"weights": "scaled"}, {"start": "unknown"}):
        gated = ddmhe.DdMhe(history, gate=1e6, **settings).run(Y)
        plain = ddmhe.DdMhe(history, **settings).run(Y)
        np.testing.assert_array_equal(gated.x, plain.x)
        np.testing.assert_array_equal(gated.covariance, plain.covariance)


def test_steps_runs_copies_and_snapshots_go_on_alike():
    """Through a spike, in the middle of a row of rejections and of a window that grows again."""
    history, Y = case(7, steps=140)
    spoilt, _ = spiked(history, Y, np.random.default_rng(1))
    spoilt[60:] -= 6 * history.recordings[0][1].std(0)
    spoilt[100:, 0] = spoilt[100, 0]
    for settings in ({"weights": "scaled"}, {"weights": "recorded"}):
        make = partial(ddmhe.DdMhe, history, gate="auto", stuck="missing", **settings)
        whole = make().run(spoilt)
        assert whole.evidence.restarted.sum() > 0
        assert whole.evidence.stuck.any()
        est, x, gated = make(), [], []
        for k, y in enumerate(spoilt):
            if k in (30, 61, 62, 63, 66, 80, 104, 112):
                est = (
                    ddmhe.DdMhe.restore(est.snapshot())
                    if k % 2
                    else pickle.loads(pickle.dumps(est))
                )
            e = est.step(y)
            x.append(e.x)
            gated.append(e.evidence.gated)
            assert e.evidence.restarted == whole.evidence.restarted[k]
        np.testing.assert_array_equal(x, whole.x)
        np.testing.assert_array_equal(gated, whole.evidence.gated)


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
def test_a_jump_starts_the_run_again(weights):
    """A state that is kicked: without a restart the gate would lock it out."""
    rng = np.random.default_rng(3)
    F = np.array([[0.99, 0.1], [-0.1, 0.97]])
    x = [np.array([1.0, 0.0])]
    for k in range(500):
        x.append(F @ x[-1] + 0.02 * rng.standard_normal(2) + (k == 350) * np.array([3.0, -2.0]))
    x = np.array(x)
    y = x[:-1, :1] + 0.02 * rng.standard_normal((500, 1))
    history = ddmhe.History(x[:201], y[:200])
    log = ddmhe.DdMhe(history, weights=weights, gate="auto").run(y[200:])
    jump, *_ = np.flatnonzero(log.evidence.restarted)
    assert 150 <= jump <= 158
    error = np.abs(log.x - x[201:])
    assert error[jump + 20 :].max() < 0.3
    assert log.evidence.gated[jump + 20 :].sum() <= 2
    words = ddmhe.DdMhe(history, weights=weights, gate="auto")
    words.run(y[200:])
    assert any("started again" in w for w in words.warnings)


def test_a_stuck_output_counts_as_not_measured_on_request():
    """From when it is found out on, with all its repetitions."""
    history, Y = case(8)
    Y = Y.copy()
    Y[40:70, 0] = Y[40, 0]
    told = ddmhe.DdMhe(history, start="recording").run(Y)
    found = int(np.argmax(told.evidence.stuck[:, 0]))
    assert found == 49  # ten times the same
    log = ddmhe.DdMhe(history, start="recording", stuck="missing").run(Y)
    np.testing.assert_array_equal(log.x[:found], told.x[:found])
    missing = Y.copy()
    missing[40:70, 0] = np.nan
    expected = ddmhe.DdMhe(history, start="recording").run(missing)
    # the estimates before it was found out differ, and later ones remember those
    last = log.x[-5:] - expected.x[-5:]
    assert np.abs(last).max() < 0.1 * np.abs(told.x[69] - expected.x[69]).max()
    for k in range(found, 70):
        assert np.isnan(log.evidence.innovation[k, 0])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"gate": 1.0}, "gate: expected a number of deviations above 1, found 1"),
        ({"gate": np.nan}, "gate: expected a"),
        ({"gate": "on"}, 'gate: expected "auto", found "on"'),
        ({"gate": "auto", "evidence": False}, "gate: expected none without evidence"),
        ({"stuck": "missing", "evidence": False}, "stuck: expected none without evidence"),
        ({"stuck": "drop"}, 'stuck: expected "tell" or "missing", found "drop"'),
    ],
)
def test_wrong_settings(settings, words):
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.DdMhe(case(0)[0], **settings)


def test_a_recording_without_noise_has_nothing_to_doubt_by():
    """Unless the noise of later outputs is stated."""
    rng = np.random.default_rng(0)
    history = ddmhe.History(*random_system(rng, 3, 2).simulate(rng.standard_normal(3), 100))
    with pytest.raises(ddmhe.DdmheError, match="gate: expected output_noise"):
        ddmhe.DdMhe(history, gate=4.0)
    assert any(
        w.startswith("gate: no output is rejected")
        for w in ddmhe.DdMhe(history, gate=True).warnings
    )
    assert not any("gate" in w for w in ddmhe.DdMhe(history, gate=True, output_noise=0.01).warnings)
