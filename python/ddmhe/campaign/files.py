"""Logs of a campaign: by a pattern, here or wherever fsspec reaches."""

from __future__ import annotations

import glob
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from ddmhe.campaign.errors import CampaignError, library
from ddmhe.checks import reason, shown

__all__ = ["listed_files", "local"]


def listed_files(name: str, pattern: str) -> list[str]:
    """The files of a pattern, in order; local ones with their whole paths."""
    if "://" not in pattern:
        found = sorted(os.path.abspath(path) for path in glob.glob(pattern, recursive=True))
    else:
        try:
            files = library("fsspec").open_files(pattern, "rb")
        except CampaignError:
            raise
        except Exception as e:  # whatever a protocol's library raises
            raise CampaignError(f"{name}: expected files that can be listed, found {shown(pattern)}"
                                f" ({reason(e)})") from e  # fmt: skip
        found = sorted(file.full_name for file in files)
    if not found:
        raise CampaignError(f"{name}: expected one file at least, found none at {shown(pattern)}")
    return found


@contextmanager
def local(source: str) -> Iterator[Path]:
    """The path of a file on this machine, for as long as it is needed."""
    if "://" not in source:
        yield Path(source)
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / PurePosixPath(source).name
        with library("fsspec").open(source, "rb") as stream, open(place, "wb") as copy:
            while part := stream.read(2**20):
                copy.write(part)
        yield place
