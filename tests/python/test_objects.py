"""Objects go where Python's objects go: into pickles, copies, other processes, other threads."""

import copy
import functools
import multiprocessing
import pickle
import threading
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import ddmhe
from ddmhe import baselines, design, interval
from ddmhe._core import validate
from reference import random_system

RNG = np.random.default_rng(5)
SYSTEM = random_system(RNG, 2, 2)
X, Y = SYSTEM.simulate(RNG.standard_normal(2), 60)
NOISY = X + 1e-3 * RNG.standard_normal(X.shape)
H = ddmhe.History(NOISY, Y, dt=0.25)
OUTPUTS = 0.1 * RNG.standard_normal((30, 2))

WAYS = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "oldest pickle": lambda thing: pickle.loads(pickle.dumps(thing, protocol=0)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


def same(a, b):
    """Equal in every public attribute, arrays bit for bit."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
    elif isinstance(a, (list, tuple)):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    elif isinstance(a, dict):
        same(list(a), list(b))
        same(list(a.values()), list(b.values()))
    elif type(a).__module__.split(".")[0] == "ddmhe" and not isinstance(a, ddmhe.Reason):
        names = [name for name in dir(a) if not name.startswith("_")]
        parts = [name for name in names if not callable(getattr(a, name))]
        assert parts or repr(a) == "Exact()"
        for name in parts:
            same(getattr(a, name), getattr(b, name))
    elif hasattr(a, "to_numpy"):
        np.testing.assert_array_equal(a.to_numpy(), b.to_numpy())
    else:
        assert a == b or (a != a and b != b), (a, b)


def certified():
    certificate = design.ioss(ddmhe.History(X, Y), eta=0.9)
    return ddmhe.DdMhe(ddmhe.History(X, Y), certificate=certificate, disturbance=(0.1, 1e-3, 1e-2))


def estimators():
    box = (-0.05, 0.05)
    return {
        "defaults": ddmhe.DdMhe(H),
        "bounds": ddmhe.DdMhe(H, 6, 0.9, 1.0, x_bounds=box, v_bounds=(-1, 1), x_prior=[0.0, 0.0]),
        "centre": ddmhe.DdMhe(H, 6, x_bounds=box, x_center="history", warm_start=True),
        "equilibrium": ddmhe.DdMhe(H, 6, equilibrium=([0, 0], [0, 0]), space=ddmhe.Truncated(3)),
        "certificate": certified(),
        "joined": ddmhe.DdMhe(ddmhe.History.concat([H, H]), 5, space=ddmhe.Ridge(1e-3)),
    }


def user_f(x):
    return np.array([0.0, 0.05 * np.sin(x[0])])


def user_jacobian(lo, hi):
    slope = np.array([[0.0, 0.0], [0.05, 0.0]])
    return -slope, slope


def users_system():
    slope = np.array([[0.0, 0.0], [0.05, 0.0]])
    A, C = np.array([[0.9, 0.1], [0.0, 0.8]]), np.array([[1.0, 0.0]])
    return interval.System(A, C, np.eye(2), np.eye(1), user_f, user_jacobian, -slope, slope)


def observer(system, method="tight"):
    gain = interval.fixed_gain(system, np.full((system.n, system.p), 0.3))
    return interval.IntervalObserver(
        system, gain, np.zeros(system.n), 0.5, 1e-3, 1e-2, method=method
    )


SYSTEMS = {
    "user's": users_system,
    "pendulum": interval.pendulum,
    "detumbling": interval.detumbling,
    "van der Pol": interval.van_der_pol,
    "linear": lambda: interval.linear(
        0.5 * np.eye(2), 0.6 * np.eye(2), [[1.0, 0.0]], np.eye(2), np.eye(1)
    ),
}


def values():
    """Everything that users hold and that does not change, by name."""
    est, noisy = certified(), ddmhe.DdMhe(H, x_bounds=(-0.05, 0.05))
    o = observer(interval.pendulum())
    record = ddmhe.models.detumbling().simulate(3.0, 0.1)
    return {
        "History": H,
        "joined History": ddmhe.History.concat([H, H]),
        "RankReport": H.rank(3),
        "Exact": ddmhe.Exact(),
        "Truncated": ddmhe.Truncated(3, 1e-3),
        "Ridge": ddmhe.Ridge(1e-3, normalised=True),
        "Estimate": noisy.step([np.nan, 0.1]),
        "Estimate with bound": est.step(OUTPUTS[0]),
        "Log": noisy.run(OUTPUTS),
        "Log with bound": est.run(OUTPUTS),
        "Zonotope": ddmhe.Zonotope([1.0, 2.0], RNG.standard_normal((2, 5))),
        "point": ddmhe.Zonotope([1.0], np.zeros((1, 0))),
        "IntervalEstimate": o.step([0.0]),
        "IntervalLog": o.run(np.zeros((7, 1))),
        "Certificate": design.ioss(ddmhe.History(X, Y), eta=0.9),
        "PolePlacement": design.pole_placement(ddmhe.History(X, Y)),
        "model": design.identify(H),
        "ObserverDesign": o.design,
        "detumbling": ddmhe.models.detumbling(),
        "recording": record,
        "DataModel": interval.from_history(H, 0.02, 0.02),
    }


VALUES = values()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", VALUES)
def test_values(name, way):
    same(VALUES[name], WAYS[way](VALUES[name]))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", list(estimators()))
def test_estimators_continue_on_their_own(name, way):
    """Before the first step, in the middle and behind an estimate: the copy goes on with the same
    numbers, the
    original does not notice."""
    estimator, reference = estimators()[name], estimators()[name]
    for part in (OUTPUTS[:0], OUTPUTS[:4], OUTPUTS[4:12]):
        estimator.run(part)
        reference.run(part)
        twin = WAYS[way](estimator)
        same(twin, estimator)
        same(twin.run(OUTPUTS[12:]), copy.copy(reference).run(OUTPUTS[12:]))
        assert estimator.t == reference.t
    same(estimator.run(OUTPUTS[12:]), reference.run(OUTPUTS[12:]))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_observers_continue_on_their_own(name, way):
    for method in ("tight", "paper"):
        for seen in (0, 5):
            o, reference = (observer(SYSTEMS[name](), method) for _ in range(2))
            y = np.zeros((12, o.system.p))
            y[3] = np.nan
            o.run(y[:seen])
            reference.run(y[:seen])
            twin = WAYS[way](o)
            same(twin.bounds, reference.bounds)
            expected = reference.run(y[5:])
            same(twin.run(y[5:]), expected)
            same(o.run(y[5:]), expected)
        x = np.full(o.system.n, 0.1)
        if o.system.f is not None:
            same(np.asarray(twin.system.f(x)), np.asarray(o.system.f(x)))


BASELINES = [
    "ArxKalman",
    "ErrorStateKalman",
    "KoopmanMhe",
    "Oracle",
    "RidgeFir",
    "TahirIntervalObserver",
]


def baseline(name):
    if name == "Oracle":
        model = ddmhe.models.detumbling()
        return baselines.Oracle(model, 0.1, model.omega_0, 0.01)
    if name == "TahirIntervalObserver":
        return baselines.TahirIntervalObserver(interval.pendulum(), np.zeros(2), 0.1, 1e-3, 1e-2)
    return getattr(baselines, name)(H)


@functools.cache
def undisturbed(name):
    """Outputs, and what a baseline makes of the last of them when nothing comes between."""
    b = baseline(name)
    y = np.zeros((9, getattr(b, "p", 1)))
    b.run(y[:5])
    return y, b.run(y[5:])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", BASELINES)
def test_baselines_continue_on_their_own(name, way):
    b = baseline(name)
    y, expected = undisturbed(name)
    b.run(y[:5])
    twin = WAYS[way](b)
    same(twin.run(y[5:]), expected)
    same(b.run(y[5:]), expected)


def work(thing):
    estimator, o, y = thing
    return estimator.run(y), o.run(np.zeros((3, 1))), estimator


@pytest.mark.parametrize("method", sorted({*multiprocessing.get_all_start_methods()} - {"fork"}))
def test_other_processes(method):
    estimator, o = ddmhe.DdMhe(H, x_bounds=(-0.05, 0.05)), observer(users_system())
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method)) as pool:
        log, bounds, moved = pool.submit(work, (estimator, o, OUTPUTS)).result(timeout=300)
    assert estimator.t == 0
    assert moved.t == len(OUTPUTS)
    same(log, estimator.run(OUTPUTS))
    same(bounds, o.run(np.zeros((3, 1))))


def test_a_function_inside_of_a_function_is_told_by_pickle_itself():
    o = observer(SYSTEMS["user's"]())
    A, eye, slope = o.system.A, np.eye(2), o.system.j_hi
    nested = interval.System(
        A, o.system.C, eye, np.eye(1), lambda x: user_f(x), user_jacobian, -slope, slope
    )
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pickle.dumps(nested)
    assert copy.deepcopy(observer(nested)).step([0.0]).lower.shape == (2,)


def test_recordings_as_bytes():
    blob = H.to_bytes()
    same(ddmhe.History.from_bytes(blob), H)
    for wrong, words in (
        (blob[:-1], "cut off"),
        (blob + b"!", "longer"),
        (b"hello", "did not write"),
        ("no", "bytes"),
    ):
        with pytest.raises(ddmhe.DdmheError, match=words):
            ddmhe.History.from_bytes(wrong)


@pytest.mark.parametrize("name", ["estimator", "observer"])
def test_two_threads_on_one_object(name):
    """While one thread runs, whatever another one asks for is an answer or an error that says what
    to do."""
    h = ddmhe.History(NOISY[:, :1], Y[:, :1])
    thing = ddmhe.DdMhe(h, 20) if name == "estimator" else observer(interval.pendulum())
    y = np.zeros((400_000 if name == "estimator" else 20_000, 1))
    calls = {
        "step": lambda: thing.step([0.0]),
        "run": lambda: thing.run(y[:3]),
        "reset": lambda: thing.reset(),
        "copy": lambda: copy.copy(thing),
        "deepcopy": lambda: copy.deepcopy(thing),
        "pickle": lambda: pickle.dumps(thing),
    }
    for part in dir(thing):
        if not part.startswith("_") and part not in calls:
            calls[part] = lambda part=part: getattr(thing, part)
    if name == "estimator":
        calls["snapshot"] = thing.snapshot
        calls["run_many"] = lambda: ddmhe.run_many(thing, [y[:3]])
        calls["run_many, list"] = lambda: ddmhe.run_many([thing], [y[:3]])
    answers = {}
    other = threading.Thread(target=thing.run, args=(y,))
    other.start()
    while not answers.get("step") and other.is_alive():
        for call, make in calls.items():
            try:
                make()
            except ddmhe.DdmheError as e:
                answers[call] = str(e)
        assert isinstance(repr(thing), str)
    other.join()
    for call in ("step", "run", "reset", "copy", "deepcopy", "pickle"):
        assert "thread" in answers[call], call
        assert "copy.copy" in answers[call]
    if name == "estimator":
        assert "thread" in answers["horizon"]
        assert "thread" in answers["run_many, list"]
    thing.step([0.0])


def test_a_callback_may_not_use_its_own_observer():
    def f(x):
        o.reset()
        return user_f(x)

    system = users_system()
    slope = system.j_hi
    again = interval.System(
        system.A, system.C, np.eye(2), np.eye(1), f, user_jacobian, -slope, slope
    )
    o = observer(again)
    with pytest.raises(ddmhe.DdmheError, match="one call at a time"):
        o.step([0.0])


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit, GeneratorExit])
@pytest.mark.parametrize("where", ["f", "jacobian"])
def test_an_interrupt_inside_of_a_users_function_stays_one(kind, where):
    def stop(*_):
        raise kind("enough")

    system = users_system()
    parts = {"f": user_f, "jacobian": user_jacobian} | {where: stop}
    slope = system.j_hi
    stopping = interval.System(
        system.A, system.C, np.eye(2), np.eye(1), parts["f"], parts["jacobian"], -slope, slope
    )
    for call in (lambda o: o.step([0.0]), lambda o: o.run([[0.0]])):
        with pytest.raises(kind, match="enough"):
            call(observer(stopping))

    def wrong(*_):
        raise ZeroDivisionError("by zero")

    parts[where] = wrong
    failing = interval.System(
        system.A, system.C, np.eye(2), np.eye(1), parts["f"], parts["jacobian"], -slope, slope
    )
    with pytest.raises(ddmhe.DdmheError, match=f"{where}: .*by zero"):
        observer(failing).step([0.0])


def test_tuning_travels():
    assert validate([], []) == []
    tuned = ddmhe.tune(ddmhe.History(X[:31], Y[:30]), progress=False)
    for other in (pickle.loads(pickle.dumps(tuned)), copy.copy(tuned), copy.deepcopy(tuned)):
        same(other.settings, tuned.settings)
        np.testing.assert_array_equal(other.promise, tuned.promise)
        np.testing.assert_array_equal(other.range, tuned.range)
        assert (other.start, other.words) == (tuned.start, tuned.words)
