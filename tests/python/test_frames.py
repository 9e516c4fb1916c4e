"""Logs and estimates as rows and frames, recordings as files."""

import numpy as np
import pandas as pd
import pytest

import ddmhe
from reference import random_system

RNG = np.random.default_rng(11)
SYSTEM = random_system(RNG, 2, 1)
X, Y = SYSTEM.simulate(RNG.standard_normal(2), 80)
X = X + 1e-3 * RNG.standard_normal(X.shape)
H = ddmhe.History(X[:61], Y[:60], dt=0.25, x_units="m", y_units=["V"])


def run(settings=None, steps=12):
    est = ddmhe.DdMhe(H, start="state", **settings or {})
    return est, est.run(Y[60 : 60 + steps])


def test_times_count_from_the_start_of_the_run():
    est, log = run()
    np.testing.assert_array_equal(log.t, 0.25 * np.arange(1, 13))
    np.testing.assert_array_equal(est.run(Y[72:74]).t, [0.25 * 13, 0.25 * 14])
    e = est.step(Y[74])
    assert e.t[-1] == 0.25 * 15
    np.testing.assert_allclose(np.diff(e.t), 0.25, rtol=1e-12)
    assert len(e) == len(e.window) == len(e.t)
    np.testing.assert_array_equal(np.array(list(e)), e.window)
    est.reset()
    assert est.run(Y[60:61]).t[0] == 0.25
    (many,) = ddmhe.run_many([H], [Y[60:64]])
    assert many.t[-1] == 1.0


def test_a_log_is_a_sequence_of_rows():
    _, log = run()
    assert len(log) == 12
    rows = list(log)
    assert [row.t for row in rows] == log.t.tolist()
    np.testing.assert_array_equal(np.array([row.x for row in rows]), log.x)
    np.testing.assert_array_equal(log[-1].std, log.std[-1])
    assert log[3].reasons == ddmhe.Reason(int(log.reasons[3]))
    part = log[4:9]
    np.testing.assert_array_equal(part.t, log.t[4:9])
    np.testing.assert_array_equal(part.covariance, log.covariance[4:9])
    assert len(log[9:4]) == 0
    with pytest.raises(IndexError, match="12"):
        log[12]
    for wrong in (slice(None, None, 2), "x"):
        with pytest.raises(ddmhe.DdmheError, match=r"^key: expected"):
            log[wrong]


def test_equal_is_what_has_the_same_numbers():
    _, log = run()
    assert log == run()[1]
    assert log != run(steps=11)[1]
    assert log != run({"rho": 0.9})[1]
    assert log != "log"
    assert run({"evidence": False})[1] == run({"evidence": False})[1]
    one, other = (ddmhe.DdMhe(H).step(Y[60]) for _ in range(2))
    assert one == other
    assert one != ddmhe.DdMhe(H).step(Y[61])
    again = ddmhe.History(X[:61], Y[:60], dt=0.25, x_units="m", y_units=["V"])
    assert (again == H, hash(again) == hash(H)) == (True, True)
    assert ddmhe.History(X[:61], Y[:60], dt=0.25) != H  # other units


def test_a_log_says_what_it_is():
    _, log = run()
    assert repr(log).startswith("Log(N=12, n=2, t=0.25..3 s, 12 optimal, ")
    assert repr(log[:0]) == "Log(N=0, n=2, no steps)"


def test_frames_of_pandas():
    _, log = run()
    frame = log.to_pandas(["a", "b"])
    assert list(frame) == ["a", "b", "a_std", "b_std", "trusted", "reasons", "status", "cost"]
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame[["a", "b"]].to_numpy(), log.x)
    assert list(run({"evidence": False})[1].to_pandas()) == ["x0", "x1", "status", "cost"]
    e = ddmhe.DdMhe(H).step(Y[60])
    window = e.to_pandas()
    assert isinstance(window, pd.DataFrame)
    np.testing.assert_array_equal(window.to_numpy(), e.window)
    for names in ("ab", ["a"], [1, 2]):
        with pytest.raises(ddmhe.DdmheError, match=r"^names: expected 2 texts"):
            log.to_pandas(names)


def test_frames_of_polars():
    pytest.importorskip("polars")
    _, log = run()
    frame = log.to_polars(["a", "b"])
    assert frame.columns[:3] == ["t", "a", "b"]
    np.testing.assert_array_equal(frame["b"].to_numpy(), log.x[:, 1])
    assert ddmhe.DdMhe(H).step(Y[60]).to_polars().columns == ["t", "x0", "x1"]


def test_datasets_of_xarray():
    pytest.importorskip("xarray")
    _, log = run()
    data = log.to_xarray(["a", "b"])
    np.testing.assert_array_equal(data["x"].sel(state="b").values, log.x[:, 1])
    np.testing.assert_array_equal(data["covariance"].values, log.covariance)
    assert data["t"].attrs["units"] == "s"
    assert "bound" not in data
    assert run({"evidence": False})[1].to_xarray()["x"].shape == (12, 2)
    assert ddmhe.DdMhe(H).step(Y[60]).to_xarray()["x"].dims == ("t", "state")


def test_a_library_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(ddmhe.DdmheError, match=r"pip install polars"):
        run()[1].to_polars()


def test_a_recording_goes_into_a_file_and_back(tmp_path):
    driven = ddmhe.History(X[:31], Y[:30], 0.1, RNG.standard_normal((30, 2)), u_units=["V", "N"])
    several = ddmhe.History.concat([H, ddmhe.History(X[5:31], Y[5:30], 0.25, x_units="m",
                                                     y_units="V")])  # fmt: skip
    for k, history in enumerate((H, driven, several)):
        path = tmp_path / f"{k}.npz"
        history.save(path)
        assert ddmhe.History.load(path) == history
    with np.load(tmp_path / "2.npz") as stored:
        assert stored["samples"].tolist() == [60, 25]
        np.testing.assert_array_equal(stored["x"][:61], X[:61])
    np.savez(tmp_path / "bare.npz", x=X[:31], y=Y[:30])
    assert ddmhe.History.load(tmp_path / "bare.npz") == ddmhe.History(X[:31], Y[:30])


@pytest.mark.parametrize("content", [b"", b"words", "zip"])
def test_a_file_that_is_no_recording(tmp_path, content):
    path = tmp_path / "other.npz"
    if content == "zip":
        np.savez(path, z=np.zeros(3))
    else:
        path.write_bytes(content)
    with pytest.raises(ddmhe.DdmheError, match=r"other\.npz: expected a recording"):
        ddmhe.History.load(path)
    with pytest.raises(ddmhe.DdmheError, match=r"none\.npz.*No such file"):
        ddmhe.History.load(tmp_path / "none.npz")
    with pytest.raises(ddmhe.DdmheError, match=r"^path: expected a file ending in \.npz"):
        H.save(tmp_path / "h.mat")


@pytest.mark.parametrize(
    ("text", "space"),
    [
        ("exact", ddmhe.Exact()),
        ("truncated:3", ddmhe.Truncated(3)),
        ("ridge:0.01", ddmhe.Ridge(0.01)),
    ],
)
def test_a_space_has_one_spelling(text, space):
    np.testing.assert_array_equal(run({"space": text})[1].x, run({"space": space})[1].x)
    for wrong in ("exactly", "truncated:", "truncated:x", "ridge:", "ridge"):
        with pytest.raises(ddmhe.DdmheError, match=r"^space: expected .*ridge:WEIGHT"):
            ddmhe.DdMhe(H, space=wrong)
