"""The models against closed forms, conservation laws and a second formulation at 50 digits."""

import math

import mpmath
import numpy as np
import pytest
from scipy.special import ellipk

from ddmhe import DdmheError, NotFiniteError, ShapeError
from ddmhe.models import TorqueCurve, detumbling, pendulum, spin_down

OMEGAS = np.array([[0.25, 0.02, 0.06], [-1.0, 0.5, 2.0], [0.0, 0.0, 0.0], [1e-3, -2e-3, 4e-3]])


def skew(v):
    """The matrix S with S u = v × u."""
    a, b, c = (mpmath.mpf(float(e)) for e in v)
    return mpmath.matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]])


def exact(array):
    return mpmath.matrix([[mpmath.mpf(float(e)) for e in row] for row in np.atleast_2d(array)])


def floats(column):
    return np.array([float(e) for e in column])


@pytest.mark.parametrize("omega", OMEGAS)
def test_detumbling_equations_agree_with_skew_matrices_at_50_digits(omega):
    model = detumbling(omega_chaser=[0.01, -0.02, 0.03])
    with mpmath.workdps(50):
        S_B, w = skew(model.B), exact(omega).T
        slip = w - exact(model.omega_chaser).T
        # u × B = -B × u: (39) τ_t = S_B M S_B slip, (41) F = -Λ M S_B slip
        tau = S_B * exact(model.M_eff) * S_B * slip
        force = -exact(model.Lambda) * exact(model.M_eff) * S_B * slip
        tau_c = -tau - skew(model.r) * force
        rate = mpmath.lu_solve(exact(model.inertia), tau - skew(omega) * exact(model.inertia) * w)
    scale = np.abs(floats(tau)).max()
    np.testing.assert_allclose(model.torque(omega), floats(tau), rtol=1e-13, atol=1e-14 * scale)
    np.testing.assert_allclose(model.output(omega), floats(tau_c), rtol=1e-13, atol=1e-13 * scale)
    np.testing.assert_allclose(model.derivative(omega), floats(rate), rtol=1e-13, atol=1e-15)


def test_detumbling_with_an_isotropic_target_brakes_across_the_field():
    """(ω × B) × B = B (B·ω) - ω |B|²."""
    model = detumbling(M_eff=np.eye(3), B=[1.0, 2.0, -2.0])
    omega = np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(
        model.torque(omega), model.B * (model.B @ omega) - 9 * omega, rtol=1e-14
    )


def test_detumbling_output_does_not_see_rotation_about_the_field():
    model = detumbling()
    assert np.abs(model.output(7.0 * model.B / np.linalg.norm(model.B))).max() < 1e-12


def test_models_take_many_states_at_once():
    for model, states in (
        (detumbling(), OMEGAS),
        (spin_down(), OMEGAS[:, :1]),
        (pendulum(), OMEGAS[:, :2]),
    ):
        for of_state in (model.derivative, model.output):
            np.testing.assert_allclose(
                of_state(states), np.array([of_state(x) for x in states]), rtol=1e-14
            )


def test_paper_parameters():
    model = detumbling()
    np.testing.assert_array_equal(np.diag(model.inertia), [4513.2, 4138.1, 3282.5])
    np.testing.assert_allclose(
        np.rad2deg(model.simulate(1.0, 0.1).x[0]), [14.364, 1.224, 3.4195], rtol=1e-15
    )
    np.testing.assert_allclose(np.diag(model.M_eff), [525812.0, 525812.0, 173639.0], rtol=1e-14)
    np.testing.assert_array_equal(model.Lambda, model.Lambda.T)
    assert abs(np.trace(model.Lambda)) < 1e-18  # a magnetic field has no divergence


