"""Wrong inputs: one clear error each, naming the argument, what was expected and what came."""

import numpy as np
import pandas as pd
import pytest

import ddmhe
from ddmhe import (
    DdMhe,
    DdmheError,
    Exact,
    History,
    NotFiniteError,
    RankError,
    Ridge,
    ShapeError,
    Truncated,
)

T = 30
RNG = np.random.default_rng(0)
X, Y = RNG.standard_normal((T + 1, 3)), RNG.standard_normal((T, 2))
H = History(X, Y, dt=0.1)


def spoiled(array, value):
    array = array.copy()
    array[4, 1] = value
    return array


CASES = {
    "x has as many samples as y": (
        lambda: History(X[:-1], Y),
        ShapeError,
        ["x", "31 samples", "30 samples"],
    ),
    "x three-dimensional": (lambda: History(X[None], Y), ShapeError, ["x", "2-D", "(T+1, n)"]),
    "y three-dimensional": (lambda: History(X, Y[None]), ShapeError, ["y", "2-D", "(T, p)"]),
    "x a number": (lambda: History(1.0, Y), ShapeError, ["x", "2-D", "single number"]),
    "x without channels": (
        lambda: History(np.zeros((31, 0)), Y),
        ShapeError,
        ["x", "at least one"],
    ),
    "y without samples": (lambda: History(X[:1], Y[:0]), ShapeError, ["y", "at least 1 sample"]),
    "x of words": (lambda: History([["a"], ["b"]], [[1.0]]), ShapeError, ["x", "real numbers"]),
    "x complex": (lambda: History(X + 1j, Y), ShapeError, ["x", "real numbers", "complex"]),
    "x ragged": (lambda: History([[1.0], [1.0, 2.0]], [[1.0]]), ShapeError, ["x", "real numbers"]),
    "NaN in the history": (
        lambda: History(spoiled(X, np.nan), Y),
        NotFiniteError,
        ["x", "row 4", "column 1", "NaN"],
    ),
    "infinity in the history": (
        lambda: History(X, spoiled(Y, np.inf)),
        NotFiniteError,
        ["y", "row 4", "inf"],
    ),
    "dt zero": (lambda: History(X, Y, dt=0.0), DdmheError, ["dt", "positive"]),
    "dt NaN": (lambda: History(X, Y, dt=np.nan), DdmheError, ["dt", "positive"]),
    "concat of nothing": (lambda: History.concat([]), ShapeError, ["histories", "empty"]),
    "concat of other things": (lambda: History.concat([1]), ShapeError, ["histories", "int"]),
    "concat of other sizes": (
        lambda: History.concat([H, History(X[:, :1], Y, 0.1)]),
        ShapeError,
        ["n = 3", "n = 1"],
    ),
    "concat of other dt": (
        lambda: History.concat([H, History(X, Y, 0.2)]),
        DdmheError,
        ["dt = 0.1", "0.2"],
    ),
    "rank at depth 0": (lambda: H.rank(0), DdmheError, ["depth", "1 to 30", "0"]),
    "rank deeper than the data": (lambda: H.rank(31), DdmheError, ["depth", "31"]),
    "history of another type": (lambda: DdMhe(X), DdmheError, ["history", "History"]),
    "horizon zero": (lambda: DdMhe(H, horizon=0), DdmheError, ["horizon", "at least 1", "0"]),
    "horizon negative": (lambda: DdMhe(H, horizon=-3), DdmheError, ["horizon", "-3"]),
    "horizon fractional": (lambda: DdMhe(H, horizon=2.5), DdmheError, ["horizon", "2.5"]),
    "horizon too long": (lambda: DdMhe(H, horizon=28), DdmheError, ["horizon", "1 to 27", "28"]),
    "recording too short": (
        lambda: DdMhe(History(X[:3], Y[:2])),
        RankError,
        ["at least n + 1 = 4", "2"],
    ),
    "state that never moves": (lambda: DdMhe(History(0 * X + 1, Y)), RankError, ["changes"]),
    "states that move together": (
        lambda: DdMhe(History(X[:, [0, 0]], Y), 5),
        RankError,
        ["rank n + 1 = 3", "rank 2"],
    ),
    "rho zero": (lambda: DdMhe(H, rho=0.0), DdmheError, ["rho", "(0, 1)", "0"]),
    "rho one": (lambda: DdMhe(H, rho=1.0), DdmheError, ["rho", "(0, 1)", "1"]),
    "rho NaN": (lambda: DdMhe(H, rho=np.nan), DdmheError, ["rho", "NaN"]),
    "mu zero": (lambda: DdMhe(H, mu=0.0), DdmheError, ["mu", "positive"]),
    "mu infinite": (lambda: DdMhe(H, mu=np.inf), DdmheError, ["mu", "finite"]),
    "x_prior too short": (lambda: DdMhe(H, x_prior=[1.0]), ShapeError, ["x_prior", "3 numbers"]),
    "x_prior NaN": (
        lambda: DdMhe(H, x_prior=[1.0, np.nan, 0.0]),
        NotFiniteError,
        ["x_prior", "NaN"],
    ),
    "x_bounds crossed": (
        lambda: DdMhe(H, x_bounds=(1.0, -1.0)),
        DdmheError,
        ["x_bounds", "lo <= hi", "lo = 1"],
    ),
    "x_bounds NaN": (lambda: DdMhe(H, x_bounds=(np.nan, 1.0)), DdmheError, ["x_bounds", "NaN"]),
    "x_bounds of another length": (
        lambda: DdMhe(H, x_bounds=([1.0, 2.0], 3.0)),
        ShapeError,
        ["x_bounds", "3 numbers"],
    ),
    "x_bounds not a pair": (lambda: DdMhe(H, x_bounds=1.0), ShapeError, ["x_bounds", "(lo, hi)"]),
    "x_bounds a triple": (
        lambda: DdMhe(H, x_bounds=(1, 2, 3)),
        ShapeError,
        ["x_bounds", "3 items"],
    ),
    "v_bounds crossed": (
        lambda: DdMhe(H, v_bounds=(0.0, [1.0, -1.0])),
        DdmheError,
        ["v_bounds", "entry 1"],
    ),
    "v_bounds out of reach": (
        lambda: DdMhe(H, v_bounds=(np.inf, np.inf)),
        DdmheError,
        ["v_bounds", "inf"],
    ),
    "x_center unknown": (
        lambda: DdMhe(H, x_center="middle"),
        DdmheError,
        ["x_center", "history", "middle"],
    ),
    "equilibrium not a pair": (
        lambda: DdMhe(H, equilibrium=3),
        ShapeError,
        ["equilibrium", "(x_e, y_e)"],
    ),
    "equilibrium too short": (
        lambda: DdMhe(H, equilibrium=([0.0], [0.0, 0.0])),
        ShapeError,
        ["equilibrium", "3"],
    ),
    "space unknown": (lambda: DdMhe(H, space="best"), DdmheError, ["space", "Ridge", "best"]),
    "truncation to nothing": (lambda: Truncated(0), DdmheError, ["rank", "at least 1", "0"]),
    "truncation below nothing": (lambda: Truncated(-1), DdmheError, ["rank", "at least 1", "-1"]),
    "truncation tolerance": (
        lambda: DdMhe(H, space=Truncated(tol=1.5)),
        DdmheError,
        ["space", "tol", "1.5"],
    ),
    "ridge negative": (
        lambda: DdMhe(H, space=Ridge(-1.0)),
        DdmheError,
        ["space", "positive", "-1"],
    ),
    "step with another length": (lambda: DdMhe(H, 5).step([1.0]), ShapeError, ["y_t", "2 numbers"]),
    "step with infinity": (lambda: DdMhe(H, 5).step([1.0, np.inf]), NotFiniteError, ["y", "inf"]),
    "step with nothing": (lambda: DdMhe(H, 5).step(None), ShapeError, ["y_t", "real numbers"]),
    "step bounds crossed": (
        lambda: DdMhe(H, 5).step([0, 0], x_bounds=(1, 0)),
        DdmheError,
        ["x_bounds", "lo <= hi"],
    ),
    "step bounds of another depth": (
        lambda: DdMhe(H, 5, start="state").step([0, 0], x_bounds=(np.zeros((5, 3)), 1)),
        ShapeError,
        ["x_bounds", "(2, 3)", "(5, 3)"],
    ),
    "run with other columns": (
        lambda: DdMhe(H, 5).run(np.zeros((4, 3))),
        ShapeError,
        ["Y", "2 columns", "3"],
    ),
    "run with infinity": (
        lambda: DdMhe(H, 5).run(spoiled(Y, -np.inf)),
        NotFiniteError,
        ["Y", "row 4", "inf"],
    ),
    "reset with another length": (
        lambda: DdMhe(H, 5).reset([1.0]),
        ShapeError,
        ["x_prior", "3 numbers"],
    ),
    "restore of other bytes": (lambda: DdMhe.restore(b"hello"), DdmheError, ["blob", "snapshot"]),
    "restore of a cut snapshot": (
        lambda: DdMhe.restore(DdMhe(H, 5).snapshot()[:-9]),
        DdmheError,
        ["blob"],
    ),
    "restore of a string": (lambda: DdMhe.restore("hello"), DdmheError, ["blob", "bytes"]),
}


