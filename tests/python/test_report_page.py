"""The page of a report as a file: what it says, what it holds, what it refuses. How it behaves in a
browser: test_report_browser.py."""

import json
import re
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

import ddmhe
from commands import COLUMNS, in_here
from ddmhe.baselines import KoopmanMhe
from ddmhe.baselines.base import Log
from ddmhe.report.web.document import LEAST
from ddmhe.report.web.evidence import autocorrelation
from ddmhe.report.web.numbers import curve_text, plus_minus
from ddmhe.report.web.setup import window_spectrum
from ddmhe.report.web.thinning import Thinning, spans_of

MB = 1e6


class Words(HTMLParser):
    """Texts of a page by the section that they stand in, and what the page would load."""

    def __init__(self, text):
        super().__init__()
        self.sections, self.loads, self._section, self._skip = {}, [], "head", False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self._skip = tag in ("script", "style")
        if tag == "section":
            self._section = named["id"]
        self.loads += [v for k, v in attrs if k in ("src", "data", "action", "poster", "srcset")]
        if tag in ("link", "iframe", "img", "object", "embed"):
            self.loads.append(tag)

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            self._skip = False

    def handle_data(self, data):
        if not self._skip:
            self.sections[self._section] = self.sections.get(self._section, "") + data


def data_of(text):
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', text)[1]
    )


@pytest.fixture(scope="module")
def run(recording):
    history = ddmhe.History(
        recording.x[:201], recording.y[:200], dt=0.1, x_units="rad/s", y_units="N m"
    )
    est = ddmhe.DdMhe(history)
    return est, est.run(recording.y[200:-1]), history


def test_stretches_keep_their_peaks_in_order():
    values = np.sin(np.arange(1000.0))
    values[[137, 138, 700]] = 5.0, -6.0, np.nan
    thin = Thinning.to(1000, 100)
    assert thin.stretch == 20
    kept, t = thin.values(values), thin.times(np.arange(1000.0))
    assert kept.shape == t.shape == (100,)
    assert (np.diff(t) > 0).all()
    pairs = kept.reshape(-1, 2)
    rows = values.reshape(-1, 20)
    assert np.array_equal(pairs.min(axis=1), np.nanmin(rows, axis=1))
    assert np.array_equal(pairs.max(axis=1), np.nanmax(rows, axis=1))
    assert pairs[6].tolist() == [5.0, -6.0]  # as they came
    assert "every 20 samples" in thin.words


@pytest.mark.parametrize("samples", [1, 2, 7, 99, 100, 101, 150, 999])
def test_thinned_curves_have_the_points_of_their_times(samples):
    thin = Thinning.to(samples, 100)
    values = np.where(np.arange(samples) % 3, np.arange(float(samples)), np.nan)
    kept, t = thin.values(values), thin.times(np.arange(float(samples)))
    assert kept.shape == t.shape
    assert len(t) <= max(100, 2)
    assert (np.diff(t) >= 0).all()
    assert thin.stretch > 1 or np.array_equal(kept, values, equal_nan=True)
    assert bool(thin.words) == (samples > 100)


def test_a_stretch_without_numbers_stays_a_gap():
    values = np.arange(400.0)
    values[100:200] = np.nan
    kept = Thinning.to(400, 100).values(values).reshape(-1, 2)
    assert np.isnan(kept[13:24]).all()
    assert np.isfinite(kept[:12]).all()


def test_spans_reach_half_a_step_beyond_their_samples():
    t = np.arange(1.0, 9.0)
    holds = np.array([1, 1, 0, 0, 1, 0, 1, 1], dtype=bool)
    assert spans_of(holds, t, 0.0) == [(0.5, 2.5), (4.5, 5.5), (6.5, 8.0)]
    # two spans at most: the shortest pause is bridged
    assert spans_of(holds, t, 0.0, most=2) == [(0.5, 2.5), (4.5, 8.0)]
    assert spans_of(holds, t, 0.0, most=1) == [(0.5, 8.0)]
    assert spans_of(~np.ones(8, dtype=bool), t, 0.0) == []


