"""``openfoam/``: a case for OpenFOAM that holds the solids' flow: a wedge mesh of the solid cells, U, phi and more.

The axis is z and r is along x. `mapFields` brings it onto a mesh of one's own; solvers of transport, such as
scalarTransportFoam, run on it as it is: phi [m³/s] is the flux of the field itself, which balances in every cell as the
field does. Nothing stands for what is not solid: its boundary is the patch `walls`.

A wedge of flat faces is a little narrower than the sector that it stands for: phi is that of the mesh's horizontal
faces, sin(angle)/angle of the sector's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granpipe.export.exported import Exported, number, numbers, write_lines
from granpipe.export.nodes import cell_sum
from granpipe.field import Array

WEDGE = np.deg2rad(2.0)
"""Angle of the wedge; OpenFOAM asks for less than 5°."""

Index = NDArray[np.intp]


@dataclass(frozen=True)
class Faces:
    """Faces of one kind that follow each other in the mesh.

    Parameters
    ----------
    corners : point numbers of each face, seen from outside its owner counterclockwise
    owner, neighbour : (n,) cells; no neighbour on a boundary
    flux : (n,) flow of bulk out of the owner [m³/s]
    velocity : (n, 3) [m/s]
    """

    corners: list[list[int]]
    owner: Index
    neighbour: Index
    flux: Array
    velocity: Array


def write_openfoam(exported: Exported, folder: Path) -> None:
    """Write mesh, fields and the least that OpenFOAM needs beside them, into an existing folder."""
    for part in ("constant/polyMesh", "0", "system"):
        (folder / part).mkdir(parents=True)
    inside, patches = _faces(exported)
    faces = [inside, *patches.values()]
    note = "; ".join(exported.head[:3])

    def write(name: str, kind: str, lines: Iterable[str]) -> None:
        location, _, last = name.rpartition("/")
        write_lines(folder / name, chain(_head(kind, location, last, note), lines))

    mesh = "constant/polyMesh"
    write(f"{mesh}/points", "vectorField", _list(f"({numbers(point)})" for point in _points(exported).tolist()))
    corners = chain.from_iterable(part.corners for part in faces)
    write(f"{mesh}/faces", "faceList", _list(f"{len(face)}({' '.join(map(str, face))})" for face in corners))
    write(f"{mesh}/owner", "labelList", _list(map(str, chain.from_iterable(part.owner.tolist() for part in faces))))
    write(f"{mesh}/neighbour", "labelList", _list(map(str, inside.neighbour.tolist())))
    write(f"{mesh}/boundary", "polyBoundaryMesh", _boundary(len(inside.owner), patches))

    def vector(rows: Array) -> Iterator[str]:
        return _values("vector", (f"({numbers(row)})" for row in rows.tolist()))

    def scalar(values: Array) -> Iterator[str]:
        return _values("scalar", map(number, values.tolist()))

    cells = exported.nodes.cells
    velocity = 0.25 * np.column_stack(
        [
            cell_sum(part)[cells]
            for part in (exported.nodes.bulk_u, np.zeros_like(exported.nodes.bulk_u), exported.nodes.bulk_w)
        ]
    )
    fixed = ("inlet", "outlet")
    speed = "[0 1 -1 0 0 0 0]"
    write(
        "0/U",
        "volVectorField",
        _field(
            speed,
            vector(velocity),
            patches,
            lambda name, faces: (
                ["type fixedValue;", *_named("value", vector(faces.velocity))]
                if name in fixed
                else ["type zeroGradient;"]
            ),
        ),
    )
    write(
        "0/phi",
        "surfaceScalarField",
        _field(
            "[0 3 -1 0 0 0 0]",
            scalar(inside.flux),
            patches,
            lambda name, faces: (["type calculated;", *_named("value", scalar(faces.flux))]),
            on_wedge=["value uniform 0;"],  # a field on faces is not read without
        ),
    )
    if exported.nodes.packing is not None:
        packing = 0.25 * cell_sum(exported.nodes.packing)[cells]
        write(
            "0/packing",
            "volScalarField",
            _field("[0 0 0 0 0 0 0]", scalar(packing), patches, lambda *_: (["type zeroGradient;"])),
        )
    write(
        "system/controlDict",
        "dictionary",
        [
            "application scalarTransportFoam;",
            "startFrom startTime;",
            "startTime 0;",
            "stopAt endTime;",
            "endTime 1;",
            "deltaT 1;",
            "writeControl timeStep;",
            "writeInterval 1;",
        ],
    )
    write(
        "system/fvSchemes",
        "dictionary",
        [
            "ddtSchemes { default Euler; }",
            "gradSchemes { default Gauss linear; }",
            "divSchemes { default none; div(phi,T) Gauss upwind; }",
            "laplacianSchemes { default Gauss linear corrected; }",
            "interpolationSchemes { default linear; }",
            "snGradSchemes { default corrected; }",
        ],
    )
    write("system/fvSolution", "dictionary", [
        "solvers { T { solver PBiCGStab; preconditioner DILU; tolerance 1e-12; relTol 0; } }",
        "SIMPLE { nNonOrthogonalCorrectors 0; }"])  # fmt: skip


def _numbers_of_points(exported: Exported) -> tuple[Index, Index]:
    """(nz+1, nr+1) number of the point of each node on the lower and upper side in y; one and the same on the axis."""
    used = exported.nodes.solids
    lower = np.cumsum(used).reshape(used.shape) - 1
    apart = used.copy()
    apart[:, 0] = False
    upper = np.where(apart, used.sum() + np.cumsum(apart).reshape(used.shape) - 1, lower)
    return lower, upper


def _points(exported: Exported) -> Array:
    nodes = exported.nodes
    r, z = np.meshgrid(nodes.r, nodes.z)
    apart = nodes.solids.copy()
    apart[:, 0] = False
    across, beside = np.cos(WEDGE / 2), np.sin(WEDGE / 2)
    lower, upper = (
        np.column_stack([across * r[used], side * beside * r[used], z[used]])
        for used, side in ((nodes.solids, -1.0), (apart, 1.0))
    )
    return np.concatenate([lower, upper])


def _faces(exported: Exported) -> tuple[Faces, dict[str, Faces]]:
    """Faces between cells in OpenFOAM's order, and the patches."""
    nodes, field = exported.nodes, exported.field
    cells = nodes.cells
    low, up = _numbers_of_points(exported)
    cell = np.where(cells, np.cumsum(cells).reshape(cells.shape) - 1, -1)
    padded = np.pad(cell, 1, constant_values=-1)
    narrower = np.sin(WEDGE)  # of a flat horizontal face over r² of the sector's radii
    through_r = 0.5 * narrower / np.pi * field.flux_r * field.velocity_scale * field.grid.side_area
    through_z = 0.5 * narrower / np.pi * field.flux_z * field.velocity_scale * field.grid.ring_area

    def made(iz: Index, ir: Index, kind: str, sign: int, owner: Index, neighbour: Index) -> Faces:
        """Faces across r at node column ir of row iz, or across z at level iz of column ir; sign 1: out is upwards."""
        if kind == "r":
            corners = np.stack([low[iz, ir], up[iz, ir], up[iz + 1, ir], low[iz + 1, ir]], axis=1)
            ends, flux = ((iz, ir), (iz + 1, ir)), through_r[iz, ir]
        else:
            corners = np.stack([low[iz, ir], low[iz, ir + 1], up[iz, ir + 1], up[iz, ir]], axis=1)
            ends, flux = ((iz, ir), (iz, ir + 1)), through_z[iz, ir]
        u, w = (0.5 * (values[ends[0]] + values[ends[1]]) for values in (nodes.bulk_u, nodes.bulk_w))
        return Faces(
            [list(dict.fromkeys(face[::sign])) for face in corners.tolist()],  # a triangle where one side is the axis
            owner, neighbour, sign * flux, np.column_stack([u, np.zeros(len(u)), w]),
        )  # fmt: skip

    iz, ir = np.nonzero(cells)
    own, none = cell[iz, ir], np.zeros(0, dtype=np.intp)
    right, above, left, below = padded[iz + 1, ir + 2], padded[iz + 2, ir + 1], padded[iz + 1, ir], padded[iz, ir + 1]
    has_right, has_above = right >= 0, above >= 0
    between = [
        made(iz[has_right], ir[has_right] + 1, "r", 1, own[has_right], right[has_right]),
        made(iz[has_above] + 1, ir[has_above], "z", 1, own[has_above], above[has_above]),
    ]
    inside = _sorted(_joined(between))
    top, bottom = (above < 0) & (iz == cells.shape[0] - 1), (below < 0) & (iz == 0)
    walls = [
        made(iz[here] + up_, ir[here] + out, kind, sign, own[here], none)
        for here, kind, sign, up_, out in (
            (right < 0, "r", 1, 0, 1),
            ((left < 0) & (ir > 0), "r", -1, 0, 0),
            ((above < 0) & ~top, "z", 1, 1, 0),
            ((below < 0) & ~bottom, "z", -1, 0, 0),
        )
    ]

    def side(points: Index, turn: int) -> Faces:
        corners = np.stack([points[iz, ir], points[iz, ir + 1], points[iz + 1, ir + 1], points[iz + 1, ir]], axis=1)[
            :, ::turn
        ]
        return Faces(corners.tolist(), own, none, np.zeros(len(own)), np.zeros((len(own), 3)))

    return inside, {
        "inlet": made(iz[top] + 1, ir[top], "z", 1, own[top], none),
        "outlet": made(iz[bottom], ir[bottom], "z", -1, own[bottom], none),
        "walls": _joined(walls),
        "front": side(low, 1),
        "back": side(up, -1),
    }


