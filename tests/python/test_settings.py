"""Settings of an estimator: one table for keywords, mappings and files."""

import ast
import inspect
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ddmhe
from ddmhe._core import check_settings, setting_names, validate
from ddmhe.config import READING, ConfigError, read_config
from ddmhe.design import ioss

ROOT = Path(__file__).parents[2]
RNG = np.random.default_rng(3)
X, Y = RNG.standard_normal((41, 2)), RNG.standard_normal((40, 1))
H = ddmhe.History(X, Y)


def test_the_signature_the_stub_and_the_table_name_the_same_settings():
    names = setting_names()
    signature = inspect.signature(ddmhe.DdMhe).parameters
    assert list(signature) == ["history", *names]
    stub = ast.parse((ROOT / "python" / "ddmhe" / "_core.pyi").read_text())
    (cls,) = (n for n in stub.body if isinstance(n, ast.ClassDef) and n.name == "DdMhe")
    (new,) = (n for n in cls.body if isinstance(n, ast.FunctionDef) and n.name == "__new__")
    positional = [argument.arg for argument in new.args.args]
    assert positional + [argument.arg for argument in new.args.kwonlyargs] == [
        "cls",
        "history",
        *names,
    ]
    by_place = inspect.Parameter.POSITIONAL_OR_KEYWORD
    assert positional[1:] == [n for n, parameter in signature.items() if parameter.kind == by_place]
    assert not set(names) & set(READING)


def test_the_stub_has_the_signatures_of_the_core():
    """Names, in order, and which of them are by name only."""
    stub = ast.parse((ROOT / "python" / "ddmhe" / "_core.pyi").read_text())
    classes = {n.name: n.body for n in stub.body if isinstance(n, ast.ClassDef)}
    calls = (
        (ddmhe.History, classes["History"], "__new__"),
        (ddmhe.DdMhe.step, classes["DdMhe"], "step"),
        (ddmhe.DdMhe.run, classes["DdMhe"], "run"),
        (ddmhe.DdMhe.reset, classes["DdMhe"], "reset"),
        (ddmhe.run_many, stub.body, "run_many"),
        (validate, stub.body, "validate"),
        (check_settings, stub.body, "check_settings"),
    )
    for function, body, name in calls:
        parameters = inspect.signature(function).parameters
        by_name = [n for n, p in parameters.items() if p.kind == inspect.Parameter.KEYWORD_ONLY]
        expected = [n for n in parameters if n not in ("self", *by_name)], by_name
        written = [n for n in body if isinstance(n, ast.FunctionDef) and n.name == name]
        assert written, name
        for one in written:
            places = [a.arg for a in one.args.args if a.arg not in ("self", "cls")]
            assert (places, [a.arg for a in one.args.kwonlyargs]) == expected, name


def test_each_property_of_the_core_is_in_the_stub():
    stub = ast.parse((ROOT / "python" / "ddmhe" / "_core.pyi").read_text())
    for cls in (ddmhe.History, ddmhe.DdMhe):
        (found,) = (n for n in stub.body if isinstance(n, ast.ClassDef) and n.name == cls.__name__)
        named = {n.name for n in found.body if isinstance(n, ast.FunctionDef)}
        assert {n for n in vars(cls) if not n.startswith("_")} - named == set()


def test_each_setting_is_described():
    described = ddmhe.DdMhe.__doc__.split("Raises")[0]
    assert [name for name in setting_names() if f"\n{name} : " not in described] == []


def test_a_place_is_a_name():
    by_name = ddmhe.DdMhe(H, horizon=4, rho=0.7, mu=2.0, x_prior=[0.1, 0.2])
    by_place = ddmhe.DdMhe(H, 4, 0.7, 2.0, [0.1, 0.2])
    np.testing.assert_array_equal(by_name.run(Y).x, by_place.run(Y).x)
    assert (by_place.horizon, by_place.rho) == (4, 0.7)
    assert by_place.mu == pytest.approx(2.0, rel=1e-12)
    # None is "not given", but of process_noise, where it is a value
    nothing = ddmhe.DdMhe(H, **dict.fromkeys(setting_names()))
    np.testing.assert_array_equal(nothing.run(Y).x, ddmhe.DdMhe(H, process_noise=None).run(Y).x)
    unsaid = dict.fromkeys(set(setting_names()) - {"process_noise"})
    np.testing.assert_array_equal(ddmhe.DdMhe(H, **unsaid).run(Y).x, ddmhe.DdMhe(H).run(Y).x)


