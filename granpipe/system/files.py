"""Files that appear whole or not at all, on the disk too; and what the disk refuses, in one clear message."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path
from typing import cast

from granpipe.errors import RunError
from granpipe.system.reading import open_regular

RESERVE = 200 * 1024**2
"""Free disk space [bytes] below which nothing is started."""


def digest(path: Path) -> str:
    """SHA-256 of a file's bytes, in hex; OSError where it is no regular file."""
    with open_regular(path) as file:
        return hashlib.file_digest(cast(BufferedReader, file), "sha256").hexdigest()


PNG = b"\x89PNG"
"""How a picture begins."""


def check_picture(path: Path) -> None:
    """Refuse a path for a picture where something else stands: it would be lost.

    Raises
    ------
    RunError : there is a file that is no PNG picture, a folder or a device
    """
    try:
        with open_regular(path) as file:
            other = file.read(len(PNG)) not in (PNG, b"")
    except FileNotFoundError:
        return
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}; choose another file for the picture") from None
    if other:
        raise RunError(f"{path} exists and is no PNG picture; choose another file for the picture")


def unique(path: Path, suffix: str = "") -> Path:
    """A hidden name beside `path` that no other process takes, on whatever machine."""
    return path.with_name(f".{path.name}.{os.urandom(4).hex()}{suffix}")


def write_whole(path: Path, text: str) -> None:
    """Write a file by one rename: whoever reads it sees the old text or the new one, after a power cut too."""
    aside = unique(path)
    try:
        aside.write_text(text, encoding="utf-8")
        replace_whole(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def replace_whole(source: Path, path: Path) -> None:
    """Put a file in the place of `path`, both on the disk by then; `source` may be on another file system."""
    try:
        flush(source)
        source.replace(path)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        aside = unique(path)
        try:
            shutil.copyfile(source, aside)
            flush(aside)
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
    flush(path.parent)


def flush(path: Path) -> None:
    """Bring a file, or a folder's list of names, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:  # some network file systems cannot flush a folder
        if error.errno not in (errno.EINVAL, errno.EBADF, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def flush_tree(folder: Path) -> None:
    """Bring a folder and all below it to the disk."""
    for path in folder.rglob("*"):
        if not path.is_symlink() and (path.is_file() or path.is_dir()):
            flush(path)
    flush(folder)


def remove_leftovers(path: Path) -> None:
    """Remove the hidden folders that killed processes have left beside `path`; for the process that holds its lock."""
    for left in leftovers(path):
        shutil.rmtree(left, ignore_errors=True)


def leftovers(path: Path) -> list[Path]:
    """Hidden folders beside `path` with a name that `unique` gives to what is still being written."""
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.part")
    return [one for one in path.parent.glob(".*.part") if name.fullmatch(one.name)]


def check_space(folder: Path, needed: int = 0) -> None:
    """RunError unless the disk has `needed` bytes and a reserve."""
    free = shutil.disk_usage(folder).free
    if free < needed + RESERVE:
        raise RunError(
            f"{folder.parent}: {free / 1e6:.0f} MB free on this disk, {(needed + RESERVE) / 1e6:.0f} MB needed; "
            "make room or choose another folder with --results"
        )


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """RunError with the remedy for a full disk or missing permission in the block."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise RunError(f"{path.parent}: no space left on the disk; make room and run again: it resumes") from error
        if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
            raise RunError(f"{error.filename or path}: not writable; choose another folder with --results") from error
        raise
