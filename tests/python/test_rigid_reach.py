"""RigidBodyMhe ten minutes beyond its recording: how far it is off, and whether it knows that."""

import numpy as np
import pytest

import ddmhe

DEG = 180 / np.pi
DT, RECORDED, ONLINE = 0.1, 200, 6000

SLOW = dict(
    inertia=[[4280.6, 287.7, -160.8], [287.7, 4992.7, -635.2], [-160.8, -635.2, 4737.7]],
    M_eff=[
        [259340.0, -18950.0, 20260.0],
        [-18950.0, 278300.0, -280.0],
        [20260.0, -280.0, 347390.0],
    ],
    B=[-0.00683, 0.00492, 0.00465],
    r=[0.024, 0.028, 0.609],
    Lambda=[[9e-05, -0.00549, -0.0071], [-0.00549, -0.00242, 0.00663], [-0.0071, 0.00663, 0.00233]],
    omega_0=[0.09293, -0.03863, 0.04161],
)
"""Nearly spherical, 6 deg/s: its possible motions lie along a valley."""
FAST = dict(
    inertia=[[2408.6, -29.1, -165.2], [-29.1, 2394.3, 77.8], [-165.2, 77.8, 3045.2]],
    M_eff=[
        [232030.0, -4190.0, -132710.0],
        [-4190.0, 205190.0, -90270.0],
        [-132710.0, -90270.0, 443950.0],
    ],
    B=[0.00409, -0.0029, 0.00354],
    r=[0.098, -0.234, 0.835],
    Lambda=[[0.01418, 0.00125, -0.00784], [0.00125, 0.0113, 0.0032], [-0.00784, 0.0032, -0.02548]],
    omega_0=[-0.30907, -0.10256, 0.02151],
)
"""Two of its moments of inertia are almost the same."""

LAGGED = dict(
    inertia=[[4606.3, -660.2, -947.4], [-660.2, 4219.9, -991.0], [-947.4, -991.0, 5113.1]],
    M_eff=[[469080.0, 6340.0, 100090.0], [6340.0, 349090.0, 8540.0], [100090.0, 8540.0, 447770.0]],
    B=[0.00249, 0.00794, -0.00163],
    r=[-0.47, -0.031, 0.324],
    Lambda=[
        [0.00228, -0.01763, 0.00258],
        [-0.01763, 0.00959, -0.00614],
        [0.00258, -0.00614, -0.01187],
    ],
    omega_0=[-0.15388, 0.01667, 0.03987],
)

NEAR_SPHERE = dict(
    inertia=[[3744.0, -330.2, -230.9], [-330.2, 3603.9, -415.0], [-230.9, -415.0, 3471.2]],
    M_eff=[
        [458010.0, -5160.0, -43830.0],
        [-5160.0, 417730.0, 162120.0],
        [-43830.0, 162120.0, 411030.0],
    ],
    B=[0.00504, 0.00619, -0.0018],
    r=[0.998, 0.422, 0.415],
    Lambda=[
        [-0.00777, -0.01768, 0.0002],
        [-0.01768, 0.00558, 0.01223],
        [0.0002, 0.01223, 0.00218],
    ],
    omega_0=[-0.02357, -0.15138, -0.09436],
)
"""Its fits take a few steps more than others."""


def run(body, rate_noise, torque_noise, later_noise, seed, camera=None, **settings):
    """The log, and the true rates beside it; `camera`: the samples at which rates are read, and
    their noise."""
    settings = dict(x_noise=rate_noise, y_noise=torque_noise, output_noise=later_noise) | settings
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in body.items()})
    record = model.simulate((RECORDED + ONLINE) * DT, DT, integrator="accurate")
    draw = np.random.default_rng(seed)
    x = record.x[: RECORDED + 1] + rate_noise * draw.standard_normal((RECORDED + 1, 3))
    y = record.y + torque_noise * draw.standard_normal(record.y.shape)
    later = record.y[RECORDED:-1] + later_noise * draw.standard_normal((ONLINE, 3))
    history = ddmhe.History(x, y[:RECORDED], dt=DT)
    read = None
    if camera is not None:
        at, settings["rate_noise"] = camera
        read = np.full((ONLINE, 3), np.nan)
        read[at] = record.x[RECORDED:-1][at] + camera[1] * draw.standard_normal((len(at), 3))
    log = ddmhe.RigidBodyMhe(history, **settings).run(later, X=read)
    return log, record.x[RECORDED + 1 :]


