"""Estimates as rows and frames, for the methods of `Log` and `Estimate`."""

from __future__ import annotations

from collections.abc import Iterator
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
    status: str
    """What the optimisation found."""
    trusted: bool | None
    """Whether nothing speaks against it."""
    reasons: Reason | None
    """What does."""
    cost: float
    """Cost (17)."""


def item(log: Log, key: Any) -> Row | Log:
    """Step `key`, or a Log of the steps of a slice without holes."""
    if isinstance(key, slice):
        start, stop, stride = key.indices(len(log))
        if stride != 1:
            raise DdmheError(f"key: expected steps that follow one another, found {shown(key)}")
        part: Log = _part(log, slice(start, max(start, stop)))
        return part
    try:
        k = range(len(log))[key]
    except TypeError:
        raise DdmheError(f"key: expected a step's number or a slice, found {shown(key)}") from None
    except IndexError:
        raise IndexError(f"step {key} of a Log of {len(log)}") from None
    return _row(log, k, log.t, _evidence(log))


def rows(log: Log, _: None) -> Iterator[Row]:
    """Step by step."""
    t, evidence = log.t, _evidence(log)
    return (_row(log, k, t, evidence) for k in range(len(log)))


def _evidence(log: Log) -> tuple[Any, Any, Any]:
    """What is computed for a whole log at once: std, trusted, reasons."""
    return log.std, log.trusted, log.reasons


def _row(log: Log, k: int, t: Array, evidence: tuple[Any, Any, Any]) -> Row:
    std, trusted, reasons = (None if part is None else part[k] for part in evidence)
    return Row(
        float(t[k]),
        log.x[k],
        std,
        str(log.status[k]),
        None if trusted is None else bool(trusted),
        None if reasons is None else Reason(int(reasons)),
        float(log.cost[k]),
    )


def _part(log: Log, kept: slice) -> Any:
    """The same columns, fewer rows; the clock goes on from the first of them."""
    reduced: Any = log.__reduce__()
    make, columns = reduced
    *whole, evidence, (before, dt) = columns
    parts = [part if part is None else part[kept] for part in whole]
    if evidence is not None:
        make_evidence, told = evidence.__reduce__()
        evidence = make_evidence(*(_rows_of(part, kept) for part in told))
    return make(*parts, evidence, (before + kept.start, dt))


def _rows_of(part: Any, kept: slice) -> Any:
    if isinstance(part, tuple):
        return tuple(_rows_of(one, kept) for one in part)
    return part if isinstance(part, str) else part[kept]


def same(log: Log, other: Any) -> bool:
    """Whether all numbers are the same."""
    return isinstance(other, Log) and _same(log.__reduce__()[1], other.__reduce__()[1])


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple):
        return len(a) == len(b) and all(_same(one, other) for one, other in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if a is None or b is None or isinstance(a, str | int | float):
        return bool(a == b)
    return _same(a.__reduce__()[1], b.__reduce__()[1])


def words(log: Log, _: None) -> str:
    """Sizes, times and how it went."""
    status = ", ".join(f"{count} {name}" for name, count in _counts(log).items())
    span = f", t={log.t[0]:.6g}..{log.t[-1]:.6g} s" if len(log) else ""
    trusted = log.trusted
    share = f", {np.mean(trusted):.1%} trusted" if trusted is not None and len(log) else ""
    return f"Log(N={len(log)}, n={log.x.shape[1]}{span}, {status or 'no steps'}{share})"


def _counts(log: Log) -> dict[str, int]:
    names, counts = np.unique(log.status, return_counts=True)
    return dict(zip(names.tolist(), counts.tolist(), strict=True))


def _names(names: Any, n: int) -> list[str]:
    """Names of the states: as given, else x0, x1, …"""
    if names is None:
        return [f"x{i}" for i in range(n)]
    if isinstance(names, str) or len(names) != n or not all(isinstance(s, str) for s in names):
        raise DdmheError(f"names: expected {n} texts, one a state, found {shown(names)}")
    return list(names)


def _columns(log: Log, names: Any) -> dict[str, Any]:
    """Columns of a frame, t first."""
    called = _names(names, log.x.shape[1])
    columns: dict[str, Any] = {"t": log.t}
    columns |= {name: log.x[:, i] for i, name in enumerate(called)}
    if log.std is not None and log.reasons is not None:
        columns |= {f"{name}_std": log.std[:, i] for i, name in enumerate(called)}
        columns |= {"trusted": log.trusted, "reasons": _reasons(log.reasons)}
    columns |= {"status": log.status.astype(object), "cost": log.cost}
    if log.bound is not None:
        columns["bound"] = log.bound
    return columns


def _reasons(reasons: NDArray[np.uint8]) -> list[str]:
    from ddmhe.report.trust import reason_words

    return reason_words(reasons)


def to_pandas(log: Log, names: Any) -> pd.DataFrame:
    """A row a step."""
    import pandas

    return pandas.DataFrame(_columns(log, names)).set_index("t")


def to_polars(log: Log, names: Any) -> pl.DataFrame:
    """A row a step."""
    columns = _columns(log, names) | {"status": log.status.tolist()}
    return _library("polars").DataFrame(columns)


def to_xarray(log: Log, names: Any) -> xr.Dataset:
    """Over t, state and, of innovations, output."""
    xarray = _library("xarray")
    called = _names(names, log.x.shape[1])
    data: dict[str, Any] = {
        "x": (("t", "state"), log.x),
        "status": ("t", log.status.astype(object)),
        "cost": ("t", log.cost),
    }
    if log.bound is not None:
        data["bound"] = ("t", log.bound)
    if log.evidence is not None:
        data |= {
            "std": (("t", "state"), log.std),
            "covariance": (("t", "state", "other_state"), log.covariance),
            "trusted": ("t", log.trusted),
            "reasons": ("t", log.reasons),
            "innovation": (("t", "output"), log.evidence.innovation),
            "innovation_std": (("t", "output"), log.evidence.innovation_std),
        }
    axes = {"t": ("t", log.t, {"units": "s"}), "state": called}
    if log.evidence is not None:
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
