"""gmsh sessions: silent, reproducible, and without a trace in the process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from granpipe.errors import GranpipeError, MeshError

_ALONE = threading.Lock()
"""gmsh has one session in a process: threads wait for each other."""


@contextmanager
def gmsh_session(task: str) -> Iterator[Any]:
    """The gmsh module, ready to use; what fails in it becomes a MeshError that names the task.

    gmsh prints nothing, reads no configuration of the user, and works on one thread: the same mesh on every machine.
    It takes the handlers of signals away when it starts, so that a run could not be ended cleanly, and would die with
    the reader of its output: the handlers are put back.

    Raises
    ------
    MeshError : the task failed, or somebody else in this process has a session, which a second one would end
    """
    try:
        import gmsh
    except OSError as error:
        raise MeshError(f"gmsh's library does not load ({error}): granpipe doctor says what to install") from error
    with _ALONE:
        if gmsh.isInitialized():
            raise MeshError(
                "gmsh has a session in this process already, which would be lost: call gmsh.finalize() first, "
                "or run granpipe in a process of its own"
            )
        try:
            gmsh.initialize(readConfigFiles=False, interruptible=False)
            _restore_handlers()
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.option.setNumber("General.NumThreads", 1)
            yield gmsh
        except GranpipeError:  # the package's own: it says already what is wrong
            raise
        except Exception as error:  # gmsh raises nothing more special
            raise MeshError(f"gmsh could not {task} ({error}): look for walls that nearly touch") from error
        finally:
            if gmsh.isInitialized():
                gmsh.finalize()


def _restore_handlers() -> None:
    """Install Python's own handlers again; only the main thread may, and only it had any."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE):
        handler = signal.getsignal(number)
        if handler is not None:
            signal.signal(number, handler)
