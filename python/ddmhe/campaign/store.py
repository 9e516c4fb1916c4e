"""Where a campaign is kept: a folder with its spec, Parquet files of rows and times, traces in a
Zarr store, and a manifest of the parts that are finished.

`rows/system=S/estimator=E/part-K.parquet`, `times/part-K.parquet`, `traces.zarr/CASE`. A part's
files are written beside their places and renamed; its line in `manifest.jsonl` comes last, so that
what is not in the manifest is run again, and comes out the same."""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ddmhe.campaign.columns import rows_schema, times_schema
from ddmhe.campaign.errors import CampaignError, library
from ddmhe.campaign.spec import Part, Spec, read_spec
from ddmhe.campaign.work import Done
from ddmhe.checks import file_words
from ddmhe.files import write, write_text

__all__ = ["Store"]

SPEC, MANIFEST, ROWS, TIMES, TRACES = "spec.json", "manifest.jsonl", "rows", "times", "traces.zarr"


class Store:
    """A folder of one campaign."""

    def __init__(self, folder: Path, spec: Spec) -> None:
        """The folder as it is; `create` and `found` make sure of it."""
        self.folder, self.spec = folder, spec
        self._schema = rows_schema(spec)

    @classmethod
    def create(cls, folder: Path, spec: Spec) -> Store:
        """A new campaign; CampaignError where there is one already."""
        if (folder / SPEC).exists():
            raise CampaignError(
                f"{file_words(folder)}: expected a folder without a campaign, found one: --resume "
                "goes on with it"
            )
        folder.mkdir(parents=True, exist_ok=True)
        about = {"ddmhe": version("ddmhe"), "hash": spec.hash, "spec": spec.plain}
        write_text(folder / SPEC, json.dumps(about, indent=1) + "\n")
        return cls(folder, spec)

    @classmethod
    def found(cls, folder: Path) -> Store:
        """The campaign of a folder."""
        try:
            about = json.loads((folder / SPEC).read_text(encoding="utf-8"))
            spec = read_spec(about["spec"])
        except (OSError, ValueError, KeyError, TypeError) as e:
            raise CampaignError(
                f"{file_words(folder)}: expected the folder of a campaign, found none ({e})"
            ) from e
        if spec.hash != about["hash"]:
            raise CampaignError(
                f"{file_words(folder / SPEC)}: expected a spec that was not changed by hand, found "
                "another hash"
            )
        return cls(folder, spec)

    def check_resumes(self, spec: Spec | None) -> None:
        """CampaignError, with the difference, where a spec or this version is not what the folder
        was begun with."""
        changed = [] if spec is None else list(self.spec.differences(spec))
        if changed:
            raise CampaignError(
                f"{file_words(self.folder)}: expected the spec that it was begun with, found "
                f"another: {'; '.join(changed)}"
            )
        began = json.loads((self.folder / SPEC).read_text(encoding="utf-8"))["ddmhe"]
        if began != version("ddmhe"):
            raise CampaignError(
                f"{file_words(self.folder)}: expected ddmhe {began}, with which it was begun, "
                f"found {version('ddmhe')}"
            )

    def finished(self) -> dict[int, int]:
        """Failed cases of each finished part. A last line that is cut is no line."""
        path = self.folder / MANIFEST
        if not path.exists():
            return {}
        found = {}
        for line in path.read_bytes().split(b"\n")[:-1]:
            entry = json.loads(line)
            found[int(entry["part"])] = int(entry["failed"])
        return found

    def repair(self) -> None:
        """Cut off the piece of a line that an end in the middle of writing has left."""
        path = self.folder / MANIFEST
        if path.exists():
            text = path.read_bytes()
            if not text.endswith(b"\n") and text:
                with open(path, "r+b") as manifest:
                    manifest.truncate(text.rfind(b"\n") + 1)
        for left in self.folder.rglob(".part-*.parquet"):
            left.unlink()
        for left in (self.folder / TRACES).glob(".[0-9]*"):
            shutil.rmtree(left, ignore_errors=True)

    def add(self, done: Done) -> None:
        """Keep a part: all of its files, then its line in the manifest."""
        name = f"part-{done.part.number:06d}.parquet"
        for estimator in self.spec.estimators:
            rows = [row for row in done.rows if row["estimator"] == estimator]
            place = self.folder / ROWS / f"system={done.part.system}" / f"estimator={estimator}"
            self._write(place / name, rows, self._schema)
        self._write(self.folder / TIMES / name, done.times, times_schema())
        for case, trace in done.traces.items():
            self._write_trace(case, trace)
        line = {"part": done.part.number, "cases": len(done.rows), "failed": done.failed}
        with open(self.folder / MANIFEST, "ab") as manifest:
            manifest.write(json.dumps(line).encode() + b"\n")
            manifest.flush()
            os.fsync(manifest.fileno())

    def _write(self, path: Path, rows: list[dict[str, Any]], schema: Any) -> None:
        pa, parquet = library("pyarrow"), library("pyarrow.parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        columns = {name: [row.get(name) for row in rows] for name in schema.names}
        table = pa.Table.from_pydict(columns, schema=schema)
        buffer = io.BytesIO()
        parquet.write_table(table, buffer, compression="zstd")
        write(path, lambda beside: beside.write_bytes(buffer.getvalue()))

    def _write_trace(self, case: int, trace: dict[str, Any]) -> None:
        """A run as a group of the Zarr store: written beside its place, then renamed."""
        xarray = library("xarray")
        place, beside = self.folder / TRACES / str(case), self.folder / TRACES / f".{case}"
        data = {name: (("t", "output" if name == "y" else "state"), trace[name])
                for name in trace if name != "t"}  # fmt: skip
        library("zarr").open_group(str(self.folder / TRACES), mode="a")
        shutil.rmtree(beside, ignore_errors=True)
        of = self.spec.case(case)
        about = {"case": case, "estimator": of.estimator, "seed": of.scenario.seed}
        made = xarray.Dataset(data, coords={"t": ("t", trace["t"], {"units": "s"})}, attrs=about)
        made.to_zarr(beside, mode="w", consolidated=False)
        shutil.rmtree(place, ignore_errors=True)
        beside.rename(place)

    def parts_left(self) -> Iterator[Part]:
        """Parts that are not finished, in order."""
        finished = self.finished()
        return (part for part in self.spec.parts if part.number not in finished)

    def rows(self) -> Any:
        """Rows of all finished parts in the order of the cases, a pandas frame."""
        dataset = library("pyarrow.dataset")
        folders = self._files(ROWS)
        pa = library("pyarrow")
        named = pa.schema([("system", pa.string()), ("estimator", pa.string())])
        schema = pa.unify_schemas([self._schema, named])
        if not folders:
            return schema.empty_table().to_pandas()
        found = dataset.dataset(
            folders, schema=schema, format="parquet", partition_base_dir=str(self.folder / ROWS),
            partitioning=dataset.partitioning(named, flavor="hive"),
        )  # fmt: skip
        frame = found.to_table().to_pandas()
        first = ["case", "system", "noise", "fault", "source", "seed", "estimator", "outcome"]
        rest = [name for name in frame.columns if name not in first]
        return frame.sort_values("case", ignore_index=True)[first + rest]

    def times(self) -> Any:
        """Times of all finished parts, a pandas frame."""
        dataset = library("pyarrow.dataset")
        files = self._files(TIMES)
        if not files:
            return times_schema().empty_table().to_pandas()
        found = dataset.dataset(files, schema=times_schema(), format="parquet")
        return found.to_table().to_pandas().sort_values("case", ignore_index=True)

    def _files(self, kind: str) -> list[str]:
        """Files of finished parts alone."""
        names = {f"part-{number:06d}.parquet" for number in self.finished()}
        return sorted(str(p) for p in (self.folder / kind).rglob("*.parquet") if p.name in names)

    def traces(self) -> dict[int, Any]:
        """Whole runs by their cases, xarray datasets that are read when they are used."""
        xarray = library("xarray")
        library("zarr")
        root = self.folder / TRACES
        cases = sorted(int(p.name) for p in root.glob("[0-9]*")) if root.exists() else []
        return {case: xarray.open_zarr(root / str(case), consolidated=False) for case in cases}
