"""The 3-DOF case of Liu et al. 2026, Section IV-B: a tumbling satellite, recorded for 20 s and
estimated for 100 s."""

from __future__ import annotations

import math
from typing import Any

from ddmhe._core import Truncated

DT = 0.1
"""Sampling interval, s: the paper prints none."""
HISTORY, DURATION = 20.0, 120.0
"""Length of the recording and of the whole experiment, s."""
T = round(HISTORY / DT)
"""Outputs in the recording."""
BOX = 10 * math.pi / 60
"""Half width of the box on every state, rad/s, around the history's window: Section IV-A1."""
PAPER: dict[str, Any] = {"horizon": 10, "rho": 0.8, "mu": 1e5, "space": Truncated(3)}
"""The printed weights, with as many directions as the system has states: all directions of a noisy
recording, which the printed equality admits, make the estimate diverge."""