def test_torque_free_tumbling_keeps_energy_and_angular_momentum():
    inertia = np.array([[4500.0, 120.0, -80.0], [120.0, 4100.0, 60.0], [-80.0, 60.0, 3300.0]])
    x = (
        detumbling(inertia=inertia, B=np.zeros(3), omega_0=[0.4, 0.2, -0.3])
        .simulate(200, 0.5, integrator="accurate")
        .x
    )
    energy = np.einsum("ki,ij,kj->k", x, inertia, x)
    momentum = np.linalg.norm(x @ inertia, axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-12)
    assert np.ptp(x, axis=0).min() > 0.1  # it does tumble


def test_torque_free_symmetric_top_precesses_at_the_textbook_rate():
    """Two equal moments I1: (ω1, ω2) turns at (I3 - I1)/I1 ω3, ω3 stays."""
    model = detumbling(inertia=[2.0, 2.0, 3.0], B=np.zeros(3), omega_0=[0.3, 0.0, 1.0])
    r = model.simulate(20, 0.1, integrator="accurate")
    np.testing.assert_allclose(r.x[:, 0], 0.3 * np.cos(0.5 * r.t), atol=1e-10)
    np.testing.assert_allclose(r.x[:, 1], 0.3 * np.sin(0.5 * r.t), atol=1e-10)
    np.testing.assert_allclose(r.x[:, 2], 1.0, atol=1e-10)


def test_braking_takes_energy_all_the_time():
    model = detumbling()
    x = model.simulate(600, 0.5, integrator="accurate").x
    assert (np.diff(np.einsum("ki,ij,kj->k", x, model.inertia, x)) < 0).all()


@pytest.mark.parametrize("make", [detumbling, spin_down, pendulum])
def test_euler_is_the_printed_formula_and_converges_to_the_accurate_solution(make):
    model = make()
    r = model.simulate(1.0, 0.01)
    np.testing.assert_array_equal(r.x[1:], [x + 0.01 * model.derivative(x) for x in r.x[:-1]])
    reference = model.simulate(1.0, 0.1, integrator="accurate").x[-1]
    coarse, fine = (np.abs(model.simulate(1.0, dt).x[-1] - reference).max() for dt in (1e-2, 1e-3))
    assert 0.09 < fine / coarse < 0.11  # first order


@pytest.mark.parametrize("make", [detumbling, spin_down, pendulum])
def test_recording_has_the_shapes_of_the_contract_and_reproducible_noise(make):
    clean, noisy = (make().simulate(30.0, 0.1, noise=level, seed=3) for level in (0.0, 0.5))
    assert clean.t.shape == (301,)
    assert clean.x.shape[0] == clean.y.shape[0] == 301
    np.testing.assert_allclose(np.diff(clean.t), 0.1, rtol=1e-10)
    np.testing.assert_array_equal(noisy.x, clean.x)
    expected = 0.5 * np.random.default_rng(3).standard_normal(clean.y.shape)
    np.testing.assert_allclose(noisy.y - clean.y, expected, atol=1e-12)
    np.testing.assert_array_equal(clean.y, make().output(clean.x))


def test_spin_down_without_friction_decays_exponentially():
    model = spin_down(viscous=0.0, coulomb=0.0, inertia=2e-3, eddy=1e-3, omega_0=10.0)
    r = model.simulate(4.0, 0.01, integrator="accurate")
    np.testing.assert_allclose(r.x[:, 0], 10 * np.exp(-0.5 * r.t), rtol=1e-10)
    np.testing.assert_allclose(r.y[:, 0], 1e-2 * np.exp(-0.5 * r.t), rtol=1e-10)


def test_spin_down_with_friction_stops_and_stays():
    """Coulomb friction alone: ω falls at coulomb/inertia until it is at rest."""
    model = spin_down(
        viscous=0.0, eddy=0.0, coulomb=5e-3, inertia=5e-3, omega_0=2.0, coulomb_speed=1e-3
    )
    x = model.simulate(3.0, 1e-3).x[:, 0]
    np.testing.assert_allclose(x[1000], 1.0, atol=1e-9)
    assert np.abs(x[2100:]).max() < 1e-3


