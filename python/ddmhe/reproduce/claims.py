"""Claims of the papers and what came out here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.table import Table

from ddmhe.files import write_text
from ddmhe.report.page import markdown_table

__all__ = [
    "MISPRINTS",
    "Claim",
    "Verdict",
    "cases",
    "holds_for",
    "holds_if",
    "verdict",
    "verdicts",
    "write_claims",
]

Verdict = Literal[
    "holds", "holds with …", "holds for …", "plausible", "does not hold", "cannot be checked"
]
"""INTRODUCTION says what each means."""


@dataclass(frozen=True)
class Claim:
    """One sentence or number of a paper."""

    source: str
    """Where it stands."""
    claim: str
    """What it says, in our words."""
    printed: str
    """The number that the paper prints, or an empty string."""
    ours: str
    """What came out here."""
    verdict: Verdict
    why: str
    """Reason for the verdict, or the condition under which the claim holds."""


def holds_if(condition: bool) -> Verdict:
    """The verdict on a claim that a number decides."""
    return "holds" if condition else "does not hold"


def holds_for(judged: Sequence[bool | None]) -> Verdict:
    """The verdict over cases that all fit what is printed, None where a case cannot judge.

    The paper's own case is not among them for certain, so none of them, nor all together, refute.
    """
    known = [each for each in judged if each is not None]
    if not any(known):
        return "cannot be checked"
    return "holds" if all(known) else "holds for …"


HEADER = ("source", "claim", "printed", "ours", "verdict", "why")


def verdict(judged: Mapping[str, bool]) -> Verdict:
    """The verdict over cases that the paper prints well enough to be refuted by them."""
    if any(judged.values()) and not all(judged.values()):
        return "holds for …"
    return holds_if(all(judged.values()))


def cases(judged: Mapping[str, bool]) -> str:
    """Which cases hold and which do not; nothing where all agree."""
    yes = [case for case, holds in judged.items() if holds]
    no = [case for case, holds in judged.items() if not holds]
    return f"; holds for {', '.join(yes)}; not for {', '.join(no)}" if yes and no else ""


INTRODUCTION = """\
# What the papers claim, and what came out

Written by `ddmhe reproduce`: every verdict is computed from the series or the matrices of \
that run. Roman numbers
are sections of the de-tumbling paper (X. Liu et al., arXiv 2301.05351v3), "interval paper" is \
"Interval Estimation for
Bounded Jacobian Nonlinear Systems by Zonotope Analysis". Errors: medians over the noise seeds.

The de-tumbling paper prints neither speed, inertia, torque nor noise of its bench (IV-A), \
so no single bench can refute
what Figs. 2 to 6 show: those claims are judged over a family of benches \
(`ddmhe.reproduce.bench.FAMILY`).

- **holds with …**: under a condition that the paper does not state, named beside it.
- **holds for …**: in some of the cases that fit what is printed, named beside it.
- **plausible**: the paper's method gives this number for some choice of what is not printed.
- **cannot be checked**: it hangs on what is not printed, and none of the cases tried shows it."""


MISPRINTS = (
    ("(11), proof of Lemma 1", "r_L α = e_o", "r_L α = r_o"),
    (
        "(12)",
        "exists since H_1(x) has rank n",
        "since H_1(x) with the row of ones has rank n+1, (7)",
    ),
    ("(14b)", "x̂(j+1) = A x̂(j) + ŵ(j)", "+ e, as in (5); likewise r in (14c)"),
    ("below (15)", "P = 2ρ^M, R = ρ^{j-1} μ", "times identity matrices"),
    ("Theorem 1", "only Assumption 1 is asked for", "its proof uses Assumption 2, too"),
    ("proof of Theorem 2", "l ∈ [1, M-1]", "l ∈ [0, M-1], or t = kM is left out"),
    ("IV-A1", "half width 10π/60·1_3 with a scalar state", "10π/60 rad/s (5 rpm)"),
    (
        "IV-A1",
        "x_c(t) = H_x H_y† y(t)",
        "y(t) is the window y(t-M_t), …, y(t-1); with offsets the row of ones belongs in",
    ),
    ("A-A", "Duel system", "dual system"),
    ("(46)", "X_{0,T-1}, X_{1,T}, Y_{0,T-1}", "T - 1 columns each, so G_L of (52) has T - 1 rows"),
    ("Interval paper, 2.2", "system (11)", "system (13)"),
    ("Interval paper, (12)", "i, …, n", "i = 1, …, n"),
    ("Interval paper, (22)", "U of size n×p", "n×n, or the blocks do not fit"),
    ("Interval paper, (29)", "λ and γ in (22), λ_l and γ_l from (29) on", "the same numbers"),
    ("Interval paper, (42)", "subject to (22) besides the vertices", "(23)"),
    ("Interval paper, (44)", "φ_k I", "φ_k times the vector of ones"),
    ("Interval paper, (51)", "x_k - x̂_{k-1}", "x_{k-1} - x̂_{k-1}"),
    ("Interval paper, 1", "existing methods [3]", "the reference has no number"),
)
"""(where, as printed, as meant): none of them changes a result."""


def write_claims(path: Path, claims: Sequence[Claim]) -> None:
    """A Markdown page: a table with one line per claim, and the misprints that do no harm."""
    rows = [
        (c.source, c.claim, c.printed or "–", c.ours, f"**{c.verdict}**", c.why) for c in claims
    ]
    lines = [*INTRODUCTION.splitlines(), "", *markdown_table(HEADER, rows)]
    lines += ["", "## Misprints that do no harm", ""]
    lines += [*markdown_table(("where", "printed", "meant"), MISPRINTS), ""]
    write_text(path, "\n".join(lines))


def verdicts(claims: Sequence[Claim]) -> Table:
    """What the papers claim and whether it holds."""
    result = Table(
        "source",
        "claim",
        "printed",
        "ours",
        "verdict",
        title="Claims",
        title_justify="left",
        show_lines=True,
    )
    for claim in claims:
        result.add_row(claim.source, claim.claim, claim.printed, claim.ours, claim.verdict)
    return result
