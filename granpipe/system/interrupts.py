"""Ctrl-C and SIGTERM where they must wait a moment, and Ctrl-Z with its children."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
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


_SUSPENDED_TOO: dict[object, tuple[Callable[[], None], Callable[[], None]]] = {}


@contextlib.contextmanager
def suspended_too(suspend: Callable[[], None], resume: Callable[[], None]) -> Iterator[None]:
    """Ctrl-Z (SIGTSTP) in the block calls `suspend` before this process stops, and `resume` when it goes on.

    For programs in sessions of their own, which the terminal does not reach. Blocks may overlap in any order.
    """
    one = object()
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTSTP) == signal.SIG_DFL:
        signal.signal(signal.SIGTSTP, _stop_together)
    _SUSPENDED_TOO[one] = suspend, resume
    try:
        yield
    finally:
        del _SUSPENDED_TOO[one]
        if not _SUSPENDED_TOO and signal.getsignal(signal.SIGTSTP) is _stop_together:
            signal.signal(signal.SIGTSTP, signal.SIG_DFL)


def _stop_together(*_: object) -> None:
    others = list(_SUSPENDED_TOO.values())
    for suspend, _resume in others:
        suspend()
    os.kill(os.getpid(), signal.SIGSTOP)  # the default action of SIGTSTP is passed over in a session without a shell
    for _suspend, resume in others:
        resume()
