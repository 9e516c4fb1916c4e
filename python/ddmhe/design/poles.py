"""Pole placement from data: Algorithm 2 of Liu et al. 2026 as printed, with its limits stated.

The algorithm looks for a gain L with the poles of A_L = A + L C in a region, for the weights ρ0 = 6
λmax(A_LᵀA_L) and μ0 = 6 λmax(LᵀL) of (24). It works on the dual system x⁺ = Aᵀx + Cᵀu through "dual
data" (45), pseudo-inverses of the recorded differences (46), whose rank condition (44) contradicts
itself: noise-free data of an autonomous system have [X1; Y0] = [A; C] X0 of rank at most n, never n
+ p. Only noise or nonlinearity fills the rank, and then shapes the result: with 2n + p or more
noisy columns X0dl, U0dl and X1dl have independent rows, the programme can have X1dl X = 0 and U0dl
X = 0, and its optimum is A_L = 0, L = 0 whatever the system is, so that ρ0 and μ0 are the solver's
rounding. So every number is computed twice: as printed, and with the same gain in an identified (or
given) (A, C).

Known inputs act on the estimate and on the true state alike, so that the gain's task, A_L = A + L
C, is the same. What the inputs explain of the differences is taken off before (45), which is exact
on exact data (`dual_data` has the derivation), and (A, C) is identified with u."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, InfeasibleError
from ddmhe.checks import array, check_finite, check_number, check_whole
from ddmhe.design.dual_data import DualData, source
from ddmhe.design.model import AffineModel, unobservable_modes
from ddmhe.design.regions import Disc, Region
from ddmhe.design.solver import solve
from ddmhe.design.tol import (
    IN_REGION,
    INVERTIBLE,
    KERNEL,
    MARGIN,
    NONZERO,
    SYMMETRIC,
)

Array = NDArray[np.float64]

__all__ = ["PolePlacement", "pole_placement"]

MOST_ATTEMPTS = 1000
"""Radii that Algorithm 2 may be made to try."""
AGREEMENT = 0.05
"""The printed and the recomputed ρ0, μ0 agree when they differ by less than this share."""


@dataclass(frozen=True, eq=False)
class PolePlacement:
    """What Algorithm 2 found, and what it is worth."""

    gain: Array | None
    """L (n, p) with A_L = A + L C; None if no programme was solved."""
    rho0: float
    """6 λmax(A_LᵀA_L) with (53)'s A_L from the data; inf without a gain."""
    mu0: float
    """6 λmax(LᵀL); inf without a gain."""
    poles: NDArray[np.complex128]
    """Eigenvalues of (53)'s A_L; empty without a gain."""
    beta: float
    """β of (55b), the asymmetry of X0dl X; inf without a gain."""
    region: Region
    """The region of the last attempt."""
    attempts: int
    """Regions that were to be tried."""
    singular_values: Array
    """Of [X1; Y0] (46), largest first, each channel divided by its rms; of [A; C] where that was
    given."""
    rank: int
    """Numerical rank behind the pseudo-inverse; (44) asks for n + p."""
    required_rank: int
    """n + p."""
    arbitrary: bool
    """Whether the dual data have independent rows: then A_L = 0, L = 0 solves the programme for any
    system."""
    rho0_identified: float
    """ρ0 with the gain in the identified or given (A, C); inf without a gain."""
    poles_identified: NDArray[np.complex128]
    """Poles of A + L C with the identified or given (A, C); those of A without a gain."""
    output_rank: int
    """Rank of C, by its standard errors."""
    lower_bound: float
    """6 max ‖A b‖² over unit b with C b = 0: no gain makes ρ0 smaller; 0 if C has rank n."""

    @property
    def feasible(self) -> bool:
        """Whether the semidefinite programme was solved with ρ0 < 1 as printed, at some radius."""
        return self.rho0 < 1

    @property
    def certified(self) -> bool:
        """Whether (24) holds for the identified or given (A, C): ρ0 < 1 there."""
        return self.rho0_identified < 1

    @property
    def agree(self) -> bool:
        """Whether both ways give the same ρ0 to 5 %."""
        return (
            self.gain is not None
            and abs(self.rho0 - self.rho0_identified) <= AGREEMENT * self.rho0_identified
        )

    @property
    def mu0_identified(self) -> float:
        """The same as mu0: L does not depend on the model."""
        return self.mu0

    @property
    def radius(self) -> float:
        """Radius of the last attempt; 0 for a region that is not a disc."""
        return self.region.radius if isinstance(self.region, Disc) else 0.0

    @property
    def words(self) -> str:
        """The verdict in sentences."""
        return " ".join([*self._limits(), *self._outcome()])

    def _limits(self) -> Iterator[str]:
        n = len(self.poles_identified)
        if self.rank < self.required_rank:
            only = "no free gain but L = A^-T C^T, which does not stabilise"
            yield (
                f"The rank condition (44) fails: the recorded differences have rank {self.rank}, "
                f"not n + p = {self.required_rank}, which no noise-free recording of a linear "
                "autonomous system reaches. The pseudo-inverse then leaves "
                f"{only if self.rank <= n else 'fewer gains than there are'}."
            )
        if self.lower_bound >= 1:
            yield (
                f"(24) is impossible: of the n = {n} directions of the state {self.output_rank} "
                "show in C by more than twice their error. On the others no gain acts for sure, so "
                f"that rho0 >= {self.lower_bound:.4g} for every gain. Use a weighted certificate "
                "(ddmhe.design.ioss) instead."
            )
        if self.arbitrary:
            yield (
                "The dual data have independent rows (noise or nonlinearity in at least 2n + p = "
                f"{n + self.required_rank} columns): A_L = 0, L = 0 solves the programme whatever "
                "the system is."
            )

    def _outcome(self) -> Iterator[str]:
        if self.gain is None:
            yield (
                f"Algorithm 2 found no gain in {self.attempts} attempt(s); the semidefinite "
                "programme is infeasible or fails."
            )
            return
        yield f"As printed: rho0 = {self.rho0:.4g}, mu0 = {self.mu0:.4g} for {self.region}."
        if not self.agree:
            yield (
                f"With the same gain in the identified system rho0 = {self.rho0_identified:.4g}: "
                "the printed value is shaped by the recording's noise or nonlinearity and "
                "certifies nothing."
            )
        relation, holds = ("< 1", "holds") if self.certified else (">= 1", "does not hold")
        yield (
            f"In the identified system rho0 = {self.rho0_identified:.4g} {relation}: (24) {holds} "
            "there."
        )


