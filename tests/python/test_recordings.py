"""What a recording says, and what it does not: rounding far from zero, too few samples, channels at
rest, angles."""

import os
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe.design import pole_placement
from reference import Affine, random_system

DATA = Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
RATIOS = (0.0, 1e2, 3e2, 1e3, 2e3, 3e3, 1e4, 1e5, 1e6)


def far_away(seed, ratio, computed):
    """A noise-free motion `ratio` deviations from zero in units of its own: rounded once, or at
    every step of it."""
    rng = np.random.default_rng(seed)
    n, p = 1 + seed % 5, 1 + (seed // 5) % 3
    system = random_system(rng, n, p)
    x_mean, y_mean = (ratio * rng.uniform(0.5, 1, k) * rng.choice([-1, 1], k) for k in (n, p))
    start = rng.standard_normal(n)
    if computed:
        moved = Affine(
            system.A, x_mean - system.A @ x_mean + system.e, system.C, y_mean - system.C @ x_mean
        )
        x, y = moved.simulate(x_mean + start, 240)
    else:
        x, y = system.simulate(start, 240)
        x, y = x + x_mean, y + y_mean
    return x * 10 ** rng.uniform(-3, 3), y * 10 ** rng.uniform(-3, 3)


@pytest.mark.parametrize(
    "seeds", [range(0, 15, 3), pytest.param(range(15), marks=pytest.mark.long)], ids=["few", "all"]
)
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("computed", [False, True])
def test_rounding_far_from_zero_is_not_taken_for_motion(ratio, computed, seeds):
    """Noise-free data span n directions, whatever their mean: nothing else is kept, and no estimate
    is lost to it."""
    for seed in seeds:
        x, y = far_away(seed, ratio, computed)
        h = ddmhe.History(x[:101], y[:100])
        spread = np.sqrt(x.var(axis=0).mean())
        for horizon, space in (
            (None, "auto"),
            (5, "auto"),
            (40, "auto"),
            (None, ddmhe.Exact()),
            (40, ddmhe.Exact()),
        ):
            estimator = ddmhe.DdMhe(h, horizon, space=space)
            assert estimator.rank == h.n
            log = estimator.run(y[100:240])
            limit = 1e-6 if space == "auto" else 1e-13 * max(ratio, 10.0) * 100
            assert np.abs(log.x - x[101:241]).max() < limit * spread


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_rank_condition_far_from_zero(ratio):
    """Every state moves: rank n + 1. One is a combination of the others: not, though its rounding
    moves."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x, y = far_away(seed, ratio, computed=True)
        h = ddmhe.History(x, y)
        assert h.rank(3).satisfied
        tied = x @ rng.standard_normal(h.n) + x.max() * rng.standard_normal()
        report = ddmhe.History(np.column_stack([x, tied * 10 ** rng.uniform(-6, 6)]), y).rank(3)
        assert (report.rank, report.required) == (h.n + 1, h.n + 2)


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
@pytest.mark.parametrize(
    ("duration", "dt"), [(20.0, 0.1), (100.0, 0.1), (20.0, 0.5), (100.0, 1.0), (20.0, 0.02)]
)
def test_differences_of_a_noise_free_satellite_have_rank_five(unit, duration, dt):
    """C has rank 2 and the outputs are linear in the states: the sixth singular value of (46) is
    rounding."""
    record = ddmhe.models.detumbling().simulate(duration, dt)
    design = pole_placement(ddmhe.History(record.x * unit, record.y[:-1], dt=dt), attempts=1)
    assert (design.rank, design.required_rank) == (5, 6)
    assert "(44) fails" in design.words


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_recording_without_degrees_of_freedom_is_not_called_exact(n):
    """n + 1 samples are fitted by some affine model whatever they are: no noise can be seen, so it
    is allowed for."""
    rng = np.random.default_rng(n)
    x, y = rng.standard_normal((n + 2, n)), rng.standard_normal((n + 1, 2))
    estimator = ddmhe.DdMhe(ddmhe.History(x, y))
    assert estimator.ridge > 0
    assert np.isfinite(estimator.run(rng.standard_normal((700, 2))).x).all()


# --- recordings that say too little


def said(estimator, *words):
    """The only warning with all of these words; None if there is none."""
    found = [w for w in estimator.warnings if all(word in w for word in words)]
    assert len(found) <= 1
    return found[0] if found else None


def of_output(estimator, index):
    """The warnings that name an output."""
    return [w for w in estimator.warnings if f"output {index} (counted from 0)" in w]


def noisy_motion(rng, n, steps, noise):
    system = random_system(rng, n, 2)
    x, y = system.simulate(rng.standard_normal(n), steps)
    return x + noise * rng.standard_normal(x.shape), y + noise * rng.standard_normal(y.shape)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_short_noisy_recording_is_refused_or_warned_about_with_the_length_that_would_do(n):
    enough, needed = None, max(10 * (n + 1), 4 * (n + 1) + 19)
    for T in range(1, needed + 5):
        x, y = noisy_motion(np.random.default_rng(T), n, T, 0.05)
        if n + 1 > T:
            with pytest.raises(ddmhe.RankError, match=f"at least n \\+ 1 = {n + 1} outputs"):
                ddmhe.DdMhe(ddmhe.History(x, y))
            continue
        words = said(ddmhe.DdMhe(ddmhe.History(x, y)), "too short to tell motion from noise")
        if words is None:
            enough = enough or T
        else:
            assert enough is None
            assert f"{needed} outputs would do" in words
    assert enough == needed


def test_a_long_horizon_leaves_few_windows():
    x, y = noisy_motion(np.random.default_rng(0), 3, 60, 0.05)
    h = ddmhe.History(x, y)
    assert said(ddmhe.DdMhe(h), "too short") is None
    assert "70 outputs would do" in said(ddmhe.DdMhe(h, 55), "too short")  # 4 (n + 1) windows of 55
    x, y = noisy_motion(np.random.default_rng(0), 3, 70, 0.05)
    assert said(ddmhe.DdMhe(ddmhe.History(x, y), 55), "too short") is None


def test_a_short_recording_without_noise_says_enough():
    """n + 2 samples of a linear motion leave a degree of freedom, and it shows no misfit."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = 1 + seed % 4
        x, y = random_system(rng, n, 2).simulate(rng.standard_normal(n), n + 2)
        estimator = ddmhe.DdMhe(ddmhe.History(x, y))
        # nothing can be held out of so few, which leaves errors unknown
        unknown = np.isnan(estimator.promise).all()
        assert len(estimator.warnings) == unknown
        assert (said(estimator, "too short to hold windows out") is not None) == unknown


# --- channels at rest


def test_an_output_that_never_moved_is_named_and_again_when_it_moves():
    rng = np.random.default_rng(0)
    x, y = random_system(rng, 2, 3).simulate(rng.standard_normal(2), 160)
    y[:, 1] = 0.1
    h = ddmhe.History(x[:101], y[:100], dt=0.1)
    estimator = ddmhe.DdMhe(h)
    assert len(estimator.warnings) == 1
    assert said(estimator, "output 1 (counted from 0) never moved", "0.1")
    estimator.run(y[100:120])
    assert len(of_output(estimator, 1)) == 1
    y[128:, 1] += 0.3
    y[125, 1] = np.nan
    estimator.run(y[120:135])
    assert said(estimator, "output 1 (counted from 0) moves from 2.9 s on (step 29)")
    assert len(of_output(estimator, 1)) == 2
    restored = ddmhe.DdMhe.restore(estimator.snapshot())
    assert restored.warnings == estimator.warnings
    restored.run(y[135:160])
    assert restored.warnings == estimator.warnings
    estimator.reset()
    assert len(estimator.warnings) == 1


def test_a_state_that_never_moved_is_named():
    rng = np.random.default_rng(0)
    x, y = random_system(rng, 2, 2).simulate(rng.standard_normal(2), 60)
    with pytest.raises(ddmhe.RankError, match=r"state 1 \(counted from 0\) never changes"):
        ddmhe.DdMhe(ddmhe.History(np.column_stack([x[:, 0], np.full(61, 300.1), x[:, 1]]), y))


# --- angles


def turning(rng, steps, turn, low, rate):
    """A heading that turns with a varying rate and noise, wrapped to [low, low + turn)."""
    heading = np.cumsum(
        rate * (1 + 0.3 * np.sin(0.05 * np.arange(steps)))
    ) + 0.02 * rate * rng.standard_normal(steps)
    return low + np.mod(heading, turn)


RANGES = [(2 * np.pi, -np.pi), (2 * np.pi, 0.0), (360.0, -180.0), (360.0, 0.0)]


@pytest.mark.parametrize(("turn", "low"), RANGES)
@pytest.mark.parametrize("share", [0.003, -0.01, 0.05, 0.1])
@pytest.mark.parametrize("decimals", [3, 9])
def test_a_wrapped_angle_in_the_recording_is_named(turn, low, share, decimals):
    rng = np.random.default_rng(3)
    angle = np.round(turning(rng, 401, turn, low, share * turn), decimals)
    other = rng.standard_normal(401)
    by_state = ddmhe.DdMhe(ddmhe.History(np.column_stack([other, angle]), other[:-1, None]))
    assert said(
        by_state,
        "state 1 (counted from 0) jumps by about",
        "360" if turn == 360.0 else "2 pi",
        "cosine",
    )
    by_output = ddmhe.DdMhe(ddmhe.History(other[:, None], np.column_stack([angle, other])[:-1]))
    assert said(by_output, "output 0 (counted from 0) jumps by about")
    first = int(np.flatnonzero(np.abs(np.diff(angle)) > turn / 2)[0]) + 1
    assert f"first at sample {first}" in said(by_output, "output 0")


@pytest.mark.parametrize(("turn", "low"), RANGES)
def test_an_angle_that_wraps_online_is_named_with_the_time(turn, low):
    rng = np.random.default_rng(4)
    angle = turning(rng, 160, turn, low, 0.01 * turn)
    start = int(np.flatnonzero(np.abs(np.diff(angle)) > turn / 2)[0]) + 1
    other = np.cos(0.1 * np.arange(160))
    y = np.column_stack([other, angle])
    T = start - 20
    estimator = ddmhe.DdMhe(ddmhe.History(other[: T + 1, None], y[:T], dt=0.5))
    estimator.run(y[T:start])
    assert of_output(estimator, 1) == []
    estimator.run(y[start : start + 30])
    assert said(
        estimator, "output 1 (counted from 0) jumps by a full turn from 10.5 s on (step 21)"
    )
    assert len(of_output(estimator, 1)) == 1


def test_ordinary_signals_are_no_angles():
    """Steps of about a turn, noise across it, spikes: nothing of them is a wrapped angle."""
    rng = np.random.default_rng(5)
    k = np.arange(400)
    square = np.where(k // 25 % 2, 1.0, -1.0)
    signals = {
        "a square wave of 2 pi": np.pi * square,
        "of 6.2 with noise": 3.1 * square + 0.02 * rng.standard_normal(400),
        "of 360": 180.0 * (square + 1),
        "of 355 with a slope beside it": 177.5 * square + 0.01 * k,
        "noise over the circle": rng.uniform(-np.pi, np.pi, 400),
        "a sine over the circle": np.pi * np.sin(0.3 * k),
        "a sine over 360": 180 + 180 * np.sin(0.05 * k),
        "a saw of 5": k % 50 / 10,
        "a saw of 20": k % 50 / 2.5,
        "spikes of 2 pi": 0.1 * rng.standard_normal(400) + 2 * np.pi * (k % 100 == 50),
    }
    other = np.cos(0.1 * k)
    for name, signal in signals.items():
        estimator = ddmhe.DdMhe(
            ddmhe.History(other[:201, None], np.column_stack([other, signal])[:200])
        )
        estimator.run(np.column_stack([other, signal])[200:])
        assert not [w for w in estimator.warnings if "wrapped" in w], name


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_channels_raise_no_false_alarm():
    """Every column of every measured log, as recorded and as an online output: none of them wraps
    or rests."""
    paths = sorted(DATA.glob("repoimu-pendulum/*.csv")) + sorted(DATA.glob("input-logs/*.csv"))
    assert len(paths) > 30
    for path in paths:
        columns = np.genfromtxt(path, delimiter=",", skip_header=1)[:, 1:]
        columns = columns[np.isfinite(columns).all(axis=1)][:1200]
        T = len(columns) // 2
        state = np.cumsum(np.random.default_rng(0).standard_normal(len(columns)))[:, None]
        estimator = ddmhe.DdMhe(ddmhe.History(state[: T + 1], columns[:T]), 5)
        estimator.run(columns[T:])
        assert not [w for w in estimator.warnings if "wrapped" in w], path.name


# --- horizon and discount


def test_settings_that_promise_no_contraction_say_so():
    x, y = noisy_motion(np.random.default_rng(0), 2, 100, 0.05)
    h = ddmhe.History(x, y)
    for given in (
        {"horizon": 1, "rho": 0.9},
        {"horizon": 13, "rho": 0.9},
        {"horizon": 20},
        {"horizon": 27, "rho": 0.95},
    ):
        estimator = ddmhe.DdMhe(h, **given)
        smallest = next(M for M in range(1, 100) if 4 * estimator.rho**M < 1)
        assert f"M = {smallest} would do" in said(estimator, "4 rho^M")
    for given in ({"horizon": 14, "rho": 0.9}, {"horizon": 28}, {"horizon": 1, "rho": 0.2}, {}):
        assert said(ddmhe.DdMhe(h, **given), "4 rho^M") is None


def test_tuning_passes_the_warnings_on():
    rng = np.random.default_rng(0)
    x, y = noisy_motion(rng, 2, 60, 0.01)
    y[:, 1] = 2.0
    tuned = ddmhe.tune(ddmhe.History(x, y))
    assert any("output 1 (counted from 0) never moved" in w for w in tuned.warnings)
