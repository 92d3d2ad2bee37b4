"""field.vtu: the field for ParaView, pyvista and every program that reads VTK."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granpipe.export.nodes import Nodes, nodal_values
from granpipe.export.quantities import at_process_scale
from granpipe.field import Array, Field, Mask

if TYPE_CHECKING:
    import meshio

Whole = NDArray[np.integer[Any]]
Data = NDArray[Any]


def vtu_mesh(field: Field) -> meshio.Mesh:
    """The cells inside the outline as quads in the plane (x, z) = (r, z), so that they lie in the 3-D vessel.

    At the flow rate of the case. Cell data: the packing fraction where known, the part inside the outline, the bulk
    mask, and the solids flux through each of the four faces [m/s], which balances exactly as far as the field does.
    Point data: bulk and particle velocity as vectors [m/s], solids mask, ψ where known.

    Raises
    ------
    DataError : a value of the field is not a number
    """
    import meshio

    nodes = nodal_values(field)
    inside = field.inside_fraction > 0
    corners, used = _quads(nodes, inside)
    r, z = np.meshgrid(nodes.r, nodes.z)
    points = np.column_stack([r.ravel(), np.zeros(r.size), z.ravel()])[used]
    return meshio.Mesh(
        points,
        [("quad", corners)],
        point_data={name: values.reshape(r.size, -1).squeeze()[used] for name, values in _point_data(nodes).items()},
        cell_data={name: [values[inside]] for name, values in _cell_data(field).items()},
    )


def write_vtu(field: Field, path: Path) -> None:
    """Write ``field.vtu``.

    Raises
    ------
    DataError : a value of the field is not a number
    """
    vtu_mesh(field).write(path, file_format="vtu")


def write_fluid_vtu(points: Array, triangles: Whole, u: Array, w: Array, psi: Array, path: Path) -> None:
    """Write a fictitious fluid on its own mesh, in the plane (x, z) = (r, z).

    Parameters
    ----------
    points : (n, 2) r and z [m]
    triangles : (m, 3) corner indices
    u, w : (n,) radial and vertical velocity [m/s]
    psi : (n,) stream function [m³/s per radian]
    """
    import meshio

    in_space = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    data = {"bulk_velocity": _vectors(u, w), "psi": psi}
    meshio.Mesh(in_space, [("triangle", triangles)], point_data=data).write(path, file_format="vtu")


def _quads(nodes: Nodes, inside: Mask) -> tuple[Whole, Whole]:
    """Corners of each cell inside, anticlockwise, counted among the nodes in use; and the flat indices of those."""
    iz, ir = np.nonzero(inside)
    lower = iz * len(nodes.r) + ir
    upper = lower + len(nodes.r)
    used, corners = np.unique(np.column_stack([lower, lower + 1, upper + 1, upper]), return_inverse=True)
    return corners.reshape(-1, 4), used


def _point_data(nodes: Nodes) -> dict[str, Data]:
    data: dict[str, Data] = {
        "bulk_velocity": _vectors(nodes.bulk_u, nodes.bulk_w),
        "solids": nodes.solids.astype(np.uint8),
    }
    if nodes.particle_u is not None and nodes.particle_w is not None:
        data["particle_velocity"] = _vectors(nodes.particle_u, nodes.particle_w)
    if nodes.psi is not None:
        data["psi"] = nodes.psi
    return data


def _vectors(u: Array, w: Array) -> Array:
    return np.stack([u, np.zeros_like(u), w], axis=-1)


def _cell_data(field: Field) -> dict[str, Data]:
    flux_r, flux_z = field.flux_r * field.flow_scale, field.flux_z * field.flow_scale
    data: dict[str, Data] = {
        "inside_fraction": field.inside_fraction,
        "bulk": field.bulk.astype(np.uint8),
        "solids_flux_inner": flux_r[:, :-1],
        "solids_flux_outer": flux_r[:, 1:],
        "solids_flux_lower": flux_z[:-1],
        "solids_flux_upper": flux_z[1:],
    }
    if field.packing_fraction is not None:
        data["packing_fraction"] = field.packing_fraction
    return data | _extra_cell_data(field)


def _extra_cell_data(field: Field) -> dict[str, Data]:
    """What the case asks for beside, as far as it stands in the cells; NaN where it is not known."""
    data: dict[str, Data] = {}
    for name, values in field.extra.items():
        if values.shape == field.grid.shape:
            data[field.grid.name_of(name)] = at_process_scale(field, name)
        elif values.shape[1:] == field.grid.shape:
            data |= {f"{name}_{number}": values for number, values in enumerate(values, start=1)}
    if "particle_u" in data:
        u, w = data.pop("particle_u"), data.pop("particle_w")
        data["cell_particle_velocity"] = _vectors(u, w) * field.flow_scale
    return data
