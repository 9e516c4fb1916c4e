"""The page of a report in a browser: it draws, reacts, prints, and does what people with a keyboard
or a screen reader need. Left out on a machine without Chromium."""

import os
import shutil

import numpy as np
import pandas as pd
import pytest

from commands import in_here
from ddmhe.models import detumbling

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = os.environ.get("CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium on this machine (apt-get install chromium)"
)
HOSTILE = ("</script><script>window.harmed=1</script>", "<img src=x onerror=window.harmed=2>")
HOSTILE_OUTPUT = ("'onfocus='window.harmed=3' autofocus '", "{{ 7*7 }}&amp;<b>")
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
PIXELS = """() => [...document.querySelectorAll('.plot canvas')].map(c => {
  const ctx = new OffscreenCanvas(c.width, c.height).getContext('2d', {willReadFrequently: true});
  ctx.drawImage(c, 0, 0);
  const d = ctx.getImageData(0, 0, c.width, c.height).data;
  let filled = 0, lines = 0;
  for (let i = 0; i < d.length; i += 4) {
    filled += d[i + 3] > 0;
    lines += d[i] < 20 && Math.abs(d[i + 1] - 114) < 12 && Math.abs(d[i + 2] - 178) < 12;
  }
  return [filled / (c.width * c.height), lines]; })"""
# of each chart the share of pixels that are not clear, and how many have the estimate's colour
DRAWN = """() => [...document.querySelectorAll('.plot canvas')].map(c => c.toDataURL())"""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


def log_with(names, outputs, path):
    """A log of the tumbling satellite, two states and two outputs of it under these names."""
    record = detumbling().simulate(30.0, 0.1, noise=0.01, seed=3)
    frame = pd.DataFrame(np.hstack([record.t[:, None], record.x[:, :2], record.y[:, :2]]))
    frame.columns = ["t", *names, *outputs]
    frame.to_csv(path, index=False)
    return path


def written(folder, names, outputs):
    log = log_with(names, outputs, folder / "log.csv")
    columns = ["--state", ",".join(names), "--output", ",".join(outputs), "--history", "10"]
    done = in_here("report", log, *columns, "--out", folder / "page.html")
    assert done.returncode == 0, done.stderr
    return folder / "page.html"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return written(tmp_path_factory.mktemp("plain"), ("w1", "w2"), ("q1", "q2"))


@pytest.fixture
def opened(browser, plain):
    """The page, as wide as a laptop; nothing that it says on the console is let pass."""
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(plain.as_uri())
    yield page
    page.close()
    assert said == []
    assert asked == [plain.as_uri()]


def box_of(page, k=0):
    """Where the k-th chart is drawn."""
    area = page.locator(".plot .u-over").nth(k)
    area.scroll_into_view_if_needed()
    return area.bounding_box()


def over_time(page):
    """Which charts are over time: those with the label of its axis in their live words."""
    return page.evaluate(
        "() => JSON.parse(document.getElementById('data').textContent).charts.map(c => !c.x)"
    )


def test_every_chart_is_drawn(opened):
    figures = opened.locator("figure").count()
    assert figures >= 10
    filled, lines = zip(*opened.evaluate(PIXELS), strict=True)
    assert len(filled) == figures
    # lines, bands and words of the axes: an empty canvas has no pixel that is not clear
    assert min(filled) > 0.01
    assert lines[0] > 100  # the estimate's line


def test_zoom_is_shared_by_all_charts_over_time(opened):
    before = opened.evaluate(DRAWN)
    time = over_time(opened)
    assert any(time)
    assert not all(time)
    area = box_of(opened)
    y = area["y"] + area["height"] / 2
    opened.mouse.move(area["x"] + 0.4 * area["width"], y)
    opened.mouse.down()
    opened.mouse.move(area["x"] + 0.7 * area["width"], y, steps=4)
    opened.mouse.up()
    opened.wait_for_timeout(100)
    zoomed = opened.evaluate(DRAWN)
    assert [a != b for a, b in zip(before, zoomed, strict=True)] == time
    opened.mouse.dblclick(area["x"] + 0.5 * area["width"], y)
    opened.wait_for_timeout(100)
    assert opened.evaluate(DRAWN) == before


def test_hovering_tells_values_in_every_legend(opened):
    area = box_of(opened)
    opened.mouse.move(area["x"] + 0.8 * area["width"], area["y"] + 20)
    opened.wait_for_timeout(50)
    first = opened.locator("#chart-0 output").all_text_contents()
    # recorded is over by then; a band has two ends
    assert first[0] == ""
    assert " to " in first[1]
    assert all(float(text) is not None for text in first[2:])
    assert "" not in opened.locator("#chart-1 output").all_text_contents()[1:]


