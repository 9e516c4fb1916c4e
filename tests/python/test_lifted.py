"""The polynomial model beside the affine estimator: equal to its reference, chosen where it is
better, and never standing where it is worse."""

import copy
import importlib.util
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe import DdmheError, LiftedMhe, Reason
from ddmhe._core import noise_levels
from ddmhe.lifted.choice import parts_of
from ddmhe.lifted.filter import LiftedFilter
from ddmhe.lifted.kalman import updated
from ddmhe.lifted.model import fit
from ddmhe.lifted.monomials import Monomials, count
from ddmhe.lifted.rivals import Rivals

SHARED = Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data")).parent
REFERENCE = SHARED / "reference" / "reach" / "lift.py"


def quadratic(steps, u=None, x_0=(0.4, -0.2)):
    """States (steps+1, 2) and outputs (steps, 1) of a map of degree 2, with an input."""
    x = [np.array(x_0)]
    for k in range(steps):
        a, b = x[-1]
        force = 0.0 if u is None else u[k, 0]
        turned = [0.995 * (a * np.cos(0.3) - b * np.sin(0.3)), a * np.sin(0.3) + b * np.cos(0.3)]
        x.append(np.array([turned[0] + 0.05 * b * b, 0.995 * turned[1] - 0.1 * a * b + force]))
    x = np.array(x)
    y = x[:-1, :1] + 0.3 * x[:-1, 1:] ** 2
    return x, y if u is None else y + 0.5 * u


def recorded(noise=0.0, seed=0, T=200, steps=500):
    x, y = quadratic(steps)
    rng = np.random.default_rng(seed)
    y = y + noise * rng.standard_normal(y.shape)
    read = x + noise / 5 * rng.standard_normal(x.shape)
    return ddmhe.History(read[: T + 1], y[:T], dt=0.1), y[T:], x[T + 1 :]


def error(x, truth):
    return float(np.sqrt(np.mean((x - truth) ** 2)))


def test_monomials_and_their_derivatives():
    phi = Monomials(np.array([0.2, -1.0, 0.5]), np.array([2.0, 0.5, 1.0]), 3)
    x = np.array([0.7, -0.3, 0.9])
    z = (x - phi.mean) / phi.scale
    assert len(phi(x)) == count(3, 3) == 20
    wanted = {1.0, z[0] * z[1] * z[2], z[0] ** 3, z[1] ** 2 * z[2], z[2]}
    assert all(np.isclose(phi(x), value, rtol=1e-14).any() for value in wanted)
    h = 1e-6
    for i in range(3):
        step = h * np.eye(3)[i]
        slope = (phi(x + step) - phi(x - step)) / (2 * h)
        assert phi.jacobian(x)[:, i] == pytest.approx(slope, abs=1e-8)


def test_a_map_of_degree_two_is_found():
    history, Y, truth = recorded()
    estimator = LiftedMhe(history)
    assert estimator.chosen
    assert estimator.degree in (2, 3)
    log = estimator.run(Y)
    affine = ddmhe.DdMhe(history).run(Y)
    assert set(log.status) == {"lifted"}
    assert error(log.x, truth) < 1e-5 < 100 * error(affine.x, truth)


def test_known_inputs_enter_the_map():
    rng = np.random.default_rng(3)
    u = 0.02 * rng.standard_normal((500, 1))
    x, y = quadratic(500, u)
    history = ddmhe.History(x[:251], y[:250], u=u[:250])
    estimator = LiftedMhe(history)
    assert estimator.chosen
    log = estimator.run(y[250:], u[250:])
    assert error(log.x, x[251:]) < 1e-5
    with pytest.raises(DdmheError, match="u"):
        estimator.step(y[0])


def test_of_degree_one_it_is_a_kalman_filter():
    """An independent filter with the fitted matrices makes the same estimates and covariances."""
    history, Y, _ = recorded(noise=0.02)
    model = fit(parts_of(history), noise_levels(history), 1, 1e-9, None)
    A, C = model.next(model.mean, np.empty(0))[1], model.output(model.mean, np.empty(0))[1]
    e = model.next(np.zeros(2), np.empty(0))[0]
    r = model.output(np.zeros(2), np.empty(0))[0]
    filter = LiftedFilter(model, None)
    x, P = model.x_end, model.P_end
    for y in Y[:60]:
        filter.step(y, np.empty(0))
        S = C @ P @ C.T + model.R
        K = P @ C.T @ np.linalg.inv(S)
        x, P = x + K @ (y - C @ x - r), P - K @ S @ K.T
        x, P = A @ x + e, A @ P @ A.T + model.Q
        assert filter.x == pytest.approx(x, abs=1e-9)
        assert pytest.approx(P, rel=1e-6, abs=1e-12) == filter.P


