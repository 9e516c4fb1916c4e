"""RigidBodyMhe in a known field that moves: against the NumPy reference's own numbers, against the
truth, and as an object."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import ddmhe

GOLDEN = np.load(Path(__file__).parents[1] / "golden" / "rigid_field.npz")
NAMES = list(GOLDEN["names"])
UNIT_X, UNIT_Y, RECORDED, EVERY, LATER = 1e-8, 1e-6, 200, 8, 6
LOST = np.iinfo(np.int32).min


def skew(v):
    """[v], with [v] u = v x u, of v (..., 3)."""
    return np.cross(np.eye(3), v[..., None, :]).swapaxes(-1, -2) * -1.0


def golden(name):
    """History, noise, outputs, field of all samples, and what the reference made of it."""
    i = NAMES.index(name)
    y = GOLDEN[f"y{i}"]
    y = np.where(y == LOST, np.nan, y * UNIT_Y)
    B = GOLDEN[f"B{i}"]
    field = B, (skew(B) - GOLDEN[f"arm{i}"])[:, : y.shape[1]]
    names = ("x_noise", "y_noise", "output_noise")
    noise = dict(zip(names, GOLDEN[f"noise{i}"], strict=True))
    history = ddmhe.History(GOLDEN[f"x{i}"] * UNIT_X, y[:RECORDED], dt=0.1)
    return history, noise, y[RECORDED:], field, GOLDEN[f"rows{i}"]


def part(field, samples):
    return tuple(v[samples] for v in field)


RECORDING, ONLINE = slice(RECORDED + 1), slice(RECORDED, RECORDED + 400)


@pytest.mark.parametrize("name", NAMES)
def test_estimates_are_the_reference_s(name):
    """400 steps with seven fits anew. The reference knew the field of each next sample beforehand;
    but for what is told of that sample, nothing of the extrapolated field stays, not even where it
    turns by a tenth of a revolution in three samples."""
    history, noise, Y, field, rows = golden(name)
    est = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING), refit="now", optima=1, **noise)
    log = est.run(Y, field=part(field, ONLINE))
    at = np.arange(LATER, len(Y), EVERY)
    upper = np.zeros((len(at), 3, 3))
    upper[(slice(None), *np.triu_indices(3))] = rows[:, 3:9]
    expected = upper + np.triu(upper, 1).transpose(0, 2, 1)
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert est.explained
    assert np.abs(log.x[at] - rows[:, :3]).max() < 1e-9
    assert np.max(np.abs(log.covariance[at] - expected) / size) < 1e-8
    assert set(log.status) == {"structured"}


def turning_body(seed, seconds=130.0, dt=0.1):
    """Rates, outputs and field of a random body in a field that turns about an axis and pulsates,
    by Runge and Kutta's rule in small steps."""
    draw = np.random.default_rng(seed)
    axes = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    J = axes @ np.diag(draw.uniform(0.7, 1.2, 3)) @ axes.T
    turned = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    M = turned @ np.diag(draw.uniform(0.003, 0.012, 3)) @ turned.T
    frame, arm = np.linalg.qr(draw.standard_normal((3, 3)))[0], 0.3 * draw.standard_normal((3, 3))
    w = draw.standard_normal(3)
    w *= 0.2 / np.linalg.norm(w)

    def B(t):
        along = np.array([np.cos(0.3 * t), np.sin(0.3 * t), 0.4])
        return (1 + 0.2 * np.sin(0.11 * t)) * frame @ along

    def f(t, w):
        b = B(t)
        return np.linalg.solve(J, np.cross(b, M @ np.cross(b, w)) - np.cross(w, J @ w))

    count, x = round(seconds / dt), [w]
    for k in range(count):
        t = k * dt
        k1 = f(t, w)
        k2 = f(t + dt / 2, w + dt / 2 * k1)
        k3 = f(t + dt / 2, w + dt / 2 * k2)
        w = w + dt / 6 * (k1 + 2 * k2 + 2 * k3 + f(t + dt, w + dt * k3))
        x.append(w)
    x, field = np.array(x), np.array([B(k * dt) for k in range(count + 1)])
    K = 800 * (skew(field) - arm)  # in other units than the brake's: κ
    y = -np.einsum("tij,jk,tk->ti", K, M, np.cross(field, x))
    return x, y, (field, K)