def pole_placement(
    history: History | None = None,
    radius: float = 0.9,
    *,
    A: ArrayLike | None = None,
    C: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    region: Region | None = None,
    step: float = 0.5,
    attempts: int = 6,
) -> PolePlacement:
    """Algorithm 2: the semidefinite programme (56) with (51b), (51c), (54), (55b), (55c), and its
    verdict.

    Parameters
    ----------
    history : History
        The recording.
    radius : float in (0, 1)
        Radius of the disc (54) for the poles; multiplied by `step` while the programme is
        infeasible or ρ0 ≥ 1 (Remark 6).
    A, C : arrays (n, n), (p, n)
        A known system instead of a recording.
    Q, R : arrays (n, n), (p, p), symmetric positive definite
        Q_dl and R_dl of (56); default identities.
    region : Disc, HalfPlane or Cone
        Another region instead of the disc; it is tried once.
    step : float in (0, 1)
    attempts : int

    Raises
    ------
    InfeasibleError
        (A, C) is unobservable: some pole cannot be placed at all.
    RankError
        Too few samples, or states that do not span n directions.
    DdmheError, ShapeError, NotFiniteError
        Wrong arguments.

    Examples
    --------
    >>> import ddmhe
    >>> placed = ddmhe.design.pole_placement(A=[[0.9, 0.1], [0.0, 0.8]], C=[[1.0, 0.0]], radius=0.9)
    >>> placed.gain.shape, bool(abs(placed.poles).max() < 0.9)
    ((2, 1), True)
    """
    for name, value in (("radius", radius), ("step", step)):
        check_number(name, value, "a number in (0, 1)", lambda share: 0 < share < 1)
    check_whole("attempts", attempts, 1, MOST_ATTEMPTS, f"at least 1 and at most {MOST_ATTEMPTS}")
    if region is not None and not isinstance(region, Region):
        raise DdmheError(
            f"region: expected a Disc, a HalfPlane or a Cone, found {type(region).__name__}"
        )
    data, model = source(history, A, C)
    n, p = data.X0.shape[0], data.U0.shape[0]
    weights = _definite("Q", Q, n), _definite("R", R, p)
    regions = [region] if region is not None else [Disc(radius * step**k) for k in range(attempts)]
    lost = unobservable_modes(model.A, model.C)
    if len(lost):
        raise InfeasibleError(
            f"A, C: expected an observable pair, found a mode {lost[0]:.6g} that no output shows"
        )
    last: tuple[Region, _Solution | None] = (regions[0], None)
    for tried in regions:
        solution = _programme(data, tried, *weights)
        if solution is not None or last[1] is None:
            last = (tried, solution)
        if solution is not None and (solution.rho0 < 1 or region is not None):
            break
    return _verdict(data, model, *last, attempts=len(regions))


