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
