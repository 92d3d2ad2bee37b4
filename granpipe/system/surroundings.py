"""What a command finds around it, made harmless before any work: closed streams, unwritable caches, user styles."""

from __future__ import annotations

import atexit
import contextlib
import os
import resource
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from granpipe.errors import RunError

_CACHES = ("NUMBA_CACHE_DIR", "MPLCONFIGDIR")

_DRAWING = threading.RLock()
"""matplotlib's style is one for the whole process: threads draw one after the other."""

LEAST_ADDRESS_SPACE = 800_000 * 1024
"""Bytes with which a fluid run was seen to end well; with half of them gmsh's library does not load."""


class Lossy:
    """A text stream that goes on where nobody reads it any more: a run must not end for a line that is lost.

    Parameters
    ----------
    lost : errors at which it goes on
    """

    def __init__(self, stream: IO[str], lost: type[OSError] = BrokenPipeError) -> None:
        self._stream, self._lost = stream, lost

    def write(self, text: str) -> int:
        with self._told():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._told():
            self._stream.flush()

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Other errors name the stream; what Python still holds of it at the end is lost, and not told once more."""
        try:
            yield
        except self._lost:
            pass
        except OSError as error:
            error.filename = self._stream.name
            atexit.register(self._silence)
            raise

    def _silence(self) -> None:
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def prepare() -> None:
    """To be called first by a command.

    Streams that are closed get the null device, so that no file takes their number; Jupyter's drawing back end is not
    used; caches of libraries go to a temporary folder where the user's cannot be written.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # a result that does not get through to a full disk must be told, a line of a log may be lost
    for name, lost in (("stdout", BrokenPipeError), ("stderr", OSError)):
        stream = getattr(sys, name)
        setattr(sys, name, Lossy(stream, lost) if stream is not None else Path(os.devnull).open("w"))  # noqa: SIM115
    os.environ["MPLBACKEND"] = "agg"
    if not can_be_written(cache_folder()) and not all(name in os.environ for name in _CACHES):
        folder = tempfile.mkdtemp(prefix="granpipe-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        for name in _CACHES:
            os.environ.setdefault(name, folder)


def cache_folder() -> Path:
    """The folder in which the user's programs keep what can be made again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(os.environ.get("HOME") or "~").expanduser() / ".cache")


def can_be_written(folder: Path) -> bool:
    """Whether files can be put into a folder, which may have to be made."""
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    except OSError:  # a folder above it may not be looked into, or the present one is gone
        return False
    return there.is_dir() and os.access(there, os.W_OK)


@contextlib.contextmanager
def own_style(changes: dict[Any, Any]) -> Iterator[None]:
    """In the block matplotlib draws with its own defaults and these changes, whatever the user's style is."""
    import matplotlib

    with _DRAWING, matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(changes)
        yield


def require_style() -> None:
    """Make sure that matplotlib, which draws at the end of the work, can read the user's style: it will not start else.

    Raises
    ------
    RunError : it cannot
    """
    folder = os.environ.get("MPLCONFIGDIR") or Path(os.environ.get("XDG_CONFIG_HOME") or "~/.config") / "matplotlib"
    given = Path(os.environ.get("MATPLOTLIBRC") or "")
    for path in (Path("matplotlibrc"), given, given / "matplotlibrc", Path(folder).expanduser() / "matplotlibrc"):
        try:
            if path.is_file():
                path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise RunError(
                f"{path}: not UTF-8 text, so that matplotlib does not start; repair it or move it"
            ) from error
        except (OSError, RuntimeError):  # matplotlib passes over what it cannot read; RuntimeError: there is no home
            continue


def require_memory() -> None:
    """Make sure that the limit on address space (``ulimit -v``) leaves room for the libraries of a run.

    Raises
    ------
    RunError : it does not
    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_ADDRESS_SPACE:
        raise RunError(
            f"the limit on address space is {limit / 1e6:.0f} MB, too little for the libraries of a run; raise it, "
            f"such as with `ulimit -v {LEAST_ADDRESS_SPACE // 1024}`, or ask the cluster for more memory"
        )
