"""RigidBodyMhe: against the NumPy reference's own numbers, and as an object."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import ddmhe

GOLDEN = np.load(Path(__file__).parents[1] / "golden" / "rigid_body.npz")
NAMES = list(GOLDEN["names"])
UNIT_X, UNIT_Y, RECORDED, EVERY = 1e-8, 1e-6, 200, 8
LOST = np.iinfo(np.int32).min


def golden(name):
    """History, settings and outputs of a case, and what the reference made of it."""
    i = NAMES.index(name)
    x, y = GOLDEN[f"x{i}"] * UNIT_X, GOLDEN[f"y{i}"]
    y = np.where(y == LOST, np.nan, y * UNIT_Y)
    noise = GOLDEN[f"noise{i}"]
    names = ("x_noise", "y_noise", "output_noise")
    history = ddmhe.History(x, y[:RECORDED], dt=0.1)
    return history, dict(zip(names, noise, strict=False)), y[RECORDED:], GOLDEN[f"rows{i}"]


def spread(x, y):
    """Of two lists of covariances the largest difference, relative to the larger's size."""
    size = np.abs(y).max(axis=(1, 2), keepdims=True)
    return np.max(np.abs(x - y) / size)


@pytest.mark.parametrize("name", NAMES)
def test_estimates_are_the_reference_s(name):
    """400 steps with seven fits anew: rates to 1e-9 rad/s, covariances to 1e-8 of their size. The
    reference follows the most probable motion alone."""
    history, settings, Y, rows = golden(name)
    est = ddmhe.RigidBodyMhe(history, refit="now", optima=1, **settings)
    log = est.run(Y)
    at = np.arange(EVERY - 1, len(Y), EVERY)
    upper = np.zeros((len(at), 3, 3))
    upper[(slice(None), *np.triu_indices(3))] = rows[:, 3:9]
    expected = upper + np.triu(upper, 1).transpose(0, 2, 1)
    assert est.explained
    assert np.abs(log.x[at] - rows[:, :3]).max() < 1e-9
    assert spread(log.covariance[at], expected) < 1e-8
    assert np.array_equal(log.status[at] == "adapting", rows[:, 9] == 1)
    assert set(log.status) <= {"structured", "adapting"}


def test_where_one_motion_is_possible_only_it_is_followed():
    history, settings, Y, _ = golden("target 4")
    alone = ddmhe.RigidBodyMhe(history, optima=1, **settings).run(Y)
    est = ddmhe.RigidBodyMhe(history, **settings)
    assert same(est.run(Y), alone)
    assert est.report().probabilities == [1.0]


def test_where_several_motions_are_possible_the_estimate_is_their_mean():
    """Of target 3 two motions explain the recording. Before anything is fitted anew the first
    estimate of both together is the weighted mean of either alone, with the spread in between."""
    history, settings, Y, _ = golden("target 3")
    both = ddmhe.RigidBodyMhe(history, **settings)
    first, second = both.report().probabilities
    assert first + second == pytest.approx(1.0)
    assert first > second > 0.01
    alone = ddmhe.RigidBodyMhe(history, optima=1, **settings)
    x, P = (e := both.step(Y[0])).x, e.covariance
    one = alone.step(Y[0])
    leading = first if np.allclose(alone.report().inertia, both.report().inertia) else second
    # of the other motion only its mean and covariance can make up the rest
    other = (x - leading * one.x) / (1 - leading)
    apart = one.x - other
    inside = (P - leading * one.covariance - first * second * np.outer(apart, apart)) / (
        1 - leading
    )
    assert np.linalg.norm(apart) > 1e-6
    assert np.all(np.linalg.eigvalsh(inside) > 0)
    assert np.linalg.norm(inside) < 10 * np.linalg.norm(one.covariance)


