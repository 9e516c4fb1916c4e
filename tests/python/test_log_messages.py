"""Malformed logs: one sentence each, that leads to the cure, as docs/logs.md has it."""

import gzip
import io
import re
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
import zstandard
from mcap.writer import Writer
from pyarrow import parquet
from scipy.io import savemat

import ddmhe
from commands import in_a_process
from ddmhe.recordings import read
from odd_logs import DT, HEAD, HISTORY, ROWS, N, clock, comma, numbers, text

DOCS = Path(__file__).parents[2] / "docs" / "logs.md"
COMMON = {"state": ["w1", "w2"], "output": ["q1"], "history": HISTORY}
COLUMNS = dict(zip(HEAD, numbers().T, strict=True))
COUNTED = [str(k) for k in range(N)]


def with_cell(word, row=5, column=1):
    rows = [list(r) for r in ROWS]
    rows[row][column] = word
    return text(rows=rows)


def zipped(names):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        for name in names:
            packed.writestr(name, "x")
    return stream.getvalue()


def saved(write):
    stream = io.BytesIO()
    write(stream)
    return stream.getvalue()


def hdf5(stream):
    with h5py.File(stream, "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values


def mcap(messages):
    def write(stream):
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("log", "jsonschema", b"{}")
        channel = writer.register_channel("/log", "json", schema)
        for k in range(messages):
            writer.add_message(channel, k, b'{"w1": 1}', k)
        writer.finish()

    return saved(write)


def malformed():
    """By name of the file: its content and options of `read`."""
    packed = gzip.compress(text().encode(), mtime=0)
    uneven = [f"{DT * k + 0.4 * DT * (k % 3):.4f}" for k in range(N)]
    dates = [f"2024-05-01T12:00:{DT * k:05.2f}" for k in range(N)]
    lines = [f'{{"time_s": {DT * k:.2f}, "w1": 1, "w2": 2, "q1": 3}}' for k in range(N)]
    found = {
        "empty.csv": "",
        "header-only.csv": ",".join(HEAD) + "\n",
        "noise.csv": bytes(range(128, 160)) * 9 + b"\0\1\2",
        "odd-utf-16.csv": text().encode("utf-16") + b"x",
        "picture.png": b"\x89PNG\r\n\x1a\n",
        "report.pdf": b"%PDF-1.7",
        "book.xlsx": zipped(["xl/workbook.xml", "x"]),
        "old.xls": b"\xd0\xcf\x11\xe0\xa1\xb1",
        "flight.ulg": b"ULog\x01\x12\x35",
        "bag.db3": b"SQLite format 3\0",
        "first.bag": b"#ROSBAG V2.0\n",
        "bench.tdms": b"TDSm" + bytes(9),
        "car.mf4": b"MDF     4.10",
        "arrays.pkl": b"\x80\x04\x95" + bytes(9),
        "cut.csv.gz": packed[: len(packed) // 2],
        "cut.csv.zst": zstandard.compress(text().encode())[:200],
        "cut.zip": zipped(["log.csv"])[:40],
        "many.zip": zipped(["a.csv", "b.csv"]),
        "wide-row.csv": text(rows=[*ROWS[:5], [*ROWS[5], "7"], *ROWS[6:]]),
        "commas-for-all.csv": text(rows=comma()),
        "open-quote.csv": with_cell('"1.5'),
        "word.csv": with_cell("overload"),
        "infinite.csv": with_cell("inf"),
        "number-with-unit.csv": with_cell("1.5 rad/s"),
        "one-decimal-comma.tsv": with_cell("0,5").replace(",", "\t").replace("0\t5", "0,5"),
        "groups.csv": text(rows=[[r[0], f"{k % 9 + 1},234", *r[2:]] for k, r in
                                 enumerate(ROWS)], sep=";"),
        "typing-error.csv": text(["time_s", "w_1", "w2", "q1"]),
        "capitals.csv": text(["time_s", "W1", "w2", "q1"]),
        "same-name-twice.csv": text(["time_s", "w1", "w1", "q1"]),
        "counter.csv": clock(COUNTED, "i"),
        "no-unit.csv": clock([str(20 * k) for k in range(N)], "time"),
        "unknown-unit.csv": text(below=["ticks,rad/s,rad/s,rad"]),
        "contradiction.csv": clock([str(1_700_000_020_223 + 20 * k) for k in range(N)], "time_s"),
        "no-time.csv": text(HEAD[1:], [r[1:] for r in ROWS]),
        "two-clocks.csv": text(["time", "clock", *HEAD[1:]], [[r[0], *r] for r in ROWS]),
        "no-stamp.csv": with_cell("", column=0),
        "broken-date.csv": clock([*dates[:5], "2024-13-01T12:00", *dates[6:]], "time"),
        "day-or-month.csv": clock([f"{1 + k // 200}/5/2024 12:00:{DT * k:05.2f}" for k in
                                   range(N)], "time"),
        "repeated.csv": text(rows=[*ROWS[:99], ROWS[98], *ROWS[99:]]),
        "swapped.csv": text(rows=[*ROWS[:99], ROWS[100], ROWS[99], *ROWS[101:]]),
        "two-in-one.csv": text(rows=ROWS + ROWS),
        "uneven.csv": clock(uneven, "time_s"),
        "three-rows.csv": (text(rows=ROWS[:2]), {}),
        "long-gap.csv": text(rows=ROWS[:40] + ROWS[60:]),
        "blank-stretch.csv": text(rows=[[r[0], "" if 40 <= k < 60 else r[1], *r[2:]] for k, r in
                                        enumerate(ROWS)]),
        "too-short.csv": text(rows=ROWS[:100]),
        "cut.parquet": saved(lambda s: parquet.write_table(pa.table(COLUMNS), s))[:-40],
        "cut.h5": saved(hdf5)[:2000],
        "cut.mat": saved(lambda s: savemat(s, COLUMNS))[:2000],
        "lengths.npz": saved(lambda s: np.savez(s, **COLUMNS | {"w2": np.zeros(9)})),
        "objects.npz": saved(lambda s: np.savez(s, w1=np.array([{}], object))),
        "bare.npy": saved(lambda s: np.save(s, numbers())),
        "cut.mcap": mcap(9)[:-60],
        "silent.mcap": mcap(0),
        "broken.jsonl": "\n".join([*lines[:4], lines[4][:-9], *lines[5:]]),
        "numbers.json": "[1, 2, 3]",
    }  # fmt: skip
    return {
        name: (data if isinstance(data, bytes) else data.encode(), options)
        for name, (data, options) in (
            (name, case if isinstance(case, tuple) else (case, {})) for name, case in found.items()
        )
    }


MALFORMED = malformed()


def said(folder, name):
    """The sentence, with the name of the file for its path."""
    data, options = MALFORMED[name]
    (folder / name).write_bytes(data)
    with pytest.raises(ddmhe.DdmheError) as e:
        read(folder / name, **COMMON | options)
    words = str(e.value)
    assert "\n" not in words
    words = words.replace(f"{folder}/", "")
    # what a library of a format adds differs from one of its versions to the next
    library = re.search("expected (a whole|arrays of)|JSON object, found none", words)
    return re.sub(r" \(.*\)$", " (…)", words) if library else words


def documented():
    page = DOCS.read_text(encoding="utf-8").partition("## Messages")[2]
    rows = re.findall(r"^\| `([^`]+)` \| (.*) \|$", page, re.M)
    return {name: words.replace("\\|", "|") for name, words in rows}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_one_sentence_that_the_docs_have(tmp_path, name):
    assert said(tmp_path, name) == documented()[name]


def test_the_docs_have_no_others():
    assert set(MALFORMED) == set(documented())
    assert len(MALFORMED) >= 40


def test_a_folder_is_a_bag_of_one_file(tmp_path):
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(mcap(3))
    with pytest.raises(ddmhe.DdmheError, match="bag of one MCAP file, found 2 of them"):
        read(tmp_path, **COMMON)


def test_the_command_line_says_the_sentence_and_writes_nothing(tmp_path):
    (tmp_path / "log.csv").write_bytes(MALFORMED["two-clocks.csv"][0])
    columns = ["--state", "w1,w2", "--output", "q1", "--history", 3, "--out", "est.csv"]
    result = in_a_process("estimate", "log.csv", *columns, cwd=tmp_path)
    words = documented()["two-clocks.csv"].replace("two-clocks", "log")
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == f"ddmhe: error: {words}\n"
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]