@pytest.fixture(scope="module")
def case():
    x, y, field = turning_body(0)
    draw = np.random.default_rng(0)
    x_seen = x[: RECORDED + 1] + 1e-4 * draw.standard_normal((RECORDED + 1, 3))
    y = y + 1e-3 * np.abs(y).max() * draw.standard_normal(y.shape)
    return ddmhe.History(x_seen, y[:RECORDED], dt=0.1), y[RECORDED:-1], field, x[RECORDED + 1 :]


@pytest.mark.parametrize("refit", ["now", "sliced"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_beyond_the_recording_the_spin_is_as_near_as_stated(seed, refit):
    """The whole spin is seen while the field turns: .02 deg/s for 110 s after a noisy recording of
    20 s, within the bars."""
    x, y, field = turning_body(seed)
    draw = np.random.default_rng(seed)
    seen = x[: RECORDED + 1] + 1e-4 * draw.standard_normal((RECORDED + 1, 3))
    y = y + 1e-3 * np.abs(y).max() * draw.standard_normal(y.shape)
    est = ddmhe.RigidBodyMhe(
        ddmhe.History(seen, y[:RECORDED], dt=0.1), field=part(field, RECORDING), refit=refit
    )
    later = slice(RECORDED, len(y) - 1)
    log = est.run(y[later], field=part(field, later))
    off = log.x - x[RECORDED + 1 :]
    assert est.explained
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < np.deg2rad(0.02)
    assert np.mean(np.abs(off) < 3 * log.std) > 0.95
    assert log.trusted.mean() > 0.95


def test_the_last_recorded_rate_is_left_out_where_its_field_is_not_known(case):
    """With the field at the outputs alone nothing of a field that was guessed stays either: of a
    recording one sample longer estimates differ by what one rate tells."""
    history, Y, field, truth = case
    longer = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING))
    shorter = ddmhe.RigidBodyMhe(history, field=part(field, slice(RECORDED)))
    logs = [e.run(Y[:40], field=part(field, slice(RECORDED, RECORDED + 40)))
            for e in (longer, shorter)]  # fmt: skip
    apart = np.abs(logs[0].x - logs[1].x)
    assert 0 < apart.max() < np.max(logs[0].std)
    assert np.all(np.abs(logs[1].x - truth[:40]) < 5 * logs[1].std)


def same(a, b):
    """Whether two logs hold the same numbers."""
    columns = ("x", "cost", "covariance", "status", "reasons")
    return all(np.array_equal(getattr(a, c), getattr(b, c)) for c in columns)


@pytest.mark.parametrize(("refit", "before", "known"), [
    ("now", 120, 201), ("sliced", 60, 200), ("sliced", 333, 201), ("manual", 7, 200),
])  # fmt: skip
def test_copies_and_pickles_go_on_with_the_same_numbers(case, refit, before, known):
    history, Y, field, _ = case
    new = ddmhe.RigidBodyMhe(history, field=part(field, slice(known)), refit=refit)
    est, middle = copy.copy(new), RECORDED + before
    first, rest = part(field, slice(RECORDED, middle)), part(field, slice(middle, middle + 300))
    log = est.run(Y[:before], field=first)
    if refit == "manual":
        assert est.refit()
    others = [copy.deepcopy(est), pickle.loads(pickle.dumps(est))]
    others.append(ddmhe.RigidBodyMhe.restore(est.snapshot()))
    after = est.run(Y[before : before + 300], field=rest)
    for other in others:
        assert other.t == before
        assert same(other.run(Y[before : before + 300], field=rest), after)
    est.reset()
    assert same(est.run(Y[:before], field=first), log)
    restored = ddmhe.RigidBodyMhe.restore(new.snapshot())
    for k in range(before):
        e = restored.step(Y[k], field=part(field, RECORDED + k))
        assert np.array_equal(e.x, log.x[k])


def test_fits_by_hand_go_on_with_the_field_that_came_since(case):
    """A fit beside steps ends with estimates of what is fitted and of what came since."""
    history, Y, field, truth = case
    est = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING), refit="manual")
    est.run(Y[:150], field=part(field, slice(RECORDED, RECORDED + 150)))
    plain, before = copy.copy(est), est.report().evidence
    for k in range(150, 600):
        now = part(field, RECORDED + k)
        ended, e = est.refit(1e-5), est.step(Y[k], field=now)
        plain.step(Y[k], field=now)
        if ended is not None:
            break
    assert ended is True
    assert est.report().evidence != before
    assert not np.array_equal(e.x, plain.estimate.x)
    assert np.all(np.abs(e.x - truth[k]) < 4 * e.std)
    assert np.all(e.std < 1.01 * plain.estimate.std)


