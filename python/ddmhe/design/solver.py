"""Running a semidefinite programme: the only place that calls the solver."""

from __future__ import annotations

import warnings
from typing import Any

__all__ = ["solve"]


def solve(problem: Any) -> bool:
    """Whether Clarabel found a point of the cvxpy problem; what it is worth is for eigenvalues to
    say."""
    import cvxpy as cp

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return False
    return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)
