"""The pendulum of the interval paper, Section 4."""

from __future__ import annotations

import numpy as np

DT = 0.065
"""Sampling interval, s."""
LAM, ORDER, STEPS = 0.5, 20, 100
"""Discount λ of the design, order of the zonotopes, samples of a trajectory."""
W, V = 0.006, 0.01
"""Bounds on the disturbances of the state and of the output."""
CENTER, RADIUS = np.array([0.98, 0.02]), np.array([0.1, 1.0])
"""The initial box: rad, rad/s."""
START = np.array([1.0, 0.0])
"""The true state at the start: rad, rad/s."""
LATE = slice(50, 100)
"""Bounds of x(51) to x(100): where widths are averaged."""
PRINTED_PHI = 1.15
"""φ0 of the peak-to-peak ball (44), as printed."""
