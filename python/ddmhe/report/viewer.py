"""A run for the Rerun viewer: states over time, and of three rates a body that spins."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError
from ddmhe.checks import check_path, file_words
from ddmhe.files import check_writable, write
from ddmhe.report.palette import color_of
from ddmhe.report.web.run import Run, Source, run_of

Array = NDArray[np.float64]

__all__ = ["check_recording", "rerun", "turned"]

APART = 3.0
"""Distance between the estimated body and the true one, in edges."""
RATE = ("rad/s", "")
"""Units of states that may be the rates of a body."""


def rerun(
    est: Any,
    log: Any,
    path: str | os.PathLike[str],
    *,
    truth: ArrayLike | None = None,
    t: ArrayLike | None = None,
    names: Mapping[str, Sequence[str]] | Sequence[str] | None = None,
    units: Mapping[str, str] | Sequence[str] | None = None,
    source: Source | None = None,
) -> Path:
    """Write a run as a recording (.rrd) that `rerun FILE.rrd` shows.

    Each state is a time series, estimated with its band of three standard deviations and true where
    that is known; doubt is another. Three states in rad/s are the rates of a body: a box turns with
    them, from where it happens to be at first, and beside it one with the true rates. The box of
    `RigidBodyMhe` has the edges of a block of its inertia.

    est, log : an estimator and what its run returned
    truth, t, names, units : as in `report.html`

    Raises DdmheError where rerun-sdk is lacking (pip install 'ddmhe[rerun]'), and as `html`."""
    check_recording(path)
    rr = _library()
    known = Source() if source is None else source
    run = run_of(est, log, truth=truth, t=t, names=names, units=units, source=known)
    target = Path(path)

    def save(beside: Path) -> None:
        recording = rr.RecordingStream("ddmhe", recording_id=target.stem)
        recording.save(str(beside))
        _states(rr, recording, run)
        if _rates(run):
            _bodies(rr, recording, run)
        recording.flush()
        recording.disconnect()

    write(target, save)
    return target


def check_recording(path: str | os.PathLike[str], name: str = "path") -> None:
    """An error for a file that cannot be written or read again, before anything is computed."""
    check_path(name, path)
    if Path(path).suffix.lower() != ".rrd":
        raise DdmheError(
            f"{name}: expected a file ending in .rrd, found '{file_words(Path(path))}'"
        )
    _library()
    check_writable(Path(path))


def _library() -> Any:
    try:
        import rerun as rr
    except ImportError:
        raise DdmheError(
            "rerun: expected the library rerun-sdk (pip install 'ddmhe[rerun]')"
        ) from None
    return rr


def _states(rr: Any, recording: Any, run: Run) -> None:
    """Time series by state."""
    clock = rr.TimeColumn("time", duration=run.t)

    def series(path: str, values: Array, name: str, color: Sequence[float], width: float) -> None:
        style = rr.SeriesLines(colors=[color], names=[name], widths=[width])
        recording.log(path, style, static=True)
        recording.send_columns(path, [clock], rr.Scalars.columns(scalars=values))

    std = getattr(run.log, "std", None)
    for i, channel in enumerate(run.states):
        at, color = f"states/{_plain(channel.name, i)}", _rgb(color_of(i))
        if run.truth is not None:
            series(f"{at}/true", run.truth[:, i], f"{channel.label}, true", (0.6, 0.6, 0.6), 3.0)
        series(f"{at}/estimate", run.x[:, i], channel.label, color, 1.5)
        if std is not None:
            for side, sign in (("lower", -3), ("upper", 3)):
                values = run.x[:, i] + sign * std[:, i]
                series(f"{at}/{side}", values, f"{channel.label}, {sign:+d} sd", color, 0.5)
    trusted = getattr(run.log, "trusted", None)
    if trusted is not None:
        series("doubt", (~trusted).astype(np.float64), "in doubt", (0.8, 0.4, 0.0), 1.5)


def _rates(run: Run) -> bool:
    return len(run.states) == 3 and all(channel.unit in RATE for channel in run.states)


def _bodies(rr: Any, recording: Any, run: Run) -> None:
    """Boxes that turn with the estimated and the true rates."""
    half = _half_edges(run.est)
    bodies = {"estimate": (run.x, 0.0, _rgb(color_of(0)))}
    if run.truth is not None and np.isfinite(run.truth).all():
        bodies["true"] = (run.truth, APART * float(half.max()) * 2.0, (0.6, 0.6, 0.6))
    clock = rr.TimeColumn("time", duration=run.t)
    steps = np.diff(run.t, prepend=run.begin)
    for name, (rates, aside, color) in bodies.items():
        at = f"body/{name}"
        box = rr.Boxes3D(half_sizes=[half], colors=[color], labels=[name], fill_mode="solid")
        recording.log(f"{at}/turn", box, static=True)
        recording.log(at, rr.Transform3D(translation=[aside, 0.0, 0.0]), static=True)
        turns = rr.Transform3D.columns(quaternion=turned(rates, steps))
        recording.send_columns(f"{at}/turn", [clock], turns)
    words = "A box turns with the rates about its own axes; where it points at first is not known."
    recording.log("body/about", rr.TextDocument(words), static=True)


def turned(rates: Array, steps: Array) -> Array:
    """Attitudes (N, 4), quaternions (x, y, z, w) from the body to where it was at first, of a body
    that turned with the rates (N, 3) about its own axes for so long (N,) before each."""
    angles = rates * steps[:, None]
    size = np.linalg.norm(angles, axis=1)
    by = np.column_stack([angles * 0.5 * np.sinc(size / (2 * np.pi))[:, None], np.cos(size / 2)])
    q, found = np.array([0.0, 0.0, 0.0, 1.0]), np.empty((len(rates), 4))
    for k, (x, y, z, w) in enumerate(np.nan_to_num(by)):
        a, b, c, d = q
        q = np.array(
            [
                d * x + a * w + b * z - c * y,
                d * y - a * z + b * w + c * x,
                d * z + a * y - b * x + c * w,
                d * w - a * x - b * y - c * z,
            ]
        )
        q /= np.linalg.norm(q)
        found[k] = q
    return found


def _half_edges(est: Any) -> Array:
    """Half edges of a homogeneous block with the inertia of a rigid body's estimator, the longest
    1; of a brick for another."""
    report = est.report() if callable(getattr(est, "report", None)) else None
    if report is None:
        return np.array([1.0, 0.6, 0.35])
    inertia = np.diag(np.asarray(report.inertia, dtype=np.float64))
    squares = np.maximum(inertia.sum() - 2 * inertia, 1e-3)  # a² ∝ I_b + I_c - I_a
    half = np.sqrt(squares)
    return np.asarray(half / half.max())


def _plain(name: str, place: int) -> str:
    """A part of an entity's path: letters and digits of a name, else its place."""
    kept = "".join(c if c.isalnum() else "_" for c in name).strip("_")
    return f"{place}_{kept}" if kept else str(place)


def _rgb(color: str) -> tuple[float, float, float]:
    return tuple(int(color[k : k + 2], 16) / 255 for k in (1, 3, 5))  # type: ignore[return-value]
