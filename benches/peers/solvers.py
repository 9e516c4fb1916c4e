"""Peers on the reduced quadratic programme: functions that prepare a case and return one that
solves its window k."""

import importlib
from collections.abc import Callable, Iterator

import numpy as np
from cases import Array, Case, Reduced

Solve = Callable[[int], tuple[Array | None, bool]]
"""Window number to (t, whether the solver claims success)."""


def quadprog(q: Reduced) -> Solve:
    """Goldfarb and Idnani's method, from scratch at every window."""
    solver = importlib.import_module("quadprog")
    G, a = np.eye(q.A.shape[1]), np.zeros(q.A.shape[1])
    C = np.ascontiguousarray(np.vstack([q.A, -q.A]).T)

    def solve(k: int) -> tuple[Array | None, bool]:
        return solver.solve_qp(G, a, C, np.concatenate([q.lower[k], -q.upper[k]]))[0], True

    return solve


def daqp(q: Reduced, tolerance: float = 1e-6) -> Solve:
    """DAQP's Python interface, which sets up anew at every call."""
    solver = importlib.import_module("daqp")
    H, f = np.eye(q.A.shape[1]), np.zeros(q.A.shape[1])
    sense = np.zeros(len(q.A), dtype=np.intc)

    def solve(k: int) -> tuple[Array | None, bool]:
        t, _, flag, _ = solver.solve(H, f, q.A, q.upper[k], q.lower[k], sense, primal_tol=tolerance)
        return t, flag == 1

    return solve


def piqp(q: Reduced, tolerance: float = 1e-8) -> Solve:
    """PIQP, dense, updated in place."""
    module = importlib.import_module("piqp")
    solver = module.DenseSolver()
    solver.settings.verbose = False
    solver.settings.eps_abs = solver.settings.eps_rel = tolerance
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = tolerance
    n = q.A.shape[1]
    solver.setup(np.eye(n), np.zeros(n), None, None, q.A, q.lower[0], q.upper[0])

    def solve(k: int) -> tuple[Array | None, bool]:
        solver.update(h_l=q.lower[k], h_u=q.upper[k])
        return np.array(solver.result.x) if (
            ok := solver.solve() == module.PIQP_SOLVED
        ) else None, ok

    return solve


def proxqp(q: Reduced, tolerance: float = 1e-5) -> Solve:
    """ProxQP, dense, warm-started with its previous result."""
    module = importlib.import_module("proxsuite").proxqp
    m, n = q.A.shape
    solver = module.dense.QP(n, 0, m)
    solver.settings.eps_abs = tolerance
    solver.settings.initial_guess = module.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
    solver.init(np.eye(n), np.zeros(n), None, None, q.A, q.lower[0], q.upper[0])
    solver.solve()  # proxsuite 0.8 crashes if the first solve comes after an update

    def solve(k: int) -> tuple[Array | None, bool]:
        solver.update(l=q.lower[k], u=q.upper[k])
        solver.solve()
        return np.array(solver.results.x), solver.results.info.status == module.PROXQP_SOLVED

    return solve


def osqp(q: Reduced, tolerance: float = 1e-3) -> Solve:
    """OSQP, updated in place and warm-started."""
    module, sparse = importlib.import_module("osqp"), importlib.import_module("scipy.sparse")
    n = q.A.shape[1]
    solver = module.OSQP()
    solver.setup(
        sparse.identity(n, format="csc"),
        np.zeros(n),
        sparse.csc_matrix(q.A),
        q.lower[0],
        q.upper[0],
        verbose=False,
        eps_abs=tolerance,
        eps_rel=tolerance,
        max_iter=20_000,
    )

    def solve(k: int) -> tuple[Array | None, bool]:
        solver.update(l=q.lower[k], u=q.upper[k])
        result = solver.solve(raise_error=False)
        return result.x, result.info.status == "solved"

    return solve


def clarabel(q: Reduced, tolerance: float = 1e-8) -> Solve:
    """Clarabel's Python interface, updated in place."""
    module, sparse = importlib.import_module("clarabel"), importlib.import_module("scipy.sparse")
    m, n = q.A.shape
    settings = module.DefaultSettings()
    settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    A = sparse.csc_matrix(np.vstack([q.A, -q.A]))
    P = sparse.identity(n, format="csc")
    b = np.concatenate([q.upper[0], -q.lower[0]])
    solver = module.DefaultSolver(P, np.zeros(n), A, b, [module.NonnegativeConeT(2 * m)], settings)

    def solve(k: int) -> tuple[Array | None, bool]:
        solver.update(b=np.concatenate([q.upper[k], -q.lower[k]]))
        result = solver.solve()
        return np.array(result.x), str(result.status) == "Solved"

    return solve