def test_measured_rates_pull_the_estimate_to_them():
    """A camera for ten seconds: errors of its noise's size over many readings, and none of it where
    it says nothing."""
    history, settings, Y, _ = golden("target 7")
    plain = ddmhe.RigidBodyMhe(history, **settings)
    silent = copy.copy(plain)
    log = plain.run(Y)
    nothing = np.full((len(Y), 3), np.nan)
    assert same(silent.run(Y, X=nothing), log)
    # what was estimated is not the truth, but a camera may see anything
    seen = nothing.copy()
    seen[100:200:10] = log.x[99:199:10] + 0.01
    camera = ddmhe.RigidBodyMhe(history, rate_noise=1e-4, **settings)
    with_it = camera.run(Y, X=seen)
    assert np.array_equal(with_it.x[:100], log.x[:100])
    pulled = with_it.x[200] - log.x[200]
    assert np.linalg.norm(pulled) > 1e-3
    again = ddmhe.RigidBodyMhe(history, rate_noise=1e-4, **settings)
    for y, x in zip(Y, seen, strict=True):
        e = again.step(y, x=x)
    assert np.array_equal(e.x, with_it.x[-1])
    halfway = ddmhe.RigidBodyMhe(history, rate_noise=1e-4, **settings)
    halfway.run(Y[:150], X=seen[:150])
    restored = ddmhe.RigidBodyMhe.restore(halfway.snapshot())
    assert same(restored.run(Y[150:], X=seen[150:]), halfway.run(Y[150:], X=seen[150:]))


def test_a_braked_body_gains_no_energy():
    """Outputs that no motion explains drive no estimate beyond what the recorded energy allows."""
    history, settings, Y, _ = golden("target 2")
    est = ddmhe.RigidBodyMhe(history, **settings)
    J, std = est.report().inertia, est.report().inertia_std
    moments = np.linalg.eigvalsh(J)
    wild = 50 * np.random.default_rng(3).standard_normal(Y.shape) * np.abs(Y).max()
    log = est.run(wild)
    recorded = GOLDEN[f"x{NAMES.index('target 2')}"] * UNIT_X
    fastest = np.linalg.norm(recorded, axis=1).max()
    most = np.sqrt(1.5 / max(moments[0] - 8 * std.max(), 0.02)) * fastest * 1.1
    assert np.all(np.abs(log.x) <= most)
    assert not np.any(log.trusted[50:])


@pytest.fixture(scope="module")
def made():
    history, settings, Y, _ = golden("target 2")
    return ddmhe.RigidBodyMhe(history, **settings), Y


def same(a, b):
    """Whether two logs hold the same numbers."""
    columns = ("x", "cost", "covariance", "status", "reasons")
    return all(np.array_equal(getattr(a, c), getattr(b, c)) for c in columns)


def test_a_run_is_its_steps(made):
    est, Y = copy.copy(made[0]), made[1][:60]
    log = copy.copy(est).run(Y)
    for k, y in enumerate(Y):
        e = est.step(y)
        assert np.array_equal(e.x, log.x[k])
        assert np.array_equal(e.window, [e.x])
        assert np.array_equal(e.covariance, log.covariance[k])
        assert e.status == log.status[k]
        assert e.trusted == log.trusted[k]
        assert e.evidence.kind == "nis"
        assert e.evidence.innovation.shape == (3,)
    assert est.t == 60
    assert np.array_equal(est.estimate.x, e.x)
    out = np.empty(3)
    assert est.step(made[1][60], out=out) is out
    assert np.array_equal(out, est.estimate.x)


@pytest.mark.parametrize(("refit", "before"), [("now", 120), ("sliced", 90), ("sliced", 333)])
def test_copies_and_pickles_go_on_with_the_same_numbers(refit, before):
    """With slices in the midst of fits, too."""
    history, settings, Y, _ = golden("target 2")
    new = ddmhe.RigidBodyMhe(history, refit=refit, **settings)
    est = copy.copy(new)
    est.run(Y[:before])
    others = [copy.deepcopy(est), pickle.loads(pickle.dumps(est))]
    others.append(ddmhe.RigidBodyMhe.restore(est.snapshot()))
    rest = est.run(Y[before:])
    for other in others:
        assert other.t == before
        assert same(other.run(Y[before:]), rest)
    est.reset()
    assert est.t == 0
    assert est.estimate is None
    assert same(est.run(Y), new.run(Y))


@pytest.mark.parametrize("name", ["two outputs", "four outputs", "five outputs"])
def test_outputs_that_fill_no_type_are_all_that_there_are(name):
    """Two run where there is room for three, four and five where there is for six: neither evidence
    nor a run that goes on elsewhere, in the midst of fits, has more of them."""
    history, settings, Y, _ = golden(name)
    est = ddmhe.RigidBodyMhe(history, refit="sliced", **settings)
    log = est.run(Y[:90])
    there = np.isfinite(Y[:90])
    found = est.step(Y[90]).evidence
    for values in (found.innovation, found.innovation_std, found.gated, found.stuck):
        assert np.shape(values) == (history.p,)
    assert np.array_equal(np.isfinite(log.evidence.innovation), there)
    # noise of the stated size, in its own units: no other output shares its mean
    nis = np.square(log.evidence.innovation / log.evidence.innovation_std)[there]
    assert 0.8 < np.mean(nis) < 1.2
    other = ddmhe.RigidBodyMhe.restore(est.snapshot())
    assert same(other.run(Y[91:]), est.run(Y[91:]))
    with pytest.raises(ddmhe.DdmheError, match=str(history.p)):
        est.step(np.zeros(history.p + 1))


