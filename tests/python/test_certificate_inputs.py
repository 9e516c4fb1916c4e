"""Certificates and error bounds of recordings with known inputs."""

import control
import numpy as np
import pytest

import ddmhe
from ddmhe.config import read_config, write_config
from ddmhe.design import (
    AffineModel,
    Certificate,
    RecordingNoise,
    consistent_set,
    identify,
    ioss,
    scalar_certificate,
)
from driven import Driven, random_driven, recorded, spheres
from reference import largest_eigenvalue

MODEL = ("A", "B", "e", "C", "D", "r")


def some(seeds, now):
    """So many seeds, all but a few of them with the long tests; these are of every n, p and m."""
    return [pytest.param(k, marks=() if k in now else pytest.mark.long) for k in range(seeds)]


def of_system(system):
    """What `ioss` takes of a known system."""
    return {name: getattr(system, name) for name in MODEL}


def largest_ratio(rng, system, history, c, sizes, steps=60, u_size=1.0, **settings):
    """Largest error over its bound in one run from a wrong start, and bounds over the states' size;
    None where there is no bound."""
    initial, w, v = sizes
    n, p, m = len(system.e), len(system.r), system.B.shape[1]
    u = u_size * rng.standard_normal((steps, m))
    x_0 = rng.standard_normal(n)
    drive = spheres(rng, steps, n, w), spheres(rng, steps, p, v)
    if rng.random() < 0.5:  # in one direction all the time
        drive = tuple(np.repeat(part[:1], steps, axis=0) for part in drive)
    x, y = system.simulate(x_0, u, *drive)
    estimator = ddmhe.DdMhe(
        history,
        x_prior=x_0 + spheres(rng, 1, n, initial)[0],
        certificate=c,
        disturbance=sizes,
        **settings,
    )
    log = estimator.run(y, u)
    if log.bound is None:
        return None
    error = np.linalg.norm(log.x - x[1:], axis=1)
    return np.max((error - 1e-9) / (log.bound * (1 + 1e-9))), np.median(log.bound) / np.std(x)


@pytest.mark.parametrize("seed", range(12))
def test_a_certificate_of_a_recording_is_that_of_its_system(seed):
    """P, Q, R as for the true (A, C), whatever drove it: inputs taken for motion of A would not
    do."""
    rng = np.random.default_rng(seed)
    system = random_driven(rng, 1 + seed % 4, 1 + seed % 3, 1 + seed % 2)
    h = recorded(system, rng)
    c, known = ioss(h, 0.9), ioss(**of_system(system), eta=0.9)
    for name in MODEL:
        np.testing.assert_allclose(getattr(c, name), getattr(system, name), atol=1e-8)
        np.testing.assert_array_equal(getattr(known, name), getattr(system, name))
    assert largest_eigenvalue(c, system.A, system.C) <= 0
    np.testing.assert_allclose(c.P, known.P, rtol=1e-3, atol=1e-3 * np.abs(known.P).max())
    assert not c.identified
    assert ioss(recorded(system, rng, y_noise=1e-3), 0.9).identified
    assert ioss(A=system.A, C=system.C, eta=0.9).B is None


