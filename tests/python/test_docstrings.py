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
    "campaign": ddmhe.campaign,
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
    "campaign.Case",
    "campaign.Progress",
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


@pytest.fixture
def campaign(tmp_path):
    """The campaign of the example of `ddmhe.campaign.run`, for those that read it."""
    from ddmhe.campaign.store import Store
    from ddmhe.campaign.work import run_part

    example = next(
        e.source for e in doctest.DocTestParser().get_examples(ddmhe.campaign.run.__doc__)
        if e.source.startswith("spec =")
    )  # fmt: skip
    names = {}
    exec(example, names)
    spec = ddmhe.campaign.read_spec(names["spec"])
    store = Store.create(tmp_path / "bench-campaign", spec)
    for part in spec.parts:
        store.add(run_part(spec, part))


@pytest.mark.parametrize("name", sorted(set(NAMES) - SHOWN_ELSEWHERE))
def test_examples(name, tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    if name in ("campaign.open", "campaign.Campaign"):
        request.getfixturevalue("campaign")
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = inspect.getdoc(NAMES[name])
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert example.examples, f"{name}: no example"
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert runner.run(example, out=said.append).failed == 0, "".join(said)