def test_snapshots_that_were_changed_are_refused(made):
    est, _ = made
    blob = bytearray(est.snapshot())
    blob[len(blob) // 2] ^= 1
    with pytest.raises(ddmhe.DdmheError, match="changed"):
        ddmhe.RigidBodyMhe.restore(bytes(blob))
    with pytest.raises(ddmhe.DdmheError, match="rigid body"):
        ddmhe.DdMhe.restore(est.snapshot())


def test_manual_fits_are_those_of_now():
    """With no fit on the way, a fit by hand where the first one is due is that fit."""
    history, settings, Y, _ = golden("target 2")
    manual = ddmhe.RigidBodyMhe(history, refit="manual", **settings)
    now = ddmhe.RigidBodyMhe(history, refit="now", **settings)
    manual.run(Y[:50])
    assert manual.refit()
    now.run(Y[:50])
    assert np.array_equal(manual.step(Y[50]).x, now.step(Y[50]).x)


def test_a_fit_by_hand_may_take_several_calls():
    """Without steps in between it ends as one at once. With some the filter goes on meanwhile, and
    then from the fit, with what came since; half a fit is saved and continued."""
    history, settings, Y, _ = golden("target 2")
    first = ddmhe.RigidBodyMhe(history, refit="manual", **settings)
    first.run(Y[:50])
    parts, plain = copy.copy(first), copy.copy(first)
    assert first.refit() is True
    calls = 0
    while (explained := parts.refit(0.0)) is None:
        calls += 1
    assert explained is True
    assert calls > 10
    assert same(parts.run(Y[50:60]), first.run(Y[50:60]))
    waiting = copy.copy(plain)
    assert waiting.refit(budget_s=0.0) is None
    assert same(waiting.run(Y[50:80]), plain.run(Y[50:80]))
    restored = ddmhe.RigidBodyMhe.restore(waiting.snapshot())
    for est in (waiting, restored):
        while est.refit(0.0) is None:
            pass
    assert waiting.report().evidence != plain.report().evidence
    assert same(waiting.run(Y[80:]), restored.run(Y[80:]))
    # it ends where a fit at once does that then consumes the same outputs
    off = np.abs(waiting.estimate.x - first.run(Y[60:]).x[-1])
    assert np.all(off < 0.1 * waiting.estimate.std)
    with pytest.raises(ddmhe.DdmheError, match="budget_s"):
        plain.refit(-1.0)
    with pytest.raises(ddmhe.DdmheError, match="budget_s"):
        plain.refit(np.nan)


def test_a_fit_by_hand_where_not_all_outputs_are_kept_is_refused():
    history, settings, *_ = golden("target 2")
    ((x, y),) = history.recordings
    short = ddmhe.History(x[:101], y[:100], dt=0.1)
    est = ddmhe.RigidBodyMhe(short, optima=1, **settings)
    silent = np.full((33 * 100, 3), np.nan)
    est.run(silent)
    assert est.refit() is False
    assert est.refit(1.0) is False


def test_the_report_says_what_the_body_is(made):
    est, Y = copy.copy(made[0]), made[1]
    before = est.report()
    est.run(Y)
    after = est.report()
    assert np.trace(after.inertia) == pytest.approx(3.0)
    assert np.linalg.norm(after.unseen) == pytest.approx(1.0)
    assert np.all(after.chi < after.limits)
    assert np.all(
        after.inertia_std[[0, 1, 2], [0, 1, 2]] < before.inertia_std[[0, 1, 2], [0, 1, 2]]
    )
    assert len(after.optima) >= 1
    assert "explains" in after.words[0]
    (line,) = est.warnings  # its rates are read with noise of 1e-3 rad/s
    assert "recorded rates hardly spread in a second direction" in line


def test_a_recording_of_no_body_is_left_to_the_affine_estimator():
    """A stable oscillator of three states, seen exactly."""
    A = np.array([[0.99, 0.1, 0.0], [-0.1, 0.99, 0.0], [0.02, 0.0, 0.95]])
    x = [np.array([1.0, 0.0, 0.5])]
    for _ in range(300):
        x.append(A @ x[-1] + [0.0, 0.01, 0.02])
    x = np.array(x)
    y = x[:-1] @ np.array([[1.0, 0.2, 0.0], [0.0, 1.0, 0.3]]).T + 0.3
    draw = np.random.default_rng(1)
    y += 1e-4 * draw.standard_normal(y.shape)
    history = ddmhe.History(x[:201] + 1e-4 * draw.standard_normal((201, 3)), y[:200], dt=0.1)
    est, affine = ddmhe.RigidBodyMhe(history), ddmhe.DdMhe(history)
    log = est.run(y[200:])
    assert not est.explained
    assert set(log.status) == {"affine"}
    assert np.array_equal(log.x, affine.run(y[200:]).x)
    assert "no rigid body explains" in est.warnings[0]


def test_a_recording_that_is_not_of_three_rates_is_left_to_the_affine_estimator():
    """Two states of a pendulum, one output."""
    t = 0.1 * np.arange(301)
    x = np.column_stack([np.sin(t), np.cos(t)])
    y = x[:, :1] + 1e-3 * np.random.default_rng(0).standard_normal((301, 1))
    history = ddmhe.History(x[:201], y[:200], dt=0.1, x_units="rad")
    est = ddmhe.RigidBodyMhe(history)
    log = est.run(y[200:])
    assert not est.explained
    assert est.report() is None
    assert set(log.status) == {"affine"}
    assert np.array_equal(log.x, ddmhe.DdMhe(history).run(y[200:]).x)
    assert "n = 2 states" in est.warnings[0]
    assert same(ddmhe.RigidBodyMhe.restore(est.snapshot()).run(y[:50]), est.run(y[:50]))
    with pytest.raises(ddmhe.ShapeError, match="x: expected no rates"):
        est.step(y[0], x=[0.0, 0.0, 0.0])


def test_estimates_stay_inside_the_box():
    history, settings, Y, _ = golden("target 2")
    free = ddmhe.RigidBodyMhe(history, **settings).run(Y)
    lo, hi = np.quantile(free.x, [0.2, 0.8], axis=0)
    log = ddmhe.RigidBodyMhe(history, x_bounds=(lo, hi), **settings).run(Y)
    assert np.all(log.x >= lo)
    assert np.all(log.x <= hi)
    assert np.any(log.x == lo)
    assert np.any(log.x == hi)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (dict(x_noise=[1.0, 2.0]), "x_noise: expected 1 or 3 numbers, found 2"),
        (dict(y_noise=-1.0), "y_noise: expected standard deviations of at least 0, found -1"),
        (dict(output_noise=np.nan), "output_noise: expected finite numbers"),
        (dict(refit="later"), "refit: expected"),
        (dict(rate_noise=[1.0, 2.0]), "rate_noise: expected 1 or 3 numbers, found 2"),
        (dict(optima=5), "optima: expected 1 to 4, found 5"),
        (dict(x_bounds=(1.0, -1.0)), "x_bounds"),
    ],
)
def test_bad_settings_are_named(change, words):
    history, *_ = golden("target 2")
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.RigidBodyMhe(history, **change)