def test_autocorrelation_of_a_known_process():
    rng = np.random.default_rng(0)
    values = np.zeros(20000)
    for k in range(1, len(values)):
        values[k] = 0.8 * values[k - 1] + rng.standard_normal()
    expected = 0.8 ** np.arange(1, 6)
    assert autocorrelation(values, 5) == pytest.approx(expected, abs=0.03)
    values[rng.random(len(values)) < 0.2] = np.nan
    assert autocorrelation(values, 5) == pytest.approx(expected, abs=0.03)
    assert np.isnan(autocorrelation(np.full(9, np.nan), 3)).all()
    assert np.isnan(autocorrelation(np.ones(2), 3)).all()


def test_numbers_of_curves_are_within_what_a_screen_shows():
    rng = np.random.default_rng(1)
    for scale, offset in ((1.0, 0.0), (1e-9, 0.0), (1e7, 0.0), (1.0, 1e6), (0.0, 3.0)):
        values = offset + scale * rng.standard_normal(300)
        values[5] = np.nan
        kept = json.loads(curve_text(values))
        assert kept[5] is None
        error = np.abs(np.delete(values, 5) - np.array(kept[:5] + kept[6:], dtype=float))
        assert error.max() <= np.ptp(np.delete(values, 5)) / 1e4
    tiny = np.logspace(-12, 3, 50)
    assert json.loads(curve_text(tiny)) == pytest.approx(tiny, rel=1e-4)


def test_windows_of_a_linear_motion_have_few_directions():
    t = np.arange(300)
    x = np.column_stack([np.cos(0.1 * t), np.sin(0.1 * t)])
    history = ddmhe.History(x, x[:-1, :1], dt=1.0)
    values = window_spectrum(history, 10)
    assert len(values) == 32  # 11 samples of two states, 10 of one output
    assert values[1] > 0.5
    assert values[2] < 1e-10
    assert window_spectrum(ddmhe.History(x[:6], x[:5, :1]), 10) is None


def test_what_a_page_says_of_a_run(run, recording, tmp_path):
    est, log, history = run
    names = {"state": ("a", "b", "c"), "output": ("p", "q", "r")}
    path = tmp_path / "page.html"
    ddmhe.report.html(
        est, log, path, truth=recording.x[201:], t=recording.t[201:], names=names, history=history
    )
    text = path.read_text()
    words = Words(text)
    assert words.loads == []
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)
    assert "@import" not in text
    summary = " ".join(words.sections["summary"].split())
    assert "The states a, b and c were estimated from p, q and r at 400 samples" in summary
    assert "learnt from a recording of 200 samples (20 s)" in summary
    first = recording.t[201:][np.argmax(~log.trusted)]
    assert f"the first doubt comes at {first:.6g} s, where the motion is unlike" in summary
    error = np.sqrt(np.mean((log.x[:, 1] - recording.x[201:, 1]) ** 2))
    assert f"{error:.3g} rad/s for b" in summary
    assert set(words.sections) >= {
        "summary", "estimate", "errors", "doubt", "evidence", "recording", "settings", "steps",
        "warnings", "again",
    }  # fmt: skip
    assert "not the weights of the recording" in words.sections["settings"]
    assert all(sentence in words.sections["warnings"] for sentence in est.warnings)
    assert f"{est.rank} directions" in words.sections["recording"]
    drawn = data_of(text)
    assert drawn["t"] == pytest.approx(recording.t[201:])
    estimated = drawn["charts"][0]["curves"][-1]
    assert estimated["look"] == "estimate"
    assert estimated["v"] == pytest.approx(log.x[:, 0], abs=1e-5)
    assert set(drawn["doubts"]) == {"novel", "uncertain", "outside"}
    for name in drawn["doubts"]:
        held = np.zeros(len(log.x), dtype=bool)
        for a, b in drawn["doubts"][name]:
            held |= (recording.t[201:] >= a) & (recording.t[201:] <= b)
        assert np.array_equal(held, log.reasons & ddmhe.Reason[name.upper()] != 0)


def test_the_same_run_gives_the_same_page(run, tmp_path):
    est, log, history = run
    for name in ("one", "two"):
        ddmhe.report.html(est, log, tmp_path / name, history=history)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_run_of_which_nothing_is_known(run, tmp_path):
    est, log, _ = run
    ddmhe.report.html(est, log, tmp_path / "page.html")
    words = Words((tmp_path / "page.html").read_text())
    assert "errors" not in words.sections
    assert f"{len(log.x)} samples, {log.t[0]:.6g} s to" in words.sections["summary"]
    assert "root-mean-square errors" in words.sections["summary"]


