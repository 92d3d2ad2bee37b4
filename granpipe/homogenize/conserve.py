"""Packing and flow of the plug above the plate, and the article's scaling of every row to that flow.

Sparta & Halvorsen (2017), Appendix B: the bulk flow, which the plate imposes, scales the flow of every row of the grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from granpipe.errors import DataError
from granpipe.field import Array, Grid, Mask, level_flow
from granpipe.homogenize.average import Sums

_LEAST_FLOW = 0.05  # of the plug's: a level that carries less is not in steady flow, and no factor mends it


@dataclass(frozen=True)
class Plug:
    """Packing and flow in the plug.

    Parameters
    ----------
    packing : φ_ref, solids fraction away from the walls
    solids_flow : solids through the whole section, positive downwards [m³/s]
    spread : largest deviation of a level's flow from `solids_flow`, as a part of it
    z_range : bottom and top of the plug [m]
    """

    packing: float
    solids_flow: float
    spread: float
    z_range: tuple[float, float]

    @property
    def bulk_flow(self) -> float:
        """Φ: flow of the bulk material, voids included [m³/s]."""
        return self.solids_flow / self.packing


def measure_plug(
    sums: Sums,
    inside_fraction: Array,
    z_range: tuple[float, float],
    diameter: float,
    packing: float | None = None,
    left: Array | float = 0.0,
) -> Plug:
    """Measure the plug in the rows wholly inside `z_range`.

    Parameters
    ----------
    sums : the average
    inside_fraction : (nz, nr) part of each cell inside the outline
    z_range : bottom and top of the plug [m]; at least five particle diameters from the plate, which orders particles
    diameter : particle diameter [m]: the layer of this thickness along walls is left out of the packing (its order
        lowers the mean), but not of the flow
    packing : φ_ref where the case gives it; the flow is measured all the same
    left : (nz+1,) solids that have left above each level, through outlets that lie higher [m³/s]

    Raises
    ------
    DataError : no row lies between the levels, or nothing flows down there
    """
    rows = _rows(sums.grid, z_range)
    flows = (level_flow(sums.mean_flux[1], sums.grid) + left)[plug_levels(sums.grid, z_range)]
    flow = float(flows.mean())
    if flow <= 0:
        raise DataError(f"no downward flow in the plug, z = {z_range[0]:g} … {z_range[1]:g} m: {flow:g} m³/s")
    return Plug(
        packing if packing is not None else _core_packing(sums, inside_fraction, rows, diameter),
        flow,
        float(np.abs(flows / flow - 1).max()),
        z_range,
    )


def _rows(grid: Grid, z_range: tuple[float, float]) -> Mask:
    """(nz,) rows wholly within a range of z [m]."""
    rows = (grid.z_edges[:-1] >= z_range[0] - 1e-9) & (grid.z_edges[1:] <= z_range[1] + 1e-9)
    if not rows.any():
        raise DataError(f"no row of the grid lies in the plug, z = {z_range[0]:g} … {z_range[1]:g} m: use a finer cell")
    return np.asarray(rows)


def plug_levels(grid: Grid, z_range: tuple[float, float]) -> Mask:
    """(nz+1,) levels that bound the rows of the plug.

    Raises
    ------
    DataError : no row of the grid lies between the levels
    """
    rows = _rows(grid, z_range)
    return np.append(rows, False) | np.insert(rows, 0, False)


def gathered_flow(sums: Sums, z_range: tuple[float, float]) -> Array:
    """(nz+1,) flow of each level beyond the plug's that the measured change of the filling explains [m³/s].

    Raises
    ------
    DataError : no row of the grid lies in the plug
    """
    rows = sums.storage.reshape(len(sums.storage), -1).sum(axis=1)
    total = np.concatenate([[0.0], np.cumsum(rows)])
    return np.asarray(total - total[plug_levels(sums.grid, z_range)].mean())


def bed_packing(sums: Sums, inside_fraction: Array, bottom: float, diameter: float) -> float:
    """φ_ref of a bed that discharges freely: solids above an outlet are dilated, and so no measure of the bulk.

    The median over the cells above a level, at least a diameter from every wall and ledge, that hold more than half of
    what the fullest tenth of them holds: bed, not void. Over the whole vessel where it ends below that level.

    Parameters
    ----------
    sums, inside_fraction, diameter : as for `measure_plug`
    bottom : lower end of the bed that counts [m]

    Raises
    ------
    DataError : no cell is that far from the walls
    """
    core = _far_from_walls(inside_fraction, sums.grid, diameter, along_z=True)
    if not core.any():
        raise DataError(f"the vessel is too narrow for its packing to be measured {diameter:g} m away from its walls")
    above = core & _as_cells(sums.grid.z_edges[:-1] >= bottom - 1e-9, core)
    packing = (sums.mean_volume / sums.grid.cell_volume)[above if above.any() else core]
    return float(np.median(packing[packing > 0.5 * np.quantile(packing, 0.9)]))


def _core_packing(sums: Sums, inside_fraction: Array, rows: Mask, diameter: float) -> float:
    """Solids fraction of the cells of some rows that are at least a diameter from every wall."""
    core = _far_from_walls(inside_fraction, sums.grid, diameter, along_z=False) & _as_cells(rows, inside_fraction)
    if not core.any():
        raise DataError(f"the plug is too narrow for its packing to be measured {diameter:g} m away from its walls")
    return float(sums.mean_volume[core].sum() / np.broadcast_to(sums.grid.cell_volume, core.shape)[core].sum())


def _far_from_walls(inside_fraction: Array, grid: Grid, diameter: float, along_z: bool) -> Mask:
    """Cells at least a diameter from every wall, sidewise or, with `along_z`, from every ledge as well."""
    reach = int(np.ceil(diameter / grid.cell))
    # beyond the outermost edge is wall; on the other side of an axis is the vessel
    sides = [(0 if grid.measure.axial else reach, reach)] * (inside_fraction.ndim - 1)
    window = 2 * reach + 1
    walled = np.pad(inside_fraction, [(0, 0), *sides])
    nearest = ndimage.minimum_filter(walled, (window if along_z else 1, *[window] * len(sides)), mode="nearest")
    inner = [slice(low, low + n) for (low, _), n in zip(sides, inside_fraction.shape[1:], strict=True)]
    return np.asarray(nearest[(slice(None), *inner)] > 1 - 1e-9)


def _as_cells(rows: Mask, cells: Array | Mask) -> Mask:
    """(nz,) rows in a shape that goes with that of cells."""
    return rows.reshape(-1, *[1] * (cells.ndim - 1))


def scale_rows(flux_r: Array, flux_z: Array, grid: Grid, solids_flow: float) -> tuple[Array, Array]:
    """Scale every row to the same flow: both components by one factor per level.

    The faces of a level get its factor, the cylindrical faces of a row the mean of its two levels' factors.

    Raises
    ------
    DataError : hardly any flow passes a level
    """
    flow = level_flow(flux_z, grid)
    weak = np.flatnonzero(flow < _LEAST_FLOW * solids_flow)
    if len(weak):
        raise DataError(
            f"hardly any flow through z = {grid.z_edges[weak[0]]:g} m: {flow[weak[0]]:g} m³/s of solids, where the "
            f"plug carries {solids_flow:g} m³/s: not steady yet (average later or longer), or blocked there"
        )
    factor = solids_flow / flow
    return flux_r * (0.5 * (factor[1:] + factor[:-1]))[:, None], flux_z * factor[:, None]
