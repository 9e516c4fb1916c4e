"""Ctrl-C ends every command within a second, also where code that is not Python's is at work."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

__all__ = ["GRACE", "STOPPED", "ended_by_interrupts"]

GRACE = 0.7
"""Seconds after which an interrupt that Python was not let to handle ends the process."""
AGAIN = 0.01
"""Seconds after which an interrupt that Python dropped is raised again: not in the same place."""
STOPPED = 130
"""Exit code after Ctrl-C."""


@contextmanager
def ended_by_interrupts() -> Iterator[None]:
    """Python raises KeyboardInterrupt between two of its own instructions, however long the one at
    work takes. A thread that hears of the signal at once ends the process if that does not come;
    files are whole or not there, whenever it does. One that was raised in an object's `__del__`,
    where Python drops it, is raised again."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    handled = threading.Event()

    def handle(number: int, frame: FrameType | None) -> NoReturn:
        handled.set()
        raise KeyboardInterrupt

    def dropped(about: sys.UnraisableHookArgs) -> None:
        if issubclass(about.exc_type, KeyboardInterrupt):
            threading.Timer(AGAIN, signal.raise_signal, (signal.SIGINT,)).start()
        else:
            unraisable(about)

    unraisable, sys.unraisablehook = sys.unraisablehook, dropped
    before = signal.signal(signal.SIGINT, handle)
    wakeup = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader, handled), daemon=True).start()
    try:
        yield
    finally:
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGINT, before)
        signal.set_wakeup_fd(wakeup)
        os.close(writer)


def _watch(reader: int, handled: threading.Event) -> None:
    """Until the pipe is closed."""
    while signals := os.read(reader, 1):
        if signals[0] == signal.SIGINT:
            if not handled.wait(GRACE):
                print("\nddmhe: stopped", file=sys.stderr, flush=True)
                os._exit(STOPPED)
            handled.clear()
    os.close(reader)
