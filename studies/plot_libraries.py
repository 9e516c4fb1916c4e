"""Libraries that could draw the page of a report: how large a page is, how long it takes, whether
it loads anything.

`make study-plot-libraries` (two minutes, Chromium and an environment of its own) prints the table
of docs/report.md: six linked panels with three curves each, of a number of samples."""

import json
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
PANELS, CURVES = 6, 3
UPLOT = Path(__file__).parents[1] / "python/ddmhe/report/web/uplot"


def curves(samples: int) -> tuple[np.ndarray, list[list[np.ndarray]]]:
    rng = np.random.default_rng(0)
    t = np.round(0.01 * np.arange(samples), 6)
    made = [
        [np.round(np.sin(0.1 * t + i + j) + 0.05 * rng.standard_normal(samples), 5)
         for j in range(CURVES)]
        for i in range(PANELS)
    ]  # fmt: skip
    return t, made


def uplot(t: np.ndarray, made: list[list[np.ndarray]]) -> str:
    data = [[t.tolist(), *(c.tolist() for c in panel)] for panel in made]
    script = """
    for (const d of DATA) new uPlot({width: 800, height: 200, scales: {x: {time: false}},
      cursor: {sync: {key: "all"}}, series: [{}, ...d.slice(1).map((_, i) =>
      ({label: "c" + i, stroke: ["#0072b2", "#d55e00", "#009e73"][i]}))]}, d, document.body);"""
    return (
        f"<style>{(UPLOT / 'uPlot.min.css').read_text()}</style><body><script>"
        f"{(UPLOT / 'uPlot.iife.min.js').read_text()}</script><script>const DATA = "
        f"{json.dumps(data, separators=(',', ':'))};{script}</script></body>"
    )


def bokeh(t: np.ndarray, made: list[list[np.ndarray]]) -> str:
    from bokeh.embed import file_html
    from bokeh.layouts import column
    from bokeh.plotting import figure
    from bokeh.resources import INLINE

    shared, panels = None, []
    for panel in made:
        fig = figure(width=800, height=200, **({"x_range": shared} if shared else {}))
        shared = fig.x_range
        for curve in panel:
            fig.line(t, curve)
        panels.append(fig)
    return file_html(column(*panels), INLINE)


def plotly(t: np.ndarray, made: list[list[np.ndarray]]) -> str:
    from plotly.subplots import make_subplots

    fig = make_subplots(rows=PANELS, cols=1, shared_xaxes=True)
    for i, panel in enumerate(made):
        for curve in panel:
            fig.add_scatter(x=t, y=curve, mode="lines", row=i + 1, col=1)
    return fig.to_html(include_plotlyjs=True)


def vega(t: np.ndarray, made: list[list[np.ndarray]]) -> str:
    import altair as alt
    import pandas as pd

    alt.data_transformers.disable_max_rows()
    panels = []
    for i, panel in enumerate(made):
        zoom = alt.selection_interval(bind="scales", encodings=["x"], name=f"zoom{i}")
        frame = pd.DataFrame(dict(enumerate(panel))).assign(t=t).melt("t")
        frame["variable"] = frame["variable"].astype(str)
        panels.append(
            alt.Chart(frame, width=800, height=200).mark_line()
            .encode(x="t:Q", y="value:Q", color="variable:N").add_params(zoom)
        )  # fmt: skip
    return alt.vconcat(*panels).to_html(inline=True)


DRAWN = "canvas, svg.main-svg, .vega-embed svg"


def opened(browser, path: Path) -> tuple[float, int]:
    """Seconds until a page has been drawn and answers again, and what it asked of the network."""
    asked = []
    page = browser.new_page()
    page.route(lambda url: not url.startswith("file:"), lambda route: route.abort())
    page.on("request", lambda r: asked.append(r.url) if r.url.startswith("http") else None)
    began = time.perf_counter()
    page.goto(path.as_uri())
    page.locator(DRAWN).first.wait_for(timeout=60_000)
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)))")
    took = time.perf_counter() - began
    page.close()
    return took, len(asked)


def main() -> None:
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    print("| library | bundle, MB | page, MB | to write, s | to open, s | from outside |")
    print("|---|---|---|---|---|---|")
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for made in (uplot, bokeh, vega, plotly):
            began = time.perf_counter()
            text = made(*curves(samples))
            wrote = time.perf_counter() - began
            empty = len(made(*curves(2)).encode())
            path = Path(folder) / f"{made.__name__}.html"
            path.write_text(text)
            times, asked = zip(*(opened(browser, path) for _ in range(3)), strict=True)
            print(
                f"| {made.__name__} | {empty / 1e6:.2f} | {len(text.encode()) / 1e6:.2f} | "
                f"{wrote:.1f} | {statistics.median(times):.1f} | {max(asked)} |"
            )


if __name__ == "__main__":
    main()
