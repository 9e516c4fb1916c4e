"""Quick looks at a run: functions that draw a `Log` into matplotlib axes and return them.

They need the log alone. Without `ax` they draw into the current axes of pyplot.

>>> ax = ddmhe.plot.states(log)            # doctest: +SKIP"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, Log, ShapeError
from ddmhe.checks import array, shown
from ddmhe.frames import told
from ddmhe.reasons import Reason
from ddmhe.steps import StepLog

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Run: TypeAlias = Log | StepLog

__all__ = ["errors", "evidence", "innovations", "states"]


def states(
    log: Run,
    ax: Axes | None = None,
    *,
    truth: ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> Axes:
    """Estimated states over time with bands of three standard deviations; doubt is shaded.

    Parameters
    ----------
    log
        A run.
    ax
        Axes to draw into.
    truth
        True states (N, n), NaN where unknown, drawn broad below.
    names
        Names of the states (n); default x0, x1, …

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> log = ddmhe.DdMhe(record.history(200)).run(record.y[200:300])
    >>> axes = ddmhe.plot.states(log, truth=record.x[201:301], names=["wx", "wy", "wz"])
    """
    from ddmhe.report.palette import color_of
    from ddmhe.report.style import BAND, ESTIMATE, TRUTH, legend_above

    axes, called = _axes(log, ax), _names(log, names)
    t, std = log.t, told(log, "std")
    known = None if truth is None else array("truth", truth, log.x.shape)
    for i, name in enumerate(called):
        color = color_of(i)
        if known is not None:
            axes.plot(t, known[:, i], color=color, **TRUTH)
        axes.plot(t, log.x[:, i], color=color, label=name, **ESTIMATE)
    limits = axes.get_ylim()
    if std is not None:
        for i in range(len(called)):
            low, high = log.x[:, i] - 3 * std[:, i], log.x[:, i] + 3 * std[:, i]
            axes.fill_between(t, low, high, color=color_of(i), **BAND)
    axes.set_ylim(limits)  # bands may be wide
    _shade_doubts(axes, log)
    axes.set(xlabel="time (s)", ylabel="state")
    legend_above(axes)
    return axes


def errors(
    log: Run,
    truth: ArrayLike,
    ax: Axes | None = None,
    *,
    names: Sequence[str] | None = None,
) -> Axes:
    """Errors |x - truth| over time on a log axis, with three standard deviations dashed; truth
    (N, n) is NaN where unknown.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> log = ddmhe.DdMhe(record.history(200)).run(record.y[200:300])
    >>> axes = ddmhe.plot.errors(log, record.x[201:301])
    """
    from ddmhe.report.palette import color_of
    from ddmhe.report.style import BAR, ESTIMATE, legend_above

    axes, called = _axes(log, ax), _names(log, names)
    error = np.abs(log.x - array("truth", truth, log.x.shape))
    std = told(log, "std")
    for i, name in enumerate(called):
        visible = np.where(error[:, i] > 0, error[:, i], np.nan)
        axes.plot(log.t, visible, color=color_of(i), label=name, **ESTIMATE)
        if std is not None:
            axes.plot(log.t, 3 * std[:, i], color=color_of(i), **BAR)
    _shade_doubts(axes, log)
    axes.set(xlabel="time (s)", ylabel="error", yscale="log")
    legend_above(axes)
    return axes


def innovations(log: Run, ax: Axes | None = None, *, names: Sequence[str] | None = None) -> Axes:
    """Measured less predicted outputs in standard deviations over time; beyond three is one in some
    hundred, where the motion is like the recording. names (p).

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> axes = ddmhe.plot.innovations(ddmhe.DdMhe(record.history(200)).run(record.y[200:300]))
    """
    from ddmhe.report.palette import color_of
    from ddmhe.report.style import legend_above

    axes, of = _axes(log, ax), _evidence(log)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = of.innovation / of.innovation_std
    p = relative.shape[1]
    called = [f"y{i}" for i in range(p)] if names is None else list(names)
    if len(called) != p:
        raise DdmheError(f"names: expected {p} texts, one an output, found {shown(names)}")
    for i, name in enumerate(called):
        axes.plot(log.t, relative[:, i], ".", color=color_of(i), markersize=3, label=name)
    for limit in (-3, 3):
        axes.axhline(limit, color="0.4", linewidth=0.8, linestyle="--")
    axes.set(xlabel="time (s)", ylabel="innovation (standard deviations)")
    legend_above(axes)
    return axes


def evidence(log: Run, ax: Axes | None = None) -> Axes:
    """How unlike the recording the motion is over time, and the limit above which it is new.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> axes = ddmhe.plot.evidence(ddmhe.DdMhe(record.history(200)).run(record.y[200:300]))
    """
    from ddmhe.report.style import ESTIMATE, legend_above

    axes, of = _axes(log, ax), _evidence(log)
    axes.plot(log.t, of.value, color="black", label=f"evidence {of.kind}", **ESTIMATE)
    axes.plot(log.t, of.limit, color="tab:red", linestyle="--", label="limit")
    axes.set(xlabel="time (s)", ylabel="unlike the recording", yscale="log")
    _shade_doubts(axes, log)
    legend_above(axes)
    return axes


def _axes(log: Any, ax: Axes | None) -> Axes:
    if not isinstance(log, Log | StepLog):
        raise DdmheError(f"log: expected a Log, as run gives it, found {shown(log)}")
    if ax is not None:
        if not hasattr(ax, "plot"):
            raise DdmheError(f"ax: expected Axes of matplotlib, found {shown(ax)}")
        return ax
    from matplotlib import pyplot

    return pyplot.gca()


def _names(log: Run, names: Sequence[str] | None) -> list[str]:
    n = log.x.shape[1]
    called = [f"x{i}" for i in range(n)] if names is None else list(names)
    if len(called) != n:
        raise ShapeError(f"names: expected {n} texts, one a state, found {shown(names)}")
    return called


def _evidence(log: Run) -> Any:
    evidence = told(log, "evidence")
    if evidence is None:
        raise DdmheError("log: expected one with evidence, found one without (evidence=False)")
    return evidence


def _shade_doubts(axes: Axes, log: Run) -> None:
    """Where estimates are in doubt, by reason."""
    from ddmhe.report.style import DOUBTS

    reasons = told(log, "reasons")
    if reasons is None or not len(log):
        return
    t = log.t
    step = t[1] - t[0] if len(t) > 1 else 0.0
    for reason, color in DOUBTS.items():
        there = np.concatenate([[0], (reasons & reason != 0).astype(int), [0]])
        begin, end = (np.flatnonzero(np.diff(there) == sign) for sign in (1, -1))
        spans = [(t[a] - step, t[b - 1] - t[a] + step) for a, b in zip(begin, end, strict=True)]
        if spans:
            across = axes.get_xaxis_transform()
            label = f"doubt: {str(Reason(reason).name).lower()}"
            axes.broken_barh(
                spans, (0, 1), transform=across, color=color, linewidth=0, zorder=0.5, label=label
            )