@pytest.mark.skipif(not REFERENCE.is_file(), reason="no reference: DDMHE_DATA names a folder in it")
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_equal_to_the_reference(noise):
    spec = importlib.util.spec_from_file_location("lift", REFERENCE)
    lift = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(lift)
    history, Y, _ = recorded(noise)
    (x, y), *_ = history.recordings
    for degree, ridge in ((1, 1e-9), (2, 1e-6), (3, 1e-3)):
        wanted = lift.Lift(x, y, degree, ridge).run(Y)
        filter = LiftedFilter(
            fit(parts_of(history), noise_levels(history), degree, ridge, None), None
        )
        for k, output in enumerate(Y):
            filter.step(output, np.empty(0))
            assert filter.x == pytest.approx(wanted[k], abs=1e-9)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("noise", [0.005, 0.02])
def test_its_bars_hold_and_it_is_better(noise, seed):
    history, Y, truth = recorded(noise, seed)
    estimator = LiftedMhe(history)
    log = estimator.run(Y)
    assert np.mean(np.abs(log.x - truth) <= 3 * log.std) > 0.97
    assert error(log.x, truth) < 1.05 * error(ddmhe.DdMhe(history).run(Y).x, truth)


def test_a_linear_system_keeps_the_affine_estimator_bit_for_bit():
    A = np.array([[0.98, -0.15], [0.15, 0.98]])
    states = [np.array([1.0, 0.0])]
    for _ in range(300):
        states.append(A @ states[-1])
    x = np.array(states)
    y = x[:-1, :1]
    history = ddmhe.History(x[:151], y[:150])
    estimator, affine = LiftedMhe(history), ddmhe.DdMhe(history)
    log, plain = estimator.run(y[150:]), affine.run(y[150:])
    assert not estimator.chosen
    assert "the affine estimator is used" in estimator.warnings[0]
    assert np.array_equal(log.x, plain.x)
    assert np.array_equal(log.covariance, plain.covariance)
    assert np.array_equal(estimator.promise, affine.promise)


def test_outside_of_the_recorded_region_the_affine_estimate_stands():
    history, Y, _ = recorded()
    estimator, affine = LiftedMhe(history), ddmhe.DdMhe(history)
    far = np.concatenate([Y[:20], Y[20:60] + 40 * np.ptp(Y)])
    log, plain = estimator.run(far), affine.run(far)
    assert log.status[0] == "lifted"
    assert log.status[-1] != "lifted"
    left = int(np.argmax(log.status != "lifted"))
    assert np.array_equal(log.x[left:], plain.x[left:])
    assert any("from step" in words for words in estimator.warnings)
    estimator.reset()
    assert estimator.step(Y[0]).status == "lifted"


def test_the_affine_estimator_stands_where_it_predicts_the_outputs_better():
    mine, other, scale = np.array([1.0, np.nan]), np.array([0.5, 0.0]), np.ones(2)
    rivals = Rivals()
    for _ in range(9):
        rivals = rivals.after(mine, other, scale)
    assert not rivals.behind  # too few samples
    assert rivals.after(np.full(2, np.nan), other, scale) is rivals
    rivals = rivals.after(mine, other, scale)
    assert rivals.behind
    assert rivals.lifted == pytest.approx(1.0)
    assert rivals.affine == pytest.approx(0.25)
    for _ in range(300):
        rivals = rivals.after(0.4 * mine, other, scale)
    assert not rivals.behind


def test_a_run_that_starts_elsewhere_begins_with_the_affine_estimate():
    history, _, _ = recorded()
    x, y = quadratic(120, x_0=(-0.3, 0.35))
    estimator = LiftedMhe(history)
    estimator.reset(start="unknown")
    log = estimator.run(y)
    first = int(np.argmax(log.status == "lifted"))
    assert first == ddmhe.DdMhe(history, start="unknown").horizon
    assert error(log.x[60:], x[61:]) < 1e-4
    estimator.reset(x[0])
    log = estimator.run(y)
    assert log.status[0] == "lifted"
    assert error(log.x, x[1:]) < 1e-4


def test_several_recordings_are_held_out_in_turn():
    parts = [quadratic(80, x_0=x_0) for x_0 in ((0.4, -0.2), (-0.3, 0.2), (0.1, 0.4))]
    history = ddmhe.History.concat([ddmhe.History(x, y) for x, y in parts])
    x, y = quadratic(100, x_0=(0.3, 0.1))
    estimator = LiftedMhe(history)
    assert estimator.chosen
    estimator.reset(x[0])
    assert error(estimator.run(y).x, x[1:]) < 1e-4


def test_a_recording_too_short_for_a_polynomial():
    x, y = quadratic(12)
    estimator = LiftedMhe(ddmhe.History(x, y))
    assert not estimator.chosen
    assert estimator.degree == 0
    assert "too short" in estimator.warnings[0]


