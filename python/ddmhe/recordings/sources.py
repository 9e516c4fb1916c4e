"""From what a user has, a path, standard input or a frame, to a table: which format, told by its
first bytes, unpacked where it is packed. Libraries of formats are loaded where they are used."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import lzma
import os
import re
import sys
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from ddmhe.checks import file_words, reason, shown
from ddmhe.recordings.documents import are_documents, yaml_table
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.libraries import library
from ddmhe.recordings.options import Reading
from ddmhe.recordings.table import Table
from ddmhe.recordings.text_table import text_table

__all__ = ["INPUT", "InMemory", "name_of", "piece_in", "table_of"]

INPUT = "-"
"""The path that means standard input."""
_PIECE = re.compile(r"(.+)#(\d+)\Z", re.DOTALL)
_HIDDEN = re.compile(r"/\Z|\A__MACOSX/|(\A|/)\.[^/]*\Z")
"""What a packed folder holds beside files."""
_HEAD = 1024
MAGIC = (
    (b"\x1f\x8b", "gzip"),
    (b"\x28\xb5\x2f\xfd", "zstd"),
    (b"BZh", "bzip2"),
    (b"\xfd7zXZ\0", "xz"),
    (b"PK\x03\x04", "zip"),
    (b"PAR1", "parquet"),
    (b"ARROW1", "feather"),
    (b"FEA1", "feather"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 7.3", "hdf5"),
    (b"MATLAB 5.0", "mat"),
    (b"\x93NUMPY", "npy"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"SQLite format 3\0", "bag"),
    (b"#ROSBAG V", "bag"),
)
_DATAFLASH = "a DataFlash log of ArduPilot; `mavlogdump.py --format csv --types …` makes tables"
UNREAD = (
    (b"ULog\x01", "a ULog of PX4; `ulog2csv` or `mcap convert` makes tables of it"),
    (b"TDSm", "a TDMS file; nptdms writes it as CSV or HDF5"),
    (b"MDF     ", "an MDF file; asammdf writes it as CSV, Parquet or MAT"),
    (b"\xd0\xcf\x11\xe0", "an old spreadsheet; save it as CSV"),
    (b"FMT, ", _DATAFLASH),
    (b"\xa3\x95\x80", _DATAFLASH),
    (b"%PDF", "a PDF; export its table as CSV"),
    (b"\x89PNG", "a picture"),
    (b"\xff\xd8\xff", "a picture"),
    (b"\x80\x04\x95", "a pickle, which could run anything; save the arrays as .npz"),
    (b"\x80\x05\x95", "a pickle, which could run anything; save the arrays as .npz"),
)
"""Known formats that are not read, and what to do."""


@dataclass(frozen=True)
class InMemory:
    """A file's bytes that were read already."""

    path: str
    data: bytes


def name_of(src: Any) -> str:
    """What messages call a source."""
    if isinstance(src, str | os.PathLike):
        return "standard input" if str(src) == INPUT else file_words(src)
    return f"the {type(src).__name__}"


def piece_in(src: Any) -> tuple[Any, int | None]:
    """A path without the number of its piece, `log.csv#2`, and that number."""
    if not isinstance(src, str | os.PathLike) or os.path.exists(src):
        return src, None
    found = _PIECE.match(str(src))
    return (found[1], int(found[2])) if found else (src, None)


def table_of(src: Any, asked: Sequence[str], how: Reading) -> Table:
    """The table of a source, in which the columns `asked` are looked for."""
    if isinstance(src, InMemory):
        return _by_format(src.path, None, src.data, asked, how)
    if not isinstance(src, str | os.PathLike):
        from ddmhe.recordings.arrays import frame_table

        return frame_table(name_of(src), src, asked)
    if "\0" in str(src):
        raise LogError(f"path: expected the path of a file, found {shown(src)}")
    path = name_of(src)
    if str(src) == INPUT:
        data = sys.stdin.buffer.read()
        table = _by_format(path, None, data, asked, how)
        return replace(table, digest=hashlib.sha256(data).hexdigest())
    place = Path(src)
    if os.path.isdir(place):
        return _folder(path, place, asked, how)
    try:
        with open(place, "rb") as file:
            head = file.read(_HEAD)
            known = _kind(head, place)
            data = head if known in _FILES else head + file.read()
            digest = hashlib.sha256(data)
            while part := file.read(2**20):
                digest.update(part)
    except FileNotFoundError:
        raise LogError(f"{path}: expected a log file, found no such file") from None
    except OSError as e:
        raise LogError(
            f"{path}: expected a readable log file, found that it is not "
            f"({e.strerror or reason(e)})"
        ) from e
    table = _by_format(path, place, data, asked, how)
    return replace(table, digest=digest.hexdigest())


def _folder(path: str, place: Path, asked: Sequence[str], how: Reading) -> Table:
    """The table of a ROS 2 bag: a folder with one MCAP file, or with databases."""
    inside = sorted(place.glob("*.mcap"))
    if len(inside) == 1:
        return table_of(inside[0], asked, how)
    if inside:
        raise LogError(
            f"{path}: expected a log file or a bag of one MCAP file, found {len(inside)} of them; "
            "give one of them, and others as --recording"
        )
    databases = sorted(place.glob("*.db3"))
    if len(databases) == 1:
        return table_of(databases[0], asked, how)
    if databases:
        from ddmhe.recordings.bag_log import bag_table

        return bag_table(path, place, asked)
    raise LogError(f"{path}: expected a readable log file, found that it is not (Is a directory)")


