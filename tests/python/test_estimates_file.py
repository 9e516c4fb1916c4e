"""Estimates as files: a row for every step with all that is known of it, units and metadata."""

import hashlib
import json
import re
from importlib.metadata import version

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet
from scipy.io import loadmat

import ddmhe
from commands import in_here
from ddmhe.recordings import read
from odd_logs import EPOCH, HISTORY, ROWS, clock, habits

LOST = (180, 181, 200)
HEAD = ["timestamp", "w1 [rad/s]", "w2 [rad/s]", "q1 [rad]"]
STATE, OUTPUT = HEAD[1:3], HEAD[3]
COLUMNS = ["--state", ",".join(STATE), "--output", OUTPUT, "--history", HISTORY]
T = 150


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Times are epoch nanoseconds; three rows are lost after the history."""
    text = clock([str(EPOCH + 20_000_000 * k) for k in range(len(ROWS))], "timestamp")
    lines = [",".join(HEAD), *text.splitlines()[1:]]
    path = tmp_path_factory.mktemp("log") / "log.csv"
    path.write_text("\n".join(line for k, line in enumerate(lines) if k - 1 not in LOST) + "\n")
    return path


@pytest.fixture(scope="module")
def expected(log):
    r = read(log, state=STATE, output=[OUTPUT], history=HISTORY)
    est = ddmhe.DdMhe(r.history, start="recording")
    return r, est, est.run(r.Y)


def table(path):
    """Columns and metadata of a file of estimates, by readers that are not ours."""
    ending = path.suffix
    if ending == ".csv":
        described = json.loads(path.with_name(path.name + "-metadata.json").read_text())
        columns = pd.read_csv(path, keep_default_na=False).to_dict("list")
        return columns, described["schema:additionalProperty"]
    if ending == ".parquet":
        found = parquet.read_table(path)
        return found.to_pydict(), json.loads(found.schema.metadata[b"ddmhe"])
    if ending == ".npz":
        with np.load(path) as found:
            columns = {name: found[name].tolist() for name in found.files if name != "metadata"}
            return columns, json.loads(str(found["metadata"]))
    found = loadmat(path, simplify_cells=True)
    columns = {str(name): found[str(word)] for word, name in found["columns"]}
    words = {k: [str(v) if np.size(v) else "" for v in columns[k]] for k in ("status", "reasons")}
    return {k: np.asarray(v).tolist() for k, v in columns.items()} | words, json.loads(
        found["metadata"]
    )


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".npz", ".mat"])
def test_a_file_has_every_step_and_says_what_it_is_made_of(log, expected, tmp_path, ending):
    out = tmp_path / f"est{ending}"
    result = in_here("estimate", log, *COLUMNS, "--out", out)
    assert result.returncode == 0, result.stderr
    assert f"wrote {out}\n" in result.stdout
    columns, about = table(out)
    r, est, run = expected
    assert columns["timestamp"] == [EPOCH + 20_000_000 * k for k in range(T + 1, len(ROWS))]
    for k, name in enumerate(STATE):
        np.testing.assert_array_equal(columns[name], run.x[:, k])
        np.testing.assert_array_equal(columns[f"{name}_std"], run.std[:, k])
        truth = np.array([np.nan if v == "" else v for v in columns[f"{name}_true"]], float)
        np.testing.assert_array_equal(truth, r.x_true[:, k])
    np.testing.assert_array_equal(columns["trusted"], run.trusted)
    assert columns["status"] == run.status.tolist()
    assert [bool(words) for words in columns["reasons"]] == (run.reasons != 0).tolist()
    seen = np.array([np.nan if v == "" else v for v in columns[f"{OUTPUT}_innovation"]], float)
    np.testing.assert_array_equal(seen, run.evidence.innovation[:, 0])
    filled = np.isin(np.arange(T + 1, len(ROWS)), LOST)
    np.testing.assert_array_equal(columns["filled"], filled)
    assert about["ddmhe"] == version("ddmhe")
    (source,) = about["logs"]
    assert source["sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert about["settings"]["horizon"] == est.horizon
    assert about["settings"]["rho"] == est.rho
    assert about["reading"] == {"history": HISTORY}
    assert about["units"]["timestamp"] == "ns"
    assert about["units"][STATE[0]] == about["units"][f"{STATE[0]}_std"] == "rad/s"
    assert about["units"][f"{OUTPUT}_innovation"] == "rad"
    assert any("ns since 1970" in note for note in about["notes"])


def test_dates_come_back_as_they_were_written(tmp_path):
    data, options = habits()["iso"]
    assert options == {}
    (tmp_path / "log.csv").write_bytes(data)
    columns = ["--state", "w1,w2", "--output", "q1", "--history", HISTORY]
    for ending in (".csv", ".parquet", ".npz", ".mat"):
        out = tmp_path / f"est{ending}"
        result = in_here("estimate", tmp_path / "log.csv", *columns, "--out", out)
        assert result.returncode == 0, result.stderr
        found, about = table(out)
        assert found["time_s"][0] == "2024-05-01T12:00:03.020000+02:00"
        assert "time_s" not in about["units"]


def test_bounds_stand_in_the_file_where_there_are_any(log, tmp_path):
    config = tmp_path / "est.toml"
    r = read(log, state=STATE, output=[OUTPUT], history=HISTORY)
    certificate = ddmhe.design.ioss(r.history, eta=0.99)
    ddmhe.config.write_config(config, {"certificate": certificate})
    given = ["--config", config, "--out", tmp_path / "est.csv"]
    result = in_here("estimate", log, *COLUMNS, *given)
    assert result.returncode == 0, result.stderr
    bound = ddmhe.DdMhe(r.history, certificate=certificate, start="recording").run(r.Y).bound
    if bound is not None:
        np.testing.assert_array_equal(table(tmp_path / "est.csv")[0]["bound"], bound)
    assert "certificate" in table(tmp_path / "est.csv")[1]["named"]


def test_what_was_there_is_replaced_and_told(log, tmp_path):
    out = tmp_path / "est.npz"
    first = in_here("estimate", log, *COLUMNS, "--out", out)
    again = in_here("estimate", log, *COLUMNS, "--out", out)
    assert f"wrote {out}\n" in first.stdout
    assert f"replaced {out}\n" in again.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == ["est.npz"]


def test_what_describes_a_csv_is_replaced_and_told(log, tmp_path):
    out = tmp_path / "est.csv"
    in_here("estimate", log, *COLUMNS, "--out", out)
    again = in_here("estimate", log, *COLUMNS, "--out", out)
    assert f"replaced {out}-metadata.json\n" in again.stdout
    assert "wrote" not in again.stdout


def test_without_out_it_is_said_that_nothing_was_written(log, tmp_path):
    result = in_here("estimate", log, *COLUMNS, cwd=tmp_path)
    assert "nothing was written; --out estimate.csv writes the estimates\n" in result.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("est.xlsx", "expected a file ending in .csv, .parquet, .npz, .mat, found '.xlsx'"),
        ("est.parquet.gz", "found '.gz'"),
        ("run.2024", "found '.2024'"),
        ("file/est.csv", "Not a directory"),
    ],
)
def test_a_wrong_target_is_told_before_the_work(log, tmp_path, out, words):
    (tmp_path / "file").touch()
    result = in_here("estimate", log, *COLUMNS, "--out", out, cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert re.fullmatch(rf"ddmhe: error: {re.escape(out)}: .*{words}[^\n]*\n", result.stderr)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_an_existing_folder_is_filled_whatever_its_name(log, tmp_path):
    (tmp_path / "run.2024").mkdir()
    result = in_here("estimate", log, *COLUMNS, "--out", "run.2024", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert sorted(p.name for p in (tmp_path / "run.2024").iterdir()) == [
        *("estimate.csv", "estimate.csv-metadata.json", "estimate.png")
    ]


def test_a_recording_in_another_file(log, tmp_path):
    """The whole log is estimated, from anywhere; both files are named with their hashes."""
    result = in_here(
        "estimate", log, *COLUMNS[:4], "--recording", f"{log}:0..3", "--out", tmp_path / "e.npz"
    )
    assert result.returncode == 0, result.stderr
    columns, about = table(tmp_path / "e.npz")
    assert len(columns["status"]) == len(ROWS) - 1
    assert len(about["logs"]) == 2
    assert about["settings"]["start"] == "unknown"
    assert "recorded: " in result.stdout
    none = in_here("estimate", log, *COLUMNS[:4])
    assert (none.returncode, "'--history' (or '--recording')" in none.stderr) == (2, True)
