"""A table as any file or frame gives it: named columns, each of text cells or of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import did_you_mean, listed, shown
from ddmhe.recordings.errors import LogError

Cells = Sequence[str] | NDArray[Any]

__all__ = ["Cells", "Table"]


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length N under a header."""

    path: str
    """What messages call it."""
    header: Sequence[str]
    columns: Sequence[Cells]
    """One a name of the header: texts, or an array (N,) of numbers or times."""
    places: NDArray[np.int64]
    """Line of each row in the file (N,), or its number, from 1."""
    place: str = "line"
    """What a place is called: "line" or "row"."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of columns, where the file states them."""
    decimal: str = "."
    """Decimal mark of the text cells."""
    grouped: bool = False
    """Whether the other mark, "," or ".", may group thousands."""
    notes: tuple[str, ...] = ()
    """What was inferred on the way, one phrase each."""
    sep: str | None = None
    """What parts the cells of a text; None for other formats."""
    alone: bool = True
    """Whether a line more can be read as it is, with the header alone."""
    digest: str | None = None
    """SHA-256 of the bytes that were read; None for frames."""

    def __len__(self) -> int:
        """Rows N."""
        return len(self.places)

    def index(self, name: str) -> int | None:
        """Which column a name means; None if no one or several.

        It is the name of the header, or else, where groups are nested, one that only one column
        ends with; "." and "/" part groups alike, and a line's end in a name is like a blank."""
        if name in self.header:
            return list(self.header).index(name) if self.header.count(name) == 1 else None
        asked = _plain(name)
        names = [_plain(known) for known in self.header]
        found = [k for k, known in enumerate(names) if known == asked] or [
            k for k, known in enumerate(names) if known.endswith("." + asked)
        ]
        return found[0] if len(found) == 1 else None

    def find(self, option: str, name: str) -> int:
        """Which column a name means; LogError naming the option where that is not clear."""
        found = self.index(name)
        if found is not None:
            return found
        if self.header.count(name) > 1:
            count = self.header.count(name)
            raise LogError(
                f"{self.path}: expected one column named {shown(name)}, found {count}; give each "
                "a name of its own"
            )
        ending = [known for known in self.header if _plain(known).endswith("." + _plain(name))]
        if ending:
            raise LogError(
                f"{option}: expected a column of {self.path}, found {shown(name)}, which may be "
                f"{' or '.join(map(shown, ending[:3]))}"
            )
        raise LogError(
            f"{option}: expected a column of {self.path}, found {shown(name)}{self._nearest(name)}"
        )

    def joined(self, names: Sequence[str]) -> tuple[str, ...]:
        """Names of which some may be parts of one name of the header that has a comma in it."""
        whole = {tuple(part.strip() for part in name.split(",")): name for name in self.header}
        found, k = [], 0
        while k < len(names):
            size = 1
            if self.index(names[k]) is None:
                longer = range(2, len(names) - k + 1)
                size = next((n for n in longer if tuple(names[k : k + n]) in whole), 1)
            found.append(names[k] if size == 1 else whole[tuple(names[k : k + size])])
            k += size
        return tuple(found)

    def column(self, name: str) -> Cells:
        """The cells of a column that is there."""
        found = self.index(name)
        assert found is not None
        return self.columns[found]

    def unit(self, name: str) -> str | None:
        """The unit that the file states for a column."""
        found = self.index(name)
        return None if found is None else self.units.get(self.header[found])

    def noted(self, *notes: str) -> Table:
        """With more that was inferred."""
        return replace(self, notes=(*self.notes, *notes))

    def rows(self, chosen: NDArray[np.intp]) -> Table:
        """Some of the rows, in the order given."""

        def cells(column: Cells) -> Cells:
            if isinstance(column, np.ndarray):
                return column[chosen]
            return [column[k] for k in chosen]

        return replace(self, columns=[cells(c) for c in self.columns], places=self.places[chosen])

    def _nearest(self, name: str) -> str:
        hint = did_you_mean(name, self.header)
        return f"{hint} (columns: {listed(self.header)})"


def _plain(name: str) -> str:
    return " ".join(name.strip("/").replace("/", ".").split())
