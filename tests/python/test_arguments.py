"""Every public function and class, attacked argument by argument: it works, or one clear error
names the argument."""

import numpy as np
import pandas as pd
import pytest

import ddmhe
from ddmhe import baselines, config, design, interval, logs, models

RNG = np.random.default_rng(0)
X, Y = RNG.standard_normal((41, 2)), RNG.standard_normal((40, 1))
H = ddmhe.History(X, Y, dt=0.1)
A, C = np.array([[0.9, 0.2], [-0.2, 0.9]]), np.array([[1.0, 0.3]])
S = interval.System(A, C, np.eye(2), np.eye(1), None, None, np.zeros((2, 2)), np.zeros((2, 2)))
G = interval.fixed_gain(S, [[0.3], [0.1]])
Z = ddmhe.Zonotope([0.0, 1.0], np.eye(2))
CERTIFICATE = design.ioss(A=A, C=C, eta=0.95)
NOISE = design.RecordingNoise(y=9.0, w=9.0)
DRIVEN = ddmhe.History(X, Y, u=np.random.default_rng(5).standard_normal(Y.shape))


def short_history():
    """n + p differences whose outputs show both states: Algorithm 2 has a gain for it at once."""
    x = np.array([np.linalg.matrix_power(A, k) @ [1.0, 0.0] for k in range(6)])
    x += 1e-6 * np.random.default_rng(0).standard_normal(x.shape)
    y = x[:-1] @ np.array([[1.0, 0.3], [0.0, 1.0]]).T
    return ddmhe.History(x, y + 1e-6 * np.random.default_rng(1).standard_normal(y.shape))


