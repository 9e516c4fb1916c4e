"""Sections on how an estimate was made: the recording, settings, steps, warnings, how to make it
again."""

from __future__ import annotations

from collections import Counter
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.report.web.numbers import percent
from ddmhe.report.web.parts import Chart, Code, Curve, Items, Section, Table, Text
from ddmhe.report.web.run import Run

Array = NDArray[np.float64]

__all__ = [
    "again_section",
    "recording_section",
    "settings_section",
    "steps_section",
    "warnings_section",
]

IN_FORCE = ("horizon", "rho", "mu", "weights", "process_noise", "start", "space")
"""Settings that an estimator states."""
MOST_WINDOWS = 4000
"""Windows of which singular values are taken; of more every second, third, …"""
FLOOR = 1e-7
"""Share of the largest singular value below which others are drawn there."""
SAID = {
    "horizon": "samples in a window",
    "rho": "discount a sample",
    "mu": "weight on fitted noise",
    "weights": "how the parts of the problem weigh",
    "process_noise": "fitted disturbance",
    "start": "where the run starts",
    "space": "which windows count as trajectories",
}
"""What settings are."""


def recording_section(run: Run) -> Section | None:
    """The recording: its rank condition, and how much of its windows few directions hold; None
    where the recording is not known."""
    history, est = run.source.history, run.est
    depth = getattr(est, "horizon", None)
    if history is None or not isinstance(depth, int):
        return None
    blocks: list[Any] = [Text(_rank_words(history, depth))]
    rank = int(getattr(est, "rank", 0))
    values = window_spectrum(history, depth)
    if values is not None:
        floor = values[0] * FLOOR
        words = f"Singular values of the recorded windows, from {values[0]:.3g} down to "
        words += f"{values[-1]:.3g}; the estimator uses {rank} directions."
        blocks.append(Text(
            "Windows of the recording are the estimator's model. Each channel is in units of its "
            "recorded spread here, the mean window taken off: values that fall steeply to a floor "
            "say that few directions hold the motion and the rest is noise."
        ))  # fmt: skip
        blocks.append(
            Chart(
                "singular value",
                words,
                [Curve("singular value", "dots", np.maximum(values, floor))],
                x=np.arange(1.0, len(values) + 1),
                x_label="direction",
                log=True,
                marks=[(rank + 0.5, f"{rank} in use")] if rank > 0 else [],
            )
        )
    ridge = float(getattr(est, "ridge", 0.0) or 0.0)
    if ridge > 0:
        blocks.append(Text(f"Directions are held small by a ridge of weight {ridge:.3g}."))
    return Section("recording", "Recording and rank", blocks)


def _rank_words(history: History, depth: int) -> str:
    found = history.rank(depth)
    holds = "holds" if found.satisfied else "does not hold"
    return (
        f"The recording has {history.T} samples of {history.dt:.4g} s. The rank condition for "
        f"windows of {depth} outputs {holds}: rank {found.rank}, {found.required} asked, smallest "
        f"singular value {found.margin:.3g} of the largest."
    )


