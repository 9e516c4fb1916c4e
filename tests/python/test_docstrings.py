"""The examples in docstrings do what they say, and every public name has one."""

import doctest
import inspect

import pytest

import ddmhe
import ddmhe.plot

MODULES = {
    "ddmhe": ddmhe,
    "design": ddmhe.design,
    "interval": ddmhe.interval,
    "models": ddmhe.models,
    "baselines": ddmhe.baselines,
    "plot": ddmhe.plot,
}
# What others hand out and nobody makes: shown where it is made. What figures of the command line
# are made of.
SHOWN_ELSEWHERE = {
    "design.Algorithm1",
    "design.ConsistentSet",
    "design.OutputDelay",
    "design.PolePlacement",
    "design.Uncertainty",
    "ddmhe.InfeasibleError",
    "ddmhe.ModelViolationError",
    "baselines.Baseline",
    "baselines.Estimate",
    "baselines.Log",
    "baselines.ModelEstimate",
    "baselines.ModelLog",
}


def public():
    """(name, object) of every function and class that users call by this name."""
    for name, module in MODULES.items():
        for part in getattr(module, "__all__", [n for n in dir(module) if not n.startswith("_")]):
            thing = getattr(module, part)
            if callable(thing) and not inspect.ismodule(thing):
                yield f"{name}.{part}", thing
    for part in ("read",):
        yield f"recordings.{part}", getattr(ddmhe.recordings, part)
    for part in ("html", "nrmse", "pooled_nrmse", "rmse", "rmse_norm", "root_mean_square"):
        yield f"report.{part}", getattr(ddmhe.report, part)


NAMES = dict(public())


def test_the_list_is_of_names_that_are_there():
    assert set(NAMES) >= SHOWN_ELSEWHERE
    assert len(NAMES) > 70


@pytest.mark.parametrize("name", sorted(set(NAMES) - SHOWN_ELSEWHERE))
def test_examples(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = inspect.getdoc(NAMES[name])
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert example.examples, f"{name}: no example"
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert runner.run(example, out=said.append).failed == 0, "".join(said)
