"""Known inputs: exact where linear systems allow it, equal to model-based estimation, honest about
what the recording cannot tell, and errors for whatever is no input."""

import pickle

import numpy as np
import pytest
import quadprog

import ddmhe
from ddmhe._core import DdmheError
from driven import Driven


class Known(Driven):
    """A system whose windows are estimated by the true model."""

    @classmethod
    def random(cls, rng, n, m, p, radius=0.95):
        """With this spectral radius."""
        A = rng.standard_normal((n, n))
        A = A * radius / max(abs(np.linalg.eigvals(A)))
        B, D = rng.standard_normal((n, m)), rng.standard_normal((p, m))
        C, e, r = (rng.standard_normal(shape) for shape in ((p, n), n, p))
        return cls(A=A, B=B, e=e, C=C, D=D, r=r)

    def window(self, u):
        """States = base + maps x(0), and outputs likewise: ((m+1), n), ((m+1), n, n), …"""
        n = len(self.A)
        x, Phi = np.zeros(n), np.eye(n)
        base_x, map_x, base_y, map_y = [x], [Phi], [], []
        for k in range(len(u)):
            base_y.append(self.C @ x + self.D @ u[k] + self.r)
            map_y.append(self.C @ Phi)
            x, Phi = self.A @ x + self.B @ u[k] + self.e, self.A @ Phi
            base_x.append(x)
            map_x.append(Phi)
        return map(np.array, (base_x, map_x, base_y, map_y))

    def estimate(self, y, u, prior, rho, mu, x_box=None, v_box=None):
        """The window (17) with boxes (16c, 16d) by the true model, in x(0) alone; states."""
        base_x, map_x, base_y, map_y = self.window(u)
        M, n = len(u), len(self.A)
        F, f = [np.sqrt(2 * rho**M) * np.eye(n)], [np.sqrt(2 * rho**M) * prior]
        G, h = [], []
        for k in range(M):
            seen = np.isfinite(y[k])
            w = np.sqrt(mu * rho ** (M - 1 - k))
            F.append(w * map_y[k][seen])
            f.append(w * (y[k] - base_y[k])[seen])
            if v_box is not None:  # y - base - map x in [lo, hi]
                left = (y[k] - base_y[k])[seen]
                G += [map_y[k][seen], -map_y[k][seen]]
                h += [left - v_box[1], -(left - v_box[0])]
        if x_box is not None:
            for k in range(M + 1):
                G += [map_x[k], -map_x[k]]
                h += [x_box[0] - base_x[k], -(x_box[1] - base_x[k])]
        F, f = np.vstack(F), np.concatenate(f)
        if G:
            G, h = np.vstack(G), np.concatenate(h)
            x0 = quadprog.solve_qp(F.T @ F, F.T @ f, G.T, h)[0]
        else:
            x0 = np.linalg.lstsq(F, f, rcond=None)[0]
        return base_x + map_x @ x0