def test_a_baseline_has_a_page_of_its_estimates(run, recording, tmp_path):
    history = run[2]
    est = KoopmanMhe(history)
    log = est.run(recording.y[200:300])
    ddmhe.report.html(est, log, tmp_path / "page.html", truth=recording.x[201:301])
    words = Words((tmp_path / "page.html").read_text())
    assert set(words.sections) >= {"summary", "estimate", "errors", "again"}
    assert "Nothing was computed that says how far" in words.sections["summary"]
    assert "KoopmanMhe" in words.sections["again"]


def test_a_polynomial_model_has_a_page(run, recording, tmp_path):
    """Its evidence is of two kinds: of the lift, and of the affine estimator after it."""
    est = ddmhe.LiftedMhe(run[2])
    log = est.run(recording.y[200:-1])
    assert set(log.evidence.kind) == {"V", "nis"}
    ddmhe.report.html(est, log, tmp_path / "page.html", history=run[2])
    text = (tmp_path / "page.html").read_text()
    words = Words(text).sections
    share = np.mean(log.status == "lifted")
    assert f"degree {est.degree} is used" in words["model"]
    assert f"made {100 * share:.0f} % of the estimates" in words["model"]
    assert "statistic over its limit" in words["evidence"]
    chart = next(c for c in data_of(text)["charts"] if c["log"])
    assert chart["curves"][1]["v"] == pytest.approx(
        log.evidence.value / log.evidence.limit, rel=1e-3
    )


def test_what_is_known_of_a_rigid_body_is_a_section(tmp_path):
    record = ddmhe.models.detumbling().simulate(60.0, 0.1, noise=0.01, seed=1)
    history = ddmhe.History(record.x[:201], record.y[:200], dt=0.1)
    est = ddmhe.RigidBodyMhe(history, x_noise=1e-6)
    page = tmp_path / "page.html"
    log = est.run(record.y[200:-1])
    ddmhe.report.html(est, log, page, truth=record.x[201:], history=history)
    found, words = est.report(), Words(page.read_text()).sections
    assert set(words) >= {"estimate", "errors", "doubt", "evidence", "body", "warnings"}
    assert all(sentence in words["body"] for sentence in found.words)
    assert plus_minus(found.inertia[0, 0], found.inertia_std[0, 0]) in words["body"]
    assert ", ".join(f"{part:.3f}" for part in found.unseen) in words["body"]
    assert words["body"].count("yes") == np.sum(found.chi <= found.limits)
    nothing = SimpleNamespace(report=lambda: None, p=3)
    ddmhe.report.html(nothing, log, page)
    assert "No rigid body was fitted" in Words(page.read_text()).sections["body"]


def test_a_deviation_says_how_many_digits_there_are():
    assert plus_minus(1.13455039, 2.02e-5) == "1.134550 ± 0.000020"
    assert plus_minus(-123.456, 7.0) == "-123.5 ± 7.0"
    assert plus_minus(123456.0, 700.0) == "123456 ± 700"
    assert plus_minus(1.5, 0.0) == "1.5 ± 0"
    assert plus_minus(1.5, np.nan) == "1.5 ± unknown"


def test_a_run_without_evidence(run, recording, tmp_path):
    history = run[2]
    est = ddmhe.DdMhe(history, evidence=False, start="recording", x_bounds=(-0.24, 0.22))
    ddmhe.report.html(est, est.run(recording.y[200:300]), tmp_path / "page.html", history=history)
    words = Words((tmp_path / "page.html").read_text())
    assert "evidence" not in words.sections
    assert "Bounds that were active" in words.sections["steps"]


