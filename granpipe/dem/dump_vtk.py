"""VTK dumps of LIGGGHTS (``dump custom/vtk … FILE*.vtk``) and of its converter: particles as points of a legacy file.

Read here, not by the VTK library, which crashes on damaged files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from granpipe.dem.snapshot import Snapshot, TruncatedError, with_standard_columns
from granpipe.errors import DataError
from granpipe.field import Array

VTK_START = b"# vtk DataFile"

_TYPES = {
    "char": ">i1", "unsigned_char": ">u1", "short": ">i2", "unsigned_short": ">u2", "int": ">i4", "unsigned_int": ">u4",
    "long": ">i8", "unsigned_long": ">u8", "vtkidtype": ">i4", "vtktypeint64": ">i8", "float": ">f4", "double": ">f8",
}  # fmt: skip
_CELLS = {"VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS"}
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9}


def vtk_step(path: Path) -> int:
    """The last whole number in the name of a file: LIGGGHTS writes the step nowhere else.

    Raises
    ------
    DataError : the name of the file holds no number
    """
    numbers = re.findall(r"\d{1,18}", path.stem)
    if not numbers:
        raise DataError(f"{path}: the name of a VTK dump must hold its step, as dump_1000.vtk does")
    return int(numbers[-1])


def read_vtk(path: Path) -> Snapshot:
    """The snapshot in a file; its box is that of the particles, because none is in it.

    Raises
    ------
    DataError : not a legacy VTK file of points, damaged or truncated
    """
    arrays = _Legacy(path).arrays()
    names, columns = [*arrays], [*arrays.values()]
    position = np.column_stack([arrays[axis] for axis in "xyz"])
    reach = np.max(arrays.get("radius", 0.0), initial=0.0)
    box = np.zeros((3, 2))
    if len(position):
        box = np.column_stack([position.min(axis=0) - reach, position.max(axis=0) + reach])
    step = vtk_step(path)
    return with_standard_columns(Snapshot(step, box, tuple(names), np.column_stack(columns)), f"{path}: step {step}")


class _Kind(NamedTuple):
    """Name, components, tuples and type of an array."""

    name: str
    components: int
    tuples: int
    type: str


class _Legacy:
    """A legacy VTK file, read from its beginning to its end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._content = path.read_bytes()
        self._at = 0
        self._line(), self._line()
        self._binary = self._line() == ["BINARY"]
        if not self._content.endswith(b"\n"):
            raise self._truncated("the last line is incomplete")

    def arrays(self) -> dict[str, Array]:
        """Coordinates x, y, z and all point data, one array (n,) per component."""
        found: dict[str, Array] = {}
        points, of_points = -1, True
        while words := self._line():
            match words:
                case ["DATASET", ("POLYDATA" | "UNSTRUCTURED_GRID")]:
                    pass
                case ["POINTS", count, kind]:
                    points = self._whole(count)
                    found |= self._values(_Kind("", 3, points, kind))
                case [cells, first, second] if cells in _CELLS:
                    self._skip_cells(self._whole(first), self._whole(second))
                case ["CELL_TYPES", count]:
                    self._values(_Kind("types", 1, self._whole(count), "int"))
                case [("POINT_DATA" | "CELL_DATA") as where, _]:
                    of_points = where == "POINT_DATA"
                case ["FIELD", _, count]:
                    for _ in range(self._whole(count)):
                        kind_of = self._field_array(self._line())
                        values = self._values(kind_of)
                        found |= values if of_points and kind_of.tuples == points else {}
                case ["SCALARS", name, kind, *components]:
                    self._line()  # LOOKUP_TABLE
                    values = self._values(_Kind(name, self._whole([*components, "1"][0]), points, kind))
                    found |= values if of_points else {}
                case [("VECTORS" | "NORMALS" | "TENSORS") as what, name, kind]:
                    values = self._values(_Kind(name, _COMPONENTS[what], points, kind))
                    found |= values if of_points else {}
                case ["METADATA"]:
                    while self._line(blank=True):
                        pass
                case _:
                    raise self._error(f"'{' '.join(words)[:40]}' is not what a dump of particles holds")
        if "x" not in found:
            raise self._error("no points")
        return found

    def _error(self, message: str) -> DataError:
        if self._at >= len(self._content):
            return self._truncated(message)
        return DataError(f"{self.path}: byte {self._at}: {message}; only legacy VTK files of points are read")

    def _line(self, blank: bool = False) -> list[str]:
        """Words of the next line that is not blank (or of the very next one); none at the end of the file."""
        while self._at < len(self._content):
            end = self._content.find(b"\n", self._at, self._at + 4096)
            if end < 0:
                end = min(len(self._content), self._at + 4096)
            words = self._content[self._at : end].decode("latin-1").split()
            self._at = end + 1
            if words or blank:
                return words
        return []

    def _whole(self, word: str) -> int:
        if not word.isdecimal() or len(word) > 18:
            raise self._error(f"expected a whole number, found '{word[:40]}'")
        return int(word)

    def _field_array(self, words: list[str]) -> _Kind:
        if len(words) == 1 and words[0] == "METADATA":  # belongs to the array before
            while self._line(blank=True):
                pass
            words = self._line()
        if len(words) != 4:
            raise self._error(f"expected an array's name, sizes and type, found '{' '.join(words)[:40]}'")
        return _Kind(words[0], self._whole(words[1]), self._whole(words[2]), words[3])

    def _skip_cells(self, first: int, second: int) -> None:
        """Pass over cells: offsets and connectivity since version 5, before that one list of `second` numbers."""
        before = self._at
        words = self._line()
        if words[:1] != ["OFFSETS"]:
            self._at = before
            self._values(_Kind("cells", 1, second, "int"))
            return
        self._values(_Kind("offsets", 1, first, words[-1]))
        words = self._line()
        self._values(_Kind("connectivity", 1, second, words[-1] if words else ""))

    def _values(self, kind: _Kind) -> dict[str, Array]:
        """The arrays (tuples,) of an array's components, named x, y, z behind its own name where there are three."""
        dtype = _TYPES.get(kind.type.lower())
        if dtype is None or not 1 <= kind.components <= 9:
            raise self._error(f"array '{kind.name[:40]}' of {kind.components} × '{kind.type[:40]}' cannot be read")
        count = kind.components * kind.tuples
        values = self._binary_values(count, np.dtype(dtype)) if self._binary else self._text_values(count)
        table = values.reshape(kind.tuples, kind.components)
        suffixes = {1: [""], 3: ["x", "y", "z"]}.get(kind.components, [str(k) for k in range(kind.components)])
        return {kind.name + suffix: table[:, k] for k, suffix in enumerate(suffixes)}

    def _truncated(self, message: str) -> TruncatedError:
        return TruncatedError(
            f"{self.path}: truncated at byte {len(self._content)}: {message}; if LIGGGHTS is still writing it, wait; "
            "otherwise leave this file out"
        )

    def _missing(self, count: int) -> TruncatedError:
        return self._truncated(f"{count} numbers expected at byte {self._at}")

    def _binary_values(self, count: int, dtype: np.dtype[np.generic]) -> Array:
        if self._at + count * dtype.itemsize > len(self._content):
            raise self._missing(count)
        values = np.frombuffer(self._content, dtype, count, self._at)
        self._at += count * dtype.itemsize
        return values.astype(float)

    def _text_values(self, count: int) -> Array:
        if 2 * count > len(self._content) - self._at + 1:
            raise self._missing(count)
        words = self._content[self._at :].split(None, count)
        if len(words) < count:
            raise self._missing(count)
        rest = words.pop() if len(words) > count else b""
        try:
            values = np.array(words, dtype=bytes).astype(float)
        except ValueError as error:
            raise self._error(f"the numbers below cannot be read ({error})") from error
        self._at = len(self._content) - len(rest)
        return values
