"""Every study of `make study-…` is there and can begin: what it takes from the package and the
tests exists."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STUDIES = sorted(path.stem for path in (ROOT / "studies").glob("*.py"))


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_can_be_imported(name, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "studies")
    assert importlib.import_module(name).__doc__


def test_every_study_that_make_names_exists():
    named = set(re.findall(r"studies/(\w+)\.py", (ROOT / "Makefile").read_text(encoding="utf-8")))
    assert named <= set(STUDIES)


def test_a_half_of_a_page_leaves_the_other(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "studies")
    page = importlib.import_module("calibration_page")
    monkeypatch.setattr(page, "PAGE", tmp_path / "page.md")
    page.write_half("faults", ["## Faults", "", "one"])
    page.write_half("evidence", ["## Bars", "", "two \\\\ three"])
    page.write_half("faults", ["## Faults", "", "four"])
    text = page.PAGE.read_text(encoding="utf-8")
    assert text.startswith(page.INTRODUCTION)
    assert text.index("two \\\\ three") < text.index("four")
    assert "one\n" not in text.replace(page.INTRODUCTION, "")
    assert "not printed yet" not in text