def _kind(head: bytes, place: Path | None = None) -> str:
    kind = next((name for magic, name in MAGIC if head.startswith(magic)), "text")
    if kind == "text" and b"\0" in head and place is not None and place.suffix.lower() == ".mat":
        return "mat"  # version 4 begins with no mark
    return "hdf5" if kind == "text" and head[512:520] == MAGIC[8][0] else kind


def _by_format(
    path: str, place: Path | None, data: bytes, asked: Sequence[str], how: Reading
) -> Table:
    """The table of a file, at a place or of these bytes."""
    kind = _kind(data[:_HEAD], place)
    if kind in _UNPACK:
        try:
            inside = _UNPACK[kind](path, data)
        except LogError:
            raise
        except Exception as e:  # each library has errors of its own
            raise LogError(
                f"{path}: expected a whole {kind} file, found one that cannot be unpacked "
                f"({reason(e)})"
            ) from e
        return _by_format(path, None, inside, asked, how)
    if kind == "zip":
        data, kind = _zip(path, data)
        if kind != "npz":
            return _by_format(path, None, data, asked, how)
    if kind in _FILES:
        module, function = _FILES[kind]
        read = getattr(import_module(f"ddmhe.recordings.{module}"), function)
        source = place if place is not None and kind != "npz" else io.BytesIO(data)
        table: Table = read(path, source, asked)
        return table
    for magic, words in UNREAD:
        if data.startswith(magic):
            raise LogError(f"{path}: expected a log file, found {words}")
    if data[257:262] == b"ustar":
        return _by_format(path, None, _tar(path, data), asked, how)
    if are_documents(data):
        return yaml_table(path, data, how.encoding)
    if data.lstrip()[:1] in (b"{", b"["):
        from ddmhe.recordings.json_lines import json_table

        return json_table(path, data, asked, how.encoding)
    return text_table(
        path, data, asked, sep=how.sep, decimal=how.decimal, comment=how.comment,
        encoding=how.encoding,
    )  # fmt: skip


_FILES = {
    "parquet": ("columnar", "parquet_table"),
    "feather": ("columnar", "feather_table"),
    "hdf5": ("hdf5", "hdf5_table"),
    "mat": ("arrays", "mat_table"),
    "npz": ("arrays", "npz_table"),
    "npy": ("arrays", "npy_table"),
    "mcap": ("mcap_log", "mcap_table"),
    "bag": ("bag_log", "bag_table"),
}
"""Module and function that read a format."""


def _zip(path: str, data: bytes) -> tuple[bytes, str]:
    """What a zip file holds: arrays of NumPy, or its one file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            names = [name for name in packed.namelist() if not _HIDDEN.search(name)]
            if names and all(name.endswith(".npy") for name in names):
                return data, "npz"
            if any(name.startswith(("xl/", "content.xml")) for name in names):
                raise LogError(f"{path}: expected a log file, found a spreadsheet; save it as CSV")
            if len(names) == 1:
                return packed.read(names[0]), "file"
    except LogError:
        raise
    except Exception as e:  # a damaged file makes it stumble over anything
        raise LogError(
            f"{path}: expected a whole zip file, found one that cannot be unpacked ({reason(e)})"
        ) from e
    raise LogError(f"{path}: expected a zip of one log file, found {len(names)} files")


def _tar(path: str, data: bytes) -> bytes:
    """The one file that a tar holds."""
    try:
        with tarfile.open(fileobj=io.BytesIO(data)) as packed:
            every = [member for member in packed.getmembers() if member.isfile()]
            members = [member for member in every if not _HIDDEN.search(member.name)]
            file = packed.extractfile(members[0]) if len(members) == 1 else None
            if file is not None:
                return file.read()
    except tarfile.TarError as e:
        raise LogError(
            f"{path}: expected a whole tar file, found one that cannot be unpacked ({reason(e)})"
        ) from e
    raise LogError(f"{path}: expected a tar of one log file, found {len(members)} files")


def _gzip(path: str, data: bytes) -> bytes:
    return gzip.decompress(data)


def _bzip2(path: str, data: bytes) -> bytes:
    return bz2.decompress(data)


def _xz(path: str, data: bytes) -> bytes:
    return lzma.decompress(data)


def _zstd(path: str, data: bytes) -> bytes:
    zstandard = library("zstandard", path, "packed with zstd")
    parts = []
    try:
        while data:
            frame = zstandard.ZstdDecompressor().decompressobj()
            parts.append(frame.decompress(data))
            if not frame.eof:
                raise ValueError("it ends early")
            data = frame.unused_data
    except zstandard.ZstdError as e:
        raise ValueError(str(e)) from e
    return b"".join(parts)


_UNPACK: dict[str, Callable[[str, bytes], bytes]] = {
    "gzip": _gzip,
    "bzip2": _bzip2,
    "xz": _xz,
    "zstd": _zstd,
}
