"""Opening what others wrote: regular files of a bounded size, so that no pipe, device or folder blocks a reader."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading bytes.

    Raises
    ------
    OSError : it cannot be opened, or is no regular file; `strerror` says why
    ValueError : the path holds a null byte
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a pipe without a writer would block
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind == stat.S_IFREG:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    raise OSError(errno.EINVAL, f"{_KINDS[kind]}, not a regular file", str(path))


def read_bytes(path: Path, most: int) -> bytes:
    """The bytes of a file.

    Raises
    ------
    OSError : it cannot be opened, is no regular file, or holds more than `most` bytes
    """
    with open_regular(path) as file:
        data = file.read(min(most, os.fstat(file.fileno()).st_size) + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"larger than {most / 1e6:.3g} MB", str(path))
    return data


def reason(error: Exception) -> str:
    """What an error of `open_regular` says, without its number and path."""
    return getattr(error, "strerror", None) or str(error)
