"""Which estimator when: Dd-MHE beside the estimators that identify a model, on the same logs.

Run with `make study-estimators`; prints the tables of docs/estimators.md. The robot's and the car's
logs take part if DDMHE_DATA, or ../shared/data beside the checkout, holds them, and do-mpc (CasADi,
IPOPT) if it is installed, as in the environment of `make bench-peers`.

Every estimator has its own defaults, starts where the log starts and sees the same numbers."""

import importlib.util
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.linalg

import ddmhe
from ddmhe.baselines import ErrorStateKalman, ModelMhe
from ddmhe.cases import bench, satellite

DATA = Path(os.environ.get("DDMHE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
PEER_STEPS = slice(60, 200)
"""Where do-mpc is compared: from when its window, which starts padded, is full and forgotten; it
takes some 10 ms a step."""


@dataclass(frozen=True)
class Log:
    """A recording, the outputs (N, p) and inputs (N, m) after it, the states (N, n) they should
    give."""

    history: ddmhe.History
    Y: np.ndarray
    U: np.ndarray | None
    truth: np.ndarray
    start: np.ndarray | None = None
    """State at the first output, where the log does not go on from the recording."""
    relative: bool = False
    scale: float = 1.0

    def error(self, x_hat, steps):
        """RMSE of all states together, or relative to each state's spread."""
        squares = ((x_hat - self.truth[: len(x_hat)]) ** 2)[steps]
        if self.relative:
            spread = self.truth.var(axis=0)
            return float(np.sqrt((squares.mean(axis=0) / spread).mean()))
        return float(np.sqrt(squares.sum(axis=1).mean())) * self.scale


def masses(seed, x_noise):
    """Two masses between springs, positions measured; disturbance 1e-3, output noise .02."""
    k_1, k_2, c, dt, T, N = 1.0, 0.7, 0.05, 0.1, 200, 1000
    rates = [[0, 1, 0, 0], [-k_1 - k_2, -c, k_2, 0], [0, 0, 0, 1], [k_2, 0, -k_1 - k_2, -c]]
    A, C = scipy.linalg.expm(np.array(rates) * dt), np.eye(4)[[0, 2]]
    rng = np.random.default_rng(seed)
    x = [np.array([1.0, 0.0, -0.5, 0.0])]
    for _ in range(T + N):
        x.append(A @ x[-1] + 1e-3 * rng.standard_normal(4))
    x = np.array(x)
    y = x[:-1] @ C.T + 0.02 * rng.standard_normal((T + N, 2))
    read = x[: T + 1] + x_noise * rng.standard_normal((T + 1, 4))
    return Log(ddmhe.History(read, y[:T], dt), y[T:], None, x[T + 1 :])


def detumbling(seed, seconds):
    """The paper's satellite, torque noise .01 N·m, recorded states 1e-4 rad/s; deg/s."""
    model, T, N = ddmhe.models.detumbling(), satellite.T, round(seconds / satellite.DT)
    record = model.simulate(20.0 + seconds + 1, satellite.DT, noise=0.01, seed=seed)
    rng = np.random.default_rng(10_000 + seed)
    x = record.x[: T + 1] + 1e-4 * rng.standard_normal((T + 1, 3))
    history = ddmhe.History(x, record.y[:T], satellite.DT, x_units="rad/s", y_units="N·m")
    truth = record.x[T + 1 : T + 1 + N]
    return Log(history, record.y[T : T + N], None, truth, scale=180 / np.pi)


def single_axis(seed, *, noisy=False, kicked=False):
    """The paper's bench, its encoder rounding the recorded state; rad/s."""
    own, T = bench.NOMINAL, round(bench.HISTORY / bench.DT)
    steps = round(bench.DURATION / bench.DT)
    t, kick = bench.DT * np.arange(steps + 1), np.zeros((steps, 1))
    if kicked:
        during = (t[:-1] >= bench.EVENT[0]) & (t[:-1] < bench.EVENT[0] + 0.1)
        kick[during] = own.kick / during.sum()
    record = own.model.simulate(bench.DURATION, bench.DT, disturbance=kick)
    level = np.full(steps + 1, own.deviation)
    if noisy:
        event = (t >= bench.EVENT[0]) & (t < bench.EVENT[1])
        level[event] *= bench.LARGE_NOISE / bench.NOISE
    y = record.y + level[:, None] * np.random.default_rng(seed).standard_normal(record.y.shape)
    history = ddmhe.History(record.x_recorded[: T + 1], y[:T], bench.DT)
    return Log(history, y[T:-1], None, record.x[T + 1 :])


def real(kind, columns, recorded, test, dt):
    """A recorded log with inputs; the error of each state over its spread."""

    def read(number):
        table = pd.read_csv(DATA / "input-logs" / f"{kind}_{number}.csv")
        return [table[list(names)].to_numpy(float) for names in columns]

    parts = []
    for number in recorded:
        x, y, u = read(number)
        parts.append(ddmhe.History(x, y[:-1], dt, u=u[:-1]))
    x, y, u = read(test)
    return Log(ddmhe.History.concat(parts), y[:-1], u[:-1], x[1:], x[0], relative=True)


ROBOT = (
    ("w1_rad_s", "w2_rad_s", "w3_rad_s"),
    ("q1_rad", "q2_rad", "q3_rad"),
    ("tau1_Nm", "tau2_Nm", "tau3_Nm"),
)


def groups():
    """Name of each case and its logs."""
    seeds = range(5)
    yield "two masses, exact states", [masses(s, 0.0) for s in seeds]
    yield "two masses, states ± .01", [masses(s, 0.01) for s in seeds]
    for seconds in (20, 40, 100):
        yield f"detumbling, {seconds} s, deg/s", [detumbling(s, seconds) for s in seeds]
    yield "bench, rad/s", [single_axis(s) for s in seeds]
    yield "bench, large noise", [single_axis(s, noisy=True) for s in seeds]
    yield "bench, disturbance", [single_axis(s, kicked=True) for s in seeds]
    if (DATA / "input-logs").is_dir():
        tests = ("11", "12", "13")
        logs = [real("robot", ROBOT, ("01", "02"), test, 0.016) for test in tests]
        yield "robot arm with torques, NRMSE", logs
        ignorant = [
            Log(h.history.without_inputs(), h.Y, None, h.truth, h.start, True) for h in logs
        ]
        yield "the same, torques ignored", ignorant


def data_driven(log, **settings):
    if log.start is None:
        return ddmhe.DdMhe(log.history, **settings)
    return ddmhe.DdMhe(log.history, start="state", x_prior=log.start, **settings)


class DoMpc:
    """do-mpc's MHE on the identified model, weights from its residual covariances, no bounds.

    Its output y(k) is that of the state after u(k), so it is given u(k-1) beside y(k) - D u(k), and
    its estimate, of the state at y(k), is moved on by the model."""

    def __init__(self, log):
        own = ModelMhe(log.history, weights="recorded", process_noise="residual", x_prior=log.start)
        self.fit, n, m = own.model, own.n, own.m
        module = importlib.import_module("do_mpc")
        model = module.model.Model("discrete")
        x = model.set_variable("_x", "x", (n, 1))
        step = self.fit.A @ x + self.fit.e[:, None]
        if m:
            u = model.set_variable("_u", "u", (m, 1))
            step = step + self.fit.B @ u
            model.set_meas("u_meas", u, meas_noise=False)
        model.set_rhs("x", step, process_noise=True)
        model.set_meas("y", self.fit.C @ x + self.fit.r[:, None], meas_noise=True)
        model.setup()
        self.mhe = module.estimator.MHE(model)
        settings = self.mhe.settings
        settings.n_horizon, settings.t_step = own.horizon, log.history.dt
        settings.meas_from_data, settings.store_full_solution = True, False
        settings.supress_ipopt_output()
        P, Q, R = (
            np.linalg.inv(each) for each in (own._weights.P, own.Q, self.fit.residual[n:, n:])
        )
        size = 1 / np.abs(R).max()  # IPOPT's tolerances are absolute
        self.mhe.set_default_objective(P_x=size * P, P_v=size * R, P_w=size * Q)
        self.mhe.setup()
        self.mhe.x0 = own._default_prior
        self.mhe.set_initial_guess()
        self.before = np.zeros(m)

    def step(self, y, u=None):
        u = np.zeros(0) if u is None else u
        known = np.concatenate([self.before, y - self.fit.D @ u])
        self.before = u
        x = np.asarray(self.mhe.make_step(known[:, None])).ravel()
        return self.fit.A @ x + self.fit.B @ u + self.fit.e

    def run(self, Y, U=None):
        rows = [self.step(y, None if U is None else U[k]) for k, y in enumerate(Y)]
        return ddmhe.baselines.Log(np.array(rows))


ESTIMATORS = {
    "DdMhe": data_driven,
    "DdMhe, scaled": lambda log: data_driven(log, weights="scaled"),
    "ModelMhe, paper": lambda log: ModelMhe(log.history, x_prior=log.start),
    "ModelMhe, residual": lambda log: ModelMhe(
        log.history, weights="recorded", process_noise="residual", x_prior=log.start
    ),
    "ModelMhe, recorded": lambda log: ModelMhe(
        log.history, weights="recorded", process_noise="recorded", x_prior=log.start
    ),
    "ErrorStateKalman": lambda log: ErrorStateKalman(log.history, x_prior=log.start),
}
PEERS = {"do-mpc": DoMpc} if importlib.util.find_spec("do_mpc") else {}


def median_error(make, logs, steps=slice(None)):
    errors = []
    for log in logs:
        U = None if log.U is None else log.U[: steps.stop]
        errors.append(log.error(make(log).run(log.Y[: steps.stop], U).x, steps))
    return float(np.median(errors))


def accuracy():
    """Median errors, one case a row, and what weights DdMhe takes by default."""
    header = [*ESTIMATORS, "recorded by default"]
    print("| | " + " | ".join(header) + " |\n|---|" + "--:|" * len(header))
    for case, logs in groups():
        cells = [f"{median_error(make, logs):.2g}" for make in ESTIMATORS.values()]
        taken = sum(data_driven(log).weights == "recorded" for log in logs)
        cells.append(f"{taken} of {len(logs)}")
        print(f"| {case} | " + " | ".join(cells) + " |", flush=True)


def peers():
    """Median errors over the steps that peers are given, three logs a case."""
    everybody = PEERS | ESTIMATORS
    print(f"| steps {PEER_STEPS.start} to {PEER_STEPS.stop} | " + " | ".join(everybody) + " |")
    print("|---|" + "--:|" * len(everybody))
    for case, logs in groups():
        if "40 s" not in case and "100 s" not in case:
            cells = [
                f"{median_error(make, logs[:3], PEER_STEPS):.2g}" for make in everybody.values()
            ]
            print(f"| {case.replace(', 20 s', '')} | " + " | ".join(cells) + " |", flush=True)


def microseconds(rounds=15, block=40):
    """Median time of a step with a full window, in one interleaved run: every estimator solves a
    block in each round, in a new order."""
    log = masses(0, 0.01)
    box = {"x_bounds": (-0.4, 0.4)}
    common = {"horizon": 20, "rho": 0.95, "mu": 1.0}
    Q = {"weights": "recorded", "process_noise": "residual", "horizon": 20}
    recorded = {"weights": "recorded", "horizon": 20}
    contestants = {
        "DdMhe, ρ and μ given": ddmhe.DdMhe(log.history, **common),
        "DdMhe, ρ and μ given, box on x": ddmhe.DdMhe(log.history, **common, **box),
        "DdMhe, recorded": ddmhe.DdMhe(log.history, **recorded),
        "DdMhe, recorded, box on x": ddmhe.DdMhe(log.history, **recorded, **box),
        "ModelMhe": ModelMhe(log.history, **common),
        "ModelMhe, box on x": ModelMhe(log.history, **common, **box),
        "ModelMhe with disturbance": ModelMhe(log.history, **Q),
        "ModelMhe with disturbance, box on x": ModelMhe(log.history, **Q, **box),
        "ModelMhe with disturbance, blocks of 5, box": ModelMhe(log.history, **Q, **box, block=5),
        "ErrorStateKalman": ErrorStateKalman(log.history),
        **{name: make(log) for name, make in PEERS.items()},
    }
    times, rng = {name: [] for name in contestants}, np.random.default_rng(0)
    active = {name: [] for name in contestants}
    for estimator in contestants.values():
        for y in log.Y[:60]:
            estimator.step(y)
    for k in range(rounds):
        for name in rng.permutation(list(contestants)):
            for y in log.Y[60 + k * block : 60 + (k + 1) * block]:
                begin = time.perf_counter_ns()
                estimate = contestants[name].step(y)
                times[name].append((time.perf_counter_ns() - begin) / 1e3)
                active[name].append(getattr(estimate, "active", 0))
    print("| µs a step, n = 4, p = 2, M = 20 | median | p90 | with active bounds |")
    print("|---|--:|--:|--:|")
    for name, each in times.items():
        each, held = np.array(each), np.array(active[name]) > 0
        middle, late = np.percentile(each, [50, 90])
        bounded = (
            f"{np.median(each[held]):.3g} ({held.mean():.0%} of the steps)" if any(held) else ""
        )
        print(f"| {name} | {middle:.3g} | {late:.3g} | {bounded} |")


if __name__ == "__main__":
    microseconds()
    print()
    accuracy()
    if PEERS:
        print()
        peers()