def _definite(name: str, matrix: ArrayLike | None, size: int) -> Array:
    """A symmetric positive definite weight, checked."""
    if matrix is None:
        return np.eye(size)
    M = array(name, matrix, (size, size))
    check_finite(name, M)
    if not np.allclose(M, M.T, rtol=SYMMETRIC, atol=0):
        raise DdmheError(f"{name}: expected a symmetric matrix, found one that is not")
    smallest = float(np.linalg.eigvalsh(M)[0])
    if smallest <= 0:
        raise DdmheError(
            f"{name}: expected a positive definite matrix, found smallest eigenvalue {smallest:.4g}"
        )
    return M


# --- the programme


@dataclass(frozen=True, eq=False)
class _Solution:
    gain: Array
    A_L: Array
    beta: float

    @property
    def rho0(self) -> float:
        return float(6 * np.linalg.norm(self.A_L, 2) ** 2)

    @property
    def mu0(self) -> float:
        return float(6 * np.linalg.norm(self.gain, 2) ** 2)


def _programme(data: DualData, region: Region, Q: Array, R: Array) -> _Solution | None:
    """(56); None if it has no solution whose poles lie in the region.

    The blocks are Lyapunov inequalities only for a symmetric X0dl X, which (55b) merely favours
    through β. Where the asymmetry that is left puts a pole outside, the programme is solved again
    with X0dl X symmetric (β = 0)."""
    for symmetric in (False, True):
        solution = _solve(data, region, Q, R, symmetric)
        if solution is not None and _contains(region, solution.A_L):
            return solution
    return None


