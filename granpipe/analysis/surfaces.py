"""Geometry of a field: positions of surfaces, sizes of voids and stagnant zones."""

from __future__ import annotations

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, Mask, cell_vectors


def crossings(values: Array, level: float, grid: Grid, where: Mask) -> Array:
    """(n, 2) points r, z [m] at which a quantity passes a level, linear between the middles of neighbouring cells.

    Parameters
    ----------
    values : (nz, nr) at the middles of the cells
    where : (nz, nr) cells that count: both of a pair must
    """
    r, z = np.meshgrid(grid.r_centres, grid.z_centres)
    middles = np.stack([r, z], axis=-1)
    above = values > level
    found = []
    for one, other in (np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:]):
        pair = where[one] & where[other] & (above[one] != above[other])
        before, behind = values[one][pair], values[other][pair]
        part = ((level - before) / (behind - before))[:, None]
        found.append((1 - part) * middles[one][pair] + part * middles[other][pair])
    return np.concatenate(found)


def bulk_edge(field: Field) -> Array:
    """(n, 2) points r, z [m] on free surfaces and round cavities: between bulk cells and void ones, no walls."""
    return crossings(field.bulk.astype(float), 0.5, field.grid, field.inside_fraction > 0)


def displacement(points: Array, others: Array) -> float:
    """RMS distance [m] from each point (n, 2) of a line to the nearest of another (m, 2)."""
    from scipy.spatial import KDTree

    if not len(points) or not len(others):
        raise DataError("one of the two lines has no point: no free surface, or the level is never passed")
    return float(np.sqrt(np.mean(KDTree(others).query(points)[0] ** 2)))


def speed(field: Field) -> Array:
    """(nz, nr) bulk speed in the middle of each cell, at the flow rate of the case [m/s]."""
    return np.asarray(np.hypot(*cell_vectors(field.flux_r, field.flux_z)) * field.velocity_scale)


def void_area(field: Field, z_range: tuple[float, float]) -> float:
    """Area in the r–z section [m²] that is void between two levels [m]: cavities, and what is over a free surface."""
    return _area(field, ~field.bulk, z_range)


def stagnant_area(field: Field, z_range: tuple[float, float], part: float = 0.02) -> float:
    """Area in the r–z section [m²] of bulk at rest between two levels [m]: slower than a part of the mean speed.

    The mean is that over the widest level: flow rate over its area.
    """
    widest = float((field.inside_fraction @ field.grid.ring_area).max())
    slow = speed(field) < part * field.bulk_flow * field.flow_scale / widest
    return _area(field, field.bulk & slow, z_range)


def _area(field: Field, cells: Mask, z_range: tuple[float, float]) -> float:
    """Area of some cells inside the outline, those counted whose middles lie between two levels."""
    z = field.grid.z_centres
    rows = (z > z_range[0]) & (z < z_range[1])
    return float((field.inside_fraction * cells)[rows].sum()) * field.grid.cell**2
