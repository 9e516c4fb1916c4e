"""Behaviour of the estimator as a user meets it."""

import copy
import threading
import time

import numpy as np
import pytest

import ddmhe
from reference import random_system


@pytest.fixture
def recorded():
    """A system, its noise-free recording and noisy online outputs."""
    rng = np.random.default_rng(5)
    system = random_system(rng, 3, 2)
    x, y = system.simulate(rng.standard_normal(3) * 3, 60)
    truth, clean = system.simulate(x[-1], 80)
    return system, x, y, truth, clean + 0.1 * rng.standard_normal(clean.shape)


def test_run_gives_the_numbers_of_step(recorded):
    _, x, y, _, outputs = recorded
    outputs = outputs.copy()
    outputs[10, 0] = outputs[11] = np.nan
    h = ddmhe.History(x, y)
    settings = dict(horizon=12, x_bounds=(-0.1, 0.1), x_center="history", v_bounds=(-0.15, np.inf))
    log = ddmhe.DdMhe(h, **settings).run(outputs)
    stepper = ddmhe.DdMhe(h, **settings)
    for k, sample in enumerate(outputs):
        estimate = stepper.step(sample)
        assert np.array_equal(log.x[k], estimate.x)
        assert (log.status[k], log.active[k], log.iterations[k]) == (
            estimate.status,
            estimate.active,
            estimate.iterations,
        )
        assert log.cost[k] == estimate.cost
        assert np.array_equal(estimate.window[-1], estimate.x)
    assert (log.iterations > 0).any()
    assert (log.iterations == 0).any()


def test_shapes_while_the_window_grows(recorded):
    _, x, y, _, outputs = recorded
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), horizon=5, start="state")
    for t, sample in enumerate(outputs[:9], start=1):
        assert estimator.next_depth == min(t, 5)
        estimate = estimator.step(sample)
        m = min(t, 5)
        assert estimate.window.shape == (m + 1, 3)
        assert estimate.v.shape == (m, 2)
        assert estimator.t == t


def test_estimate_uses_outputs_up_to_the_previous_sample(recorded):
    """x̂(t) is of the time after y(t-1): with noise-free data it equals the next true state."""
    system, x, y, truth, _ = recorded
    _, clean = system.simulate(truth[0], 80)
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), horizon=6)
    assert np.allclose(estimator.step(clean[0]).x, truth[1], atol=1e-9)


def test_several_recordings_excite_what_one_does_not():
    """Each recording alone leaves a mode at rest; together they determine it. No window crosses the
    seam."""
    rng = np.random.default_rng(3)
    system = random_system(rng, 4, 2)
    values, vectors = np.linalg.eig(system.A)
    rest = np.linalg.solve(np.eye(4) - system.A, system.e)
    first = np.real(vectors[:, 0] + np.conj(vectors[:, 0])) + np.real(
        1j * (vectors[:, 0] - np.conj(vectors[:, 0]))
    )
    starts = [rest + first, rest + rng.standard_normal(4)]
    histories = [ddmhe.History(*system.simulate(start, 30)) for start in starts]
    assert not histories[0].rank(5).satisfied
    with pytest.raises(ddmhe.RankError, match="rank"):
        ddmhe.DdMhe(histories[0], 5)
    joined = ddmhe.History.concat(histories)
    assert joined.T == 60
    truth, clean = system.simulate(rng.standard_normal(4), 40)
    estimator = ddmhe.DdMhe(joined, 10, 0.9, 1.0, x_prior=truth[0])
    assert estimator.rank == 4
    assert np.allclose(estimator.run(clean).x, truth[1:], atol=1e-8)
    assert len(values) == 4


def test_both_paths_agree(recorded):
    """A box pushed in by 1e-9 sends the problem to the solver; the answer may move by no more than
    that."""
    _, x, y, _, outputs = recorded
    h = ddmhe.History(x, y)
    free = ddmhe.DdMhe(h, 10, 0.9, 1.0)
    for sample in outputs[:20]:
        closed_form = free.step(sample)
    boxed = ddmhe.DdMhe(h, 10, 0.9, 1.0)
    boxed.run(outputs[:19])
    hi = closed_form.window.max(0) - 1e-9
    estimate = boxed.step(outputs[19], x_bounds=(-np.inf, np.tile(hi, (11, 1))))
    assert closed_form.iterations == 0
    assert estimate.iterations > 0
    assert estimate.status == "optimal"
    assert estimate.active > 0
    assert np.allclose(estimate.window, closed_form.window, rtol=0, atol=1e-7)
    assert (estimate.window <= hi + 1e-10).all()


