"""What a worker of this machine does first: Dask loads this module into each (`preload`)."""

from __future__ import annotations

import signal

__all__ = ["dask_setup"]


def dask_setup(worker: object) -> None:
    """Ctrl-C, which a terminal sends to all processes of a command, is for the command to act on.
    A worker that acts on it ends by itself, and is not begun again."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
