"""Dask: a scheduler with workers on this machine, or one that runs already."""

from __future__ import annotations

import logging
import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Thread
from typing import Any

from ddmhe.campaign.errors import CampaignError, library
from ddmhe.checks import reason

__all__ = ["PATIENCE", "Workers", "workers_at"]

DEATHS = 3
"""Deaths of a worker on one part after which the part is given up."""
PATIENCE = 60.0
"""Seconds without any worker after which a campaign ends."""
CLOSE = 1.0
"""Seconds in which processes of this machine must end by themselves."""
SOON = 0.5
"""Seconds that an interrupt waits for the cluster's end."""
CONNECT = 10.0
"""Seconds in which a scheduler must answer."""


@dataclass
class Workers:
    """Where parts are run."""

    client: Any
    cluster: Any
    """Of this machine; None for a scheduler of someone else."""
    dashboard: str
    words: str
    """How many, and how much memory each may take."""

    def threads(self) -> int:
        """How many parts run at a time."""
        return sum(map(int, self.client.nthreads().values()))

    def end_now(self) -> None:
        """End the processes of this machine without waiting for what they are at."""
        if self.cluster is not None:
            for nanny in list(self.cluster.workers.values()):
                nanny.close_gracefully()  # or it begins another worker
            for child in multiprocessing.active_children():
                child.kill()


@contextmanager
def workers_at(scheduler: str | None, workers: int | None) -> Iterator[Workers]:
    """A client of a scheduler by its address, or of a local one with so many workers (default: one
    a core), of one thread each. All of it ends with the context, but not another's scheduler."""
    distributed = library("distributed")
    if scheduler is None:
        with _local(distributed, workers) as found:
            yield found
        return
    silent = library("distributed.utils").silence_logging_cmgr
    with silent(logging.CRITICAL):  # of a scheduler that is lost Dask prints what it tried
        try:
            client = distributed.Client(scheduler, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, distributed.TimeoutError) as e:
            raise CampaignError(
                f"scheduler: expected one that answers at {scheduler}, found none ({reason(e)})"
            ) from e
        with client:
            _wait(client)
            yield Workers(client, None, client.dashboard_link, _words(client))


@contextmanager
def _local(distributed: Any, workers: int | None) -> Iterator[Workers]:
    dask = library("dask")
    silent = library("distributed.utils").silence_logging_cmgr
    settings = {
        "distributed.scheduler.allowed-failures": DEATHS - 1,
        "distributed.worker.preload": ["ddmhe.campaign.workers"],
    }
    # a cluster that is silent by itself is so until it is closed; its connections end after it
    with dask.config.set(settings), silent(logging.CRITICAL):
        cluster = distributed.LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
        client = distributed.Client(cluster, set_as_default=False)
        found = Workers(client, cluster, cluster.dashboard_link, "")
        try:
            _wait(client)
            found.words = _words(client)
            yield found
        except KeyboardInterrupt:
            found.end_now()
            closing = Thread(target=_close, args=(client, cluster), daemon=True)
            closing.start()
            closing.join(SOON)  # some hundredths: a process that ends before it leaves semaphores
            raise
        except BaseException:
            found.end_now()
            _close(client, cluster)
            raise
        _close(client, cluster)


def _close(client: Any, cluster: Any) -> None:
    with suppress(Exception):  # of processes that were ended
        client.close(timeout=CLOSE)
        cluster.close(timeout=CLOSE)


def _wait(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except library("distributed").TimeoutError:
        raise CampaignError(
            f"scheduler: expected a worker within {PATIENCE:g} s, found none"
        ) from None


def _words(client: Any) -> str:
    """The workers in words."""
    found = client.scheduler_info(n_workers=-1)["workers"].values()
    memory = {worker["memory_limit"] for worker in found}
    most = f"{max(memory) / 1e9:.2g} GB" if all(memory) else "no bound"
    threads = sum(worker["nthreads"] for worker in found)
    count = f"{len(found)} worker{'s' if len(found) != 1 else ''}"
    return f"{count}, {threads} thread{'s' if threads != 1 else ''}; memory of each: {most}"
