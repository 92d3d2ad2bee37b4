"""The store of finished stages: content keys, temporary folders, publishing by one rename, locks.

A stage is done when its folder exists, and the folder appears complete or not at all; there is no status database.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granpipe.errors import DataError, RunError

RESERVE = 200 * 1024**2
"""Free disk space [bytes] below which nothing is started."""


def key_of(stage: str, version: int, part: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON of all that the result of a stage depends on; 20 hex digits."""
    text = json.dumps({"stage": stage, "version": version, "part": part}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def digest(path: Path) -> str:
    """SHA-256 of a file's bytes, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Store:
    """Folders of finished stages below `root`.

    Where another process works on a stage, RunError says so at once. With `waiting` given, that is told so, and this
    process waits for the other: so the points of a sweep share what they have in common.
    """

    root: Path
    waiting: Callable[[str], None] | None = None

    def folder(self, stage: str, key: str) -> Path:
        """Where the result of a stage lies, or will."""
        return self.root / f"{stage}-{key}"

    def make(self, stage: str, key: str, work: Callable[[Path], None]) -> Path:
        """The folder of a finished stage; `work(folder)` fills it where it does not exist yet."""

        def in_one_step(folder: Path) -> Iterator[None]:
            work(folder)
            yield

        for _ in self.make_in_steps(stage, key, in_one_step):
            pass
        return self.folder(stage, key)

    def make_in_steps(self, stage: str, key: str, work: Callable[[Path], Iterator[None]]) -> Iterator[None]:
        """Like `make`, with work that is done bit by bit: the folder is finished when the iterator ends."""
        target = self.folder(stage, key)
        if target.is_dir():
            return
        with self.lock(stage, key):
            if not target.is_dir():  # it may have appeared while this process waited
                sweep(target)
                with publishing(target) as folder:
                    yield from work(folder)

    def clear(self) -> tuple[int, list[str]]:
        """Delete every stage; return the bytes that were freed, and why others were kept: processes work on them."""
        freed, kept = 0, []
        for folder in self.root.glob("*-*/"):
            stage, _, key = folder.name.lstrip(".").split(".")[0].partition("-")
            try:
                with self.lock(stage, key):
                    freed += sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
                    shutil.rmtree(folder)
            except RunError as error:
                kept.append(f"{folder.name}: {error}")
        return freed, kept  # empty lock files stay: deleting one while another process opens it would split the lock

    @contextlib.contextmanager
    def lock(self, stage: str, key: str) -> Iterator[None]:
        """Keep other processes off a stage; if one is at work on it, wait for it or raise RunError at once.

        The lock is the kernel's: it falls with its process, however that ends.
        """
        path = self.root / f".{stage}-{key}.lock"
        with _explained(path):
            self.root.mkdir(parents=True, exist_ok=True)
            file = path.open("a+")
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                owner = file.read().strip() or "unknown"
                message = f"another granpipe (process {owner}) is working on {stage} of this case"
                if self.waiting is None:
                    raise RunError(f"{message}; wait for it, or stop it and run again") from None
                self.waiting(f"{message}; waiting for it")
                fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            file.truncate()
            file.write(str(os.getpid()))
            file.flush()
            yield


@contextlib.contextmanager
def publishing(target: Path) -> Iterator[Path]:
    """A temporary folder that becomes `target` by one rename if the block succeeds, and vanishes otherwise.

    An existing `target` is replaced.
    """
    aside = target.with_name(f".{target.name}.{os.getpid()}.part")
    with _explained(target):
        shutil.rmtree(aside, ignore_errors=True)
        aside.mkdir(parents=True)
        check_space(aside)
        try:
            yield aside
            _replace(aside, target)
        finally:
            shutil.rmtree(aside, ignore_errors=True)


def sweep(target: Path) -> None:
    """Remove what killed processes have left of `target`; for who holds its lock."""
    for left in target.parent.glob(f".{target.name}.*.part"):
        shutil.rmtree(left, ignore_errors=True)


@contextlib.contextmanager
def evidence_kept(work: Path, evidence: Path) -> Iterator[None]:
    """If the block fails, what is in `work` is moved to the folder `evidence`, which the error then names."""
    try:
        yield
    except (RunError, DataError) as error:
        shutil.rmtree(evidence, ignore_errors=True)
        shutil.move(work, evidence)
        raise type(error)(f"{error}\nevidence: {evidence}") from error
    shutil.rmtree(evidence, ignore_errors=True)


def _replace(folder: Path, target: Path) -> None:
    """Put `folder` where `target` is; between the two renames the old one still lies beside it."""
    if not target.exists():
        folder.rename(target)
        return
    old = target.with_name(f".{target.name}.{os.getpid()}.old")
    target.rename(old)
    folder.rename(target)
    shutil.rmtree(old, ignore_errors=True)


def check_space(folder: Path, needed: int = 0) -> None:
    """RunError unless the disk has `needed` bytes and a reserve."""
    free = shutil.disk_usage(folder).free
    if free < needed + RESERVE:
        raise RunError(
            f"{folder.parent}: {free / 1e6:.0f} MB free on this disk, {(needed + RESERVE) / 1e6:.0f} MB needed; "
            "make room or choose another folder with --results"
        )


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn what the disk refuses into one clear message."""
    try:
        yield
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise RunError(f"{path.parent}: no space left on the disk; make room and run again: it resumes") from error
        if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
            raise RunError(f"{error.filename or path}: not writable; choose another folder with --results") from error
        raise
