"""`ddmhe reproduce` as a user runs it, and what its verdicts rest on."""

import dataclasses
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

import ddmhe
from commands import in_here
from ddmhe.reproduce import (
    EXPERIMENTS,
    Claim,
    bench,
    interval_theory,
    pendulum,
    pendulum_task,
    satellite,
    theory,
    write_claims,
)
from ddmhe.reproduce.claims import cases, holds_for, verdict
from ddmhe.reproduce.experiments import COLORS
from ddmhe.reproduce.montecarlo import Trial, Trials, estimates

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "repoimu-pendulum"
)


def run(*arguments, program=("-m", "ddmhe")):
    command = [sys.executable, *program, "reproduce", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def table(path):
    """Cells of the claims by (source, claim)."""
    rows = [
        line.split(" | ")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.count(" | ") == 5
    ]
    return {(row[0].removeprefix("| "), row[1]): row[2:] for row in rows}


FEW_SEEDS = """
from ddmhe.reproduce import experiments
experiments.SEEDS, experiments.FAMILY_SEEDS = 2, 1
from ddmhe.cli import main
main()
"""


@pytest.mark.parametrize(
    "program",
    [["-c", FEW_SEEDS], pytest.param(["-m", "ddmhe"], marks=pytest.mark.long)],
    ids=["few seeds", "all"],
)
def test_one_experiment_leaves_figures_series_and_claims(tmp_path, program):
    done = run("bench-both", "--out", tmp_path, program=program)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir()}
    files = {f"bench-both.{end}" for end in ("csv", "png", "svg")} | {"bench-both-family.csv"}
    assert names == files | {"claims.md", "tables.md"}
    assert imread(tmp_path / "bench-both.png").std() > 0.02
    series = pd.read_csv(tmp_path / "bench-both.csv")
    assert len(series) == 250
    assert series["time_s"].iloc[[0, -1]].tolist() == pytest.approx([0.51, 3.0])
    family = pd.read_csv(tmp_path / "bench-both-family.csv")
    assert len(family) == len(bench.FAMILY)
    # the verdict again, from the family's series
    claim = table(tmp_path / "claims.md")[
        "IV-A2, Fig. 5", "With noise and disturbance Dd-KMHE deviates unacceptably"
    ]
    kicks = family["kick"].str.removesuffix(" rad/s").astype(float)
    counted = int((family[f"{bench.KMHE}: RMSE later"] > 0.5 * kicks).sum())
    assert claim[1].startswith(f"{counted} of {len(bench.FAMILY)} benches")
    assert 0 < counted < len(bench.FAMILY)
    assert claim[2] == "**holds for …**"


