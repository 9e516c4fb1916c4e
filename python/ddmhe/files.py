"""Files are whole or not there: written beside their place, forced onto the disk, and only then
renamed."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from ddmhe._core import DdmheError
from ddmhe.checks import check_path, file_words

__all__ = ["FileError", "check_writable", "write", "write_text"]


class FileError(DdmheError):
    """A file cannot be written."""


def write(path: str | Path, save: Callable[[Path], object]) -> None:
    """Write a file by `save(beside)`, which gets a path of the same ending in the same directory.

    A file of that name stays as it is until the new one is complete. What is no ordinary file (a
    device, a pipe) is written to directly. FileError names the path and the reason."""
    check_path("path", path)
    place = Path(os.path.realpath(path))
    try:
        if place.exists() and not place.is_file():
            save(Path(path))
        else:
            _beside(place, save)
    except OSError as e:
        reason = e.strerror or str(e)
        raise FileError(
            f"{file_words(path)}: expected to be able to write this file, found: {reason}"
        ) from e


def _beside(place: Path, save: Callable[[Path], object]) -> None:
    """Saved beside its place, then renamed."""
    beside = place.with_name(f".{place.stem}.{os.getpid()}{place.suffix}")
    try:
        save(beside)
        _force(beside)
        beside.replace(place)
    finally:
        beside.unlink(missing_ok=True)


def check_writable(path: str | Path) -> None:
    """FileError if a file cannot be written there, as far as that shows beforehand."""
    check_path("path", path)
    above = Path(os.path.realpath(path)).parent
    while not above.exists() and above != above.parent:
        above = above.parent
    if Path(path).is_dir():
        reason = "Is a directory"
    elif not above.is_dir():
        reason = "Not a directory"
    elif not os.access(path if Path(path).exists() else above, os.W_OK):
        reason = "Permission denied"
    else:
        return
    raise FileError(f"{path}: expected to be able to write this file, found: {reason}")


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8; as `write`."""
    write(path, lambda beside: beside.write_text(text, encoding="utf-8"))


def _force(path: Path) -> None:
    """Onto the disk: some disks say only then that they are full."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())
