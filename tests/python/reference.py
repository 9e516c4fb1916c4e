"""Independent references for the estimator: (16) written down verbatim, model-based MHE, recursive
least squares.

Used only by tests. Nothing here shares code or formulation with the package: no centring, no
scaling, no basis."""

from dataclasses import dataclass

import numpy as np
import quadprog
import scipy.optimize


@dataclass(frozen=True)
class Affine:
    """x(t+1) = A x + e, y = C x + r."""

    A: np.ndarray
    e: np.ndarray
    C: np.ndarray
    r: np.ndarray

    def simulate(self, x0, steps):
        """States (steps+1, n) and outputs (steps, p)."""
        x, y = [np.asarray(x0, float)], []
        for _ in range(steps):
            y.append(self.C @ x[-1] + self.r)
            x.append(self.A @ x[-1] + self.e)
        return np.array(x), np.array(y)


def random_system(rng, n, p):
    """An observable affine system with persistent modes, so that one recording excites all of them.

    Eigenvalues are drawn apart from each other near the unit circle; poorly observable draws are
    rejected."""
    while True:
        blocks, left = [], n
        while left:
            radius = rng.uniform(0.97, 1.0)
            if left >= 2 and rng.random() < 0.7:
                angle = rng.uniform(0.3, 2.8)
                blocks.append(
                    radius
                    * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                )
                left -= 2
            else:
                blocks.append(np.array([[radius * rng.choice([-1.0, 1.0])]]))
                left -= 1
        J = np.zeros((n, n))
        k = 0
        for block in blocks:
            J[k : k + len(block), k : k + len(block)] = block
            k += len(block)
        V = np.linalg.qr(rng.standard_normal((n, n)))[0] @ np.diag(rng.uniform(0.5, 2.0, n))
        A = V @ J @ np.linalg.inv(V)
        C = rng.standard_normal((p, n))
        observability = np.vstack([C @ np.linalg.matrix_power(A, k) for k in range(n)])
        apart = np.linalg.eigvals(J)
        gap = min((abs(a - b) for i, a in enumerate(apart) for b in apart[:i]), default=1.0)
        if np.linalg.cond(observability) < 200 and gap > 0.15:
            return Affine(A, rng.standard_normal(n) * 0.1, C, rng.standard_normal(p))


def hankel(signal, depth):
    """Block Hankel matrix (Definition 1), depth·width x columns."""
    return np.array([signal[k : k + depth].ravel() for k in range(len(signal) - depth + 1)]).T


def printed_bounds(H_x, H_y, y, M, x_bounds, v_bounds):
    """(16c) and (16d) with v = y - H_y alpha as rows @ alpha <= limits."""
    N = H_x.shape[1]
    rows, limits = [np.zeros((0, N))], [np.zeros(0)]
    if x_bounds is not None:
        rows += [-H_x, H_x]
        limits += [-np.tile(x_bounds[0], M + 1), np.tile(x_bounds[1], M + 1)]
    if v_bounds is not None:
        rows += [H_y, -H_y]
        limits += [y - np.tile(v_bounds[0], M), np.tile(v_bounds[1], M) - y]
    return np.vstack(rows), np.concatenate(limits)


def least_cost(D, d, rows, limits):
    """The shortest alpha of least ‖D alpha - d‖ among those with rows @ alpha = limits and
    1ᵀalpha = 1."""
    fixed = np.vstack([rows, np.ones((1, D.shape[1]))])
    alpha = np.linalg.lstsq(fixed, np.append(limits, 1.0), rcond=1e-11)[0]
    _, sigma, Vt = np.linalg.svd(fixed)
    Z = Vt[(sigma > 1e-11 * sigma[0]).sum() :].T
    U, sigma, Vt = np.linalg.svd(D @ Z, full_matrices=False)
    # not relative to D Z: the active rows may leave it nothing but rounding
    kept = sigma > 1e-11 * np.linalg.norm(D)
    return alpha + Z @ (Vt[kept].T @ (U[:, kept].T @ (d - D @ alpha) / sigma[kept]))


def prove_optimal(D, d, rows, alpha, shortest):
    """Multipliers >= 0 of the active rows balance the cost's gradient, that of 1ᵀalpha = 1 is free;
    with `shortest` they do so for ‖alpha‖ among the minimisers, too."""
    gradient = 2 * D.T @ (D @ alpha - d)
    ones = np.ones(len(alpha))
    normals = np.column_stack([rows.T, ones, -ones])
    scale = max(np.abs(gradient).max(), np.abs(2 * D.T @ d).max() * 1e-6, 1e-9)
    _, unbalanced = scipy.optimize.nnls(normals, -gradient / scale)
    assert unbalanced < 1e-6
    if shortest:
        others = np.column_stack([D.T, -D.T]) / np.linalg.norm(D)  # given: multipliers of any sign
        _, unbalanced = scipy.optimize.nnls(
            np.column_stack([normals, others]), -alpha / np.linalg.norm(alpha)
        )
        assert unbalanced < 1e-7


