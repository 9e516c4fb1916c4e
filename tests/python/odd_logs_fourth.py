"""Ways of writing the log of `odd_logs` that were refused once: what loggers, instruments,
simulations, databases and people make of it."""

import io
import json
import tarfile
import zipfile
from datetime import timedelta

import h5py
import numpy as np
import scipy.io

from odd_logs import DT, HEAD, ROWS, START, N, text

HOLES = (170, 171, 181)
"""Samples without an output in some of them."""
TIMES = [float(row[0]) for row in ROWS]
CELLS = [row[1:] for row in ROWS]
MOMENTS = [START + timedelta(seconds=58 + t) for t in TIMES]
ROUND = [f"{m.microsecond // 1000:03d}" for m in MOMENTS]
NUMBERS = np.array(ROWS, dtype=float)


def lines(*rows, sep=",", end="\n"):
    return end.join([*(row if isinstance(row, str) else sep.join(row) for row in rows), ""])


def clocked(words, name="time"):
    return lines([name, *HEAD[1:]], *([w, *c] for w, c in zip(words, CELLS, strict=True)))


def stamped(form, mark="."):
    return [f"{m:{form}}{mark}{ms}" for m, ms in zip(MOMENTS, ROUND, strict=True)]


def beside(names, parts):
    head = [*names, *HEAD[1:]]
    return lines(head, *([*map(str, p), *c] for p, c in zip(parts, CELLS, strict=True)))


def without(word):
    return [[*r[:3], word if k in HOLES else r[3]] for k, r in enumerate(ROWS)]


def quoted(row):
    return [f'"{cell}"' for cell in row]


def comma(cells):
    return [cell.replace(".", ",") for cell in cells]


def bars(rule, above=()):
    rows = [" | ".join(f"{c:>14}" for c in row) for row in [HEAD, *ROWS]]
    return rows[0], rule, *rows[1:]


def times_in_parts():
    """Columns that hold a time together, and times in digits and words."""
    year = [(m.year, m.month, m.day, m.hour, m.minute) for m in MOMENTS]
    seconds = [f"{m.second}.{ms}" for m, ms in zip(MOMENTS, ROUND, strict=True)]
    week = [(2312, f"{302_400_000 + 20 * k}") for k in range(N)]
    of_day = [("2024", "122", f"{43_258 + t:.2f}") for t in TIMES]
    french = [
        f"{1000 * t:,.3f}".replace(",", "\N{NO-BREAK SPACE}").replace(".", ",") for t in TIMES
    ]
    rows = zip(french, CELLS, strict=True)
    return {
        "parts of a date": beside(
            ["year", "month", "day", "hour", "minute", "second"],
            [(*y, s) for y, s in zip(year, seconds, strict=True)],
        ),
        "months and minutes of two letters": beside(
            ["YYYY", "MM", "DD", "hh", "mm", "ss.ss"],
            [(*y, s) for y, s in zip(year, seconds, strict=True)],
        ),
        "day of the year": beside(["YEAR", "DOY", "SOD"], of_day),
        "week and milliseconds": beside(["GPS_Week", "GPS_TOW_ms"], week),
        "milliseconds apart": beside(
            ["Time", "ms"],
            [(f"{m:%H:%M:%S}", int(ms)) for m, ms in zip(MOMENTS, ROUND, strict=True)],
        ),
        "digits of date and time": beside(
            ["Date", "Time"],
            [(f"{m:%Y%m%d}", f"{m:%H%M%S}{ms}") for m, ms in zip(MOMENTS, ROUND, strict=True)],
        ),
        "digits of the time": clocked(stamped("%H%M%S"), "utc"),
        "day of the year and time": clocked(stamped("%j:%H:%M:%S"), "IRIG_TIME"),
        "days and time": clocked([f"0 days 00:00:{t:09.6f}" for t in TIMES], ""),
        "two digits of the year": clocked([f"{s} PM" for s in stamped("%m/%d/%y %I:%M:%S")]),
        "year of two digits first": clocked(stamped("%y/%m/%d %H:%M:%S")),
        "German, two digits": lines(
            ["Zeit", *HEAD[1:]],
            *(
                [s, *comma(c)]
                for s, c in zip(stamped("%d.%m.%y %H:%M:%S", ","), CELLS, strict=True)
            ),
            sep=";",
        ),
        "month in letters, two digits": clocked(stamped("%d-%b-%y %H:%M:%S")),
        "month in letters, joined": clocked(stamped("%d%b%Y:%H:%M:%S")),
        "a named zone": clocked(
            [f"{s}+02:00[Europe/Berlin]" for s in stamped("%Y-%m-%dT%H:%M:%S")]
        ),
        "dots in the time": clocked([f"1.5.2024 {s}" for s in stamped("%H.%M.%S")]),
        "blanks between thousands": lines(
            ["Temps (ms)", *HEAD[1:]], *([t, *comma(c)] for t, c in rows), sep=";"
        ),
        "a time by its unit": lines(
            ["", "Pt", "T", *HEAD[1:]],
            ["", "#", "s", "rad/s", "rad/s", "rad"],
            *(["", str(k), *r] for k, r in enumerate(ROWS)),
            sep="\t",
        ),
    }


