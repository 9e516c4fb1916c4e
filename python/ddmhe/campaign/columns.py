"""The columns of a campaign's rows: the same in every file of it, whatever its part holds."""

from __future__ import annotations

from typing import Any

from ddmhe.campaign.errors import library
from ddmhe.campaign.spec import Spec

__all__ = ["TIMES", "rows_schema", "times_schema"]

NAMED = ("noise", "fault", "source", "source_sha256", "outcome", "error", "status", "settings",
         "spec_hash", "version")  # fmt: skip
SHARES = ("finite", "within_1sd", "within_2sd", "within_3sd", "inside", "trusted",
          "unnoticed")  # fmt: skip
TIMES = ("seconds", "data_seconds")
"""Wall time of a case, s, and its share of the time that its data took."""


def rows_schema(spec: Spec) -> Any:
    """Columns of a row; system and estimator are in the path of its file."""
    pa = library("pyarrow")
    number, several = pa.float64(), pa.list_(pa.float64())
    fields = [("case", pa.int64()), ("seed", pa.int64()), ("samples", pa.int64())]
    fields += [(name, pa.string()) for name in NAMED]
    fields += [(name, number) for name in SHARES]
    for span in spec.spans:
        fields += [(f"rmse_{span}", number)]
        fields += [(f"rmse_{state}_{span}", number) for state in spec.states]
        fields += [(f"nees_{span}", number)]
    fields += [(name, several) for name in ("width", "error_over_time", "nees_over_time")]
    return pa.schema(fields)


def times_schema() -> Any:
    """Columns of the table of times."""
    pa = library("pyarrow")
    return pa.schema([("case", pa.int64()), *((name, pa.float64()) for name in TIMES)])
