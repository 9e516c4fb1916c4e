"""What a recorded column says of itself: values far out, and angles that jump by a turn."""

import os
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ddmhe._core import wrapped_angle
from ddmhe.logs import LogError, read_log
from ddmhe.recordings.oddities import far_out


def test_what_is_far_out_on_its_own():
    rng = np.random.default_rng(0)
    signal = np.sin(np.arange(3000) / 40) + 0.01 * rng.standard_normal(3000)
    for share in (0.001, 0.1, 0.4):
        low, high = rng.random(3000) < share, rng.random(3000) < 0.05
        low[7], high[9] = True, True
        spoiled = np.where(low, -9999.0, signal)
        np.testing.assert_array_equal(far_out(spoiled), np.flatnonzero(low))
        np.testing.assert_array_equal(
            far_out(np.where(high, 999.0, spoiled)), np.flatnonzero(low | high)
        )
    rest = 1e-3 * rng.standard_normal(2900)
    for motion in (
        np.sin(np.arange(100) / 4),  # sets out after a long rest
        1 + 1e-3 * rng.standard_normal(100),  # a step to another level
        np.cumsum(rng.standard_normal(100)),
    ):
        assert far_out(np.r_[rest, motion]).size == 0
        assert far_out(np.r_[np.zeros(2900), motion]).size == 0
    assert far_out(np.r_[signal, 400.0, 700.0, signal]).tolist() == [3000, 3001]
    assert far_out(np.full(100, np.nan)).size == 0


@pytest.mark.parametrize("full", [2 * np.pi, 360.0])
@pytest.mark.parametrize("offset", [0.0, 0.5, 0.25, -3.1])
def test_wrapped_angles_are_seen_and_made_continuous(tmp_path, full, offset):
    angle = full * np.cumsum(np.linspace(0.005, 0.02, 400))
    wrapped = angle % full - offset * full
    jump = int(np.flatnonzero(np.abs(np.diff(wrapped)) > full / 2)[0]) + 1
    assert wrapped_angle(wrapped) == (full, jump)
    gap = np.where(np.arange(400) < jump, np.nan, wrapped)  # what was not measured is left out
    following = int(np.flatnonzero(np.abs(np.diff(gap)) > full / 2)[0]) + 1
    assert wrapped_angle(gap) == (full, following)
    assert wrapped_angle(angle) is None
    assert wrapped_angle(0.49 * full * np.sin(np.arange(400) / 9)) is None
    for nothing in ([], [1.0], [np.nan] * 9, [np.inf] * 9):
        assert wrapped_angle(nothing) is None
    rows = [f"{0.1 * k:.1f},{wrapped[k]:.12f},{k},{wrapped[k]:.12f}" for k in range(400)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,w,q,torque", *rows]) + "\n")
    log = read_log(path, ["w", "q"], ["torque"], decimate=2, unwrap=["w", "torque"])
    np.testing.assert_allclose(log.x[:, 0], angle[::2] - offset * full, atol=1e-9)
    np.testing.assert_allclose(log.y[:, 0], angle[::2] - offset * full, atol=1e-9)
    with pytest.raises(
        LogError, match="unwrap: expected a column of the states or outputs, found 'time_s'"
    ):
        read_log(path, ["w", "q"], ["torque"], unwrap=["time_s"])


MEASURED = Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.mark.skipif(
    not MEASURED.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_nothing_odd_is_seen_in_measured_logs():
    """Pendulums, cars, arms and circuits, whole and thinned: no value far out, no wrapped angle."""
    paths = sorted([*MEASURED.glob("repoimu-pendulum/*.csv"), *MEASURED.glob("input-logs/*.csv")])
    assert len(paths) > 18
    for path in paths:
        frame = pd.read_csv(path)
        for name, step in product(frame.columns[1:], (1, 4)):
            values = frame[name].to_numpy(dtype=float)[::step]
            assert far_out(values).size == 0, (path, name)
            assert wrapped_angle(values) is None, (path, name)
