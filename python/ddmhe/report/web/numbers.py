"""Numbers as texts: of tables, short; of curves, as many digits as a screen can show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = [
    "curve_text",
    "listed",
    "number",
    "percent",
    "plus_minus",
    "seconds",
    "times",
    "with_unit",
]

STEPS = 2e4
"""Steps into which the range of a curve is cut: ten a pixel of a large screen."""


def curve_text(values: Array, exact: bool = False) -> str:
    """A JSON list; null for what is not finite. Times are `exact`: ten digits."""
    known = values[np.isfinite(values)]
    if exact or not known.size:
        return _list(values, "{:.10g}")
    spread = float(np.ptp(known)) or abs(float(known[0])) or 1.0
    digits = math.ceil(math.log10(STEPS) - math.log10(spread))
    # on a logarithmic axis small values have their digits, too
    if float(np.min(np.abs(known))) * STEPS < spread or not 0 <= digits < 9:
        return _list(values, "{:.5g}")
    return _list(np.round(values, digits) + 0.0, "{:.12g}")


def _list(values: Array, form: str) -> str:
    texts = [form.format(v) if math.isfinite(v) else "null" for v in values.tolist()]
    return f"[{','.join(texts)}]"


def number(value: float) -> str:
    """Three digits; "unknown" for NaN."""
    if math.isnan(value):
        return "unknown"
    return f"{value:.3g}" if math.isfinite(value) else "without bound"


def plus_minus(value: float, deviation: float) -> str:
    """A number and its standard deviation, both to the second digit of this."""
    if not (math.isfinite(value) and math.isfinite(deviation) and deviation > 0):
        return f"{number(value)} ± {number(deviation)}"
    digits = min(max(1 - math.floor(math.log10(deviation)), 0), 12)
    return f"{value:.{digits}f} ± {deviation:.{digits}f}"


def with_unit(value: float, unit: str) -> str:
    """A number and its unit, if there is one."""
    return f"{number(value)} {unit}".rstrip() if math.isfinite(value) else number(value)


def seconds(value: float, label: str) -> str:
    """A time: in s, or a step's number where the step's length is not known."""
    return f"{value:.6g} s" if label.endswith("(s)") else f"step {value:.0f}"


def times(count: int) -> str:
    """How often."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def percent(share: float) -> str:
    """A share in per cent with a digit behind the point."""
    return f"{100 * share:.1f} %"


def listed(words: Sequence[str]) -> str:
    """Words in a sentence: a, b and c; of many the first five."""
    if len(words) > 6:
        return f"{', '.join(words[:5])} and {len(words) - 5} more"
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))
