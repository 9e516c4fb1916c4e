"""Sections on what an estimator has found out about the system: a rigid body's inertia, or a
polynomial model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.report.web.numbers import number, plus_minus
from ddmhe.report.web.parts import Items, Section, Table, Text
from ddmhe.report.web.run import Run

Array = NDArray[np.float64]

__all__ = ["lifted_section", "rigid_section"]

AXES = "xyz"
RESIDUALS = ("rates", "outputs", "rates, means of ten", "outputs, means of ten")
"""What `chi` and `limits` of a rigid body's report are of."""


def rigid_section(run: Run) -> Section | None:
    """Inertia with its error bars, the direction that no output shows, the optima that were kept;
    None for an estimator that knows of no body."""
    told = getattr(run.est, "report", None)
    if not callable(told):
        return None
    found = told()
    if found is None:
        return Section("body", "Rigid body", [Text("No rigid body was fitted to the recording.")])
    words = [found.words] if isinstance(found.words, str) else list(found.words)
    blocks: list[Any] = [Items(words)] if words else []
    blocks += [_inertia(found), *_unseen(found.unseen), _residuals(found), _optima(found.optima)]
    return Section("body", "Rigid body", blocks)


def _inertia(found: Any) -> Table:
    inertia, std = np.asarray(found.inertia), np.asarray(found.inertia_std)
    rows = [(AXES[i], *(plus_minus(inertia[i, j], std[i, j]) for j in range(3))) for i in range(3)]
    caption = "Inertia of trace 3, for its scale cannot be seen, ± one standard deviation"
    return Table(caption, ("", *AXES), rows)


def _unseen(direction: Array) -> list[Text]:
    if not np.all(np.isfinite(direction)):
        return []  # in a field that moves none stays so, as the words above say
    parts = ", ".join(f"{value:.3f}" for value in np.asarray(direction))
    return [Text(f"A turn about ({parts}), in axes of the body, shows in no output.")]


def _residuals(found: Any) -> Table:
    rows = [
        (name, number(float(chi)), number(float(limit)), "yes" if chi <= limit else "no")
        for name, chi, limit in zip(RESIDUALS, found.chi, found.limits, strict=False)
    ]
    header = ("residuals of", "mean square", "limit", "explained")
    return Table("Residuals of the fit in units of their noise", header, rows)


def _optima(optima: Any) -> Table:
    rows = []
    for k, (cost, evidence, inertia) in enumerate(optima):
        moments = np.linalg.eigvalsh(np.asarray(inertia))
        rows.append((str(k + 1), f"{cost:.5g}", f"{evidence:.5g}",
                     ", ".join(f"{moment:.3f}" for moment in moments)))  # fmt: skip
    header = ("", "cost", "log of the evidence", "principal moments")
    return Table("Optima that are kept, the best first", header, rows)


def lifted_section(run: Run) -> Section | None:
    """Whether a polynomial model is used; None for an estimator that has none."""
    chosen, degree = (getattr(run.est, name, None) for name in ("chosen", "degree"))
    if chosen is None or degree is None:
        return None
    words = (
        f"A polynomial model of degree {degree} is used: its errors are clearly smaller in "
        "held-out ends of the recording."
        if chosen
        else "No polynomial is used: none is clearly better in held-out ends of the recording."
    )
    status = getattr(run.log, "status", None)
    if chosen and status is not None:
        share = float(np.mean(np.asarray(status) == "lifted"))
        words += f" It made {100 * share:.0f} % of the estimates, the affine estimator the others."
    return Section("model", "Polynomial model", [Text(words)])
