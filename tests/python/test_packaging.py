"""What a wheel holds beside the code."""

import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]


def test_licences_of_others_that_are_shipped_are_named():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    shipped = {str(p.relative_to(ROOT)) for p in (ROOT / "python").rglob("LICENSE*")}
    assert shipped == {"python/ddmhe/report/web/uplot/LICENSE"}
    assert shipped | {"LICENSE"} == set(project["license-files"])


def test_example_pages_are_linked_from_the_guide_and_copied_into_the_site():
    guide = (ROOT / "docs/report.md").read_text()
    for page in (ROOT / "docs/reports").glob("*.html"):
        assert f'<a href="reports/{page.name}">' in guide
    assert "build-finished" in (ROOT / "docs/conf.py").read_text()