@pytest.mark.parametrize("name", CASES)
def test_wrong_input(name):
    call, kind, words = CASES[name]
    with pytest.raises(kind) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    for word in words:
        assert word in text, text


def test_every_error_is_a_value_error():
    kinds = [
        ShapeError,
        NotFiniteError,
        RankError,
        ddmhe.InfeasibleError,
        ddmhe.ModelViolationError,
    ]
    assert all(issubclass(kind, DdmheError) for kind in kinds)
    assert issubclass(DdmheError, ValueError)


def test_a_rejected_step_leaves_the_estimator_unchanged():
    outputs = RNG.standard_normal((12, 2))
    a, b = (DdMhe(H, 5, space=Exact()) for _ in range(2))
    a.run(outputs[:6])
    b.run(outputs[:6])
    for wrong in ([1.0], [1.0, np.inf]):
        with pytest.raises(DdmheError):
            b.step(wrong)
    with pytest.raises(NotFiniteError):
        b.run(np.vstack([outputs[6:8], [[0.0, np.inf]]]))
    assert np.array_equal(a.run(outputs[6:]).x, b.run(outputs[6:]).x)


def test_lists_integers_and_other_layouts_are_welcome():
    as_lists = DdMhe(History(X.tolist(), Y.tolist()), 5)
    as_fortran = DdMhe(History(np.asfortranarray(X), Y[:, ::-1][:, ::-1]), 5)
    sample = Y[0]
    expected = DdMhe(H, 5).step(sample).x
    assert np.array_equal(as_lists.step(list(sample)).x, expected)
    assert np.array_equal(as_fortran.step(np.vstack([sample, sample]).T[:, 0]).x, expected)
    single = DdMhe(
        History(np.arange(9.0)[:, None] ** 2, np.arange(8)[:, None]), 2, space=Truncated(1)
    )
    assert single.step(3).x.shape == (1,)