def cells_and_lines():
    """What stands in cells, and around the table."""
    two = [[*r[:3], ""] for r in ROWS], [[r[0], "", "", r[3]] for r in ROWS]
    both = [row for pair in zip(*two, strict=True) for row in pair]
    units = [[r[0], f"{r[1]} rad/s", f"{r[2]} rad/s", f"{r[3]} rad"] for r in ROWS]
    note = ['"valve open,\nsee page 3"' if k in (40, 200) else "" for k in range(N)]
    half = text().split("\n")
    wide = [["t [s]", "rate a", "rate b", "q"], *ROWS]
    spread = ["".join(f"{c:<20}" for c in row) for row in wide]
    words = [["", *[f"{word}: a"] * 3] for word in ("Type", "Unit", "Interp", "Path")]
    return {
        "a row a raster": (lines(HEAD, *both), {"duplicates": "mean"}),
        "units in the cells": lines(HEAD, *units),
        "vectors in the cells": (
            lines(["time_s", "w", "q1"], *([r[0], f'"[{r[1]}, {r[2]}]"', r[3]] for r in ROWS)),
            {"state": ["w[0]", "w[1]"]},
        ),
        "words for an overload": (lines(HEAD, *without("+OVER")), {"missing": ["+OVER"]}),
        "points for nothing": lines(HEAD, *without(".")),
        "dashes and a point": lines(HEAD, *without("--.--")),
        "\\N": lines(HEAD, *without(r"\N"), sep="\t"),
        "guarded cells": lines(HEAD, *([f'="{c}"' for c in r] for r in ROWS)),
        "zeros behind the end": text().encode() + bytes(777),
        "wide zeros behind the end": text().encode("utf-16") + bytes(400),
        "a mark within": "\n".join([*half[:121], "\ufeff" + half[0], *half[121:]]),
        "statistics below": lines(HEAD, *ROWS, "", "Min,0,0,0", "Max,1,1,1", "Mean,.5,.5,.5"),
        "notes of two lines": lines(
            [*HEAD, "note"], *([*r, n] for r, n in zip(ROWS, note, strict=True))
        ),
        "metadata beside": (
            lines(*([("Length" if k == 0 else ""), "2.4" if k < 9 else "", *r]
                    for k, r in enumerate(ROWS))),
            {"state": ["4", "5"], "output": ["6"], "time": "3"},
        ),
        "columns by their places": (
            lines("VERSION = 1", "STOP", *(f"{s} {' '.join(c)}" for s, c in
                  zip(stamped("%Y-%m-%dT%H:%M:%S"), CELLS, strict=True))),
            {"state": ["2", "3"], "output": ["4"], "time": "1"},
        ),
        "tabs, commas and no names": (
            lines(*map(comma, ROWS), sep="\t"),
            {"state": ["2", "3"], "output": ["4"], "time": "1"},
        ),
        "numbers beside units": (
            lines(["X", *HEAD[1:], "Start", "Increment"],
                  ["Sequence", "Volt", "Volt", "Volt", "-2.4", "2.0E-02"],
                  *([str(k), *c, "", ""] for k, c in enumerate(CELLS))),
            {"dt": DT},
        ),
        "an index's name below": lines(
            ["axis", *HEAD[1:]], ["time_s", "", "", ""], *ROWS
        ),
        "four lines of words": lines(HEAD, *words, *ROWS),
        "words with numbers below": lines(
            ["Time [s]", *HEAD[1:]], ["Rate: 50 Hz", "A; 0,1% of 2", "B 2", "B 3"],
            *map(comma, ROWS), sep="\t",
        ),
        "comments in quotes": lines(
            '"#NAMES"', quoted(HEAD), '"#TYPES"', '"#ROWS","240"', *map(quoted, ROWS)
        ),
        "names in brackets": lines('("time_s" "w1" "w2" "q1")', *ROWS, sep=" "),
        "aligned names with blanks": (
            lines(*spread), {"state": ["rate a", "rate b"], "output": ["q"]},
        ),
        "ends of paths between tabs": lines(
            ["frame.time_epoch", "rig.w1", "rig.w2", "rig.q1"],
            *([f"{1714564800 + t:.9f}", *c] for t, c in zip(TIMES, CELLS, strict=True)), sep="\t",
        ),
        "drawn between": lines(*bars("+".join(["-" * 15] * 4)), f"({N} rows)"),
        "drawn around": lines(
            "+---+", *(f"| {row} |" for row in bars("x")[:1]), "+---+---+",
            *(f"| {row} |" for row in bars("x")[2:]), "+---+",
        ),
        "drawn in dashes": lines(HEAD, ["------"] * 4, *ROWS, sep="  "),
        "a line a channel": lines(*([n, *c] for n, c in zip(HEAD, zip(*ROWS, strict=True),
                                                          strict=True))),
        "a value a row": lines(
            ["time_s", "signal", "value"],
            *([r[0], HEAD[i], r[i]] for r in ROWS for i in (1, 2, 3)),
        ),
        "a value a row, changed at": lines(
            ["entity_id", "state", "last_changed"],
            *([HEAD[i], c[i - 1], f"{s}Z"] for i in (1, 2, 3) for s, c in
              zip(stamped("%Y-%m-%dT%H:%M:%S"), CELLS, strict=True)),
        ),
    }  # fmt: skip