def test_bounds_hold_on_every_state_of_the_window(recorded):
    _, x, y, truth, outputs = recorded
    lo, hi = truth.min(0) * 0.8, truth.max(0) * 0.8
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y), 8, 0.9, 1.0, x_bounds=(lo, hi), x_prior=np.clip(truth[0], lo, hi)
    )
    seen = 0
    for sample in outputs[:30]:
        estimate = estimator.step(sample)
        if estimate.status == "optimal":
            assert (estimate.window >= lo - 1e-8).all()
            assert (estimate.window <= hi + 1e-8).all()
            seen += estimate.active > 0
    assert seen > 5


def test_equal_bounds_fix_a_state(recorded):
    _, x, y, truth, outputs = recorded
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), 8, 0.9, 1.0)
    estimator.run(outputs[:7])
    lo, hi = np.full((9, 3), -np.inf), np.full((9, 3), np.inf)
    lo[-1, 0] = hi[-1, 0] = truth[8, 0] + 0.3
    estimate = estimator.step(outputs[7], x_bounds=(lo, hi))
    assert estimate.x[0] == pytest.approx(truth[8, 0] + 0.3, abs=1e-9)


def test_infeasible_is_a_status_and_the_estimator_goes_on(recorded):
    _, x, y, _, outputs = recorded
    h = ddmhe.History(x, y)
    estimator = ddmhe.DdMhe(h, 8, 0.9, 1.0)
    free = ddmhe.DdMhe(h, 8, 0.9, 1.0)
    estimator.run(outputs[:10])
    free.run(outputs[:10])
    lo, hi = np.full((9, 3), -np.inf), np.full((9, 3), np.inf)
    lo[0], hi[0], lo[-1] = -1, 1, 50  # no motion of this system goes from 1 to 50 in eight samples
    estimate = estimator.step(outputs[10], x_bounds=(lo, hi))
    assert estimate.status == "infeasible"
    free.step(outputs[10])
    assert (estimate.window >= lo).all()  # inside the box, as documented, and not remembered
    assert (estimate.window <= hi).all()
    after = estimator.step(outputs[11])
    assert after.status == "optimal"
    assert np.array_equal(after.x, free.step(outputs[11]).x)


def test_missing_outputs(recorded):
    """NaN is 'not measured': such an entry has no influence, whatever it hides."""
    _, x, y, truth, outputs = recorded
    h = ddmhe.History(x, y)
    holes = outputs.copy()
    holes[5:8, 0] = np.nan
    holes[20] = np.nan
    log = ddmhe.DdMhe(h, 10, 0.9, 1.0).run(holes)
    assert np.isfinite(log.x).all()
    assert (
        np.abs(log.x - truth[1:]).max()
        < 3 * np.abs(ddmhe.DdMhe(h, 10, 0.9, 1.0).run(outputs).x - truth[1:]).max()
    )
    nothing = ddmhe.DdMhe(h, 10, 0.9, 1.0, x_prior=truth[0]).run(np.full((10, 2), np.nan))
    assert np.allclose(nothing.x, truth[1:11], atol=1e-9)  # pure prediction from the prior


def test_snapshot_continues_with_the_same_numbers(recorded):
    _, x, y, _, outputs = recorded
    estimator = ddmhe.DdMhe(
        ddmhe.History(x, y), 9, x_bounds=(-2, 2), x_center="history", warm_start=True
    )
    estimator.run(outputs[:15])
    blob = estimator.snapshot()
    assert isinstance(blob, bytes)
    again = ddmhe.DdMhe.restore(blob)
    assert again.t == 15
    assert np.array_equal(again.run(outputs[15:]).x, estimator.run(outputs[15:]).x)


def test_reset_starts_again(recorded):
    _, x, y, truth, outputs = recorded
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), 9)
    first = estimator.run(outputs).x
    estimator.reset()
    assert estimator.t == 0
    assert np.array_equal(estimator.run(outputs).x, first)
    estimator.reset(truth[0] + 1)
    assert not np.array_equal(estimator.run(outputs).x, first)


def test_warm_start_fills_the_window_from_the_recording(recorded):
    """Its first estimate is that of a full window over the recording's last outputs and the first
    new one."""
    _, x, y, _, outputs = recorded
    M = 10
    warm = ddmhe.DdMhe(ddmhe.History(x, y), M, 0.9, 1.0, warm_start=True)
    assert warm.next_depth == M
    first = warm.step(outputs[0])
    cold = ddmhe.DdMhe(ddmhe.History(x, y), M, 0.9, 1.0, x_prior=x[-M])
    expected = cold.run(np.vstack([y[-M + 1 :], outputs[:1]]))
    assert np.allclose(first.x, expected.x[-1], atol=1e-10)


