"""Colours of figures and pages: told apart by people with each kind of colour blindness."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe.report.palette import COLORS, HISTORY, color_of
from ddmhe.report.style import labels

SEEN = {
    "all colours": np.eye(3),
    "no red": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "no green": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "no blue": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""What is seen of linear red, green and blue: Machado, Oliveira and Fernandes 2009, severity 1."""
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
TAB10 = (
    *("1f77b4", "ff7f0e", "2ca02c", "d62728", "9467bd"),
    *("8c564b", "e377c2", "7f7f7f", "bcbd22", "17becf"),
)


def linear(color):
    parts = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(color, seen):
    """CIE 1976 L*a*b* under D65."""
    xyz = TO_XYZ @ np.clip(np.array(seen) @ linear(color), 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def nearest(colors, seen):
    pairs = itertools.combinations([lab(color, seen) for color in colors], 2)
    return min(np.linalg.norm(a - b) for a, b in pairs)


@pytest.mark.parametrize("seen", SEEN.values(), ids=SEEN)
def test_colours_stay_apart(seen):
    assert nearest(COLORS, seen) > 12
    assert nearest(COLORS[:6], seen) > 16


def test_the_usual_colours_of_matplotlib_do_not():
    assert nearest([f"#{color}" for color in TAB10], SEEN["no red"]) < 5


def test_our_estimator_has_one_colour_in_figures_and_pages():
    css = Path(ddmhe.report.__file__).with_name("web").joinpath("page.css").read_text()
    light = re.search(r":root \{(.*?)\}", css, re.DOTALL)[1]
    assert re.search(r"--estimate: (#\w+)", light)[1] == COLORS[0] == color_of(0)
    assert re.search(r"--recorded: (#\w+)", light)[1] == HISTORY
    assert color_of(len(COLORS)) == COLORS[0]


def test_axes_have_units():
    assert labels(["a", "b"], ["m", "m"]) == (["a", "b"], "state (m)")
    assert labels(["a", "$b$"], ["m", "m/s"]) == (["a (m)", "\\$b\\$ (m/s)"], "state")
    assert labels(["a", "b"], ["", "m"]) == (["a", "b (m)"], "state")
    assert labels(["a"], [""]) == (["a"], "state")
