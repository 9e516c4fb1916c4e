"""A page as one HTML file: templates, style, script, library and numbers, and nothing from
elsewhere."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.files import write_text
from ddmhe.report.web.numbers import curve_text
from ddmhe.report.web.parts import Chart, Curve, Page
from ddmhe.report.web.thinning import Thinning

Array = NDArray[np.float64]

__all__ = ["document", "write_page"]

NUMBERS = 340_000
"""Numbers of curves that a page holds at most, some eight characters each."""
LEAST = 400
"""Points that a curve has at least before it is thinned, whatever the number of curves."""


def write_page(path: str | Path, page: Page) -> None:
    """Write a page in UTF-8; the file is whole or not there."""
    write_text(path, document(page))


def document(page: Page) -> str:
    """A page as HTML. All of its text is escaped where it stands."""
    from jinja2 import Environment, StrictUndefined  # longer to load than a page to write
    from markupsafe import Markup

    charts = [block for part in page.sections for block in part.blocks if block.kind == "chart"]
    thinning = Thinning.to(len(page.t), _points(charts))
    library, script = _own("uplot/uPlot.iife.min.js"), _own("page.js")
    made = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = made.from_string(_own("page.html.jinja"))
    return template.render(
        page=page,
        numbers={chart: k for k, chart in enumerate(charts)},
        notes=[words for words in (thinning.words, _made_by()) if words],
        hashes=" ".join(map(_hash, (library, script))),
        style=Markup(_own("uplot/uPlot.min.css") + "\n" + _own("page.css")),
        data=Markup(_inside_a_script(_data(page, charts, thinning))),
        library=Markup(library),
        script=Markup(script),
    )


def _points(charts: list[Chart]) -> int:
    """Points that each curve over time may have."""
    curves = [curve for chart in charts if chart.x is None for curve in chart.curves]
    columns = sum(1 if curve.upper is None or _mirrored(curve) else 2 for curve in curves)
    return max(LEAST, NUMBERS // (columns + 1))


def _data(page: Page, charts: list[Chart], thinning: Thinning) -> str:
    """Everything that is drawn, as JSON."""
    recorded = Thinning.to(len(page.recorded_t), _points(charts))
    drawn = [_chart(page, chart, thinning, recorded) for chart in charts]
    t, recorded_t = thinning.times(page.t), recorded.times(page.recorded_t)
    return (
        f'{{"t":{curve_text(t, exact=True)},"rt":{curve_text(recorded_t, exact=True)},'
        f'"doubts":{_spans(page.doubts)},"charts":[{",".join(drawn)}]}}'
    )


def _chart(page: Page, chart: Chart, thinning: Thinning, recorded: Thinning) -> str:
    def values(curve: Curve, of: Array) -> str:
        kept = np.where(of > 0, of, np.nan) if chart.log else of
        if chart.x is None:
            kept = (recorded if curve.at == "recording" else thinning).values(kept)
        return curve_text(kept)

    curves = []
    for curve in chart.curves:
        text = f'{{"look":{json.dumps(curve.look)},"at":{json.dumps(curve.at)},'
        text += '"v":null' if _mirrored(curve) else f'"v":{values(curve, curve.values)}'
        text += "" if curve.upper is None else f',"u":{values(curve, curve.upper)}'
        curves.append(f"{text}}}")
    about = {
        "xl": page.time_label if chart.x is None else chart.x_label,
        "log": chart.log,
        "doubts": chart.doubts,
        "view": None if chart.view is None or not np.isfinite(chart.view).all() else chart.view,
        "marks": list(chart.marks),
    }
    x = "null" if chart.x is None else curve_text(chart.x, exact=True)
    return (
        f'{json.dumps(about)[:-1]},"lanes":{_spans(chart.lanes)},"x":{x},'
        f'"curves":[{",".join(curves)}]}}'
    )


def _mirrored(curve: Curve) -> bool:
    """Whether a band is the same on both sides of zero: then one of them is enough."""
    return curve.upper is not None and np.array_equal(curve.values, -curve.upper, equal_nan=True)


def _spans(named: Any) -> str:
    """Spans of time by their names."""
    return json.dumps({k: [[float(f"{v:.10g}") for v in span] for span in spans]
                       for k, spans in named.items()}, separators=(",", ":"))  # fmt: skip


def _inside_a_script(text: str) -> str:
    """JSON that no parser of HTML takes for the end of the script that it stands in."""
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _own(name: str) -> str:
    """A file of this package."""
    return files("ddmhe.report.web").joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """What the page's policy lets run: a script by its hash, none else."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _made_by() -> str:
    return (
        f"Made by ddmhe {version('ddmhe')}. Charts: uPlot 1.6.18, © Leon Sorokin, MIT licence. "
        "The page loads nothing from elsewhere. Drag in a chart to zoom, double-click to see all; "
        "in a chart that has the focus arrows move the cursor, with shift the time, + and - zoom, "
        "0 shows all."
    )