def _hollow(array, holes):
    """One array with entries that say "not measured", in the ways of Python's world; -9999 lies
    under each mask."""
    masked = np.ma.array(array, copy=True)
    masked[holes] = -9999.0
    masked[holes] = np.ma.masked
    none, na = array.astype(object), array.astype(object)
    none[holes], na[holes] = None, pd.NA
    return {
        "masked": masked,
        "list of masked rows": list(masked),
        "None": none,
        "lists with None": none.tolist(),
        "NA": na,
        "nullable frame": pd.DataFrame(na).astype("Float64"),
    }


@pytest.mark.parametrize("kind", _hollow(Y, (slice(3, 5), 1)))
def test_outputs_that_are_masked_none_or_na_are_not_measured(kind):
    holes = ([3, 4, 9], [1, 1, 0])
    blank = Y.copy()
    blank[holes] = np.nan
    given = _hollow(Y, holes)[kind]
    expected = DdMhe(H, 5, start="state").run(blank).x
    np.testing.assert_array_equal(DdMhe(H, 5, start="state").run(given).x, expected)
    rows = given.to_numpy() if isinstance(given, pd.DataFrame) else given
    estimator = DdMhe(H, 5, start="state")
    np.testing.assert_array_equal([estimator.step(row).x for row in rows], expected)
    np.testing.assert_array_equal(
        ddmhe.run_many([DdMhe(H, 5, start="state")], [given])[0].x, expected
    )
    column = given.iloc[3] if isinstance(given, pd.DataFrame) else rows[3]
    assert np.isnan(DdMhe(H, 5, start="state").step(column).v[0, 1])


def test_a_missing_scalar_is_no_measurement_either():
    h = History(X[:, :1], Y[:, :1])
    expected = DdMhe(h, 5).step([np.nan]).x
    for given in (None, np.ma.masked, pd.NA, [None], np.ma.array([1.0], mask=[True])):
        np.testing.assert_array_equal(DdMhe(h, 5).step(given).x, expected)


@pytest.mark.parametrize("kind", _hollow(Y, ([4], [1])))
def test_what_must_be_known_must_not_be_missing(kind):
    for name, call in (
        ("x", lambda: History(_hollow(X, ([4], [1]))[kind], Y)),
        ("y", lambda: History(X, _hollow(Y, ([4], [1]))[kind])),
    ):
        with pytest.raises(
            NotFiniteError, match=rf"^{name}: .* missing \(masked, None or NA\) in row 4, column 1$"
        ):
            call()


def test_bounds_and_priors_must_not_be_missing():
    three = np.ma.array([1.0, -9999.0, 1.0], mask=[False, True, False])
    for name, call in (
        ("x_prior", lambda: DdMhe(H, 5, x_prior=three)),
        ("x_prior", lambda: DdMhe(H, 5).reset([0.0, None, 0.0])),
        ("x_bounds", lambda: DdMhe(H, 5, x_bounds=(-5.0, three))),
        ("x_bounds", lambda: DdMhe(H, 5).step([0, 0], x_bounds=(three, 5.0))),
        ("v_bounds", lambda: DdMhe(H, 5, v_bounds=(None, 1.0))),
        ("equilibrium", lambda: DdMhe(H, 5, equilibrium=(three, [0.0, 0.0]))),
        ("center", lambda: ddmhe.Zonotope(three, np.eye(3))),
        ("A", lambda: ddmhe.design.ioss(A=[[pd.NA]], C=[[1.0]])),
        ("omega_0", lambda: ddmhe.models.detumbling(omega_0=three)),
    ):
        with pytest.raises(NotFiniteError, match=rf"^{name}: .* missing \(masked, None or NA\)"):
            call()
