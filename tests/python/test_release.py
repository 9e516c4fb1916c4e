"""What is released says the same of itself everywhere."""

import subprocess
import sys
from pathlib import Path

import ddmhe

ROOT = Path(__file__).parents[2]


def names(*options, root=ROOT):
    command = [sys.executable, str(root / "tools" / "release_names.py"), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_version_address_and_licence_agree():
    found = names()
    assert (found.returncode, found.stdout.count("\n")) == (0, 1), found.stdout


def test_a_tag_of_another_version_is_refused():
    found = names("--tag", "v99.0.0")
    assert found.returncode == 1
    assert f"the tag: expected v{ddmhe.__version__}, found v99.0.0" in found.stdout


def test_a_version_that_was_forgotten_in_one_place_is_found(tmp_path):
    for name in ("Cargo.toml", "pyproject.toml", "CITATION.cff", "LICENSE", "CHANGELOG.md"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    for folder in ("tools", "crates/ddmhe-run", "crates/ddmhe-core", "crates/ddmhe-interval"):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("README.md", "LICENSE"):
        for crate in ("run", "core", "interval"):
            path = Path("crates") / f"ddmhe-{crate}" / name
            (tmp_path / path).write_bytes((ROOT / path).read_bytes())
    tool = Path("tools") / "release_names.py"
    (tmp_path / tool).write_bytes((ROOT / tool).read_bytes())
    assert names(root=tmp_path).returncode == 0
    citation = tmp_path / "CITATION.cff"
    citation.write_text(citation.read_text().replace("version: 0.1.0", "version: 0.0.9"))
    assert "CITATION.cff: expected 0.1.0, found 0.0.9" in names(root=tmp_path).stdout
