"""Identified models: recovery, stated uncertainty, errors in variables, the bridge to
python-control."""

import control
import numpy as np
import pytest

import ddmhe
from ddmhe._core import noise_levels
from ddmhe.design import identify
from ddmhe.design.model import is_observable
from reference import Affine, random_system


def record(system, rng, steps=120, w=0.0, v=0.0):
    """A recording driven by process noise w, with output noise v."""
    n, p = len(system.e), len(system.r)
    x = [rng.standard_normal(n)]
    for _ in range(steps):
        x.append(system.A @ x[-1] + system.e + w * rng.standard_normal(n))
    x = np.array(x)
    return x, x[:-1] @ system.C.T + system.r + v * rng.standard_normal((steps, p))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("method", ["least squares", "total least squares"])
def test_noise_free_systems_are_recovered(seed, method):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n=1 + seed % 4, p=1 + seed % 3)
    recordings = [ddmhe.History(*record(system, rng, 60)) for _ in range(2)]  # two starts, one seam
    model = identify(ddmhe.History.concat(recordings), method)
    for name in ("A", "e", "C", "r"):
        np.testing.assert_allclose(getattr(model, name), getattr(system, name), atol=1e-7)
    assert model.observable


def test_covariance_is_that_of_repeated_experiments():
    """Noise through w and v only: the spread of 600 fits is what each fit says of itself, entry by
    entry."""
    rng = np.random.default_rng(5)
    system = random_system(rng, 2, 2)
    system = Affine(
        0.7 * system.A, system.e, system.C, system.r
    )  # forgets: near a unit root the spread is not normal
    fits = [identify(ddmhe.History(*record(system, rng, 200, w=0.3, v=0.1))) for _ in range(600)]
    spread = np.std([np.concatenate([m.A, m.C]) for m in fits], axis=0)
    stated = np.sqrt(np.mean([np.concatenate(m.standard_errors) ** 2 for m in fits], axis=0))
    np.testing.assert_allclose(stated, spread, rtol=0.12)


def test_total_least_squares_removes_the_bias_of_noisy_states():
    """y = 2 x with errors on x: least squares shrinks the slope by var/(var + noise), total least
    squares does not."""
    rng = np.random.default_rng(0)
    x = 1.0 + np.cumsum(rng.standard_normal(401))[:, None] * 0.1
    slopes = {"least squares": [], "total least squares": []}
    for _ in range(100):
        noisy = x + 0.3 * rng.standard_normal(x.shape)
        history = ddmhe.History(noisy, 2 * x[:-1] + 0.3 * rng.standard_normal((400, 1)))
        for method, found in slopes.items():
            found.append(identify(history, method).C[0, 0])
    shrunk = 2 * x[:-1].var() / (x[:-1].var() + 0.09)
    assert np.mean(slopes["least squares"]) == pytest.approx(shrunk, abs=0.03)
    assert abs(np.mean(slopes["total least squares"]) - 2) < 0.25 * (2 - shrunk)


def test_python_control_simulates_the_same_motion():
    rng = np.random.default_rng(2)
    system = random_system(rng, 3, 2)
    model = identify(ddmhe.History(*record(system, rng), dt=0.1))
    x_0 = rng.standard_normal(3)
    x, y = model.simulate(x_0, 40)
    response = control.forced_response(
        model.to_control(), T=np.arange(40) * 0.1, inputs=np.ones(40), X0=x_0
    )
    np.testing.assert_allclose(response.states.T, x[:-1], atol=1e-10)
    np.testing.assert_allclose(response.outputs.T, y, atol=1e-10)


def test_observability_does_not_depend_on_units():
    A, C = np.diag([0.9, 0.5]), np.array([[1e-6, 1e-6]])
    assert is_observable(A, C)
    assert not is_observable(A, np.array([[1e6, 0.0]]))
    assert not is_observable(np.eye(2), np.array([[1.0, 2.0]]))


def test_errors_name_the_argument():
    x, y = np.zeros((20, 2)), np.zeros((19, 1))
    x[:, 0] = np.sin(np.arange(20))
    with pytest.raises(
        ddmhe.RankError, match="history: expected states that span n = 2 directions"
    ):
        identify(ddmhe.History(x, y))
    with pytest.raises(ddmhe.RankError, match="history: expected at least 3 outputs"):
        identify(ddmhe.History(x[:3], y[:2]))
    with pytest.raises(ddmhe.DdmheError, match="method: expected one of least squares"):
        identify(ddmhe.History(x, y), "magic")


def test_noise_levels_are_those_of_fifth_differences():
    """Of several recordings together, against NumPy's differences; 0 where five samples are all."""
    rng = np.random.default_rng(5)
    parts = []
    for T in (40, 70):
        t = 0.1 * np.arange(T + 1)
        noise = [0.01, 0.2] * rng.standard_normal((T + 1, 2))
        x = np.column_stack([np.sin(t), 3 * np.cos(t)]) + noise
        parts.append((x, 0.05 * rng.standard_normal((T, 1))))
    history = ddmhe.History.concat([ddmhe.History(x, y) for x, y in parts])
    for found, signals in zip(noise_levels(history), zip(*parts, strict=True), strict=True):
        differences = np.concatenate([np.diff(s, 5, axis=0) for s in signals])
        expected = np.sqrt(np.mean(differences**2, axis=0) / 252)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(noise_levels(history)[0], [0.01, 0.2], rtol=0.4)
    x, y = parts[0]
    short = noise_levels(ddmhe.History(x[:5], y[:4]))
    assert [level.tolist() for level in short] == [[0.0, 0.0], [0.0]]
