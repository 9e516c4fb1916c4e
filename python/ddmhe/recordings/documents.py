"""Tables from documents of YAML, one a sample, parted by lines of three dashes."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ddmhe.checks import reason
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.json_trees import table_of_objects
from ddmhe.recordings.libraries import library
from ddmhe.recordings.table import Table
from ddmhe.recordings.text import decode

__all__ = ["are_documents", "yaml_table"]

_PARTED = re.compile(rb"(?:\A|\n)[ \t]*[\w./]+:[ \t]*[^\n,;\t]*\r?\n(?:[^\n]*\n){0,200}?---\r?\n")
_DASHES = re.compile(rb"^---\r?$", re.MULTILINE)


def are_documents(data: bytes) -> bool:
    """Whether bytes begin as such documents do."""
    head = data[:20_000]
    return _PARTED.match(head.removeprefix(b"---\n")) is not None and len(_DASHES.findall(head)) > 2


def yaml_table(path: str, data: bytes, encoding: str | None) -> Table:
    """The table of documents; nested names have paths."""
    yaml = library("ruamel.yaml", path, "documents of YAML")
    text, _ = decode(path, data, encoding)
    try:
        found = [one for one in yaml.YAML(typ="safe").load_all(text) if one is not None]
    except Exception as e:  # it has a class of error for each thing that can be wrong
        raise LogError(f"{path}: expected documents of YAML, found others ({reason(e)})") from e
    if not all(isinstance(one, Mapping) for one in found):
        raise LogError(f"{path}: expected documents of YAML with names and values, found others")
    return table_of_objects(path, list(enumerate(found, 1)), "row")
