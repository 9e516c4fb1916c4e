"""`ddmhe interval`: of the pendulum and of a log, and bounds that say nothing."""

import re

import numpy as np
import pandas as pd

from commands import PNG, in_a_process, in_here, printed


def test_interval_of_the_pendulum(tmp_path):
    result = in_a_process("interval", "pendulum", "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "1.5029, 7.7372" in result.stdout
    assert "15.753, 15.753" in result.stdout
    row = re.search(r"tight, PCA\s+│ ([\d.]+)\s+│ ([\d.]+)\s+│ (\d+)", result.stdout).groups()
    assert float(row[0]) < 0.024
    assert float(row[1]) < 0.16
    assert row[2] == "0"
    assert (tmp_path / "pendulum-fig1.png").read_bytes().startswith(PNG)


def test_bounds_that_say_nothing_are_refused(tmp_path):
    """A swing of growing size that no affine system follows: the smallest radii are a large part of
    the motion."""
    t = 0.1 * np.arange(300)
    a = np.sin(t * (1 + 0.02 * t))
    frame = pd.DataFrame({"t": t, "a": a, "b": np.cos(3 * a), "y": a**2})
    log = tmp_path / "log.csv"
    frame.to_csv(log, index=False)
    options = ["--state", "a,b", "--output", "y", "--history", 10]
    result = in_here("interval", log, *options, "--out", tmp_path / "out")
    assert result.returncode == 2
    assert "verdict: " in result.stdout
    assert "says nothing beyond the recorded range" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert "smallest admissible" in result.stdout
    result = in_here("interval", log, *options, "--accept-wide", "--out", tmp_path / "out")
    assert (result.returncode, result.stderr) == (0, "")
    assert "says nothing beyond the recorded range" in result.stdout
    for written in (result.stdout, (tmp_path / "out" / "interval.csv").read_text()):
        assert not re.search(r"\b(inf|nan)\b", written)


def test_interval_of_a_log(tmp_path):
    """A linear system with bounded noise: the log's states stay inside, and the files hold the
    bounds."""
    rng = np.random.default_rng(0)
    x, y = [np.array([2.0, -1.0])], []
    for _ in range(200):
        y.append(x[-1] @ [1.0, 0.5] + 0.3 + 0.02 * rng.uniform(-1, 1))
        x.append(np.array([[0.95, 0.2], [-0.15, 0.9]]) @ x[-1] + 0.01 * rng.uniform(-1, 1, 2))
    log = tmp_path / "log.csv"
    frame = pd.DataFrame(
        {"t": 0.1 * np.arange(200), "a": np.array(x)[:-1, 0], "b": np.array(x)[:-1, 1], "y": y}
    )
    frame.to_csv(log, index=False)
    options = ["--state", "a,b", "--output", "y", "--history", 6]
    result = in_here(
        "interval", log, *options, "--w-radius", 0.01, "--v-radius", 0.02, "--out", tmp_path
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "Guaranteed for every system" in result.stdout
    assert re.search(
        r"verdict: a 0\.\d+ of the recorded range; b 0\.\d+ of the recorded range", result.stdout
    )
    assert printed(result, "samples of the log outside") == 0
    written = pd.read_csv(tmp_path / "interval.csv")
    truth = frame.set_index("t").loc[written["t"]]
    for name in ("a", "b"):
        assert (truth[name].to_numpy() >= written[f"{name} lower"]).all()
        assert (truth[name].to_numpy() <= written[f"{name} upper"]).all()
    assert (written["b upper"] - written["b lower"]).iloc[50:].mean() < 0.5
    blind = frame.copy()
    blind.loc[61:, ["a", "b"]] = np.nan  # the states end with the history
    blind.to_csv(tmp_path / "blind.csv", index=False)
    again = ["--w-radius", 0.01, "--v-radius", 0.02, "--out", tmp_path / "blind"]
    result = in_here("interval", tmp_path / "blind.csv", *options, *again)
    assert (result.returncode, result.stderr) == (0, "")
    assert "outside" not in result.stdout.split("Guaranteed")[0]
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "blind" / "interval.csv"), written)
    assert (tmp_path / "interval.png").read_bytes().startswith(PNG)
    for changed, words in (
        (
            ["--w-radius", 1e-4, "--v-radius", 0.02],
            "w_radius: expected a bound that an affine system satisfies",
        ),
        (["--w-radius", "1e-4,1", "--v-radius", 0.02], "for a, "),
        (["--w-radius", 0.01], "--v-radius: expected with a log"),
        (["--w-radius", "x", "--v-radius", 0.02], "--w-radius"),
    ):
        result = in_here("interval", log, *options, *changed, "--out", tmp_path)
        assert result.returncode == 2
        assert words in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
