"""Identified models of recordings with known inputs, and the way to python-control and back."""

import sys

import control
import numpy as np
import pytest

import ddmhe
from ddmhe._core import noise_levels
from ddmhe.design import AffineModel, identify
from ddmhe.design.model import recorded_noise
from driven import random_driven, recorded
from reference import random_system

PARTS = ("A", "B", "e", "C", "D", "r")


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("method", ["least squares", "total least squares"])
def test_noise_free_systems_are_recovered(seed, method):
    rng = np.random.default_rng(seed)
    n, p, m = 1 + seed % 4, 1 + seed % 3, 1 + (seed // 2) % 3
    system = random_driven(rng, n, p, m)
    model = identify(ddmhe.History.concat([recorded(system, rng, 60) for _ in range(2)]), method)
    for name in PARTS:
        np.testing.assert_allclose(getattr(model, name), getattr(system, name), atol=1e-7)
    assert (model.B.shape, model.D.shape) == ((n, m), (p, m))
    assert model.gram.shape == (n + m + 1, n + m + 1)


def test_without_inputs_B_and_D_have_no_columns():
    rng = np.random.default_rng(0)
    system = random_system(rng, 3, 2)
    x, y = system.simulate(rng.standard_normal(3), 60)
    model = identify(ddmhe.History(x, y))
    assert (model.B.shape, model.D.shape) == ((3, 0), (2, 0))
    sys = model.to_control()
    assert (sys.ninputs, model.to_control(offsets=False).ninputs) == (1, 0)
    np.testing.assert_array_equal(sys.B[:, 0], model.e)
    np.testing.assert_array_equal(sys.D[:, 0], model.r)


def test_standard_errors_are_those_of_repeated_experiments():
    """w and v only: the spread of 300 fits is what each fit says of itself, entry by entry."""
    rng = np.random.default_rng(5)
    system = random_driven(rng, 2, 2, 2)
    system = type(system)(0.7 * system.A, system.B, system.e, system.C, system.D, system.r)
    fits = []
    for _ in range(300):
        u = rng.standard_normal((200, 2))
        noise = 0.3 * rng.standard_normal((200, 2)), 0.1 * rng.standard_normal((200, 2))
        fits.append(identify(ddmhe.History(*system.simulate(np.zeros(2), u, *noise), u=u)))
    for names, errors in (("AC", "standard_errors"), ("BD", "input_standard_errors")):
        parts = [np.concatenate([getattr(m, name) for name in names]) for m in fits]
        stated = [np.concatenate(getattr(m, errors)) ** 2 for m in fits]
        np.testing.assert_allclose(np.sqrt(np.mean(stated, 0)), np.std(parts, 0), rtol=0.16)


def test_total_least_squares_removes_the_bias_of_noisy_states():
    """A slow state that steps of u move, read with errors: least squares shrinks A and bends
    B, total least squares does not, though a step looks like noise to a fifth difference."""
    rng = np.random.default_rng(1)
    truth = {"A": 0.98, "B": 1.0}
    missed = {"least squares": [], "total least squares": []}
    for _ in range(40):
        u = np.repeat(rng.choice([-1.0, 1.0], 40), 25)[:, None]
        x = [0.0]
        for k in range(1000):
            x.append(0.98 * x[-1] + u[k, 0])
        x = np.array(x)[:, None]
        history = ddmhe.History(
            x + 2.0 * rng.standard_normal(x.shape),
            x[:-1] + 2.0 * rng.standard_normal((1000, 1)),
            u=u,
        )
        for method, found in missed.items():
            model = identify(history, method)
            found.append([getattr(model, name)[0, 0] - value for name, value in truth.items()])
    bias = {method: np.abs(np.mean(found, axis=0)) for method, found in missed.items()}
    assert (bias["least squares"] > [0.008, 0.07]).all()
    assert (bias["total least squares"] < 0.2 * bias["least squares"]).all()


def test_inputs_do_not_pass_for_noise():
    """A slow system under white inputs with a feedthrough: fifth differences see u, not noise."""
    rng = np.random.default_rng(4)
    A, D = np.array([[0.98, 0.03], [-0.03, 0.97]]), np.array([[2.0, -1.0]])
    parts = []
    for T in (300, 200):
        u, x = rng.standard_normal((T, 2)), [np.zeros(2)]
        for k in range(T):
            x.append(A @ x[-1] + u[k])
        x, y = np.array(x), np.array(x)[:-1, :1] + u @ D.T
        noise = [0.01, 0.2] * rng.standard_normal(x.shape), 0.05 * rng.standard_normal(y.shape)
        parts.append(ddmhe.History(x + noise[0], y + noise[1], u=u))
    history = ddmhe.History.concat(parts)
    np.testing.assert_allclose(
        np.concatenate(recorded_noise(history)), [0.01, 0.2, 0.05], rtol=0.15
    )
    assert (np.concatenate(noise_levels(history)) > 0.3).all()
    short = ddmhe.History(x[:9], y[:8], u=u[:8])  # nothing is left of so few
    assert [level.tolist() for level in recorded_noise(short)] == [[0.0, 0.0], [0.0]]


@pytest.mark.parametrize("offsets", [False, True])
def test_python_control_simulates_the_same_motion(offsets):
    rng = np.random.default_rng(2)
    system = random_driven(rng, 3, 2, 2)
    h = recorded(system, rng)
    model = identify(ddmhe.History(*h.recordings[0], dt=0.1, u=h.inputs[0]))
    x_0, u = rng.standard_normal(3), rng.standard_normal((40, 2))
    sys = model.to_control(offsets=offsets)
    start, inputs = x_0, u
    shift_x, shift_y = np.zeros(3), np.zeros(2)
    if offsets:
        inputs = np.column_stack([u, np.ones(40)])
    else:  # deviations from the rest under no input
        shift_x = np.linalg.solve(np.eye(3) - model.A, model.e)
        shift_y = model.C @ shift_x + model.r
        start = x_0 - shift_x
    response = control.forced_response(sys, T=np.arange(40) * 0.1, inputs=inputs.T, X0=start)
    x, y = system.simulate(x_0, u)  # the truth, not the model's own simulation
    np.testing.assert_allclose(response.states.T + shift_x, x[:-1], atol=1e-8)
    np.testing.assert_allclose(response.outputs.T + shift_y, y, atol=1e-8)
    np.testing.assert_allclose(model.simulate(x_0, 40, u)[0], x, atol=1e-8)
    np.testing.assert_allclose(model.simulate(x_0, 40, u)[1], y, atol=1e-8)
    assert sys.dt == 0.1


def test_from_control_and_back():
    rng = np.random.default_rng(3)
    system = random_driven(rng, 3, 2, 2)
    sys = control.ss(system.A, system.B, system.C, system.D, 0.05)
    model = AffineModel.from_control(sys)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(model, name), getattr(system, name))
    assert (model.dt, model.samples, model.method) == (0.05, 0, "given")
    assert not model.e.any()
    assert not model.r.any()
    back = model.to_control()
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(back, name), getattr(system, name))
    assert back.dt == 0.05
    assert AffineModel.from_control(control.ss(system.A, system.B, system.C, 0, True)).dt == 1.0