@pytest.mark.parametrize("seed", some(20, (0, 5, 10, 15)))
def test_errors_never_exceed_the_bounds_over_exact_recordings(seed):
    """With process and output noise online and inputs three times as large as recorded."""
    rng = np.random.default_rng(seed)
    system = random_driven(rng, 1 + seed % 4, 1 + (seed // 4) % 3, 1 + seed % 2)
    h = recorded(system, rng)
    c = ioss(h, float(rng.choice([0.6, 0.8, 0.9])))
    for space in ("auto", ddmhe.Exact()):
        for sizes in ((0.5, 0.0, 0.0), (0.5, 0.02, 0.1)):
            for _ in range(10):
                ratio, _ = largest_ratio(rng, system, h, c, sizes, u_size=3.0, space=space)
                assert ratio <= 1.0


def test_the_bounds_say_something():
    """Small against the states' own spread, and reached to a tenth somewhere."""
    shares, ratios = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        system = random_driven(rng, 1 + seed % 4, 1 + seed % 3, 1 + seed % 2)
        h = recorded(system, rng)
        ratio, share = largest_ratio(rng, system, h, ioss(h, 0.8), (0.1, 0.005, 0.01))
        shares.append(share)
        ratios.append(ratio)
    assert np.median(shares) < 0.2
    assert max(shares) < 1.0
    assert max(ratios) > 0.1


def test_the_bound_rests_on_B_and_D():
    """Those of another system leave residuals in every window, and the bound shows them."""
    wider = {"B": 0, "D": 0}
    for seed in range(8):
        for name in wider:
            rng = np.random.default_rng(seed)
            system = random_driven(rng, 2, 2, 1)
            h = recorded(system, rng, x_noise=1e-6)  # noisy: B and D count
            wrong = of_system(system) | {name: 0.5 * getattr(system, name)}
            exact = largest_ratio(rng, system, h, ioss(**of_system(system), eta=0.8), (0.1, 0, 0))
            assert exact[0] <= 1.0
            biased = largest_ratio(rng, system, h, ioss(**wrong, eta=0.8), (0.1, 0, 0))
            wider[name] += biased[1] > 20 * exact[1]
    assert wider == {"B": 8, "D": 8}


@pytest.mark.parametrize("seed", some(12, (0, 5, 7)))
def test_bounds_over_noisy_recordings_hold_where_they_are_given(seed):
    """With the true model never exceeded; with the fitted one, or the true one without e and r,
    there is none."""
    rng = np.random.default_rng(seed)
    system = random_driven(rng, 1 + seed % 3, 1 + (seed // 3) % 3, 1 + seed % 2)
    given = of_system(system)
    for size in (1e-6, 1e-3, 0.05):
        h = recorded(system, rng, 150, x_noise=size, y_noise=size)
        full = ioss(**given, eta=0.9)
        bare = ioss(**{name: given[name] for name in "ABCD"}, eta=0.9)
        for space in ("auto", ddmhe.Exact(), ddmhe.Ridge(1e-2, normalised=True)):
            sizes = (0.2, 0.01, 0.05)
            ratio, _ = largest_ratio(rng, system, h, full, sizes, space=space, u_size=2.0)
            assert ratio <= 1.0
            assert largest_ratio(rng, system, h, bare, sizes, space=space) is None
            assert largest_ratio(rng, system, h, ioss(h, 0.9), sizes, space=space) is None


NOISY = Driven(
    np.array([[0.95, 0.3, 0.0], [-0.3, 0.95, 0.1], [0.0, 0.0, -0.99]]),
    np.array([[0.5, 0.0], [0.0, 0.3], [0.2, -0.4]]),
    np.array([0.1, -0.2, 0.3]),
    np.array([[1.0, 0.0, 0.5]]),
    np.array([[0.3, -0.1]]),
    np.array([2.0]),
)


def test_the_consistent_set_is_that_of_its_definition():
    """Z_c, Δ and G⁻¹ from D1, D0 and Θ as they are written, not centred, nothing taken off."""
    rng = np.random.default_rng(0)
    noise = RecordingNoise(x=2e-3, y=1e-3, w=1e-3)
    h = ddmhe.History.concat([recorded(NOISY, rng, 40, 2e-3, 1e-3, 1e-3) for _ in range(2)])
    found = consistent_set(h, noise)
    D1 = np.concatenate([np.hstack([x[1:], y]) for x, y in h.recordings]).T
    X, U = np.concatenate([x[:-1] for x, _ in h.recordings]).T, np.concatenate(h.inputs).T
    D0 = np.vstack([X, U, np.ones(80)])
    theta = noise.energy(3, 1, 81)
    G = D0 @ D0.T - np.diag([theta[2]] * 3 + [0.0] * 3)
    Z = D1 @ D0.T @ np.linalg.inv(G)
    delta = Z @ G @ Z.T - D1 @ D1.T + np.diag([theta[0]] * 3 + [theta[1]])
    np.testing.assert_allclose(
        np.block([[found.A, found.B, found.e[:, None]], [found.C, found.D, found.r[:, None]]]),
        Z,
        atol=1e-8,
    )
    np.testing.assert_allclose(found.metric, np.linalg.inv(G), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(
        found.root @ found.root.T, delta, rtol=1e-6, atol=1e-6 * np.abs(delta).max()
    )


@pytest.mark.parametrize("kind", ["bounded", "gaussian"])
def test_the_true_system_is_always_among_the_consistent_ones(kind):
    rng = np.random.default_rng(1)
    noise = RecordingNoise(x=2e-3, y=2e-3, w=1e-3, kind=kind)
    truth = {name: getattr(NOISY, name) for name in MODEL}
    for _ in range(200):
        h = recorded(NOISY, rng, 100, 2e-3, 2e-3, 1e-3)
        assert consistent_set(h, noise).contains(**truth)
    for name in ("B", "D"):
        moved = truth | {name: truth[name] + 0.5}
        assert not consistent_set(h, noise).contains(**moved)
    with pytest.raises(ddmhe.DdmheError, match="B, D: expected both"):
        consistent_set(h, noise).contains(*(truth[name] for name in "AeCr"))


def test_robust_bounds_hold_for_estimates_from_the_noisy_recording():
    rng = np.random.default_rng(5)
    noise = RecordingNoise(x=1e-3, y=1e-3)
    shares = []
    for _ in range(20):
        h = recorded(NOISY, rng, 200, 1e-3, 1e-3)
        c = ioss(h, 0.95, noise=noise)
        assert c.uncertainty.metric.shape == (6, 6)
        assert largest_eigenvalue(c, NOISY.A, NOISY.C) <= 0
        ratio, share = largest_ratio(rng, NOISY, h, c, (0.01, 0.0, 0.01), u_size=1.0)
        assert ratio <= 1.0
        shares.append(share)
    assert max(shares) < 0.5  # and say something


def test_files_carry_B_and_D(tmp_path):
    rng = np.random.default_rng(2)
    h = recorded(NOISY, rng, 200, 1e-3, 1e-3)
    u = rng.standard_normal((40, 2))
    _, y = NOISY.simulate(np.zeros(3), u)
    for noise in (None, RecordingNoise(x=1e-3, y=1e-3)):
        c = ioss(h, 0.95, noise=noise)
        write_config(tmp_path / "c.toml", {"certificate": c})
        back = read_config(tmp_path / "c.toml")["certificate"]
        for name in ("P", "Q", "R", *MODEL):
            np.testing.assert_array_equal(getattr(back, name), getattr(c, name))
        runs = [
            ddmhe.DdMhe(h, certificate=one, disturbance=(0.1, 0.0, 0.01)).run(y, u)
            for one in (c, back)
        ]
        np.testing.assert_array_equal(runs[0].x, runs[1].x)
        assert (runs[0].bound is None) == (noise is None)
        if noise is not None:
            np.testing.assert_array_equal(runs[0].bound, runs[1].bound)


def test_a_model_from_python_control_is_certified():
    """A plant that was designed elsewhere: its matrices, a recording, a bound."""
    rng = np.random.default_rng(3)
    plant = control.ss([[0.9, 0.2], [-0.1, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.4]], 0.1)
    model = AffineModel.from_control(plant)
    system = Driven(*(getattr(model, name) for name in MODEL))
    h = recorded(system, rng, 80, x_noise=1e-3, y_noise=1e-3)
    parts = {name: getattr(model, name) for name in MODEL}
    ratio, share = largest_ratio(rng, system, h, ioss(**parts, eta=0.8), (0.1, 0.001, 0.01))
    assert ratio <= 1.0
    assert share < 0.5


def test_scalar_weights_with_inputs():
    rng = np.random.default_rng(4)
    A, C = np.array([[0.9, 0.1], [0.0, 0.8]]), np.eye(2)
    system = Driven(
        A, np.array([[1.0], [0.5]]), np.ones(2), C, np.array([[0.2], [0.0]]), np.ones(2)
    )
    of_inputs = {name: getattr(system, name) for name in ("B", "D")}
    c = scalar_certificate(
        A, C, -A + 0.1 * np.eye(2), 0.5, 20.0, e=system.e, r=system.r, **of_inputs
    )
    h = recorded(system, rng, 60)
    assert largest_ratio(rng, system, h, c, (0.1, 0.01, 0.01))[0] <= 1.0
    u = rng.standard_normal((30, 1))
    _, y = system.simulate(np.zeros(2), u)
    runs = [
        ddmhe.DdMhe(h, 5, **weights, space=ddmhe.Exact()).run(y, u)
        for weights in ({"certificate": c}, {"rho": 0.5, "mu": 20.0})
    ]
    np.testing.assert_allclose(runs[0].x, runs[1].x, atol=1e-9)


def test_errors_name_the_argument():
    rng = np.random.default_rng(0)
    h = recorded(NOISY, rng, 100)
    given = {name: getattr(NOISY, name) for name in MODEL}
    cases = [
        (dict(A=NOISY.A, C=NOISY.C, B=NOISY.B), "B, D: expected both with A and C, or neither"),
        (dict(history=h, B=NOISY.B, D=NOISY.D), "B, D: expected both with A and C, or neither"),
        (given | {"B": NOISY.B[:2]}, "B: expected shape"),
        (given | {"D": NOISY.D[:, :1]}, "D: expected shape"),
        (given | {"D": NOISY.D * np.nan}, "D: expected finite numbers"),
    ]
    for arguments, message in cases:
        with pytest.raises(ddmhe.DdmheError, match=message):
            ioss(**arguments)
    c = ioss(A=NOISY.A, C=NOISY.C)
    assert isinstance(c, Certificate)
    with pytest.raises(ddmhe.DdmheError, match="certificate: expected B beside A and C"):
        ddmhe.DdMhe(h, certificate=c)
    assert identify(h).B.shape == (3, 2)
