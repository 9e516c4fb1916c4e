"""A campaign, run: parts to workers, what they return into the store, until all are finished."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ddmhe.campaign.cluster import PATIENCE, Workers, workers_at
from ddmhe.campaign.errors import CampaignError, library
from ddmhe.campaign.opened import Campaign
from ddmhe.campaign.spec import Part, Spec, read_spec
from ddmhe.campaign.store import Store
from ddmhe.campaign.trial import check_settings_of
from ddmhe.campaign.work import Done, lost_part, run_part
from ddmhe.checks import check_path, check_whole

__all__ = ["Progress", "run"]

NEEDED = ("distributed", "pyarrow", "xarray", "zarr")
LOOK = 1.0
"""Seconds after which workers are counted again."""


@dataclass(frozen=True)
class Progress:
    """How far a campaign is."""

    done: int
    """Finished cases, those of earlier runs too."""
    total: int
    failed: int
    seconds: float
    """Since this run began."""
    rate: float
    """Cases a second of this run."""
    dashboard: str
    workers: str

    @property
    def left(self) -> float:
        """Seconds left at this rate; infinite as long as nothing tells."""
        return (self.total - self.done) / self.rate if self.rate > 0 else float("inf")


def run(
    spec: str | Path | Mapping[str, Any] | Spec | None,
    out: str | Path,
    *,
    scheduler: str | None = None,
    resume: bool = False,
    workers: int | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Campaign:
    """Run all cases of a spec that the folder does not hold yet.

    Parameters
    ----------
    spec
        A TOML file, what such a file holds, or a `Spec`; None on resuming: that of the folder.
    out
        The campaign's folder.
    scheduler
        Address of a Dask scheduler, "tcp://host:8786"; None: one on this machine.
    resume
        Whether the folder holds a campaign that is gone on with. Its spec must be the same.
    workers
        Processes on this machine; default one a core.
    progress
        Is called with a `Progress` at the start and after every part.

    Raises
    ------
    CampaignError
        A key or a setting is wrong; the folder holds a campaign already, or none, or another; no
        scheduler answers; it was lost on the way. All finished parts are kept, after
        KeyboardInterrupt too.

    Examples
    --------
    In a script all of it stands under `if __name__ == "__main__":`, since processes are started.

    >>> import ddmhe
    >>> spec = {
    ...     "seeds": 4,
    ...     "systems": {"bench": {"duration": 0.5}},
    ...     "noise": {"low": {"x": 1e-3, "y": 1e-3}},
    ...     "estimators": {"DdMhe": {"knows_noise": True}, "ErrorStateKalman": {}},
    ... }
    >>> campaign = ddmhe.campaign.run(spec, "bench-campaign", workers=1)
    >>> campaign.rows.groupby("estimator")["rmse_all"].count()
    estimator
    DdMhe               4
    ErrorStateKalman    4
    Name: rmse_all, dtype: int64
    >>> ddmhe.campaign.run(spec, "bench-campaign", resume=True).complete  # nothing is left to run
    True
    """
    check_path("out", out)
    if workers is not None:
        check_whole("workers", workers)
    if spec is None and not resume:
        raise CampaignError("spec: expected a spec for a new campaign, found none")
    read = None if spec is None else read_spec(spec)
    for name in NEEDED:
        library(name)
    if resume:
        store = Store.found(Path(out))
        store.check_resumes(read)
        store.repair()
    else:
        assert read is not None
        check_settings_of(read)
        store = Store.create(Path(out), read)
    left = list(store.parts_left())
    if left:
        with workers_at(scheduler, workers) as found:
            _run(store, left, found, progress or (lambda _: None))
    return Campaign(store)


def _run(
    store: Store, left: list[Part], workers: Workers, progress: Callable[[Progress], object]
) -> None:
    """Every part to a worker, every result into the store."""
    spec, begin = store.spec, time.monotonic()
    failed = sum(store.finished().values())
    ahead = sum(part.stop - part.first for part in left) * len(spec.estimators)
    before = spec.cases - ahead
    done = 0

    def tell() -> None:
        seconds = time.monotonic() - begin
        progress(Progress(before + done, spec.cases, failed, seconds, done / max(seconds, 1e-9),
                          workers.dashboard, workers.words))  # fmt: skip

    tell()
    for result in _results(spec, left, workers):
        store.add(result)
        done += len(result.rows)
        failed += result.failed
        tell()


def _results(spec: Spec, left: list[Part], workers: Workers) -> Iterator[Done]:
    """What the parts come to, in the order in which they are finished.

    No more parts are handed out than there are threads: then a worker that dies has one part, which
    it died on, and no other is blamed."""
    distributed = library("distributed")
    waiting = iter(left)
    running: dict[Any, Part] = {}
    counted, threads, alone_since = 0.0, 0, time.monotonic()

    def hand_out() -> None:
        nonlocal counted, threads, alone_since
        now = time.monotonic()
        if now - counted > LOOK:
            counted, threads = now, workers.threads()
            alone_since = now if threads else alone_since
        if now - alone_since > PATIENCE:
            raise CampaignError(
                f"workers: expected one within {PATIENCE:g} s, found that all are gone; finished "
                "parts are kept, --resume goes on"
            )
        while len(running) < max(threads, 1) and (part := next(waiting, None)) is not None:
            key = f"part-{part.number}-{spec.hash[:12]}"
            wanted = version("ddmhe")
            running[workers.client.submit(_part, spec, part, wanted, key=key, pure=False)] = part

    with _lost_or_not(distributed):
        hand_out()
    while running:
        with _lost_or_not(distributed):
            try:
                with workers.client.as_current():
                    ready = distributed.wait(list(running), LOOK, "FIRST_COMPLETED").done
            except distributed.TimeoutError:
                ready = set()
            ended = [(running.pop(future), future) for future in ready]
            results = [_result(spec, part, future) for part, future in ended]
            hand_out()  # before the files are written: workers are not to wait for the disk
        yield from results


@contextmanager
def _lost_or_not(distributed: Any) -> Iterator[None]:
    """CampaignError where what Dask raises means that the scheduler is gone."""
    try:
        yield
    except (distributed.CancelledError, distributed.TimeoutError, OSError) as e:
        raise CampaignError(
            "scheduler: expected one that stays, found that it was lost; finished parts are kept, "
            "--resume goes on"
        ) from e


def _part(spec: Spec, part: Part, wanted: str) -> Done:
    """On a worker: a part, by the version that the campaign was begun with."""
    if version("ddmhe") != wanted:
        raise CampaignError(f"worker: expected ddmhe {wanted}, found {version('ddmhe')}")
    return run_part(spec, part)


def _result(spec: Spec, part: Part, future: Any) -> Done:
    """What a future holds; a part that killed its workers comes to rows that say so."""
    distributed = library("distributed")
    try:
        result: Done = future.result()
        return result
    except distributed.KilledWorker as e:
        return lost_part(spec, part, f"the worker died {e.allowed_failures + 1} times on this part")
