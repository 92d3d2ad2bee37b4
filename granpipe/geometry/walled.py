"""A slab between a front and a back wall for LIGGGHTS: the strips of its walls and obstacles, and both end faces.

Strips and faces are made of the same pieces of the border of what is free in the section, so that they share their
points: the surface is closed but for the inlet and the outlet, and walls behind obstacles that stand on them are no
part of it.
"""

from __future__ import annotations

from math import tan

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array
from granpipe.geometry.extrude import cut_line, strip_count, strips, with_ends
from granpipe.geometry.flat import flat_triangles
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import distance_to, edges_of
from granpipe.geometry.revolve import TARGET_ANGLE

VESSEL = "vessel"

Index = NDArray[np.intp]


def walled_slab(outline: Outline, top: float, bottom: float) -> dict[str, Array]:
    """Name of a mesh → its corners (triangles, 3, xyz) [m], from y = 0 to the depth.

    ``vessel`` holds the left and the right wall, with straight ends up to `top` and down to `bottom`, and the two end
    faces; ``obstacle_<name>`` what of an obstacle particles can touch. No triangle is larger than the narrowest
    opening: between points of two walls that are farther apart they would be thin.

    Raises
    ------
    MeshError : an edge is too short for strips as long as the slab is deep, or gmsh cannot mesh the faces
    """
    depth = outline.measure.turn
    section = _free_section(outline, top, bottom)
    borders = [ring for face in section for ring in face]
    shortest = min(float(np.hypot(*np.diff(_closed(ring), axis=0).T).min()) for ring in borders)
    size = min(opening.gap for opening in find_openings(outline))
    count = strip_count(min(shortest, 0.5 * size), depth, VESSEL)
    size = min(size, depth / count / tan(TARGET_ANGLE))
    faces = [[cut_line(_closed(ring), size)[:-1] for ring in face] for face in section]
    pieces = np.concatenate([edges_of(ring, closed=True) for face in faces for ring in face])
    level = np.abs(pieces[:, :, 1, None] - [top, bottom]).max(axis=1) <= outline.tolerance
    pieces = pieces[~level.any(axis=1)]  # the others are the inlet and the outlet
    owner, y = _owners(outline, pieces.mean(axis=1), top, bottom), np.linspace(0.0, depth, count + 1)
    names = [VESSEL, *(f"obstacle_{name}" for name in outline.obstacles)]
    meshes = {name: np.concatenate([strips(one, y) for one in pieces[owner == k]]) for k, name in enumerate(names)}
    flat = flat_triangles(faces, size)
    ends = [np.stack([flat[..., 0], np.full(flat.shape[:2], at), flat[..., 1]], axis=-1) for at in (0.0, depth)]
    return meshes | {VESSEL: np.concatenate([meshes[VESSEL], *ends])}


def _free_section(outline: Outline, top: float, bottom: float) -> list[list[Array]]:
    """What is free in the section between two heights: of each part its border and those of its holes, (n, 2) [m].

    Points nearer than the outline's tolerance are one.
    """
    import shapely

    left, right = (with_ends(chain, top, bottom) for chain in (outline.left, outline.wall))
    whole = shapely.Polygon(np.concatenate([left, right[::-1]]))
    solids = shapely.union_all([shapely.Polygon(corners) for corners in outline.obstacles.values()])
    free = shapely.difference(whole, solids, grid_size=outline.tolerance)
    drawn = np.concatenate([left, right, *outline.obstacles.values()])
    return [
        [
            _as_drawn(shapely.get_coordinates(ring)[:-1], drawn, outline.tolerance)
            for ring in (part.exterior, *part.interiors)
        ]
        for part in shapely.get_parts(free)
    ]


def _as_drawn(points: Array, drawn: Array, tolerance: float) -> Array:
    """Points (n, 2) put back where they were drawn, from the places of a grid next to it [m]."""
    apart = np.linalg.norm(points[:, None] - drawn, axis=2)
    return np.where((apart.min(axis=1) <= tolerance)[:, None], drawn[apart.argmin(axis=1)], points)


def _owners(outline: Outline, points: Array, top: float, bottom: float) -> Index:
    """(n,) whose each of the points (n, 2) is, which lie on solids: 0 that of a wall, k of the k-th obstacle."""
    walls = [edges_of(with_ends(chain, top, bottom)) for chain in (outline.left, outline.wall)]
    solids = [np.concatenate(walls), *(edges_of(corners, closed=True) for corners in outline.obstacles.values())]
    return np.asarray(np.stack([distance_to(points, edges) for edges in solids]).argmin(axis=0))


def _closed(ring: Array) -> Array:
    return np.concatenate([ring, ring[:1]])
