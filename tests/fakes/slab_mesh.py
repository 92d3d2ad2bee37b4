"""A triangle mesh of a slab, made without gmsh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from fakes.vessel_mesh import mesh_below

from granpipe.field import Array, Measure
from granpipe.rzmesh import RZMesh

Wall = Callable[[Array], Array]


def slab_between(left: Wall, right: Wall, bottom: float, top: float, cells: int, depth: float) -> RZMesh:
    """Mesh of left(z) < x < right(z), `cells` each way, with uneven diagonals; the left wall is one piece."""
    square = mesh_below(np.ones_like, bottom, top, cells)
    share, z = square.points.T
    x = (1 - share) * left(z) + share * right(z)
    names = np.where(square.names == "axis", "wall:left", square.names)
    return RZMesh(np.stack([x, z], axis=1), square.triangles, square.edges, names, Measure(depth, axial=False))
