"""One log in many habits of writing: a pendulum of two states and an output, 240 rows of 20 ms."""

import bz2
import gzip
import io
import lzma
import zipfile
from datetime import datetime, timedelta

import numpy as np
import scipy.io

N, DT, HISTORY = 240, 0.02, 3.0
HEAD = ["time_s", "w1", "w2", "q1"]
EPOCH = 1_700_000_020_223_456_854
START = datetime(2024, 5, 1, 12)


def numbers():
    """Rows (N, 4): time, both states, the output."""
    rng = np.random.default_rng(11)
    A = np.array([[0.996, 0.05], [-0.06, 0.992]])
    x = np.zeros((N, 2))
    x[0] = [0.8, 0.2]
    for k in range(N - 1):
        x[k + 1] = A @ x[k] + 0.01 * rng.standard_normal(2)
    q = x @ [1.0, 0.3] + 0.004 * rng.standard_normal(N)
    return np.column_stack([np.round(DT * np.arange(N), 6), x, q])


ROWS = [[f"{v:.9g}" for v in row] for row in numbers()]


def text(head=HEAD, rows=ROWS, sep=",", above=(), below=(), end="\n"):
    return end.join([*above, sep.join(head), *below, *(sep.join(row) for row in rows), ""])


def clock(values, name, rows=ROWS):
    """The same rows with other words for the time."""
    return text([name, *HEAD[1:]], [[v, *row[1:]] for v, row in zip(values, rows, strict=True)])


def spaced(row):
    return " ".join(f"{cell:>14}" for cell in row)


def comma(rows=ROWS):
    return [[cell.replace(".", ",") for cell in row] for row in rows]


def zipped(data):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        packed.writestr("log.csv", data)
    return stream.getvalue()


def holes(word, rows=(170, 171, 181)):
    return [[*row[:3], word if k in rows else row[3]] for k, row in enumerate(ROWS)]


