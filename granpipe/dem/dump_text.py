"""Text dumps of LIGGGHTS and LAMMPS (``ITEM: TIMESTEP`` …), plain or gzipped."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from granpipe.dem.snapshot import READ_COLUMNS, Periodic, Snapshot, TruncatedError, with_standard_columns
from granpipe.errors import DataError
from granpipe.field import Array

_BLOCK = 1 << 22  # bytes of text parsed at a time
_LONGEST_LINE = 1 << 16
_GZIP_RATIO = 100  # text dumps shrink 3 to 10 times; a file that promises more than this per byte is not one


def first_text_step(file: io.BufferedReader, path: Path, gzipped: bool) -> int:
    """Step of the first snapshot."""
    with _stream(file, gzipped) as stream:
        return _read_step(_Lines(stream, path)).step


def read_text(
    file: io.BufferedReader, path: Path, gzipped: bool, columns: Sequence[str] | None, last_step: float
) -> Iterator[Snapshot]:
    """Snapshots of a file up to a step; see `granpipe.dem.dump.read_dump`.

    Raises
    ------
    DataError : the file is no text dump, or damaged
    """
    most_bytes = path.stat().st_size * (_GZIP_RATIO if gzipped else 1)  # what the file can hold, against absurd counts
    with _stream(file, gzipped) as stream:
        lines = _Lines(stream, path)
        while True:
            head = _read_step(lines)
            if head.step > last_step:
                return
            yield _read_snapshot(lines, head, most_bytes, columns)
            if lines.at_end():
                return


def _stream(file: io.BufferedReader, gzipped: bool) -> io.BufferedIOBase:
    return gzip.open(file) if gzipped else file


class _Head(NamedTuple):
    step: int
    time: float | None


def _read_step(lines: _Lines) -> _Head:
    """Read up to the step; units and time may stand before it (``dump_modify units yes time yes`` of LAMMPS)."""
    time = None
    line = lines.required("'ITEM: TIMESTEP'")
    if line.startswith(b"ITEM: UNITS"):
        units = lines.required("the units").strip().decode(errors="replace")
        if units != "si":
            raise lines.error(f"the dump is in units '{units[:40]}'; only SI units are read: run with 'units si'")
        line = lines.required("'ITEM: TIMESTEP'")
    if line.startswith(b"ITEM: TIME") and not line.startswith(b"ITEM: TIMESTEP"):
        time = lines.number_below()
        line = lines.required("'ITEM: TIMESTEP'")
    lines.check_item(line, b"ITEM: TIMESTEP")
    return _Head(lines.integer(), time)


def _read_snapshot(lines: _Lines, head: _Head, most_bytes: int, columns: Sequence[str] | None) -> Snapshot:
    lines.item(b"ITEM: NUMBER OF ATOMS")
    atoms = lines.integer()
    box, periodic = _read_box(lines)
    names = tuple(lines.item(b"ITEM: ATOMS").decode(errors="replace").split())
    if not names:
        raise lines.error("the dump does not name its columns: too old a format")
    if columns is not None and tuple(columns) != names:
        raise lines.error(f"the dump's columns are {','.join(names)}, not {','.join(columns)} as given")
    if 2 * atoms * len(names) > most_bytes + 1:
        raise lines.error(
            f"step {head.step}: {atoms} atoms of {len(names)} columns do not fit into a file of this size: "
            "truncated or damaged"
        )
    snapshot = Snapshot(head.step, box, names, lines.rows(atoms, names, head.step), head.time)
    return with_standard_columns(snapshot, f"{lines.path}: step {head.step}", periodic)


def _read_box(lines: _Lines) -> tuple[Array, Periodic]:
    """(3, 2) box bounds, and in which directions it is periodic."""
    flags = lines.item(b"ITEM: BOX BOUNDS").split()
    if b"xy" in flags:
        raise lines.error("triclinic box; only orthogonal boxes are read")
    bounds = [lines.required("a box bound").split() for _ in range(3)]
    try:
        box = np.array([[float(low), float(high)] for low, high in bounds])
    except ValueError as error:
        raise lines.error(f"the three box bounds above cannot be read ({error})") from error
    if not (np.isfinite(box).all() and (box[:, 0] < box[:, 1]).all()):
        raise lines.error(f"the box bounds above, {box.tolist()}, leave no room: damaged")
    along_x, along_y, along_z = [*(flag == b"pp" for flag in flags), False, False, False][:3]
    return box, (along_x, along_y, along_z)


class _Lines:
    """Lines of a text stream, with the line number for messages; never holds more than a block and a line."""

    def __init__(self, stream: io.BufferedIOBase, path: Path) -> None:
        self.stream, self.path = stream, path
        self.number = 0
        self._unended = False  # the last line lacks its end
        self._buffer = b""
        self._at = 0

    def error(self, message: str) -> DataError:
        return DataError(f"{self.path}:{self.number}: {message}")

    def _fill(self) -> bool:
        """Append a block to what is left of the buffer; False at the end of the file."""
        try:
            block = self.stream.read1(_BLOCK)  # what comes before damage, before the damage is met
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
            if len(self._buffer) - self._at > _LONGEST_LINE:
                raise self.error("blank lines without end: damaged")
            if not self._fill():
                return True
        return False

    def truncated(self, what: str) -> TruncatedError:
        return TruncatedError(
            f"{self.path}:{self.number}: truncated: {what}; if LIGGGHTS is still writing it, wait; otherwise leave the "
            "last snapshot out (--stop)"
        )

    def required(self, what: str) -> bytes:
        line = self.next()
        if line is None:
            raise self.truncated(f"the file ends where {what} should follow")
        return line

    def item(self, head: bytes) -> bytes:
        """The rest of the next line, which must begin with `head`."""
        return self.check_item(self.required(f"'{head.decode()}'"), head)

    def check_item(self, line: bytes, head: bytes) -> bytes:
        """The rest of a line, which must begin with `head`."""
        if not line.startswith(head):
            raise self.error(f"expected '{head.decode()}', found '{line[:40].decode(errors='replace')}'")
        return line[len(head) :].strip()

    def number_below(self) -> float:
        """The number on the next line."""
        line = self.required("a number")
        try:
            return float(line)
        except ValueError:
            raise self.error(f"expected a number, found '{line[:40].decode(errors='replace')}'") from None

    def integer(self) -> int:
        """The whole number on the next line."""
        line = self.required("a number")
        if not line.strip().isdigit() or len(line) > 20:
            raise self.error(f"expected a whole number, found '{line[:40].decode(errors='replace')}'")
        return int(line)

    def rows(self, count: int, names: tuple[str, ...], step: int) -> Array:
        """(count, columns) the numbers on the next `count` lines."""
        parts: list[Array] = []
        missing = count
        while missing:
            if not (end := self._end_of_lines(missing)):
                raise self.truncated(f"the file ends after {count - missing} of {count} atoms of step {step}")
            text = self._buffer[self._at : end]
            lines = text.count(b"\n")
            if self._unended:  # what is left of a number is a number, too
                self.number += lines
                raise self.truncated(
                    f"the last row of step {step} has no line end, it may be cut in a number; add one if it is whole"
                )
            parts.append(self._parse(text, lines, names))
            self._at, self.number, missing = end, self.number + lines, missing - lines
        return np.concatenate(parts) if parts else np.empty((0, len(names)))

    def _end_of_lines(self, count: int) -> int:
        """Position behind the last whole line in the buffer, at most `count` lines on; 0 where there is none."""
        while (end := self._buffer.rfind(b"\n", self._at) + 1) <= self._at:
            if len(self._buffer) - self._at > _LONGEST_LINE:
                raise self.error("a line without end; not a text dump")
            if not self._fill():
                if self._at == len(self._buffer):
                    return 0
                self._buffer += b"\n"
                self._unended = True
        if self._buffer.count(b"\n", self._at, end) > count:
            breaks = np.flatnonzero(np.frombuffer(self._buffer, np.uint8, end - self._at, self._at) == 10)
            end = self._at + int(breaks[count - 1]) + 1
        return end

    def _parse(self, text: bytes, lines: int, names: tuple[str, ...]) -> Array:
        """(lines, columns) numbers; nan in columns of text that nobody reads."""
        if not text.strip():
            raise self.error(f"{lines} lines of {len(names)} numbers expected below, found blank ones")
        first = text[: text.index(b"\n")].split()
        read = [at for at, word in enumerate(first) if _is_number(word) or names[at : at + 1] in _READ]
        if len(first) != len(names):
            read = list(range(len(first)))
        try:
            rows = text.decode("ascii").splitlines()
            columns = None if len(read) == len(first) else read
            values = np.loadtxt(rows, ndmin=2, comments=None, usecols=columns)
        except ValueError as error:
            raise self.error(f"the numbers below this line cannot be read ({error})") from error
        if values.shape != (lines, len(read)) or len(first) != len(names):
            raise self.error(f"{lines} lines of {len(names)} numbers expected below, found {values.shape}")
        if columns is None:
            return values
        whole = np.full((lines, len(names)), np.nan)
        whole[:, read] = values
        return whole


_READ = {(name,) for name in READ_COLUMNS}


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
