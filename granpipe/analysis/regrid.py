"""A field on another grid of its vessel, by its stream function."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, flux_from_psi

MOSTLY = 0.5
"""Part of what a cell has inside the vessel that must be bulk, for the cell to be."""


def on_grid(field: Field, grid: Grid, inside_fraction: Array) -> Field:
    """The field as it stands on other cells, finer or coarser; the same field where the cells are its own.

    ψ is taken as linear in r² (in a slab in x) and z between the nodes, in which a plug is exact; where nodes of the
    new grid are nodes of the old one, the new fluxes are exact means of the old ones. Standard errors are means of
    their squares over what a new face covers, and not smaller for that they are several: neighbours share particles.
    Plain averages, packing and what else was asked for are left out.

    Parameters
    ----------
    grid : of the same vessel, and for a slab of the same depth
    inside_fraction : (nz, nr) part of each of its cells inside the vessel

    Raises
    ------
    DataError : the field has no stream function
    """
    if field.grid.shape == grid.shape and np.allclose(field.grid.z_edges, grid.z_edges, atol=1e-6 * grid.cell):
        return field
    if field.psi is None:
        raise DataError("a field without a stream function stays on its own cells; run it with homogenize.method: psi")
    own, measure = field.grid, grid.measure
    reach, its_reach = measure.reach(grid.r_edges), measure.reach(own.r_edges)
    levels, lines = _between(grid.z_edges, own.z_edges), _between(reach, its_reach)
    rows, rings = _covered(grid.z_edges, own.z_edges), _covered(reach, its_reach)
    psi = levels @ field.psi @ lines.T
    flux_r, flux_z = flux_from_psi(psi, grid)
    inside = rows @ field.inside_fraction @ rings.T
    bulk = rows @ (field.bulk * field.inside_fraction) @ rings.T
    return replace(
        field,
        grid=grid,
        inside_fraction=inside_fraction,
        bulk=(inside_fraction > 0) & (inside > 0) & (bulk >= MOSTLY * inside),
        flux_r=flux_r,
        flux_z=flux_z,
        psi=psi,
        flux_r_se=_errors(field.flux_r_se, rows, lines),
        flux_z_se=_errors(field.flux_z_se, levels, rings),
        packing_fraction=None,
        raw_flux_r=None,
        raw_flux_z=None,
        raw_flux_r_se=None,
        raw_flux_z_se=None,
        extra={},
    )


def _errors(errors: Array | None, up: Array, across: Array) -> Array | None:
    """√ of the mean squares of those that are known; nan where none is."""
    if errors is None:
        return None
    known = ~np.isnan(errors)
    squares, counted = (up @ each @ across.T for each in (np.where(known, errors, 0.0) ** 2, known.astype(float)))
    return np.asarray(np.sqrt(np.divide(squares, counted, out=np.full_like(squares, np.nan), where=counted > 0)))


def _between(points: Array, nodes: Array) -> Array:
    """(n, m) weights that interpolate linearly from nodes to points; beyond the last nodes their values stay."""
    at = np.clip(np.searchsorted(nodes, points) - 1, 0, len(nodes) - 2)
    part = np.clip((points - nodes[at]) / (nodes[at + 1] - nodes[at]), 0.0, 1.0)
    weights, each = np.zeros((len(points), len(nodes))), np.arange(len(points))
    weights[each, at], weights[each, at + 1] = 1 - part, part
    return weights


def _covered(edges: Array, others: Array) -> Array:
    """(n, m) shares in each interval between edges of those between others; the nearest one's beyond these."""
    low, high = (np.clip(part, others[0], others[-1]) for part in (edges[:-1], edges[1:]))
    shares = np.minimum.outer(high, others[1:]) - np.maximum.outer(low, others[:-1])
    shares = np.maximum(shares, 0.0)
    beyond = shares.sum(axis=1) == 0
    shares[beyond, np.where(edges[1:][beyond] > others[0], -1, 0)] = 1.0
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))
