"""What a user could take instead of Dd-MHE, implemented as well as we can: the estimators that
studies compare with.

- `KoopmanMhe`, `ErrorStateKalman`: the two methods that Liu et al. 2026 compare with.
- `ArxKalman`, `RidgeFir`: the usual data-driven choices, a Kalman filter on an identified model and
  a regression.
- `ModelMhe`: moving horizon estimation on the identified, or a given, model.
- `Oracle`: a Kalman filter (extended or unscented) that knows the true model: a limit for
  everything else.
- `TahirIntervalObserver`: a mixed-monotone interval observer, a reconstruction; takes an
  `interval.System`.

All but the last share one interface with `DdMhe`: `step(y_t, u=None)` consumes the next output (and
input) and returns the estimate of the state right after it (step t consumes y(t-1), u(t-1) and
gives x̂(t)), `run(Y, U=None)` does it for many, `reset(x_prior)` starts again."""

from ddmhe.baselines.base import Baseline, Estimate, Log
from ddmhe.baselines.kalman import ArxKalman, ErrorStateKalman, Oracle
from ddmhe.baselines.koopman import KoopmanMhe, thin_plate
from ddmhe.baselines.model_mhe import ModelEstimate, ModelLog, ModelMhe
from ddmhe.baselines.regression import RidgeFir
from ddmhe.baselines.tahir import TahirIntervalObserver

__all__ = [
    "ArxKalman",
    "Baseline",
    "ErrorStateKalman",
    "Estimate",
    "KoopmanMhe",
    "Log",
    "ModelEstimate",
    "ModelLog",
    "ModelMhe",
    "Oracle",
    "RidgeFir",
    "TahirIntervalObserver",
    "thin_plate",
]
