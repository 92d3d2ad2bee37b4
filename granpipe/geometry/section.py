"""Outline → triangle mesh of the r–z half section, or of a slab by x and z, by gmsh, graded to the corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import ROUND, Array, Measure
from granpipe.geometry.element_size import TOLERANCE, element_size
from granpipe.geometry.polyline import distance_to, edges_of, enclosed, nearest_points
from granpipe.rzmesh import Index, Names, RZMesh
from granpipe.system.gmsh_session import gmsh_session


def mesh_section(
    wall: Array,
    obstacles: Mapping[str, Array],
    sections: Mapping[str, tuple[float, float]],
    *,
    cells_across: float = 10.0,
    corner_refinement: float = 10.0,
    bands: Sequence[tuple[float, float, float]] = (),
    outlet_radii: Sequence[float] = (),
    left: Array | None = None,
    measure: Measure = ROUND,
) -> RZMesh:
    """Mesh the space between axis or left wall, wall and obstacles.

    Parameters
    ----------
    wall : (n, 2) r and z of the wall from the top down [m]
    obstacles : closed polygons (m, 2) [m]; they may lie on the wall, on the axis or be free rings
    sections : upper and lower end of each section [m]
    cells_across : elements from the axis to the wall, away from corners; half as many fit between two walls, and twice
        as many across a slab: as many as across a round vessel
    corner_refinement : how much smaller the elements at corners are
    bands : lower end, upper end and largest element of ranges that a known flow needs to be fine [m]
    outlet_radii : where the outflow jumps, as at the edges of an annular outlet [m]
    left : (n, 2) x and z of the left wall of a slab, from the top down [m]; not needed beside an axis
    measure : what the section stands for

    Returns
    -------
    The part of the section that joins inlet and outlet; pockets that obstacles close off are left out.

    Raises
    ------
    MeshError : gmsh cannot mesh the section
    """
    if left is None or measure.axial:
        left, origin = wall[[0, -1]] * [0.0, 1.0], np.zeros(2)
    else:  # far from x = 0 lengths would lose digits
        origin, cells_across = np.array([left[:, 0].min(), 0.0]), 4 * cells_across
    sides = [(chain - origin) for chain in (wall, left)]
    rings = {name: ring - origin for name, ring in obstacles.items()}
    scale = 2.0 ** np.round(np.log2(sides[0][:, 0].max()))  # a power of two: scaling loses no digit
    heights = _law_heights(sides, rings, sections)
    walls = sides[:1] if measure.axial else sides  # no law rules on the axis, which keeps its ends only
    sides[: len(walls)] = [_with_heights(chain, heights, sides[0][:, 0].max()) for chain in walls]
    drawing = _Drawing(
        sides[0] / scale,
        sides[1] / scale,
        measure.axial,
        {name: ring / scale for name, ring in rings.items()},
        {name: (top / scale, bottom / scale) for name, (top, bottom) in sections.items()},
        heights / scale,
        np.sort(np.asarray(outlet_radii, dtype=float))[::-1] / scale,
    )
    unit_bands = [(low / scale, high / scale, size / scale) for low, high, size in bands]
    points, triangles = _triangulate(drawing, cells_across, corner_refinement, unit_bands)
    edges = _boundary(triangles)
    names = drawing.names(points[edges].mean(axis=1))
    points[edges[names == "axis"], 0] = 0.0
    return RZMesh(points * scale + origin, triangles, edges, names, measure)


@dataclass(frozen=True)
class _Drawing:
    """The outline in units of the vessel's size; it knows what every boundary point belongs to."""

    wall: Array
    left: Array
    axial: bool
    obstacles: Mapping[str, Array]
    sections: Mapping[str, tuple[float, float]]
    law_heights: Array
    outlet_radii: Array

    def names(self, points: Array) -> Names:
        """(n,) what each boundary point (n, 2) belongs to."""
        walls = [edges_of(self.wall)] if self.axial else [edges_of(self.wall), edges_of(self.left)]
        piece = nearest_points(points, np.concatenate(walls))[0].argmin(axis=1)
        names = np.array([self._wall_name(i, z) for i, z in zip(piece, points[:, 1], strict=True)], dtype="U80")
        for name, end in {"inlet": 0, "outlet": -1}.items():
            (left, z), (right, _) = self.left[end], self.wall[end]
            names[(np.abs(points[:, 1] - z) < TOLERANCE) & (points[:, 0] > left) & (points[:, 0] < right)] = name
        if self.axial:
            names[points[:, 0] < TOLERANCE] = "axis"
        for name, ring in self.obstacles.items():
            names[distance_to(points, edges_of(ring, closed=True)) < TOLERANCE] = f"obstacle:{name}"
        return names

    def _wall_name(self, piece: int, z: float) -> str:
        for name, (top, bottom) in self.sections.items():
            if bottom - TOLERANCE <= z <= top + TOLERANCE:
                return f"wall:{name}"
        return f"wall:{piece + 1}"


