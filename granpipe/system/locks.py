"""Locks between processes, also of other containers and machines that share a file system.

They are the kernel's (`flock`): a lock falls with its process, however that ends. The file tells who holds it, and is
gone afterwards.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from granpipe.errors import RunError
from granpipe.system.files import explained

_UNSUPPORTED = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}
_POLL = 0.02  # s
_MOST_OWNER = 1000  # characters


@dataclass(frozen=True)
class Owner:
    """The process that holds a lock; pid 0 where it has not said so yet."""

    host: str = ""
    pid: int = 0

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}" if self.pid else "another process"


@contextlib.contextmanager
def locked(
    path: Path,
    busy: Callable[[Owner], str],
    waiting: Callable[[str], None] | None = None,
    *,
    patience: float = 0.0,
) -> Iterator[None]:
    """Hold the lock `path` alone.

    Parameters
    ----------
    busy : what is said of the process that holds it
    waiting : is told so once, and this process waits; without it RunError is raised
    patience : how long to try before that [s]

    Raises
    ------
    RunError : another process holds it, the file system has no locks, or the file is no lock
    """
    end = time.monotonic() + patience
    while (file := _try_lock(path, fcntl.LOCK_EX | fcntl.LOCK_NB)) is None:
        if time.monotonic() < end:
            time.sleep(_POLL)
        elif waiting is None:
            raise RunError(busy(_owner(path)))
        else:
            waiting(busy(_owner(path)))
            waiting = _say_nothing
            if (file := _try_lock(path, fcntl.LOCK_EX)) is not None:
                break
    with file:
        _check_own(file, path)
        file.truncate(0)
        file.write(json.dumps(asdict(Owner(socket.gethostname(), os.getpid()))))
        file.flush()
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def shared(path: Path) -> Iterator[None]:
    """Hold the lock `path` together with others; while a process holds it alone, wait.

    Raises
    ------
    RunError : another process holds the lock, or the file system has none
    """
    while (file := _try_lock(path, fcntl.LOCK_SH)) is None:
        pass
    with file:
        yield


def holder(path: Path) -> Owner | None:
    """The process that holds a lock alone; None where there is none."""
    try:
        file = _opened(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _owner(path)
    return None


def _try_lock(path: Path, mode: int) -> IO[str] | None:
    """The locked file; None where another process holds it, or has removed it meanwhile.

    RunError where the file system has no locks.
    """
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _opened(path, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(file, mode)
        if os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return file
    except (BlockingIOError, FileNotFoundError):
        pass
    except OSError as error:
        file.close()
        if error.errno in _UNSUPPORTED:
            raise RunError(
                f"{path}: this file system has no file locks ({error.strerror}); choose a folder on another one with "
                "--results, or have it mounted with locks (NFS: lockd; Lustre: -o flock)"
            ) from error
        raise
    except BaseException:
        file.close()
        raise
    file.close()
    return None


def _opened(path: Path, flags: int) -> IO[str]:
    """The file of a lock; RunError where another thing has its name: a link might lead to a file of the user's."""
    try:
        descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
            raise RunError(_not_ours(path)) from error
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise RunError(_not_ours(path))
    return os.fdopen(descriptor, "r+" if flags & os.O_RDWR else "r")


def _check_own(file: IO[str], path: Path) -> None:
    """RunError where a file that others wrote has the name of a lock."""
    with contextlib.suppress(ValueError):
        text = file.read(_MOST_OWNER)
        if not text or _owner_in(text).pid:
            file.seek(0)
            return
    raise RunError(_not_ours(path))


def _not_ours(path: Path) -> str:
    return f"{path}: not a lock that granpipe wrote; move it away and run again"


def _owner(path: Path) -> Owner:
    with contextlib.suppress(OSError, ValueError), path.open() as file:
        return _owner_in(file.read(_MOST_OWNER))
    return Owner()


def _owner_in(text: str) -> Owner:
    with contextlib.suppress(ValueError, RecursionError):
        match json.loads(text):
            case {"host": str(host), "pid": int(pid)} if 0 < pid < 2**31:
                return Owner(host, pid)
    return Owner()


def _say_nothing(_: str) -> None:
    pass
