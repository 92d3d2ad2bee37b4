"""A field in space for ParaView and COMSOL Multiphysics: values at the middles of the cells."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granpipe.export.comsol import spreadsheet
from granpipe.export.exported import Column, numbers, write_lines
from granpipe.field import Array, Box, Field

if TYPE_CHECKING:
    import pyvista

SPARSE = 0.1
"""Of the reference packing: what solids are taken to fill of a cell at least, where its particles' velocity is told."""


def vtr_mesh(field: Field) -> pyvista.RectilinearGrid:
    """A rectilinear grid: packing, bulk mask, solids flux, bulk and particle velocity in its cells [m/s].

    At the flow rate of the case.
    """
    import pyvista

    grid = box_of(field)
    mesh = pyvista.RectilinearGrid(grid.r_edges, grid.y_edges, grid.z_edges)
    packing = _packing(field)
    flux = np.stack(cell_fluxes(field), axis=-1)
    mesh.cell_data["packing_fraction"] = packing.ravel()
    mesh.cell_data["bulk"] = field.bulk.astype(np.uint8).ravel()
    mesh.cell_data["solids_flux"] = flux.reshape(-1, 3) * field.flow_scale
    mesh.cell_data["bulk_velocity"] = flux.reshape(-1, 3) * field.velocity_scale
    mesh.cell_data["particle_velocity"] = flux.reshape(-1, 3) * _per_solids(field).reshape(-1, 1)
    return mesh


def write_vtr(field: Field, path: Path) -> None:
    """Write ``field.vtr``."""
    vtr_mesh(field).save(path)


def write_text(field: Field, folder: Path, *, name: str, date: datetime) -> None:
    """Write the Spreadsheet format: bulk and particle velocity and packing at the middles of the cells."""
    grid, packing = box_of(field), _packing(field)
    z, y, x = np.meshgrid(*map(_middles, (grid.z_edges, grid.y_edges, grid.r_edges)), indexing="ij")
    columns, per_solids = [], _per_solids(field)
    for letter, axis, flux in zip("uvw", "xyz", cell_fluxes(field), strict=True):
        bulk, own = flux * field.velocity_scale, flux * per_solids
        columns.append(Column(f"{letter}_bulk", "m/s", f"Bulk velocity along {axis}", bulk))
        columns.append(Column(f"{letter}_particle", "m/s", f"Particle velocity along {axis}", own))
    columns.append(Column("packing", "1", "Solids fraction", packing))
    lines = spreadsheet({"x": x, "y": y, "z": z}, columns, name, date)
    write_lines(folder / "flow_spreadsheet.txt", lines)


def write_grid(field: Field, folder: Path) -> None:
    """Write the Grid format, a file for each component of the bulk velocity and for the packing.

    Values at the middles of the cells: x, y and z on a line each, then a row of all x for each y, and so on for each z.
    """
    grid = box_of(field)
    axes = [numbers(_middles(edges).tolist()) for edges in (grid.r_edges, grid.y_edges, grid.z_edges)]
    values = {f"{name}_grid": flux * field.velocity_scale for name, flux in zip("uvw", cell_fluxes(field), strict=True)}
    for name, array in (values | {"phi_grid": _packing(field)}).items():
        rows = array.reshape(-1, array.shape[-1])
        write_lines(folder / f"{name}.txt", ["% Grid", *axes, "% Data", *map(numbers, rows.tolist())])


def box_of(field: Field) -> Box:
    """The grid of a field in space."""
    assert isinstance(field.grid, Box)
    return field.grid


def _packing(field: Field) -> Array:
    assert field.packing_fraction is not None
    return field.packing_fraction


def cell_fluxes(field: Field) -> tuple[Array, Array, Array]:
    """(nz, ny, nx) flux along x, y and z in the middle of the cells: the mean of two faces [m/s]."""
    assert field.flux_y is not None
    x, y, z = field.flux_r, field.flux_y, field.flux_z
    return 0.5 * (x[..., 1:] + x[..., :-1]), 0.5 * (y[:, 1:] + y[:, :-1]), 0.5 * (z[1:] + z[:-1])


def _per_solids(field: Field) -> Array:
    """(nz, ny, nx) velocity of particles, at the flow rate of the case, over the mean flux in a cell, at DEM scale.

    One over the part of the cell that solids fill, 0 where nothing is. Where they fill less than `SPARSE` of the
    reference packing, as if they filled so much: a cell that hardly any particle has been in still has the flux that
    conserving gives it.
    """
    filled = _packing(field) * field.inside_fraction
    return np.where(filled > 0, field.flow_scale / np.maximum(filled, SPARSE * field.bulk_packing), 0.0)


def _middles(edges: Array) -> Array:
    return 0.5 * (edges[1:] + edges[:-1])
