"""Writes rigid_body.npz: runs of the NumPy reference of the rigid body's estimator, which lies
beside the checkout (`reference/reach` next to the folder that DDMHE_DATA names, else next to
`../shared/data`).

    python tests/golden/rigid_body.py

Recordings and outputs are whole numbers of 1e-8 rad/s and 1e-6 N m, so that they are kept as they
were used."""

import os
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DDMHE_DATA", HERE.parents[2] / "shared" / "data"))
UNIT_X, UNIT_Y = 1e-8, 1e-6
RECORDED, ONLINE, EVERY, DT = 200, 400, 8, 0.1
LOST = np.iinfo(np.int32).min
# noise of recorded rates (rad/s), recorded and later outputs (N m)
LEVELS = [(1e-5, 1e-3, 1e-3), (1e-4, 1e-2, 1e-2), (1e-3, 1e-2, 1e-2), (1e-3, 5e-2, 5e-2)]

# the fourth and the fifth output, of the three torques
MORE = np.array([[0.8, -0.6, 0.0], [0.5, 0.5, 1.0]])


def cases():
    """Name, seed, noise, how it is simulated, outputs, share that is lost, whether noise is
    known."""
    for k in range(10):
        yield f"target {k}", 1000 + k, LEVELS[k % 4], {}, 3, 0.0, True
    yield "cubic", 1011, LEVELS[1], {"cubic": 0.5}, 3, 0.0, True
    yield "euler", 1012, LEVELS[1], {"integ": "euler"}, 3, 0.0, True
    yield "lost", 1013, LEVELS[1], {}, 3, 0.3, False
    yield "two outputs", 1014, LEVELS[1], {}, 2, 0.0, True
    yield "four outputs", 1015, LEVELS[1], {}, 4, 0.1, True
    # fits of 1016 creep along a valley, where the reference ends them earlier
    yield "five outputs", 1017, LEVELS[1], {}, 5, 0.0, True


def simulated(sims, seed, noise, how, outputs, lost):
    """The recording and the outputs after it, as whole numbers; a lost one is the least of them."""
    body = sims.rand_target(seed)
    x, y = sims.simulate(body, (RECORDED + ONLINE) * DT, DT, **how)
    draw = np.random.default_rng(seed)
    of_x, of_y, of_later = noise
    x = x[: RECORDED + 1] + of_x * draw.standard_normal((RECORDED + 1, 3))
    y, count = np.c_[y, y @ MORE[: max(outputs - 3, 0)].T][:-1], len(y) - 1
    sd = np.where(np.arange(count) < RECORDED, of_y, of_later)[:, None]
    y = y + sd * draw.standard_normal(y.shape)
    whole = np.rint(y[:, :outputs] / UNIT_Y).astype(np.int32)
    gone = draw.random(whole.shape) < lost
    gone[:RECORDED] = False
    whole[gone] = LOST
    return np.rint(x / UNIT_X).astype(np.int32), whole


def estimated(reference, x, y, noise, known):
    """Rates, covariances and statuses of the reference at every EVERY-th step."""
    x = x * UNIT_X
    y = np.where(y == LOST, np.nan, y * UNIT_Y)
    of = dict(zip(("sx", "sy", "so"), noise, strict=True)) if known else {}
    estimator = reference.Estimator(x, y[:RECORDED], DT, **of)
    rows = []
    for k, output in enumerate(y[RECORDED:]):
        w = estimator.step(output)
        if (k + 1) % EVERY == 0:
            upper = estimator.cov[np.triu_indices(3)]
            rows.append(np.r_[w, upper, estimator.status == "adapting", len(estimator.fits)])
    return np.array(rows)


def main():
    """All cases into one file."""
    sys.path.insert(0, str(DATA.parent / "reference" / "reach"))
    import sims

    import reference

    found = {"names": np.array([case[0] for case in cases()])}
    for i, (name, seed, noise, how, outputs, lost, known) in enumerate(cases()):
        x, y = simulated(sims, seed, noise, how, outputs, lost)
        rows = estimated(reference, x, y, noise, known)
        stated = np.array(noise if known else [])
        found |= {f"x{i}": x, f"y{i}": y, f"rows{i}": rows, f"noise{i}": stated}
        print(name, rows[-1][:3], flush=True)
    np.savez_compressed(HERE / "rigid_body.npz", **found)


if __name__ == "__main__":
    main()
