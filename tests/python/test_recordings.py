"""What a recording says, and what it does not: rounding far from zero, too few samples, channels at rest, angles."""

import numpy as np
import pytest

import ddmhe
from ddmhe.design import pole_placement
from reference import Affine, random_system

RATIOS = (0.0, 1e2, 3e2, 1e3, 2e3, 3e3, 1e4, 1e5, 1e6)


def far_away(seed, ratio, computed):
    """A noise-free motion `ratio` deviations from zero in units of its own: rounded once, or at every step of it."""
    rng = np.random.default_rng(seed)
    n, p = 1 + seed % 5, 1 + (seed // 5) % 3
    system = random_system(rng, n, p)
    x_mean, y_mean = (ratio * rng.uniform(0.5, 1, k) * rng.choice([-1, 1], k) for k in (n, p))
    start = rng.standard_normal(n)
    if computed:
        moved = Affine(system.A, x_mean - system.A @ x_mean + system.e, system.C, y_mean - system.C @ x_mean)
        x, y = moved.simulate(x_mean + start, 240)
    else:
        x, y = system.simulate(start, 240)
        x, y = x + x_mean, y + y_mean
    return x * 10 ** rng.uniform(-3, 3), y * 10 ** rng.uniform(-3, 3)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("computed", [False, True])
def test_rounding_far_from_zero_is_not_taken_for_motion(ratio, computed):
    """Noise-free data span n directions, whatever their mean: nothing else is kept, and no estimate is lost to it."""
    for seed in range(15):
        x, y = far_away(seed, ratio, computed)
        h = ddmhe.History(x[:101], y[:100])
        spread = np.sqrt(x.var(axis=0).mean())
        for horizon, space in ((None, "auto"), (5, "auto"), (40, "auto"), (None, ddmhe.Exact()), (40, ddmhe.Exact())):
            estimator = ddmhe.DdMhe(h, horizon, space=space)
            assert estimator.rank == h.n
            log = estimator.run(y[100:240])
            limit = 1e-6 if space == "auto" else 1e-13 * max(ratio, 10.0) * 100
            assert np.abs(log.x - x[101:241]).max() < limit * spread


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_rank_condition_far_from_zero(ratio):
    """Every state moves: rank n + 1. One is a combination of the others: not, though its rounding moves."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x, y = far_away(seed, ratio, computed=True)
        h = ddmhe.History(x, y)
        assert h.rank(3).satisfied
        tied = x @ rng.standard_normal(h.n) + x.max() * rng.standard_normal()
        report = ddmhe.History(np.column_stack([x, tied * 10 ** rng.uniform(-6, 6)]), y).rank(3)
        assert (report.rank, report.required) == (h.n + 1, h.n + 2)


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
@pytest.mark.parametrize(("duration", "dt"), [(20.0, 0.1), (100.0, 0.1), (20.0, 0.5), (100.0, 1.0), (20.0, 0.02)])
def test_differences_of_a_noise_free_satellite_have_rank_five(unit, duration, dt):
    """C has rank 2 and the outputs are linear in the states: the sixth singular value of (46) is rounding."""
    record = ddmhe.models.detumbling().simulate(duration, dt)
    design = pole_placement(ddmhe.History(record.x * unit, record.y[:-1], dt=dt), attempts=1)
    assert (design.rank, design.required_rank) == (5, 6)
    assert "(44) fails" in design.words


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_recording_without_degrees_of_freedom_is_not_called_exact(n):
    """n + 1 samples are fitted by some affine model whatever they are: no noise can be seen, so it is allowed for."""
    rng = np.random.default_rng(n)
    x, y = rng.standard_normal((n + 2, n)), rng.standard_normal((n + 1, 2))
    estimator = ddmhe.DdMhe(ddmhe.History(x, y))
    assert estimator.ridge > 0
    assert np.isfinite(estimator.run(rng.standard_normal((700, 2))).x).all()
