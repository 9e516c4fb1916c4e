"""Units of channels: read from column names, and what channels of one unit share."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["is_unit", "shared", "unit_of"]

_TOKENS = frozenset(
    """rad deg rpm m cm mm km s ms us min Hz kHz kg N kN mN Nm V mV uV kV A mA W kW mW
    Pa kPa MPa bar K degC T mT uT""".split()  # noqa: SIM905
)
"""Units that may end a column's name; letters that also number or name things (C, F, g, h, L) are
left out."""
_TORQUES = frozenset(("N/m", "kN/m", "mN/m"))
_TOKEN = re.compile(r"([A-Za-z]+)([2-4]?)\Z")
_PARTS = re.compile(r"[\s/·⋅*^.()+\-\d²³]+")
_MORE = frozenset("% ° °C °F C g h d Nm sec usec msec ns µs".split())  # noqa: SIM905
"""Units that stand alone in a line of units."""
_BRACKETS = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*\Z")


def unit_of(name: str) -> str:
    """The unit that a column's name states, "" where it states none.

    It stands in brackets at the end, ``rate [rad/s]``, or follows underscores, ``omega_x_rad_s`` or
    ``acc_z_m_s2``: the longest tail of known units that leaves something of the name; of several
    the ones after the first divide, but for metres after a force: ``tz_N_m`` is a torque."""
    bracketed = _BRACKETS.search(name)
    if bracketed:
        return bracketed.group(1)
    tokens = name.split("_")
    first = len(tokens)
    while first > 1 and _known(tokens[first - 1]):
        first -= 1
    unit = "/".join(tokens[first:])
    return unit.replace("/", " ") if unit in _TORQUES else unit


def is_unit(text: str) -> bool:
    """Whether a text is a unit, as far as its parts are known ones."""
    parts = [part for part in _PARTS.split(text.strip("[]() ")) if part]
    return bool(parts) and all((_TOKEN.match(p) and _known(p)) or p in _MORE for p in parts)


def _known(token: str) -> bool:
    found = _TOKEN.match(token)
    return found is not None and found.group(1) in _TOKENS


def shared(values: Array, units: Sequence[str]) -> Array:
    """Each channel's mean of `values` (n,) over the channels of its unit; a channel of unknown unit
    stands alone."""
    groups = [unit or f"\0{i}" for i, unit in enumerate(units)]
    return np.array(
        [
            np.mean([v for v, other in zip(values, groups, strict=True) if other == own])
            for own in groups
        ]
    )
