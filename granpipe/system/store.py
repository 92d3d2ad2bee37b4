"""The store of finished stages: content keys, folders that appear by one rename, locks.

A stage is done when its folder is there and every file in it is as its manifest says; there is no status database.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from granpipe import __version__
from granpipe.errors import DataError, RunError
from granpipe.system.files import explained, remove_leftovers
from granpipe.system.locks import locked, shared
from granpipe.system.manifest import MANIFEST, MOST_BYTES, is_whole, read_manifest, write_manifest
from granpipe.system.publish import lock_file, publishing
from granpipe.system.reading import read_bytes

_MARKER = "stage.json"
"""In every folder of the store: what granpipe made it for. Only folders that have it are ever removed."""

_UNLISTED = {"work", "logs", "snapshots"}
"""Folders of a stage that is done in parts; what is in them stands in no manifest."""


def key_of(stage: str, version: int, part: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON of all that the result of a stage depends on; 20 hex digits."""
    text = json.dumps({"stage": stage, "version": version, "part": part}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Store:
    """Folders of finished stages below `root`.

    Where another process works on a stage, RunError says so at once. With `waiting` given, that is told so, and this
    process waits for the other: so the points of a sweep share what they have in common.
    """

    root: Path
    waiting: Callable[[str], None] | None = None
    _checked: set[Path] = field(default_factory=set, init=False, repr=False, compare=False)

    def folder(self, stage: str, key: str) -> Path:
        """Where the result of a stage lies, or will."""
        return self.root / f"{stage}-{key}"

    def has(self, stage: str, key: str) -> bool:
        """Whether a stage is done and all its files are as they were then; each folder is read once."""
        folder = self.folder(stage, key)
        if folder not in self._checked and is_whole(folder):
            self._checked.add(folder)
        return folder in self._checked

    def make(self, stage: str, key: str, work: Callable[[Path], None]) -> Path:
        """The folder of a finished stage; `work(folder)` fills it where it does not exist yet.

        Raises
        ------
        RunError : another process is at work on the stage, or the store cannot be written
        """

        def in_one_step(folder: Path) -> Iterator[None]:
            work(folder)
            yield

        for _ in self.make_in_steps(stage, key, in_one_step):
            pass
        return self.folder(stage, key)

    def make_in_steps(self, stage: str, key: str, work: Callable[[Path], Iterator[None]]) -> Iterator[None]:
        """Like `make`, with work that is done bit by bit: the folder is finished when the iterator ends.

        Raises
        ------
        RunError : another process is at work on the stage, or the store cannot be written
        """
        if self.has(stage, key):
            return
        target = self.folder(stage, key)
        with self.lock(stage, key):
            if self.has(stage, key):  # another process may have made it while this one waited
                return
            self._remove(target)
            remove_leftovers(target)
            with publishing(target) as folder:
                _mark(folder, stage, key)
                yield from work(folder)
        self._checked.add(target)

    def begin(self, stage: str, key: str) -> Path:
        """The folder of a stage that is done in parts, each with a manifest of its own.

        Raises
        ------
        RunError : another process is at work on the stage, or the store cannot be written
        """
        folder = self.folder(stage, key)
        with explained(folder):
            folder.mkdir(parents=True, exist_ok=True)
            _mark(folder, stage, key)
        return folder

    def lock(self, stage: str, key: str) -> contextlib.AbstractContextManager[None]:
        """Keep other processes off a stage; if one is at work on it, wait for it or raise RunError at once."""
        return locked(
            lock_file(self.folder(stage, key)),
            lambda owner: (
                f"another granpipe ({owner}) is working on {stage} of this case; "
                + ("waiting for it" if self.waiting else "wait for it, or stop it and run again")
            ),
            self.waiting,
        )

    def in_use(self) -> contextlib.AbstractContextManager[None]:
        """To be held by a run: the store is not cleared meanwhile.

        Raises
        ------
        RunError : another process holds the lock, or the file system has none
        """
        return shared(self.root / ".lock")

    def clear(self) -> tuple[int, list[Path]]:
        """Delete every stage; return the bytes that were freed, and the folders that stay: they hold other files.

        Raises
        ------
        RunError : a run uses the store
        """
        freed, foreign = 0, []
        with locked(self.root / ".lock", lambda _: f"{self.root}: a run uses this store; wait for it, or stop it"):
            for folder in sorted(path for path in self.root.iterdir() if path.is_dir()):
                size = sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())
                try:
                    self._remove(folder)
                    freed += size
                except DataError:
                    foreign.append(folder)
        return freed, foreign

    def _remove(self, folder: Path) -> None:
        """Delete the folder of a stage, finished or not; DataError where granpipe has not made it."""
        if not folder.exists():
            return
        if folder.is_symlink() or not _is_marked(folder):
            raise DataError(f"{folder}: not a stage that granpipe wrote; move it away and run again")
        if foreign := _foreign(folder):
            raise DataError(f"{foreign[0]}: not written by granpipe; move it away and run again")
        shutil.rmtree(folder)


@contextlib.contextmanager
def evidence_kept(work: Path, evidence: Path) -> Iterator[None]:
    """If the block fails, what is in `work` is moved to the folder `evidence`, which the error then names."""
    try:
        yield
    except (RunError, DataError) as error:
        _clear_evidence(evidence)
        shutil.move(work, evidence)
        with contextlib.suppress(OSError, RunError):  # the disk may be full
            write_manifest(evidence)
        error.evidence, error.args = evidence, (f"{error}\nevidence: {evidence}",)
        raise
    _clear_evidence(evidence)


def _clear_evidence(evidence: Path) -> None:
    """Delete what a failed run left; where there are other files among it, all of it is kept under another name."""
    if evidence.is_dir() and _foreign(evidence):
        evidence.rename(evidence.with_name(f"{evidence.name}-{os.urandom(4).hex()}"))
    shutil.rmtree(evidence, ignore_errors=True)


def _foreign(folder: Path) -> list[Path]:
    """Files in a stage or in evidence that granpipe did not write: that no manifest beside or above them lists.

    Where a manifest is damaged, or there is none at all, nothing tells, and all is taken for granpipe's. So are hidden
    files, which it uses for what is not done yet.
    """
    if not (folder / MANIFEST).exists() and not any(folder.glob(f"*/{MANIFEST}")):
        return []
    found: list[Path] = []
    own: set[Path] = set()
    for place, folders, names in os.walk(folder):
        here = Path(place)
        hidden = {name for name in (*folders, *names) if name.startswith(".")}
        folders[:] = [name for name in folders if name not in hidden | (_UNLISTED if here == folder else set())]
        try:
            own |= {here / name for name in read_manifest(here)}
        except DataError:
            if MANIFEST in names:
                folders.clear()
                continue
        found += [here / name for name in names if name not in hidden | {_MARKER, MANIFEST}]
    return [path for path in found if path not in own]


def _mark(folder: Path, stage: str, key: str) -> None:
    (folder / _MARKER).write_text(json.dumps({"stage": stage, "key": key, "granpipe": __version__}))


def _is_marked(folder: Path) -> bool:
    """Whether the marker in a folder of the store says that granpipe made it: the key is part of the folder's name."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        match json.loads(read_bytes(folder / _MARKER, MOST_BYTES)):
            case {"stage": str(stage), "key": str(key)} if stage and key:
                return f"-{key}" in folder.name
    return False
