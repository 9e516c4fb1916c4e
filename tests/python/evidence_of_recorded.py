"""Independent reference of the covariance and the novelty of an estimate with the weights of the
recording: a stationary Kalman filter, and what least squares leave of its own model.

With x̂ - x =: ε, F = A - L C and Δ = [ΔA Δe; ΔC Δr] the error of the model,

    ε(t+1) = F ε(t) + [I, -L] Δ [x(t); 1] - w(t) + L v(t)

so that ε has, beside the stationary P, a part Σ_j K_j(t) [I, -L] δ_j: δ_j the error of the model in
the j-th whitened regressor z_j, K_j(t+1) = F K_j(t) + z_j(t) I. The errors of N least-squares steps
of slow motion have the covariance Γ_e = blkdiag(Q, R) + J N Jᵀ, J = [I - A; -C]: reading noise N of
the states enters each step twice, and all but the difference cancels from step to step. It biases
the model as well, by -[A; C] N Σ_x⁻¹."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.stats

from disturbed import fitted, stationary


@dataclass(frozen=True)
class Noises:
    """A model x(k+1) = A x + e, y = C x + r with the covariances of a recording, user's units."""

    A: np.ndarray
    e: np.ndarray
    C: np.ndarray
    r: np.ndarray
    Q: np.ndarray
    N: np.ndarray
    R: np.ndarray
    P: np.ndarray
    """Stationary, of the error of x̂(t) before y(t)."""

    @classmethod
    def of_residuals(cls, history):
        """Those of least squares, all of the states' residuals for that of the disturbance."""
        model = fitted(history)
        none, P = np.zeros_like(model.A), stationary(model, model.gamma)
        return cls(model.A, model.e, model.C, model.r, model.gamma, none, model.R, P)


@dataclass
class Told:
    """x̂ (N, n), Σ (N, n, n), ν (N, p), its covariance (N, p, p), v = NIS/dof and novelty (N,)."""

    x: np.ndarray
    Sigma: np.ndarray
    nu: np.ndarray
    S: np.ndarray
    v: np.ndarray
    novel: np.ndarray


def told(noises, recordings, M, Y, x_prior):
    """Runs the filter over Y and says what it knows of its errors."""
    A, C, Q, R, N, P = (getattr(noises, name) for name in ("A", "C", "Q", "R", "N", "P"))
    n, p, X = len(A), len(C), np.vstack([x[:-1] for x, _ in recordings])
    T, mean = len(X), X.mean(axis=0)
    S_xx = (X - mean).T @ (X - mean)
    whiten = np.linalg.inv(np.linalg.cholesky(S_xx))
    L = A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
    F, steps, J = A - L @ C, np.hstack([np.eye(n), -L]), np.vstack([np.eye(n) - A, -C])
    G_w = steps @ (scipy.linalg.block_diag(Q, R) + J @ N @ J.T) @ steps.T
    bias = -F @ N @ np.linalg.inv(S_xx / T)
    few = (T + n + 1) / (T - n - 1)
    x, K, b, Sigma = np.array(x_prior), np.zeros((n + 1, n, n)), np.zeros(n), few * P
    result = Told(*(np.zeros((len(Y), *shape)) for shape in
                    ((n,), (n, n), (p,), (p, p), (), ())))  # fmt: skip
    scores = []
    for t, y in enumerate(Y):
        nu, S = y - C @ x - noises.r, C @ Sigma @ C.T + few * R
        scores = [*scores, float(nu @ np.linalg.solve(S, nu))][-M:]
        dof = p * len(scores)
        z = np.r_[whiten @ (x - mean), 1 / np.sqrt(T)]
        K = F @ K + z[:, None, None] * np.eye(n)
        b = F @ b + bias @ (x - mean)
        x = A @ x + noises.e + L @ nu
        Sigma = few * (P + sum(k @ G_w @ k.T for k in K) + np.outer(b, b))
        v = sum(scores) / dof
        large = max(1.0, v) if len(scores) == M else 1.0
        result.x[t], result.Sigma[t], result.nu[t], result.S[t] = x, large * Sigma, nu, S
        result.v[t], result.novel[t] = v, sum(scores) > scipy.stats.chi2.ppf(0.9999, dof)
    return result
