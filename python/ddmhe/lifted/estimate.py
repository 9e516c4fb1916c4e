"""What the lifted estimator hands out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import Estimate
from ddmhe.reasons import Reason
from ddmhe.steps import StepLog

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

__all__ = ["LiftedEstimate", "LiftedEvidence", "LiftedEvidenceLog", "LiftedLog", "log_of"]


@dataclass(frozen=True, eq=False)
class LiftedEvidence:
    """The numbers behind the trust in a lifted estimate."""

    kind: Literal["nis"]
    value: float
    """Moving mean of the normalised innovations squared, 1 while the model holds."""
    limit: float
    """Value above which the motion is novel."""
    innovation: Array
    """What the newest outputs (p,) differ by from what was expected; NaN where not measured."""
    innovation_std: Array
    """Standard deviations (p,) of that."""
    stuck: Flags
    """Which outputs (p,) repeat one value."""
    gated: Flags
    """All False: no output is doubted."""
    restarted: bool
    """False: a run does not start again by itself."""


@dataclass(frozen=True, eq=False)
class LiftedEstimate:
    """The estimate after one step: the lift's, or where that is not trusted the affine one."""

    x: Array
    """State x̂(t) (n,)."""
    covariance: Array
    """Covariance (n, n) of its error."""
    status: str
    """"lifted", or "affine" where the affine estimate stands; "infeasible" or "failed" as that one
    says."""
    trusted: bool
    reasons: Reason
    evidence: LiftedEvidence | object
    affine: Estimate
    """What `DdMhe` makes of the same outputs."""

    @property
    def std(self) -> Array:
        """Standard deviations (n,) of the error."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True, eq=False)
class LiftedEvidenceLog:
    """As `LiftedEvidence`, step by step."""

    kind: NDArray[np.str_]
    """Of each step (N,), since the affine estimator's statistic may be another."""
    value: Array
    limit: Array
    innovation: Array
    """(N, p)."""
    innovation_std: Array
    """(N, p)."""
    stuck: Flags
    """(N, p)."""
    gated: Flags
    """(N, p)."""
    restarted: Flags
    """(N,)."""


@dataclass(frozen=True, eq=False, repr=False)
class LiftedLog(StepLog):
    """The estimates of many steps."""

    covariance: Array
    """(N, n, n)."""
    std: Array
    """(N, n)."""
    status: NDArray[np.str_]
    """(N,)."""
    trusted: Flags
    """(N,)."""
    reasons: NDArray[np.uint8]
    """Numbers of `Reason` (N,)."""
    evidence: LiftedEvidenceLog


def log_of(
    estimates: list[LiftedEstimate], sizes: tuple[int, int], clock: tuple[int, float]
) -> LiftedLog:
    """The estimates of a run of n states and p outputs, one after the other; clock: the steps
    before, and the sampling interval."""
    n, p = sizes
    covariance = np.reshape([e.covariance for e in estimates], (-1, n, n))
    found = [e.evidence for e in estimates]

    def outputs(name: str, kind: type) -> NDArray:  # type: ignore[type-arg]
        return np.array([getattr(e, name) for e in found], dtype=kind).reshape(-1, p)

    def numbers(name: str, kind: type) -> NDArray:  # type: ignore[type-arg]
        return np.array([getattr(e, name) for e in found], dtype=kind)

    evidence = LiftedEvidenceLog(
        kind=numbers("kind", str),
        value=numbers("value", float),
        limit=numbers("limit", float),
        innovation=outputs("innovation", float),
        innovation_std=outputs("innovation_std", float),
        stuck=outputs("stuck", bool),
        gated=outputs("gated", bool),
        restarted=numbers("restarted", bool),
    )
    return LiftedLog(
        x=np.reshape([e.x for e in estimates], (-1, n)),
        covariance=covariance,
        std=np.sqrt(np.einsum("kii->ki", covariance)),
        status=np.array([e.status for e in estimates], dtype=str),
        trusted=np.array([e.trusted for e in estimates], dtype=bool),
        reasons=np.array([int(e.reasons) for e in estimates], dtype=np.uint8),
        evidence=evidence,
        before=clock[0],
        dt=clock[1],
    )