def checksummed(row):
    sentence, found = ",".join(["RIG", *row]), 0
    for byte in sentence.encode():
        found ^= byte
    return f"${sentence}*{found:02X}"


def lines_of_their_own():
    """Lines with more than cells, and documents."""
    pairs = [" ".join(f"{n}={c}" for n, c in zip(HEAD, r, strict=True)) for r in ROWS]
    late = [" ".join(p.split()[1:]) for p in pairs]
    rows = ["<tr>" + "".join(f"<td>{c}</td>" for c in r) + "</tr>" for r in [HEAD, *ROWS]]
    return {
        "pairs": lines(*(f"{pair} level=info" for pair in pairs)),
        "pairs with colons": lines(
            *(f"t_ms:{20 * k}\t" + "\t".join(p.replace("=", ":").split()[1:])
              for k, p in enumerate(pairs))
        ),
        "pairs behind a logger's words": lines(
            *(f"{s} INFO rig.imu {p}" for s, p in
              zip(stamped("%Y-%m-%d %H:%M:%S", ","), late, strict=True)),
            f"{START} INFO rig stopped",
        ),
        "pairs behind a count": (
            lines(*(f"I ({20 * k + 312}) imu: {p}" for k, p in enumerate(late))), {"dt": DT},
        ),
        "checksums": (
            lines(*map(checksummed, ROWS), end="\r\n"),
            {"state": ["3", "4"], "output": ["5"], "time": "2"},
        ),
        "times of receiving": lines(
            *(f"{s} -> {','.join(r)}" for s, r in
              zip(["12:00:58.000", *stamped("%H:%M:%S")], [HEAD[1:], *CELLS], strict=True))
        ),
        "HTML": lines("<html><table border=1>", *rows, "</table></html>"),
        "YAML": "".join(
            f"stamp:\n  secs: {10 + 20 * k // 1000}\n  nsecs: {20 * k % 1000 * 10**6}\n"
            f"w1: {c[0]}\nw2: {c[1]}\nq1: {c[2]}\n---\n" for k, c in enumerate(CELLS)
        ),
    }  # fmt: skip


