"""Specs of campaigns, their cases and data: which cases there are, and that each is a function of
the spec and its number."""

import copy
import json
import subprocess
import sys

import numpy as np
import pytest

import ddmhe
from commands import OUTPUT, STATE
from ddmhe.campaign import CampaignError, read_spec
from ddmhe.campaign.data import data_of
from ddmhe.campaign.dry import forecast
from ddmhe.campaign.faults import FAULT, faulty
from ddmhe.campaign.measures import measured
from ddmhe.campaign.trial import check_settings_of
from ddmhe.campaign.work import run_case, run_part

SPEC = {
    "seeds": 3,
    "batch": 2,
    "systems": {"bench": {"duration": 0.5}, "pendulum": {"duration": 1.3}},
    "noise": {"low": {"x": 1e-4, "y": 1e-3}, "high": {"x": 1e-3, "y": 1e-2}},
    "faults": {"none": {}, "gaps": {"missing": 0.2}},
    "estimators": {"DdMhe": {}, "filter": {"kind": "ErrorStateKalman"}},
    "keep": {"spans": [0.2]},
}


def changed(**tables):
    found = copy.deepcopy(SPEC)
    for name, value in tables.items():
        found[name] = value
    return found


def test_cases_are_the_product_in_the_order_of_the_spec():
    spec = read_spec(SPEC)
    assert spec.cases == 2 * 2 * 2 * 3 * 2
    every = [spec.case(i) for i in range(spec.cases)]
    assert len({(case.scenario, case.estimator) for case in every}) == spec.cases
    assert [case.estimator for case in every[:4]] == ["DdMhe", "filter"] * 2
    assert [case.scenario.seed for case in every[:8:2]] == [0, 1, 2, 0]
    assert [case.scenario.fault for case in every[:12:6]] == ["none", "gaps"]
    assert every[-1].scenario.system == "pendulum"
    covered = [k for part in spec.parts for k in range(part.first, part.stop)]
    assert covered == list(range(spec.scenarios))
    assert all(spec.scenario(part.stop - 1).system == part.system for part in spec.parts)


def test_equal_numbers_and_defaults_have_one_hash():
    one = read_spec(SPEC)
    same = changed(
        systems={"bench": {"duration": 0.5, "dt": 0.01}, "pendulum": {"duration": 1.3}},
        seeds=[0, 1, 2], keep={"spans": [0.2], "bins": 24.0},
    )  # fmt: skip
    assert read_spec(same).hash == one.hash
    assert read_spec(one.plain).hash == one.hash
    whole = [read_spec(changed(noise={"n": {"y": y}})).hash for y in (1, 1.0)]
    assert whole[0] == whole[1]
    assert read_spec(changed(seeds=4)).hash != one.hash
    swapped = dict(reversed(SPEC["systems"].items()))
    assert read_spec(changed(systems=swapped)).hash != one.hash  # the cases' numbers are others


def test_a_difference_is_told():
    other = read_spec(changed(seeds=4, noise={"low": {"x": 1e-4, "y": 2e-3}}))
    words = list(read_spec(SPEC).differences(other))
    assert "seeds was 3, is 4" in words
    assert any(w.startswith("noise.low.y was 0.001, is 0.002") for w in words)