def test_intervals_have_a_page(tmp_path):
    rng = np.random.default_rng(0)
    A = np.array([[0.95, 0.2], [-0.2, 0.95]])
    x = np.zeros((301, 2))
    x[0, 0] = 1.0
    for k in range(300):
        x[k + 1] = A @ x[k] + 0.01 * rng.uniform(-1, 1, 2)
    y = x[:, :1] + 0.01 * rng.uniform(-1, 1, (301, 1))
    history = ddmhe.History(x[:101], y[:100], dt=0.1, x_units=["m", "m/s"], y_units="m")
    observer = ddmhe.interval.from_history(history, "auto", "auto", kappa=1.1).observer()
    log = observer.run(y[100:300])
    page = tmp_path / "page.html"
    ddmhe.report.html(observer, log, page, truth=x[101:], names=["a", "b"], history=history)
    words = Words(page.read_text())
    assert set(words.sections) >= {"bounds", "verdict", "observer"}
    assert "the bounds hold all 200 true states" in words.sections["summary"]
    assert "narrow enough to be of use: a 0.0" in words.sections["summary"]
    curves = data_of(page.read_text())["charts"][0]["curves"]
    band = next(curve for curve in curves if curve["look"] == "band")
    assert band["v"] == pytest.approx(log.lower[:, 0], abs=1e-4)
    assert band["u"] == pytest.approx(log.upper[:, 0], abs=1e-4)
    ddmhe.report.html(observer, log, page, truth=x[101:] + 1.0)
    assert "yet 200 of 200 true states are outside" in Words(page.read_text()).sections["summary"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"truth": np.zeros((400, 2))}, "truth: expected"),
        ({"t": np.zeros(3)}, "t: expected"),
        ({"t": np.arange(400.0, 0.0, -1.0)}, "t: expected times that do not go back"),
        ({"t": np.full(400, np.nan)}, "t: "),
        ({"names": ["a", "b"]}, "names: expected 3 texts for states"),
        ({"names": "abc"}, "names: expected 3 texts for states"),
        ({"names": {"states": ["a", "b", "c"]}}, "names: expected keys state and output"),
        ({"units": ["m"]}, "units: expected 3 texts"),
        ({"history": 3}, "history: expected a History"),
    ],
)
def test_arguments_that_do_not_fit(run, tmp_path, wrong, words):
    with pytest.raises(ddmhe.DdmheError, match=re.escape(words)):
        ddmhe.report.html(run[0], run[1], tmp_path / "page.html", **wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [np.nan, 1e300, np.inf, 0.0])
def test_estimates_that_are_no_use_have_a_page(run, tmp_path, value):
    x = np.full((30, 3), value)
    x[0] = 0.0
    ddmhe.report.html(run[0], Log(x), tmp_path / "page.html", truth=np.zeros((30, 3)))
    charts = data_of((tmp_path / "page.html").read_text())["charts"]
    assert [len(curve["v"]) for curve in charts[0]["curves"]] == [30, 30]


def test_what_is_no_run_is_refused(run, tmp_path):
    with pytest.raises(ddmhe.DdmheError, match="log: expected what an estimator's run returns"):
        ddmhe.report.html(run[0], 3, tmp_path / "page.html")
    with pytest.raises(ddmhe.DdmheError, match="log: expected one estimate at least"):
        ddmhe.report.html(run[0], Log(np.zeros((0, 3))), tmp_path / "page.html")
    with pytest.raises(ddmhe.DdmheError, match="expected to be able to write"):
        ddmhe.report.html(run[0], run[1], tmp_path)


def test_names_stand_as_text(run, tmp_path):
    est, log, _ = run
    names = ["</script><b>", "<img src=x onerror=alert(1)>", "&amp;\u2028"]
    ddmhe.report.html(est, log, tmp_path / "page.html", names=names, units=["<i>", "]]>", "-->"])
    text = (tmp_path / "page.html").read_text()
    assert text.count("<script") == text.count("</script>") == 3
    assert "<img" not in text
    assert "<b>" not in text
    assert "<i>" not in text
    assert names[1] in Words(text).sections["summary"]


def test_ten_thousand_samples_are_shown_whole_in_three_megabytes(run, tmp_path):
    est, history = run[0], run[2]
    record = ddmhe.models.detumbling().simulate(1020.0, 0.1, noise=0.01, seed=2)
    est.reset()
    log = est.run(record.y[200:10200])
    page = tmp_path / "page.html"
    ddmhe.report.html(est, log, page, truth=record.x[201:], t=record.t[201:], history=history)
    assert page.stat().st_size <= 3 * MB
    assert len(data_of(page.read_text())["t"]) == 10000
    assert "thinned" not in page.read_text().rpartition("<footer>")[2].partition("</footer>")[0]


