"""How far to trust each estimate, as the command line says it: columns, words, figures."""

import re

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba

import ddmhe
from commands import COLUMNS, STATE, T, in_a_process, in_here, printed
from ddmhe.report.figures import estimate_figure
from ddmhe.report.style import DOUBTS
from ddmhe.report.trust import Trust, reason_words, share_words

ESTIMATE = ("estimate", "log.csv", *COLUMNS, "--history", 20, "--out", "est.csv")
BESIDE = [*(f"{name}_std" for name in STATE), "trusted", "reasons"]
WITH_EVIDENCE = ["t", *STATE, *BESIDE, "status"]
WORDS = {1: "novel", 2: "uncertain", 4: "stuck", 8: "outside"}


def run_of(recording, **settings):
    history = ddmhe.History(recording.x[: T + 1], recording.y[:T], dt=0.1)
    return ddmhe.DdMhe(history, start="recording", **settings).run(recording.y[T:-1])


@pytest.fixture
def here(frame, tmp_path):
    """A directory with the log, as log.csv."""
    frame.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path


def test_the_file_says_how_far_to_trust_each_estimate(recording, here):
    result = in_here(*ESTIMATE, cwd=here)
    assert result.returncode == 0, result.stderr
    written = pd.read_csv(here / "est.csv", keep_default_na=False)
    assert list(written.columns)[: len(WITH_EVIDENCE)] == WITH_EVIDENCE
    log = run_of(recording)
    np.testing.assert_allclose(written[BESIDE[:3]], log.std, rtol=1e-9)
    np.testing.assert_array_equal(written["trusted"], log.trusted.astype(int))
    assert len(set(log.reasons.tolist())) > 2
    for words, bits in zip(written["reasons"], log.reasons.tolist(), strict=True):
        assert words == "+".join(word for bit, word in WORDS.items() if bits & bit)


def test_one_line_says_how_much_of_the_log_is_trusted(recording, here):
    """With weights whose bars do not hold all errors."""
    options = ["--horizon", 10, "--rho", 0.8, "--mu", 1e5, "--space", "truncated:3"]
    result = in_here(*ESTIMATE, *options, cwd=here)
    given = {"horizon": 10, "rho": 0.8, "mu": 1e5, "space": ddmhe.Truncated(3)}
    log = run_of(recording, **given)
    share, error = np.mean(log.trusted), log.x - recording.x[T + 1 :]
    line = f"trusted for {100 * share:.0f} % of the log; bars calibrated by replay of the recording"
    assert line in result.stdout.splitlines()
    within = np.abs(error) <= 3 * log.std
    assert 0.1 < np.mean(within) < 1
    assert printed(result, "errors within 3 sd") == pytest.approx(100 * np.mean(within), abs=0.051)
    assert f"of {within.size}" in result.stdout
    inside = 100 * np.mean(within[log.trusted])
    assert printed(result, "... while trusted") == pytest.approx(inside, abs=0.051)
    history = ddmhe.History(recording.x[: T + 1], recording.y[:T], dt=0.1)
    promise = ddmhe.DdMhe(history, start="recording", **given).promise
    assert printed(result, "promised rms wy") == pytest.approx(promise[1], rel=1e-3)


