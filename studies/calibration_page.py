"""The page docs/measured/evidence.md, of which two studies print one half each."""

import re
from collections.abc import Sequence
from pathlib import Path

MEASURED = Path(__file__).resolve().parents[1] / "docs" / "measured"
PAGE = MEASURED / "evidence.md"
HALVES = ("evidence", "faults")
"""Names of the halves, `make study-NAME`, in their order."""
INTRODUCTION = """\
# Evidence, measured: how often the bars hold, and what is seen

What the words and numbers mean: [evidence.md](../evidence.md). The first half of this page is
printed by `make study-evidence`, the second by `make study-faults`; each says how long it took.
`DDMHE_DATA=FOLDER` names measured logs, without which their rows are left out.
"""


def write_half(name: str, lines: Sequence[str]) -> None:
    """Put the lines in the place of that half; the other stays as it is."""
    old = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    halves = {half: _between(old, half) for half in HALVES} | {name: "\n".join(lines).strip()}
    parts = [
        f"{_mark('begin', half)}\n\n{text}\n\n{_mark('end', half)}\n"
        for half, text in halves.items()
    ]
    PAGE.write_text("\n".join([INTRODUCTION, *parts]), encoding="utf-8")


def verdict(asked: str, measured: str, holds: bool) -> list[str]:
    """The end of a row that compares what was asked for with what was found."""
    return [asked, measured, "holds" if holds else "**fails**"]


def _mark(kind: str, half: str) -> str:
    return f"<!-- {kind} study-{half} -->"


def _between(text: str, half: str) -> str:
    begin, end = (re.escape(_mark(kind, half)) for kind in ("begin", "end"))
    found = re.search(f"{begin}\n(.*){end}", text, re.DOTALL)
    return found[1].strip() if found else f"(not printed yet: `make study-{half}`)"
