"""The vessel as surfaces for LIGGGHTS: one STL file each for the walls, every obstacle and the plate.

A slab is made of plane strips (`granpipe.geometry.extrude`), with a front and a back wall where it has them (`walled`),
a body of revolution of facets. They stand one above the other and not staggered: only then is every horizontal cut a
regular polygon with the area of its circle. Staggered by half a facet, the cut midway between two rings is
(1 + cos α)/(2 cos α) times too large, α = π/facets: 1.8 % at 12 facets, 0.4 % at 24.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, pi
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import Array
from granpipe.geometry.extrude import extruded, with_ends, write_stl
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import edges_of, nearest_points
from granpipe.geometry.revolve import SMALLEST_ANGLE, Turn, generatrix, triangle_angles
from granpipe.geometry.walled import walled_slab
from granpipe.system.gmsh_session import gmsh_session


@dataclass(frozen=True)
class Walls:
    """What was written.

    Parameters
    ----------
    files : name of the mesh (vessel, obstacle_<name>, plate) → STL file
    triangles : name of the mesh → number of triangles
    facets : of the vessel's wall per turn; 0 of a slab
    sides : ends of x and of y between which the walls lie; those of y are periodic in a slab without
        a front and a back wall [m]
    inward : how far the middle of a facet lies inside the true wall, at most [m]
    plate_area : of the outlet's polygon [m²], which is that of its circle, or of the slot
    smallest_angle : of all triangles [rad]
    box : (3, 2) lowest and highest x, y and z [m]
    """

    files: Mapping[str, Path]
    triangles: Mapping[str, int]
    facets: int
    sides: tuple[tuple[float, float], tuple[float, float]]
    inward: float
    plate_area: float
    smallest_angle: float
    box: Array


def build_walls(
    outline: Outline,
    *,
    top: float,
    bottom: float,
    plate_z: float | None,
    particle_diameter: float,
    folder: Path,
    facets: int | None = None,
) -> Walls:
    """Write the STL files into the folder.

    The vessel's wall goes on straight above the inlet up to `top` and below the outlet down to `bottom`. Faces of
    obstacles that lie on the wall or on the axis are left out.

    Parameters
    ----------
    top, bottom : upper and lower end of the wall mesh [m]
    plate_z : height of the flat disc in the outlet [m]; None: there is none
    particle_diameter : what the chord error is measured by [m]
    facets : per turn, a multiple of 4; None: as few as the chord error allows

    Raises
    ------
    MeshError : gmsh cannot mesh the walls, or LIGGGHTS would not take them
    """
    if not (top >= outline.z_top and bottom <= outline.z_bottom):
        raise ValueError("reservoir and extension lie outside the outline")
    if not outline.measure.axial:
        return _slab(outline, top, bottom, plate_z, folder)
    turns = facet_turns(outline, particle_diameter, facets)
    turn = turns[""]
    lines = {"vessel": ([with_ends(outline.wall, top, bottom)], turn)}
    for name in outline.obstacles:
        lines[f"obstacle_{name}"] = (_exposed(outline, name), turns[name])
    if plate_z is not None:
        lines["plate"] = ([np.array([[0.0, plate_z], [outline.outlet_radius, plate_z]])], turn)
    files, meshes = {}, {}
    for name, (parts, own_turn) in lines.items():
        files[name] = folder / f"{name}.stl"
        meshes[name] = _revolve([generatrix(part, own_turn, name) for part in parts], own_turn, files[name])
    corners = np.concatenate(list(meshes.values()))
    radius = float(np.hypot(corners[..., 0], corners[..., 1]).max())
    return Walls(
        files=files,
        triangles={name: len(mesh) for name, mesh in meshes.items()},
        facets=turn.facets,
        sides=((-radius, radius), (-radius, radius)),
        inward=turn.inward * outline.r_max,
        plate_area=pi * outline.outlet_radius**2,
        smallest_angle=min(checked_angle(name, mesh) for name, mesh in meshes.items()),
        box=np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))], axis=1),
    )


def facet_turns(outline: Outline, particle_diameter: float, facets: int | None) -> dict[str, Turn]:
    """Name of an obstacle, "" for the vessel → the facets of its walls.

    Parameters
    ----------
    particle_diameter : what the chord error is measured by [m]
    facets : per turn; None: as few as the chord error allows

    Raises
    ------
    MeshError : the walls would need more facets per turn than LIGGGHTS takes
    """
    radii = {"": outline.r_max} | {name: _group_radius(outline, name) for name in outline.obstacles}
    return {name: Turn.chosen(facets, radius, particle_diameter) for name, radius in radii.items()}


def _slab(outline: Outline, top: float, bottom: float, plate_z: float | None, folder: Path) -> Walls:
    """The walls of a slab, from y = 0 to its depth."""
    depth = outline.measure.turn
    if outline.measure.walled:
        meshes = walled_slab(outline, top, bottom)
    else:
        lines = {"vessel": [with_ends(chain, top, bottom) for chain in (outline.left, outline.wall)]}
        lines |= {f"obstacle_{name}": _exposed(outline, name) for name in outline.obstacles}
        meshes = {name: extruded(parts, depth, name) for name, parts in lines.items()}
    if plate_z is not None:
        line = np.array([[chain[-1, 0], plate_z] for chain in (outline.left, outline.wall)])
        meshes["plate"] = extruded([line], depth, "plate")
    files = {name: folder / f"{name}.stl" for name in meshes}
    for name, mesh in meshes.items():
        write_stl(mesh, files[name])
    corners = np.concatenate(list(meshes.values()))
    return Walls(
        files=files,
        triangles={name: len(mesh) for name, mesh in meshes.items()},
        facets=0,
        sides=((outline.r_min, outline.r_max), (0.0, depth)),
        inward=0.0,
        plate_area=outline.outlet_area,
        smallest_angle=min(checked_angle(name, mesh) for name, mesh in meshes.items()),
        box=np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))], axis=1),
    )


def _group_radius(outline: Outline, name: str) -> float:
    """Largest radius of what this obstacle touches: solids that meet share their facets."""
    if outline.stands_on(name) == "wall":
        return outline.r_max
    group = (p for other, p in outline.obstacles.items() if outline.groups.joined(name, other))
    return max(float(polygon[:, 0].max()) for polygon in group)


def _exposed(outline: Outline, name: str) -> list[Array]:
    """The lines of an obstacle's edges that particles can touch."""
    edges = edges_of(outline.obstacles[name], closed=True)
    walls = np.concatenate([edges_of(outline.wall), edges_of(outline.left)])  # the axis is the left one
    on_wall = nearest_points(edges.reshape(-1, 2), walls)[0].reshape(len(edges), 2, -1)
    hidden = np.asarray(np.any(np.all(on_wall <= outline.tolerance, axis=1), axis=1))
    if not hidden.any():
        return [np.concatenate([edges[:, 0], edges[:1, 0]])]
    first = int(np.flatnonzero(hidden)[0]) + 1
    lines: list[list[Array]] = [[]]
    for i in (np.arange(len(edges)) + first) % len(edges):
        if hidden[i]:
            lines.append([])
        else:
            lines[-1] += [edges[i, 1]] if lines[-1] else [edges[i, 0], edges[i, 1]]
    tolerance = outline.tolerance if outline.measure.axial else -np.inf
    return [_on_axis(np.array(line), tolerance) for line in lines if line]


