"""What a camera's minute is worth after it: the first eight bodies of studies/reach.py, torque for
six minutes, and rates once a second for the first of them. Writes the table "A camera for a
minute" of docs/measured/reach.md."""

import numpy as np

import ddmhe
from bodies import DEG, DT, RECORDED, bodies, tumbled
from ddmhe.report.page import markdown_table
from reach_page import put

SEEDS, ONLINE, SEEN = range(1000, 1008), 3600, 600
NOISES = ((1e-4, 0.01, 1e-4), (1e-3, 0.01, 1e-4), (1e-3, 0.05, 1e-3))
"""Of recorded rates (rad/s), of torques (N m), of the camera (rad/s)."""
SPANS = {"60 s": slice(500, 600), "160 s": slice(1500, 1600), "360 s": slice(3300, 3600)}


def case(x, y, noises, seed):
    """Errors (deg/s) over SPANS without and with the camera: of DdMhe and of RigidBodyMhe."""
    of_x, of_y, of_camera = noises
    draw = np.random.default_rng([99, seed])
    read = x + of_x * draw.standard_normal(x.shape)
    y = y + of_y * draw.standard_normal(y.shape)
    camera = np.full((ONLINE, 3), np.nan)
    seen = x[RECORDED : RECORDED + SEEN : 10]
    camera[:SEEN:10] = seen + of_camera * draw.standard_normal(seen.shape)
    Y, truth = y[RECORDED : RECORDED + ONLINE], x[RECORDED + 1 : RECORDED + ONLINE + 1]
    x, y = read[: RECORDED + 1], y[:RECORDED]
    settings = dict(x_noise=of_x, y_noise=of_y, rate_noise=of_camera)
    body = ddmhe.RigidBodyMhe(ddmhe.History(x, y, dt=DT), **settings)
    affine = ddmhe.DdMhe(ddmhe.History(x, np.hstack([y, x[:-1]]), dt=DT))
    nothing = np.full_like(camera, np.nan)
    logs = [affine.run(np.hstack([Y, nothing]))]
    affine.reset()
    logs += [affine.run(np.hstack([Y, camera])), body.run(Y)]
    body.reset()
    logs += [body.run(Y, X=camera)]
    square = [np.sum((log.x - truth) ** 2, axis=1) for log in logs]
    return [[DEG * np.sqrt(np.mean(e[k])) for k in SPANS.values()] for e in square]


def main():
    """All cases; the table."""
    x, y = tumbled(bodies(SEEDS), RECORDED + ONLINE)
    rows = []
    for noises in NOISES:
        found = np.array([case(x[:, k], y[:, k], noises, k) for k in range(len(SEEDS))])
        for i, name in ((0, "DdMhe"), (2, "RigidBodyMhe")):
            errors = [f"{np.median(v):.2g}" for v in found[:, i + 1].T]
            ratios = [f"{v:.2f}" for v in np.median(found[:, i + 1] / found[:, i], axis=0)]
            spans = [f"{e} ({r})" for e, r in zip(errors, ratios, strict=True)]
            rows.append((", ".join(f"{v:g}" for v in noises), name, *spans))
    put("camera", markdown_table(("noise", "estimator", *SPANS), rows))


if __name__ == "__main__":
    main()