def _law_heights(
    walls: Sequence[Array], obstacles: Mapping[str, Array], sections: Mapping[str, tuple[float, float]]
) -> Array:
    """(n,) heights where the wall's speed may jump [m]: ends of sections; level edges, where the free area jumps."""
    sides = np.concatenate([*map(edges_of, walls), *(edges_of(ring, closed=True) for ring in obstacles.values())])
    level = sides[:, 0, 1] == sides[:, 1, 1]
    return np.unique([*sides[level, 0, 1], *(z for ends in sections.values() for z in ends)])


def _with_heights(wall: Array, heights: Array, size: float) -> Array:
    """The wall with a point wherever it crosses one of the heights; `size` is that of the vessel [m]."""
    near = TOLERANCE * size
    points = [wall[0]]
    for start, end in edges_of(wall):
        part = (heights[heights != start[1]] - start[1]) / (end[1] - start[1]) if end[1] != start[1] else np.empty(0)
        margin = near / np.linalg.norm(end - start)
        crossed = np.sort(part[(part > margin) & (part < 1 - margin)])
        points += [*(start + crossed[:, None] * (end - start)), end]
    return np.array(points)


# --- gmsh -------------------------------------------------------------------------------------------------------------


def _triangulate(
    drawing: _Drawing, cells_across: float, corner_refinement: float, bands: Sequence[tuple[float, float, float]]
) -> tuple[Array, Index]:
    """Points (n, 2) and triangles (m, 3), counter-clockwise, of the part that joins inlet and outlet."""
    with gmsh_session("mesh the r–z section") as gmsh:
        for source in ("FromPoints", "ExtendFromBoundary", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{source}", 0)
        gmsh.option.setNumber("Mesh.LcIntegrationPrecision", 1e-4)  # the default asks for 20 times the calls
        face, edges = _way_through(drawing)
        names = drawing.names(edges.mean(axis=1))
        end = (names == "inlet") | (names == "outlet")
        size = element_size(edges, names == "axis", end, drawing.law_heights, cells_across, corner_refinement)
        size = replace(size, bands=tuple(bands))
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, r, z, y, lc: size.at(r, z))
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, corners = gmsh.model.mesh.getElementsByType(2, face)
    order = np.argsort(tags)
    used, triangles = np.unique(order[np.searchsorted(tags, corners, sorter=order)], return_inverse=True)
    points = coordinates.reshape(-1, 3)[used, :2]
    return points, _counter_clockwise(points, triangles.reshape(-1, 3))


def _way_through(drawing: _Drawing) -> tuple[int, Array]:
    """gmsh's face that joins inlet and outlet, and its boundary (k, 2, 2) with the inside on the left."""
    import gmsh

    bottom, radii = drawing.wall[-1, 1], drawing.outlet_radii
    radii = radii[(radii > TOLERANCE) & (radii < drawing.wall[-1, 0] - TOLERANCE)]
    outlet = np.stack([radii, np.full(len(radii), bottom)], axis=1)
    shell = _polygon(np.vstack([drawing.left[:1], drawing.wall, outlet, drawing.left[:0:-1]]))
    if drawing.obstacles:
        gmsh.model.occ.cut([(2, shell)], [(2, _polygon(ring)) for ring in drawing.obstacles.values()])
    gmsh.model.occ.synchronize()
    for _, face in gmsh.model.getEntities(2):
        edges = _sides(face)
        if {"inlet", "outlet"} <= set(drawing.names(edges.mean(axis=1))):
            return face, edges
    raise MeshError("the obstacles leave no way from the inlet to the outlet: move or shrink one")


def _polygon(points: Array) -> int:
    """A plane face in gmsh with these corners (n, 2)."""
    import gmsh

    model = gmsh.model.occ
    corners = [model.addPoint(r, z, 0) for r, z in points]
    lines = [model.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    return int(model.addPlaneSurface([model.addCurveLoop(lines)]))


def _sides(face: int) -> Array:
    """(k, 2, 2) the straight sides of one of gmsh's faces, the inside on their left."""
    import gmsh

    curves = gmsh.model.getBoundary([(2, face)], oriented=False)
    ends = [[gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getBoundary([curve])] for curve in curves]
    edges = np.array(ends)[:, :, :2]
    along = edges[:, 1] - edges[:, 0]
    to_left = 1e-4 * np.stack([-along[:, 1], along[:, 0]], axis=1)
    wrong = ~enclosed(edges.mean(axis=1) + to_left, edges)
    edges[wrong] = edges[wrong, ::-1]
    return edges


def _counter_clockwise(points: Array, triangles: Index) -> Index:
    """The triangles (m, 3), turned where they run clockwise."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def _boundary(triangles: Index) -> Index:
    """(k, 2) edges that only one triangle has, in its direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(edges[first[count == 1]])
