"""Settings from a TOML file: every key, and every wrong one."""

import pytest

from ddmhe import DdmheError
from ddmhe.config import ConfigError, read_config, space_from_text


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
        ("missing = -9999", "missing: expected a list of finite numbers, found -9999"),
        ("missing = [nan]", "missing: expected a list of finite numbers"),
        ("horizon = ", "expected a TOML file, found an error in it"),
    ],
)
def test_wrong_config_is_an_error_that_names_file_and_key(tmp_path, text, expected):
    path = tmp_path / "est.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=expected) as e:
        read_config(path)
    assert str(path) in str(e.value)
