"""What an estimate says about itself, against independent references and against the truth."""

import copy
import pickle

import numpy as np
import pytest

import ddmhe
from disturbed import Noisy, fitted
from evidence_of_recorded import Noises, told
from evidence_of_spaces import Evidence
from evidence_reference import Twin
from reference import random_system


def linear(seed, T=150, steps=90, x_noise=0.02):
    """A recording of a random system with disturbance and noise, outputs and states that follow."""
    return Noisy.random(seed, inputs=False, x_noise=x_noise, T=T, steps=steps)


def tumbling(seed=0):
    """The 20 s recording of the demo and the 60 s that follow."""
    r = ddmhe.models.detumbling().simulate(80.0, 0.1, noise=0.01, seed=seed)
    h = ddmhe.History(r.x[:201], r.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
    return h, r.y[200:-1], r.x[201:]


def exact(seed, T=80, steps=200, n=3, p=2):
    """An exact recording of a random system; exact outputs and states that follow."""
    rng = np.random.default_rng(seed)
    x, y = random_system(rng, n, p).simulate(rng.standard_normal(n), T + steps)
    return ddmhe.History(x[: T + 1], y[:T]), y[T:], x[T + 1 :]


def in_user_units(Sigma, twin):
    return Sigma * np.outer(twin.scales.s_x, twin.scales.s_x)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["linear", "tumbling", "several", "louder"])
def test_covariance_and_doubts_are_those_of_the_reference(kind, seed):
    settings = {}
    if kind == "tumbling":
        history, Y, _ = tumbling(seed)
    else:
        case = linear(seed)
        history, Y = case.history, case.Y
        if kind == "several":
            (x, y) = history.recordings[0]
            parts = [ddmhe.History(x[:91], y[:90]), ddmhe.History(x[95:], y[95:])]
            history = ddmhe.History.concat(parts)
    noise = None
    if kind == "louder":
        y = history.recordings[0][1]
        settings["output_noise"] = 0.5 * y.std(axis=0)
        least = np.maximum(ddmhe._core.noise_levels(history)[1] ** 2, 1e-10 * y.var(axis=0))
        least = np.minimum(least, np.diag(fitted(history).R))
        noise = np.sqrt(np.maximum(settings["output_noise"] ** 2 - least, 0))
    est = ddmhe.DdMhe(history, weights="scaled", **settings, start="state")
    log, twin = est.run(Y), Twin(history, est)
    trace, evidence = twin.run(Y, history.recordings[-1][0][-1]), Evidence(twin, noise)
    Sigma = evidence.covariance(trace)
    spread = np.sqrt(np.abs(np.einsum("ij,ik->ijk", twin.spread[None], twin.spread[None])))
    error = (in_user_units(Sigma, twin) - log.covariance) / (
        np.sqrt(np.einsum("tii,tjj->tij", log.covariance, log.covariance))
        + 1e-12 * np.outer(twin.scales.s_x, twin.scales.s_x) * spread
    )
    assert np.abs(error).max() < 1e-6
    np.testing.assert_allclose(est.promise, evidence.h * twin.scales.s_x, rtol=1e-6)
    np.testing.assert_allclose(
        log.evidence.innovation, trace.nu * twin.scales.s_y, rtol=1e-5, atol=1e-8 * Y.std()
    )
    if kind != "louder":  # the limit of a stated noise is chosen otherwise
        assert np.array_equal(evidence.novel(trace), log.reasons & ddmhe.Reason.NOVEL != 0)
    assert np.array_equal(evidence.uncertain(Sigma), log.reasons & ddmhe.Reason.UNCERTAIN != 0)
    assert np.array_equal(evidence.stuck(Y), log.evidence.stuck)