@pytest.mark.parametrize("seed", range(4))
def test_bars_hold_for_ten_minutes(seed):
    """Between fits the filter is linear about the last one: it finds no information that a fit to
    the same data does not have. An extended filter's bars hold a quarter of these errors."""
    log, truth = run(SLOW, 1e-4, 0.01, 0.01, seed)
    assert np.mean(np.abs(log.x - truth) <= 2 * log.std) > 0.75


def test_a_fit_without_noise_goes_on_to_its_end():
    """Its steps are short where the valley is narrow: their gains alone would end it .03 deg/s
    off."""
    log, truth = run(FAST, 0.0, 0.0, 0.01, 0)
    error = np.linalg.norm(log.x - truth, axis=1)
    assert DEG * np.sqrt(np.mean(error[:1000] ** 2)) < 0.001
    assert DEG * np.sqrt(np.mean(error**2)) < 0.003


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("torque_noise", [0.01, 0.05])
def test_fits_in_slices_come_to_an_end(seed, torque_noise):
    """A round that begins anew whenever half as much has come in since never ends where a fit takes
    ten steps: the filter then goes on from the recording alone, trusted and deg/s off."""
    log, truth = run(NEAR_SPHERE, 1e-3, torque_noise, torque_noise, seed, refit="sliced")
    off = np.abs(log.x - truth)
    assert np.mean(off <= 2 * log.std) > 0.9
    assert np.mean(log.trusted & np.any(off > 5 * log.std, axis=1)) < 0.01


ONCE_A_SECOND = np.arange(7, 600, 10)  # for a minute


@pytest.mark.parametrize(
    "camera", [None, (ONCE_A_SECOND, 1e-6), (np.arange(200), 1e-6)], ids=["no", "slow", "fast"]
)
def test_means_say_what_their_samples_say(camera):
    """Fits in slices are of means over up to ten samples: to the rates of the middle alone these
    are of a torque .03 % too small, which is eight deviations here. Rates that a camera reads on
    the way count for the instants that they are of."""
    x = {}
    for refit in ("now", "sliced"):
        log, _ = run(LAGGED, 1e-6, 1e-5, 1e-4, 0, camera, refit=refit)
        x[refit], std = log.x[2000:], log.std[2000:]
    assert np.max(np.abs(x["sliced"] - x["now"]) / std) < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_fits_in_slices_come_to_an_end_where_a_camera_sees(seed):
    """Sample by sample a round took up to minutes, and what the camera had shown was lost."""
    camera = (ONCE_A_SECOND, 1e-4)
    log, truth = run(SLOW, 1e-3, 0.01, 0.01, seed, camera, refit="sliced")
    off = np.abs(log.x - truth)
    assert np.mean(off <= 2 * log.std) > 0.9


@pytest.mark.parametrize(
    ("body", "noise", "line"), [(SLOW, 1e-3, True), (SLOW, 1e-5, False), (FAST, 1e-4, False)]
)
def test_rates_along_a_line_are_told(body, noise, line):
    """Where recorded rates spread in one direction alone, many bodies explain them."""
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in body.items()})
    record = model.simulate(RECORDED * DT, DT, integrator="accurate")
    draw = np.random.default_rng(0)
    x = record.x[: RECORDED + 1] + noise * draw.standard_normal((RECORDED + 1, 3))
    y = record.y[:RECORDED] + 0.01 * draw.standard_normal((RECORDED, 3))
    made = ddmhe.RigidBodyMhe(ddmhe.History(x, y, dt=DT), x_noise=noise, y_noise=0.01)
    spread = np.sqrt(np.sort(np.linalg.eigvalsh(np.cov((x / noise).T, bias=True)))[1])
    told = [words for words in made.warnings if "second direction" in words]
    assert (spread < 3) == line == bool(told)
    assert all(f"({spread:.1f} times their noise)" in words for words in told)