CALLS = {
    "History": (ddmhe.History, {"x": X, "y": Y, "dt": 0.1}),
    "History with inputs": (ddmhe.History, {"x": X, "y": Y, "u": Y}),
    "History.concat": (ddmhe.History.concat, {"histories": [H, H]}),
    "History.rank": (H.rank, {"depth": 3}),
    "DdMhe": (
        ddmhe.DdMhe,
        {
            "history": H,
            "horizon": 5,
            "rho": 0.9,
            "mu": 1.0,
            "x_prior": [0.0, 0.0],
            "x_bounds": (-9.0, 9.0),
            "x_center": "history",
            "v_bounds": (-9.0, 9.0),
            "equilibrium": ([0.0, 0.0], [0.0]),
            "warm_start": False,
            "space": "auto",
        },
    ),
    "DdMhe with a certificate": (
        lambda certificate, disturbance: ddmhe.DdMhe(
            H, certificate=certificate, disturbance=disturbance
        ),
        {"certificate": CERTIFICATE, "disturbance": None},
    ),
    "DdMhe.step": (
        lambda **given: ddmhe.DdMhe(H, 5).step(**given),
        {"y_t": [0.1], "x_bounds": (-9.0, 9.0), "out": None},
    ),
    "DdMhe.run": (lambda **given: ddmhe.DdMhe(H, 5).run(**given), {"Y": Y[:3], "out": None}),
    "DdMhe.step with inputs": (
        lambda **given: ddmhe.DdMhe(DRIVEN, 5).step(**given),
        {"y_t": [0.1], "u": [0.1], "out": None},
    ),
    "DdMhe.run with inputs": (
        lambda **given: ddmhe.DdMhe(DRIVEN, 5).run(**given),
        {"Y": Y[:3], "U": Y[:3]},
    ),
    "run_many with inputs": (
        ddmhe.run_many,
        {"estimators": ddmhe.DdMhe(DRIVEN, 5), "logs": [Y[:3]], "inputs": [Y[:3]]},
    ),
    "DdMhe.reset": (lambda **given: ddmhe.DdMhe(H, 5).reset(**given), {"x_prior": [0.0, 0.0]}),
    "DdMhe.restore": (ddmhe.DdMhe.restore, {"blob": ddmhe.DdMhe(H, 5).snapshot()}),
    "run_many": (
        lambda estimators, logs: ddmhe.run_many(estimators, logs),
        {"estimators": ddmhe.DdMhe(H, 5), "logs": [Y[:3]]},
    ),
    "Truncated": (
        lambda **given: ddmhe.DdMhe(H, 5, space=ddmhe.Truncated(**given)),
        {"rank": 2, "tol": 0.1},
    ),
    "Ridge": (
        lambda **given: ddmhe.DdMhe(H, 5, space=ddmhe.Ridge(**given)),
        {"weight": 0.1, "normalised": False},
    ),
    "Zonotope": (ddmhe.Zonotope, {"center": [0.0, 1.0], "generators": np.eye(2)}),
    "Zonotope.linear_map": (Z.linear_map, {"A": A}),
    "Zonotope.interval_map": (Z.interval_map, {"A_lo": A, "A_hi": A}),
    "Zonotope.translate": (Z.translate, {"v": [0.0, 1.0]}),
    "Zonotope.minkowski_sum": (Z.minkowski_sum, {"other": Z}),
    "Zonotope.reduce": (Z.reduce, {"q": 2, "method": "pca"}),
    "Zonotope.contains": (Z.contains, {"x": [0.0, 1.0]}),
    "Zonotope.support": (Z.support, {"d": [0.0, 1.0]}),
    "minimum_horizon": (design.minimum_horizon, {"rho": 0.9}),
    "identify": (design.identify, {"history": H, "method": "least squares"}),
    "AffineModel.simulate": (design.identify(H).simulate, {"x_0": [0.0, 1.0], "steps": 3}),
    "ioss of a recording": (
        design.ioss,
        {"history": H, "eta": 0.95, "condition": None, "noise": None, "gains": (1.0, 1.0)},
    ),
    "ioss of a system": (
        lambda **given: design.ioss(**given, eta=0.95),
        {"A": A, "C": C, "B": np.eye(2), "D": np.zeros((1, 2))},
    ),
    "scalar_certificate": (
        design.scalar_certificate,
        {"A": 0.1 * A, "C": C, "gain": np.zeros((2, 1)), "rho": 0.9, "mu": 10.0},
    ),
    "consistent_set": (design.consistent_set, {"history": H, "noise": NOISE}),
    "pole_placement": (
        design.pole_placement,
        {
            "history": H,
            "radius": 0.9,
            "Q": np.eye(2),
            "R": np.eye(1),
            "region": None,
            "step": 0.5,
            "attempts": 1,
        },
    ),
    "algorithm1": (
        design.algorithm1,
        {
            "history": short_history(),
            "radius": 0.9,
            "rho": 0.6,
            "mu": 100.0,
            "horizon": 3,
            "Q": np.eye(2),
            "R": np.eye(2),
            "region": None,
            "disturbance": (0.1, 0.0, 0.1),
            "x_prior": [0.0, 0.0],
        },
    ),
    "AffineModel.to_control": (design.identify(H).to_control, {"offsets": True}),
    "AffineModel.from_control": (
        design.AffineModel.from_control,
        {"sys": design.identify(H).to_control()},
    ),
    "RecordingNoise": (
        design.RecordingNoise,
        {"x": 0.1, "y": 0.1, "w": 0.1, "kind": "bounded", "confidence": 0.9},
    ),
    "Disc": (design.Disc, {"radius": 0.9, "centre": 0.0}),
    "HalfPlane": (design.HalfPlane, {"bound": 0.9, "right": True}),
    "Cone": (design.Cone, {"angle": 0.9, "apex": 0.0, "right": True}),
    "Certificate.verify": (CERTIFICATE.verify, {"A": A, "C": C}),
    "Certificate.error_bound": (
        CERTIFICATE.error_bound,
        {"steps": 3, "horizon": 5, "initial": 1.0, "w": 0.1, "v": 0.1},
    ),
    "tune": (
        lambda **given: _checked_only(ddmhe.tune, **given),
        {"history": H, "output_noise": 0.1, "equilibrium": None},
    ),
    "System": (
        interval.System,
        {
            "A": A,
            "C": C,
            "D1": np.eye(2),
            "D2": np.eye(1),
            "f": None,
            "jacobian": None,
            "j_lo": np.zeros((2, 2)),
            "j_hi": np.zeros((2, 2)),
            "B": np.eye(2),
            "r": [0.0],
        },
    ),
    "design_observer": (
        interval.design_observer,
        {"system": S, "lam": 0.5, "lmi": "exact", "weights": [1.0, 1.0]},
    ),
    "fixed_gain": (interval.fixed_gain, {"system": S, "gain": [[0.3], [0.1]]}),
    "kalman_gain": (interval.kalman_gain, {"system": S, "w_radius": 0.1, "v_radius": 0.1}),
    "from_history": (
        interval.from_history,
        {"history": H, "w_radius": 9.0, "v_radius": 9.0, "gain": [[0.3], [0.1]]},
    ),
    "IntervalObserver": (
        interval.IntervalObserver,
        {
            "system": S,
            "design": G,
            "x0_center": [0.0, 0.0],
            "x0_radius": 1.0,
            "w_radius": 0.1,
            "v_radius": 0.1,
            "order": 20,
            "method": "tight",
            "reduction": "pca",
        },
    ),
    "IntervalObserver.step": (lambda **given: _observer().step(**given), {"y": [0.1], "u": None}),
    "IntervalObserver.run": (lambda **given: _observer().run(**given), {"Y": [[0.1]], "U": None}),
    "linear": (
        interval.linear,
        {
            "A_lo": A,
            "A_hi": A,
            "C": C,
            "D1": np.eye(2),
            "D2": np.eye(1),
            "B": None,
            "C_radius": None,
        },
    ),
    "interval.pendulum": (interval.pendulum, {"model": None, "dt": 0.065}),
    "interval.detumbling": (
        interval.detumbling,
        {"model": None, "dt": 0.1, "rate_bound": 0.3, "uncertainty": 0.02},
    ),
    "van_der_pol": (interval.van_der_pol, {"dt": 0.05, "mu": 1.0, "bound": 3.0}),
    "KoopmanMhe": (
        baselines.KoopmanMhe,
        {
            "history": H,
            "horizon": 5,
            "rho": 0.9,
            "mu": 1.0,
            "dimension": 5,
            "relift": True,
            "seed": 0,
            "cut": 1e-6,
            "x_prior": [0.0, 0.0],
        },
    ),
    "ErrorStateKalman": (
        baselines.ErrorStateKalman,
        {"history": H, "Q": 1.0, "R": 1.0, "affine": True, "x_prior": [0.0, 0.0]},
    ),
    "ArxKalman": (baselines.ArxKalman, {"history": H, "order": 2}),
    "RidgeFir": (baselines.RidgeFir, {"history": H, "length": 3, "weight": 0.1}),
    "Oracle": (
        baselines.Oracle,
        {
            "model": models.pendulum(),
            "dt": 0.1,
            "x_prior": [0.0, 0.0],
            "noise": 0.1,
            "prior": 0.1,
            "motion": 0.1,
            "kind": "ekf",
        },
    ),
    "Baseline.step": (lambda **given: baselines.RidgeFir(H).step(**given), {"y_t": [0.1]}),
    "Baseline.run": (lambda **given: baselines.RidgeFir(H).run(**given), {"Y": [[0.1]]}),
    "Baseline.reset": (
        lambda **given: baselines.RidgeFir(H).reset(**given),
        {"x_prior": [0.1, 0.0]},
    ),
    "simulate": (
        models.spin_down().simulate,
        {
            "duration": 1.0,
            "dt": 0.1,
            "noise": 0.1,
            "seed": 0,
            "integrator": "euler",
            "disturbance": np.zeros((10, 1)),
        },
    ),
    "detumbling": (
        models.detumbling,
        {
            "inertia": [1.0, 2.0, 3.0],
            "M_eff": np.eye(3),
            "omega_0": [0.1, 0, 0],
            "B": [1, 0, 0],
            "Lambda": np.eye(3),
        },
    ),
    "spin_down": (
        models.spin_down,
        {
            "inertia": 0.1,
            "eddy": 0.1,
            "omega_0": 30.0,
            "torque_curve": None,
            "torque_bias": 0.0,
            "encoder_counts": 100,
        },
    ),
    "pendulum": (models.pendulum, {"stiffness": 1.0, "x_0": [1.0, 0.0]}),
    "TorqueCurve": (models.TorqueCurve, {"speed": [0.0, 1.0], "torque": [0.0, 1.0]}),
    "TorqueCurve.from_csv": (models.TorqueCurve.from_csv, {"path": "no-such-file.csv"}),
    "read_log": (
        logs.read_log,
        {
            "path": "no-such-file.csv",
            "state": ["w"],
            "output": ["q"],
            "input": ["u"],
            "time": None,
            "start": None,
            "decimate": 1,
            "missing": (),
            "unwrap": (),
        },
    ),
    "Log.split": (lambda history: _log().split(history), {"history": 1.0}),
    "read_config": (config.read_config, {"path": "no-such-file.toml"}),
    "write_config": (
        config.write_config,
        {"path": "no-such-directory/a.toml", "settings": {"horizon": 3}},
    ),
    "space_from_text": (config.space_from_text, {"text": "auto"}),
}

