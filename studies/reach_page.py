"""The tables of docs/measured/reach.md, each in its place between the words around it."""

import re
from collections.abc import Sequence
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "measured" / "reach.md"


def put(name: str, lines: Sequence[str]) -> None:
    """Print a table, and put it in the place that the page has for it."""
    print(f"{name}:", *lines, "", sep="\n", flush=True)
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
    text, table = PAGE.read_text(encoding="utf-8"), "\n".join(["", *lines, "", ""])
    made, found = re.subn(f"{begin}.*?{end}", lambda _: begin + table + end, text, flags=re.DOTALL)
    if found != 1:
        raise ValueError(f"{PAGE.name}: expected one place for '{name}', found {found}")
    PAGE.write_text(made, encoding="utf-8")
