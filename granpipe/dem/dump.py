"""Reader of LIGGGHTS particle dumps: ``dump custom`` as binary (``.bin``), as text, and as gzipped text.

The binary layout is little-endian without padding. Every snapshot has a header of 100 bytes (step, number of atoms,
triclinic flag, six boundary flags, six box bounds, number of columns, number of chunks); then each rank's chunk
follows as an int32 count of doubles and the doubles, row by row. Column names are not in such a file.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array

OWN_COLUMNS = ("id", "type", "x", "y", "z", "vx", "vy", "vz", "radius")
"""What granpipe's own decks dump."""

_HEADER = struct.Struct("<qqi6i6dii")
_COUNT = struct.Struct("<i")
_MOST_COLUMNS = 1000
_MOST_CHUNKS = 1_000_000
_TEXT_START = b"ITEM:"
_GZIP_START = b"\x1f\x8b"
_BLOCK = 1 << 22  # bytes of text parsed at a time
_LONGEST_LINE = 1 << 16
_GZIP_RATIO = 100  # text dumps shrink 3 to 10 times; a file that promises more than this per byte is not one


@dataclass(frozen=True)
class Snapshot:
    """All particles at one step.

    Parameters
    ----------
    step : time step number of the simulation
    box : (3, 2) low and high bound of the simulation box in x, y, z [m]
    columns : names of the columns
    values : (n, columns) one row per particle, in the file's order (which changes with the rank layout: use `id`)
    """

    step: int
    box: Array
    columns: tuple[str, ...]
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    def column(self, name: str) -> Array:
        """(n,) the named column; the first one where a dump repeats a name."""
        if name not in self.columns:
            raise DataError(f"step {self.step}: the dump has no column '{name}' (it has {', '.join(self.columns)})")
        return np.asarray(self.values[:, self.columns.index(name)])

    def _vector(self, names: tuple[str, str, str]) -> Array:
        return np.column_stack([self.column(name) for name in names])

    @property
    def id(self) -> NDArray[np.int64]:
        """(n,) particle numbers."""
        return self.column("id").astype(np.int64)

    @property
    def position(self) -> Array:
        """(n, 3) centres [m]."""
        return self._vector(("x", "y", "z"))

    @property
    def velocity(self) -> Array:
        """(n, 3) [m/s]."""
        return self._vector(("vx", "vy", "vz"))

    @property
    def radius(self) -> Array:
        """(n,) [m]."""
        return self.column("radius")


def read_dump(path: Path, columns: Sequence[str] | None = None) -> Iterator[Snapshot]:
    """Read the snapshots of one file, in the file's order, one at a time.

    Parameters
    ----------
    path : binary, text or gzipped text dump; told apart by content, not by name
    columns : names of a binary dump's columns (those of granpipe's own decks where None); a text dump names its own,
        and disagreement is an error
    """
    with path.open("rb") as file:
        start = file.read(len(_TEXT_START))
        file.seek(0)
        size = path.stat().st_size
        if not start:
            raise DataError(f"{path}: empty file")
        if start.startswith(_GZIP_START):
            with gzip.open(file) as stream:
                yield from _read_text(_Lines(stream, path), _GZIP_RATIO * size, columns)
        elif start == _TEXT_START:
            yield from _read_text(_Lines(file, path), size, columns)
        else:
            yield from _read_binary(file, path, size, tuple(columns or OWN_COLUMNS))


def read_snapshot(path: Path, columns: Sequence[str] | None = None) -> Snapshot:
    """Read a file that holds exactly one snapshot."""
    snapshots = list(read_dump(path, columns))
    if len(snapshots) != 1:
        raise DataError(f"{path}: holds {len(snapshots)} snapshots where one was expected")
    return snapshots[0]


def read_dumps(paths: Iterable[Path], columns: Sequence[str] | None = None) -> Iterator[Snapshot]:
    """Read several files in the order of their first steps, whatever the order of their names.

    A step that a restarted simulation wrote a second time is passed over; steps that run backwards within a file, or
    files that overlap, are an error.
    """
    last = -1
    for path in sorted(paths, key=first_step):
        for snapshot in read_dump(path, columns):
            if snapshot.step < last:
                raise DataError(
                    f"{path}: step {snapshot.step} comes after step {last}; give the files of one simulation, and of "
                    "files that overlap only one"
                )
            if snapshot.step > last:
                yield snapshot
            last = snapshot.step


def first_step(path: Path) -> int:
    """Step of the first snapshot in a file, from its first bytes alone."""
    if not path.is_file():
        raise DataError(f"{path}: {'a folder' if path.is_dir() else 'no such file'}; give the files of the dumps")
    with path.open("rb") as file:
        start = file.read(len(_TEXT_START))
        file.seek(0)
        if start.startswith(_GZIP_START):
            with gzip.open(file) as stream:
                return _Lines(stream, path).integer_item(b"ITEM: TIMESTEP")
        if start == _TEXT_START:
            return _Lines(file, path).integer_item(b"ITEM: TIMESTEP")
        return _read_header(file, path, path.stat().st_size).step