ATTACKS = {
    "None": None, "text": "x", "bytes": b"x", "dict": {}, "set": {1.0, 2.0}, "object": object(),
    "class": int, "function": len, "True": True, "complex": 1j, "complex array": np.array([[1j]]),
    "negative": -1, "zero": 0, "nan": float("nan"), "inf": float("inf"), "fraction": 2.5,
    "1e12": 10**12, "1e400": 10**400, "1e5000": 10**5000, "empty": [],
    "nothing in it": np.zeros((0, 0)), "ragged": [[1.0], [1.0, 2.0]], "0-d": np.array(1.0),
    "3-d": np.zeros((2, 2, 2)), "objects": np.array([[object()]]), "texts": ["a", "b"],
    "masked": np.ma.masked, "masked array": np.ma.array([[1.0, 2.0]], mask=[[True, False]]),
    "NA": pd.NA, "Nones": [None, None], "date": np.datetime64("2020-01-01"),
    "pair of pairs": ((1, 2), (3, 4)), "estimator": ddmhe.DdMhe(H, 5),
}  # fmt: skip


def _observer():
    return interval.IntervalObserver(S, G, [0.0, 0.0], 1.0, 0.1, 0.1)


def _checked_only(tune, **given):
    """Tune, whose arguments are to be checked before anything that takes time: a recording too
    short ends it there."""
    if given["history"] is H:
        given["history"] = ddmhe.History(X[:12], Y[:11])
    return tune(**given, progress=False)