def test_the_report_says_that_no_direction_stays_unseen(case):
    history, _, field, _ = case
    report = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING)).report()
    assert np.all(np.isnan(report.unseen))
    assert "no direction stays unseen" in report.words[1]
    assert np.trace(report.inertia) == pytest.approx(3.0)


def test_a_page_about_a_run_names_no_unseen_direction(case, tmp_path):
    history, Y, field, _ = case
    est = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING))
    log = est.run(Y[:50], field=part(field, slice(RECORDED, RECORDED + 50)))
    ddmhe.report.html(est, log, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "no direction stays unseen" in page
    assert "A turn about" not in page


def test_a_recording_of_no_body_in_that_field_is_left_to_the_affine_estimator(case):
    history, _, (B, K), _ = case
    # the field of other moments
    wrong = np.roll(B[: RECORDED + 1], 70, axis=0), np.roll(K[: RECORDED + 1], 70, axis=0)
    est = ddmhe.RigidBodyMhe(history, field=wrong)
    assert not est.explained
    assert est.warnings


def test_a_step_takes_a_field_if_and_only_if_the_recording_had_one(case):
    history, Y, field, _ = case
    est = ddmhe.RigidBodyMhe(history, field=part(field, RECORDING))
    plain = ddmhe.RigidBodyMhe(history)
    now = part(field, RECORDED)
    with pytest.raises(ddmhe.ShapeError, match="field: expected B and K of each sample"):
        est.step(Y[0])
    with pytest.raises(ddmhe.ShapeError, match="field: expected B and K of each sample"):
        est.run(Y)
    with pytest.raises(ddmhe.ShapeError, match="field: expected none"):
        plain.step(Y[0], field=now)
    with pytest.raises(ddmhe.NotFiniteError, match="field"):
        est.step(Y[0], field=(now[0] * np.nan, now[1]))
    with pytest.raises(ddmhe.ShapeError, match=r"field B: expected \(3,\), found \(1, 3\)"):
        est.step(Y[0], field=(now[0][None], now[1]))
    with pytest.raises(ddmhe.ShapeError, match=r"field K: expected \(5, 3, 3\)"):
        est.run(Y[:5], field=(field[0][:5], field[1][:6]))
    with pytest.raises(ddmhe.DdmheError, match="a pair"):
        est.step(Y[0], field=3.0)
    assert est.t == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda B, K: (B[:-5], K[:-5]), r"field B: expected \(200, 3\) or \(201, 3\)"),
        (lambda B, K: (B, K[:-1]), "found 603 and 1800"),
        (lambda B, K: (B, K[:, :2]), r"field K: expected \(200, 3, 3\) or \(201, 3, 3\)"),
        (lambda B, K: (B, np.nan * K), "field"),
        (lambda B, K: (0 * B, K), "field: expected B and K that are not 0 throughout"),
    ],
)
def test_bad_fields_are_named(case, change, words):
    history, _, field, _ = case
    with pytest.raises(ddmhe.DdmheError, match=words):
        ddmhe.RigidBodyMhe(history, field=change(*part(field, RECORDING)))


def test_a_field_is_of_one_recording(case):
    _, _, field, _ = case
    x, y, _ = turning_body(0, seconds=20.0)
    two = ddmhe.History.concat(
        [ddmhe.History(x[:101], y[:100]), ddmhe.History(x[100:], y[100:200])]
    )
    with pytest.raises(ddmhe.ShapeError, match="field: expected none, or one recording"):
        ddmhe.RigidBodyMhe(two, field=part(field, slice(200)))


def test_four_outputs_are_more_than_there_is_room_for():
    x, y, (B, K) = turning_body(0, seconds=20.0)
    four = ddmhe.History(x, y[:200, [0, 1, 2, 0]], dt=0.1)
    with pytest.raises(
        ddmhe.ShapeError, match="field: expected none, or three rates and at most 3"
    ):
        ddmhe.RigidBodyMhe(four, field=(B[:200], K[:200][:, [0, 1, 2, 0]]))