def test_keys_and_buttons_do_what_the_mouse_does(opened):
    before = opened.evaluate(DRAWN)
    opened.locator("#chart-0 .plot").focus()
    opened.keyboard.press("+")
    opened.wait_for_timeout(50)
    assert opened.evaluate(DRAWN)[0] != before[0]
    assert "from" in opened.locator("#said").text_content()
    opened.keyboard.press("0")
    opened.wait_for_timeout(50)
    assert opened.evaluate(DRAWN)[0] == before[0]
    opened.keyboard.press("ArrowLeft")
    assert "estimated" in opened.locator("#said").text_content()
    for label in ("Zoom in", "Later"):
        opened.get_by_role("button", name=label).click()
    opened.wait_for_timeout(50)
    assert opened.evaluate(DRAWN)[0] != before[0]
    opened.get_by_role("button", name="All").click()
    opened.wait_for_timeout(50)
    assert opened.evaluate(DRAWN)[0] == before[0]


def test_the_theme_is_the_systems_or_chosen(opened):
    paper = "() => getComputedStyle(document.body).backgroundColor"
    light, drawn = opened.evaluate(paper), opened.evaluate(DRAWN)
    opened.get_by_label("Colours").select_option("dark")
    dark = opened.evaluate(paper)
    assert dark != light
    assert all(a != b for a, b in zip(drawn, opened.evaluate(DRAWN), strict=True))
    opened.get_by_label("Colours").select_option("auto")
    assert opened.evaluate(paper) == light
    opened.emulate_media(color_scheme="dark")
    opened.wait_for_function("() => document.documentElement.dataset.theme === 'dark'")
    assert opened.evaluate(paper) == dark


def test_contents_lead_to_every_section(opened):
    links = opened.get_by_role("navigation").get_by_role("link")
    sections = opened.locator("main > section")
    assert links.count() == sections.count() >= 8
    opened.emulate_media(reduced_motion="reduce")
    for k in range(links.count()):
        links.nth(k).click()
        target = opened.locator(links.nth(k).get_attribute("href"))
        assert target.get_by_role("heading", level=2).text_content() == links.nth(k).text_content()
        assert target.get_by_role("heading", level=2).bounding_box()["y"] < 900


def test_a_phone_needs_no_scrolling_sideways(opened):
    opened.set_viewport_size({"width": 400, "height": 800})
    opened.wait_for_timeout(100)
    assert opened.evaluate("() => document.documentElement.scrollWidth") <= 400
    assert (
        opened.evaluate(
            "() => Math.max(...[...document.querySelectorAll('canvas')].map(c => c.clientWidth))"
        )
        <= 400
    )


def test_paper_gets_all_charts_sharp_and_light(opened):
    opened.get_by_label("Colours").select_option("dark")
    dark = opened.evaluate(DRAWN)
    opened.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert opened.evaluate("() => document.documentElement.dataset.theme") == "light"
    widths = opened.evaluate("() => [...document.querySelectorAll('canvas')].map(c => c.width)")
    assert set(widths) == {1700}
    opened.evaluate("() => dispatchEvent(new Event('afterprint'))")
    assert opened.evaluate(DRAWN) == dark
    assert len(opened.pdf(format="A4")) > 20_000


@pytest.mark.parametrize(("theme", "width"), [("light", 1200), ("dark", 400)])
def test_no_violation_of_accessibility(opened, theme, width):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    opened.emulate_media(color_scheme=theme)
    opened.set_viewport_size({"width": width, "height": 900})
    opened.wait_for_function(f"() => document.documentElement.dataset.theme === '{theme}'")
    found = axe.Axe().run(opened, options=RULES).response
    assert [(v["id"], v["nodes"][0]["html"]) for v in found["violations"]] == []
    assert len(found["passes"]) > 15


def test_names_from_a_log_do_no_harm(browser, tmp_path):
    path = written(tmp_path, HOSTILE, HOSTILE_OUTPUT)
    page = browser.new_page()
    said = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(path.as_uri())
    page.locator("#chart-0 .plot").focus()
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("() => window.harmed") is None
    assert said == []
    assert page.locator("img, b").count() == 0
    assert page.locator("script").count() == 3
    heading = page.locator("#chart-0-title").text_content()
    assert heading == HOSTILE[0]
    assert HOSTILE_OUTPUT[1] in page.locator("#summary").text_content()
    page.close()


def test_words_and_tables_are_there_without_a_script(browser, plain):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(plain.as_uri())
    assert page.locator("table").count() >= 5
    assert "The charts are drawn by a script" in page.locator("#summary").text_content()
    context.close()