def test_equilibrium_helps_a_noisy_recording_and_is_left_out_of_a_clean_one():
    """A slow decay seen for a short while with noise: knowing where it ends is worth a lot."""
    t = np.arange(400) * 0.01
    x, y = 60 * np.exp(-t)[:, None], 0.3 * np.exp(-t)[:, None]
    squares = np.zeros(2)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy_x, noisy_y = (
            x + 0.3 * rng.standard_normal(x.shape),
            y + 0.002 * rng.standard_normal(y.shape),
        )
        h = ddmhe.History(noisy_x[:51], noisy_y[:50], 0.01)
        for k, rest in enumerate((([0], [0]), None)):
            squares[k] += np.sum(
                (ddmhe.DdMhe(h, equilibrium=rest).run(noisy_y[50:-1]).x - x[51:]) ** 2
            )
    assert np.sqrt(squares[0] / squares[1]) < 0.5
    clean = ddmhe.DdMhe(ddmhe.History(x[:51], y[:50], 0.01), equilibrium=([0.0], [0.0]))
    assert any("equilibrium" in warning for warning in clean.warnings)


def test_an_unstable_setting_is_reported():
    """An unobserved growing mode: the prior is all the estimator has, and its error grows."""
    A, C = np.diag([1.05, 0.9]), np.array([[0.0, 1.0]])
    x = [np.array([1.0, 1.0])]
    for _ in range(40):
        x.append(A @ x[-1])
    x = np.array(x)
    estimator = ddmhe.DdMhe(ddmhe.History(x, x[:-1] @ C.T), 5, 0.9, 1.0, space=ddmhe.Exact())
    assert estimator.spectral_radius == pytest.approx(1.05**5, rel=1e-6)
    assert any("spectral radius" in warning for warning in estimator.warnings)


def test_rank_report():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((21, 2)), rng.standard_normal((20, 1))
    report = ddmhe.History(x, y).rank(4)
    assert (report.rank, report.required, report.satisfied) == (3, 3, True)
    starts = np.vstack([(x / np.abs(x[:17]).max(0))[:17].T, np.ones(17)])
    assert np.allclose(report.singular_values, np.linalg.svd(starts)[1])
    assert report.margin == pytest.approx(report.singular_values[2] / report.singular_values[0])
    flat = x.copy()
    flat[:, 1] = 2 * flat[:, 0] + 1
    assert ddmhe.History(flat, y).rank(4).rank == 2


def test_the_gil_is_released_during_run(recorded):
    """This thread's longest pause is a part of the run's half second; held, the GIL would make it
    all of it."""
    _, x, y, _, outputs = recorded
    estimator = ddmhe.DdMhe(ddmhe.History(x, y), 10, v_bounds=(-0.01, 0.01))
    outputs = np.tile(outputs, (400, 1))
    took, longest = [], 0.0

    def work():
        begin = time.perf_counter()
        estimator.run(outputs)
        took.append(time.perf_counter() - begin)

    thread = threading.Thread(target=work)
    last = time.perf_counter()
    thread.start()
    while thread.is_alive():
        now = time.perf_counter()
        longest, last = max(longest, now - last), now
    assert took[0] > 0.1
    assert longest < 0.5 * took[0]


def test_default_rule_does_not_depend_on_units_or_offsets():
    rng = np.random.default_rng(2)
    system = random_system(rng, 2, 2)
    x, y = system.simulate(rng.standard_normal(2), 100)
    x, y = x + 0.05 * rng.standard_normal(x.shape), y + 0.05 * rng.standard_normal(y.shape)
    a = ddmhe.DdMhe(ddmhe.History(x[:61], y[:60]))
    b = ddmhe.DdMhe(ddmhe.History(180 / np.pi * x[:61] + 7, 1e-3 * y[:60] - 4))
    assert (a.horizon, a.rank) == (b.horizon, b.rank)
    assert a.ridge == pytest.approx(b.ridge)
    assert np.allclose(180 / np.pi * a.run(y[60:]).x + 7, b.run(1e-3 * y[60:] - 4).x, atol=1e-6)


