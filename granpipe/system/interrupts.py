"""Ctrl-C and SIGTERM where they must wait a moment."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """An interrupt that comes in the block acts at its end.

    For calls into libraries that call back into Python and swallow what is raised there, as numba's loader does: an
    interrupt would be lost in them.
    """
    came: list[tuple[int, Any]] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for one in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(one)
            if callable(handler):
                handlers[one] = handler
                signal.signal(one, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        for one, handler in handlers.items():
            signal.signal(one, handler)
        for number, frame in came[:1]:
            handlers[signal.Signals(number)](number, frame)