def test_a_call_that_python_would_refuse_is_refused():
    known = len(inspect.signature(ddmhe.DdMhe).parameters) - 1
    for call, words in (
        (lambda: ddmhe.DdMhe(H, 4, horizon=5), "DdMhe: expected one horizon, found two"),
        (lambda: ddmhe.DdMhe(H, *[None] * known), "DdMhe: expected at most 12 settings without"),
        (lambda: ddmhe.DdMhe(H, horizn=5), "found \"horizn\"; did you mean 'horizon'?"),
    ):
        with pytest.raises(TypeError) as e:
            call()
        assert words in str(e.value)


def test_a_misspelt_name_is_refused_with_the_nearest(tmp_path):
    fold = (H, np.zeros(2), np.zeros((2, 1)), None, np.zeros((2, 2)), [1], np.ones(2))
    path = tmp_path / "est.toml"
    path.write_text("x_bound = [-1, 1]")
    for call, kind in (
        (lambda: check_settings({"x_bound": (-1, 1)}), ddmhe.DdmheError),
        (lambda: validate([fold], [(0, {"x_bound": (-1, 1)})]), ddmhe.DdmheError),
        (lambda: read_config(path), ConfigError),
    ):
        with pytest.raises(kind, match=r"found .x_bound.; did you mean .x_bounds.\?"):
            call()


def test_a_misspelt_attribute_of_a_certificate_is_refused():
    c = ioss(A=0.5 * np.eye(2), C=np.ones((1, 2)), eta=0.9)
    parts = {name: getattr(c, name) for name in ("P", "Q", "R", "eta")}
    check_settings({"certificate": SimpleNamespace(**parts, growth=2.0)}, H)
    with pytest.raises(ddmhe.DdmheError, match="\"growht\"; did you mean 'growth'"):
        check_settings({"certificate": SimpleNamespace(**parts, growht=2.0)}, H)
    with pytest.raises(ddmhe.DdmheError, match="expected a number for eta, found 'high'"):
        check_settings({"certificate": SimpleNamespace(**parts | {"eta": "high"})}, H)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"horizon": 0}, "horizon: expected a whole number of at least 1"),
        ({"rho": "0.9"}, "rho: expected a real number"),
        ({"x_prior": [[1.0]]}, "x_prior: expected"),
        ({"x_bounds": [1.0]}, r"x_bounds: expected a pair \(lo, hi\)"),
        ({"x_bounds": [0.0, [[1.0]]]}, "x_bounds: expected a scalar"),
        ({"x_center": "middle"}, 'x_center: expected "history", found "middle"'),
        ({"v_bounds": [None, 1.0]}, "v_bounds: expected"),
        ({"equilibrium": 0.0}, r"equilibrium: expected .*\(x_e, y_e"),
        ({"warm_start": 1}, "warm_start: expected True or False"),
        ({"warm_start": True, "start": "state"}, "warm_start: expected none beside start"),
        ({"space": "best"}, 'space: expected "auto"'),
        ({"certificate": 1.0}, "certificate: expected a ddmhe.design.Certificate"),
        ({"disturbance": [1.0, 2.0]}, "disturbance: expected three numbers"),
        (
            {"weights": "own"},
            'weights: expected "auto", "paper", "scaled" or "recorded", found "own"',
        ),
        (
            {"start": "end"},
            'start: expected "auto", "recording", "state" or "unknown", found "end"',
        ),
    ],
)
def test_a_wrong_value_is_one_error_with_or_without_a_recording(setting, message):
    for call in (
        lambda: check_settings(setting),
        lambda: check_settings(setting, H),
        lambda: ddmhe.DdMhe(H, **setting),
    ):
        with pytest.raises(ddmhe.DdmheError, match=message):
            call()


def test_sizes_are_those_of_the_recording():
    for setting in (
        {"x_prior": np.zeros(3)},
        {"x_bounds": (np.zeros(3), 1.0)},
        {"v_bounds": (-1.0, np.ones(3))},
        {"equilibrium": (np.zeros(2), np.zeros(2))},
        {"certificate": ioss(A=0.5 * np.eye(3), C=np.ones((1, 3)), eta=0.9)},
    ):
        check_settings(setting)
        (name,) = setting
        with pytest.raises(ddmhe.ShapeError, match=f"^{name}: expected"):
            check_settings(setting, H)
    check_settings({"x_bounds": (1.0, 0.0)})
    with pytest.raises(ddmhe.DdmheError, match="x_bounds: expected lo <= hi"):
        check_settings({"x_bounds": (1.0, 0.0)}, H)
