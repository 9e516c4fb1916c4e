"""The bench, its family and the 3-DOF case: what a seed is, and what the verdicts on the estimators
rest on."""

import dataclasses

import numpy as np
import pytest

import ddmhe
from ddmhe.report.palette import HISTORY
from ddmhe.reproduce import (
    bench,
    satellite,
)
from ddmhe.reproduce.claims import cases, holds_for, verdict
from ddmhe.reproduce.experiments import ESTIMATORS
from ddmhe.reproduce.montecarlo import Trials


def test_a_seed_of_the_bench_is_what_the_module_says():
    """The kick speeds the target up by 4 rad/s between 1.5 and 1.6 s; noise is 25 times larger from
    1.5 to 2 s."""
    calm, kicked = bench.trial(0), bench.trial(0, disturbed=True)
    before, after = calm.t <= 1.5, calm.t > 1.6
    np.testing.assert_array_equal(calm.x[before], kicked.x[before])
    assert (kicked.x - calm.x)[after][0, 0] == pytest.approx(4.0, rel=0.06)
    quiet, loud = (bench.trial(1, noisy=noisy) for noisy in (False, True))
    model = ddmhe.models.spin_down()
    during = (quiet.t > 1.51) & (quiet.t <= 2.0)
    torque = model.output(
        np.vstack([quiet.x[:1], quiet.x[:-1]])
    )  # y(t-1) belongs to the estimate at t
    assert np.std((loud.y - torque)[during]) == pytest.approx(5e-3, rel=0.3)
    assert np.std((quiet.y - torque)[during]) == pytest.approx(2e-4, rel=0.3)


def test_the_3_dof_case_with_a_clean_recording_gives_the_errors_known_from_elsewhere():
    """An independent prototype: paper's weights .35/.49/.85, affine ESKF .040/.16/1.11, linear ESKF
    100 s 1.0 deg/s."""
    trials = Trials([satellite.trial(seed, 0.01, 0.0) for seed in range(3)])

    def errors(name):
        return [np.rad2deg(np.median(trials.rms(name, 0.0, span))) for span in (20, 40, 100)]

    assert errors(satellite.MHE) == pytest.approx([0.35, 0.49, 0.85], rel=0.2)
    assert errors("Dd-ESKF, Q = 1e5, R = 1e3") == pytest.approx([0.040, 0.16, 1.11], rel=0.2)
    assert errors("Dd-ESKF, linear model")[2] == pytest.approx(1.0, rel=0.1)
    assert errors(satellite.EKF)[2] < 1e-3
    # Euler's equation, fitted to a recording without noise: the same prototype's .001 at 100 s
    assert errors(satellite.RIGID)[2] < 1e-3


def test_no_bench_alone_refutes():
    assert holds_for([True, True, None]) == "holds"
    assert holds_for([True, False]) == "holds for …"
    assert holds_for([False, False]) == "cannot be checked"
    assert holds_for([None]) == "cannot be checked"
    assert verdict({"a": True, "b": False}) == "holds for …"
    assert verdict({"a": False}) == "does not hold"
    assert cases({"a": True, "b": False}) == "; holds for a; not for b"
    judged = {each: each.decay > 1 for each in bench.FAMILY}
    assert bench.shares(judged) == "18 of 36 benches (decay 1 s 0/18, 5 s 18/18)"


