"""Code in the README and the docs does what it says."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import odd_logs

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *(p for p in ROOT.glob("docs/**/*.md") if "_build" not in p.parts)]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_example_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 6
    exec(compile("\n".join(blocks), "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "optimal (21, 3)" in printed  # M + 1 states: the window begins in the recording
    assert "['optimal']" in printed
    assert float(re.search(r"within 3 standard deviations: (\S+)", printed)[1]) > 0.99
    since = re.search(r"trusted for (\S+) s, then novel: True", printed)[1]
    assert since in README.split("### How far to trust it")[1].split("###")[0]
    before, after = re.search(r"error before: (\S+), after: (\S+) rad/s", printed).groups()
    assert f"{before} before, {after} after" in README
    assert "Guaranteed for every system" in printed
    assert float(re.search(r"largest error (\S+)", printed)[1]) < 1e-6  # of speeds of size 1


def test_a_log_is_read_as_the_docs_have_it(capsys, tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_bytes(odd_logs.habits()["milliseconds"][0])
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "logs.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(compile(f"import ddmhe\n{block.replace('6.0', '3.0')}", "logs.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "Names(time='time_ms', state=('w1', 'w2'), output=('q1',), input=())" in printed
    assert "time column 'time_ms' in ms" in printed


def test_a_polynomial_is_used_as_the_docs_have_it():
    text = (ROOT / "docs" / "lifted.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(compile(block, "lifted.md", "exec"), names)
    assert names["estimator"].chosen
    assert names["estimate"].status == "lifted"
    assert names["affine"].status == "optimal"


def test_a_rigid_body_is_found_as_the_docs_have_it():
    text = (ROOT / "docs" / "rigid-body.md").read_text(encoding="utf-8")
    one, several = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(compile(one, "rigid-body.md", "exec"), names)
    assert names["estimator"].explained
    assert set(names["log"].status) <= {"structured", "adapting"}
    assert "a rigid body explains" in names["words"][0]
    exec(compile(several, "rigid-body.md", "exec"), names)
    assert "of 2 recordings" in names["estimator"].report().words[0]
    assert set(names["log"].status) <= {"structured", "adapting"}


def test_the_paper_in_one_call_as_the_docs_have_it(capsys):
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 1
    exec(compile(blocks[0], "design.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "Theorem 2 applies: True" in printed
    assert "errors within their bounds: True" in printed


GUIDES = [
    *("index", "start", "how-to-outputs", "how-to-constraints", "how-to-inputs", "how-to-live"),
    *("choose", "bars", "pictures"),
]


@pytest.mark.parametrize("name", GUIDES)
def test_guides_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == (2 if name == "start" else 1)
    names = {}
    exec(compile("\n".join(blocks), f"{name}.md", "exec"), names)
    assert "ddmhe" in names


def test_a_filter_with_more_disturbance_wins_as_the_docs_have_it():
    text = (ROOT / "docs" / "estimators.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(compile(block, "estimators.md", "exec"), names)
    own, by_hand, same = names["rms"].values()
    assert own[0] < 0.5 * by_hand[0]
    assert by_hand[1] < 0.9 * own[1]
    assert same == pytest.approx(by_hand, rel=0.02)
    assert all(f"{value:.3f}" in text for value in (*own, *by_hand))


# What makes processes that import its file is a process of its own.
GALLERY = [
    pytest.param(path, id=path.stem, marks=pytest.mark.long if "campaign" in path.stem else ())
    for path in sorted(ROOT.glob("examples/gallery/*.py"))
]


@pytest.mark.parametrize("path", GALLERY)
def test_the_gallery_runs(path, capsys):
    program = ROOT / "target" / "release" / "examples" / "first_estimate"
    if path.stem == "plot_91_rust" and not program.exists():
        pytest.skip("no program in Rust: cargo test builds it")
    if path.stem == "plot_11_campaign":
        command = [sys.executable, "-W", "error", str(path)]
        environment = os.environ | {"MPLBACKEND": "agg"}
        subprocess.run(command, check=True, timeout=300, env=environment)
        return
    plt.switch_backend("agg")
    with plt.rc_context():
        runpy.run_path(str(path), run_name="__main__")
    plt.close("all")
    assert capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    """To files that exist, and to headings that they have."""
    for file, heading in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", page.read_text("utf-8")):
        if "://" in file or file.startswith("mailto:"):
            continue
        if file.startswith("gallery/"):
            continue  # made of examples/gallery with the site
        target = page.parent / file if file else page
        assert target.exists(), f"{page.name}: {file}"
        if heading:
            titles = re.findall(r"^#+ (.*)$", target.read_text("utf-8"), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert heading in anchors, f"{page.name}: {file}#{heading}"