def _log():
    t = np.arange(40) * 0.1
    gaps, lines = (), np.arange(40)
    return logs.Log(
        "a.csv", logs.Names("t", ("w",), ("q",)), t, X[:40, :1], Y, 0.1, lines + 2, lines, gaps
    )


def attacks():
    """Names and values; a generator is used up by being looked at."""
    yield from ATTACKS.items()
    yield "generator", (number for number in (1.0, 2.0))


def verdict(function, given):
    """What is wrong with how a call takes its arguments, None if nothing is."""
    try:
        function(**given)
    except ddmhe.DdmheError as e:
        text = str(e)
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as e:  # a panic of the core is no Exception
        return f"{type(e).__name__}: {e}"
    else:
        return None
    clear = "expected" in text and "\n" not in text and len(text) < 600
    return None if clear else f"unclear: {text!r}"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("call", CALLS)
def test_the_calls_that_are_attacked_work(call):
    function, given = CALLS[call]
    if "no-such" in str(given) or call == "tune":  # no file, and no time
        with pytest.raises(ddmhe.DdmheError):
            function(**given)
    else:
        function(**given)


# One test for all attacks on a call: seven thousand tests would take longer to set up than to run.
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("call", CALLS)
def test_a_wrong_argument_is_one_clear_error(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, given = CALLS[call]
    found = {
        f"{argument}: {attack}": verdict(function, given | {argument: wrong})
        for argument in given
        for attack, wrong in attacks()
    }
    assert len(found) == len(given) * (len(ATTACKS) + 1)
    assert {at: wrong for at, wrong in found.items() if wrong} == {}