def test_each_doubt_is_told_since_when_on_the_clock_of_the_log(frame, tmp_path):
    """The row of that time is the first that has the reason."""
    frame.assign(t=frame["t"] + 1000.0).to_csv(tmp_path / "log.csv", index=False)
    result = in_here(*ESTIMATE, "--decimate", 2, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    written = pd.read_csv(tmp_path / "est.csv", keep_default_na=False)
    told = re.findall(r"warning: from (\S+) s on \(step (\d+)\) (.*)\n", result.stderr)
    kinds = {"the motion is unlike": "novel", "uncertain": "uncertain", "outside": "outside"}
    seen = {}
    for time, step, words in told:
        assert float(time) == pytest.approx(written["t"][int(step) - 1], abs=1e-3)
        (kind,) = [kind for part, kind in kinds.items() if part in words]
        seen.setdefault(kind, int(step))
    assert "novel" in seen
    assert "outside" in seen
    for kind, step in seen.items():
        has = written["reasons"].str.split("+").map(lambda words, kind=kind: kind in words)
        assert has.idxmax() == step - 1
    assert "counted from 0" not in result.stderr
    assert any("state 'wx'" in words for *_, words in told)


def test_without_truth_no_errors_are_counted(frame, tmp_path):
    frame.assign(**{name: frame[name].where(frame.index <= T) for name in STATE}).to_csv(
        tmp_path / "log.csv", index=False
    )
    result = in_here(*ESTIMATE, cwd=tmp_path)
    assert "within" not in result.stdout
    assert "while trusted" not in result.stdout
    assert "trusted for " in result.stdout


@pytest.mark.parametrize("way", ["option", "file"])
def test_without_evidence_all_is_as_it_was(recording, here, way):
    (here / "est.toml").write_text("evidence = false\n")
    given = ["--no-evidence"] if way == "option" else ["--config", "est.toml"]
    result = in_here(*ESTIMATE, *given, "--plot", "est.svg", cwd=here)
    assert (result.returncode, result.stderr) == (0, "")
    written = pd.read_csv(here / "est.csv")
    truth = [f"{name}_true" for name in STATE]
    assert list(written.columns) == ["t", *STATE, "status", *truth, "filled"]
    np.testing.assert_allclose(written[STATE], run_of(recording, evidence=False).x, rtol=1e-9)
    for words in ("trust", "3 sd", "promised"):
        assert words not in result.stdout
    result = in_here(*ESTIMATE, "--config", "est.toml", "--evidence", cwd=here)
    written = list(pd.read_csv(here / "est.csv").columns)
    assert written[: len(WITH_EVIDENCE)] == WITH_EVIDENCE


@pytest.mark.parametrize("noise", [(0.05,), (0.02, 0.05, 0.1)])
@pytest.mark.parametrize("way", ["option", "file"])
def test_the_noise_of_later_outputs_can_be_stated(recording, here, noise, way):
    given = ["--output-noise", ",".join(map(str, noise))]
    if way == "file":
        value = noise[0] if len(noise) == 1 else list(noise)
        (here / "est.toml").write_text(f"output_noise = {value}\n")
        given = ["--config", "est.toml"]
    assert in_here(*ESTIMATE, *given, cwd=here).returncode == 0
    stated = run_of(recording, output_noise=noise[0] if len(noise) == 1 else noise)
    written = pd.read_csv(here / "est.csv")
    np.testing.assert_allclose(written[BESIDE[:3]], stated.std, rtol=1e-9)
    assert not np.isclose(stated.std, run_of(recording).std).any()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("x", "--output-noise.*expected finite numbers"),
        ("nan", "--output-noise.*expected finite numbers"),
        ("-1", "output_noise: expected"),
        ("0.1,0.2", "output_noise: expected"),
    ],
)
def test_a_wrong_noise_is_one_line(here, value, words):
    result = in_here(*ESTIMATE, f"--output-noise={value}", cwd=here)
    assert result.returncode == 2
    assert re.fullmatch(rf"ddmhe: error: .*{words}[^\n]+\n", result.stderr), result.stderr
    assert not (here / "est.csv").exists()


def test_weights_of_the_recording_have_the_bars_of_its_noise(here):
    (here / "est.toml").write_text('weights = "recorded"\n')
    result = in_here(*ESTIMATE, "--config", "est.toml", cwd=here)
    assert re.search(
        r"trusted for \d+ % of the log; bars from the noise of the recording\n", result.stdout
    )


