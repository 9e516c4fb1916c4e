"""Estimates as rows and frames, for the methods of `Log`, of the logs made in Python and of
`Estimate`. A log has t and x; what else it lacks is left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError, Estimate, Log
from ddmhe.checks import shown
from ddmhe.reasons import Reason

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    import xarray as xr

Array = NDArray[np.float64]

__all__ = ["Row"]


class Row(NamedTuple):
    """One step of a Log."""

    t: float
    """Time of the state, s since the run began."""
    x: Array
    """Estimated state (n,)."""
    std: Array | None
    """Standard deviation of its error (n,); None, as all evidence, where none was asked for."""
    status: str | None
    """What the optimisation found; None of an estimator that does not say."""
    trusted: bool | None
    """Whether nothing speaks against it."""
    reasons: Reason | None
    """What does."""
    cost: float | None
    """Cost (17), or that of the estimator's own problem; None without one."""


def item(log: Any, key: Any) -> Any:
    """Step `key`, or a Log of the steps of a slice without holes."""
    if isinstance(key, slice):
        start, stop, stride = key.indices(len(log))
        if stride != 1:
            raise DdmheError(f"key: expected steps that follow one another, found {shown(key)}")
        return _part(log, slice(start, max(start, stop)))
    try:
        k = range(len(log))[key]
    except TypeError:
        raise DdmheError(f"key: expected a step's number or a slice, found {shown(key)}") from None
    except IndexError:
        raise IndexError(f"step {key} of a Log of {len(log)}") from None
    return _row(log, k, log.t, _evidence(log))


def rows(log: Any, _: None = None) -> Iterator[Row]:
    """Step by step."""
    t, evidence = log.t, _evidence(log)
    return (_row(log, k, t, evidence) for k in range(len(log)))


def _evidence(log: Any) -> tuple[Any, Any, Any]:
    """What is computed for a whole log at once: std, trusted, reasons."""
    return told(log, "std"), told(log, "trusted"), told(log, "reasons")


def told(log: Any, name: str) -> Any:
    """What a log tells of its steps; None where it does not."""
    return getattr(log, name, None)


def _row(log: Any, k: int, t: Array, evidence: tuple[Any, Any, Any]) -> Row:
    std, trusted, reasons = (None if part is None else part[k] for part in evidence)
    return Row(
        float(t[k]),
        log.x[k],
        std,
        None if told(log, "status") is None else str(log.status[k]),
        None if trusted is None else bool(trusted),
        None if reasons is None else Reason(int(reasons)),
        None if told(log, "cost") is None else float(log.cost[k]),
    )


def _part(log: Any, kept: slice) -> Any:
    """The same columns, fewer rows; the clock goes on from the first of them."""
    if is_dataclass(log) and not isinstance(log, type):
        part = _rows_of(log, kept)
        return replace(part, before=part.before + kept.start)
    reduced: Any = log.__reduce__()
    make, columns = reduced
    *whole, evidence, (before, dt) = columns
    parts = [part if part is None else part[kept] for part in whole]
    if evidence is not None:
        make_evidence, its = evidence.__reduce__()
        evidence = make_evidence(*(_rows_of(part, kept) for part in its))
    return make(*parts, evidence, (before + kept.start, dt))


def _rows_of(part: Any, kept: slice) -> Any:
    if isinstance(part, tuple):
        return tuple(_rows_of(one, kept) for one in part)
    if is_dataclass(part) and not isinstance(part, type):
        parts = {f.name: _rows_of(getattr(part, f.name), kept) for f in fields(part)}
        return replace(part, **parts)
    return part if part is None or isinstance(part, str | int | float) else part[kept]


def same(log: Any, other: Any) -> bool:
    """Whether all numbers are the same."""
    if is_dataclass(log):
        return type(other) is type(log) and _same(_of(log), _of(other))
    return isinstance(other, Log) and _same(log.__reduce__()[1], other.__reduce__()[1])


