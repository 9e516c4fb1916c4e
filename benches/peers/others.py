"""Peers that are other estimators: they need a model, identified here from the same recording by
least squares."""

import importlib
from collections.abc import Callable

import numpy as np
from cases import RHO, Array, Case

Estimate = Callable[[int], Array]
"""Step number t to x(t)."""


def identified(case: Case) -> tuple[Array, Array, Array, Array]:
    """A, e, C, r of x(t+1) = A x(t) + e, y(t) = C x(t) + r."""
    X = np.column_stack([case.x[:-1], np.ones(len(case.y))])
    step, output = (
        np.linalg.lstsq(X, case.x[1:], rcond=None)[0],
        np.linalg.lstsq(X, case.y, rcond=None)[0],
    )
    return step[:-1].T, step[-1], output[:-1].T, output[-1]


def kalman(case: Case) -> Estimate:
    """filterpy's Kalman filter."""
    filters = importlib.import_module("filterpy.kalman")
    A, e, C, r = identified(case)
    n, p = len(A), len(C)
    kf = filters.KalmanFilter(dim_x=n, dim_z=p, dim_u=1)
    kf.F, kf.B, kf.H = A, e[:, None], C
    kf.R, kf.Q, kf.P = np.eye(p) / case.mu, np.eye(n) * 1e-6, np.eye(n)
    kf.x = case.x_hat[case.steps.start - 2][:, None].copy()
    u = np.ones(1)

    def estimate(t: int) -> Array:
        kf.update(case.outputs[t - 1] - r)
        kf.predict(u=u)
        return np.asarray(kf.x).ravel()

    return estimate


def do_mpc(case: Case) -> Estimate:
    """do-mpc's moving horizon estimator (IPOPT) with this case's weights, horizon and bounds on the
    states."""
    module = importlib.import_module("do_mpc")
    A, e, C, r = identified(case)
    n, p, M = len(A), len(C), case.horizon
    model = module.model.Model("discrete")
    x = model.set_variable("_x", "x", (n, 1))
    model.set_rhs("x", A @ x + e[:, None], process_noise=False)
    model.set_meas("y", C @ x + r[:, None], meas_noise=True)
    model.setup()
    mhe = module.estimator.MHE(model)
    mhe.settings.n_horizon, mhe.settings.t_step = M, 0.1
    mhe.settings.meas_from_data, mhe.settings.store_full_solution = True, False
    mhe.settings.supress_ipopt_output()
    mhe.set_default_objective(2 * RHO**M * np.eye(n), case.mu * np.eye(p))
    mhe.bounds["lower", "_x", "x"], mhe.bounds["upper", "_x", "x"] = -1e3, 1e3
    mhe.setup()
    mhe.x0 = case.x_hat[case.steps.start - 2]
    mhe.set_initial_guess()

    def estimate(t: int) -> Array:
        return np.asarray(mhe.make_step(case.outputs[t - 1][:, None])).ravel()

    return estimate