def test_names_of_states_are_kept_and_others_make_way(frame, tmp_path):
    taken = frame.rename(columns={"wx": "a", "wy": "a_std", "wz": "trusted", "t": "reasons"})
    taken.to_csv(tmp_path / "log.csv", index=False)
    columns = ["--state", "a,a_std,trusted", "--output", "tx,ty,tz"]
    result = in_here(
        "estimate", "log.csv", *columns, "--history", 20, "--out", "est.csv", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert list(pd.read_csv(tmp_path / "est.csv").columns)[:9] == [
        *("reasons", "a", "a_std", "trusted"),
        *("a_std_", "a_std_std", "trusted_std", "trusted_", "reasons_"),
    ]


def test_the_demo_says_since_when_it_is_in_doubt(tmp_path):
    result = in_a_process("demo", "--out", "here", cwd=tmp_path)
    assert result.returncode == 0
    written = pd.read_csv(tmp_path / "here" / "estimate.csv", keep_default_na=False)
    truth = ddmhe.models.detumbling().simulate(620.0, 0.1, integrator="accurate").x[201:]
    error = np.rad2deg(written.iloc[:, 1:4].to_numpy() - truth)
    size = np.linalg.norm(error, axis=1)
    first = written["reasons"].str.contains("novel").idxmax()
    since = written["time_s"][first] - 20.0
    assert 12.0 < since < 20.0
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("defaults: trusted")]
    assert f"From {since:.1f} s on it says itself that the motion is unlike" in line
    told = [float(number) for number in re.findall(r"(\S+) deg/s", line)]
    assert told == pytest.approx([size[:first].max(), size[first:].max()], abs=6e-4)
    assert f"trusted for {100 * written['trusted'].mean():.0f} % of the log" in line
    std = np.rad2deg(written.iloc[:, 4:7].to_numpy())
    within = 100 * np.mean(np.abs(error) <= 3 * std)
    assert printed(result, "errors within 3 sd") == pytest.approx(within, abs=0.051)
    assert (
        f"warning: defaults: from {since:.1f} s on (step {10 * since:.0f}) the motion is unlike"
        in (result.stderr)
    )
    assert "rigid body: trusted for 100 % of the log" in result.stdout
    assert "warning: rigid body" not in result.stderr
    assert "'omega_z'" in result.stderr


# --- figures


def drawn(reasons=None, *, truth=True):
    t = np.arange(10.0, 20.0)
    x = np.column_stack([np.sin(t), np.cos(t)])
    trust = None
    if reasons is not None:
        reasons = np.array(reasons, dtype=np.uint8)
        trust = Trust(np.full((10, 2), 5.0), reasons == 0, reasons, "V")
    return estimate_figure(
        t,
        x,
        x + 0.1 if truth else None,
        history=(np.arange(10.0), np.zeros((10, 2))),
        names=["a", "b"],
        quantity="x (1)",
        trust=trust,
    )


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_bands_are_drawn_and_leave_the_view_as_it_is():
    bare, banded = drawn(), drawn(np.zeros(10))
    above = banded.axes[0]
    assert above.get_ylim() == bare.axes[0].get_ylim()
    bands = [one for one in above.collections if len(one.get_paths()[0].vertices) > 20]
    assert len(bands) == 2
    low, high = (side(bands[0].get_paths()[0].vertices[:, 1]) for side in (np.min, np.max))
    x = np.sin(np.arange(10.0, 20.0))
    assert (low, high) == pytest.approx((x.min() - 15, x.max() + 15))
    assert "± 3 sd" in legend(banded)
    assert "± 3 sd" not in legend(bare)
    assert not any("doubt" in word for word in legend(banded))
    dashed = [line for line in banded.axes[1].get_lines() if line.get_linestyle() == "--"]
    assert [line.get_ydata().tolist() for line in dashed] == [[15.0] * 10] * 2
    assert len(drawn(np.zeros(10), truth=False).axes) == 1


