"""From segment sums to a `Field`: the raw average alone, and the article's method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, level_flow
from granpipe.homogenize.average import Sums
from granpipe.homogenize.conserve import Plug, scale_rows
from granpipe.homogenize.smooth import bulk_mask, flowing_faces, smooth
from granpipe.homogenize.space_outlets import fluxes
from granpipe.homogenize.statistics import BLOCKS, LEAST_BLOCKS, blocks, errors_in_space, flux_errors


def packing_fraction(volume: Array, inside_fraction: Array, grid: Grid) -> Array:
    """(nz, nr) solids fraction of the part of each cell inside the outline; at most 1, 0 outside.

    Slivers of cells along an oblique wall can hold more solids than room, because contacts are soft and spheres
    overlap the wall.
    """
    room = inside_fraction * grid.cell_volume
    return np.clip(np.divide(volume, room, out=np.zeros_like(volume), where=room > 0), 0, 1)


def raw_field(sums: Sums, inside_fraction: Array, plug: Plug, diameter: float, flow_scale: float = 1.0) -> Field:
    """The plain average as a field, nothing adjusted."""
    flux_r, flux_z = sums.mean_flux
    return Field(
        grid=sums.grid,
        packing_fraction=packing_fraction(sums.mean_volume, inside_fraction, sums.grid),
        inside_fraction=inside_fraction,
        bulk=bulk_mask(sums.mean_volume, inside_fraction, sums.grid, plug.packing, diameter),
        flux_r=flux_r,
        flux_z=flux_z,
        bulk_flow=plug.bulk_flow,
        bulk_packing=plug.packing,
        flow_scale=flow_scale,
        raw_flux_r=flux_r,
        raw_flux_z=flux_z,
        flux_y=sums.mean_flux_y,
    )


def with_standard_errors(field: Field, segments: Sequence[Sums], diameter: float) -> Field:
    """A plain average with its standard errors from blocks of its segments; without where there are too few.

    Parameters
    ----------
    segments : those of the average
    diameter : particle diameter [m]
    """
    if len(segments) < LEAST_BLOCKS:
        return field
    if field.flux_y is not None:
        joined = blocks(segments, min(len(segments), 2 * LEAST_BLOCKS))  # more fluxes in space at once take much memory
        run = np.array([block.run for block in joined])
        (x, y, z), _ = errors_in_space([fluxes(block) for block in joined], run, field.grid, diameter)
        return replace(field, flux_r_se=x, flux_y_se=y, flux_z_se=z, raw_flux_r_se=x, raw_flux_z_se=z)
    joined = blocks(segments, min(len(segments), BLOCKS))
    run = np.array([block.run for block in joined])
    (flux_r, flux_z), _ = flux_errors([block.mean_flux for block in joined], run, field.grid, diameter)
    return replace(field, flux_r_se=flux_r, flux_z_se=flux_z, raw_flux_r_se=flux_r, raw_flux_z_se=flux_z)


def gaussian_field(
    sums: Sums, inside_fraction: Array, plug: Plug, diameter: float, passes: int, flow_scale: float = 1.0
) -> Field:
    """The article's adjustment: rows scaled to the plug's flow, Gaussian `passes` times, rows scaled again.

    Parameters
    ----------
    sums : the average
    inside_fraction : (nz, nr) part of each cell inside the outline
    plug : packing and flow in the plug
    diameter : particle diameter [m]
    passes : number of 5×5 Gaussian convolutions
    flow_scale : flow of the case over that of the simulation

    Raises
    ------
    DataError : hardly any flow passes a level
    """
    raw = raw_field(sums, inside_fraction, plug, diameter, flow_scale)
    faces = flowing_faces(raw.bulk, inside_fraction)
    flux = scale_rows(raw.flux_r * faces[0], raw.flux_z * faces[1], raw.grid, plug.solids_flow)
    flux = scale_rows(*smooth(*flux, faces, passes), raw.grid, plug.solids_flow)
    return replace(raw, flux_r=flux[0], flux_z=flux[1])


def unguided_plug(sums: Sums) -> Plug:
    """Stand-in for `measure_plug` where no outline tells where the plug is: an estimate from the whole grid.

    The packing is the median over the cells that hold more than half of what the fullest tenth of all cells holds;
    the flow is the mean over all levels.

    Raises
    ------
    DataError : there is no particle on the grid
    """
    packing = sums.mean_volume / sums.grid.cell_volume
    full = packing[packing > 0.5 * np.quantile(packing, 0.9)]
    if not len(full):
        raise DataError("no particles on the grid")
    flows = level_flow(sums.mean_flux[1], sums.grid)
    flow = float(flows.mean())
    spread = float(np.abs(flows - flow).max() / abs(flow)) if flow else np.inf
    return Plug(float(np.median(full)), flow, spread, (float(sums.grid.z_edges[0]), float(sums.grid.z_edges[-1])))
