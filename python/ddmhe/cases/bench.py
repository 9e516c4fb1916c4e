"""The single-axis bench of Liu et al. 2026, Section IV-A.

The paper prints the sampling interval (0.01 s), the history (0.5 s), the weights and the box.
Everything else is chosen here: `ddmhe.models.SpinDown` with an encoder of 10 000 counts per
revolution, torque noise of NOISE, during EVENT a noise LARGE_NOISE or a jerk of the target."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from ddmhe import models

DT, HISTORY, DURATION = 0.01, 0.5, 3.0
"""Sampling interval, history and whole experiment, s."""
NOISE, LARGE_NOISE = 2e-4 / 0.15, 5e-3 / 0.15
"""Torque noise as a share of the eddy torque at the start: 0.13 % and 3.3 %."""
EVENT = (1.5, 2.0)
"""When noise or disturbance is large, s; the jerk takes the first fifth of it."""
SPEED = 30.0
"""Speed at the start, rad/s."""
ENCODER = 10_000
"""Counts per revolution."""
RHO, M, MU = 0.9, 20, 1e5
"""The printed weights."""
BOX = 10 * math.pi / 60
"""Half width of the box around x_c, rad/s."""
MUS = tuple(10.0**k for k in range(-2, 8))
"""The sweep of Fig. 6; the paper's own values are not legible."""


@dataclass(frozen=True)
class Bench:
    """What the paper does not print of its bench."""

    decay: float = 1.0
    """Inertia over eddy damping, s."""
    C: float = 5e-3
    """Eddy torque per speed, N·m·s: the output matrix of (5)."""
    noise: float = 1.0
    """Times NOISE and LARGE_NOISE."""
    kick: float = 4.0
    """By how much the disturbance speeds the target up, rad/s."""

    @property
    def model(self) -> models.SpinDown:
        """Bearing friction in proportion to the eddy torque, as in the defaults of
        `models.SpinDown`."""
        return models.spin_down(
            inertia=self.decay * self.C,
            eddy=self.C,
            viscous=0.04 * self.C,
            coulomb=0.4 * self.C,
            omega_0=SPEED,
            encoder_counts=ENCODER,
        )

    @property
    def deviation(self) -> float:
        """Standard deviation of the torque noise outside of EVENT, N·m."""
        return NOISE * self.noise * self.C * SPEED


NOMINAL = Bench()
"""The bench of the figures and tables."""
FAMILY = tuple(
    Bench(*each)
    for each in itertools.product((1.0, 5.0), (5e-4, 5e-3, 5e-2), (1.0, 3.0, 10.0), (4.0, 10.0))
)
"""The benches that judge: decay, C, noise and kick in every combination."""