def is_complete(path: Path) -> bool:
    """Whether a binary dump is wholly written; reads its headers only.

    False for a file that ends early (LIGGGHTS may still be writing it); DataError for one that no more bytes can mend.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        try:
            while file.tell() < size or size == 0:
                header = _read_header(file, path, size)
                for _ in _walk_chunks(file, path, size, header):
                    pass
        except _TruncatedError:
            return False
    return True


# --- binary ---------------------------------------------------------------------------------------------------------


class _TruncatedError(DataError):
    """The file ends before its own header says so."""


class _Header(NamedTuple):
    step: int
    atoms: int
    box: Array
    columns: int
    chunks: int


def _read_exactly(file: BinaryIO, path: Path, size: int, count: int, what: str) -> bytes:
    """Next `count` bytes, or an error that says where they are missing."""
    offset = file.tell()
    if offset + count > size:
        raise _TruncatedError(
            f"{path}: truncated at byte {size}: {what} at byte {offset} needs {count} bytes; "
            "if LIGGGHTS is still writing it, wait; otherwise leave this file out"
        )
    return file.read(count)


def _read_header(file: BinaryIO, path: Path, size: int) -> _Header:
    """Read and check one header: after it, the declared amount of data is known to fit into the file."""
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
    if not (np.isfinite(box).all() and (box[:, 0] <= box[:, 1]).all()):
        raise refuse(f"box bounds {box.tolist()}", 44)
    if not 1 <= columns <= _MOST_COLUMNS:
        raise refuse(f"{columns} columns", 92)
    if not 1 <= chunks <= _MOST_CHUNKS:
        raise refuse(f"{chunks} chunks", 96)
    header = _Header(step, atoms, box, columns, chunks)
    if offset + _snapshot_bytes(header) > size:
        raise _TruncatedError(
            f"{path}: truncated at byte {size}: step {step} at byte {offset} declares {atoms} atoms of {columns} "
            f"columns in {chunks} chunks, {_snapshot_bytes(header)} bytes; if LIGGGHTS is still writing it, wait; "
            "otherwise leave this file out"
        )
    return header


def _snapshot_bytes(header: _Header) -> int:
    return _HEADER.size + _COUNT.size * header.chunks + 8 * header.atoms * header.columns


def _walk_chunks(file: BinaryIO, path: Path, size: int, header: _Header) -> Iterator[tuple[int, int]]:
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


def _read_binary(file: BinaryIO, path: Path, size: int, columns: tuple[str, ...]) -> Iterator[Snapshot]:
    while file.tell() < size:
        header = _read_header(file, path, size)
        if header.columns != len(columns):
            raise DataError(
                f"{path}: step {header.step} has {header.columns} columns, but {len(columns)} names are given "
                f"({','.join(columns)}): name the columns of the dump command in their order"
            )
        values = np.empty(header.atoms * header.columns)
        data = values.view(np.uint8).data
        for first, count in _walk_chunks(file, path, size, header):
            if file.readinto(data[8 * first : 8 * (first + count)]) != 8 * count:  # type: ignore[attr-defined]
                raise DataError(f"{path}: shortened while step {header.step} was read, near byte {file.tell()}")
        yield _checked(Snapshot(header.step, header.box, columns, values.reshape(-1, header.columns)), path)


# --- text -----------------------------------------------------------------------------------------------------------


class _Lines:
    """Lines of a text stream, with the line number for messages; never holds more than a block and a line."""

    def __init__(self, stream: BinaryIO | gzip.GzipFile, path: Path) -> None:
        self.stream, self.path = stream, path
        self.number = 0
        self._buffer = b""
        self._at = 0

    def error(self, message: str) -> DataError:
        return DataError(f"{self.path}:{self.number}: {message}")

    def _fill(self) -> bool:
        """Append a block to what is left of the buffer; False at the end of the file."""
        try:
            block = self.stream.read(_BLOCK)
        except (EOFError, OSError, zlib.error) as error:
            raise self.error(f"the compressed data end early or are damaged ({error})") from error
        self._buffer = self._buffer[self._at :] + block
        self._at = 0
        return bool(block)

    def next(self) -> bytes | None:
        """Next line without its end; None at the end of the file."""
        while (end := self._buffer.find(b"\n", self._at)) < 0:
            if len(self._buffer) - self._at > _LONGEST_LINE:
                raise self.error("a line without end; not a text dump")
            if not self._fill():
                end = len(self._buffer)
                break
        if end == self._at == len(self._buffer):
            return None
        line, self._at = self._buffer[self._at : end], min(end + 1, len(self._buffer))
        self.number += 1
        return line.rstrip(b"\r")

    def at_end(self) -> bool:
        """Whether nothing but blank lines follows."""
        while not self._buffer[self._at :].strip():
            if not self._fill():
                return True
        return False

    def required(self, what: str) -> bytes:
        line = self.next()
        if line is None:
            raise self.error(f"the file ends where {what} should follow: truncated")
        return line

    def item(self, head: bytes) -> bytes:
        """The rest of the next line, which must begin with `head`."""
        line = self.required(f"'{head.decode()}'")
        if not line.startswith(head):
            raise self.error(f"expected '{head.decode()}', found '{line[:40].decode(errors='replace')}'")
        return line[len(head) :].strip()

    def integer_item(self, head: bytes) -> int:
        """The whole number on the line below `head`."""
        self.item(head)
        line = self.required("a number")
        if not line.strip().isdigit() or len(line) > 20:
            raise self.error(f"expected a whole number, found '{line[:40].decode(errors='replace')}'")
        return int(line)

    def rows(self, count: int, columns: int) -> Array:
        """(count, columns) the numbers on the next `count` lines."""
        parts: list[Array] = []
        while count:
            if not (end := self._end_of_lines(count)):
                raise self.error(f"the file ends {count} atoms early: truncated")
            lines = self._buffer.count(b"\n", self._at, end)
            parts.append(self._parse(self._buffer[self._at : end], lines, columns))
            self._at, self.number, count = end, self.number + lines, count - lines
        return np.concatenate(parts) if parts else np.empty((0, columns))

    def _end_of_lines(self, count: int) -> int:
        """Position behind the last whole line in the buffer, at most `count` lines on; 0 where there is none."""
        while (end := self._buffer.rfind(b"\n", self._at) + 1) <= self._at:
            if len(self._buffer) - self._at > _LONGEST_LINE:
                raise self.error("a line without end; not a text dump")
            if not self._fill():
                if self._at == len(self._buffer):
                    return 0
                self._buffer += b"\n"  # a last line without its end
        if self._buffer.count(b"\n", self._at, end) > count:
            breaks = np.flatnonzero(np.frombuffer(self._buffer, np.uint8, end - self._at, self._at) == 10)
            end = self._at + int(breaks[count - 1]) + 1
        return end

    def _parse(self, text: bytes, lines: int, columns: int) -> Array:
        if not text.strip():
            raise self.error(f"{lines} lines of {columns} numbers expected below, found blank ones")
        try:
            values = np.loadtxt(text.decode("ascii").splitlines(), ndmin=2, comments=None)
        except ValueError as error:
            raise self.error(f"the numbers below this line cannot be read ({error})") from error
        if values.shape != (lines, columns):
            raise self.error(f"{lines} lines of {columns} numbers expected below, found {values.shape}")
        return values


def _read_text(lines: _Lines, most_bytes: int, columns: Sequence[str] | None) -> Iterator[Snapshot]:
    """Read ``ITEM:`` snapshots; `most_bytes` bounds what the file can hold, against absurd counts."""
    while True:
        step = lines.integer_item(b"ITEM: TIMESTEP")
        atoms = lines.integer_item(b"ITEM: NUMBER OF ATOMS")
        box = _text_box(lines)
        names = tuple(lines.item(b"ITEM: ATOMS").decode(errors="replace").split())
        if not names:
            raise lines.error("the dump does not name its columns: too old a format")
        if columns is not None and tuple(columns) != names:
            raise lines.error(f"the dump's columns are {','.join(names)}, not {','.join(columns)} as given")
        if 2 * atoms * len(names) > most_bytes + 1:
            raise lines.error(f"{atoms} atoms of {len(names)} columns do not fit into a file of this size: damaged")
        yield _checked(Snapshot(step, box, names, lines.rows(atoms, len(names))), lines.path)
        if lines.at_end():
            return


def _text_box(lines: _Lines) -> Array:
    """(3, 2) box bounds."""
    if b"xy" in lines.item(b"ITEM: BOX BOUNDS").split():
        raise lines.error("triclinic box; only orthogonal boxes are read")
    bounds = [lines.required("a box bound").split() for _ in range(3)]
    try:
        return np.array([[float(low), float(high)] for low, high in bounds])
    except ValueError as error:
        raise lines.error(f"the three box bounds above cannot be read ({error})") from error


# --- both -----------------------------------------------------------------------------------------------------------


def _checked(snapshot: Snapshot, path: Path) -> Snapshot:
    """Refuse values that no dump has: mostly a sign that the columns are named in another order than dumped."""
    where = f"{path}: step {snapshot.step}"
    remedy = "are the columns named in the order of the dump command?"
    with np.errstate(over="ignore", invalid="ignore"):
        suspicious = not np.isfinite(snapshot.values.sum())  # one fast pass; a huge but finite column also ends here
    if suspicious:
        for name in ("id", "x", "y", "z", "vx", "vy", "vz", "radius"):
            if name in snapshot.columns and not np.isfinite(snapshot.column(name)).all():
                raise DataError(f"{where}: column '{name}' is not finite everywhere; {remedy}")
    if "radius" in snapshot.columns and len(snapshot) and snapshot.column("radius").min() <= 0:
        raise DataError(f"{where}: column 'radius' is not positive everywhere; {remedy}")
    if "id" in snapshot.columns:
        number = snapshot.column("id").copy()  # in one piece
        if len(number) and (number.min() < 1 or number.max() >= 2**53 or (number != np.floor(number)).any()):
            raise DataError(f"{where}: column 'id' does not hold whole numbers from 1; {remedy}")
    return snapshot
