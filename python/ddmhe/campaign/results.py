"""What a campaign has come to: its rows, times and traces."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ddmhe.campaign.errors import library
from ddmhe.campaign.spec import Spec
from ddmhe.campaign.store import Store

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Results"]


class Results:
    """A campaign in its folder. What it holds is read when it is first asked for."""

    def __init__(self, store: Store) -> None:
        """Of a store."""
        self._store = store

    @property
    def folder(self) -> Path:
        """Where it is."""
        return self._store.folder

    @property
    def spec(self) -> Spec:
        """What was run."""
        return self._store.spec

    @cached_property
    def rows(self) -> pd.DataFrame:
        """A row a case that is finished, in the order of their numbers."""
        frame: pd.DataFrame = self._store.rows()
        return frame

    @cached_property
    def timing(self) -> pd.DataFrame:
        """Wall times, s: of each case, and its share of making its data. Not reproducible."""
        frame: pd.DataFrame = self._store.times()
        return frame

    @cached_property
    def traces(self) -> dict[int, Any]:
        """Whole runs by their cases: datasets of t, x, x_hat, std and y."""
        return self._store.traces()

    @property
    def failed(self) -> pd.DataFrame:
        """Rows of the cases that ended with an error, diverged, or whose bounds were violated."""
        return self.rows[self.rows["outcome"] != "done"]

    @property
    def complete(self) -> bool:
        """Whether all cases are finished."""
        return len(self.rows) == self.spec.cases

    def to_xarray(self) -> Any:
        """The rows as an xarray.Dataset over `case`: rmse and nees also over `span`, and of each
        state over `state`."""
        xarray = library("xarray")
        rows, spans, states = self.rows, list(self.spec.spans), list(self.spec.states)
        per_state = np.array(
            [[rows[f"rmse_{state}_{span}"] for span in spans] for state in states], dtype=np.float64
        ).transpose(2, 1, 0)
        data: dict[str, Any] = {"rmse_of_state": (("case", "span", "state"), per_state)}
        for name in ("rmse", "nees"):
            values = [rows[f"{name}_{span}"].to_numpy(np.float64) for span in spans]
            data[name] = (("case", "span"), np.array(values).T)
        used = {f"{k}_{s}" for k in ("rmse", "nees") for s in spans}
        used |= {f"rmse_{state}_{span}" for state in states for span in spans}
        lists = ("width", "error_over_time", "nees_over_time")
        for name in rows.columns:
            if name not in used and name != "case" and name not in lists:
                column = rows[name]
                kind = object if column.dtype.kind not in "iuf" else None
                data[name] = ("case", column.to_numpy(kind))
        axes = {"case": rows["case"].to_numpy(), "span": spans, "state": states}
        return xarray.Dataset(data, coords=axes)