def test_doubt_is_shaded_where_it_is_and_named():
    """In both panels, from half a step before its first estimate to half a step after its last."""
    figure = drawn([0, 1, 1, 0, 0, 3, 8, 4, 0, 1])
    names = [word for word in legend(figure) if "doubt" in word]
    assert names == ["doubt: novel", "doubt: uncertain", "doubt: stuck"]
    expected = {
        ddmhe.Reason.NOVEL: [(10.5, 12.5), (14.5, 15.5), (18.5, 19.0)],
        ddmhe.Reason.UNCERTAIN: [(14.5, 15.5)],
        ddmhe.Reason.STUCK: [(16.5, 17.5)],
    }
    for axes in figure.axes:
        for reason, spans in expected.items():
            color = to_rgba(DOUBTS[reason])
            (shaded,) = [one for one in axes.collections if tuple(one.get_facecolor()[0]) == color]
            found = [(p.vertices[:, 0].min(), p.vertices[:, 0].max()) for p in shaded.get_paths()]
            np.testing.assert_allclose(found, spans)
    assert "doubt: stuck" not in legend(drawn([0, 1, 1, 0, 0, 3, 8, 0, 0, 1]))


def test_a_log_of_one_estimate_has_its_figure(frame, tmp_path):
    frame.iloc[: T + 2].to_csv(tmp_path / "log.csv", index=False)
    result = in_here(*ESTIMATE, "--plot", "est.svg", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len(pd.read_csv(tmp_path / "est.csv")) == 1
    assert "<svg" in (tmp_path / "est.svg").read_text()
    assert "of 3 " in result.stdout  # errors, one a state


def test_words_of_reasons_and_shares():
    assert reason_words(np.array([0, 1, 15, 8, 6], dtype=np.uint8)) == [
        *("", "novel", "novel+uncertain+stuck+outside", "outside", "uncertain+stuck")
    ]
    shares = {0.0: "0 %", 1.0: "100 %", 0.999: "99 %", 0.001: "1 %", 0.874: "87 %"}
    assert {share: share_words(share) for share in shares} == shares


def test_errors_within_bars_are_counted_apart_while_trusted():
    trusted = np.array([True, True, False, False])
    trust = Trust(np.full((4, 1), 1.0), trusted, 1 - trusted.astype(np.uint8), "V")
    error = np.array([[2.9], [np.nan], [3.1], [-3.1]])
    assert trust.within(error) == {
        "errors within 3 sd": "33.3% of 3",
        "... while trusted": "100.0% of 1",
    }
    assert list(trust.rows(~trusted).within(error[2:])) == ["errors within 3 sd"]


def test_a_recording_too_short_to_be_held_out_is_said():
    x = np.cumsum(np.random.default_rng(0).standard_normal((6, 4)), axis=0)
    estimator = ddmhe.DdMhe(ddmhe.History(x, x[:5]))
    assert np.isnan(estimator.promise).all()
    trust = Trust.of_log(estimator.run(x))
    assert "the recording is too short to calibrate bars" in trust.words(estimator.promise)
    assert "calibrated by replay" in trust.words(np.ones(4))


def test_what_a_gate_left_out_is_counted(recording, frame, here):
    """In the table, on stderr since when, and the estimates are those of the gated estimator."""
    spoilt = frame.copy()
    column = COLUMNS[COLUMNS.index("--output") + 1].split(",")[1]
    spoilt.loc[[T + 30, T + 75], column] += 5.0
    spoilt.to_csv(here / "log.csv", index=False)
    result = in_here(*ESTIMATE, "--gate", "auto", cwd=here)
    assert result.returncode == 0, result.stderr
    (row,) = [line for line in result.stdout.splitlines() if f"rejected {column}" in line]
    assert "2" in row.split()
    assert re.search(
        rf"from \S+ s on \(step 31\) output '{column}' was rejected 2 times", result.stderr
    )
    history = ddmhe.History(recording.x[: T + 1], recording.y[:T], dt=0.1)
    y = recording.y[T:-1].copy()
    y[[30, 75], 1] += 5.0
    expected = ddmhe.DdMhe(history, gate="auto").run(y).x
    written = pd.read_csv(here / "est.csv")
    np.testing.assert_allclose(written[list(STATE)], expected, rtol=1e-9, atol=1e-12)
    for wrong, words in (("often", "expected auto or a number"), ("0.5", "above 1")):
        refused = in_here(*ESTIMATE, "--gate", wrong, cwd=here)
        assert refused.returncode == 2
        assert words in refused.stderr