def _of(log: Any) -> tuple[Any, ...]:
    """The parts of a log made in Python, and of its evidence."""
    parts = (getattr(log, f.name) for f in fields(log))
    return tuple(_of(part) if is_dataclass(part) else part for part in parts)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple):
        return len(a) == len(b) and all(_same(one, other) for one, other in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if a is None or b is None or isinstance(a, str | int | float):
        return bool(a == b)
    return _same(a.__reduce__()[1], b.__reduce__()[1])


def words(log: Any, _: None = None) -> str:
    """Sizes, times and how it went."""
    parts = [f"N={len(log)}", f"n={log.x.shape[1]}"]
    if len(log):
        parts.append(f"t={log.t[0]:.6g}..{log.t[-1]:.6g} s")
    if told(log, "status") is not None or not len(log):
        status = [f"{count} {name}" for name, count in _counts(log).items()] if len(log) else []
        parts.append(", ".join(status) or "no steps")
    trusted = told(log, "trusted")
    if trusted is not None and len(log):
        parts.append(f"{np.mean(trusted):.1%} trusted")
    return f"{type(log).__name__}({', '.join(parts)})"


def _counts(log: Any) -> dict[str, int]:
    names, counts = np.unique(log.status, return_counts=True)
    return dict(zip(names.tolist(), counts.tolist(), strict=True))


def _names(names: Any, n: int) -> list[str]:
    """Names of the states: as given, else x0, x1, …"""
    if names is None:
        return [f"x{i}" for i in range(n)]
    if isinstance(names, str) or len(names) != n or not all(isinstance(s, str) for s in names):
        raise DdmheError(f"names: expected {n} texts, one a state, found {shown(names)}")
    return list(names)


def _columns(log: Any, names: Any) -> dict[str, Any]:
    """Columns of a frame, t first."""
    called = _names(names, log.x.shape[1])
    columns: dict[str, Any] = {"t": log.t}
    columns |= {name: log.x[:, i] for i, name in enumerate(called)}
    std, trusted, reasons = _evidence(log)
    if std is not None:
        columns |= {f"{name}_std": std[:, i] for i, name in enumerate(called)}
    if reasons is not None:
        columns |= {"trusted": trusted, "reasons": _reasons(reasons)}
    if told(log, "status") is not None:
        columns["status"] = log.status.astype(object)
    columns |= {name: told(log, name) for name in ("cost", "bound") if told(log, name) is not None}
    return columns


def _reasons(reasons: NDArray[np.uint8]) -> list[str]:
    from ddmhe.report.trust import reason_words

    return reason_words(reasons)


def to_pandas(log: Any, names: Any) -> pd.DataFrame:
    """A row a step."""
    import pandas

    return pandas.DataFrame(_columns(log, names)).set_index("t")


def to_polars(log: Any, names: Any) -> pl.DataFrame:
    """A row a step."""
    columns = _columns(log, names)
    if "status" in columns:
        columns["status"] = columns["status"].tolist()
    return _library("polars").DataFrame(columns)


def to_xarray(log: Any, names: Any) -> xr.Dataset:
    """Over t, state and, of innovations, output."""
    xarray = _library("xarray")
    called = _names(names, log.x.shape[1])
    data: dict[str, Any] = {"x": (("t", "state"), log.x)}
    if told(log, "status") is not None:
        data["status"] = ("t", log.status.astype(object))
    for name in ("cost", "bound"):
        if told(log, name) is not None:
            data[name] = ("t", told(log, name))
    judged = told(log, "evidence") is not None
    if judged:
        data |= {
            "std": (("t", "state"), log.std),
            "covariance": (("t", "state", "other_state"), log.covariance),
            "trusted": ("t", log.trusted),
            "reasons": ("t", log.reasons),
            "innovation": (("t", "output"), log.evidence.innovation),
            "innovation_std": (("t", "output"), log.evidence.innovation_std),
        }
    axes = {"t": ("t", log.t, {"units": "s"}), "state": called}
    if judged:
        axes["other_state"] = called
    return xarray.Dataset(data, coords=axes)


def window_to_pandas(e: Estimate, names: Any) -> pd.DataFrame:
    """A row a state of the window."""
    import pandas

    called = _names(names, e.window.shape[1])
    return pandas.DataFrame(e.window, columns=called, index=pandas.Index(e.t, name="t"))


def window_to_polars(e: Estimate, names: Any) -> pl.DataFrame:
    """A row a state of the window."""
    called = _names(names, e.window.shape[1])
    columns = {name: e.window[:, i] for i, name in enumerate(called)}
    return _library("polars").DataFrame({"t": e.t} | columns)


def window_to_xarray(e: Estimate, names: Any) -> xr.Dataset:
    """Over t and state."""
    axes = {"t": ("t", e.t, {"units": "s"}), "state": _names(names, e.window.shape[1])}
    return _library("xarray").Dataset({"x": (("t", "state"), e.window)}, coords=axes)


def _library(name: str) -> Any:
    """A library that this package does without otherwise."""
    try:
        return import_module(name)
    except ImportError:
        raise DdmheError(f"to_{name}: expected the library {name} (pip install {name})") from None