def inputs(kind, rng, T, m):
    if kind == "steps":
        return np.repeat(rng.standard_normal((4, m)), -(-T // 4), axis=0)[:T]
    if kind == "sine":
        return np.sin(0.3 * np.arange(T)[:, None] + np.arange(m)) + 3
    return rng.standard_normal((T, m)) + 3


@pytest.mark.parametrize("kind", ["white", "steps", "sine", "as short as can be"])
def test_estimates_of_a_noise_free_linear_system_are_exact(kind):
    """100 systems with offsets and feed-through; online inputs are three times as large and of
    another kind."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        n, m, p = (int(k) for k in rng.integers((1, 1, 1), (5, 3, 3)))
        system, M = Known.random(rng, n, m, p), int(rng.integers(2, 13))
        # n + 1 windows, and as many samples as the response has parameters
        T = 60 + M if kind != "as short as can be" else max(M + n, n + m + 1)
        u = inputs(kind, rng, T, m)
        x, y = system.simulate(3 * rng.standard_normal(n), u)
        est = ddmhe.DdMhe(ddmhe.History(x, y, u=u), M, space=ddmhe.Exact(), start="state")
        U = 3 * rng.standard_normal((3 * M, m))
        truth, Y = system.simulate(3 * rng.standard_normal(n), U)
        est.reset(truth[0])
        assert (abs(est.run(Y, U).x - truth[1:]) <= 1e-9 * x.std(axis=0)).all(), seed


@pytest.mark.parametrize("boxed", [False, True])
def test_noisy_windows_are_those_of_the_true_model(boxed):
    """Boxes move with the forced motion, and lost outputs are lost."""
    touched = 0
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        n, m, p = (int(k) for k in rng.integers((1, 1, 1), (5, 3, 3)))
        system, M = Known.random(rng, n, m, p), int(rng.integers(2, 9))
        u = inputs("white", rng, 80, m)
        x, y = system.simulate(3 * rng.standard_normal(n), u)
        U = 3 * rng.standard_normal((M, m))
        truth, Y = system.simulate(3 * rng.standard_normal(n), U)
        Y = Y + 0.3 * rng.standard_normal(Y.shape)
        Y[rng.random(Y.shape) < 0.15] = np.nan
        prior = truth[0] + rng.standard_normal(n)
        boxes, given = {}, {}
        if boxed:
            # tight about the truth: feasible, and active
            x_box = (truth.min(axis=0) - 0.05, truth.max(axis=0) + 0.05)
            boxes = {"x_box": x_box, "v_box": (-1.2, 1.2)}
            given = {"x_bounds": x_box, "v_bounds": (-1.2, 1.2)}
        est = ddmhe.DdMhe(
            ddmhe.History(x, y, u=u),
            M,
            0.9,
            0.7,
            prior,
            space=ddmhe.Exact(),
            start="state",
            **given,
        )
        for k in range(M):
            found = est.step(Y[k], U[k])
        expected = system.estimate(Y, U, prior, 0.9, 0.7, **boxes)
        assert found.status == "optimal"
        touched += found.active > 0
        assert (abs(found.window - expected) <= 1e-8 * x.std(axis=0)).all(), seed
        fitted = Y - np.array(
            [system.C @ a + system.D @ b for a, b in zip(found.window[:-1], U, strict=True)]
        )
        assert np.allclose(found.v, fitted - system.r, atol=1e-7 * y.std(), equal_nan=True)
    assert touched >= (25 if boxed else 0)


def driven_recording(seed=0, T=120, noise=0.01, n=3, m=2, p=2):
    rng = np.random.default_rng(seed)
    system = Known.random(rng, n, m, p)
    u = inputs("white", rng, T + 60, m)
    x, y = system.simulate(rng.standard_normal(n), u)
    y = y + noise * rng.standard_normal(y.shape)
    recorded = x + noise * rng.standard_normal(x.shape)
    return ddmhe.History(recorded[: T + 1], y[:T], 0.1, u[:T]), x[T:], y[T:], u[T:]


@pytest.mark.parametrize("start", ["state", "recording", "unknown"])
def test_run_step_snapshot_and_copies_give_the_same_numbers(start):
    h, x, Y, U = driven_recording()
    est = ddmhe.DdMhe(h, start=start, x_bounds=(-20.0, 20.0))
    whole = est.run(Y, U).x
    est.reset()
    first = [est.step(y, u).x for y, u in zip(Y[:25], U[:25], strict=True)]
    for other in (ddmhe.DdMhe.restore(est.snapshot()), pickle.loads(pickle.dumps(est))):
        assert np.array_equal(other.run(Y[25:], U[25:]).x, whole[25:])
    assert np.array_equal(first, whole[:25])
    many = ddmhe.run_many([ddmhe.DdMhe(h, start=start, x_bounds=(-20.0, 20.0))], [Y], [U])
    assert np.array_equal(many[0].x, whole)
    # started right, or found within a window: the noise is a hundredth
    settled = 0 if start != "unknown" else 20
    assert np.sqrt(np.mean((whole - x[1:])[settled:] ** 2)) < 0.1


def test_joined_recordings_and_their_inputs():
    system = Known.random(np.random.default_rng(5), 3, 1, 2)
    rng = np.random.default_rng(6)
    parts = []
    for _ in range(3):
        u = rng.standard_normal((25, 1))
        parts.append((*system.simulate(rng.standard_normal(3), u), u))
    h = ddmhe.History.concat([ddmhe.History(x, y, u=u) for x, y, u in parts])
    assert (h.m, [u.shape for u in h.inputs]) == (1, [(25, 1)] * 3)
    assert np.array_equal(h.inputs[1], parts[1][2])
    U = rng.standard_normal((40, 1))
    truth, Y = system.simulate(rng.standard_normal(3), U)
    est = ddmhe.DdMhe(h, start="state")
    est.reset(truth[0])
    assert np.allclose(est.run(Y, U).x, truth[1:], atol=1e-9)
    with pytest.raises(ddmhe.ShapeError, match="p = 2, m = 1 in every recording, found n = 3"):
        ddmhe.History.concat([h, h.without_inputs()])


def test_a_rest_held_by_inputs_joins_noisy_data():
    """At the rest, far from a short noisy recording, which it contradicts without its u_e."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        system = Known.random(rng, 3, 1, 1)
        u = rng.standard_normal((40, 1))
        x, y = system.simulate(rng.standard_normal(3), u)
        noisy = (x + 0.1 * rng.standard_normal(x.shape), y + 0.1 * rng.standard_normal(y.shape))
        h = ddmhe.History(*noisy, u=u)
        u_e = np.array([8.0])
        x_e = np.linalg.solve(np.eye(3) - system.A, system.B @ u_e + system.e)
        y_e = system.C @ x_e + system.D @ u_e + system.r
        Y, U = y_e + 0.1 * rng.standard_normal((60, 1)), np.repeat(u_e[None], 60, axis=0)

        def error(h=h, x_e=x_e, Y=Y, U=U, **settings):
            est = ddmhe.DdMhe(h, start="state", **settings)
            est.reset(x_e)
            return np.sqrt(np.mean((est.run(Y, U).x - x_e) ** 2))

        right = error(equilibrium=(x_e, y_e, u_e))
        assert right < 0.5 * error()
        assert right < 0.5 * error(equilibrium=(x_e, y_e, 0 * u_e))
    with pytest.raises(
        ddmhe.ShapeError, match=r"equilibrium: expected three items \(x_e, y_e, u_e"
    ):
        ddmhe.DdMhe(h, equilibrium=(x_e, y_e))


def test_errors_name_the_input():
    h, _, Y, U = driven_recording()
    est, plain = ddmhe.DdMhe(h), ddmhe.DdMhe(h.without_inputs())
    y, u = Y[0], U[0]
    nan, huge = np.array([1.0, np.nan]), np.array([1.0, 1e300])
    for call, kind, message in [
        (lambda: est.step(y), ddmhe.ShapeError, "u: expected 2 numbers, the inputs at the instant"),
        (lambda: est.step(y, u[:1]), ddmhe.ShapeError, "u: expected"),
        (lambda: est.step(y, nan), ddmhe.NotFiniteError, "u: .* row 0, column 1"),
        (lambda: est.step(y, huge), DdmheError, "u: expected at most .* standard deviations"),
        (lambda: plain.step(y, u), ddmhe.ShapeError, "u: expected none, for a recording without"),
        (lambda: est.run(Y), ddmhe.ShapeError, "U: expected 60 samples of 2 inputs"),
        (lambda: est.run(Y, U[1:]), ddmhe.ShapeError, r"U: expected shape \(60, 2\), one row for"),
        (lambda: plain.run(Y, U), ddmhe.ShapeError, "U: expected none, for a recording without"),
        (lambda: ddmhe.run_many(est, [Y]), ddmhe.ShapeError, "U: expected 60 samples"),
        (lambda: ddmhe.run_many(est, [Y], []), ddmhe.ShapeError, "inputs: expected 1, one per log"),
        (lambda: ddmhe.History(Y, Y[1:], u=U), ddmhe.ShapeError, "u: expected 59 samples of m = 2"),
        (lambda: ddmhe.History(Y, Y[1:], u_units="V"), DdmheError, "u_units: expected none"),
    ]:
        with pytest.raises(kind, match=message):
            call()
    # nothing of it has moved the window
    assert np.array_equal(est.run(Y, U).x, ddmhe.DdMhe(h).run(Y, U).x)


def warned(h, words):
    return [w for w in ddmhe.DdMhe(h).warnings if words in w]


def test_what_the_recording_cannot_tell_of_its_inputs_is_said():
    rng = np.random.default_rng(8)
    system = Known.random(rng, 3, 2, 2)
    white = rng.standard_normal((200, 2))

    def history(u, shift=0, noise=1e-3):
        x, y = system.simulate(rng.standard_normal(3), u)
        y = y + noise * rng.standard_normal(y.shape)
        x = x + noise * rng.standard_normal(x.shape)
        return ddmhe.History(x, y, u=np.roll(u, shift, axis=0))

    assert not [w for w in ddmhe.DdMhe(history(white)).warnings if "input" in w]
    still = white * [1.0, 0.0] + [0.0, 0.7]
    assert warned(history(still), "input 1 (counted from 0) never changed in the recording")
    together = white[:, :1] * [1.0, -2.0]
    assert warned(history(together), "cannot be told apart")
    for shift in (1, -1):
        assert warned(history(white, shift), "a sample later" if shift < 0 else "a sample earlier")
    # feedback u = K x with a little dither
    u, x = np.zeros((200, 2)), np.ones(3)
    K = 0.1 * rng.standard_normal((2, 3))
    xs, ys = [x], []
    for k in range(200):
        u[k] = K @ x + 1e-3 * rng.standard_normal(2) + 0.02 * np.sin(0.3 * k)
        ys.append(system.C @ x + system.D @ u[k] + system.r)
        x = system.A @ x + system.B @ u[k] + system.e
        xs.append(x)
    assert warned(ddmhe.History(np.array(xs), np.array(ys), u=u), "a function of the states")


def test_inputs_that_leave_what_was_recorded_are_noticed():
    rng = np.random.default_rng(9)
    system = Known.random(rng, 2, 2, 2)
    u = rng.uniform(-1, 1, (150, 2)) * [1.0, 0.0]
    h = ddmhe.History(*system.simulate(np.ones(2), u), 0.1, u)
    est = ddmhe.DdMhe(h, 20, start="state")
    U = rng.uniform(-1, 1, (80, 2)) * [1.0, 0.0]
    Y = system.simulate(np.ones(2), U)[1]
    at_first = est.warnings
    est.run(Y[:30], U[:30])
    before = est.warnings
    far = U.copy()
    far[30:, 0], far[40:, 1] = 3.0, 0.5
    est.run(Y[30:], far[30:])
    new = [w for w in est.warnings if w not in before]
    # two of twenty are more than a twentieth; a step counts from 1
    assert [w for w in new if "input 0" in w and "from 3.2 s on (step 32)" in w]
    assert [w for w in new if "input 1" in w and "from 4.1 s on (step 41)" in w]
    est.reset()
    assert est.warnings == at_first


def test_an_input_that_never_moved_is_ignored():
    rng = np.random.default_rng(10)
    system = Known.random(rng, 2, 1, 2)
    u = np.full((60, 1), 0.3)
    x, y = system.simulate(rng.standard_normal(2), u)
    still, without = ddmhe.History(x, y, u=u), ddmhe.History(x, y)
    Y = y[:40] + 0.01 * rng.standard_normal((40, 2))
    found = ddmhe.DdMhe(still, 8, start="state").run(Y, rng.standard_normal((40, 1))).x
    assert np.allclose(found, ddmhe.DdMhe(without, 8, start="state").run(Y).x, atol=1e-9)


def test_recordings_with_inputs_travel():
    h = driven_recording()[0]
    for other in (pickle.loads(pickle.dumps(h)), ddmhe.History.from_bytes(h.to_bytes())):
        assert (other.m, other.u_units) == (2, ["", ""])
        assert np.array_equal(other.inputs[0], h.inputs[0])
    assert "m=2" in repr(h)
    named = ddmhe.History(np.eye(3), np.eye(2), u=np.eye(2), u_units=["V", None])
    assert named.u_units == ["V", ""]
    assert h.without_inputs().inputs[0].shape == (120, 0)
