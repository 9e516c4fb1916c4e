"""Recordings from frames: `History(frame, state=…, output=…)` by the names of columns, and what
frames that stand for arrays say of themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ddmhe._core import DdmheError, History, ShapeError
from ddmhe.checks import shown
from ddmhe.recordings.arrays import is_frame
from ddmhe.recordings.csv_log import log_of
from ddmhe.recordings.options import Reading
from ddmhe.recordings.time_units import is_time_name

__all__ = ["check_frames", "recording"]


def recording(
    frame: Any, others: tuple[Any, Any, Any], columns: tuple[Any, Any, Any], stated: Sequence[Any]
) -> History:
    """The whole frame as a recording.

    others : y, u and dt of History, of which dt alone may be given
    columns : the names of states, outputs and inputs
    stated : units of states, outputs and inputs, where the frame's own are not meant
    """
    y, u, dt = others
    for name, value in (("y", y), ("u", u)):
        if value is not None:
            found = f"found {shown(value)}"
            raise DdmheError(f"{name}: expected none beside state= and output=, {found}")
    for name, names in zip(("state", "output"), columns, strict=False):
        if names is None:
            raise DdmheError(f"{name}: expected names of the frame's columns, found none")
    if not is_frame(frame):
        raise DdmheError(
            "x: expected a frame (pandas, polars, pyarrow) or a mapping of names to arrays beside "
            f"state= and output=, found {shown(frame)}; recordings.read takes files"
        )
    state, output, known = columns
    log = log_of(frame, (state, output, known or ()), Reading(dt=dt)).fill_gaps()
    own = (log if dt is None else replace(log, dt=float(dt))).recording(len(log.t) - 1)
    if all(units is None for units in stated):
        return own
    x_units, y_units, u_units = stated
    (x, y), inputs = own.recordings[0], own.inputs
    return History(
        x,
        y,
        own.dt,
        inputs[0] if own.m else None,
        x_units=own.x_units if x_units is None else x_units,
        y_units=own.y_units if y_units is None else y_units,
        u_units=(own.u_units or None) if u_units is None else u_units,
    )


def check_frames(x: Any, y: Any, u: Any) -> None:
    """Errors where frames in the place of arrays hold a clock, or rows of other instants."""
    for name, given in (("x", x), ("y", y), ("u", u)):
        clocks = [label for label in _labels(given) if is_time_name(label)]
        if clocks:
            raise DdmheError(
                f"{name}: expected a channel a column, found {shown(clocks[0])}, which looks like "
                "the clock; choose columns, or History(frame, state=[…], output=[…]) does"
            )
    for name, given in (("y", y), ("u", u)):
        ours, theirs = _index(x), _index(given)
        if ours is None or theirs is None or len(theirs) >= len(ours):
            continue
        if not theirs.equals(ours[: len(theirs)]):
            raise ShapeError(
                f"{name}: expected rows of the same index as the first {len(theirs)} of x, found "
                f"others, the first {shown(theirs[0])} beside {shown(ours[0])}; row k is the "
                "sample k of both, .to_numpy() takes them so"
            )


def _labels(given: Any) -> list[str]:
    """Names of columns; none for what has no names."""
    labels = getattr(given, "columns", None)
    if labels is None:
        name = getattr(given, "name", None)
        labels = [] if name is None else [name]
    return [label for label in labels if isinstance(label, str)]


def _index(given: Any) -> Any:
    """The index of what pandas makes."""
    index = getattr(given, "index", None)
    return index if hasattr(index, "equals") else None