def test_recordings_of_no_rates_are_refused():
    draw = np.random.default_rng(0)
    x, y = draw.standard_normal((201, 3)), draw.standard_normal((200, 2))
    for history, words in [
        (ddmhe.History(x, y, dt=0.1, u=y), "none of known inputs"),
        (ddmhe.History(x[:51], y[:50], dt=0.1), "at least 100 outputs"),
        (ddmhe.History(x, y, dt=0.1, x_units="deg/s"), "rates in rad/s"),
        (ddmhe.History(0 * x, y, dt=0.1), "x: expected a body that turns"),
    ]:
        with pytest.raises(ddmhe.DdmheError, match=words):
            ddmhe.RigidBodyMhe(history)
    est = ddmhe.RigidBodyMhe(golden("target 2")[0])
    with pytest.raises(ddmhe.ShapeError, match="y_t: expected 3 numbers"):
        est.step([1.0, 2.0])
    with pytest.raises(ddmhe.ShapeError, match="x: expected 3 numbers"):
        est.step([1.0, 2.0, 3.0], x=[1.0, 2.0])
    with pytest.raises(ddmhe.ShapeError, match=r"X: expected \(5, 3\), found \(4, 3\)"):
        est.run(np.zeros((5, 3)), X=np.zeros((4, 3)))
    with pytest.raises(ddmhe.NotFiniteError, match="x"):
        est.step([1.0, 2.0, 3.0], x=[1.0, 2.0, np.inf])
