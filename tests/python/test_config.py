"""Settings from a TOML file: every key, and every wrong one."""

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import in_here
from ddmhe import DdmheError
from ddmhe.config import ConfigError, read_config, space_from_text, write_config


def test_errors_are_package_errors():
    assert issubclass(ConfigError, DdmheError)


def test_config_reads_every_key(tmp_path):
    path = tmp_path / "est.toml"
    path.write_text(
        "horizon = 7\nrho = 0.9\nmu = 1\nx_prior = [0, 1.5]\nx_bounds = [-1, [2, inf]]\nx_center "
        "= 'history'\nv_bounds = [-1.0, 1.0]\nequilibrium = [[0, 0], [0]]\nwarm_start = "
        "true\nspace = { kind = 'truncated', rank = 5 }\n"
    )
    settings = read_config(path)
    assert repr(settings.pop("space")) == "Truncated(rank=5)"
    assert settings == {
        "horizon": 7,
        "rho": 0.9,
        "mu": 1,
        "x_prior": [0, 1.5],
        "x_bounds": [-1, [2, float("inf")]],
        "x_center": "history",
        "v_bounds": [-1.0, 1.0],
        "equilibrium": [[0, 0], [0]],
        "warm_start": True,
    }


Q = [[1e-3, 2e-4], [2e-4, 4e-3]]
DISTURBANCES = [
    (
        f'weights = "recorded"\nprocess_noise = {Q}\nw_bounds = [-0.01, [0.02, inf]]',
        {"weights": "recorded", "process_noise": Q, "w_bounds": [-0.01, [0.02, np.inf]]},
    ),
    (
        'weights = "scaled"\nprocess_noise = "residual"',
        {"weights": "scaled", "process_noise": "residual"},
    ),
    ('process_noise = "none"', {"process_noise": None}),
]


@pytest.mark.parametrize(("text", "expected"), DISTURBANCES)
def test_a_fitted_disturbance_is_read_and_written(tmp_path, text, expected):
    path = tmp_path / "est.toml"
    path.write_text(text)
    assert read_config(path) == expected
    write_config(path, {key: np.array(v) if v is Q else v for key, v in expected.items()})
    assert read_config(path) == expected


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """An oscillator that noise drives: x (201, 2), y (201, 1), and its log."""
    rng = np.random.default_rng(5)
    x = [np.ones(2)]
    for _ in range(200):
        x.append([[0.95, 0.2], [-0.2, 0.95]] @ x[-1] + 0.05 * rng.standard_normal(2))
    x = np.array(x)
    y = x[:, :1] + 0.1 * rng.standard_normal((201, 1))
    path = tmp_path_factory.mktemp("driven") / "log.csv"
    frame = pd.DataFrame(np.hstack([0.1 * np.arange(201)[:, None], x, y]), columns=list("tabc"))
    frame.to_csv(path, index=False)
    return x, y, path


def estimated(path, text):
    """How `ddmhe estimate` ends, with a file of these settings beside the log."""
    (path.parent / "est.toml").write_text(text)
    options = ["--state", "a,b", "--output", "c", "--history", 15, "--config", "est.toml"]
    return in_here("estimate", path, *options, "--out", "est.csv", cwd=path.parent)


@pytest.mark.parametrize(("text", "expected"), DISTURBANCES)
def test_the_command_line_fits_the_disturbance_of_a_file(driven, text, expected):
    x, y, path = driven
    result = estimated(path, text)
    assert (result.returncode, result.stderr) == (0, "")
    history = ddmhe.History(x[:151], y[:150], dt=0.1)
    estimates, others = (
        ddmhe.DdMhe(history, start="recording", **settings).run(y[150:-1]).x
        for settings in (expected, {})
    )
    written = pd.read_csv(path.parent / "est.csv")[["a", "b"]]
    np.testing.assert_allclose(written, estimates, rtol=1e-9, atol=1e-12)
    assert np.abs(estimates - others).max() > 0.01  # what the file says matters


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("process_noise = [[1.0]]", "process_noise: expected shape (2, 2), found (1, 1)"),
        ("process_noise = 'recorded'\nw_bounds = [1.0, -1.0]", "w_bounds: expected lo <= hi"),
        ("weights = 'recorded'\nrho = 0.9", "rho"),
    ],
)
def test_a_disturbance_that_does_not_fit_is_one_line(driven, text, message):
    result = estimated(driven[2], text)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("auto", "'auto'"),
        ("exact", "Exact()"),
        ("truncated:3", "Truncated(rank=3)"),
        ("ridge:0.5", "Ridge(5e-1)"),
    ],
)
def test_space_from_text(text, expected):
    assert repr(space_from_text(text)) == expected


@pytest.mark.parametrize(
    "text", ["", "Auto", "auto:", "exact:1", "truncated", "truncated:-1", "truncated:x", "ridge:"]
)
def test_space_from_wrong_text(text):
    with pytest.raises(
        ConfigError, match="space: expected auto, exact, truncated:RANK or ridge:WEIGHT"
    ):
        space_from_text(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("horizn = 3", "expected one of the keys horizon, rho, mu, .* found 'horizn'"),
        ("horizon = true", "horizon: expected a whole number of at least 1, found True"),
        ("horizon = 1e99", "horizon: expected a whole number"),
        ("rho = '0.9'", "rho: expected a real number, found '0.9'"),
        ("warm_start = 1", "warm_start: expected True or False, found 1"),
        ("x_bounds = ['a', 'b']", "x_bounds: expected an array of real numbers, found str"),
        ("space = 'ridge'", "space: expected auto, exact"),
        (
            "space = { kind = 'best' }",
            "space: expected kind 'exact', 'truncated', 'ridge', found 'best'",
        ),
        ("space = { kind = 'ridge' }", "space: expected a weight for ridge"),
        (
            "space = { kind = 'truncated', rank = 1.5 }",
            "space, rank: expected a whole number of at least 1, found 1.5",
        ),
        (
            "space = { kind = 'exact', rank = 1 }",
            "space: expected no argument for exact, found 'rank'",
        ),
        ("missing = -9999", "missing: expected a list of finite numbers and words, found -9999"),
        ("missing = [nan]", "missing: expected a list of finite numbers and words"),
        ("process_noise = 'best'", 'process_noise: expected "auto", "recorded" or "residual"'),
        ("process_noise = [1.0, 2.0]", "process_noise: expected a 2-D array"),
        ("process_noise = [[1.0, 2.0], [3.0]]", "process_noise: expected an array of real numbers"),
        ("process_noise = false", "process_noise: expected a 2-D array"),
        ("w_bounds = 1.0", r"w_bounds: expected a pair \(lo, hi\)"),
        ("horizon = ", "expected a TOML file, found an error in it"),
    ],
)
def test_wrong_config_is_an_error_that_names_file_and_key(tmp_path, text, expected):
    path = tmp_path / "est.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=expected) as e:
        read_config(path)
    assert str(path) in str(e.value)