def test_many_runs_are_the_single_ones():
    """Other horizons, bounds that bind, lost samples: every log as if it had been run alone."""
    model = ddmhe.models.detumbling()
    settings = [
        {"horizon": 5 + k % 7, "v_bounds": (-0.02, 0.02) if k % 2 else None} for k in range(12)
    ]
    records = [model.simulate(30.0, 0.1, noise=0.01, seed=k) for k in range(12)]
    histories = [ddmhe.History(r.x[:151], r.y[:150], dt=0.1) for r in records]
    outputs = [r.y[150 : 250 + 3 * k] for k, r in enumerate(records)]
    outputs[3][40, 1] = np.nan
    single = [
        ddmhe.DdMhe(h, **s).run(Y) for h, s, Y in zip(histories, settings, outputs, strict=True)
    ]
    estimators = [ddmhe.DdMhe(h, **s) for h, s in zip(histories, settings, strict=True)]
    many = ddmhe.run_many(estimators, outputs)
    for a, b in zip(single, many, strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.status, b.status)
    with pytest.raises(ddmhe.ShapeError, match="logs: expected 12"):
        ddmhe.run_many(estimators, outputs[:3])
    with pytest.raises(ddmhe.DdmheError, match="only once"):
        ddmhe.run_many([estimators[0], estimators[0]], outputs[:2])
    with pytest.raises(ddmhe.ShapeError, match="logs, number 1: expected 3 columns"):
        ddmhe.run_many(estimators[:2], [outputs[0], outputs[1][:, :2]])
    with pytest.raises(ddmhe.DdmheError, match="estimators"):
        ddmhe.run_many([1.0], outputs[:1])


def test_many_logs_continue_from_copies_of_one_estimator(recorded):
    """The estimator itself stays where it is; copies go on alone."""
    _, x, y, _, outputs = recorded
    est = ddmhe.DdMhe(ddmhe.History(x, y), horizon=12, v_bounds=(-0.1, 0.1))
    est.run(outputs[:30])
    logs = [outputs[30:] * (1 + 0.01 * k) for k in range(9)]
    expected = [copy.copy(est).run(log) for log in logs]
    assert not np.array_equal(expected[0].x, expected[8].x)
    for a, b in zip(ddmhe.run_many(est, logs), expected, strict=True):
        np.testing.assert_array_equal(a.x, b.x)
    assert est.t == 30
    np.testing.assert_array_equal(copy.deepcopy(est).step(logs[0][0]).x, expected[0].x[0])


def test_many_recordings_get_an_estimator_each(recorded):
    _, x, y, _, outputs = recorded
    histories = [ddmhe.History(x[k : k + 50], y[k : k + 49]) for k in range(5)]
    logs = [outputs] * 5
    for found, history in zip(ddmhe.run_many(histories, logs), histories, strict=True):
        np.testing.assert_array_equal(found.x, ddmhe.DdMhe(history).run(outputs).x)
    with pytest.raises(ddmhe.DdmheError, match="the same throughout, found"):
        ddmhe.run_many([histories[0], ddmhe.DdMhe(histories[0])], logs[:2])
    with pytest.raises(ddmhe.DdmheError, match="estimators: expected a DdMhe or a list"):
        ddmhe.run_many(3.0, logs)


def test_states_can_be_written_into_arrays_of_the_caller(recorded):
    """`out` receives the same numbers; the Estimate of the step stays to be had."""
    _, x, y, _, outputs = recorded
    h = ddmhe.History(x, y)
    expected = ddmhe.DdMhe(h, horizon=12).run(outputs)
    est, x_hat = ddmhe.DdMhe(h, horizon=12), np.empty(3)
    assert est.estimate is None
    for k, sample in enumerate(outputs):
        assert est.step(sample, out=x_hat) is x_hat
        np.testing.assert_array_equal(x_hat, expected.x[k])
        assert est.estimate.cost == expected.cost[k]
    states = np.empty((len(outputs), 3))
    assert ddmhe.DdMhe(h, horizon=12).run(outputs, out=states).x is states
    np.testing.assert_array_equal(states, expected.x)


def read_only(shape):
    array = np.zeros(shape)
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "out",
    [
        np.empty(9),
        np.empty(3, dtype=np.float32),
        [0.0] * 3,
        np.empty(6)[::2],
        read_only(3),
        np.empty((3, 1)),
    ],
)
def test_an_out_that_cannot_take_the_state_changes_nothing(recorded, out):
    _, x, y, _, outputs = recorded
    est = ddmhe.DdMhe(ddmhe.History(x, y), horizon=12)
    with pytest.raises(ddmhe.ShapeError, match="out: expected a writable float64 array"):
        est.step(outputs[0], out=out)
    with pytest.raises(ddmhe.ShapeError, match="out: expected a writable float64 array"):
        est.run(outputs, out=out)
    assert est.t == 0
