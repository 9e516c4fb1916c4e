"""Logs of estimators that are written in Python: they answer as `Log` does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import frames
from ddmhe.frames import Row

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    import xarray as xr

Array = NDArray[np.float64]

__all__ = ["StepLog"]


@dataclass(frozen=True, eq=False, repr=False)
class StepLog:
    """The estimates of many steps; what else an estimator tells of them is said by its own log."""

    x: Array
    """States (N, n)."""
    before: int = field(default=0, kw_only=True)
    """Steps since the run began, before these."""
    dt: float = field(default=1.0, kw_only=True)
    """Sampling interval, s; 1 where none is known."""

    __hash__ = None  # type: ignore[assignment]

    @property
    def t(self) -> Array:
        """Times (N,) of the states, s since the run began."""
        return np.asarray((self.before + np.arange(1.0, len(self.x) + 1)) * self.dt)

    def __len__(self) -> int:
        """Number of steps N."""
        return len(self.x)

    def __iter__(self) -> Iterator[Row]:
        """Step by step."""
        return frames.rows(self)

    def __getitem__(self, key: Any) -> Any:
        """Step k as a Row, or the log of a slice of steps that follow one another."""
        return frames.item(self, key)

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same."""
        return frames.same(self, other)

    def __repr__(self) -> str:
        """Sizes, times and how it went."""
        return frames.words(self)

    def to_pandas(self, names: Sequence[str] | None = None) -> pd.DataFrame:
        """A row a step, indexed by t; `names` (n) of the states, else x0, x1, …"""
        return frames.to_pandas(self, names)

    def to_polars(self, names: Sequence[str] | None = None) -> pl.DataFrame:
        """A row a step."""
        return frames.to_polars(self, names)

    def to_xarray(self, names: Sequence[str] | None = None) -> xr.Dataset:
        """Over t, state and, of innovations, output."""
        return frames.to_xarray(self, names)
