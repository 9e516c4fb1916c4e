"""A saved state: arrays, bytes and a few words in one NumPy archive, with a checksum."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from typing import Any

import numpy as np

from ddmhe._core import DdmheError

__all__ = ["packed", "unpacked"]

MAGIC = b"ddmhe lifted 1\n"


def packed(state: dict[str, Any]) -> bytes:
    """Values by name, in mappings of mappings: arrays, bytes, and what JSON can hold."""
    arrays: dict[str, Any] = {}
    words = _without_arrays(state, "", arrays)
    arrays["words"] = _as_array(json.dumps(words).encode())
    room = io.BytesIO()
    np.savez(room, **arrays)
    body = room.getvalue()
    return MAGIC + zlib.crc32(body).to_bytes(4, "little") + body


def unpacked(blob: bytes) -> dict[str, Any]:
    """What was packed; DdmheError for other bytes."""
    head = len(MAGIC) + 4
    if not isinstance(blob, bytes) or not blob.startswith(MAGIC):
        raise DdmheError("blob: expected a snapshot of a LiftedMhe, found other bytes")
    body = blob[head:]
    if zlib.crc32(body) != int.from_bytes(blob[len(MAGIC) : head], "little"):
        raise DdmheError("blob: expected a snapshot as it was saved, found one that was changed")
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        words = json.loads(arrays.pop("words").tobytes())
    except (ValueError, KeyError, OSError, zipfile.BadZipFile) as e:
        raise DdmheError("blob: expected a snapshot of a LiftedMhe, found damaged bytes") from e
    return dict(_with_arrays(words, arrays))


def _as_array(data: bytes) -> Any:
    return np.frombuffer(data, np.uint8)


def _without_arrays(value: Any, place: str, arrays: dict[str, Any]) -> Any:
    """The value with a name in the place of each array and of bytes."""
    if isinstance(value, dict):
        return {name: _without_arrays(v, f"{place}.{name}", arrays) for name, v in value.items()}
    if isinstance(value, tuple):
        parts = [_without_arrays(v, f"{place}.{k}", arrays) for k, v in enumerate(value)]
        return {"tuple": parts}
    if isinstance(value, bytes):
        arrays[place] = _as_array(value)
        return {"bytes": place}
    if isinstance(value, np.ndarray):
        arrays[place] = value
        return {"array": place}
    return value


def _with_arrays(value: Any, arrays: dict[str, Any]) -> Any:
    if not isinstance(value, dict):
        return value
    if set(value) == {"tuple"}:
        return tuple(_with_arrays(v, arrays) for v in value["tuple"])
    if set(value) == {"bytes"}:
        return arrays[value["bytes"]].tobytes()
    if set(value) == {"array"}:
        return arrays[value["array"]]
    return {name: _with_arrays(v, arrays) for name, v in value.items()}