def of_day(seconds):
    """A time of the day, which begins anew at midnight."""
    seconds = round(seconds * 1e3)
    hours, rest = divmod(seconds // 1000 % 86400, 3600)
    return f"{hours:02d}:{rest // 60:02d}:{rest % 60:02d}.{seconds % 1000:03d}"


def iso(k):
    return f"2024-05-01T12:00:{DT * k:09.6f}+02:00"


def structure():
    """A MAT file with one structure, as MATLAB saves what a simulation logged."""
    values = np.array(ROWS, dtype=np.float64)
    stream = io.BytesIO()
    log = {"t": values[:, :1], "x": values[:, 1:3], "y": values[:, 3:]}
    scipy.io.savemat(stream, {"log": log})
    return stream.getvalue(), {"state": ["x[0]", "x[1]"], "output": ["y"]}


def habits():
    """By name: the file's bytes and the options of `read` that the habit needs."""
    plain, at = text(), [float(row[0]) for row in ROWS]
    names = {"state": ["w, first", "w2"]}
    missing = {"missing": [-9999]}
    found = {
        # the habits that were seen
        "plain": plain,
        "semicolon": text(sep=";"),
        "tab": text(sep="\t"),
        "decimal-comma": text(rows=comma(), sep=";"),
        "comments": text(above=["# recorded on the rig", "# run 3"]),
        "units-row": text(below=["s,rad/s,rad/s,rad"]),
        "byte-order-mark": plain.encode("utf-8-sig"),
        "latin-1": text([*HEAD, "temp_°C"], [[*r, "20"] for r in ROWS]).encode("latin-1"),
        "iso": clock([iso(k) for k in range(N)], "time_s"),
        "milliseconds": clock([f"{1000 * t:.9g}" for t in at], "time_ms"),
        "epoch-ns": clock([str(EPOCH + 20_000_000 * k) for k in range(N)], "timestamp"),
        "index-first": text(["", *HEAD], [[str(k), *r] for k, r in enumerate(ROWS)]),
        "counter-first": text(["i", *HEAD], [[str(k), *r] for k, r in enumerate(ROWS)]),
        "quoted-header": (text(["time_s", '"w, first"', "w2", "q1"]), names),
        "comma-in-a-name": (
            text(["time_s", '"w, first"', "w2", "q1"]),
            {"state": ["w", "first", "w2"]},
        ),
        "no-time": (text(HEAD[1:], [row[1:] for row in ROWS]), {"dt": DT}),
        "duplicate": (text(rows=[*ROWS[:99], ROWS[98], *ROWS[99:]]), {"duplicates": "first"}),
        "swapped": (text(rows=[*ROWS[:99], ROWS[100], ROWS[99], *ROWS[101:]]), {"sort": True}),
        "missing-words": text(rows=holes("NA")),
        "sentinel": (text(rows=holes("-9999")), missing),
        "crlf": text(end="\r\n"),
        "gzip": gzip.compress(plain.encode(), mtime=0),
        # others
        "pipe": text(sep="|"),
        "aligned": "\n".join([spaced(HEAD), *map(spaced, ROWS), ""]),
        "tab-decimal-comma": text(rows=comma(), sep="\t"),
        "utf-16": plain.encode("utf-16"),
        "utf-16-unmarked": plain.encode("utf-16-be"),
        "lines-above": text(above=["Rig 3", "operator;;", "a,b", ""]),
        "header-in-a-comment": text(["# time_s", *HEAD[1:]], above=["# np.savetxt"]),
        "percent": text(["% time_s", *HEAD[1:]]),
        "all-quoted": text(rows=[[f'"{cell}"' for cell in row] for row in ROWS]),
        "quoted-decimal-comma": text(rows=[[f'"{c}"' for c in row] for row in comma()]),
        "trailing-separator": text(rows=[[*row, ""] for row in ROWS]),
        "words-below": plain + "\nEnd of recording\noperator: me, 12 h\n"[:18],
        "header-again": text(rows=[*ROWS[:120], HEAD, *ROWS[120:]]),
        "spreadsheet": "sep=;\r\n" + text(rows=comma(), sep=";", end="\r\n"),
        "unicode-text": text(rows=comma(), sep="\t", end="\r\n").encode("utf-16"),
        "blanks-around": text(sep=" , "),
        "keys-above": text(above=["Date: 2024-05-01, 12:00", "Rig: 3", "Rate, Hz: 50"]),
        "micro-sign": clock([str(20_000 * k) for k in range(N)], "t [µs]").encode("latin-1"),
        "epoch-us": clock([str(EPOCH // 1000 + 20_000 * k) for k in range(N)], "time"),
        "hours-and-minutes": clock([of_day(60 + t)[1:] for t in at], "elapsed"),
        "two-of-a-name": text([*HEAD, "temp", "temp"], [[*r, "20", "21"] for r in ROWS]),
        "states-alone-first": text(["w1", "w2", "q1", "time_s"], [[*r[1:], r[0]] for r in ROWS]),
        "minutes": clock([f"{t / 60:.12g}" for t in at], "time (min)"),
        "mixed-line-ends": plain.replace("\n", "\r\n", 100),
        "a-list-of-names-above": text(above=["units,w2,w1,q1", "x,w2,w1,q1"]),
        "a-time-that-stands": (
            text(["exposure_time_ms", *HEAD[1:]], [["8", *r[1:]] for r in ROWS]),
            {"dt": DT},
        ),
        "newest-first": (text(rows=ROWS[::-1]), {"sort": True}),
        "epoch-seconds-with-commas": text(
            ["stamp", *HEAD[1:]],
            [
                [f"{1_700_000_020 + t:.3f}".replace(".", ","), *r[1:]]
                for t, r in zip(at, comma(), strict=True)
            ],
            sep=";",
        ),
        "carriage-returns": text(end="\r"),
        "no-last-line-end": plain.rstrip(),
        "cut-in-the-last-row": plain + "4.8,0.1",
        "blank-lines": text(end="\n\n"),
        "units-in-brackets": text(["time [s]", *HEAD[1:]]),
        "types-and-units": text(below=["float,float,float,float", "s,rad/s,rad/s,rad"]),
        "long-names": text(below=["Time,Rate one,Rate two,Angle", "[s],[rad/s],[rad/s],[rad]"]),
        "over-midnight": clock([of_day(86398 + t) for t in at], "clock"),
        "german-dates": clock([f"01.05.2024 {of_day(3600 + t)}" for t in at], "Zeit"),
        "american-dates": clock([f"5/1/2024 {of_day(3600 + t)}" for t in at], "DateTime"),
        "two-columns-of-time": text(
            ["Date", "Time", *HEAD[1:]],
            [["2024-05-01", of_day(3600 + t), *r[1:]] for t, r in zip(at, ROWS, strict=True)],
        ),
        "epoch-seconds": clock([f"{1_700_000_020 + t:.3f}" for t in at], "stamp"),
        "epoch-ms": clock([str(1_700_000_020_223 + 20 * k) for k in range(N)], "t"),
        "microseconds": clock([str(5_000_000 + 20_000 * k) for k in range(N)], "TimeUS"),
        "stated-unit": (clock([str(20 * k) for k in range(N)], "time"), {"time_unit": "ms"}),
        "named-clock": (clock([f"{t:.9g}" for t in at], "x"), {"time": "x"}),
        "sec-and-nanosec": text(
            ["header.stamp.sec", "header.stamp.nanosec", *HEAD[1:]],
            [
                [str(17 + 20 * k // 1000), str(20 * k % 1000 * 10**6), *row[1:]]
                for k, row in enumerate(ROWS)
            ],
        ),
        "serial-days": clock([f"{45000.25 + t / 86400:.12f}" for t in at], "Timestamp"),
        "stated-comment": (
            text(rows=[[*row[:3], f"{row[3]} ! checked"] for row in ROWS]),
            {"comment": "!"},
        ),
        "grouped-thousands": (
            clock([f"{1e3 * (t + 1):,.1f}".join('""') for t in at], "time_ms"),
            {"decimal": "."},
        ),
        "no-header": (
            "\n".join(",".join(row) for row in ROWS),
            {"state": ["2", "3"], "output": ["4"], "time": "1"},
        ),
        "fortran-exponents": text(
            rows=[
                [row[0], *(f"{float(c):.15E}".replace("E", "D") for c in row[1:])] for row in ROWS
            ]
        ),
        "words-for-nothing": text(rows=holes("#N/A")),
        "dashes": text(rows=holes("--")),
        "bzip2": bz2.compress(plain.encode()),
        "xz": lzma.compress(plain.encode()),
        "zip": zipped(plain),
        "json-lines": "\n".join(
            "{" + ", ".join(f'"{n}": {v}' for n, v in zip(HEAD, row, strict=True)) + "}"
            for row in ROWS
        ),
    }
    moments = [START + timedelta(milliseconds=20 * k) for k in range(N)]
    bars = [f"| {' | '.join(row)} |" for row in [HEAD, ["---"] * len(HEAD), *ROWS]]
    arff = ["@RELATION run", "", *(f"@ATTRIBUTE {n} NUMERIC" for n in HEAD), "", "@DATA"]
    broken = [f'"{name}\n[{u}]"' for name, u in zip(HEAD, ["s", "1", "1", "1"], strict=True)]
    found |= {
        "durations": clock([f"{t:.9g} sec" for t in at], "Time"),
        "names-of-months": clock([f"{m:%d-%b-%Y %H:%M:%S.%f}"[:-3] for m in moments], "Time"),
        "month-first": clock([f'"{m:%b %d, %Y %H:%M:%S.%f}"' for m in moments], "Time"),
        "table-of-markdown": "\n".join([*bars, ""]),
        "arff": "\n".join([*arff, *map(",".join, ROWS), ""]),
        "names-with-line-ends": (
            text(broken),
            {"state": ["w1 [1]", "w2 [1]"], "output": ["q1 [1]"]},
        ),
        "structure-of-matrices": structure(),
    }
    pairs = {k: v if isinstance(v, tuple) else (v, {}) for k, v in found.items()}
    return {
        name: (data if isinstance(data, bytes) else data.encode(), options)
        for name, (data, options) in pairs.items()
    }
