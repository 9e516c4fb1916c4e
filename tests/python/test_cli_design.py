"""`ddmhe design` and `ddmhe tune`: what they write is what `ddmhe estimate` takes."""

import re

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import COLUMNS, PNG, in_a_process, in_here, printed


def test_design_writes_a_certificate_that_estimate_takes(log, tmp_path):
    result = in_a_process("design", log, *COLUMNS, "--history", 20, "--eta", 0.9, "--out", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "rho0, mu0 as printed" in result.stdout
    assert "(24) is impossible" in result.stdout
    assert (tmp_path / "poles.png").read_bytes().startswith(PNG)
    config = tmp_path / "design.toml"
    estimated = in_here(
        "estimate", log, *COLUMNS, "--history", 20, "--config", config, "--out", tmp_path / "e.csv"
    )
    assert estimated.returncode == 0
    said = estimated.stderr.splitlines()  # of the log; none of the certificate
    assert all(line.startswith("ddmhe: warning: from ") for line in said)
    assert printed(estimated, "rho") == 0.9
    short = in_here("estimate", log, *COLUMNS, "--history", 20, "--config", config, "--horizon", 13)
    assert short.returncode == 2
    assert "horizon: expected at least 14" in short.stderr


def test_a_certificate_survives_its_file(tmp_path):
    """Also a robust one, whose uncertainty widens the error bound: the bounds are the same to the
    last digit."""
    from ddmhe.config import read_config, write_config
    from ddmhe.design import RecordingNoise, ioss

    rng = np.random.default_rng(0)
    A, C = np.array([[0.95, 0.3], [-0.3, 0.95]]), np.array([[1.0, 0.5]])
    x = np.array([np.linalg.matrix_power(A, k) @ [1.0, 0.0] for k in range(121)])
    x, y = x + rng.uniform(-1e-3, 1e-3, x.shape), x[:-1] @ C.T
    history = ddmhe.History(x, y)
    for noise in (None, RecordingNoise(x=2e-3)):
        settings = {"certificate": ioss(history, 0.9, noise=noise), "disturbance": (0.1, 0.0, 0.01)}
        write_config(tmp_path / "c.toml", settings | {"space": ddmhe.Ridge(1e-6, normalised=True)})
        read = read_config(tmp_path / "c.toml")
        assert read["space"] == ddmhe.Ridge(1e-6, normalised=True)
        bounds = [
            ddmhe.DdMhe(history, **s).run(y[:30]).bound
            for s in (settings | {"space": read["space"]}, read)
        ]
        np.testing.assert_array_equal(*bounds)
        assert (read["certificate"].uncertainty is None) == (noise is None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("certificate = 3", "certificate: expected a table"),
        ("[certificate]\neta = 0.9", "certificate: expected eta, P, Q and R, found no P"),
        ("[certificate]\ncolour = 1", "certificate: expected one of"),
        (
            "[certificate]\neta = 'x'\nP = [[1]]\nQ = [[1]]\nR = [[1]]",
            "certificate: expected a number for eta",
        ),
        (
            "[certificate]\neta=0.9\nP=[[1.0],[2.0,3.0]]\nQ=[[1.0]]\nR=[[1.0]]",
            "expected rectangular matrices",
        ),
        (
            "[certificate]\neta=0.9\nP=[[1.0]]\nQ=[[1.0]]\nR=[[1.0]]",
            "certificate: expected a matrix (3, 3)",
        ),
        (
            "space = {kind = 'ridge', weight = 1.0, normalised = 1}",
            "space, normalised: expected True or False, found 1",
        ),
    ],
)
def test_wrong_certificates_in_a_file(log, tmp_path, text, message):
    (tmp_path / "c.toml").write_text(text)
    result = in_here("estimate", log, *COLUMNS, "--history", 20, "--config", tmp_path / "c.toml")
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_design_reports_what_cannot_be(log, tmp_path):
    for options, message in (
        (["--radius", 1.5], "radius: expected a number in (0, 1)"),
        (["--condition", 0.5], "condition: expected a number above 1"),
        (["--noise-x", 1.0], "noise: expected a recording that moves every direction"),
        (["--noise-y", -1.0], "noise: expected a finite y"),
    ):
        result = in_here("design", log, *COLUMNS, "--history", 20, "--out", tmp_path, *options)
        assert result.returncode == 2
        assert message in result.stderr
        assert result.stderr.count("\n") == 1


def test_tune_writes_settings_that_estimate_takes(log, tmp_path):
    result = in_a_process("tune", log, *COLUMNS, "--history", 8, "--rest", "--out", tmp_path)
    assert result.returncode == 0
    assert "held-out quarters" in result.stdout
    assert (tmp_path / "tune.png").read_bytes().startswith(PNG)
    assert len(pd.read_csv(tmp_path / "tune.csv")) > 100
    # of each state, by its column: what to expect, and whether the settings are better than the
    # default rule's
    for column in COLUMNS[COLUMNS.index("--state") + 1].split(","):
        (row,) = [
            line for line in result.stdout.splitlines() if line.strip("│ ").startswith(f"{column} ")
        ]
        assert re.search(
            r"│ +[\d.e-]+ +│ +[\d.e-]+ to [\d.e-]+ +│ +"
            r"(cannot tell|as much as its error|[\d.e-]+ times its error)",
            row,
        )
    assert ddmhe.config.read_config(tmp_path / "tune.toml")["start"] == "recording"
    estimated = in_here(
        "estimate", log, *COLUMNS, "--history", 8, "--config", tmp_path / "tune.toml"
    )
    assert estimated.returncode == 0
    # chosen for accuracy, not for contraction, and said
    warning, *of_the_log = estimated.stderr.splitlines()
    assert "4 rho^M" in warning
    assert all(line.startswith("ddmhe: warning: from ") for line in of_the_log)
    assert printed(estimated, "horizon M") == pd.read_csv(tmp_path / "tune.csv")["horizon"][0]
