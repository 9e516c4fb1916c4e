"""Design of an estimator: identified models, pole placement (Algorithm 2), stability certificates.

`pole_placement` is Algorithm 2 of Liu et al. 2026 as printed, with its limits stated, and
`algorithm1` the whole of the paper in one call: its weights, its horizon, its estimator. `ioss`
designs the weighted certificate that exists for every observable system, and with a stated noise
one for every system that a recording allows."""

from ddmhe._core import minimum_horizon
from ddmhe.design.algorithm1 import Algorithm1, algorithm1
from ddmhe.design.certificate import Certificate, Uncertainty
from ddmhe.design.certify import ioss, scalar_certificate
from ddmhe.design.delay import OutputDelay, output_delay
from ddmhe.design.model import AffineModel, identify
from ddmhe.design.poles import PolePlacement, pole_placement
from ddmhe.design.regions import Cone, Disc, HalfPlane
from ddmhe.design.uncertainty import ConsistentSet, RecordingNoise, consistent_set

__all__ = [
    "AffineModel",
    "Algorithm1",
    "Certificate",
    "Cone",
    "ConsistentSet",
    "Disc",
    "HalfPlane",
    "OutputDelay",
    "PolePlacement",
    "RecordingNoise",
    "Uncertainty",
    "algorithm1",
    "consistent_set",
    "identify",
    "ioss",
    "minimum_horizon",
    "output_delay",
    "pole_placement",
    "scalar_certificate",
]
