"""A triangle mesh of a vessel without obstacles, made without gmsh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from granpipe.field import Array
from granpipe.rzmesh import RZMesh


def mesh_below(radius: Callable[[Array], Array], bottom: float, top: float, cells: int) -> RZMesh:
    """Mesh of 0 < r < radius(z), `cells` each way, with uneven diagonals; the wall has two pieces of equal height."""
    count = cells + 1
    z = np.repeat(np.linspace(bottom, top, count), count)
    r = np.tile(np.linspace(0, 1, count), count) * radius(z)
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    even = (np.add.outer(np.arange(cells), np.arange(cells)) % 2 == 0)[..., None]
    first = np.where(even, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    second = np.where(even, np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    sides = {"outlet": number[0], "wall": number[:, -1], "inlet": number[-1, ::-1], "axis": number[::-1, 0]}
    edges = np.concatenate([np.stack([line[:-1], line[1:]], 1) for line in sides.values()])
    names = np.repeat(list(sides), cells).astype("U12")
    wall = np.flatnonzero(names == "wall")
    names[wall[: cells // 2]], names[wall[cells // 2 :]] = "wall:low", "wall:high"
    return RZMesh(np.stack([r, z], 1), np.concatenate([first, second]).reshape(-1, 3), edges, names)