@pytest.mark.long
def test_a_million_samples_are_thinned_to_six_megabytes(tmp_path):
    record = ddmhe.models.detumbling().simulate(100_022.0, 0.1, noise=0.01, seed=2)
    after = slice(201, 1_000_201)
    history = ddmhe.History(record.x[:201], record.y[:200], dt=0.1)
    est = ddmhe.DdMhe(history)
    log = est.run(record.y[200:1_000_200])
    page = tmp_path / "page.html"
    ddmhe.report.html(est, log, page, truth=record.x[after], t=record.t[after], history=history)
    text = page.read_text()
    assert len(text) <= 6 * MB
    drawn = data_of(text)
    charts = {k: next(c for c in drawn["charts"][k]["curves"] if c["look"] == "estimate")
              for k in range(3)}  # fmt: skip
    for k, curve in charts.items():
        shown = np.array(curve["v"])
        spread = np.ptp(log.x[:, k])
        assert shown.max() == pytest.approx(log.x[:, k].max(), abs=1e-4 * spread)
        assert shown.min() == pytest.approx(log.x[:, k].min(), abs=1e-4 * spread)
    assert sum(map(len, drawn["doubts"].values())) <= 4 * 500


def test_many_states_over_long_logs_are_thinned_and_it_is_said(tmp_path):
    rng = np.random.default_rng(0)
    x = rng.standard_normal((50_000, 30)).cumsum(axis=0)
    x[23_456, 7] = 1e6
    ddmhe.report.html(object(), Log(x), tmp_path / "page.html", truth=x)
    text = (tmp_path / "page.html").read_text()
    assert len(text) <= 6 * MB
    drawn = data_of(text)
    assert LEAST <= len(drawn["t"]) < 5000
    assert max(v for v in drawn["charts"][7]["curves"][-1]["v"] if v is not None) == 1e6
    assert "Curves of 50000 samples are thinned" in Words(text).sections["again"]


def test_the_command_writes_what_estimate_does(log, tmp_path):
    page, beside = tmp_path / "a" / "page.html", tmp_path / "b.html"
    done = in_here("report", log, *COLUMNS, "--history", "20", "--out", page)
    assert done.returncode == 0, done.stderr
    assert f"wrote {page}" in done.stdout
    words = Words(page.read_text()).sections
    assert "Estimates of log.csv" in words["head"]
    assert "wx, wy and wz of log.csv were estimated from tx, ty and tz" in words["summary"]
    again = words["again"]
    assert f"ddmhe report {log} --state wx,wy,wz" in again
    assert re.search(r"SHA-256 of the log\s*[0-9a-f]{64}", again)
    assert "Time of a step" in words["steps"]
    assert "state 'wx'" in words["warnings"]
    out = tmp_path / "est.csv"
    done = in_here(
        "estimate", log, *COLUMNS, "--history", "20", "--report", beside, "--out", out, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert str(beside) in json.loads(done.stdout)["written"]
    a, b = (data_of(path.read_text()) for path in (page, beside))
    assert a == b


def test_the_command_refuses_other_files(log, tmp_path):
    for given in (["report", "--out", "page.pdf"], ["estimate", "--report", "page.txt"]):
        done = in_here(given[0], log, *COLUMNS, "--history", "20", *given[1:], cwd=tmp_path)
        assert done.returncode == 2
        assert f"{given[1]}: expected a file ending in .html" in done.stderr
    done = in_here("report", log, *COLUMNS, "--history", "20")
    assert done.returncode == 2
    assert "--out" in done.stderr
    done = in_here("interval", "pendulum", "--report", tmp_path / "page.html")
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


def test_intervals_of_a_log_have_a_page(tmp_path):
    rng = np.random.default_rng(0)
    x = np.zeros(401)
    x[0] = 1.0
    for k in range(400):
        x[k + 1] = 0.97 * x[k] + 0.05 * np.sin(0.3 * k) + 0.002 * rng.uniform(-1, 1)
    rows = [f"{k / 10:g},{a:.9g},{a + 0.002 * rng.uniform(-1, 1):.9g}" for k, a in enumerate(x)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["t,a,q", *rows]) + "\n")
    page = tmp_path / "page.html"
    done = in_here(
        "interval", log, "--state", "a", "--output", "q", "--history", "10", "--accept-wide",
        "--out", tmp_path / "out", "--report", page,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    words = Words(page.read_text()).sections
    assert "Intervals of log.csv" in words["head"]
    assert "of the recorded range" in words["verdict"]
