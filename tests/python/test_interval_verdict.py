"""What bounds say, in words."""

import numpy as np
import pytest

import ddmhe
from ddmhe import interval

INF = float("inf")


def test_verdicts():
    t = np.arange(10.0)
    low, high = np.zeros((10, 3)), np.tile([0.1, 0.7, 1.5], (10, 1))
    high[6:, 0] = 3.0
    high[8:, 1] = INF
    v = interval.judge(low, high, (np.zeros(3), np.ones(3)), t, ("a", "b", "c"))
    np.testing.assert_allclose(v.share, [0.1, 0.7, 1.5])
    np.testing.assert_array_equal(v.grows, [6.0, 8.0, np.nan])
    np.testing.assert_array_equal(v.unbounded, [np.nan, 8.0, np.nan])
    assert not v.useful
    assert "a 0.1 of the recorded range, grows beyond it from 6 s on" in v.words
    assert "b says little: median width 0.7" in v.words
    assert "no bound from 8 s on" in v.words
    assert "c says nothing beyond the recorded range (median width 1.5 of it)" in v.words
    assert "inf" not in v.words
    endless = interval.judge(-high[:, 1:2] * 1e4 ** t[:, None], high[:, 1:2], ([0], [1]), t, ("b",))
    assert (
        "median width above 1000 of it), grows beyond it from 0 s on, no bound from 8 s on"
        in endless.words
    )
    assert interval.judge(low[:, :1], high[:, :1], ([0], [1]), t, ("a",)).useful
    with pytest.raises(ddmhe.DdmheError, match="recorded:"):
        interval.judge(low, high, (np.zeros(3), np.zeros(3)), t, ("a", "b", "c"))
    with pytest.raises(ddmhe.ShapeError, match="upper:"):
        interval.judge(low, high[1:], (np.zeros(3), np.ones(3)), t, ("a", "b", "c"))