WRONG = [
    (changed(sistems={}), ["'sistems'", "did you mean 'systems'"]),
    ({"systems": {"bench": {}}}, ["estimators: expected a value"]),
    (changed(systems={"a": {"kind": "satelite"}}), ["systems.a.kind", "'satellite'"]),
    (changed(systems={"bench": {"durations": 1}}), ["systems.bench", "mean 'duration'"]),
    (changed(systems={"bench": {"duration": 0.505}}), ["systems.bench.duration", "multiple of dt"]),
    (changed(systems={"bench": {"speed": [3, 2]}}), ["systems.bench.speed", "[least, most]"]),
    (changed(noise={"n": {"x": -1}}), ["noise.n.x", "at least 0"]),
    (changed(faults={"f": {"missing": 2}}), ["faults.f.missing", "from 0 to 1"]),
    (changed(estimators={"a": {"kind": "DDMhe"}}), ["estimators.a.kind", "'DdMhe'"]),
    (changed(estimators={"DdMhe": {"settings": {"horizn": 3}}}), ["settings", "mean 'horizon'"]),
    (changed(estimators={"DdMhe": {"settings": {"rho": "x"}}}), ["estimators.DdMhe", "rho"]),
    (changed(estimators={"ArxKalman": {"settings": {"lag": 3}}}), ["ArxKalman.settings", "'lag'"]),
    (changed(estimators={"a b": {"kind": "DdMhe"}}), ["estimators", "letters"]),
    (changed(keep={"traces": [48]}), ["keep.traces", "below 48"]),
    (changed(keep={"spans": [1.4]}), ["keep.spans", "at most 1.3 s"]),
    (changed(systems={"satellite": {"inertia": [0, 9]}}), ["systems.satellite.inertia", "above 0"]),
    (changed(systems={"bench": {"eddy": [-1, 1]}}), ["systems.bench.eddy", "at least 0"]),
    (changed(faults={"f": {"bias_from": -1}}), ["faults.f.bias_from", "at least 0"]),
    (changed(seeds=0), ["seeds", "at least 1"]),
    (changed(seeds=[1, 1]), ["seeds", "differ"]),
    (changed(systems={"log": {"files": "/nowhere/*.csv", "state": ["x"], "output": ["y"],
                              "history": 1}}), ["systems.log.files", "found none"]),
]  # fmt: skip


@pytest.mark.parametrize(("spec", "words"), WRONG, ids=range(len(WRONG)))
def test_wrong_specs_are_one_sentence(spec, words):
    with pytest.raises(ddmhe.DdmheError) as raised:
        read_spec(spec)
    assert all(word in str(raised.value) for word in words), str(raised.value)


def test_estimators_and_levels_share_a_motion():
    spec = read_spec(SPEC)
    scenarios = {(s.noise, s.fault): s for k in range(12) if (s := spec.scenario(k)).seed == 1}
    none, gaps = (data_of(spec, scenarios["low", fault]) for fault in ("none", "gaps"))
    high = data_of(spec, scenarios["high", "none"])
    np.testing.assert_array_equal(none.x, high.x)
    seen = np.isfinite(gaps.Y)
    assert not seen.all()
    np.testing.assert_array_equal(none.Y[seen], gaps.Y[seen])
    again = data_of(read_spec(changed(estimators={"DdMhe": {}})), scenarios["low", "none"])
    np.testing.assert_array_equal(none.Y, again.Y)
    other = data_of(spec, spec.scenario(0))
    assert np.abs(other.x - none.x).max() > 0.1


def test_a_case_alone_is_what_it_is_among_others():
    spec = read_spec(SPEC)
    rows = {row["case"]: row for part in spec.parts[:3] for row in run_part(spec, part).rows}
    for number in (5, 2, 9):
        assert json.dumps(run_case(spec, number)[0]) == json.dumps(rows[number])


def test_a_failing_case_is_a_row():
    spec = read_spec(
        changed(estimators={"DdMhe": {}, "RigidBodyMhe": {"settings": {"x_noise": [1, 2]}}})
    )
    done = run_part(spec, spec.parts[0])
    assert [row["outcome"] for row in done.rows] == ["done", "ShapeError"] * 2
    assert "x_noise: expected" in done.rows[1]["error"]
    assert done.failed == 2


@pytest.mark.parametrize("kind", ["satellite", "bench", "pendulum"])
def test_seeds_are_dispersed_within_their_limits(kind):
    spec = read_spec(changed(systems={kind: {"recorded": 1.3, "duration": 1.3}}, noise={"n": {}}))
    starts = [data_of(spec, spec.scenario(k)).history.recordings[0][0][0] for k in range(3)]
    assert len(np.unique(np.array(starts)[:, 0])) == 3
    if kind == "satellite":
        rates = np.rad2deg(np.linalg.norm(starts, axis=1))
        assert ((rates >= 2) & (rates <= 20)).all()
        still = read_spec(changed(systems={kind: {"duration": 1, "dispersed": False}}))
        begins = data_of(still, still.scenario(1)).x[0]
        model = ddmhe.models.detumbling()
        np.testing.assert_array_equal(begins, model.simulate(21, 0.1).x[201])


