"""The pages that are kept as examples, in Chromium: nothing loaded, nothing said in the console,
no violation of accessibility, no scrolling sideways on a phone, whole on paper."""

from pathlib import Path

import pytest

from test_report_browser import CHROMIUM, RULES

playwright = pytest.importorskip("playwright.sync_api")
axe = pytest.importorskip("axe_playwright_python.sync_playwright")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium on this machine (apt-get install chromium)"
)
PAGES = sorted((Path(__file__).parents[2] / "docs" / "reports").glob("*.html"))
# each page in one of two ways, the next one in the other; both ways of all with the long tests
WAYS = [("light", 1200), ("dark", 400)]
CASES = [
    pytest.param(
        *(path, *way), id=f"{path.stem}-{way[0]}", marks=pytest.mark.long if (i + k) % 2 else ()
    )
    for i, path in enumerate(PAGES)
    for k, way in enumerate(WAYS)
]


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.mark.parametrize(("path", "theme", "width"), CASES)
def test_an_example_is_well_made(browser, path, theme, width):
    page = browser.new_page(color_scheme=theme, viewport={"width": width, "height": 900})
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector(".plot canvas")
    found = axe.Axe().run(page, options=RULES).response
    assert [(v["id"], v["nodes"][0]["html"]) for v in found["violations"]] == []
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    assert len(page.pdf(format="A4")) > 20_000
    assert (said, asked) == ([], [path.as_uri()])
    page.close()