@pytest.mark.parametrize("seed", range(4))
def test_with_the_weights_of_the_recording_it_is_the_reference(seed):
    case = linear(seed)
    history, Y = case.history, case.Y
    est = ddmhe.DdMhe(history, weights="recorded", process_noise="residual", start="state")
    last = history.recordings[-1][0][-1]
    noises, log = Noises.of_residuals(history), est.run(Y)
    found = told(noises, history.recordings, est.horizon, Y, last)
    scale = np.sqrt(np.einsum("tii,tjj->tij", found.Sigma, found.Sigma))
    assert np.abs((found.Sigma - log.covariance) / scale).max() < 1e-6
    np.testing.assert_allclose(log.evidence.value, found.v, rtol=1e-6)
    np.testing.assert_allclose(log.evidence.innovation, found.nu, rtol=1e-6, atol=1e-9)
    deviation = np.sqrt(np.einsum("tii->ti", found.S))
    np.testing.assert_allclose(log.evidence.innovation_std, deviation, rtol=1e-6)
    assert log.evidence.kind == "nis"
    # Wilson and Hilferty's quantile is off by less than one in a thousand
    near = np.abs(log.evidence.value / log.evidence.limit - 1) < 1e-2
    novel = log.evidence.value > log.evidence.limit
    assert np.array_equal(novel[~near], found.novel[~near].astype(bool))


@pytest.mark.parametrize("weights", ["scaled", "recorded"])
def test_evidence_changes_no_estimate_and_a_step_is_a_row_of_a_run(weights):
    case = linear(12)
    Y = case.Y.copy()
    Y[20:23] = np.nan
    Y[50, 0] = np.nan
    est = ddmhe.DdMhe(case.history, weights=weights, start="state")
    bare = ddmhe.DdMhe(case.history, weights=weights, evidence=False, start="state")
    log, without = est.run(Y), bare.run(Y)
    for name in ("x", "cost", "active", "iterations"):
        assert np.array_equal(getattr(log, name), getattr(without, name))
    assert without.covariance is without.std is without.trusted is without.evidence is None
    assert bare.estimate.covariance is None
    assert bare.promise is None
    est.reset()
    for k, y in enumerate(Y):
        if k == 37:  # also through a snapshot, a copy and a pickle
            est = pickle.loads(pickle.dumps(copy.copy(ddmhe.DdMhe.restore(est.snapshot()))))
        e = est.step(y)
        assert np.array_equal(e.covariance, log.covariance[k])
        assert np.array_equal(e.std, log.std[k])
        assert int(e.reasons) == log.reasons[k]
        assert e.trusted == log.trusted[k]
        assert e.evidence.value == log.evidence.value[k]
        assert np.array_equal(e.evidence.innovation, log.evidence.innovation[k], equal_nan=True)
        assert np.array_equal(e.evidence.innovation_std, log.evidence.innovation_std[k])
    again = pickle.loads(pickle.dumps(log))
    assert np.array_equal(again.covariance, log.covariance)
    assert np.array_equal(again.reasons, log.reasons)


def test_lost_outputs_widen_the_bars():
    """And they cover while outputs are lost and after it."""
    inside, wider = [], []
    for seed in range(12):
        case = linear(seed, steps=120)
        for weights in ("scaled", "recorded"):
            est = ddmhe.DdMhe(case.history, weights=weights, start="state")
            whole = est.run(case.Y)
            Y = case.Y.copy()
            Y[60:66] = np.nan
            est.reset()
            log = est.run(Y)
            assert np.array_equal(log.covariance[:60], whole.covariance[:60])
            wider.append((log.std[65] / whole.std[65]).min())
            inside.extend((np.abs(log.x - case.x[1:]) < 3 * log.std)[60:75].ravel())
    assert np.min(wider) > 0.8
    assert np.mean(np.array(wider) > 1) > 0.8
    assert np.mean(inside) > 0.985