def test_torque_curve_is_odd_linear_between_points_and_replaces_the_linear_law():
    curve = TorqueCurve([0.0, 10.0, 20.0], [0.0, 4.0, 2.0])
    np.testing.assert_allclose(
        curve([-15.0, -5.0, 0.0, 5.0, 10.0, 15.0, 99.0]), [-3, -2, 0, 2, 4, 3, 2], rtol=1e-15
    )
    straight = TorqueCurve([0.0, 50.0], [0.0, 0.25])
    linear, tabulated = (spin_down(torque_curve=c).simulate(2.0, 0.01) for c in (None, straight))
    np.testing.assert_allclose(tabulated.x, linear.x, rtol=1e-12)


def test_torque_curve_from_csv(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("slip_speed_rpm,torque_N_m\n0,0\n60,1.5\n120,2.0\n")
    np.testing.assert_allclose(TorqueCurve.from_csv(path)(2 * math.pi), 1.5, rtol=1e-14)


def test_transducer_bias_and_encoder_rounding():
    exact_one, rough = spin_down(torque_bias=0.02), spin_down(encoder_counts=1000)
    np.testing.assert_allclose(exact_one.output([0.0]), [0.02])
    r = rough.simulate(0.5, 0.01)
    count = 2 * math.pi / (1000 * 0.01)
    np.testing.assert_allclose(r.x_recorded / count, np.round(r.x_recorded / count), atol=1e-9)
    assert 0 < np.abs(r.x_recorded - r.x).max() <= count / 2
    np.testing.assert_array_equal(
        exact_one.simulate(0.5, 0.01).x_recorded, exact_one.simulate(0.5, 0.01).x
    )


def test_pendulum_step_is_the_system_of_the_paper():
    """(60): A = [[1, .065], [0, 1]], f = (0, -.065 sin x1), C = [1 0]."""
    model = pendulum()
    r = model.simulate(100 * model.paper_dt, model.paper_dt)
    f = np.column_stack([np.zeros(100), -0.065 * np.sin(r.x[:-1, 0])])
    np.testing.assert_allclose(
        r.x[1:], r.x[:-1] @ np.array([[1, 0.065], [0, 1]]).T + f, rtol=1e-14, atol=1e-16
    )
    np.testing.assert_array_equal(r.y, r.x[:, :1])


def test_pendulum_has_the_period_of_the_elliptic_integral():
    """From rest at θ0 it returns after 4 K(sin²(θ0/2)) / sqrt(stiffness)."""
    period = 4 * ellipk(math.sin(0.5) ** 2) / math.sqrt(2.0)
    r = pendulum(stiffness=2.0).simulate(period, period / 4, integrator="accurate")
    np.testing.assert_allclose(r.x[[2, 4]], [[-1.0, 0.0], [1.0, 0.0]], atol=1e-10)


WRONG = [
    (
        lambda: detumbling(mass=3.0),
        DdmheError,
        r"mass: expected a parameter of Detumbling: inertia, M_eff",
    ),
    (
        lambda: detumbling(inertia=[1.0, 2.0]),
        ShapeError,
        r"inertia: expected shape \(3, 3\), found \(2,\)",
    ),
    (
        lambda: detumbling(inertia=[1.0, 2.0, -1.0]),
        DdmheError,
        "inertia: expected a symmetric positive definite",
    ),
    (
        lambda: detumbling(inertia=np.arange(9.0).reshape(3, 3)),
        DdmheError,
        "inertia: expected a symmetric",
    ),
    (lambda: detumbling(B=[np.nan, 0, 0]), NotFiniteError, "B: expected finite numbers"),
    (lambda: detumbling(r="abc"), ShapeError, "r: expected an array of real numbers, found str"),
    (lambda: spin_down(inertia=0.0), DdmheError, "inertia: expected a number above 0, found 0"),
    (lambda: spin_down(eddy=-1.0), DdmheError, "eddy: expected a number of at least 0, found -1"),
    (lambda: spin_down(omega_0=[1.0, 2.0]), ShapeError, "omega_0: expected shape"),
    (lambda: spin_down(encoder_counts=0), DdmheError, "encoder_counts: expected a whole number"),
    (
        lambda: spin_down(torque_curve=3),
        DdmheError,
        "torque_curve: expected a TorqueCurve or None, found int",
    ),
    (
        lambda: spin_down(torque_curve=TorqueCurve([0, 1], [0, 1])),
        DdmheError,
        "torque_curve: expected speeds up to",
    ),
    (lambda: TorqueCurve([0.0], [0.0]), ShapeError, "speed: expected at least 2 speeds"),
    (
        lambda: TorqueCurve([0.0, 1.0, 1.0], [0, 1, 1]),
        DdmheError,
        "speed: expected speeds that start at 0",
    ),
    (lambda: TorqueCurve([0.0, 1.0], [0.0, -1.0]), DdmheError, "torque: expected braking torques"),
    (
        lambda: TorqueCurve([0.0, 1.0], [0.0]),
        ShapeError,
        r"torque: expected shape \(2,\), found \(1,\)",
    ),
    (
        lambda: TorqueCurve.from_csv("no-such-file.csv"),
        DdmheError,
        "path: expected a readable CSV file",
    ),
    (lambda: pendulum(x_0=[1.0]), ShapeError, r"x_0: expected shape \(2,\), found \(1,\)"),
    (
        lambda: pendulum().simulate(1.0, 0.3),
        DdmheError,
        "duration: expected a multiple of dt = 0.3 s, found 1.0 s",
    ),
    (lambda: pendulum().simulate(-1.0, 0.1), DdmheError, "duration: expected a positive number"),
    (lambda: pendulum().simulate(1.0, 0.0), DdmheError, "dt: expected a positive number"),
    (
        lambda: pendulum().simulate(1.0, math.nan),
        DdmheError,
        "dt: expected a positive number of seconds, found nan",
    ),
    (
        lambda: pendulum().simulate(1.0, 0.1, noise=-0.1),
        DdmheError,
        "noise: expected a finite number of at least 0",
    ),
    (
        lambda: pendulum().simulate(1.0, 0.1, integrator="rk4"),
        DdmheError,
        "integrator: expected one of euler, accurate",
    ),
    (
        lambda: detumbling(B=[9.0, 9, 9]).simulate(300.0, 1.0),
        DdmheError,
        "dt: expected one small enough",
    ),
]


@pytest.mark.parametrize(("make", "kind", "text"), WRONG)
def test_wrong_input_is_an_error_that_names_it(make, kind, text):
    with pytest.raises(kind, match=text):
        make()


def test_curve_file_without_the_columns_is_an_error(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("speed,torque\n0,0\n60,1.5\n")
    with pytest.raises(DdmheError, match="path: expected columns slip_speed_rpm and torque_N_m"):
        TorqueCurve.from_csv(path)


def test_parameters_cannot_be_changed_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        detumbling().B[0] = 1.0


def test_a_recording_becomes_a_history_with_its_units():
    record = spin_down(encoder_counts=4096).simulate(1.0, 0.01, noise=1e-4)
    history = record.history(60)
    (x, y), *_ = history.recordings
    np.testing.assert_array_equal(x, record.x_recorded[:61])
    np.testing.assert_array_equal(y, record.y[:60])
    assert (history.dt, history.x_units, history.y_units) == (0.01, ["rad/s"], ["N m"])
    assert record.history().T == 100
    assert pendulum().simulate(1.3, 0.065).history().x_units == ["rad", "rad/s"]
    assert detumbling().simulate(1.0, 0.1).history().y_units == ["N m"] * 3
    for samples in (0, 101, 2.0, True):
        with pytest.raises(DdmheError, match=r"^samples: expected"):
            record.history(samples)
