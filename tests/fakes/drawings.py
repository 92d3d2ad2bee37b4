"""Drawings of a vessel in several formats, made by other libraries than those that read them where there are any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

Points = Sequence[Sequence[float]]


def write_dxf(path: Path, lines: Sequence[tuple[str, Points, bool]], insunits: int = 0) -> Path:
    """Polylines (layer, points, closed) as a DXF in plain text, written by hand after the DXF reference (R12)."""
    text = ["0", "SECTION", "2", "HEADER", "9", "$ACADVER", "1", "AC1009", "9", "$INSUNITS", "70", str(insunits),
            "0", "ENDSEC", "0", "SECTION", "2", "ENTITIES"]  # fmt: skip
    for layer, points, closed in lines:
        text += ["0", "POLYLINE", "8", layer, "66", "1", "70", str(int(closed))]
        for x, y in points:
            text += ["0", "VERTEX", "8", layer, "10", repr(float(x)), "20", repr(float(y))]
        text += ["0", "SEQEND", "8", layer]
    path.write_text("\n".join([*text, "0", "ENDSEC", "0", "EOF", ""]))
    return path


def write_csv(path: Path, lines: Sequence[Points], separator: str = ",") -> Path:
    """Polylines as rows of r and z, separated by blank lines."""
    blocks = ["\n".join(f"{r!r}{separator}{z!r}" for r, z in points) for points in lines]
    path.write_text("r" + separator + "z\n" + "\n\n".join(blocks) + "\n")
    return path


def write_mphtxt(path: Path, points: Points, triangles: Sequence[Sequence[int]]) -> Path:
    """A mesh in COMSOL's text format, version 4."""
    rows = ["# Created by COMSOL Multiphysics.", "0 1", "1 # number of tags", "5 mesh1", "1 # number of types", "3 obj",
            "0 0 1", "4 Mesh # class", "4 # version", "2 # sdim", f"{len(points)} # number of mesh vertices",
            "0 # lowest mesh vertex index", *(f"{x!r} {y!r}" for x, y in points), "1 # number of element types",
            "3 tri # type name", "3 # number of vertices per element", f"{len(triangles)} # number of elements",
            *(" ".join(map(str, triangle)) for triangle in triangles), f"{len(triangles)} # entity indices",
            *(["1"] * len(triangles))]  # fmt: skip
    path.write_text("\n".join(rows) + "\n")
    return path


def revolved_stl(path: Path, profile: Points, facets: int = 24) -> Path:
    """A polyline turned about z, as an STL in plain text, without caps."""
    turns = 2 * np.pi * np.arange(facets) / facets
    rows = ["solid wall"]
    for (r0, z0), (r1, z1) in pairwise(profile):
        for a, b in zip(turns, np.roll(turns, -1), strict=True):
            corner = [(r * np.cos(t), r * np.sin(t), z) for r, z in ((r0, z0), (r1, z1)) for t in (a, b)]
            for i, j, k in ((0, 1, 2), (1, 3, 2)):
                rows += ["facet normal 0 0 0", "outer loop"]
                rows += [f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (corner[i], corner[j], corner[k])]
                rows += ["endloop", "endfacet"]
    path.write_text("\n".join([*rows, "endsolid wall", ""]))
    return path


def write_step(path: Path, wall: Points, obstacles: Mapping[str, Points], turned: bool) -> Path:
    """The inside of a vessel by OpenCASCADE: its face in the plane x–z, or the body that it makes about z."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ

        def face(points: Points) -> tuple[int, int]:
            corners = [occ.addPoint(r, 0, z) for r, z in points]
            edges = [occ.addLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
            return 2, occ.addPlaneSurface([occ.addCurveLoop(edges)])

        inside = [(0.0, wall[-1][1]), (0.0, wall[0][1]), *wall]
        parts, _ = occ.cut([face(inside)], [face(polygon) for polygon in obstacles.values()]) if obstacles else (
            [face(inside)], None)  # fmt: skip
        if turned:
            occ.revolve(parts, 0, 0, 0, 0, 0, 1, 2 * np.pi)
            occ.remove(parts, recursive=False)
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path
