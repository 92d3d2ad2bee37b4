"""Folders that appear whole by one rename, and results folders of which only granpipe's own files are renewed."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

from granpipe.errors import RunError
from granpipe.system.files import (
    check_space,
    digest,
    explained,
    flush,
    flush_tree,
    leftovers,
    remove_leftovers,
    replace_whole,
    unique,
)
from granpipe.system.locks import locked
from granpipe.system.manifest import MANIFEST, MOST_BYTES, write_manifest
from granpipe.system.reading import read_bytes


@contextlib.contextmanager
def publishing(target: Path) -> Iterator[Path]:
    """A temporary folder that becomes `target` by one rename if the block succeeds, and vanishes otherwise.

    Its manifest is written, and everything is on the disk, before the rename.

    Raises
    ------
    RunError : `target` exists by then, or the disk is full or not writable
    """
    with explained(target):
        aside = unique(target, ".part")
        try:
            aside.mkdir(parents=True)
            check_space(aside)
            yield aside
            write_manifest(aside)
            flush_tree(aside)
            _rename(aside, target)
            flush(target.parent)
        finally:
            shutil.rmtree(aside, ignore_errors=True)


@contextlib.contextmanager
def publishing_new(target: Path) -> Iterator[Path]:
    """Like `publishing`, for a folder that a user names: one process at a time, and only where nothing is yet.

    Raises
    ------
    RunError : something is there
    """
    _check_new(target)
    with locked(lock_file(target), lambda owner: f"{owner} is writing {target}; wait for it"):
        _check_new(target)
        remove_leftovers(target)
        with publishing(target) as folder:
            yield folder


def _check_new(target: Path) -> None:
    if os.path.lexists(target):
        raise RunError(f"{target} exists already; choose another --out")


def lock_file(target: Path) -> Path:
    """The lock of a folder, beside it."""
    return target.with_name(f".{target.name}.lock")


@contextlib.contextmanager
def renewing(target: Path, note: Callable[[str], None]) -> Iterator[Path]:
    """A temporary folder whose files take the place of those that granpipe wrote into `target` earlier.

    Files of the user's stay where they are, symbolic links stay links. A file of granpipe's that was changed since is
    kept under another name, and `note` is told so. For the process that holds `lock_file(target)`.

    Raises
    ------
    RunError : the disk is full or not writable
    """
    if not target.exists():
        remove_leftovers(target)
        with publishing(target) as folder:
            yield folder
        return
    with explained(target):
        aside = unique(target / "granpipe", ".part")
        try:
            aside.mkdir()
            check_space(aside)
            yield aside
            write_manifest(aside)
            flush_tree(aside)
        except BaseException:
            shutil.rmtree(aside, ignore_errors=True)
            raise
        _merge(aside, target, note)  # should it be interrupted, the manifest aside still tells what is granpipe's
        for left in _journals(target):
            shutil.rmtree(left, ignore_errors=True)


def _merge(aside: Path, target: Path, note: Callable[[str], None]) -> None:
    written = _written(target)
    names = sorted(path.relative_to(aside).as_posix() for path in aside.rglob("*") if path.is_file())
    names.remove(MANIFEST)
    for name in names:
        _put(aside / name, target, name, written[name], note)
    for name in sorted(written.keys() - {*names, MANIFEST}):
        _remove(target, name, written[name], note)
    manifest = Path(os.path.realpath(target / MANIFEST))
    if manifest.is_dir():
        _keep(manifest, note)
    replace_whole(aside / MANIFEST, manifest)


def _written(target: Path) -> defaultdict[str, set[str]]:
    """Name → hashes under which granpipe has written it into a folder, also when it was interrupted in doing so."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for folder in (target, *_journals(target)):
        with contextlib.suppress(OSError, ValueError, RecursionError):
            match json.loads(read_bytes(folder / MANIFEST, MOST_BYTES)):
                case {"files": dict(files)}:
                    for name, sha256 in files.items():
                        if isinstance(sha256, str) and not {"", ".", ".."} & {*name.split("/")}:
                            found[name].add(sha256)
    return found


def _journals(target: Path) -> list[Path]:
    return leftovers(target / "granpipe")


def _put(source: Path, target: Path, name: str, written: set[str], note: Callable[[str], None]) -> None:
    """Move a file to its place below `target`, which others' files and folders are moved out of."""
    place = target
    for part in name.split("/")[:-1]:
        place /= part
        if os.path.lexists(place) and not place.is_dir():
            _keep(place, note)
        place.mkdir(exist_ok=True)
    path = Path(os.path.realpath(target / name))
    if os.path.lexists(path) and not _is_ours(path, {*written, digest(source)}):
        _keep(path, note)
    replace_whole(source, path)


def _is_ours(path: Path, written: set[str]) -> bool:
    """Whether a file is as granpipe wrote it, or empty: nothing is lost with it."""
    return path.is_file() and (path.stat().st_size == 0 or digest(path) in written)


def _keep(path: Path, note: Callable[[str], None]) -> None:
    """Give a file or folder that is not granpipe's another name."""
    number = 1
    while os.path.lexists(kept := path.with_name(f"{path.stem}.changed-{number}{path.suffix}")):
        number += 1
    path.rename(kept)
    note(f"note: {path} is not as granpipe wrote it; it is kept as {kept.name}")


def _remove(target: Path, name: str, written: set[str], note: Callable[[str], None]) -> None:
    """Remove a file of an earlier run, and the folders that become empty."""
    path = target / name
    if not path.is_file():
        return
    if path.is_symlink() or not _is_ours(path, written):
        note(f"note: {path} is of an earlier run, but no longer as granpipe wrote it; it stays")
        return
    path.unlink()
    with contextlib.suppress(OSError):
        for parent in path.relative_to(target).parents[:-1]:
            (target / parent).rmdir()


def _rename(folder: Path, target: Path) -> None:
    try:
        folder.rename(target)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise RunError(f"{target} has appeared meanwhile; move it away and run again") from error
        raise
