"""Recordings as .npz files that any program with NumPy reads: arrays x, y and u, one recording
behind the other, the output samples of each, dt and the units of the channels."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ddmhe._core import DdmheError, History
from ddmhe.checks import check_path, file_words, reason
from ddmhe.files import write

__all__ = ["load", "save"]

UNITS = ("x_units", "y_units", "u_units")


def save(history: History, path: str | Path) -> None:
    """Write a History; the ending has to be .npz, which NumPy would add."""
    check_path("path", path)
    if Path(path).suffix != ".npz":
        raise DdmheError(f"path: expected a file ending in .npz, found '{file_words(path)}'")
    parts = history.recordings
    arrays: dict[str, Any] = {
        "x": np.concatenate([x for x, _ in parts]),
        "y": np.concatenate([y for _, y in parts]),
        "samples": np.array([len(y) for _, y in parts]),
        "dt": np.array(history.dt),
        **{name: np.array(getattr(history, name), dtype=np.str_) for name in UNITS},
    }
    if history.m:
        arrays["u"] = np.concatenate(history.inputs)
    write(path, lambda beside: np.savez(beside, allow_pickle=False, **arrays))


def load(path: str | Path) -> History:
    """The History of a file; without "samples" it is one recording."""
    check_path("path", path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        samples = arrays.get("samples", np.array([len(arrays["y"])])).tolist()
        units = {name: arrays[name].tolist() for name in UNITS if name in arrays}
        ends = np.cumsum(samples).tolist()
        parts = []
        for k, (T, end) in enumerate(zip(samples, ends, strict=True)):
            outputs, states = slice(end - T, end), slice(end - T + k, end + k + 1)
            u = arrays["u"][outputs] if "u" in arrays else None
            own = units if u is not None else {k: v for k, v in units.items() if k != "u_units"}
            dt = float(arrays.get("dt", 1.0))
            parts.append(History(arrays["x"][states], arrays["y"][outputs], dt, u, **own))
        return parts[0] if len(parts) == 1 else History.concat(parts)
    except (OSError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError) as e:
        found = e.strerror if isinstance(e, OSError) and e.strerror else reason(e)
        raise DdmheError(
            f"{file_words(path)}: expected a recording as History.save writes it, found another "
            f"file ({found})"
        ) from e
    except ValueError as e:
        if isinstance(e, DdmheError):
            raise type(e)(f"{file_words(path)}: {e}") from e
        raise DdmheError(
            f"{file_words(path)}: expected a recording as History.save writes it, found another "
            f"file ({reason(e)})"
        ) from e