def test_errors_of_conversions_are_one_sentence(monkeypatch):
    A, B, C = [[0.5]], [[1.0]], [[1.0]]
    sys_ = control.ss(A, B, C, 0, 0.1)
    cases = [
        (control.ss(A, B, C, 0), "sys: expected a discrete control.StateSpace, found a continuous"),
        (control.ss(A, B, C, 0, None), "StateSpace, found one without a time base"),
        (
            control.tf([1.0], [1.0, 0.5], 0.1),
            "sys: expected a control.StateSpace, found a Transfer",
        ),
        (np.eye(2), "sys: expected a control.StateSpace, found a ndarray"),
        (control.ss([], [], [], [[1.0]], 0.1), "sys: expected at least one state and one output"),
        (control.ss([[np.inf]], B, C, 0, 0.1), "sys.A: expected finite numbers"),
    ]
    for given, words in cases:
        with pytest.raises(ddmhe.DdmheError, match=words) as error:
            AffineModel.from_control(given)
        assert "\n" not in str(error.value)
    model = AffineModel.from_control(sys_)
    with pytest.raises(ddmhe.DdmheError, match="offsets: expected True or False"):
        model.to_control(offsets="yes")
    monkeypatch.setitem(sys.modules, "control", None)
    for call in (model.to_control, lambda: AffineModel.from_control(sys_)):
        with pytest.raises(ImportError, match=r"expected the package control, found none \(pip"):
            call()


def test_errors_name_the_argument():
    rng = np.random.default_rng(0)
    system = random_driven(rng, 2, 1, 2)
    h = recorded(system, rng, 30)
    (x, y), u = h.recordings[0], h.inputs[0]
    still = u.copy()
    still[:, 1] = 3.3
    follows = np.column_stack([u[:, 0], x[:-1] @ [0.3, -0.2]])
    together = np.column_stack([u[:, 0], 0.1 * u[:, 0] + 7.0])
    cases = [
        (dict(u=still), "found input 1 .counted from 0. constant: its effect is unknown"),
        (dict(u=follows), "span n . m = 4 directions about their means, found 3: u follows"),
        (dict(u=together), "span n . m = 4 directions about their means, found 3: u follows"),
    ]
    for given, words in cases:
        with pytest.raises(ddmhe.RankError, match=f"history: expected .*{words}"):
            identify(ddmhe.History(x, y, **given))
    with pytest.raises(ddmhe.RankError, match="history: expected at least 5 outputs"):
        identify(ddmhe.History(x[:5], y[:4], u=u[:4]))
    model = identify(h)
    for given, words in ((None, "found none"), (u[:3], r"u: expected shape \(4, 2\)")):
        with pytest.raises(ddmhe.ShapeError, match=words):
            model.simulate(x[0], 4, given)
    with pytest.raises(ddmhe.ShapeError, match="u: expected none for a model without inputs"):
        identify(h.without_inputs()).simulate(x[0], 4, u[:4])