def test_lost_outputs_widen_the_bars():
    history, Y, truth = recorded(0.01)
    estimator = LiftedMhe(history)
    lost = Y.copy()
    lost[50:80] = np.nan
    log = estimator.run(lost)
    assert np.isnan(log.evidence.innovation[50:80]).all()
    assert (log.std[79] > LiftedMhe(history).run(Y).std[79]).all()
    assert error(log.x[100:], truth[100:]) < 0.02


def test_steps_runs_snapshots_and_copies_have_the_same_bits():
    history, Y, _ = recorded(0.01)
    Y[70:73] = np.nan
    new = LiftedMhe(history)
    estimator, x = copy.deepcopy(new), []
    whole = copy.deepcopy(new).run(Y)
    for k, y in enumerate(Y):
        x.append(estimator.step(y).x)
        if k == 40:
            estimator = LiftedMhe.restore(estimator.snapshot())
        elif k == 80:
            estimator = pickle.loads(pickle.dumps(estimator))
        elif k == 90:
            estimator = copy.deepcopy(estimator)
    assert np.array_equal(whole.x, x)
    assert estimator.t == len(Y)
    assert estimator.warnings == new.warnings
    estimator.reset()
    again = estimator.run(Y)
    assert np.array_equal(again.x, whole.x)
    assert np.array_equal(again.reasons, whole.reasons)
    assert len(again) == len(Y)


def test_estimates_stay_in_their_box():
    history, Y, truth = recorded(0.05)
    lo, hi = truth.min(axis=0) / 2, truth.max(axis=0) / 2
    estimator = LiftedMhe(history, x_bounds=(lo, hi))
    log = estimator.run(Y)
    lifted = log.x[log.status == "lifted"]
    assert len(lifted)
    assert (lifted >= lo).all()
    assert (lifted <= hi).all()


def test_an_update_is_that_of_least_squares():
    rng = np.random.default_rng(1)
    x, H, v = rng.standard_normal(3), rng.standard_normal((2, 3)), rng.standard_normal(2)
    P, R = np.diag([1.0, 2.0, 0.5]), np.diag([0.1, 0.3])
    rows = np.vstack([np.linalg.cholesky(np.linalg.inv(P)).T, np.diag(np.diag(R) ** -0.5) @ H])
    targets = np.concatenate([np.zeros(3), np.diag(R) ** -0.5 * v])
    found, covariance = updated(x, P, H, v, R)
    assert found - x == pytest.approx(np.linalg.lstsq(rows, targets, rcond=None)[0])
    assert covariance == pytest.approx(np.linalg.inv(rows.T @ rows))


def test_doubts_are_told():
    history, Y, _ = recorded(0.005)
    estimator = LiftedMhe(history)
    e = estimator.step(Y[0])
    assert e.trusted
    assert e.reasons == Reason(0)
    assert e.evidence.kind == "nis"
    assert e.std.shape == (2,)
    noisy = Y[1:60] + 0.2 * np.random.default_rng(0).standard_normal((59, 1))
    log = estimator.run(noisy)
    assert not log.trusted.all()
    assert (log.reasons & Reason.NOVEL != 0).any()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"output_noise": np.ones(3)}, "output_noise"),
        ({"output_noise": -1.0}, "output_noise"),
        ({"x_bounds": (1.0, -1.0)}, "x_bounds"),
        ({"x_bounds": 3.0}, "x_bounds"),
        ({"fallback": 3}, "fallback"),
        ({"fallback": {"horizons": 3}}, "horizons"),
        ({"fallback": {"evidence": False}}, "evidence"),
        ({"fallback": {"output_noise": 1.0}, "output_noise": 1.0}, "output_noise"),
    ],
)
def test_wrong_arguments_are_named(arguments, words):
    history, _, _ = recorded()
    with pytest.raises(DdmheError, match=words):
        LiftedMhe(history, **arguments)


def test_wrong_data_are_named_and_change_nothing():
    history, Y, _ = recorded()
    estimator, other = LiftedMhe(history), LiftedMhe(history)
    for wrong in (np.ones(2), [np.inf], "a", [[1.0, 2.0]]):
        with pytest.raises(DdmheError, match="y"):
            estimator.step(wrong)
    with pytest.raises(DdmheError, match="Y"):
        estimator.run(np.array([[np.inf]]))
    with pytest.raises(DdmheError, match="u"):
        estimator.step(Y[0], u=[1.0])
    with pytest.raises(DdmheError, match="history"):
        LiftedMhe(3)
    for blob in (b"", b"ddmhe", estimator.snapshot()[:-3], 3, other.snapshot()[:20] + b"0" * 99):
        with pytest.raises(DdmheError, match="blob"):
            LiftedMhe.restore(blob)
    assert np.array_equal(estimator.step(Y[0]).x, other.step(Y[0]).x)