def test_a_bench_on_which_statements_of_iv_a_hold_at_once():
    """Decay 5 s, C = 5e-4 N·m·s, noise × 3: the filter ignores noise, misses 2.41 of 4 rad/s;
    Dd-KMHE drifts away."""
    other = bench.Bench(5.0, 5e-4, 3.0, 4.0)
    assert other in bench.FAMILY
    runs = {
        kind: Trials(
            [bench.trial(seed, bench=other, names=bench.JUDGED, **given) for seed in range(4)]
        )
        for kind, given in {
            "noise": {"noisy": True},
            "disturbance": {"disturbed": True},
            "both": {"noisy": True, "disturbed": True},
        }.items()
    }
    assert np.median(runs["disturbance"].rms(bench.ESKF, *bench.AFTER)) == pytest.approx(
        2.41, abs=0.05
    )
    held = {
        statement.claim: statement.judge(other, runs[kind])
        for kind in runs
        for statement in bench.STATEMENTS[kind]
        if not statement.source.startswith("V")
    }
    for claim in (
        "Dd-ESKF with Q = 1e5, R = 1e3 is strongly robust against noise",
        "Dd-ESKF (Q = 1e5, R = 1e3) cannot follow the disturbance",
        "With noise and disturbance Dd-KMHE deviates unacceptably",
    ):
        assert held[claim], claim
    nominal = Trials([bench.trial(seed, disturbed=True, names=bench.JUDGED) for seed in range(2)])
    (cannot,) = (each for each in bench.STATEMENTS["disturbance"] if "cannot follow" in each.claim)
    assert not cannot.judge(bench.NOMINAL, nominal)  # … and the statement can fail


def test_the_centres_of_kmhe_are_drawn_for_every_seed():
    history = ddmhe.History(np.linspace(1, 2, 51)[:, None] ** 2, np.linspace(1, 2, 50)[:, None])
    a, b = (
        bench.estimators(history, bench.NOMINAL, np.ones(1), 1e5, seed)[bench.KMHE]().centres
        for seed in (0, 1)
    )
    assert np.abs(a - b).max() > 0.01


def test_the_box_is_about_the_history_window():
    """x_c(t) against NumPy: the first direction of the centred windows, fitted to the outputs."""
    one = bench.trial(0)
    record = bench.NOMINAL.model.simulate(3.0, 0.01)
    x = one.history[1]
    y = record.y + 2e-4 * np.random.default_rng(0).standard_normal(record.y.shape)
    m = 20
    windows = np.array(
        [np.concatenate([y[k : k + m, 0], x[k : k + m + 1, 0]]) for k in range(50 - m + 1)]
    ).T
    scale = np.concatenate([np.full(m, y[:50].std()), np.full(m + 1, x.std())])
    windows = windows / scale[:, None]
    mean = windows.mean(axis=1)
    first = np.linalg.svd(windows - mean[:, None])[0][:, 0]
    seen = one.y[100 : 100 + m, 0] / scale[:m] - mean[:m]
    expected = scale[-1] * (mean[-1] + first[-1] * (first[:m] @ seen) / (first[:m] @ first[:m]))
    assert one.center[100 + m - 1, 0] == pytest.approx(expected, abs=1e-6)
    assert not one.active.any()  # x̂ stays inside of the nominal bench's box
    assert np.abs(one.x_hat[bench.MHE] - one.center).max() < bench.BOX


@pytest.mark.parametrize("acts", [True, False])
def test_the_figure_starts_with_the_history_and_shows_the_box_where_it_acts(acts):
    from ddmhe.reproduce.figures import trials_figure

    kept = bench.trial(0, names=(bench.MHE,))
    one = dataclasses.replace(kept, active=np.full(250, int(acts)))
    figure = trials_figure(
        Trials([one, one]),
        names=("omega",),
        quantity="speed (rad/s)",
        colors={bench.MHE: ESTIMATORS[bench.MHE]},
        band=1.0,
    )
    above = figure.axes[0]
    first, *_ = (line for line in above.lines if line.get_color() == HISTORY)
    assert first.get_xdata()[[0, -1]].tolist() == pytest.approx([0.0, 0.5])
    (estimate,) = (line for line in above.lines if line.get_color() == ESTIMATORS[bench.MHE])
    assert len(estimate.get_xdata()) == 250
    assert bool(above.collections) == acts
    assert f"active at {250 * acts} of 250" in figure.legends[0].get_texts()[1].get_text()


def test_every_estimator_has_a_colour_of_its_own():
    assert len(set(ESTIMATORS.values())) == len(ESTIMATORS)
    assert set(bench.JUDGED) <= set(ESTIMATORS)
