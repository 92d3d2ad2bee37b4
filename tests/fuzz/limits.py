"""Bounds on time and memory, for code that is given hostile input."""

from __future__ import annotations

import contextlib
import resource
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

SECONDS = 5.0  # of processor time, for one input
MEMORY = 300_000_000  # bytes that all inputs together may add


class HangError(BaseException):
    """Not an Exception: no reader may catch it."""


@contextlib.contextmanager
def bounded() -> Iterator[Callable[[], None]]:
    """Limits on memory, for all, and on time, for each input: call what it yields before each."""

    def hang(*_: object) -> None:
        raise HangError(f"more than {SECONDS} s")

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    old_limit, old_handler = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGPROF, hang)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, old_limit[1]))
    try:
        yield lambda: signal.setitimer(signal.ITIMER_PROF, SECONDS) and None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, old_handler)
        resource.setrlimit(resource.RLIMIT_AS, old_limit)