def window_spectrum(history: History, depth: int) -> Array | None:
    """Singular values of the matrix of recorded windows [x(k) … x(k+M); y(k) … y(k+M-1)], each
    channel over its spread, less their mean; None where no recording holds a window."""

    def spread(parts: list[Array]) -> Array:
        deviation = np.concatenate(parts).std(axis=0)
        return np.where(deviation > 0, deviation, 1.0)

    states = spread([x for x, _ in history.recordings])
    outputs = spread([y for _, y in history.recordings])
    blocks = []
    for x, y in history.recordings:
        count = len(y) - depth + 1
        if count < 1:
            continue
        of_x = sliding_window_view(x / states, depth + 1, axis=0).reshape(count, -1)
        of_y = sliding_window_view(y / outputs, depth, axis=0).reshape(count, -1)
        blocks.append(np.hstack([of_x, of_y]))
    if not blocks:
        return None
    matrix = np.concatenate(blocks)
    matrix = matrix[:: -(-len(matrix) // MOST_WINDOWS)]
    matrix -= matrix.mean(axis=0)
    return np.asarray(np.linalg.svd(matrix / np.sqrt(len(matrix)), compute_uv=False))


def settings_section(run: Run) -> Section | None:
    """Settings in force and why; None for an estimator that states none."""
    settings = getattr(run.est, "settings", None)
    if settings is None:
        return None
    why = dict(settings.why)
    rows = []
    for key in IN_FORCE:
        value = getattr(settings, key)
        text = f"{value:.5g}" if isinstance(value, float) else str(value)
        text = "none" if value is None else text
        if isinstance(value, np.ndarray):
            text = f"given, trace {np.trace(np.atleast_2d(value)):.3g}"
        by_itself = "given, or as the first windows said" if key == "start" else "given"
        reason = why.pop(key, by_itself).replace("as stated", "given")
        rows.append((key, SAID[key], text, reason))
    rows += [(key, "", "", said) for key, said in why.items() if key not in IN_FORCE]
    radius = getattr(run.est, "spectral_radius", None)
    if radius is not None:
        said = "estimation errors shrink by it in a sample, at last"
        rows.append(("spectral radius", "", f"{radius:.4f}", said))
    table = Table("Settings in force", ("setting", "what it is", "value", "why"), rows)
    return Section("settings", "Settings", [table])


def steps_section(run: Run) -> Section | None:
    """How steps ended, active bounds, how long they took; None where nothing of it is known."""
    status, times = getattr(run.log, "status", None), run.source.times
    blocks: list[Any] = []
    if status is not None:
        counts = Counter(str(one) for one in status)
        rows = [(name, str(count), percent(count / len(run.t))) for name, count in
                counts.most_common()]  # fmt: skip
        blocks.append(Table("How steps ended", ("status", "steps", "share"), rows))
    active = getattr(run.log, "active", None)
    if active is not None and np.any(active):
        held = percent(float(np.mean(active > 0)))
        words = f"Bounds that were active, over time: some in {held} of the steps, at most "
        words += f"{int(np.max(active))} at once."
        blocks.append(Text(words))
        curve = Curve("active bounds", "estimate", np.asarray(active, dtype=np.float64))
        blocks.append(Chart("active bounds (count)", words, [curve]))
    elif active is not None:
        blocks.append(Text("No bound was active in any step."))
    if times is not None:
        rows = [("all, in one call", f"{1e6 * times.mean:.3g}", str(len(run.t)))]
        for label, share in (("median", 50), ("99 of 100", 99), ("longest", 100)):
            value = 1e6 * float(np.percentile(times.single, share))
            rows.append((f"one by one, {label}", f"{value:.3g}", str(len(times.single))))
        blocks.append(
            Table("Time of a step on the machine that made this page", ("steps", "µs", "of"), rows)
        )
    return Section("steps", "Steps and bounds", blocks) if blocks else None


def warnings_section(run: Run) -> Section | None:
    """What the estimator said; None for one that says nothing of the kind."""
    warnings = run.source.warnings
    if warnings is None:
        warnings = getattr(run.est, "warnings", None)
    if warnings is None:
        return None
    block = Items(list(warnings)) if warnings else Text("There were none.")
    return Section("warnings", "Warnings", [block])


def again_section(run: Run) -> Section:
    """What made the page, and of what."""
    blocks: list[Any] = []
    if run.source.command:
        blocks.append(Code(run.source.command, "The command that makes this page again"))
    made = {"ddmhe": version("ddmhe"), "estimator": type(run.est).__name__}
    facts = made | dict(run.source.facts)
    table = Table("What it is made of", ("", "value"), list(facts.items()))
    return Section("again", "To make it again", [*blocks, table])
