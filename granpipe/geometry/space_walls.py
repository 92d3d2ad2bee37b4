"""The walls of a vessel in space as surfaces for LIGGGHTS: the walls with straight ends, and a plate in each outlet."""

from __future__ import annotations

from math import degrees
from pathlib import Path

import numpy as np

from granpipe.errors import MeshError
from granpipe.field import Array
from granpipe.geometry.extrude import write_stl
from granpipe.geometry.flat import flat_triangles, triangles_of
from granpipe.geometry.revolve import SMALLEST_ANGLE, triangle_angles
from granpipe.geometry.space_vessel import SpaceOutlet, SpaceVessel
from granpipe.geometry.walls import Walls, checked_angle
from granpipe.system.gmsh_session import gmsh_session

SAME_AREA = 0.01
"""Relative change of the walls' area, at most, where they are meshed anew."""

_SIZE = 1.0  # of new triangles, in particle diameters: a chord of an opening five wide is off by 1/20 of one
_CREASE = np.radians(20)  # between two triangles, from which on an edge is kept


def plate_name(vessel: SpaceVessel, outlet: SpaceOutlet) -> str:
    """Name of the mesh of the plate in an outlet."""
    return "plate" if len(vessel.outlets) == 1 else f"plate_{outlet.name}"


def build_space_walls(
    vessel: SpaceVessel, *, top: float, bottom: float, plate_z: float, particle_diameter: float, folder: Path
) -> Walls:
    """Write the STL files into the folder.

    The walls go on upright above the inlet up to `top` and below each outlet's spout down to `bottom`. Triangles that
    are too thin for LIGGGHTS are made anew, with the others.

    Parameters
    ----------
    top, bottom : upper and lower end of the wall mesh [m]
    plate_z : height of the flat plate below an outlet at the lowest point [m]; of others as much higher as they are
    particle_diameter : what the size of new triangles goes by [m]

    Raises
    ------
    MeshError : gmsh cannot mesh the walls, or LIGGGHTS would not take them
    """
    surface = vessel.surface(top, bottom)
    if triangle_angles(surface).min() < SMALLEST_ANGLE:
        surface = _anew(vessel.surface(top, bottom, 1), _SIZE * particle_diameter, folder / "given.stl")
    meshes = {"vessel": surface}
    for outlet, rise in zip(vessel.outlets, vessel.rises, strict=True):
        meshes[plate_name(vessel, outlet)] = _plate(outlet.spout.border, plate_z + rise)
    files = {name: folder / f"{name}.stl" for name in meshes}
    for name, mesh in meshes.items():
        write_stl(mesh, files[name])
    corners = np.concatenate(list(meshes.values()))
    box = np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))], axis=1)
    (x0, x1), (y0, y1), _ = box.tolist()
    return Walls(
        files=files,
        triangles={name: len(mesh) for name, mesh in meshes.items()},
        facets=0,
        sides=((x0, x1), (y0, y1)),
        inward=0.0,
        plate_area=vessel.outlet_area,
        smallest_angle=min(checked_angle(name, mesh) for name, mesh in meshes.items()),
        box=box,
    )


def _anew(surface: Array, size: float, path: Path) -> Array:
    """The same surface in triangles of about one size [m]."""
    write_stl(surface, path)
    with gmsh_session("mesh the walls anew") as gmsh:
        gmsh.merge(str(path))
        gmsh.model.mesh.removeDuplicateNodes()
        gmsh.model.mesh.classifySurfaces(_CREASE, True, True, np.pi)
        gmsh.model.mesh.createGeometry()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.model.mesh.generate(2)
        found = triangles_of(gmsh)
    path.unlink()
    before, after = _area(surface), _area(found)
    if abs(after / before - 1) > SAME_AREA:
        raise MeshError(
            f"vessel: made anew, for some triangles are thinner than {degrees(SMALLEST_ANGLE):.2g}°, the walls have "
            f"{after:.4g} m² instead of {before:.4g} m²: give a file without such triangles"
        )
    return found


def _plate(border: Array, z: float) -> Array:
    """Triangles of a flat plate within a border (n, 2) at a height [m]."""
    flat = flat_triangles([[border]])
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), z)], axis=2)


def _area(triangles: Array) -> float:
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return float(0.5 * np.linalg.norm(np.cross(first, second), axis=1).sum())