def test_a_lost_output_is_one_of_boundless_noise():
    """The maps of the outputs that are left are those of the problem that was made for them."""
    case = linear(7)
    est = ddmhe.DdMhe(case.history, weights="scaled", start="state")
    twin, n, p, M = Twin(case.history, est), case.history.n, case.history.p, est.horizon
    Y = case.Y.copy()
    t = M + 10
    lost = np.zeros((M, p), bool)
    lost[3], lost[M - 1, 0] = True, True
    rows = np.r_[np.zeros(n, bool), lost.ravel()]
    Y[t - M : t][lost] = np.nan
    log, evidence = est.run(Y), Evidence(twin)
    w = twin.windows[M]
    whole = w.B_seen * np.sqrt(w.w)[:, None]
    F = np.where(rows[:, None], 0, whole)
    inverse = np.linalg.inv(F.T @ F + twin.lam * np.eye(F.shape[1]))
    Bx = w.B_x
    Phi = Bx @ inverse @ (F.T * np.sqrt(w.w))[:, :n]
    reference = evidence.of_depth(M)
    more = Bx @ (inverse - np.linalg.inv(whole.T @ whole + twin.lam * np.eye(F.shape[1]))) @ Bx.T
    Q = reference.Q0 + reference.V0 / (M * p) * more
    A = Phi @ (log.covariance[t - M - 1] / np.outer(twin.scales.s_x, twin.scales.s_x)) @ Phi.T
    v = log.evidence.value[t - 1]
    s = v if v <= 1 else v**1.5
    a = np.diag(A) @ twin.spread**-2
    q = s * np.diag(Q) @ twin.spread**-2
    kappa = np.sqrt(a / q)
    expected = in_user_units(A * (1 + 1 / kappa) + s * Q * (1 + kappa), twin)
    np.testing.assert_allclose(np.diag(log.covariance[t - 1]), np.diag(expected), rtol=1e-6)


def test_where_nothing_is_measured_the_bars_grow_to_the_spread_and_cover():
    history, Y, truth = tumbling()
    log = ddmhe.DdMhe(history, weights="scaled", start="state").run(np.full_like(Y, np.nan))
    assert (np.abs(log.x - truth) < 3 * log.std).mean() > 0.97
    spread = history.recordings[0][0].std(axis=0)
    assert (log.std[10] < 0.1 * spread).all()
    assert (log.std[-1] > 0.5 * spread).all()
    assert log.reasons[-1] & ddmhe.Reason.UNCERTAIN
    assert not log.trusted[-1]
    assert not (log.reasons & ddmhe.Reason.NOVEL).any()  # there is nothing to be new


def test_the_demo_rises_its_flag_before_the_error_does():
    history, Y, truth = tumbling()
    est = ddmhe.DdMhe(history, start="state")
    log = est.run(Y)
    error = np.abs(log.x - truth)
    first = int(np.argmin(log.trusted))
    assert 100 <= first <= 200
    assert not log.trusted[first:].any()
    # up to then errors are a small part of what the recorded states deviate by
    assert (error[:first] < 0.25 * history.recordings[0][0].std(axis=0)).all()
    assert (error < 3 * log.std).mean() > 0.95
    words = [w for w in est.warnings if "unlike the recording" in w]
    assert len(words) == 1
    assert f"(step {first + 1})" in words[0]


def test_a_stuck_output_and_a_state_outside_are_told():
    case = linear(7, steps=80)
    Y = case.Y.copy()
    assert Y.shape[1] == 2
    Y[30:60, 1] = Y[30, 1]
    est = ddmhe.DdMhe(case.history, weights="scaled", start="state")
    log = est.run(Y)
    stuck = log.evidence.stuck
    assert not stuck[:, 0].any()
    assert not stuck[:39].any()
    assert stuck[39:60, 1].all()
    assert not stuck[60:].any()
    assert ((log.reasons & ddmhe.Reason.STUCK != 0) == stuck.any(axis=1)).all()
    assert any("output 1" in w and "(step 40)" in w for w in est.warnings)
    est = ddmhe.DdMhe(case.history, weights="scaled", start="state")
    log = est.run(3 * Y)
    x = case.history.recordings[0][0]
    more = 0.25 * np.ptp(x, axis=0)
    outside = ((log.x < x.min(axis=0) - more) | (log.x > x.max(axis=0) + more)).any(axis=1)
    assert outside.any()
    assert not outside.all()
    assert np.array_equal(log.reasons & ddmhe.Reason.OUTSIDE != 0, outside)
    only = log.reasons == ddmhe.Reason.OUTSIDE
    assert log.trusted[only].all()


