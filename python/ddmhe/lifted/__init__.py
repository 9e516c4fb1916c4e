"""Estimators whose model is a polynomial of the recording's states."""

from ddmhe.lifted.estimate import (
    LiftedEstimate,
    LiftedEvidence,
    LiftedEvidenceLog,
    LiftedLog,
)
from ddmhe.lifted.estimator import LiftedMhe

__all__ = ["LiftedEstimate", "LiftedEvidence", "LiftedEvidenceLog", "LiftedLog", "LiftedMhe"]
