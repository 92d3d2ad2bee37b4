"""Binary dumps of LIGGGHTS (``dump custom … FILE*.bin``): little-endian without padding.

Every snapshot has a header of 100 bytes (step, number of atoms, triclinic flag, six boundary flags, six box bounds,
number of columns, number of chunks); then each rank's chunk follows as an int32 count of doubles and the doubles, row
by row. Column names are not in such a file.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

import numpy as np

from granpipe.dem.snapshot import Periodic, Snapshot, TruncatedError, with_standard_columns
from granpipe.errors import DataError
from granpipe.field import Array

_HEADER = struct.Struct("<qqi6i6dii")
_COUNT = struct.Struct("<i")
_MOST_COLUMNS = 1000
_MOST_CHUNKS = 1_000_000


def is_complete(path: Path) -> bool:
    """Whether a binary dump is wholly written; reads its headers only.

    False for a file that ends early: LIGGGHTS may still be writing it.

    Raises
    ------
    DataError : the file is damaged in a way that no more bytes can mend
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        try:
            while file.tell() < size or size == 0:
                header = _read_header(file, path, size)
                for _ in _walk_chunks(file, path, size, header):
                    pass
        except TruncatedError:
            return False
    return True


def begins_binary(start: bytes) -> bool:
    """Whether the first bytes of a file, at least 100, are those of a binary dump: any step may stand there."""
    if len(start) < _HEADER.size:
        return False
    raw = _HEADER.unpack_from(start)
    return raw[2] in (0, 1) and all(0 <= flag <= 3 for flag in raw[3:9]) and 1 <= raw[15] <= _MOST_COLUMNS


def first_binary_step(file: BufferedReader, path: Path) -> int:
    """Step of the first snapshot.

    Raises
    ------
    DataError : the file is no binary dump, or damaged
    """
    return _read_header(file, path, path.stat().st_size).step


def read_binary(file: BufferedReader, path: Path, columns: tuple[str, ...], last_step: float) -> Iterator[Snapshot]:
    """Snapshots of a file up to a step; see `granpipe.dem.dump.read_dump`.

    Raises
    ------
    DataError : the file is no binary dump, damaged, or has other columns than those named
    """
    size = path.stat().st_size
    while file.tell() < size:
        header = _read_header(file, path, size, last_step)
        if header.step > last_step:
            return
        if header.columns != len(columns):
            raise DataError(
                f"{path}: step {header.step} has {header.columns} columns, but {len(columns)} names are given "
                f"({','.join(columns)}): name the columns of the dump command in their order"
            )
        values = np.empty(header.atoms * header.columns)
        data = values.view(np.uint8).data
        for first, count in _walk_chunks(file, path, size, header):
            if file.readinto(data[8 * first : 8 * (first + count)]) != 8 * count:
                raise DataError(f"{path}: shortened while step {header.step} was read, near byte {file.tell()}")
        snapshot = Snapshot(header.step, header.box, columns, values.reshape(-1, header.columns))
        yield with_standard_columns(snapshot, f"{path}: step {header.step}", header.periodic)


class _Header(NamedTuple):
    step: int
    atoms: int
    box: Array
    periodic: Periodic
    columns: int
    chunks: int


def _read_exactly(file: BufferedReader, path: Path, size: int, count: int, what: str) -> bytes:
    """Next `count` bytes, or an error that says where they are missing."""
    offset = file.tell()
    if offset + count > size:
        raise TruncatedError(
            f"{path}: truncated at byte {size}: {what} at byte {offset} needs {count} bytes; "
            "if LIGGGHTS is still writing it, wait; otherwise leave this file out"
        )
    return file.read(count)


def _read_header(file: BufferedReader, path: Path, size: int, last_step: float = math.inf) -> _Header:
    """Read and check one header: after it, the data of a step up to the last one are known to fit into the file."""
    offset = file.tell()
    raw = _HEADER.unpack(_read_exactly(file, path, size, _HEADER.size, "a header"))
    step, atoms, triclinic = raw[:3]
    boundary, box, columns, chunks = raw[3:9], np.array(raw[9:15]).reshape(3, 2), raw[15], raw[16]

    def refuse(why: str, byte: int) -> DataError:
        return DataError(f"{path}: {why} (byte {offset + byte}); not a binary dump of LIGGGHTS, or damaged")

    if step < 0:
        raise DataError(
            f"{path}: negative step {step} (byte {offset}): damaged, or the binary layout of newer LAMMPS versions, "
            "which is not read here: dump text instead"
        )
    if atoms < 0:
        raise refuse(f"{atoms} atoms", 8)
    if triclinic == 1:
        raise DataError(f"{path}: triclinic box (byte {offset + 16}); only orthogonal boxes are read")
    if triclinic != 0:
        raise refuse(f"triclinic flag {triclinic}", 16)
    if not all(0 <= flag <= 3 for flag in boundary):
        raise refuse(f"boundary flags {boundary}", 20)
    if not (np.isfinite(box).all() and (box[:, 0] < box[:, 1]).all()):
        raise refuse(f"box bounds {box.tolist()}", 44)
    if not 1 <= columns <= _MOST_COLUMNS:
        raise refuse(f"{columns} columns", 92)
    if not 1 <= chunks <= _MOST_CHUNKS:
        raise refuse(f"{chunks} chunks", 96)
    periodic = boundary[0] == 0, boundary[2] == 0, boundary[4] == 0
    header = _Header(step, atoms, box, periodic, columns, chunks)
    if step <= last_step and offset + _snapshot_bytes(header) > size:
        raise TruncatedError(
            f"{path}: truncated at byte {size}: step {step} at byte {offset} declares {atoms} atoms of {columns} "
            f"columns in {chunks} chunks, {_snapshot_bytes(header)} bytes; if LIGGGHTS is still writing it, wait; "
            "otherwise leave this file out"
        )
    return header


def _snapshot_bytes(header: _Header) -> int:
    return _HEADER.size + _COUNT.size * header.chunks + 8 * header.atoms * header.columns


def _walk_chunks(file: BufferedReader, path: Path, size: int, header: _Header) -> Iterator[tuple[int, int]]:
    """Yield (first double, number of doubles) of each chunk with the file at its data; leaves the file behind it."""
    wanted, found = header.atoms * header.columns, 0
    for chunk in range(header.chunks):
        offset = file.tell()
        (count,) = _COUNT.unpack(_read_exactly(file, path, size, _COUNT.size, f"the count of chunk {chunk + 1}"))
        if count < 0 or count % header.columns or found + count > wanted:
            raise DataError(
                f"{path}: chunk {chunk + 1} of step {header.step} claims {count} numbers (byte {offset}), but "
                f"{wanted - found} of {header.atoms} atoms times {header.columns} columns remain: damaged"
            )
        data = file.tell()
        yield found, count
        file.seek(data + 8 * count)
        found += count
    if found != wanted:
        raise DataError(
            f"{path}: the chunks of step {header.step} hold {found} numbers, its header says {header.atoms} atoms "
            f"times {header.columns} columns (byte {file.tell()}): damaged"
        )
