"""`ddmhe reproduce` as a user runs it: files, verdicts, measured logs."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

import ddmhe
from commands import in_here
from ddmhe.reproduce import (
    EXPERIMENTS,
    Claim,
    bench,
    pendulum_task,
    write_claims,
)

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "repoimu-pendulum"
)


def run(*arguments, program=("-m", "ddmhe")):
    command = [sys.executable, *program, "reproduce", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def table(path):
    """Cells of the claims by (source, claim)."""
    rows = [
        line.split(" | ")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.count(" | ") == 5
    ]
    return {(row[0].removeprefix("| "), row[1]): row[2:] for row in rows}


FEW_SEEDS = """
from ddmhe.reproduce import experiments
experiments.SEEDS, experiments.FAMILY_SEEDS = {}, 1
from ddmhe.cli import main
main()
"""


def programs(seeds):
    """The command with so many seeds of each experiment, and as it is."""
    return pytest.mark.parametrize(
        "program",
        [
            pytest.param(["-c", FEW_SEEDS.format(seeds)], id="few seeds"),
            pytest.param(["-m", "ddmhe"], marks=pytest.mark.long, id="all"),
        ],
    )


@programs(2)
def test_one_experiment_leaves_figures_series_and_claims(tmp_path, program):
    done = run("bench-both", "--out", tmp_path, program=program)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir()}
    files = {f"bench-both.{end}" for end in ("csv", "png", "svg")} | {"bench-both-family.csv"}
    assert names == files | {"claims.md", "tables.md"}
    assert imread(tmp_path / "bench-both.png").std() > 0.02
    series = pd.read_csv(tmp_path / "bench-both.csv")
    assert len(series) == 250
    assert series["time_s"].iloc[[0, -1]].tolist() == pytest.approx([0.51, 3.0])
    family = pd.read_csv(tmp_path / "bench-both-family.csv")
    assert len(family) == len(bench.FAMILY)
    # the verdict again, from the family's series
    claim = table(tmp_path / "claims.md")[
        "IV-A2, Fig. 5", "With noise and disturbance Dd-KMHE deviates unacceptably"
    ]
    kicks = family["kick"].str.removesuffix(" rad/s").astype(float)
    counted = int((family[f"{bench.KMHE}: RMSE later"] > 0.5 * kicks).sum())
    assert claim[1].startswith(f"{counted} of {len(bench.FAMILY)} benches")
    assert 0 < counted < len(bench.FAMILY)
    assert claim[2] == "**holds for …**"


def test_the_numbers_of_algorithm_2(tmp_path):
    """Rank 5 of (44), 0.4614 as an output and not as a certificate, and the numbers that no bench
    decides."""
    done = run("design", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    rows = table(tmp_path / "claims.md")
    rank = rows["A-A, (44)", "[X1; Y0] of the recorded differences has rank n + p"]
    assert "3-DOF: 6 of 6" in rank[1]
    assert "3-DOF, no noise: 5 of 6" in rank[1]
    assert "bench, no noise: 1 of 2" in rank[1]
    assert rank[2] == "**holds with …**"
    output = rows["IV-B, Algorithm 2", "ρ0 and μ0 of the 3-DOF case are what Algorithm 2 returns"]
    assert "r = 0.2773 gives ρ0 = 0.4614" in output[1]
    assert output[2] == "**plausible**"
    meaning = rows["IV-B, (24)", "ρ0 and μ0 of the 3-DOF case satisfy (24)"]
    assert "5.98" in meaning[1]
    assert meaning[2] == "**does not hold**"
    for symbol in ("ρ0", "μ0"):
        assert rows["IV-A2, Algorithm 2", f"{symbol} of the bench"][2] == "**cannot be checked**"
    assert (
        rows["A-B3, Algorithm 2", "ρ0 and μ0 are properties of the system"][2]
        == "**does not hold**"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], "NAME"),
        (["real", "--data", "/nowhere"], "--data: expected a directory with pendulum logs"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(arguments, words, tmp_path):
    done = in_here("reproduce", *arguments, "--out", tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_claims_are_a_table(tmp_path):
    write_claims(tmp_path / "c.md", [Claim("Fig. 0", "a | b", "", "1", "holds", "because")])
    lines = (tmp_path / "c.md").read_text(encoding="utf-8").splitlines()
    assert r"| Fig. 0 | a \| b | – | 1 | **holds** | because |" in lines
    assert "## Misprints that do no harm" in lines


def test_every_experiment_of_the_contract_is_there():
    wanted = {
        "bench-nominal",
        "bench-noise",
        "bench-disturbance",
        "bench-both",
        "bench-mu",
        "detumbling",
        "design",
    }
    assert wanted <= set(EXPERIMENTS)


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_logs(tmp_path):
    """Two logs through the command; the defaults' score against an independent reading with
    pandas."""
    paths = sorted(DATA.glob("*.csv"))[:2]
    for path in paths:
        (tmp_path / path.name).symlink_to(path)
    done = run("real", "--data", tmp_path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    scores = pd.read_csv(tmp_path / "out" / "real.csv", index_col=0)
    assert list(scores.index) == [path.stem for path in paths]
    task = pendulum_task(paths[0])
    frame = pd.read_csv(paths[0]).iloc[::4].reset_index(drop=True)
    rates = frame[[f"omega_{axis}_rad_s" for axis in "xyz"]].to_numpy()
    begin = int(np.argmax(np.linalg.norm(rates, axis=1) > 0.5)) + 20
    recorded, _ = task.history.recordings[0]
    assert recorded[0] == pytest.approx(rates[begin])
    x_hat = ddmhe.DdMhe(task.history).run(task.Y).x
    seen = np.isfinite(task.x).all(axis=1)
    truth = task.x[seen]
    expected = np.sqrt(np.mean((x_hat[seen] - truth) ** 2) / np.mean((truth - truth.mean(0)) ** 2))
    assert scores["Dd-MHE, defaults"].iloc[0] == pytest.approx(expected, rel=1e-9)
    assert "| geometric mean |" in (tmp_path / "out" / "real.md").read_text(encoding="utf-8")


@programs(10)
def test_the_interval_paper_has_its_verdicts(tmp_path, program):
    done = run("pendulum", "--out", tmp_path, program=program)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir()}
    figures = {
        f"pendulum{kind}.{end}" for kind in ("-fig1", "-fig2", "-widths") for end in ("png", "svg")
    }
    assert names == figures | {"pendulum.csv", "pendulum-widths.csv", "claims.md", "tables.md"}
    rows = {claim: cells[2] for (_, claim), cells in table(tmp_path / "claims.md").items()}
    assert rows["The design (42) gives this gain"] == "**holds**"
    assert rows["φ0 is the value of (44) at k = 0"] == "**holds with …**"
    assert rows["The initial bound holds for every start in the box"] == "**does not hold**"
    assert rows["The bounded error converges faster on x2"] == "**holds with …**"
    assert rows["The state stays within its bounds"] == "**holds**"
    assert rows["Some J in [J̲, J̄] satisfies both inequalities"] == "**holds**"
    assert rows["⟨p, M⟩ ⊆ ⟨p, ↓q(M)⟩"] == "**holds with …**"
    assert not any("Interval paper, V" in source for source, _ in table(tmp_path / "claims.md"))
    assert "| peak-to-peak ball (44) | 0.58" in (tmp_path / "tables.md").read_text(encoding="utf-8")
