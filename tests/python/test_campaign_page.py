"""What a campaign is told as: its page, its comparison with another, a case again."""

import json
import shutil

import numpy as np
import pytest

from commands import in_here
from ddmhe import campaign
from ddmhe.campaign.store import Store
from ddmhe.campaign.work import Done, run_part

SPEC = {
    "name": "of <tests>",
    "seeds": 12,
    "batch": 4,
    "systems": {"bench": {"duration": 0.5}},
    "noise": {"low": {"x": 1e-3, "y": 1e-3}},
    "estimators": {"DdMhe": {}, "ArxKalman": {}, "RigidBodyMhe": {"settings": {"x_noise": [1, 2]}}},
    "keep": {"spans": [0.2]},
}


def kept(folder, spec, change=lambda row: row):
    """A campaign, run in this process; `change` alters its rows."""
    read = campaign.read_spec(spec)
    store = Store.create(folder, read)
    for part in read.parts:
        done = run_part(read, part)
        store.add(Done(part, [change(dict(row)) for row in done.rows], done.times, done.traces))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return kept(tmp_path_factory.mktemp("campaign") / "here", SPEC)


def test_the_page_has_what_it_promises(folder, tmp_path):
    path = tmp_path / "page.html"
    result = in_here("campaign", "report", folder, "--out", path)
    assert result.returncode == 0, result.stderr
    text = path.read_text()
    assert "Campaign of &lt;tests&gt;" in text
    assert "36 of 36 cases are finished" in text
    rows = campaign.open(folder).rows
    worst = rows[rows["estimator"] == "DdMhe"].nlargest(1, "rmse_all").iloc[0]
    assert f"campaign replay {folder} {worst['case']}" in text
    assert f"{worst['rmse_all']:.3g}" in text
    for words in ("Distributions of errors", "Errors over time", "NEES", "ShapeError", "sha256"):
        assert words in text
    assert "http://" not in text.split("<script")[0]


def test_a_case_again_is_its_row(folder, tmp_path):
    result = in_here("campaign", "replay", folder, 3, "--report", tmp_path / "case.html")
    assert "the same as its row, bit for bit" in result.stdout, result.stdout + result.stderr
    assert "Errors against the truth" in (tmp_path / "case.html").read_text()
    failed = in_here("campaign", "replay", folder, 2)
    assert "x_noise: expected" in failed.stdout
    assert "bit for bit" in failed.stdout
    assert in_here("campaign", "replay", folder, 36).returncode == 2
    other = kept(tmp_path / "other", SPEC, lambda row: row | {"rmse_all": 1.0})
    told = in_here("campaign", "replay", other, 0)
    assert "another rmse_all" in told.stderr


@pytest.mark.parametrize(
    ("change", "reasons"),
    [
        (lambda row: row, []),
        (lambda row: row | {"rmse_all": 0.9 * row.get("rmse_all", np.nan)}, []),
        (lambda row: row | {"rmse_all": 1.1 * row.get("rmse_all", np.nan)}, ["1.1 times as large"]),
        (lambda row: row | {"within_3sd": 0.5}, ["within 3 sd"]),
        (lambda row: row | ({"outcome": "Lost"} if row["seed"] == 5 else {}), ["1 cases fail"]),
    ],
)
def test_a_gate_closes_for_what_is_worse(folder, tmp_path, change, reasons):
    own = kept(
        tmp_path / "here", SPEC, lambda row: change(row) if row["estimator"] == "DdMhe" else row
    )
    result = in_here("campaign", "report", own, "--against", folder, "--json")
    answer = json.loads(result.stdout)
    assert result.returncode == (1 if reasons else 0), result.stderr
    assert [one["estimator"] for one in answer["worse"]] == ["DdMhe"] * bool(reasons)
    for words in reasons:
        assert any(words in reason for reason in answer["worse"][0]["reasons"])
    assert "Against the other campaign" in (own / "report.html").read_text()


def test_campaigns_without_a_common_case_are_refused(folder, tmp_path):
    other = kept(tmp_path / "other", SPEC | {"seeds": [77]})
    result = in_here("campaign", "report", folder, "--against", other)
    assert result.returncode == 2
    assert "the same cases" in result.stderr


def test_a_part_that_is_not_finished_is_not_told_of(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "cut")
    manifest = tmp_path / "cut" / "manifest.jsonl"
    lines = manifest.read_text().splitlines(keepends=True)
    manifest.write_text("".join(lines[:-1]) + lines[-1][:9])
    cut = campaign.open(tmp_path / "cut")
    assert len(cut.rows) == 24
    assert not cut.complete
    cut.report(tmp_path / "cut.html")
    assert "24 of 36 cases are finished" in (tmp_path / "cut.html").read_text()


def test_a_folder_changed_by_hand_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "forged")
    path = tmp_path / "forged" / "spec.json"
    path.write_text(path.read_text().replace('"seeds": 12', '"seeds": 11'))
    with pytest.raises(campaign.CampaignError, match="changed by hand"):
        campaign.open(tmp_path / "forged")