def qpoases(q: Reduced) -> Solve:
    """QpOASES through CasADi, warm-started."""
    ca = importlib.import_module("casadi")
    n = q.A.shape[1]
    H, A = ca.DM.eye(n), ca.DM(q.A)
    options = {"printLevel": "none", "error_on_fail": False}
    solver = ca.conic(
        "solver", "qpoases", {"h": ca.Sparsity.dense(n, n), "a": A.sparsity()}, options
    )
    H = ca.DM(np.eye(n))

    def solve(k: int) -> tuple[Array | None, bool]:
        found = solver(h=H, g=np.zeros(n), a=A, lba=q.lower[k], uba=q.upper[k])
        return np.array(found["x"]).ravel(), bool(solver.stats()["success"])

    return solve


def cvxpy_reduced(q: Reduced, solver: str) -> Solve:
    """Cvxpy on the reduced problem with parameters (DPP)."""
    cp = importlib.import_module("cvxpy")
    m, n = q.A.shape
    t, lower, upper = cp.Variable(n), cp.Parameter(m), cp.Parameter(m)
    problem = cp.Problem(cp.Minimize(cp.sum_squares(t)), [q.A @ t <= upper, q.A @ t >= lower])

    def solve(k: int) -> tuple[Array | None, bool]:
        lower.value, upper.value = q.lower[k], q.upper[k]
        try:
            problem.solve(solver=solver)
        except cp.error.SolverError:
            return None, False
        return t.value, problem.status == "optimal"

    return solve


def cvxpy_verbatim(case: Case, solver: str) -> Solve:
    """Cvxpy on (16) as printed, over alpha, every direction of the data: another estimator where
    the rank is cut."""
    cp = importlib.import_module("cvxpy")
    q, M = case.reduced, case.horizon
    n, p = case.x.shape[1], case.y.shape[1]
    H_x = np.array([case.x[k : k + M + 1].ravel() for k in range(len(case.y) - M + 1)]).T
    H_y = np.array([case.y[k : k + M].ravel() for k in range(len(case.y) - M + 1)]).T
    alpha, y, prior = cp.Variable(H_x.shape[1]), cp.Parameter(M * p), cp.Parameter(n)
    x, v = H_x @ alpha, y - H_y @ alpha
    weight = np.sqrt(case.mu * np.repeat(0.9 ** np.arange(M - 1, -1, -1.0), p))
    cost = 2 * 0.9**M * cp.sum_squares(x[:n] - prior) + cp.sum_squares(cp.multiply(weight, v))
    bound = min(case.v_bound, 1e3)
    problem = cp.Problem(
        cp.Minimize(cost), [cp.sum(alpha) == 1, cp.abs(x) <= 1e3, cp.abs(v) <= bound]
    )

    def solve(k: int) -> tuple[Array | None, bool]:
        step = case.steps[k]
        y.value, prior.value = case.outputs[step - M : step].ravel(), case.x_hat[step - M - 1]
        try:
            problem.solve(solver=solver)
        except cp.error.SolverError:
            return None, False
        if alpha.value is None:
            return None, False
        # so that A_x t + x_free is its estimate
        x_hat = (H_x @ alpha.value)[-n:]
        return np.linalg.lstsq(q.A_x, x_hat - q.x_free[k], rcond=None)[
            0
        ], problem.status == "optimal"

    return solve


def floor(q: Reduced) -> Solve:
    """No solver: z from the data and the whole window, two NumPy products."""
    mean, A = q.window

    def solve(k: int) -> tuple[Array | None, bool]:
        return mean + A @ (q.gain @ q.f[k]), True

    return solve


def contestants(case: Case) -> Iterator[tuple[str, Callable[[], Solve], int]]:
    """Name, preparation, and on how many windows of a round it is timed."""
    q = case.reduced
    yield "NumPy: the two products alone", lambda: floor(q), 200
    yield "quadprog", lambda: quadprog(q), 200
    yield "DAQP (Python)", lambda: daqp(q), 200
    yield "DAQP (Python), 1e-11", lambda: daqp(q, 1e-11), 200
    yield "PIQP", lambda: piqp(q), 50
    yield "PIQP, 1e-10", lambda: piqp(q, 1e-10), 20
    yield "ProxQP", lambda: proxqp(q), 50
    yield "ProxQP, 1e-10", lambda: proxqp(q, 1e-10), 50
    yield "OSQP", lambda: osqp(q), 50
    yield "OSQP, 1e-9", lambda: osqp(q, 1e-9), 10
    yield "qpOASES (CasADi)", lambda: qpoases(q), 50
    yield "Clarabel", lambda: clarabel(q), 20
    yield "Clarabel, 1e-12", lambda: clarabel(q, 1e-12), 20
    for solver in ("CLARABEL", "OSQP", "SCS"):
        yield f"cvxpy, reduced, {solver}", lambda solver=solver: cvxpy_reduced(q, solver), 3
    for solver in ("CLARABEL", "OSQP", "SCS"):
        yield (
            f"cvxpy, (16) verbatim, {solver}",
            lambda solver=solver: cvxpy_verbatim(case, solver),
            1,
        )
