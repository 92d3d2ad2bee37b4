"""``.npz`` files that granpipe wrote, read as if a stranger had: nothing is decompressed before its size is known."""

from __future__ import annotations

import math
import os
import re
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.system.reading import open_regular, reason

MOST_BYTES = 2_000_000_000
"""Of all arrays of a file, decompressed."""

MOST_ARRAYS = 100

_HEADER = re.compile(
    r"\{'descr': '((?:<[fi]8|\|b1|<U\d{1,3}))', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d{1,10}(?:,|, (?=\d)))*(?:\d{1,10})?)\), \} *\n"
)
"""Header that numpy writes for an array of numbers (float64, int64), booleans or text."""

_MAGIC = b"\x93NUMPY\x01\x00"

_DAMAGE = (OSError, ValueError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error)


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file, by name.

    Raises
    ------
    FileNotFoundError : there is no such file
    DataError : it is no regular file, no ``.npz``, damaged, too large, or holds anything but plain arrays
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
            size = sum(entry.file_size for entry in entries)
            if sum(entry.compress_size for entry in entries) > os.fstat(file.fileno()).st_size:
                raise ValueError("its directory tells of more bytes than it has")
            if len(entries) > MOST_ARRAYS or size > MOST_BYTES:
                raise ValueError(f"{len(entries)} arrays of {size / 1e6:.3g} MB together are more than it can hold")
            return {entry.filename.removesuffix(".npy"): _array(archive.read(entry)) for entry in entries}
    except FileNotFoundError:
        raise
    except _DAMAGE as error:
        raise DataError(f"{path}: not an .npz file that granpipe wrote ({reason(error)})") from error


def _array(data: bytes) -> NDArray[Any]:
    """An array from the bytes of a ``.npy`` file."""
    start = len(_MAGIC) + 2
    length = int.from_bytes(data[len(_MAGIC) : start], "little")
    header = _HEADER.fullmatch(data[start : start + length].decode("latin-1"))
    if not data.startswith(_MAGIC) or header is None:
        raise ValueError("an array of a kind that granpipe does not write")
    kind, order, sizes = np.dtype(header[1]), header[2], [int(size) for size in header[3].split(",") if size.strip()]
    if math.prod(sizes) * kind.itemsize != len(data) - start - length:
        raise ValueError(f"an array of {sizes} numbers with data of another length")
    flat = np.frombuffer(bytearray(data[start + length :]), kind)
    return flat.reshape(sizes, order="F" if order == "True" else "C")
