"""Wrong input to the interval side is one clear error."""

import numpy as np
import pytest

import ddmhe
from ddmhe import interval
from pendulum_case import RADIUS, START, V, W

INF = float("inf")


def system(**changed):
    given = {
        "A": np.eye(2),
        "C": [[1.0, 0.0]],
        "D1": np.eye(2),
        "D2": [[1.0]],
        "f": None,
        "jacobian": None,
    }
    given |= {"j_lo": np.zeros((2, 2)), "j_hi": np.zeros((2, 2))}
    return interval.System(**(given | changed))


def observer(**changed):
    s = interval.pendulum()
    design = interval.fixed_gain(s, [[1.5], [7.7]])
    given = {
        "system": s,
        "design": design,
        "x0_center": START,
        "x0_radius": RADIUS,
        "w_radius": W,
        "v_radius": V,
    }
    return interval.IntervalObserver(**(given | changed))


def python_system(f, jacobian):
    s = interval.pendulum()
    return interval.System(s.A, s.C, s.D1, s.D2, f, jacobian, s.j_lo, s.j_hi)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: system(A=np.ones((2, 3))), ddmhe.ShapeError, "A:"),
        (lambda: system(A=[[1, np.nan], [0, 1]]), ddmhe.NotFiniteError, "A:"),
        (lambda: system(C=[[1.0]]), ddmhe.ShapeError, "C:"),
        (lambda: system(D1=np.eye(3)), ddmhe.ShapeError, "D1:"),
        (lambda: system(D2=np.eye(2)), ddmhe.ShapeError, "D2:"),
        (lambda: system(B=np.eye(3)), ddmhe.ShapeError, "B:"),
        (lambda: system(r=[1.0, 2.0]), ddmhe.ShapeError, "r:"),
        (lambda: system(j_lo=np.ones((2, 2))), ddmhe.DdmheError, "j_lo:"),
        (lambda: system(f=np.sin), ddmhe.DdmheError, "f, jacobian:"),
        (lambda: system(f=1, jacobian=2), ddmhe.DdmheError, "f:"),
        (
            lambda: interval.linear(np.ones((2, 2)), np.zeros((2, 2)), [[1, 0]], np.eye(2), [[1]]),
            ddmhe.DdmheError,
            "A_lo",
        ),
        (lambda: interval.detumbling(uncertainty=-1), ddmhe.DdmheError, "uncertainty"),
        (lambda: interval.design_observer(3), ddmhe.DdmheError, "system:"),
        (lambda: interval.design_observer(interval.pendulum(), 1.5), ddmhe.DdmheError, "lam:"),
        (
            lambda: interval.design_observer(interval.pendulum(), 0.5, lmi="x"),
            ddmhe.DdmheError,
            "lmi:",
        ),
        (
            lambda: interval.design_observer(interval.pendulum(), 0.5, weights=[1, 0]),
            ddmhe.DdmheError,
            "weights:",
        ),
        (
            lambda: interval.design_observer(system(C=[[0.0, 0.0]]), 0.5),
            ddmhe.InfeasibleError,
            "smaller",
        ),
        (
            lambda: interval.design_observer(system(j_hi=np.full((2, 2), INF)), 0.5),
            ddmhe.DdmheError,
            "j_lo, j_hi",
        ),
        (lambda: observer(x0_center=[1.0]), ddmhe.ShapeError, "x0_center"),
        (lambda: observer(x0_radius=[0.1, -1.0]), ddmhe.DdmheError, "x0_radius"),
        (lambda: observer(w_radius=-1.0), ddmhe.DdmheError, "w_radius"),
        (lambda: observer(v_radius=np.nan), ddmhe.NotFiniteError, "v_radius"),
        (lambda: observer(order=1), ddmhe.DdmheError, "order"),
        (lambda: observer(method="best"), ddmhe.DdmheError, "method"),
        (lambda: observer(reduction="best"), ddmhe.DdmheError, "method"),
        (lambda: observer(design=np.eye(2)), ddmhe.DdmheError, "design"),
        (lambda: observer().step([1.0, 2.0]), ddmhe.ShapeError, "y:"),
        (lambda: observer().step([INF]), ddmhe.NotFiniteError, "y:"),
        (lambda: observer().step([1.0], u=[1.0]), ddmhe.ShapeError, "u:"),
        (lambda: observer().step([5.0]), ddmhe.ModelViolationError, "step 0 leaves state 1"),
        (lambda: observer().run(np.ones((3, 2))), ddmhe.ShapeError, "Y:"),
        (
            lambda: observer(system=python_system(lambda x: [1.0], lambda lo, hi: (0, 0))).step(
                [1.0]
            ),
            ddmhe.DdmheError,
            "jacobian",
        ),
        (
            lambda: observer(
                system=python_system(lambda x: 1 / 0, interval.pendulum().jacobian)
            ).step([1.0]),
            ddmhe.DdmheError,
            "ZeroDivisionError",
        ),
        (lambda: ddmhe.Zonotope([1.0], np.ones((2, 2))), ddmhe.ShapeError, "generators"),
        (lambda: ddmhe.Zonotope([np.nan], np.ones((1, 2))), ddmhe.NotFiniteError, "center"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).reduce(1), ddmhe.DdmheError, "q:"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).reduce(2, "x"), ddmhe.DdmheError, "method"),
        (lambda: ddmhe.Zonotope([0.0, 0.0], np.eye(2)).contains([1.0]), ddmhe.ShapeError, "x:"),
        (lambda: interval.from_history(1, 0.1, 0.1), ddmhe.DdmheError, "history"),
    ],
)
def test_wrong_input_is_one_clear_error(call, error, words):
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "expected" in str(caught.value)
