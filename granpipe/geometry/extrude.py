"""How lines in the x–z plane become the walls of a slab for LIGGGHTS: flat strips from its front to its back face.

The strips end on the periodic faces. Walls are alike all along y, so the point of a wall that is nearest to a particle
in the box lies in the box as well, and no contact is missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, tan
from pathlib import Path

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import Array
from granpipe.geometry.revolve import SMALLEST_ANGLE, TARGET_ANGLE

MOST_STRIPS = 64
"""Side by side along y: shorter edges would need more, to keep their triangles from being thin."""


def extruded(lines: Sequence[Array], depth: float, name: str) -> Array:
    """The corners (triangles, 3, xyz) [m] of walls along lines (n, 2), between y = 0 and the depth [m].

    Long edges are cut into rows and the depth into strips, so that no triangle is thin.

    Raises
    ------
    MeshError : an edge is too short for that
    """
    lengths = np.concatenate([np.hypot(*np.diff(line, axis=0).T) for line in lines])
    strips = max(1, ceil(depth * tan(1.1 * SMALLEST_ANGLE) / lengths.min()))
    if strips > MOST_STRIPS:
        raise MeshError(
            f"{name}: an edge is {lengths.min():.3g} m long beside a slab {depth:.3g} m thick; LIGGGHTS refuses such "
            f"thin triangles: make it at least {depth * tan(1.1 * SMALLEST_ANGLE) / MOST_STRIPS:.3g} m long, or leave "
            "it out"
        )
    longest = depth / strips / tan(TARGET_ANGLE)
    fine = [np.concatenate([line[:1], *(_cut(start, end, longest) for start, end in pairwise(line))]) for line in lines]
    return np.concatenate([_strip(line, np.linspace(0.0, depth, strips + 1)) for line in fine])


def write_stl(corners: Array, path: Path) -> None:
    """Write triangles (n, 3, xyz) [m] as an STL file; LIGGGHTS does not use their normals."""
    text = ["solid slab"]
    for triangle in corners:
        text += ["facet normal 0 0 0", "outer loop"]
        text += [f"vertex {x:.17g} {y:.17g} {z:.17g}" for x, y, z in triangle]
        text += ["endloop", "endfacet"]
    path.write_text("\n".join([*text, "endsolid slab", ""]))


def _cut(start: Array, end: Array, longest: float) -> Array:
    """Points after the first of an edge in pieces no longer than `longest` [m]."""
    rows = ceil(float(np.hypot(*(end - start))) / longest - 1e-9)
    return np.asarray(start + (end - start) * (np.arange(1, rows + 1) / rows)[:, None])


def _strip(line: Array, y: Array) -> Array:
    """Two triangles for each piece of the line and of y."""
    grid = np.empty((len(line), len(y), 3))
    grid[..., 0], grid[..., 1], grid[..., 2] = line[:, :1], y, line[:, 1:]
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return np.concatenate([np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
