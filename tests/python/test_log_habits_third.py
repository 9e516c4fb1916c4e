"""Habits that the reader was not shaped on: read right, or refused in a sentence, never wrong."""

import numpy as np
import pytest

from ddmhe.recordings import LogError, read
from odd_logs import HISTORY, text
from odd_logs_third import third

REFUSED = {
    "Swiss thousands": r"column 'time_ms': expected a finite number, found \"1'000\"",
    "a typographic minus": "column 'w1': expected a finite number",
    "GPS week and seconds of it": r"the first, 'gps_week', .* may count rows",
    "hours, minutes and seconds by letters": "column 'time': expected a finite number",
    "R's row names without a header": "expected 4 cells as in the header, found 5",
}
"""What is said of those that are not read."""
COLUMNS = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}


@pytest.mark.parametrize("name", third())
def test_a_habit_is_read_right_or_refused(tmp_path, name):
    plain = tmp_path / "plain.csv"
    plain.write_text(text())
    wanted = read(plain, **COLUMNS)
    ending, written, options = third()[name]
    odd = tmp_path / f"odd{ending}"
    odd.write_bytes(written.encode())
    if name in REFUSED:
        with pytest.raises(LogError, match=REFUSED[name]):
            read(odd, **COLUMNS | options)
        return
    found = read(odd, **COLUMNS | options)
    assert found.history.dt == pytest.approx(wanted.history.dt, abs=1e-6)
    for of, given in zip(found.history.recordings[0], wanted.history.recordings[0], strict=True):
        np.testing.assert_allclose(of, given, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.Y, wanted.Y, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.x_true, wanted.x_true, rtol=0, atol=1e-9)


def test_there_are_eighteen():
    assert len(third()) == 18
    assert set(REFUSED) < set(third())
