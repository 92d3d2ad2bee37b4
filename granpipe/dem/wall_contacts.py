"""Reader of the contacts with walls that the production deck dumps (``dump local``) where pressure is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array
from granpipe.system.reading import read_bytes, reason

_HEAD = 9  # lines
_COLUMNS = 6
_MOST_BYTES = 500_000_000


def read_wall_contacts(path: Path) -> tuple[Array, Array]:
    """Points (n, 3) [m] of the contacts in one snapshot and forces (n, 3) [N] on the particles.

    Raises
    ------
    DataError : the file cannot be read, or is damaged
    """
    try:
        lines = read_bytes(path, _MOST_BYTES).decode("ascii", errors="replace").splitlines()
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read ({reason(error)})") from error
    if len(lines) < _HEAD or not lines[2].startswith("ITEM: NUMBER OF ENTRIES"):
        raise DataError(f"{path}: not a dump of contacts with walls, or cut short")
    try:
        values = np.array([line.split() for line in lines[_HEAD:]], dtype=float).reshape(-1, _COLUMNS)
        count = int(lines[3])
    except ValueError as error:
        raise DataError(f"{path}: the numbers cannot be read ({error})") from error
    if len(values) != count or not np.isfinite(values).all():
        raise DataError(f"{path}: {count} contacts with walls announced, {len(values)} whole ones found")
    return values[:, :3], values[:, 3:]
