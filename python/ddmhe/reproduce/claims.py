"""Claims of the papers and what came out here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ddmhe.files import write_text

__all__ = ["Claim", "Verdict", "holds_if", "write_claims"]

Verdict = Literal["holds", "holds with …", "does not hold", "cannot be checked"]


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


HEADER = ("source", "claim", "printed", "ours", "verdict", "why")


def write_claims(path: Path, claims: Sequence[Claim]) -> None:
    """A Markdown table, one line per claim."""
    lines = [
        "# What the papers claim, and what came out",
        "",
        "Written by `ddmhe reproduce`. The first paper prints neither speed, inertia, torque nor noise of its bench:",
        "ours are those of `ddmhe.models.SpinDown` and `ddmhe.reproduce.bench`. Errors: medians over the noise seeds.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|" + " --- |" * len(HEADER),
    ]
    for claim in claims:
        cells = (claim.source, claim.claim, claim.printed or "–", claim.ours, f"**{claim.verdict}**", claim.why)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    write_text(path, "\n".join([*lines, ""]))