def test_a_copy_goes_on_between_late_fits():
    """About the same motion of the same fit."""
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in SLOW.items()})
    record = model.simulate(100.0, DT, integrator="accurate")
    y = record.y + 0.01 * np.random.default_rng(5).standard_normal(record.y.shape)
    history = ddmhe.History(record.x[: RECORDED + 1], y[:RECORDED], dt=DT)
    est = ddmhe.RigidBodyMhe(history, output_noise=0.01)
    est.run(y[RECORDED:-150])
    other = ddmhe.RigidBodyMhe.restore(est.snapshot())
    a, b = est.run(y[-150:-1]), other.run(y[-150:-1])
    assert np.array_equal(a.x, b.x)
    assert np.array_equal(a.covariance, b.covariance)


def double_pendulum(steps):
    """Angle of the second of two equal rods with a mass at each end, and both rates; g/l = 1."""

    def slope(s):
        a, b, u, v = s
        d = a - b
        share = 3 - np.cos(2 * d)
        one = 3 * np.sin(a) + np.sin(a - 2 * b) + 2 * np.sin(d) * (v * v + u * u * np.cos(d))
        two = 2 * np.sin(d) * (2 * u * u + 2 * np.cos(a) + v * v * np.cos(d))
        return np.array([u, v, -one / share, two / share])

    states, h = [np.array([1.0, -0.5, 0.0, 0.0])], DT / 4
    for _ in range(steps):
        s = states[-1]
        for _ in range(4):
            a = slope(s)
            b = slope(s + h / 2 * a)
            c = slope(s + h / 2 * b)
            s = s + h / 6 * (a + 2 * b + 2 * c + slope(s + h * c))
        states.append(s)
    return np.array(states)[:, 1:]


def test_what_neither_a_body_nor_an_affine_motion_explains_goes_to_who_foretells_its_ends():
    """A rigid body fits these angles better than an affine motion does, and foretells them worse:
    followed, it was 13 times as far off as DdMhe."""
    x = double_pendulum(RECORDED + 400)
    y = x[:-1] @ [[1.0, 0.0], [0.2, 1.0], [0.0, 0.3]]
    draw = np.random.default_rng(6)
    x = x + 1e-3 * x.std() * draw.standard_normal(x.shape)
    y = y + 1e-3 * y.std() * draw.standard_normal(y.shape)
    history = ddmhe.History(x[: RECORDED + 1], y[:RECORDED], dt=DT)
    est = ddmhe.RigidBodyMhe(history)
    assert not est.explained
    a, b = est.run(y[RECORDED:]), ddmhe.DdMhe(history).run(y[RECORDED:])
    assert set(a.status) == {"affine"}
    assert np.array_equal(a.x, b.x)
    est.reset()
    assert np.array_equal(est.run(y[RECORDED:]).x, b.x)


def test_no_estimate_of_a_body_that_does_not_explain_its_recording_is_trusted():
    """The torque sensor lags by two seconds, which is not looked for: a body still foretells the
    recording's ends better than DdMhe, but leaves residuals that are no noise."""
    model = ddmhe.models.detumbling(**{name: np.array(value) for name, value in LAGGED.items()})
    record = model.simulate(80.0, DT, integrator="accurate")
    y, keep = record.y.copy(), np.exp(-DT / 2.0)
    for k in range(1, len(y)):
        y[k] = keep * y[k - 1] + (1 - keep) * 0.5 * (record.y[k] + record.y[k - 1])
    draw = np.random.default_rng(6)
    y += 0.01 * draw.standard_normal(y.shape)
    x = record.x + 1e-4 * draw.standard_normal(record.x.shape)
    history = ddmhe.History(x[: RECORDED + 1], y[:RECORDED], dt=DT)
    est = ddmhe.RigidBodyMhe(history, x_noise=1e-4, y_noise=0.01, output_lag=False)
    assert not est.explained
    log = est.run(y[RECORDED:-1])
    assert "structured" in set(log.status)
    assert not log.trusted.any()
    assert any("no estimate is trusted" in words for words in est.warnings)


def test_noise_that_is_stated_too_small_is_no_reason_to_distrust_a_body():
    """What it leaves is white: it goes on with as much noise as that."""
    log, truth = run(SLOW, 1e-4, 0.01, 0.01, 5, x_noise=5e-5, y_noise=0.005, output_noise=0.01)
    assert set(log.status[:400]) == {"structured"}
    assert log.trusted[:100].all()
    assert DEG * np.abs(log.x - truth)[:400].max() < 0.2
