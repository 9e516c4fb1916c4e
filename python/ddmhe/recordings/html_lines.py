"""Tables of web pages, which some programs call spreadsheets, as lines of cells."""

from __future__ import annotations

from html.parser import HTMLParser

from ddmhe.recordings.text import Lines, line_of

__all__ = ["html_lines"]


class _Rows(HTMLParser):
    """The cells of all rows, each with the line on which its row begins, from 0."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.rows: list[tuple[int, list[str]]] = []
        self.inside = False

    def handle_starttag(self, tag: str, attrs: object) -> None:
        """A row or a cell begins."""
        if tag == "tr":
            self.rows.append((self.getpos()[0] - 1, []))
        elif tag in ("td", "th") and self.rows:
            self.rows[-1][1].append("")
            self.inside = True

    def handle_endtag(self, tag: str) -> None:
        """A cell ends."""
        if tag in ("td", "th"):
            self.inside = False

    def handle_data(self, data: str) -> None:
        """What a cell holds."""
        if self.inside:
            self.rows[-1][1][-1] += data


def html_lines(lines: Lines) -> tuple[Lines, list[str]]:
    """A row a line; where a line holds several, later ones go on to the next lines."""
    parser = _Rows()
    parser.feed("\n".join(lines.rows))
    found = [""] * len(lines.rows)
    for at, cells in parser.rows:
        place = at
        while place < len(found) and found[place]:
            place += 1
        found[place : place + 1] = [line_of([" ".join(cell.split()) for cell in cells])]
    return Lines(found, {}), ["a table of HTML"]