def _on_axis(points: Array, tolerance: float) -> Array:
    """Points within the tolerance of the axis put on it."""
    return np.where(points <= [tolerance, -np.inf], [0.0, 0.0], points)


def checked_angle(name: str, corners: Array) -> float:
    """Smallest angle of the mesh [rad]; MeshError where LIGGGHTS would not take it."""
    smallest = float(triangle_angles(corners).min())
    if smallest < SMALLEST_ANGLE:
        raise MeshError(
            f"{name}: a triangle has an angle of {degrees(smallest):.2g}°, and LIGGGHTS wants well above 0.5°; "
            "look for very short edges beside long ones, or walls that meet at such an angle"
        )
    return smallest


def _revolve(lines: list[Array], turn: Turn, path: Path) -> Array:
    """Turn lines (n, 2) about the axis, write the STL file, and return the corners (triangles, 3, xyz) [m]."""
    with gmsh_session("revolve the outline") as gmsh:
        for line in lines:
            _turn_about_axis(gmsh, line * [turn.scale, 1.0], turn.facets)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, _, nodes = gmsh.model.mesh.getElements(2)
    if not path.read_bytes().rstrip().endswith(b"endsolid Created by Gmsh"):
        raise MeshError(f"{path}: was not written to its end; is the disk full?")
    place = np.zeros(int(tags.max()) + 1, dtype=int)
    place[tags] = np.arange(len(tags))
    return np.asarray(coordinates.reshape(-1, 3)[place[nodes[0].reshape(-1, 3)]])


def _turn_about_axis(gmsh: Any, line: Array, facets: int) -> None:
    """Revolve a line in four quarters, each edge one row of facets."""
    geo = gmsh.model.geo
    points = [geo.addPoint(r, 0.0, z) for r, z in line]
    if np.array_equal(line[0], line[-1]):
        points[-1] = points[0]
    curves = [geo.addLine(a, b) for a, b in pairwise(points)]
    for curve in curves:
        geo.mesh.setTransfiniteCurve(curve, 2)
    front = [(1, curve) for curve in curves]
    for _ in range(4):
        swept = geo.revolve(front, 0, 0, 0, 0, 0, 1, pi / 2, numElements=[facets // 4])
        front = [swept[i - 1] for i, (dimension, _) in enumerate(swept) if dimension == 2]
    geo.synchronize()
