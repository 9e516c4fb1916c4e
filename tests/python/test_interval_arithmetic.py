"""Interval arithmetic encloses what high precision computes."""

import mpmath
import numpy as np

from ddmhe._core import interval_operation

INF = float("inf")

UNARY = {
    "sqr": lambda x: x * x,
    "sqrt": mpmath.sqrt,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "exp": mpmath.exp,
}
BINARY = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
}
EDGES = [
    0.0,
    5e-324,
    2.3e-308,
    1e-160,
    0.5,
    1.0,
    np.pi / 2,
    np.pi,
    2 * np.pi,
    3e5,
    1e15,
    1e17,
    1e160,
    1.7e308,
]
EDGES = sorted(
    {s * x for x in EDGES for s in (-1, 1)} | {np.nextafter(np.pi, 4), -np.nextafter(np.pi, 4)}
)


def holds(found, exact, context):
    assert found[0] <= exact <= found[1], (*context, found)


def check_unary(op, lo, hi, inside):
    found = interval_operation(op, (lo, hi), (0.0, 0.0))
    for x in inside:
        if op == "sqrt" and x < 0:
            continue
        if op == "exp" and x > 1e6:
            assert found[1] == INF
            continue
        holds(found, UNARY[op](mpmath.mpf(x)), (op, lo, hi, x))
    return found


def test_elementary_functions_enclose_high_precision_values():
    rng = np.random.default_rng(0)
    with mpmath.workprec(400):
        for k in range(50_000):
            op = list(UNARY)[k % 5]
            center = rng.standard_normal() * 10.0 ** rng.uniform(-8, 3)
            width = abs(center) * 10.0 ** rng.uniform(-17, 1) * (k % 7 > 0)
            lo, hi = center - width, center + width
            inside = [lo, hi, min(max(lo + rng.random() * (hi - lo), lo), hi)]
            found = check_unary(op, lo, hi, inside)
            if op in ("sin", "cos") and width == 0 and abs(center) < 1e3:
                assert (
                    found[1] - found[0] <= 6 * np.spacing(max(abs(found[0]), 1e-300)) + 1e-300
                )  # and tight


def test_elementary_functions_at_every_edge():
    with mpmath.workprec(1400):
        for op in UNARY:
            for i, lo in enumerate(EDGES):
                for hi in EDGES[i:]:
                    check_unary(op, lo, hi, [x for x in EDGES if lo <= x <= hi])
                found = interval_operation(op, (lo, INF), (0.0, 0.0))
                assert found[0] <= found[1]
        # the extrema inside, by hand
        assert interval_operation("cos", (-0.1, 0.2), (0, 0))[1] == 1.0
        assert interval_operation("cos", (3.0, 3.2), (0, 0))[0] == -1.0
        assert interval_operation("sin", (1.5, 1.6), (0, 0))[1] == 1.0
        assert interval_operation("sin", (-1.6, -1.5), (0, 0))[0] == -1.0
        low, high = interval_operation("sin", (0.1, 0.2), (0, 0))
        assert 0 < np.sin(0.1) - low < 1e-15
        assert 0 < high - np.sin(0.2) < 1e-15
        assert np.isnan(interval_operation("sqrt", (-2.0, -1.0), (0, 0))).all()


def test_basic_operations_enclose_exact_values():
    rng = np.random.default_rng(1)
    ends = rng.standard_normal((50_000, 4)) * 10.0 ** rng.integers(-12, 12, (50_000, 4))
    ends[::11, 0] = 0.0
    ends[::13, 2] = 0.0
    edges = [
        (a, b, c, d) for a in EDGES[::3] for b in EDGES[::3] for c in EDGES[::4] for d in EDGES[::4]
    ]
    with mpmath.workprec(2500):
        for k, (a, b, c, d) in enumerate([*map(tuple, ends), *edges]):
            x, y = (min(a, b), max(a, b)), (min(c, d), max(c, d))
            op = list(BINARY)[k % 4]
            found = interval_operation(op, x, y)
            corners = {
                (u, v): BINARY[op](mpmath.mpf(u), mpmath.mpf(v))
                for u in x
                for v in y
                if op != "div" or v != 0
            }
            for at, exact in corners.items():
                holds(found, exact, (op, x, y, *at))
            if k < len(ends) and not (op == "div" and y[0] <= 0 <= y[1]):  # and tight
                assert found[0] >= min(corners.values()) - 2 * np.spacing(abs(found[0]))
                assert found[1] <= max(corners.values()) + 2 * np.spacing(abs(found[1]))