def trees():
    """JSON values that hold the table somewhere."""
    columns = {name: NUMBERS[:, k].tolist() for k, name in enumerate(HEAD)}
    objects = [dict(zip(HEAD, row, strict=True)) for row in NUMBERS.tolist()]
    times = [1714564800 + t for t in TIMES]
    series = [[[t, cells[k]] for t, cells in zip(times, CELLS, strict=True)] for k in range(3)]
    found = {
        "arrays in groups": {
            "rig": 3, "time_s": columns["time_s"],
            "data": {"imu": {n: columns[n] for n in ("w1", "w2")}, "enc": {"q1": columns["q1"]}},
        },
        "rows below names": [HEAD, *NUMBERS.tolist()],
        "rows beside names": {"results": [{"columns": HEAD, "values": NUMBERS.tolist()}]},
        "series": {"data": {"result": [
            {"metric": {"__name__": n, "job": "rig"}, "values": one}
            for n, one in zip(HEAD[1:], series, strict=True)
        ]}},
        "series, value first": [
            {"target": n, "datapoints": [[float(v), t] for t, v in one]}
            for n, one in zip(HEAD[1:], series, strict=True)
        ],
        "objects within": {"hits": {"hits": [{"_id": "a", "_source": o} for o in objects]}},
        "objects by their times": {
            f"{s}Z": {n: o[n] for n in HEAD[1:]}
            for s, o in zip(stamped("%Y-%m-%dT%H:%M:%S"), objects, strict=True)
        },
        "columns by numbers": {
            n: {str(k): v for k, v in enumerate(column)} for n, column in columns.items()
        },
    }  # fmt: skip
    return {name: json.dumps(tree) for name, tree in found.items()}


def in_memory(write):
    stream = io.BytesIO()
    write(stream)
    return stream.getvalue()


def _tar(stream):
    with tarfile.open(fileobj=stream, mode="w:gz") as packed:
        member = tarfile.TarInfo("run/log.csv")
        member.size = len(text().encode())
        packed.addfile(member, io.BytesIO(text().encode()))


def _zip(stream):
    with zipfile.ZipFile(stream, "w") as packed:
        packed.writestr("run/log.csv", text())
        packed.writestr("__MACOSX/run/._log.csv", b"\0\5")
        packed.writestr("run/.DS_Store", b"\0")


def _netcdf(stream):
    with h5py.File(stream, "w") as file:
        for k, name in enumerate(["time", *HEAD[1:]]):
            file[name] = NUMBERS[:, k]
        file["time"].attrs["units"] = "seconds since 2024-05-01 12:00:00"


def _structures(stream):
    log = np.zeros((1, N), dtype=[(name, object) for name in HEAD])
    for k, row in enumerate(NUMBERS):
        for name, value in zip(HEAD, row, strict=True):
            log[0, k][name] = np.array([[value]])
    scipy.io.savemat(stream, {"log": log})


def _trajectory(stream):
    """As OpenModelica writes results: q1 is stored with the other sign."""
    names = ["time", "w1", "w2", "q1", "mass"]
    width = max(map(len, names))
    down = ["".join(name.ljust(width)[k] for name in names) for k in range(width)]
    stored = NUMBERS.T.copy()
    stored[3] = -stored[3]
    info = np.array([[0, 2, 2, 2, 1], [1, 2, 3, -4, 2], [0] * 5, [-1] * 5], dtype=np.int32)
    matrices = {
        "Aclass": np.array(["Atrajectory", "1.1", "", "binTrans"]), "name": np.array(down),
        "dataInfo": info, "data_1": np.array([[0.0, TIMES[-1]], [1.5, 1.5]]), "data_2": stored,
    }  # fmt: skip
    scipy.io.savemat(stream, matrices, format="4")


def fourth():
    """By name: the file's bytes, options of `read`, and whether outputs are lacking."""
    binary = {
        "tar": _tar, "zip of a Mac": _zip, "times since": _netcdf,
        "array of structures": _structures, "trajectory": _trajectory,
    }  # fmt: skip
    every = times_in_parts() | cells_and_lines() | lines_of_their_own() | trees()
    every |= {name: in_memory(write) for name, write in binary.items()}
    pairs = {k: v if isinstance(v, tuple) else (v, {}) for k, v in every.items()}
    return {
        name: (data if isinstance(data, bytes) else data.encode(), options)
        for name, (data, options) in pairs.items()
    }