def test_the_numbers_of_algorithm_2(tmp_path):
    """Rank 5 of (44), 0.4614 as an output and not as a certificate, and the numbers that no bench
    decides."""
    done = run("design", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    rows = table(tmp_path / "claims.md")
    rank = rows["A-A, (44)", "[X1; Y0] of the recorded differences has rank n + p"]
    assert "3-DOF: 6 of 6" in rank[1]
    assert "3-DOF, no noise: 5 of 6" in rank[1]
    assert "bench, no noise: 1 of 2" in rank[1]
    assert rank[2] == "**holds with …**"
    output = rows["IV-B, Algorithm 2", "ρ0 and μ0 of the 3-DOF case are what Algorithm 2 returns"]
    assert "r = 0.2773 gives ρ0 = 0.4614" in output[1]
    assert output[2] == "**plausible**"
    meaning = rows["IV-B, (24)", "ρ0 and μ0 of the 3-DOF case satisfy (24)"]
    assert "5.98" in meaning[1]
    assert meaning[2] == "**does not hold**"
    for symbol in ("ρ0", "μ0"):
        assert rows["IV-A2, Algorithm 2", f"{symbol} of the bench"][2] == "**cannot be checked**"
    assert (
        rows["A-B3, Algorithm 2", "ρ0 and μ0 are properties of the system"][2]
        == "**does not hold**"
    )


def test_no_gain_of_an_affordable_brake_gives_the_printed_pair():
    """|A| ≤ √(ρ0/6) + √(μ0/6)|C|: the bound of the claim by a search over gains, with C just below
    and above it."""
    rho0, mu0 = 1.2705e-19, 3.3307e-14
    A, most = 1 - 0.01, np.sqrt(mu0 / 6)  # |L| ≤ √(μ0/6)
    least = (A - np.sqrt(rho0 / 6)) / most
    assert 1.2e7 < least < 1.4e7
    gains = np.linspace(-most, most, 100_001)
    assert (6 * (A + gains * 0.999 * least) ** 2).min() > 1e10 * rho0
    assert (6 * (A + gains * least) ** 2).min() == pytest.approx(rho0, rel=1e-4)


def test_the_rank_of_44_needs_the_rounding_of_the_differences():
    """Rank 5 at every sampling time; C has rank 2, so a sixth direction is rounding (3e-31 in 60
    digits)."""
    for dt in (0.1, 0.5, 1.0):
        record = ddmhe.models.detumbling().simulate(20.0, dt)
        assert (
            ddmhe.design.pole_placement(
                ddmhe.History(record.x, record.y[:-1], dt=dt), attempts=1
            ).rank
            == 5
        )
    noisy = record.y[:-1] + 1e-9 * np.random.default_rng(0).standard_normal(
        (20, 3)
    )  # of 5 N·m: no rounding
    assert ddmhe.design.pole_placement(ddmhe.History(record.x, noisy, dt=1.0), attempts=1).rank == 6


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], "NAME"),
        (["real", "--data", "/nowhere"], "--data: expected a directory with pendulum logs"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(arguments, words, tmp_path):
    done = in_here("reproduce", *arguments, "--out", tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_trials_know_their_errors():
    """Two seeds, an estimator that is off by 1 and one that fails half way."""
    t = np.arange(1, 5) * 0.5
    x = np.zeros((4, 2))
    wrong, failed = np.full((4, 2), [0.6, 0.8]), np.zeros((4, 2))
    failed[2:] = np.nan
    trials = Trials([Trial(t, x, x, {"wrong": k * wrong, "failed": failed}) for k in (1, 3)])
    assert trials.rms("wrong").tolist() == pytest.approx([1.0, 3.0])
    assert np.isinf(trials.rms("failed")).all()
    assert trials.rms("failed", 0.0, 1.0).tolist() == [0.0, 0.0]
    assert np.isinf(trials.rms("failed", 1.0, 1.5)).all()
    assert trials.band("wrong")[[0, 2], 0].tolist() == pytest.approx([1.0, 3.0])


def test_an_estimator_that_raises_is_reported_as_failed():
    class Broken:
        def run(self, Y):
            raise np.linalg.LinAlgError("singular")

    found = estimates({"broken": Broken}, np.zeros((3, 1)), 2)
    assert np.isnan(found["broken"]).all()
    assert found["broken"].shape == (3, 2)


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


def test_the_counterexample_to_25_31_and_34_in_exact_arithmetic():
    """The window y(3..5) and the prior x̂(3) = x(3) = 0 by rational normal equations, under all of
    the conditions."""
    F = Fraction
    rho, mu, M, C = F(1, 20), F(6), 3, F(1000)
    A = [[F(1), F(10)], [F(0), F(1)]]

    def times(X, Y):
        return [
            [
                sum(a * b for a, b in zip(row, column, strict=True))
                for column in zip(*Y, strict=True)
            ]
            for row in X
        ]

    # A + L C = 0 with L = -A/1000, and 6 λmax(LᵀL) ≤ 6 trace(LᵀL) ≤ μ; 4ρ^M < 1; 6 ≤ μ
    gain = [[-a / C for a in row] for row in A]
    assert all(
        a + C * g == 0 for ra, rg in zip(A, gain, strict=True) for a, g in zip(ra, rg, strict=True)
    )
    assert 6 * sum(g * g for row in gain for g in row) <= mu
    assert 4 * rho**M < 1
    x = [[[F(0)], [F(0)]]]
    for k in range(6):
        step = times(A, x[-1])
        x.append([step[0], [step[1][0] + (k == 4)]])
    # minimise 2ρ³|z|² + Σ_j ρ^{j-1} μ C² |A^{3-j} z - x(6-j)|² over z = x̂(3)
    power, normal, right = (
        [[F(1), F(0)], [F(0), F(1)]],
        [[2 * rho**M, F(0)], [F(0), 2 * rho**M]],
        [F(0), F(0)],
    )
    terms = []
    for age in (3, 2, 1):
        weight = rho ** (age - 1) * mu * C**2
        terms.append((weight, power, x[6 - age]))
        for i in range(2):
            right[i] += weight * sum(power[k][i] * x[6 - age][k][0] for k in range(2))
            for j in range(2):
                normal[i][j] += weight * sum(power[k][i] * power[k][j] for k in range(2))
        power = times(A, power)
    determinant = normal[0][0] * normal[1][1] - normal[0][1] ** 2
    z = [
        [(normal[1][1] * right[0] - normal[0][1] * right[1]) / determinant],
        [(normal[0][0] * right[1] - normal[1][0] * right[0]) / determinant],
    ]
    last = times(power, z)
    error = float(sum((a[0] - b[0]) ** 2 for a, b in zip(last, x[6], strict=True))) ** 0.5
    cost = 2 * rho**M * (z[0][0] ** 2 + z[1][0] ** 2)
    for weight, P, target in terms:
        cost += weight * sum((a[0] - b[0]) ** 2 for a, b in zip(times(P, z), target, strict=True))
    assert error == pytest.approx(8.49, abs=0.01)
    example = theory.Example.standard()
    assert example.run() == pytest.approx((error, float(cost)), rel=1e-6)
    assert example.allowed() == pytest.approx((0.3**0.5, (4 * 0.05**3) ** (1 / 6) * 6**0.5))
    assert error > max(example.allowed())
    assert cost > 0  # (31): J* ≤ 0


def test_one_step_is_19():
    """The smallest eigenvalue decides (19): compared with the inequality at random differences,
    both ways."""
    rng = np.random.default_rng(0)
    A, C = np.array([[0.3, 0.1], [0.0, 0.2]]), np.eye(2)
    for rho, mu in ((0.9, 6.0), (0.9, 1.5), (0.05, 0.1)):
        holds = theory.one_step(A, C, rho, mu) >= 0
        worst = np.inf
        for _ in range(4000):
            x, e, w, r, v = rng.standard_normal((5, 2)) * 10.0 ** rng.uniform(-2, 1, (5, 1))
            e = w if rng.random() < 0.5 else e
            y = C @ x + r + v
            right = rho * x @ x + mu * (y @ y + r @ r + v @ v + e @ e + w @ w)
            worst = min(worst, right - (A @ x + e + w) @ (A @ x + e + w))
        assert (worst >= 0) == holds


def test_lemma_1_needs_its_row_of_ones():
    """The lemma holds on random systems; without 1ᵀα = 1 the offsets are scaled."""
    assert max(theory.lemma_1(40)) < 1e-8
    assert theory.lemma_1(40, ones=False)[1] > 0.1


def test_the_sign_of_48():
    """Positive definite it never is; negative definite for poles inside, not for poles outside of
    the disc."""
    A = np.array([[0.5, 0.2], [0.0, -0.3]])
    low, high = theory.region_sign(A, 0.9, np.eye(2))
    assert low < high < 0
    assert theory.region_sign(A, 0.4, np.eye(2))[1] > 0
    assert theory.region_sign(A, 0.4, np.eye(2))[0] < 0


def test_the_linearisation_by_hand():
    """Euler's equations are quadratic: w = dt J⁻¹(-δ × J δ), and the torque is linear, v = 0."""
    model = ddmhe.models.detumbling()
    x = model.simulate(40.0, 0.1).x[200:]
    inertia = np.array([4513.2, 4138.1, 3282.5])
    off = x - x[0]
    w = -0.1 * np.cross(off, off * inertia) / inertia
    (row,) = theory.linearisation((20.0,))
    assert row[1] == pytest.approx(np.rad2deg(np.linalg.norm(w[:-1], axis=1).max()), rel=1e-4)
    assert row[2] < 1e-10
    kappa = (4 * 0.8**10) ** 0.1
    sizes = np.linalg.norm(w[:-1], axis=1)
    allowed = sum(kappa ** ((199 - j) / 2) * 1e5**0.5 * sizes[j] for j in range(200))
    assert row[3] == pytest.approx(np.rad2deg(allowed), rel=1e-3)


def test_scatter_is_free_of_bias_and_drift():
    t = np.linspace(0.01, 1, 100)
    noise = 0.1 * np.random.default_rng(0).standard_normal((100, 1))
    x = np.zeros((100, 1))
    drift = 3 + 5 * (t - 0.3)[:, None] ** 3
    failed = noise.copy()
    failed[60:] = np.nan
    trials = Trials([Trial(t, x, x, {"still": noise, "drifts": noise + drift, "failed": failed})])
    assert trials.scatter("drifts", 0, 1) == pytest.approx(trials.scatter("still", 0, 1), rel=1e-9)
    assert trials.scatter("still", 0, 1)[0] == pytest.approx(0.1, rel=0.15)
    assert np.isinf(trials.scatter("failed", 0, 1)[0])


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
        colors={bench.MHE: COLORS[bench.MHE]},
        band=1.0,
    )
    above = figure.axes[0]
    first, *_ = (line for line in above.lines if line.get_color() == "0.2")
    assert first.get_xdata()[[0, -1]].tolist() == pytest.approx([0.0, 0.5])
    (estimate,) = (line for line in above.lines if line.get_color() == COLORS[bench.MHE])
    assert len(estimate.get_xdata()) == 250
    assert bool(above.collections) == acts
    assert f"active at {250 * acts} of 250" in figure.legends[0].get_texts()[1].get_text()


def test_every_estimator_has_a_colour_of_its_own():
    assert len(set(COLORS.values())) == len(COLORS)
    assert set(bench.JUDGED) <= set(COLORS)


def test_claims_are_a_table(tmp_path):
    write_claims(tmp_path / "c.md", [Claim("Fig. 0", "a | b", "", "1", "holds", "because")])
    lines = (tmp_path / "c.md").read_text(encoding="utf-8").splitlines()
    assert r"| Fig. 0 | a \| b | – | 1 | **holds** | because |" in lines
    assert "## Misprints that do no harm" in lines


def test_every_experiment_of_the_contract_is_there():
    wanted = {
        "bench-nominal",
        "bench-noise",
        "bench-disturbance",
        "bench-both",
        "bench-mu",
        "detumbling",
        "design",
    }
    assert wanted <= set(EXPERIMENTS)


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_logs(tmp_path):
    """Two logs through the command; the defaults' score against an independent reading with
    pandas."""
    paths = sorted(DATA.glob("*.csv"))[:2]
    for path in paths:
        (tmp_path / path.name).symlink_to(path)
    done = run("real", "--data", tmp_path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    scores = pd.read_csv(tmp_path / "out" / "real.csv", index_col=0)
    assert list(scores.index) == [path.stem for path in paths]
    task = pendulum_task(paths[0])
    frame = pd.read_csv(paths[0]).iloc[::4].reset_index(drop=True)
    rates = frame[[f"omega_{axis}_rad_s" for axis in "xyz"]].to_numpy()
    begin = int(np.argmax(np.linalg.norm(rates, axis=1) > 0.5)) + 20
    recorded, _ = task.history.recordings[0]
    assert recorded[0] == pytest.approx(rates[begin])
    x_hat = ddmhe.DdMhe(task.history).run(task.Y).x
    seen = np.isfinite(task.x).all(axis=1)
    truth = task.x[seen]
    expected = np.sqrt(np.mean((x_hat[seen] - truth) ** 2) / np.mean((truth - truth.mean(0)) ** 2))
    assert scores["Dd-MHE, defaults"].iloc[0] == pytest.approx(expected, rel=1e-9)
    assert "| geometric mean |" in (tmp_path / "out" / "real.md").read_text(encoding="utf-8")


def test_the_interval_paper_has_its_verdicts(tmp_path):
    done = run("pendulum", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir()}
    figures = {
        f"pendulum{kind}.{end}" for kind in ("-fig1", "-fig2", "-widths") for end in ("png", "svg")
    }
    assert names == figures | {"pendulum.csv", "pendulum-widths.csv", "claims.md", "tables.md"}
    rows = {claim: cells[2] for (_, claim), cells in table(tmp_path / "claims.md").items()}
    assert rows["The design (42) gives this gain"] == "**holds**"
    assert rows["φ0 is the value of (44) at k = 0"] == "**holds with …**"
    assert rows["The initial bound holds for every start in the box"] == "**does not hold**"
    assert rows["The bounded error converges faster on x2"] == "**holds with …**"
    assert rows["The state stays within its bounds"] == "**holds**"
    assert rows["Some J in [J̲, J̄] satisfies both inequalities"] == "**holds**"
    assert rows["⟨p, M⟩ ⊆ ⟨p, ↓q(M)⟩"] == "**holds with …**"
    assert not any("Interval paper, V" in source for source, _ in table(tmp_path / "claims.md"))
    assert "| peak-to-peak ball (44) | 0.58" in (tmp_path / "tables.md").read_text(encoding="utf-8")


def test_where_the_printed_phi_0_comes_from():
    """V0 = eᵀPe at e = (0.1, 1) with P = [[15.2664, -.9930], [·, .12834]], μ = 31.505 and λ = .5,
    by hand."""
    P, mu, mu_w, e = (
        np.array([[15.2664, -0.9930], [-0.9930, 0.12834]]),
        31.5052,
        15.7526,
        np.array([0.1, 1.0]),
    )
    level = e @ P @ e
    assert level == pytest.approx(0.0824, abs=2e-4)
    phi = (mu * (0.5 * level + mu_w * (2 * 0.006**2 + 0.001**2))) ** 0.5
    assert phi == pytest.approx(1.155, abs=1e-3)
    assert pendulum.radii(level)[0] == pytest.approx(1.176, abs=2e-3)
    worst = max(a @ P @ a for a in (np.array([0.1, 1.0]), np.array([0.1, -1.0])))
    assert pendulum.worst_V0() == pytest.approx(worst, rel=1e-3)
    assert pendulum.left_the_ball(pendulum.worst_V0()) == 0.0  # the sound ball is never left
    assert pendulum.left_the_ball(pendulum.V0_of(1.15)) == 1.0


def test_the_statements_of_the_interval_paper_by_independent_arithmetic():
    apart, outside = interval_theory.equality(50)
    assert apart < 1e-14
    assert outside <= 0
    # (24): P = γI with γ = 1/√(2λ) satisfies (22) for Ã = 0: V⁺ = γ‖w‖² ≤ (1-λ)V + γ‖w‖²; (23):
    # λγ·2γ = 1
    gamma = 1 / (2 * 0.9) ** 0.5
    product = 2 * 0.9 * gamma**2
    assert product == pytest.approx(1.0)
    assert interval_theory.worst_single_step() == pytest.approx((2.0, 2 / 0.9, 1 / 0.9))
    assert interval_theory.from_norm(1.15) == pytest.approx(1.3225)
    assert interval_theory.mean_value_point() == pytest.approx(2 * np.pi)
    M = np.array([[2.0, 1.0, -1.0]])
    np.testing.assert_array_equal(interval_theory.reduced_as_printed(M, 2), [[2.0, 0.0]])
    assert ddmhe.Zonotope([0.0], M).reduce(2).interval_hull()[1][0] >= 4.0


def test_figures_1_and_2_start_at_k_0():
    one = pendulum.trial(0)
    for name, half in ((pendulum.ZONOTOPE, [0.1, 1.0]), (pendulum.PRINTED_BALL, [1.15, 1.15])):
        lower, upper = pendulum.from_start(one, name)
        assert lower.shape == one.x.shape
        assert 0.5 * (upper[0] - lower[0]) == pytest.approx(half)
    # the intervals at k = 1, 2, 3 on x2: the printed ball is the tighter one, the sound one is not
    ball, sound, zonotope = (
        0.5 * np.subtract(*pendulum.from_start(one, name)[::-1])[1:4, 1]
        for name in (pendulum.PRINTED_BALL, pendulum.BALL, pendulum.ZONOTOPE)
    )
    late = 31.5052 * 15.7526 * (2 * 0.006**2 + 0.01**2)
    assert ball == pytest.approx(
        [((1.15**2 - late) / 2**k + late) ** 0.5 for k in (1, 2, 3)], rel=1e-3
    )
    assert zonotope == pytest.approx([1.792, 0.961, 0.546], abs=0.01)
    assert (ball < zonotope).all()
    assert (sound > zonotope).all()


class _Raising:
    def __init__(self, error):
        self.error = error

    def run(self, Y):
        raise self.error


def test_only_numbers_out_of_bounds_count_as_diverged():
    """A wrong shape, a wrong argument or a fault of the code is an error, not an estimator that
    diverged."""
    from ddmhe.baselines import ErrorStateKalman
    from ddmhe.reproduce.montecarlo import estimates

    rng = np.random.default_rng(0)
    history, Y = (
        ddmhe.History(rng.standard_normal((41, 2)), rng.standard_normal((40, 1))),
        np.zeros((9, 1)),
    )
    wild = ErrorStateKalman(history, Q=1.0, R=1e300)
    wild.A *= 1e90
    found = estimates(
        {"wild": lambda: wild, "lost": lambda: _Raising(np.linalg.LinAlgError("singular"))}, Y, 2
    )
    assert np.isnan(found["wild"][-1]).all()
    assert np.isnan(found["lost"]).all()
    for make, kind in (
        (lambda: ddmhe.DdMhe(history, horizon=0), ddmhe.DdmheError),
        (lambda: _Raising(ValueError("operands could not be broadcast together")), ValueError),
        (lambda: _Raising(ddmhe.ShapeError("Y: expected 2 columns")), ddmhe.ShapeError),
        (
            lambda: ErrorStateKalman(
                ddmhe.History(rng.standard_normal((41, 2)), np.zeros((40, 3)))
            ),
            ddmhe.ShapeError,
        ),
        (
            lambda: ErrorStateKalman(
                ddmhe.History(rng.standard_normal((41, 3)), np.zeros((40, 1)))
            ),
            ddmhe.ShapeError,
        ),
    ):
        with pytest.raises(kind):
            estimates({"wrong": make}, Y, 2)