def _joined(parts: list[Faces]) -> Faces:
    return Faces(
        list(chain.from_iterable(part.corners for part in parts)),
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("owner", "neighbour", "flux", "velocity")
        ),
    )


def _sorted(faces: Faces) -> Faces:
    """By owner, then by neighbour."""
    order = np.lexsort((faces.neighbour, faces.owner))
    return Faces(
        [faces.corners[place] for place in order.tolist()],
        *(getattr(faces, name)[order] for name in ("owner", "neighbour", "flux", "velocity")),
    )


def _head(kind: str, location: str, name: str, note: str) -> Iterator[str]:
    yield f'FoamFile {{ version 2.0; format ascii; class {kind}; location "{location}"; object {name};'
    yield f'note "{note}"; }}'


def _list(items: Iterable[str]) -> Iterator[str]:
    rows = list(items)
    yield from (str(len(rows)), "(", *rows, ")")


def _boundary(first: int, patches: dict[str, Faces]) -> Iterator[str]:
    yield from (str(len(patches)), "(")
    for name, faces in patches.items():
        kind = {"walls": "wall", "front": "wedge", "back": "wedge"}.get(name, "patch")
        yield f"{name} {{ type {kind}; nFaces {len(faces.owner)}; startFace {first}; }}"
        first += len(faces.owner)
    yield ")"


def _values(kind: str, rows: Iterable[str]) -> Iterator[str]:
    yield f"nonuniform List<{kind}>"
    yield from _list(rows)
    yield ";"


def _named(name: str, lines: Iterable[str]) -> Iterator[str]:
    """An entry whose value begins on the line of its name."""
    for number_, line in enumerate(lines):
        yield f"{name} {line}" if number_ == 0 else line


def _field(
    dimensions: str,
    inside: Iterable[str],
    patches: dict[str, Faces],
    condition: Callable[[str, Faces], Iterable[str]],
    on_wedge: Iterable[str] = (),
) -> Iterator[str]:
    """Entries of a field; `on_wedge` is what the wedge's sides have beside their type."""
    yield f"dimensions {dimensions};"
    yield from _named("internalField", inside)
    yield "boundaryField {"
    for name, faces in patches.items():
        yield f"{name} {{"
        yield from condition(name, faces) if name not in ("front", "back") else ["type wedge;", *on_wedge]
        yield "}"
    yield "}"
