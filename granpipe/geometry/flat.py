"""Flat faces in triangles, by gmsh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from granpipe.field import Array
from granpipe.system.gmsh_session import gmsh_session


def flat_triangles(faces: Sequence[Sequence[Array]], size: float | None = None) -> Array:
    """(m, 3, 2) corners of the triangles of flat faces; their borders keep their points, and get no others.

    Parameters
    ----------
    faces : of each the outer border and the borders of its holes, (n, 2) points [m], the last one not repeated
    size : edge length of triangles at the most [m]; None: as the points of the borders have it

    Raises
    ------
    MeshError : gmsh cannot mesh them
    """
    with gmsh_session("mesh a flat face") as gmsh:
        geo = gmsh.model.geo
        for borders in faces:
            points: dict[tuple[float, ...], int] = {}  # a hole may touch the border in a point
            geo.addPlaneSurface([_loop(gmsh, border, points) for border in borders])
        geo.synchronize()
        if size is not None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(2)
        return triangles_of(gmsh)[:, :, :2]


def triangles_of(gmsh: Any) -> Array:
    """(n, 3, 3) corners of all triangles of the model [m]."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, dtype=int)
    place[tags] = np.arange(len(tags))
    _, _, nodes = gmsh.model.mesh.getElements(2)
    corners = np.concatenate([one.reshape(-1, 3) for one in nodes])
    return np.asarray(coordinates.reshape(-1, 3)[place[corners]])


def _loop(gmsh: Any, border: Array, points: dict[tuple[float, ...], int]) -> int:
    """A closed line of edges that are not cut, through points that are there already or added."""
    geo = gmsh.model.geo
    corners = []
    for place in map(tuple, border.tolist()):
        if place not in points:
            points[place] = geo.addPoint(*place, 0.0)
        corners.append(points[place])
    lines = [geo.addLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    for line in lines:
        geo.mesh.setTransfiniteCurve(line, 2)
    return int(geo.addCurveLoop(lines))
