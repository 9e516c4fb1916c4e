"""RigidBodyMhe of several recordings of a body: against a dense least-squares problem of all their
unknowns, written down on its own, and as an object."""

import copy
import pickle

import numpy as np
import pytest
from scipy.optimize import least_squares

import ddmhe

DT, TURN, STEP = 0.1, 0.08, 1e-30
E = np.array([np.diag([1, -1, 0]), np.diag([1, 1, -2]) / np.sqrt(3)] + [np.zeros((3, 3))] * 3)
E[[2, 3, 4], [0, 0, 1], [1, 2, 2]] = E[[2, 3, 4], [1, 2, 2], [0, 0, 1]] = 1
E /= np.sqrt(2)
SPINS = ([0.12, -0.09, 0.05], [-0.03, 0.16, 0.02], [0.05, 0.06, -0.14])
"""First rates of the recordings, rad/s."""
LENGTHS = (120, 87, 150)
"""Their outputs."""
NOISE = dict(x_noise=1e-5, y_noise=1e-3, output_noise=1e-3)


class Dense:
    """The unknowns (ω_1(0), …, ω_K(0), j 5, β 2, S 3, G 6, r 3), of whose cost the residuals are

    (x - ω)/σx, (y - ŷ)/σy of all recordings, θ/sd."""

    def __init__(self, recordings, b0, N0, offset):
        self.recordings, self.b0, self.N0 = recordings, b0, N0
        x = np.concatenate([x for x, _ in recordings])
        y = np.concatenate([y[: len(x) - 1] for x, y in recordings])
        fastest = np.sqrt(np.max(np.sum(x**2, 1)))
        self.substeps = max(1, int(np.ceil(DT * fastest / TURN)))
        W, size = np.sqrt(np.mean(np.sum(x**2, 1))), np.sqrt(np.mean(y**2))
        of_r = 0.1 * (size if offset else NOISE["output_noise"])
        parts = [(5, 0.35), (2, 1.0), (3, 0.3 * W), (6, 10 * size / W), (3, of_r)]
        self.sd = np.concatenate([np.full(n, v) for n, v in parts])

    def parts(self, theta):
        """J, N, S, G, r of θ (…, 19)."""
        j, beta, S, G, r = np.split(theta, [5, 7, 10, 16], axis=-1)
        J = np.eye(3) + np.tensordot(j, E, 1)
        N = self.N0 - self.b0[:, None] * beta[..., None, :]
        S = S[..., [0, 1, 1, 2]].reshape(*S.shape[:-1], 2, 2)
        return J, N, S, G.reshape(*G.shape[:-1], 3, 2), r

    def motion(self, w, theta, samples):
        """ω and y (samples + 1, …, 3)."""
        J, N, S, G, r = self.parts(theta)
        T = np.swapaxes(N, -1, -2)
        inverse, D = np.linalg.inv(J), -N @ S @ T
        h, found = DT / self.substeps, [w]

        def along(A, w):
            return np.einsum("...ik,...k->...i", A, w)

        def f(w):
            return along(inverse, along(D, w) - np.cross(w, along(J, w)))

        for _ in range(samples):
            for _ in range(self.substeps):
                p = f(w)
                q = f(w + h / 2 * p)
                s = f(w + h / 2 * q)
                w = w + h / 6 * (p + 2 * q + 2 * s + f(w + h * s))
            found.append(w)
        x = np.array(found)
        return x, along(G @ T, x) + r

    def residuals(self, unknowns):
        """Of unknowns (…, n): (…, m)."""
        count = 3 * len(self.recordings)
        firsts, theta = unknowns[..., :count], unknowns[..., count:]
        rows = [-theta / self.sd]
        for i, (x, y) in enumerate(self.recordings):
            w, y_hat = self.motion(firsts[..., 3 * i : 3 * i + 3], theta, len(y))
            for read, found, noise in ((x, w, "x_noise"), (y, y_hat[:-1], "y_noise")):
                off = (read - np.moveaxis(found[: len(read)], 0, -2)) / NOISE[noise]
                rows.append(off.reshape(*off.shape[:-2], -1))
        return np.concatenate(rows, axis=-1)

    def chi(self, unknowns):
        """Mean squares of the residuals of x and y, and of their means over ten samples of one
        recording, times ten."""
        e = np.split(self.residuals(unknowns)[len(self.sd) :].reshape(-1, 3), self.ends()[:-1])
        blocks = [v[: len(v) // 10 * 10].reshape(-1, 10, 3).mean(1) for v in e]
        kinds = [np.concatenate(v) for v in (e[::2], e[1::2], blocks[::2], blocks[1::2])]
        return np.array([1, 1, 10, 10]) * [np.mean(v**2) for v in kinds]

    def ends(self):
        """Where in the samples of x, y, x, … each of them ends."""
        return np.cumsum([len(v) for recording in self.recordings for v in recording])

    def jacobian(self, unknowns, of=None):
        """By complex steps: no derivative is written down."""
        steps = 1j * STEP * np.eye(len(unknowns))
        return (of or self.residuals)(unknowns + steps).imag.T / STEP

    def solved(self, start):
        return least_squares(
            self.residuals, start, self.jacobian, method="lm", x_scale="jac",
            ftol=1e-15, xtol=1e-15, gtol=1e-15,
        ).x  # fmt: skip

    def said(self, unknowns):
        """Cost, evidence, χ, and ω a sample after the last recording's end with its covariance."""
        e, A = self.residuals(unknowns), self.jacobian(unknowns)
        R = np.linalg.qr(A, mode="r")
        log = np.sum(np.log(np.abs(np.diag(R)))) + np.sum(np.log(self.sd))
        last = slice(3 * len(self.recordings) - 3, 3 * len(self.recordings))
        count = len(self.recordings[-1][1]) + 1

        def ahead(unknowns):
            return self.motion(unknowns[..., last], unknowns[..., last.stop :], count)[0][-1]

        M = self.jacobian(unknowns, ahead) @ np.linalg.inv(R)
        return e @ e, -0.5 * e @ e - log, self.chi(unknowns), ahead(unknowns), M @ M.T


def plane(b):
    """Two directions (3, 2) that make an orthonormal basis with b."""
    return np.linalg.svd(b[None])[2][1:].T


def optimum(recordings, body):
    """The most probable motion, from the body's own parameters: with free offsets or without, about
    its own unseen direction."""
    J, D, C, b = body
    scale, best = np.trace(J) / 3, None
    for offset in (False, True):
        b0, N0 = b, plane(b)
        j = np.tensordot(E, J / scale, 2)
        S = -N0.T @ (D / scale) @ N0
        theta = np.r_[j, 0, 0, S[0, 0], S[0, 1], S[1, 1], (C @ N0).ravel(), np.zeros(3)]
        unknowns = np.r_[np.ravel([x[0] for x, _ in recordings]), theta]
        for _ in range(3):
            dense = Dense(recordings, b0, N0, offset)
            unknowns = dense.solved(unknowns)
            _, N, S, G, _ = dense.parts(unknowns[-19:])
            beta = unknowns[-14:-12]
            b0 = b0 + dense.N0 @ beta
            b0, (N0, U) = b0 / np.linalg.norm(b0), np.linalg.qr(N)
            S = U @ S @ U.T
            unknowns[-14:-3] = np.r_[0, 0, S[0, 0], S[0, 1], S[1, 1], (G @ U.T).ravel()]
        said = Dense(recordings, b0, N0, offset).said(unknowns)
        if best is None or said[1] > best[1]:
            best = said
    return best


def turning(lengths=LENGTHS, spins=SPINS, after=0):
    """Recordings of a tumbling body at several spins, what follows the last, the true rates there,
    and the body."""
    draw, parts = np.random.default_rng(0), []
    for length, spin in zip(lengths, spins, strict=True):
        model = ddmhe.models.detumbling(omega_0=np.array(spin))
        record = model.simulate((length + after) * DT, DT, integrator="accurate")
        x = record.x + NOISE["x_noise"] * draw.standard_normal(record.x.shape)
        y = record.y + NOISE["y_noise"] * draw.standard_normal(record.y.shape)
        parts.append((x[: length + 1], y[:length]))
    body = (model.inertia, model.torque(np.eye(3)).T, model.output(np.eye(3)).T)
    b = model.B / np.linalg.norm(model.B)
    return parts, y[lengths[-1] : -1], record.x[lengths[-1] + 1 :], (*body, b)


def history(recordings):
    return ddmhe.History.concat([ddmhe.History(x, y, dt=DT) for x, y in recordings])


def made(recordings, **settings):
    return ddmhe.RigidBodyMhe(history(recordings), **(NOISE | settings))


def same(a, b):
    """Whether two logs hold the same numbers."""
    columns = ("x", "cost", "covariance", "status", "reasons")
    return all(np.array_equal(getattr(a, c), getattr(b, c)) for c in columns)


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.long), 3])
def test_the_fit_is_the_dense_problem_s(count):
    """ω to 1e-8 rad/s, its covariance to 1e-6, the cost, the evidence and χ."""
    recordings, _, _, body = turning(LENGTHS[-count:], SPINS[-count:])
    cost, evidence, chi, w, P = optimum(recordings, body)
    est = made(recordings, optima=1)
    e, report = est.step([np.nan] * 3), est.report()
    assert est.explained
    assert report.optima[0][0] == pytest.approx(cost, abs=1e-3)
    assert report.evidence == pytest.approx(evidence, abs=1e-3)
    assert report.chi == pytest.approx(chi, rel=1e-4)
    # of the earlier ones what is of no whole block does not count
    whole = sum(n // 10 * 10 for n in LENGTHS[-count:-1]) + LENGTHS[-1]
    assert report.limits[3] == pytest.approx(1.05 + 4.5 * np.sqrt(2 / (0.3 * whole)))
    assert np.abs(e.x - w).max() < 1e-8
    assert np.abs(e.covariance - P).max() < 1e-6 * np.abs(P).max()


def test_a_fit_anew_is_the_dense_problem_s_with_all_outputs_since():
    recordings, Y, _, body = turning(after=60)
    est = made(recordings, optima=1, refit="manual")
    est.run(Y[:60])
    assert est.refit()
    (x, y), report = recordings[-1], est.report()
    cost, _, _, w, P = optimum([*recordings[:-1], (x, np.concatenate([y, Y[:60]]))], body)
    e = est.step([np.nan] * 3)
    assert report.optima[0][0] == pytest.approx(cost, abs=1e-3)
    assert np.abs(e.x - w).max() < 1e-8
    assert np.abs(e.covariance - P).max() < 1e-6 * np.abs(P).max()


def test_the_order_of_earlier_recordings_does_not_matter():
    (a, b, c), Y, *_ = turning(after=200)
    one, other = made([a, b, c]).run(Y), made([b, a, c]).run(Y)
    assert np.abs(one.x - other.x).max() < 1e-8
    assert np.abs(one.covariance / other.covariance - 1).max() < 1e-3


def test_a_recording_that_is_cut_in_two_says_almost_as_much():
    """Only that its second part begins where the first has ended is lost."""
    [(x, y)], *_ = turning([200], SPINS[:1])
    whole, cut = made([(x, y)]), made([(x[:101], y[:100]), (x[100:], y[100:])])
    whole, cut = whole.step([np.nan] * 3), cut.step([np.nan] * 3)
    assert np.all(np.abs(whole.x - cut.x) < 3 * cut.std)
    assert np.all(cut.std > whole.std)
    assert np.all(cut.std < 4 * whole.std)


def test_every_recording_of_other_spins_makes_the_estimate_better():
    recordings, Y, truth, _ = turning(after=900)
    errors = [
        np.sqrt(np.mean((made(recordings[first:]).run(Y).x - truth) ** 2)) for first in (0, 1, 2)
    ]
    assert errors[0] < errors[1] < errors[2]


@pytest.mark.parametrize("refit", ["now", "sliced"])
def test_copies_and_pickles_go_on_with_the_same_numbers(refit):
    """With slices in the midst of fits, too."""
    recordings, Y, truth, _ = turning(after=500)
    new = made(recordings, refit=refit)
    est = copy.copy(new)
    est.run(Y[:130])
    others = [copy.deepcopy(est), pickle.loads(pickle.dumps(est))]
    rest = est.run(Y[130:])
    assert all(same(other.run(Y[130:]), rest) for other in others)
    assert np.abs(rest.x - truth[130:]).max() < 1e-4
    assert set(rest.status) == {"structured"}
    est.reset()
    assert same(est.run(Y), new.run(Y))


def test_recordings_may_be_short_and_many_but_not_of_less_than_a_hundred_samples():
    eight, Y, truth, _ = turning([25] * 8, [*SPINS, *SPINS, *SPINS[:2]], after=300)
    est = made(eight)
    assert est.explained
    assert "8 recordings" in est.report().words[0]
    assert np.abs(est.run(Y).x - truth).max() < 1e-3
    made(eight[:4])
    for recordings, words in [
        (eight[:3], "at least 100 outputs, found 75"),
        ([*eight, eight[0]], "at most 8 recordings, found 9"),
    ]:
        with pytest.raises(ddmhe.ShapeError, match=words):
            made(recordings)


def test_the_box_is_of_the_energy_that_the_run_begins_with():
    """An earlier recording at four times the spin does not widen it."""
    (fast, slow), Y, *_ = turning([150, 150], [np.multiply(4, SPINS[2]), SPINS[1]], after=100)
    draw = np.random.default_rng(3)
    wild = 50 * draw.standard_normal(Y.shape) * np.abs(Y).max()
    most = [np.abs(made(own).run(wild).x).max() for own in ([slow], [fast, slow])]
    fastest = np.linalg.norm(slow[0], axis=1).max()
    assert most[1] <= most[0] < 2 * fastest < np.abs(fast[0]).max()


def test_recordings_of_two_bodies_are_explained_by_none():
    (a, *_), _, _, _ = turning()
    draw, other = (
        np.random.default_rng(5),
        ddmhe.models.detumbling(
            inertia=np.diag([2000.0, 3000.0, 4500.0]), omega_0=np.array(SPINS[1])
        ),
    )
    record = other.simulate(15.0, DT, integrator="accurate")
    x = record.x + NOISE["x_noise"] * draw.standard_normal(record.x.shape)
    y = record.y + NOISE["y_noise"] * draw.standard_normal(record.y.shape)
    est = made([a, (x, y[:-1])])
    assert not est.explained
    assert "no rigid body explains the data of 2 recordings" in est.warnings[0]
    assert set(est.run(y[:50]).status) == {"affine"}


def test_means_are_as_short_as_the_quickest_recording_wants():
    """Of a body that turned fast in an earlier recording fits in slices are of single samples."""
    spins = [np.multiply(10, SPINS[2]), SPINS[1]]
    recordings, Y, *_ = turning([150, 150], spins, after=1500)
    logs = [made(recordings, refit=refit, optima=1).run(Y[:1500]) for refit in ("now", "sliced")]
    off = np.abs(logs[1].x - logs[0].x) / logs[0].std
    assert off[-300:].max() < 0.005