def test_faults_do_what_they_say():
    draw = np.random.default_rng(5)
    recorded, Y = draw.standard_normal((50, 2)), draw.standard_normal((4000, 2))
    deviation = recorded.std(axis=0)

    def of(**fault):
        table = {name: key.default for name, key in FAULT.items()} | fault
        return faulty(Y, recorded, 0.1, table, np.random.default_rng(1))

    np.testing.assert_array_equal(of(), Y)
    np.testing.assert_array_equal(of(delay=3)[3:], Y[:-3])
    np.testing.assert_array_equal(of(delay=3)[:3], recorded[-3:])
    off = of(bias=2.0, bias_from=100.0) - Y
    assert (off[:1000] == 0).all()
    np.testing.assert_allclose(off[1000:], np.tile(2 * deviation, (3000, 1)), atol=1e-12)
    hit = (of(spikes=0.1, spike_size=5.0) - Y) / deviation
    assert 0.08 < np.mean((hit != 0).any(axis=1)) < 0.12
    np.testing.assert_allclose(np.abs(hit[hit != 0]), 5.0, rtol=1e-9)
    assert 0.25 < np.isnan(of(missing=0.3)).all(axis=1).mean() < 0.35


class _Data:
    t = 0.1 * np.arange(1.0, 401)


class _Log:
    pass


def test_measures_are_those_of_numpy():
    draw = np.random.default_rng(3)
    P = np.array([[4.0, 1.0], [1.0, 1.0]])
    data, log = _Data(), _Log()
    data.x = draw.standard_normal((400, 2))
    off = draw.multivariate_normal([0, 0], P, 400)
    off[[5, 200]] = [6.5, 1.0]  # beyond three deviations, the first within what is trusted
    log.x, log.covariance = data.x + off, np.tile(P, (400, 1, 1))
    log.std, log.status = np.tile([2.0, 1.0], (400, 1)), ["optimal"] * 399 + ["failed"]
    log.trusted = np.arange(400) < 100
    row = measured(log, data, ("a", "b"), {"10s": 10.0, "all": np.inf}, 8)
    assert row["rmse_a_10s"] == pytest.approx(np.sqrt(np.mean(off[:100, 0] ** 2)))
    assert row["rmse_all"] == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    nees = np.einsum("ti,ij,tj->t", off, np.linalg.inv(P), off) / 2
    assert row["nees_all"] == pytest.approx(nees.mean())
    np.testing.assert_allclose(row["nees_over_time"], nees.reshape(8, 50).mean(axis=1))
    assert row["within_2sd"] == np.mean(np.abs(off) <= [4.0, 2.0])
    assert row["trusted"] == 0.25
    wrong = (np.abs(off[:100]) > [6.0, 3.0]).any(axis=1)
    assert row["unnoticed"] == wrong.sum() / 400 > 0
    assert json.loads(row["status"]) == {"failed": 1, "optimal": 399}
    assert np.isnan(measured(log, data, ("a", "b"), {"41s": 41.0}, 8)["rmse_41s"])
    assert measured(log, data, ("a", "b"), {"40s": 40.0}, 8)["rmse_40s"] == row["rmse_all"]
    log.x[7, 0] = np.nan
    assert measured(log, data, ("a", "b"), {"all": np.inf}, 8)["rmse_all"] == np.inf


def test_logs_are_found_here_and_through_fsspec(frame, tmp_path):
    for k in range(2):
        frame.to_csv(tmp_path / f"log{k}.csv", index=False)
    table = {"kind": "log", "state": STATE, "output": OUTPUT, "history": 20}
    specs = [
        read_spec(changed(systems={"log": table | {"files": f"{where}{tmp_path}/*.csv"}}, seeds=1,
                          noise={"none": {}}, faults={"none": {}}))
        for where in ("", "file://")
    ]  # fmt: skip
    rows = [[row for part in spec.parts for row in run_part(spec, part).rows] for spec in specs]
    assert [len(every) for every in rows] == [4, 4]
    assert all(row["outcome"] == "done" for every in rows for row in every), rows
    assert rows[0][0]["rmse_all"] == rows[1][0]["rmse_all"] < 0.1
    assert rows[0][0]["source"].endswith("log0.csv")
    assert len(rows[0][0]["source_sha256"]) == 64
    assert read_spec(specs[0].plain).hash == specs[0].hash
    with pytest.raises(CampaignError, match=r"beside systems\.log"):
        read_spec(changed(systems={"log": table | {"files": f"{tmp_path}/*.csv"}}))


