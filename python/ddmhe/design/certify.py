"""Designing a certificate: from a recording, from every system that a noisy recording allows, from
(A, C), or from the scalar weights of (17)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, InfeasibleError
from ddmhe.checks import array, check_finite, check_kind, check_number, shown
from ddmhe.design.arguments import input_matrices, recording_or_system, system
from ddmhe.design.certificate import Certificate, Uncertainty
from ddmhe.design.dissipation import (
    best_gains,
    dissipation,
    largest_eigenvalue,
    root,
)
from ddmhe.design.model import given_model, identify, is_exact, unobservable_modes
from ddmhe.design.tol import ETA_MOST, ETA_STEP, LEAST_WIDTH, NONZERO
from ddmhe.design.uncertainty import ConsistentSet, RecordingNoise, consistent_set

Array = NDArray[np.float64]

__all__ = ["ioss", "scalar_certificate"]

ETA = 0.95
"""Discount that is designed for when neither `eta` nor `condition` is given."""


def ioss(
    history: History | None = None,
    eta: float | None = None,
    *,
    A: ArrayLike | None = None,
    C: ArrayLike | None = None,
    e: ArrayLike | None = None,
    r: ArrayLike | None = None,
    B: ArrayLike | None = None,
    D: ArrayLike | None = None,
    condition: float | None = None,
    noise: RecordingNoise | None = None,
    gains: tuple[float, float] | None = None,
) -> Certificate:
    """Design a stability certificate from a recording, or from (A, C).

    Minimises w² trace Q + v² trace R subject to (L) and P ⪰ I; with `noise`, to (L) for every
    system that the recording allows.

    Parameters
    ----------
    history : History
        A recording; its affine least-squares model (with B and D, where it has inputs) is
        certified, or with `noise` every system consistent with it.
    eta : float in (0, 1)
        Discount per sample. Default: the smallest that `condition` allows, or 0.95.
    A, C : arrays (n, n), (p, n)
        A known system instead of a recording.
    e, r : arrays (n,), (p,)
        Its offsets, x(t+1) = A x + e, y = C x + r; zeros for a linear system. P, Q and R do not
        depend on them, but the error bound of an estimator over a noisy recording does.
    B, D : arrays (n, m), (p, m)
        What its known inputs do, x(t+1) = A x + B u + e, y = C x + D u + r, for an estimator over a
        recording with inputs. P, Q and R do not depend on them.
    condition : float > 1
        Upper bound on cond P.
    noise : RecordingNoise
        Errors of the recording.
    gains : (w, v)
        Relative sizes of w and v in what is minimised. Default (1, ‖C‖): an output error as large
        as a unit of state.

    Raises
    ------
    InfeasibleError
        No certificate exists or none was found: unobservable modes that η does not cover, η too
        small for `condition`, noise that allows for systems that cannot be certified together.
    DdmheError, ShapeError, NotFiniteError, RankError
        Wrong arguments; a recording that does not determine (A, C).

    Examples
    --------
    >>> import ddmhe
    >>> certificate = ddmhe.design.ioss(A=[[0.9, 0.1], [0.0, 0.8]], C=[[1.0, 0.0]], eta=0.95)
    >>> certificate.residual <= 0  # the largest eigenvalue of the inequality
    True
    >>> certificate.P.shape, certificate.R.shape
    ((2, 2), (1, 1))
    """
    if eta is not None:
        check_number("eta", eta, "a number in (0, 1)", lambda value: 0 < value < 1)
    if condition is not None:
        check_number("condition", condition, "a number above 1", lambda value: value > 1)
    if noise is not None:
        check_kind("noise", noise, RecordingNoise, "a RecordingNoise")
    allowed = _resolve(history, A, C, noise)
    known = _beside(history, allowed, (e, r), (B, D))
    if gains is None:
        gains = (1.0, max(float(np.linalg.norm(allowed.C, 2)), NONZERO))
    if not isinstance(gains, tuple | list) or len(gains) != 2:
        raise DdmheError(f"gains: expected two positive numbers (w, v), found {shown(gains)}")
    for gain in gains:
        check_number("gains", gain, "two positive numbers (w, v)", lambda value: value > 0)
    if eta is None:
        eta = ETA if condition is None else _smallest_eta(allowed, condition)
    found = best_gains(allowed, eta, condition, gains)
    if found is None:
        raise InfeasibleError(_why_not(allowed, eta, condition, gains, noise))
    certificate = _certificate(allowed, *found, eta=eta, noise=noise, offsets=history is not None)
    identified = history is not None and noise is None and not _is_exact(history, allowed)
    return replace(certificate, identified=identified, **known)


def scalar_certificate(
    A: ArrayLike,
    C: ArrayLike,
    gain: ArrayLike,
    rho: float,
    mu: float,
    *,
    e: ArrayLike | None = None,
    r: ArrayLike | None = None,
    B: ArrayLike | None = None,
    D: ArrayLike | None = None,
) -> Certificate:
    """The scalar weights of (17) as a certificate, P = I, R = μI, Q = 3I, η = ρ, if `gain` L (n, p)
    satisfies (24).

    e, r are the offsets of the system and B, D what its inputs do, as in `ioss`.

    ‖A_L d - w + L(v - v̂)‖² ≤ 3‖A_L d‖² + 3‖w‖² + 3‖L(v - v̂)‖² with 6‖A_L‖² ≤ ρ, 6‖L‖² ≤ μ gives
    (L).

    Examples
    --------
    >>> import ddmhe
    >>> certificate = ddmhe.design.scalar_certificate(
    ...     A=[[0.9]], C=[[1.0]], gain=[[-0.9]], rho=0.5, mu=5.0
    ... )
    >>> certificate.P, certificate.R, certificate.eta
    (array([[1.]]), array([[5.]]), 0.5)
    """
    A, C = system(A, C)
    L = array("gain", gain, (len(A), len(C)))
    check_finite("gain", L)
    check_number("rho", rho, "a number in (0, 1)", lambda value: 0 < value < 1)
    check_number("mu", mu, "a positive number", lambda value: value > 0)
    rho_0, mu_0 = 6 * np.linalg.norm(A + L @ C, 2) ** 2, 6 * np.linalg.norm(L, 2) ** 2
    if not rho_0 <= rho < 1:
        raise InfeasibleError(
            f"rho: expected a number in [{rho_0:.4g}, 1), which (24) asks for, found {rho}"
        )
    if not mu_0 <= mu:
        raise InfeasibleError(f"mu: expected at least {mu_0:.4g}, which (24) asks for, found {mu}")
    P, Q, R = np.eye(len(A)), 3.0 * np.eye(len(A)), mu * np.eye(len(C))
    residual = largest_eigenvalue(dissipation(A, C, P, Q, R, rho))
    if residual > 0:
        raise InfeasibleError(
            "gain: expected one for which the inequality holds, found its eigenvalue "
            f"{residual:.3g}"
        )
    if (e is None) != (r is None):
        raise DdmheError("e, r: expected both or neither, found one")
    certificate = Certificate(P, Q, R, rho, residual, A, C, growth=float(np.linalg.norm(A, 2)))
    of_inputs = input_matrices(B, D, len(A), len(C))
    if of_inputs is not None:
        certificate = replace(certificate, B=of_inputs[0], D=of_inputs[1])
    if e is None or r is None:
        return certificate
    return replace(certificate, e=_vector("e", e, len(A)), r=_vector("r", r, len(C)))


def _resolve(
    history: History | None, A: ArrayLike | None, C: ArrayLike | None, noise: RecordingNoise | None
) -> ConsistentSet:
    """The set of systems to certify; a single one has a root without columns."""
    given = recording_or_system(history, A, C)
    if isinstance(given, History):
        if noise is not None:
            return consistent_set(given, noise)
        model = identify(given)
    else:
        if noise is not None:
            raise DdmheError("noise: expected a recording that it belongs to, found A and C")
        model = given_model(*given)
    (n, m), p = model.B.shape, len(model.C)
    return ConsistentSet(
        model.A,
        model.B,
        model.e,
        model.C,
        model.D,
        model.r,
        root=np.zeros((n + p, 0)),
        metric=np.zeros((n + m + 1, n + m + 1)),
    )


def _beside(
    history: History | None,
    allowed: ConsistentSet,
    offsets: tuple[ArrayLike | None, ArrayLike | None],
    of_inputs: tuple[ArrayLike | None, ArrayLike | None],
) -> dict[str, Any]:
    """e and r, B and D as given beside A and C, checked; what was not given is left out."""
    e, r = offsets
    if (e is None) != (r is None) or (e is not None and history is not None):
        raise DdmheError("e, r: expected both with A and C, or neither, found otherwise")
    known: dict[str, Any] = {}
    n, p = len(allowed.A), len(allowed.C)
    if e is not None and r is not None:
        known |= {"e": _vector("e", e, n), "r": _vector("r", r, p)}
    matrices = input_matrices(*of_inputs, n, p)
    if matrices is not None:
        if history is not None:
            raise DdmheError("B, D: expected both with A and C, or neither, found otherwise")
        known |= {"B": matrices[0], "D": matrices[1]}
    return known


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    vector = array(name, value, (size,))
    check_finite(name, vector)
    return vector


def _is_exact(history: History, model: ConsistentSet) -> bool:
    """Whether the recording is a trajectory of the model to rounding, with a sample to spare."""
    theta = np.block([[model.A, model.B], [model.C, model.D]])
    return is_exact(history, theta, np.concatenate([model.e, model.r]))


def _certificate(
    allowed: ConsistentSet,
    P: Array,
    Q: Array,
    R: Array,
    residual: float,
    optimised: bool,
    *,
    eta: float,
    noise: RecordingNoise | None,
    offsets: bool,
) -> Certificate:
    n = len(P)
    root_P, root_Q, root_R = (scipy.linalg.cholesky(M) for M in (P, Q, R))
    inverse = scipy.linalg.solve_triangular(root_P, np.eye(n))
    growth = float(np.linalg.norm(root_P @ allowed.A @ inverse, 2))
    uncertainty = None
    if noise is not None:
        spread = float(
            np.linalg.norm(root_P @ allowed.root[:n], 2)
            * np.linalg.norm(root(allowed.shape) @ inverse, 2)
        )
        growth += spread
        w, v = (
            float(np.linalg.norm(U @ q, 2))
            for U, q in ((root_Q, allowed.root[:n]), (root_R, allowed.root[n:]))
        )
        uncertainty = Uncertainty(allowed.metric, w, v)
    certificate = Certificate(
        P, Q, R, eta, residual, allowed.A, allowed.C, None, None, growth, uncertainty, noise
    )
    certificate = replace(certificate, optimised=optimised)
    if offsets:
        certificate = replace(certificate, e=allowed.e, r=allowed.r)
    return replace(certificate, B=allowed.B, D=allowed.D) if allowed.B.shape[1] else certificate


def _smallest_eta(allowed: ConsistentSet, condition: float) -> float:
    """Smallest η, to ETA_STEP, at which cond P ≤ condition is possible: bisection."""
    lo, hi = 0.0, ETA_MOST
    if best_gains(allowed, hi, condition, (1.0, 1.0)) is None:
        raise InfeasibleError(
            f"condition: expected a bound on cond P that some eta below {hi} can meet, found "
            f"{condition:g}"
        )
    while hi - lo > ETA_STEP:
        middle = 0.5 * (lo + hi)
        lo, hi = (
            (lo, middle) if best_gains(allowed, middle, condition, (1.0, 1.0)) else (middle, hi)
        )
    return hi


def _why_not(
    allowed: ConsistentSet,
    eta: float,
    condition: float | None,
    gains: tuple[float, float],
    noise: RecordingNoise | None,
) -> str:
    """Why there is no certificate, in words."""
    modes = unobservable_modes(allowed.A, allowed.C)
    slow = max((abs(z) for z in modes), default=0.0)
    if slow**2 >= eta:
        if slow >= 1:
            return (
                f"A, C: expected a detectable pair, found a mode of magnitude {slow:.6g} that no "
                "output shows: no certificate exists"
            )
        return (
            f"eta: expected more than {slow**2:.6g}, the square of the unobservable mode "
            f"{slow:.6g}, found {eta:g}"
        )
    if noise is not None:
        share = _certifiable_share(allowed, eta, condition, gains)
        return (
            f"noise: expected a size that leaves systems which one certificate with eta = {eta:g} "
            f"can cover, found a set of consistent systems that would have to be {share:.2g} times "
            "as wide; state less noise, record more motion or raise eta"
        )
    if condition is not None:
        return f"eta: expected a larger one for cond P of at most {condition:g}, found {eta:g}"
    return (
        "A, C: expected a pair whose certificate survives rounding, found one too badly observable "
        f"at eta = {eta:g}"
    )


def _certifiable_share(
    allowed: ConsistentSet, eta: float, condition: float | None, gains: tuple[float, float]
) -> float:
    """Largest width that can be certified, relative to the set's own about its centre: to 10 %, at
    least LEAST_WIDTH."""
    lo, hi = math.log(LEAST_WIDTH), 0.0
    while hi - lo > 0.1:
        middle = 0.5 * (lo + hi)
        narrower = replace(allowed, root=math.exp(middle) * allowed.root)
        lo, hi = (
            (lo, middle) if best_gains(narrower, eta, condition, gains) is None else (middle, hi)
        )
    return math.exp(lo)