@pytest.mark.parametrize("stated", [True, False])
def test_an_exact_recording_takes_the_noise_as_stated_or_from_the_run(stated):
    inside, twice, early = [], [], []
    for seed in range(25):
        history, Y, truth = exact(seed)
        noise = 0.01 * Y.std(axis=0)
        Y = Y + noise * np.random.default_rng(seed + 99).standard_normal(Y.shape)
        settings = {"output_noise": noise} if stated else {}
        est = ddmhe.DdMhe(history, start="state", **settings)
        log = est.run(Y)
        error = np.abs(log.x - truth)
        inside.append((error < 3 * log.std).mean())
        twice.append((error < 2 * log.std).mean())
        early.append((log.reasons & ddmhe.Reason.NOVEL != 0).mean())
    assert 0.99 <= np.mean(inside) <= 1.0
    # from the run it is one level for all outputs, in units of their scales
    assert (0.93 if stated else 0.88) <= np.mean(twice) <= 0.975
    assert np.mean(early) < 0.02


def test_drift_widens_what_outputs_do_not_show():
    case = linear(1)
    W = 0.01 * np.diag(case.history.recordings[0][0].var(axis=0))
    est = ddmhe.DdMhe(case.history, weights="scaled", start="state")
    drifting = ddmhe.DdMhe(case.history, weights="scaled", drift=W, start="state")
    plain, wide = est.run(case.Y), drifting.run(case.Y)
    assert np.array_equal(plain.x, wide.x)
    grown = np.einsum("tii->ti", wide.covariance - plain.covariance)
    assert (grown[0] >= np.diag(W) * (1 - 1e-9)).all()
    assert (grown > 0).all()


def test_active_bounds_raise_V_and_the_bars():
    case = linear(4)
    free = ddmhe.DdMhe(case.history, weights="scaled", start="state").run(case.Y)
    box = 0.3 * np.abs(case.history.recordings[0][0]).max(axis=0)
    log = ddmhe.DdMhe(case.history, weights="scaled", x_bounds=(-box, box), start="state").run(
        case.Y
    )
    first = int(np.argmax(log.active > 0))
    assert (log.active > 0).any()
    assert log.evidence.value[first] > free.evidence.value[first]
    assert (log.evidence.value[log.active > 0] > 0).all()
    assert np.isfinite(log.covariance).all()


@pytest.mark.parametrize(
    ("setting", "value", "expected"),
    [
        ("output_noise", -1.0, "output_noise: expected standard deviations"),
        ("output_noise", [1.0, 2.0, 3.0, 4.0, 5.0], "output_noise"),
        ("output_noise", float("nan"), "output_noise"),
        ("drift", [[1.0]], "drift: expected shape"),
        ("evidence", "yes", "evidence"),
    ],
)
def test_bad_settings_are_named(setting, value, expected):
    with pytest.raises(ddmhe.DdmheError, match=expected):
        ddmhe.DdMhe(linear(0).history, **{setting: value}, start="state")


def test_what_only_evidence_uses_is_refused_without():
    history = linear(0).history
    for settings in ({"output_noise": 1.0}, {"drift": np.eye(history.n)}):
        with pytest.raises(ddmhe.DdmheError, match="none without evidence"):
            ddmhe.DdMhe(history, evidence=False, **settings, start="state")


def test_what_a_recording_cannot_promise_is_told():
    """A state that no output shows and that wanders."""
    rng = np.random.default_rng(5)
    seen = np.sin(0.3 * np.arange(201))
    unseen = rng.standard_normal(201).cumsum()
    y = seen[:200, None] + 0.01 * rng.standard_normal((200, 1))
    h = ddmhe.History(np.column_stack([seen, unseen]), y)
    words = [w for w in ddmhe.DdMhe(h, weights="scaled", start="unknown").warnings
             if "cannot promise state 1" in w]  # fmt: skip
    assert words
