"""Writes rigid_field.npz: runs of the NumPy reference of the rigid body's estimator in a field that
is known and moves, as rigid_body.py does without one.

    python tests/golden/rigid_field.py

The reference is given the field of every sample beforehand. What it tells of a sample is with the
field as it would go on from the two before, and no more of that stays in it."""

import sys

import numpy as np
from rigid_body import DATA, DT, EVERY, HERE, LEVELS, LOST, ONLINE, RECORDED, UNIT_X, UNIT_Y

LATER = 6


def cases():
    """Name, seed, noise, turns of the field (rad/s), how much of it pulsates, how it is simulated,
    outputs, share that is lost."""
    yield "turning", 1020, LEVELS[1], 0.3, 0.0, {}, 3, 0.0
    yield "quick", 1021, LEVELS[0], 2.0, 0.0, {}, 3, 0.0
    yield "pulsating", 1022, LEVELS[2], 0.15, 0.5, {}, 3, 0.0
    yield "lost", 1023, LEVELS[1], 0.3, 0.0, {}, 3, 0.3
    yield "cubic", 1024, LEVELS[1], 0.3, 0.0, {"cubic": 0.5}, 3, 0.0
    yield "two outputs", 1025, LEVELS[1], 0.3, 0.0, {}, 2, 0.0


def turning(body, seed, rate, pulse):
    """B (T) of time: turned about an axis, and pulsating."""
    draw = np.random.default_rng(seed)
    axes = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    size = np.linalg.norm(body.B)

    def at(t):
        along = np.array([np.cos(rate * t), np.sin(rate * t), 0.4])
        return size * (1 + pulse * np.sin(0.7 * t)) * axes @ along

    return at


def simulated(sims, case):
    """Recording and outputs as whole numbers, B in units of its size, and [r] Lambda."""
    _, seed, noise, rate, pulse, how, outputs, lost = case
    body = sims.rand_target(seed)
    B = turning(body, seed, rate, pulse)
    x, y = sims.simulate(body, (RECORDED + ONLINE) * DT, DT, Bt=B, **how)
    field = np.array([B(k * DT) for k in range(len(y))])
    unit = np.sqrt(np.mean(np.sum(field[: RECORDED + 1] ** 2, axis=1)))
    draw = np.random.default_rng(seed)
    of_x, of_y, of_later = noise
    x = x[: RECORDED + 1] + of_x * draw.standard_normal((RECORDED + 1, 3))
    sd = np.where(np.arange(len(y) - 1) < RECORDED, of_y, of_later)[:, None]
    y = y[:-1] + sd * draw.standard_normal((len(y) - 1, 3))
    whole = np.rint(y[:, :outputs] / UNIT_Y).astype(np.int32)
    gone = draw.random(whole.shape) < lost
    gone[:RECORDED] = False
    whole[gone] = LOST
    arm = sims.sk(body.r) @ body.Lam
    return np.rint(x / UNIT_X).astype(np.int32), whole, field / unit, arm / unit


def shown(reference, B, arm, outputs):
    """K: what the outputs show of the moment."""
    return (reference.skew(B) - arm)[:, :outputs]


def foretelling(reference):
    """The reference, with `ahead`: rates and covariance as foretold by an extrapolated field."""

    class Foretelling(reference.Estimator):
        def _predict(s):
            k, (B, K), P = len(s.y) + s.t - 1, s.field, s.P.copy()
            w, guess = s.w, B.copy()
            guess[k + 1] = 2 * B[k] - B[k - 1]
            s.field = guess, K
            super()._predict()
            s.ahead = s.w, s.P[:3, :3]
            s.w, s.P, s.field = w, P, (B, K)
            super()._predict()

    return Foretelling


def estimated(reference, x, y, noise, field):
    """Rates, covariances and statuses of the reference at every EVERY-th step from LATER on, where
    nothing is fitted anew."""
    y = np.where(y == LOST, np.nan, y * UNIT_Y)
    of = dict(zip(("sx", "sy", "so"), noise, strict=True))
    estimator = foretelling(reference)(x * UNIT_X, y[:RECORDED], DT, field=field, **of)
    rows = []
    for k, output in enumerate(y[RECORDED:]):
        estimator.step(output)
        if k % EVERY == LATER:
            w, P = estimator.ahead
            upper = P[np.triu_indices(3)]
            rows.append(np.r_[w, upper, estimator.status == "adapting", len(estimator.fits)])
    return np.array(rows)


def main():
    """All cases into one file."""
    sys.path.insert(0, str(DATA.parent / "reference" / "reach"))
    import sims

    import reference

    found = {"names": np.array([case[0] for case in cases()])}
    for i, case in enumerate(cases()):
        x, y, B, arm = simulated(sims, case)
        K = shown(reference, B, arm, y.shape[1])
        rows = estimated(reference, x, y, case[2], (B, K))
        found |= {f"x{i}": x, f"y{i}": y, f"B{i}": B, f"arm{i}": arm, f"rows{i}": rows}
        found[f"noise{i}"] = np.array(case[2])
        print(case[0], rows[-1][:3], rows[-1][-2:], flush=True)
    np.savez_compressed(HERE / "rigid_field.npz", **found)


if __name__ == "__main__":
    main()
