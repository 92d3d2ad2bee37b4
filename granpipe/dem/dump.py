"""Particle dumps of LIGGGHTS, whatever their format: binary, text, gzipped text, VTK."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path
from typing import Literal

import numpy as np

from granpipe.dem.dump_binary import begins_binary, first_binary_step, read_binary
from granpipe.dem.dump_text import first_text_step, read_text
from granpipe.dem.dump_vtk import VTK_START, read_vtk, vtk_step
from granpipe.dem.snapshot import OWN_COLUMNS, READ_COLUMNS, Snapshot
from granpipe.errors import DataError

_TEXT_START = b"ITEM:"
_GZIP_START = b"\x1f\x8b"
_OTHERS = {
    b"BZh": "compressed by bzip2: unpack it with bunzip2 first",
    b"\x28\xb5\x2f\xfd": "compressed by zstd: unpack it with unzstd first",
    b"\xfd7zXZ": "compressed by xz: unpack it with unxz first",
    b"PK\x03\x04": "a zip archive: unpack it first",
    b"\x89HDF": "an HDF5 file: dump binary, text or VTK",
    b"\xef\xbb\xbf": "text that begins with a byte order mark (BOM): save it without one",
    b"\xff\xfe": "text in UTF-16: save it as plain ASCII",
    b"\xfe\xff": "text in UTF-16: save it as plain ASCII",
    b"<": "XML, as .vtp and .vtu files are: dump custom/vtk to files that end on .vtk",
}
_HEAD = 512  # bytes by which a format is told
_SAME = 1e-3  # of the largest in a column: so much may a value differ that was written before and after a restart


def read_dump(path: Path, columns: Sequence[str] | None = None, last_step: float = math.inf) -> Iterator[Snapshot]:
    """Read the snapshots of one file, in the file's order, one at a time.

    Parameters
    ----------
    path : the file; its format is told by content, not by name
    columns : names of a binary dump's columns (those of granpipe's own decks where None); a text dump names its own,
        and disagreement is an error
    last_step : reading ends there, and damage behind it is not seen

    Raises
    ------
    DataError : not a dump, damaged or truncated
    """
    with _opened(path) as file:
        match _format(file, path):
            case "binary":
                yield from read_binary(file, path, tuple(columns or OWN_COLUMNS), last_step)
            case "vtk":
                yield from [read_vtk(path)] if vtk_step(path) <= last_step else []
            case kind:
                yield from read_text(file, path, kind == "gzip", columns, last_step)


def read_snapshot(path: Path, columns: Sequence[str] | None = None) -> Snapshot:
    """Read a file that holds exactly one snapshot; DataError where it holds none or several."""
    snapshots = list(read_dump(path, columns))
    if len(snapshots) != 1:
        raise DataError(f"{path}: holds {len(snapshots)} snapshots where one was expected")
    return snapshots[0]


def read_dumps(
    paths: Iterable[Path], columns: Sequence[str] | None = None, last_step: float = math.inf
) -> Iterator[Snapshot]:
    """Read several files in the order of their first steps, whatever the order of their names.

    A step that a restarted simulation wrote a second time is passed over, where it holds the same particles. The files
    of the box that ``dump custom/vtk`` writes beside its dumps are left out. Files whose first step cannot be read come
    last.

    Raises
    ------
    DataError : steps run backwards within a file, files overlap, or a step is there twice with other particles; or see
        `read_dump`
    """
    last = -1
    before: Snapshot | None = None
    for path in sorted((path for path in paths if "boundingBox" not in path.name), key=_sorting_step):
        for snapshot in read_dump(path, columns, last_step):
            if snapshot.step < last:
                raise DataError(
                    f"{path}: step {snapshot.step} comes after step {last}; give the files of one simulation, and of "
                    "files that overlap only one"
                )
            if before is not None and snapshot.step == last:
                if not _alike(before, snapshot):
                    raise DataError(
                        f"{path}: step {last} is there twice, with other particles; give the files of one simulation"
                    )
                continue
            yield snapshot
            before, last = snapshot, snapshot.step
            if last >= last_step:
                return


def _alike(one: Snapshot, other: Snapshot) -> bool:
    """Whether two snapshots hold the same particles, in any order, but for what a restart rounds."""
    if one.columns != other.columns or len(one) != len(other):
        return False
    read = [at for at, name in enumerate(one.columns) if name in READ_COLUMNS]  # forces are not known yet
    first, second = (snapshot.values for snapshot in (one, other))
    if "id" in one.columns:
        at = one.columns.index("id")
        first, second = (values[np.argsort(values[:, at], kind="stable")] for values in (first, second))
    first, second = first[:, read], second[:, read]
    scale = np.abs(first).max(axis=0, initial=0.0)
    return bool((np.abs(first - second) <= _SAME * scale).all())


def first_step(path: Path) -> int:
    """Step of the first snapshot in a file, from its first bytes alone; DataError where it has none."""
    with _opened(path) as file:
        match _format(file, path):
            case "binary":
                return first_binary_step(file, path)
            case "vtk":
                return vtk_step(path)
            case kind:
                return first_text_step(file, path, kind == "gzip")


def _sorting_step(path: Path) -> float:
    with _opened(path):
        pass  # a file that is not there is no damage
    try:
        return first_step(path)
    except DataError:
        return math.inf


def _opened(path: Path) -> BufferedReader:
    if not path.is_file():
        what = "a folder" if path.is_dir() else "not a regular file" if path.exists() else "no such file"
        raise DataError(f"{path}: {what}; give the files of the dumps")
    return path.open("rb")


def _format(file: BufferedReader, path: Path) -> Literal["binary", "text", "gzip", "vtk"]:
    """The format of a file, told by its first bytes; the file stands at its beginning again."""
    start = file.read(_HEAD)
    file.seek(0)
    if not start:
        raise DataError(f"{path}: empty file")
    if begins_binary(start):
        return "binary"
    if start.startswith(_GZIP_START):
        return "gzip"
    if start.startswith(_TEXT_START):
        return "text"
    if start.startswith(VTK_START):
        return "vtk"
    for other, what in _OTHERS.items():
        if start.startswith(other):
            raise DataError(f"{path}: {what}")
    first_line = start.split(b"\n")[0]
    if first_line.isascii() and first_line.decode("ascii").rstrip("\r").isprintable():
        if any(mark in first_line for mark in (b",", b";", b"\t")):
            raise DataError(f"{path}: CSV or another table; dump text (ITEM: TIMESTEP …), binary or VTK")
        if len(first_line) < len(start) or len(start) < _HEAD:
            raise DataError(f"{path}: begins with '{first_line[:40].decode()}'; text dumps begin with ITEM: TIMESTEP")
    return "binary"
