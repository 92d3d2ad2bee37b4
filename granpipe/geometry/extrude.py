"""How lines in the x–z plane become the walls of a slab for LIGGGHTS: flat strips from its front to its back face.

The strips end on the periodic faces, or on the front and the back wall (`granpipe.geometry.walled`). Walls are alike
all along y, so the point of a wall that is nearest to a particle in the box lies in the box as well, and no contact is
missed.
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

MOST_DEPTHS = 4
"""Longest triangle over the depth: LIGGGHTS stops at its first insertion (region_neighbor_list) where one is ten times
as long as the period; eight times passed."""


def extruded(lines: Sequence[Array], depth: float, name: str) -> Array:
    """The corners (triangles, 3, xyz) [m] of walls along lines (n, 2), between y = 0 and the depth [m].

    Long edges are cut into rows and the depth into strips, so that no triangle is thin.

    Raises
    ------
    MeshError : an edge is too short for that
    """
    lengths = np.concatenate([np.hypot(*np.diff(line, axis=0).T) for line in lines])
    count = strip_count(float(lengths.min()), depth, name)
    longest = min(depth / count / tan(TARGET_ANGLE), MOST_DEPTHS * depth)
    return np.concatenate([strips(cut_line(line, longest), np.linspace(0.0, depth, count + 1)) for line in lines])


def strip_count(shortest: float, depth: float, name: str) -> int:
    """Number of strips that keep triangles at the shortest edge [m] from being thin.

    Raises
    ------
    MeshError : the edge is too short for that
    """
    count = max(1, ceil(depth * tan(1.1 * SMALLEST_ANGLE) / shortest))
    if count > MOST_STRIPS:
        raise MeshError(
            f"{name}: an edge is {shortest:.3g} m long beside a slab {depth:.3g} m thick; LIGGGHTS refuses such "
            f"thin triangles: make it at least {depth * tan(1.1 * SMALLEST_ANGLE) / MOST_STRIPS:.3g} m long, or leave "
            "it out"
        )
    return count


def cut_line(line: Array, longest: float) -> Array:
    """The line (n, 2) with its edges cut into equal pieces no longer than `longest` [m]."""
    return np.concatenate([line[:1], *(_cut(start, end, longest) for start, end in pairwise(line))])


def with_ends(wall: Array, top: float, bottom: float) -> Array:
    """A wall (n, 2) that goes on straight up to `top` and down to `bottom` [m]."""
    line = [[float(wall[0, 0]), top], *wall.tolist(), [float(wall[-1, 0]), bottom]]
    return np.array([a for a, b in pairwise(line) if a != b] + line[-1:])


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


def strips(line: Array, y: Array) -> Array:
    """(triangles, 3, xyz) two triangles for each piece of the line (n, 2) and of y [m]."""
    grid = np.empty((len(line), len(y), 3))
    grid[..., 0], grid[..., 1], grid[..., 2] = line[:, :1], y, line[:, 1:]
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return np.concatenate([np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
