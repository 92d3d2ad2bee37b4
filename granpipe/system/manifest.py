"""``manifest.json``: the files that granpipe wrote into a folder, with their hashes.

What it lists may be replaced or removed while its hash is unchanged; everything else in the folder is the user's.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from granpipe.errors import DataError
from granpipe.system.files import digest, write_whole
from granpipe.system.reading import read_bytes

MANIFEST = "manifest.json"
MOST_BYTES = 100_000_000


def write_manifest(folder: Path) -> dict[str, str]:
    """List every file below a folder; name → SHA-256."""
    paths = sorted(Path(place) / name for place, _, names in os.walk(folder) for name in names)
    files = {path.relative_to(folder).as_posix(): digest(path) for path in paths}
    files.pop(MANIFEST, None)
    write_whole(folder / MANIFEST, json.dumps({"files": files, "sha256": _seal(files)}, indent=1) + "\n")
    return files


def read_manifest(folder: Path) -> dict[str, str]:
    """Name → SHA-256 of what granpipe wrote into a folder.

    Raises
    ------
    DataError : there is no manifest, or it is damaged
    """
    path = folder / MANIFEST
    try:
        match json.loads(read_bytes(path, MOST_BYTES)):
            case {"files": dict(files), "sha256": str(seal)} if seal == _seal(files):
                return files
    except FileNotFoundError:
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder; pass the results folder of a completed run") from None
        raise DataError(f"{folder}: not a folder that granpipe wrote: it has no {MANIFEST}") from None
    except (OSError, ValueError, TypeError, RecursionError):
        pass
    raise DataError(f"{path}: damaged")


def has_manifest(folder: Path) -> bool:
    """Whether there is a whole manifest in a folder."""
    try:
        read_manifest(folder)
    except DataError:
        return False
    return True


def changed_files(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """Those of the files (by default all that granpipe wrote) that are missing or not as granpipe wrote them.

    Raises
    ------
    DataError : there is no manifest, or it is damaged
    """
    files = read_manifest(folder)
    return [name for name in (files if names is None else names) if not is_unchanged(folder / name, files.get(name))]


def is_whole(folder: Path, names: Iterable[str] | None = None) -> bool:
    """Whether files (by default all that granpipe wrote into a folder) are there and as it wrote them."""
    try:
        return not changed_files(folder, names)
    except DataError:
        return False


def verify(folder: Path, *names: str) -> None:
    """Make sure that files, or all that granpipe wrote into a folder, are as it wrote them.

    Raises
    ------
    DataError : the folder is not granpipe's, or a file is missing or changed
    """
    if changed := changed_files(folder, names or None):
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise DataError(
            f"{folder / changed[0]}{more}: missing, damaged or changed since granpipe wrote it; run the case again"
        )


def is_unchanged(path: Path, sha256: str | None) -> bool:
    """Whether there is a regular file with this hash."""
    try:
        return sha256 is not None and path.is_file() and digest(path) == sha256
    except OSError:
        return False


def _seal(files: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()