def _solve(data: DualData, region: Region, Q: Array, R: Array, symmetric: bool) -> _Solution | None:
    """One solution of (56), unchecked; None if the solver finds no point."""
    import cvxpy as cp

    n, p = data.X0.shape[0], data.U0.shape[0]
    # X in the scale of the data, so that X0dl X is of size 1
    unit = 1 / max(float(np.linalg.norm(data.X0, 2)), NONZERO)
    X = cp.Variable((data.X0.shape[1], n))
    W, beta = cp.Variable((p, p), symmetric=True), cp.Variable(nonneg=True)
    S, Y, U = (unit * M @ X for M in (data.X0, data.X1, data.U0))
    H = 0.5 * (S + S.T)  # the diagonal blocks of a symmetric matrix: (55b) keeps S near it
    identity = np.eye(n)
    root_R = scipy.linalg.cholesky(R)
    constraints = [
        _positive(W, root_R @ U, H),  # (51b)
        _positive(H - identity, Y, H),  # (51c)
        _inside(region, S, Y),  # (54), or another region
        _positive(beta * identity, S - S.T, identity),  # (55b)
        H >> MARGIN * identity,  # (55c)
    ]
    if symmetric:
        constraints.append(S == S.T)
    problem = cp.Problem(cp.Minimize(cp.trace(Q @ H) + cp.trace(W) + beta), constraints)
    if not solve(problem) or X.value is None:
        return None
    S_, Y_, U_ = (unit * M @ X.value for M in (data.X0, data.X1, data.U0))
    if not np.isfinite(S_).all() or np.linalg.cond(S_) > INVERTIBLE:
        return None
    inverse = np.linalg.inv(S_)
    A_L, gain = (Y_ @ inverse).T, (U_ @ inverse).T  # (53)
    return (
        _Solution(gain, A_L, float(beta.value))
        if np.isfinite(A_L).all() and np.isfinite(gain).all()
        else None
    )


def _positive(A: Any, B: Any, D: Any) -> Any:
    """[[A, B], [Bᵀ, D]] ≻ 0 with a margin."""
    import cvxpy as cp

    block = cp.bmat([[A, B], [B.T, D]])
    return 0.5 * (block + block.T) >> MARGIN * np.eye(block.shape[0])


def _inside(region: Region, S: Any, Y: Any) -> Any:
    """L ⊗ S + M ⊗ Y + Mᵀ ⊗ Yᵀ ≺ 0 (Definition 3), of which (54) is the case of a disc about 0."""
    import cvxpy as cp

    L, M = region.matrices()
    n, size = S.shape[0], len(L)
    H = 0.5 * (S + S.T)
    block = cp.bmat(
        [[L[i, j] * H + M[i, j] * Y + M[j, i] * Y.T for j in range(size)] for i in range(size)]
    )
    return 0.5 * (block + block.T) << -MARGIN * np.eye(n * size)


def _contains(region: Region, A_L: Array) -> bool:
    """Whether all eigenvalues lie in the region, up to rounding."""
    L, M = region.matrices()
    return all(
        np.linalg.eigvalsh(L + z * M + np.conj(z) * M.T)[-1] <= IN_REGION
        for z in np.linalg.eigvals(A_L)
    )


# --- the verdict


def _verdict(
    data: DualData, model: AffineModel, region: Region, solution: _Solution | None, attempts: int
) -> PolePlacement:
    output_rank, lower_bound = _blind(model)
    A_L = model.A if solution is None else model.A + solution.gain @ model.C
    return PolePlacement(
        gain=solution.gain if solution else None,
        rho0=solution.rho0 if solution else math.inf,
        mu0=solution.mu0 if solution else math.inf,
        poles=np.linalg.eigvals(solution.A_L).astype(np.complex128)
        if solution
        else np.empty(0, dtype=np.complex128),
        beta=solution.beta if solution else math.inf,
        region=region,
        attempts=attempts,
        singular_values=data.singular_values,
        rank=data.rank,
        required_rank=data.X0.shape[0] + data.U0.shape[0],
        arbitrary=data.arbitrary,
        rho0_identified=float(6 * np.linalg.norm(A_L, 2) ** 2) if solution else math.inf,
        poles_identified=np.linalg.eigvals(A_L).astype(np.complex128),
        output_rank=output_rank,
        lower_bound=lower_bound,
    )


def _blind(model: AffineModel) -> tuple[int, float]:
    """Rank of C by its standard errors, and 6 max ‖A b‖² over unit b in its kernel."""
    _, sigma, Vt = np.linalg.svd(model.C)
    floor = max(2 * float(np.linalg.norm(model.standard_errors[1])), KERNEL * float(sigma[0]))
    rank = int(np.sum(sigma > floor))
    kernel = Vt[rank:].T  # n x (n - rank)
    return rank, float(6 * np.linalg.norm(model.A @ kernel, 2) ** 2) if kernel.size else 0.0
