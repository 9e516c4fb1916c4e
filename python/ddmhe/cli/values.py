"""Texts of options as values of settings: bounds, prices, matrices, a rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown

Array = NDArray[np.float64]

__all__ = [
    "bounds",
    "equilibrium",
    "matrix",
    "numbers",
    "one_or_each",
    "price",
    "resolved",
    "stand_ins",
]

Interval = tuple[float, float]


def parsed(value: str) -> tuple[float, ...]:
    """The numbers of a comma-separated list; none where one of them is no number."""
    try:
        return tuple(float(part) for part in value.split(","))
    except ValueError:
        return ()


def numbers(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[float, ...] | None:
    """Finite numbers from a comma-separated list."""
    if value is None:
        return None
    found = parsed(value)
    if not found or not np.isfinite(found).all():
        raise click.BadParameter(
            f"expected finite numbers separated by commas, found {shown(value)}"
        )
    return found


def stand_ins(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[float | str, ...] | None:
    """Finite numbers and words from a comma-separated list."""
    if value is None:
        return None
    found: list[float | str] = []
    for part in value.split(","):
        try:
            number = float(part)
        except ValueError:
            found.append(part.strip())
            continue
        found.append(number if np.isfinite(number) else "")
    if "" in found:
        raise click.BadParameter(
            f"expected finite numbers or words separated by commas, found {shown(value)}"
        )
    return tuple(found)


def one_or_each(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> float | tuple[float, ...] | None:
    """One finite number for all columns, or one a column, separated by commas."""
    found = numbers(ctx, param, value)
    return found[0] if found is not None and len(found) == 1 else found


def bounds(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> list[tuple[str, Interval]] | None:
    """LO:HI for all columns, or one a column parted by commas, or NAME=LO:HI for some; an end left
    out is none. As names ("" for none) and ends."""
    if value is None:
        return None
    found = []
    for part in value.split(","):
        name, _, ends = part.rpartition("=")
        try:
            lo, hi = ends.split(":")
            pair = float(lo) if lo.strip() else -np.inf, float(hi) if hi.strip() else np.inf
        except ValueError:
            raise click.BadParameter(
                "expected LO:HI, one a column, or NAME=LO:HI, parted by commas, "
                f"found {shown(value)}"
            ) from None
        found.append((name.strip(), pair))
    named = [name for name, _ in found if name]
    if named and (len(named) < len(found) or len(set(named)) < len(named)):
        raise click.BadParameter(f"expected different names, or none, found {shown(value)}")
    return found


def resolved(
    option: str, found: Sequence[tuple[str, Interval]], columns: Sequence[str]
) -> tuple[Any, Any]:
    """(lo, hi) of bounds by name or place, for these columns; what is not named has no bounds."""
    if not found[0][0]:
        if len(found) == 1:
            return found[0][1]
        lo, hi = np.transpose([pair for _, pair in found])
        return lo, hi
    lo, hi = np.full((2, len(columns)), [[-np.inf], [np.inf]])
    for name, pair in found:
        if name not in columns:
            raise click.BadParameter(
                f"expected names out of {', '.join(columns)}, found {shown(name)}",
                param_hint=option,
            )
        i = list(columns).index(name)
        lo[i], hi[i] = pair
    return lo, hi


def price(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> float | dict[str, float] | None:
    """One price, or x=PRICE,v=PRICE,w=PRICE."""
    if value is None:
        return None
    try:
        if "=" not in value:
            return float(value)
        parts = [part.split("=") for part in value.split(",")]
        return {name.strip(): float(number) for name, number in parts}
    except ValueError:
        raise click.BadParameter(
            f"expected a price, or x=PRICE,v=PRICE,w=PRICE, found {shown(value)}"
        ) from None


def matrix(ctx: click.Context, param: click.Parameter, value: str | None) -> Array | str | None:
    """A matrix of its diagonal's numbers, or a word."""
    if value is None:
        return None
    found = parsed(value)
    return np.diag(found) if found else value


def equilibrium(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[tuple[float, ...], ...] | None:
    """Numbers of the states, of the outputs and of the inputs at rest, parted by colons."""
    if value is None:
        return None
    groups = tuple(parsed(part) for part in value.split(":"))
    if not 2 <= len(groups) <= 3 or not all(groups):
        raise click.BadParameter(
            f"expected X1,X2,…:Y1,Y2,… with :U1,U2,… where there are inputs, found {shown(value)}"
        )
    return groups