def test_what_is_lacking_is_named_with_the_extra(tmp_path):
    code = (
        "import sys; sys.modules['distributed'] = None\n"
        "import ddmhe\n"
        "ddmhe.campaign.run({'systems': {'bench': {}}, 'estimators': {'DdMhe': {}}}, sys.argv[1])"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "never")]
    found = subprocess.run(command, capture_output=True, text=True)
    assert "pip install 'ddmhe[campaign]'" in found.stderr.splitlines()[-1]
    assert not (tmp_path / "never").exists()


OUT_OF_RANGE = [
    (
        {"DdMhe": {"settings": {"rho": 3}}},
        {},
        "estimators.DdMhe.settings.rho: expected a number in (0, 1), found 3",
    ),
    (
        {"a": {"kind": "DdMhe", "settings": {"horizon": 900}}},
        {},
        "estimators.a.settings.horizon: expected 1 to ",
    ),
    (
        {"tuned": {"settings": {"mu": -1}}},
        {},
        "estimators.tuned.settings.mu: expected a positive finite number, found -1",
    ),
    (
        {"RigidBodyMhe": {"settings": {"x_noise": -1}}},
        {},
        "RigidBodyMhe.settings.x_noise: expected standard dev",
    ),
    (
        {"KoopmanMhe": {"settings": {"rho": 3}}},
        {},
        "KoopmanMhe.settings.rho, mu: expected rho in (0, 1)",
    ),
    (
        {"intervals": {"settings": {"kappa": 0.5}}},
        {},
        "intervals.settings.kappa: expected a number of at least 1",
    ),
    (
        {"DdMhe": {}},
        {"noise": {"n": {}, "two": {"x": [1, 2]}}},
        "noise.two.x: expected a number or 1 of them, found 2",
    ),
    (
        {"DdMhe": {}},
        {"faults": {"f": {"delay": 900}}},
        "faults.f.delay: expected at most the 50 samples recorded, found 900",
    ),
]


@pytest.mark.parametrize(
    ("estimators", "more", "words"), OUT_OF_RANGE, ids=range(len(OUT_OF_RANGE))
)
def test_what_no_case_can_take_is_refused_before_the_run(estimators, more, words, tmp_path):
    spec = SPEC | {"systems": {"bench": {}}, "estimators": {"good": {"kind": "DdMhe"}} | estimators}
    with pytest.raises(CampaignError) as raised:
        ddmhe.campaign.run(spec | more, tmp_path / "never", workers=1)
    assert words in str(raised.value)
    assert str(raised.value).endswith(" (systems.bench)")
    assert not (tmp_path / "never").exists()
    with pytest.raises(CampaignError):
        forecast(read_spec(spec | more))


def test_what_fails_on_some_recordings_or_for_another_reason_is_a_failing_case(frame, tmp_path):
    table = {"files": f"{tmp_path}/*.csv", "state": STATE, "output": OUTPUT, "history": 5}
    coarse, fine = frame[::3], frame
    estimators = {
        "DdMhe": {"settings": {"horizon": 20}},
        "intervals": {"settings": {"kappa": 1.2}},
    }
    for logs in ((coarse, fine), (coarse, coarse)):
        for name, rows in zip("ab", logs, strict=True):
            rows.to_csv(tmp_path / f"{name}.csv", index=False)
        spec = read_spec({"systems": {"log": table}, "estimators": estimators})
        if logs[1] is fine:
            check_settings_of(spec)
        else:
            with pytest.raises(CampaignError, match=r"DdMhe\.settings\.horizon: expected 1 to"):
                check_settings_of(spec)
    other = {"RigidBodyMhe": {"settings": {"x_noise": 1e-3}}}  # one rate is not three
    check_settings_of(read_spec(SPEC | {"systems": {"bench": {}}, "estimators": other}))


def test_errors_over_time_are_means_of_what_is_known():
    log, data = _Log(), _Data()
    data.x = np.zeros((5, 1))
    data.t = 0.1 * np.arange(1.0, 6)
    log.x = np.array([[1.0], [7.0], [3.0], [4.0], [np.inf]])
    data.x[3] = np.nan
    row = measured(log, data, ("a",), {"all": np.inf}, 3)
    assert row["error_over_time"] == pytest.approx([5.0, 3.0, np.inf])  # 2, 1 and 2 samples
    every = measured(log, data, ("a",), {"all": np.inf}, 10)["error_over_time"]
    assert np.isnan(every).sum() == 6
    assert np.array(every)[~np.isnan(every)].tolist() == [1.0, 7.0, 3.0, np.inf]
