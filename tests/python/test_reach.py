"""What docs/measured/reach.md is made of: the motion against another integrator, the bound against
one Jacobian of everything by finite differences, the filter that knows the body against it."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

STUDIES = Path(__file__).parents[2] / "studies"
SEED, RECORDED, AFTER, LEVEL = 1003, 60, 40, 3


@pytest.fixture
def study(monkeypatch):
    monkeypatch.syspath_prepend(STUDIES)
    return [importlib.import_module(name) for name in ("bodies", "bound", "targets")]


def one(bodies):
    """A body, its rates and torques, and a short case."""
    group = bodies.bodies([SEED])
    x, y = bodies.tumbled(group, RECORDED + AFTER)
    return group, x, y, bodies.noisy(x[:, 0], y[:, 0], SEED, LEVEL, RECORDED)


def test_bodies_move_as_their_models(study):
    bodies, _, targets = study
    _, x, y, _ = one(bodies)
    record = targets.target(SEED).simulate(10.0, 0.1, integrator="accurate")
    assert np.abs(x[:, 0] - record.x).max() < 1e-11
    assert np.abs(y[:, 0] - record.y).max() < 1e-10


def test_a_case_has_the_noise_of_the_log_of_its_target(study):
    bodies, _, targets = study
    log, record = targets.detumbled(SEED, LEVEL, 40), targets.target(SEED).simulate(24.0, 0.1)
    x, y = bodies.tumbled(bodies.bodies([SEED]), 240)
    case = bodies.noisy(x[:, 0], y[:, 0], SEED, LEVEL)
    recorded, torques = log.history.recordings[0][:2]
    for ours, theirs in (
        (case.x - x[:201, 0], recorded - record.x[:201]),
        (case.y - y[:200, 0], torques - record.y[:200]),
        (case.Y - y[200:-1, 0], log.Y - record.y[200:-1]),
    ):
        assert np.abs(ours - theirs).max() < 1e-12


def plainly(z, b, samples):
    """Rates and torques (samples+1, 3) of ω(0), j, β, S, G, written down once more."""
    w, j, beta, (p, q, r), G = z[:3], z[3:8], z[8:10], z[10:13], z[13:].reshape(3, 2)
    J = np.eye(3)
    J += np.diag(
        [j[0] / 2**0.5 + j[1] / 6**0.5, -j[0] / 2**0.5 + j[1] / 6**0.5, -2 * j[1] / 6**0.5]
    )
    for value, (a, c) in zip(j[2:] / 2**0.5, ((0, 1), (0, 2), (1, 2)), strict=True):
        J[a, c] += value
        J[c, a] += value
    N = np.linalg.svd(b[None])[2][1:].T - np.outer(b, beta)
    S = np.array([[p, q], [q, r]])

    def f(_, w):
        return np.linalg.solve(J, -N @ S @ N.T @ w - np.cross(w, J @ w))

    t = 0.1 * np.arange(samples + 1)
    x = solve_ivp(f, (0, t[-1]), w, "DOP853", t_eval=t, rtol=1e-12, atol=1e-14).y.T
    return x, x @ N @ G.T


def test_the_bound_is_that_of_one_jacobian_by_finite_differences(study):
    bodies, bound, _ = study
    group, x, y, case = one(bodies)
    by_unknowns = bound.sensitivities(group, RECORDED + AFTER)
    found = bound.bound(*by_unknowns, [case], RECORDED)[:, 0]
    assert found.shape == (AFTER,)
    camera = bound.Camera(noise=3e-3, until=22)
    with_camera = bound.bound(*by_unknowns, [case], RECORDED, camera=camera)[:, 0]

    J, b = group.J[0] / (np.trace(group.J[0]) / 3), group.b[0]
    j = [(J[0, 0] - J[1, 1]) / 2**0.5, (J[0, 0] + J[1, 1] - 2 * J[2, 2]) / 6**0.5]
    j += [2**0.5 * J[a, c] for a, c in ((0, 1), (0, 2), (1, 2))]
    N = np.linalg.svd(b[None])[2][1:].T
    S = -N.T @ group.D[0] @ N / (np.trace(group.J[0]) / 3)
    truth = np.array([*group.w[0], *j, 0, 0, S[0, 0], S[0, 1], S[1, 1], *(group.C[0] @ N).ravel()])
    again = plainly(truth, b, RECORDED + AFTER)
    assert np.abs(again[0] - x[:, 0]).max() < 1e-10
    assert np.abs(again[1] - y[:, 0]).max() < 1e-9

    steps = 1e-5 * np.maximum(np.abs(truth), 1e-2)
    slopes = [
        [(high - low) / (2 * h) for high, low in zip(
            *(plainly(truth + side * h * e, b, RECORDED + AFTER) for side in (1, -1)), strict=True)]
        for h, e in zip(steps, np.eye(19), strict=True)
    ]  # fmt: skip
    of_x, of_y = (np.moveaxis(np.array(part), 0, -1) for part in zip(*slopes, strict=True))
    W, size = np.sqrt(np.mean(np.sum(case.x**2, axis=1))), np.sqrt(np.mean(case.y**2))
    prior = np.r_[[np.inf] * 3, [0.35] * 5, 1, 1, [0.3 * W] * 3, [10 * size / W] * 6]
    for k in (1, 7, AFTER):
        known = RECORDED + k  # outputs before the sample that is estimated
        rows = [np.diag(1 / prior), of_x[: RECORDED + 1].reshape(-1, 19) / 1e-3]
        rows.append(of_y[:known].reshape(-1, 19) / 1e-2)
        seen = of_x[RECORDED : min(known, RECORDED + 22) : 10].reshape(-1, 19) / 3e-3
        for limit, own in ((found, rows), (with_camera, [*rows, seen])):
            R = np.linalg.qr(np.concatenate(own), mode="r")
            root = np.linalg.solve(R.T, of_x[known].T)
            assert limit[k - 1] == pytest.approx(np.sqrt(np.sum(root**2)), rel=1e-5)


def test_the_filter_that_knows_the_body_is_nearer_than_the_bound(study):
    bodies, bound, _ = study
    group, *_, case = one(bodies)
    off = np.linalg.norm(bound.known(group, [case])[:, 0] - case.truth, axis=1)
    limit = bound.bound(*bound.sensitivities(group, RECORDED + AFTER), [case], RECORDED)[:, 0]
    assert np.sqrt(np.mean(off**2)) < np.sqrt(np.mean(limit**2))


def test_without_noise_that_filter_has_no_error(study):
    bodies, bound, _ = study
    group, x, y, _ = one(bodies)
    exact = bodies.Case(x[: RECORDED + 1, 0], y[:RECORDED, 0], y[RECORDED:-1, 0],
                        x[RECORDED + 1 :, 0], (0.0, 0.0, 1e-3))  # fmt: skip
    assert np.abs(bound.known(group, [exact])[:, 0] - exact.truth).max() < 1e-9


def test_every_table_has_its_place_on_the_page(monkeypatch, tmp_path, capsys):
    monkeypatch.syspath_prepend(STUDIES)
    page = importlib.import_module("reach_page")
    text = page.PAGE.read_text(encoding="utf-8")
    names = [name for path in STUDIES.glob("*.py")
             if "from reach_page import put" in (code := path.read_text(encoding="utf-8"))
             for name in re.findall(r'put\("([^"]+)"', code)]  # fmt: skip
    assert len(names) > 8
    assert sorted(names) == sorted(re.findall("<!-- begin (.+) -->", text))
    monkeypatch.setattr(page, "PAGE", tmp_path / "page.md")
    page.PAGE.write_text(text, encoding="utf-8")
    page.put("bars", ["| a \\1 |", "| --- |"])
    made = page.PAGE.read_text(encoding="utf-8")
    assert made.count("| a \\1 |") == 1
    assert made.split("<!-- end bars -->")[1] == text.split("<!-- end bars -->")[1]
    assert "| a" in capsys.readouterr().out
    with pytest.raises(ValueError, match="one place for 'bar', found 0"):
        page.put("bar", [])