def verbatim(
    x_hist, y_hist, y_window, prior, rho, mu, x_bounds=None, v_bounds=None, *, near, near_v=None
):
    """Problem (16) with cost (17), exactly as printed, over α. Returns (window, v, cost), proven
    optimal.

    Interior-point solvers stop near 1e-5 on it or fail (its Hessian is singular in most of α), so
    it is solved as a mathematician would: guess the active bounds (`near` is any window close to
    the answer), solve the equality constrained least squares for α, then prove optimality with
    multipliers from non-negative least squares. With `near_v`, the fitted noise beside that window,
    α is proved to be the shortest one of least cost, too."""
    M, n, p = len(y_window), x_hist.shape[1], y_hist.shape[1]
    H_y, H_x = hankel(y_hist, M), hankel(x_hist, M + 1)
    N, y = H_y.shape[1], y_window.ravel()
    rows, limits = printed_bounds(H_x, H_y, y, M, x_bounds, v_bounds)
    discount = np.repeat(np.sqrt(rho ** np.arange(M - 1, -1, -1.0)), p)
    D = np.vstack([np.sqrt(2 * rho**M) * H_x[:n], np.sqrt(mu) * discount[:, None] * H_y])
    d = np.concatenate(
        [np.sqrt(2 * rho**M) * prior, np.sqrt(mu) * discount * y]
    )  # cost = ‖D alpha - d‖²

    shown, seen = [H_x, np.ones((1, N))], [near.ravel(), [1.0]]
    if near_v is not None:
        shown, seen = [*shown, H_y], [*seen, y - near_v.ravel()]
    guess = np.linalg.lstsq(np.vstack(shown), np.concatenate(seen), rcond=1e-11)[0]
    active = limits - rows @ guess < 1e-7
    alpha = least_cost(D, d, rows[active], limits[active])
    assert (rows @ alpha <= limits + 1e-8).all()
    assert abs(alpha.sum() - 1) < 1e-10
    prove_optimal(D, d, rows[active], alpha, shortest=near_v is not None)
    return (
        (H_x @ alpha).reshape(M + 1, n),
        (y - H_y @ alpha).reshape(M, p),
        float(np.sum((D @ alpha - d) ** 2)),
    )


def model_based(system, y_window, prior, rho, mu, x_bounds=None, v_bounds=None):
    """The same estimate from the true (A, e, C, r): a dense QP in x̂(t-M) for quadprog (Goldfarb,
    Idnani)."""
    M, n = len(y_window), len(prior)
    p = len(system.r)
    powers, offsets = [np.eye(n)], [np.zeros(n)]
    for _ in range(M):
        powers.append(system.A @ powers[-1])
        offsets.append(system.A @ offsets[-1] + system.e)
    states, constant = (
        np.vstack(powers),
        np.concatenate(offsets),
    )  # window = states @ x_0 + constant
    outputs = np.vstack([system.C @ power for power in powers[:M]])
    residual = y_window.ravel() - np.concatenate(
        [system.C @ o + system.r for o in offsets[:M]]
    )  # v = residual - outputs x_0
    weight = np.repeat(mu * rho ** np.arange(M - 1, -1, -1.0), p)
    H = 2 * rho**M * np.eye(n) + outputs.T @ (weight[:, None] * outputs)
    g = 2 * rho**M * prior + outputs.T @ (weight * residual)
    rows, limits = [], []  # rows @ x_0 >= limits
    if x_bounds is not None:
        rows += [states, -states]
        limits += [np.tile(x_bounds[0], M + 1) - constant, constant - np.tile(x_bounds[1], M + 1)]
    if v_bounds is not None:
        rows += [-outputs, outputs]
        limits += [np.tile(v_bounds[0], M) - residual, residual - np.tile(v_bounds[1], M)]
    if rows:
        x_0 = quadprog.solve_qp(H, g, np.vstack(rows).T.copy(), np.concatenate(limits))[0]
    else:
        x_0 = np.linalg.solve(H, g)
    v = residual - outputs @ x_0
    cost = 2 * rho**M * np.sum((x_0 - prior) ** 2) + np.sum(weight * v**2)
    return (states @ x_0 + constant).reshape(M + 1, n), v.reshape(M, p), cost


def recursive_least_squares(system, y, prior, rho, mu):
    """x̂(1), x̂(2), … by recursive least squares on x(0) with forgetting factor ρ, moved forward by
    the model."""
    n = len(prior)
    theta, P = np.array(prior, float), np.eye(n) / 2
    power, offset, estimates = np.eye(n), np.zeros(n), []
    for sample in y:
        phi = system.C @ power
        predicted = phi @ theta + system.C @ offset + system.r
        K = P @ phi.T @ np.linalg.inv(rho / mu * np.eye(len(sample)) + phi @ P @ phi.T)
        theta = theta + K @ (sample - predicted)
        P = (P - K @ phi @ P) / rho
        power, offset = system.A @ power, system.A @ offset + system.e
        estimates.append(power @ theta + offset)
    return np.array(estimates)


def largest_eigenvalue(c, A, C):
    """Of a certificate's inequality (L) for the system (A, C)."""
    top = np.hstack([A.T @ c.P @ A - c.eta * c.P - C.T @ c.R @ C, A.T @ c.P])
    return np.linalg.eigvalsh(np.vstack([top, np.hstack([c.P @ A, c.P - c.Q])]))[-1]
