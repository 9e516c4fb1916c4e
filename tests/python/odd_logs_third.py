"""Eighteen more ways of writing the log of `odd_logs`, put down before any of them was read."""

import csv
import io
import json
from datetime import timedelta

from odd_logs import DT, HEAD, ROWS, START, N, clock, text


def third():
    """By name: the file's ending, its text, and options of `read` that the habit needs."""
    seconds = [DT * k for k in range(N)]
    moved = [[*row[:1], *(f"{float(c) + 1e-30:+.9g}" for c in row[1:])] for row in ROWS]
    wide = [f"{name:>16}" for name in HEAD]
    named = [[f'"{k + 1}"', *row] for k, row in enumerate(ROWS)]
    quoted = io.StringIO()
    csv.writer(quoted, delimiter=";", quoting=csv.QUOTE_ALL).writerows([HEAD, *ROWS])
    columns = {name: [float(row[i]) for row in ROWS] for i, name in enumerate(HEAD)}
    rows_in_lists = [
        json.dumps({"t_s": float(t), "w": [float(a), float(b)], "q1": float(q)})
        for t, a, b, q in ROWS
    ]
    of_day = [START + timedelta(seconds=s) for s in seconds]
    swiss = [f"{20 * k:,}".replace(",", "'") for k in range(N)]
    noted = [[*row, f'"ok, {k % 3}"', f"0x{k:04X}"] for k, row in enumerate(ROWS)]
    halves = [text().split("\n")[:121], text().split("\n")]
    return {
        "Fortran's exponents": (
            ".dat",
            text(sep=" ", rows=[[f"{float(c):.9E}".replace("E", "D") for c in r] for r in ROWS]),
            {},
        ),
        "columns of one width": (
            ".txt",
            text(wide, [[f"{c:>16}" for c in row] for row in ROWS], sep=""),
            {},
        ),
        "every cell in quotes": (".csv", quoted.getvalue(), {}),
        "a separator behind each row": (".csv", text([*HEAD, ""], [[*r, ""] for r in ROWS]), {}),
        "Excel's sep=": (".csv", text(sep=";", above=["sep=;"]), {}),
        "Swiss thousands": (".csv", clock(swiss, "time_ms"), {}),
        "signs before all numbers": (".csv", text(rows=moved), {}),
        "a typographic minus": (".csv", text().replace("-", "\N{MINUS SIGN}"), {}),
        "words and hexadecimals beside": (".csv", text([*HEAD, "state_word", "flags"], noted), {}),
        "line ends of the old Macintosh": (".csv", text(end="\r"), {}),
        "a line that says the end": (".csv", text() + "END OF DATA\n", {}),
        "modified Julian days": (
            ".csv",
            clock([f"{60431.5 + s / 86400:.12f}" for s in seconds], "mjd"),
            {},
        ),
        "GPS week and seconds of it": (
            ".csv",
            text(
                ["gps_week", "tow_s", *HEAD[1:]],
                [["2312", f"{302400 + s:.2f}", *r[1:]] for s, r in zip(seconds, ROWS, strict=True)],
            ),
            {},
        ),
        "the header once more in the middle": (
            ".csv",
            "\n".join([*halves[0], ",".join(HEAD), *halves[1][121:]]),
            {},
        ),
        "an object of columns": (".json", json.dumps(columns), {}),
        "vectors in JSON lines": (
            ".jsonl",
            "\n".join(rows_in_lists) + "\n",
            {"state": ["w[0]", "w[1]"]},
        ),
        "hours, minutes and seconds by letters": (
            ".csv",
            clock(
                [f"{t:%Hh%Mm%S}.{t.microsecond // 10_000:02}s" for t in of_day],
                "time",
            ),
            {},
        ),
        "R's row names without a header": (".txt", text(rows=named, sep=" "), {}),
    }
