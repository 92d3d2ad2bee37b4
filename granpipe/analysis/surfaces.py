"""Geometry of a field: positions of surfaces, sizes of voids and stagnant zones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, Mask, cell_vectors

LEAST_SURFACE = 3.0
"""Shortest free surface of which an angle is told, in particle diameters across."""

LEAST_HALF = 2.0
"""The same for one of its halves."""


class SurfaceAngle(NamedTuple):
    """Angle of a free surface below the horizontal and its standard error [rad]; positive where it falls outwards."""

    angle: float
    error: float


class SurfaceHalves(NamedTuple):
    """Angles of the inner and the outer half of a free surface, and the radius between them [m].

    `change` is what the field changes by, E of what lies between the levels, if the half that flows less were as steep
    as the other: of what is between both surfaces, at the speed beneath them.
    """

    inner: SurfaceAngle
    outer: SurfaceAngle
    radius: float
    change: float

    @property
    def apart(self) -> SurfaceAngle:
        """By how much one half is steeper than the other, whichever way they fall, and its standard error [rad]."""
        steeper = abs(abs(self.inner.angle) - abs(self.outer.angle))
        return SurfaceAngle(steeper, float(np.hypot(self.inner.error, self.outer.error)))


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


def surface_angle(field: Field, z_range: tuple[float, float], diameter: float) -> SurfaceAngle | None:
    """The angle of the uppermost free surface between two levels [m], by a straight line through its points.

    The surface is where bulk lies below a void; a column of cells that is bulk to the top, or to a wall, has none. Its
    standard error counts one independent point for each particle diameter [m]. None where it is shorter than
    `LEAST_SURFACE` diameters.
    """
    r, height = _uppermost(field, z_range)
    return _line(r, height, field.grid.cell, diameter) if len(r) * field.grid.cell >= LEAST_SURFACE * diameter else None


def surface_halves(field: Field, z_range: tuple[float, float], diameter: float) -> SurfaceHalves | None:
    """The angle of each half of that surface: a material has one, whatever the radius.

    None where a half is shorter than `LEAST_HALF` diameters.
    """
    r, height = _uppermost(field, z_range)
    if len(r) * field.grid.cell < 2 * LEAST_HALF * diameter:
        return None
    middle = len(r) // 2
    parts = np.s_[:middle], np.s_[middle:]
    inner, outer = (_line(r[half], height[half], field.grid.cell, diameter) for half in parts)
    change = _change_by_bend(field, z_range, r, height, diameter)
    return SurfaceHalves(inner, outer, float(0.5 * (r[middle - 1] + r[middle])), change)


def _change_by_bend(field: Field, z_range: tuple[float, float], r: Array, height: Array, diameter: float) -> float:
    """`change` of the halves of a surface through points r, height (n,) [m]."""
    middle, grid, squares = len(r) // 2, field.grid, speed(field) ** 2
    columns = np.searchsorted(grid.r_edges, r) - 1
    motion = grid.ring_area[columns] * _mean_below(squares[:, columns], grid, height, diameter)
    slower, faster = sorted((np.s_[:middle], np.s_[middle:]), key=lambda half: float(motion[half].sum()))
    slope, offset = np.polyfit(r[faster], height[faster], 1)
    # either slope may fall outwards or inwards: a ridge is not bent
    ways = (slope * (r[slower] - r[middle]), -slope * (r[slower] - r[middle]))
    apart = min((np.abs(height[slower] - slope * r[middle] - offset - way) for way in ways), key=np.sum)
    rows = (grid.z_centres > z_range[0]) & (grid.z_centres < z_range[1])
    whole = (grid.ring_area * np.where(field.bulk, squares, 0.0))[rows].sum()
    return float(np.sqrt((motion[slower] * apart).sum() / grid.cell / max(whole, 1e-300)))


def _uppermost(field: Field, z_range: tuple[float, float]) -> tuple[Array, Array]:
    """(n,) radii and heights [m] of the uppermost free surface, one for each column of cells that has one."""
    grid = field.grid
    rows = (grid.z_centres > z_range[0]) & (grid.z_centres < z_range[1])
    solid, inside, z = field.bulk[rows], field.inside_fraction[rows] > 0, grid.z_edges[1:][rows]
    free = solid[:-1] & ~solid[1:] & inside[1:]
    columns = np.flatnonzero(free.any(axis=0))
    if not len(columns):  # a section of less than two rows of cells has no surface in it
        return np.empty(0), np.empty(0)
    return grid.r_centres[columns], z[:-1][len(free) - 1 - free[::-1, columns].argmax(axis=0)]


def _mean_below(values: Array, grid: Grid, height: Array, depth: float) -> Array:
    """(n,) mean of values (nz, n) in columns, between a height (n,) and a depth [m] below it."""
    z = grid.z_centres[:, None]
    within = (z < height) & (z > height - max(depth, grid.cell))
    return np.asarray(np.where(within, values, 0.0).sum(axis=0) / np.maximum(within.sum(axis=0), 1))


def _line(r: Array, height: Array, cell: float, diameter: float) -> SurfaceAngle:
    """Angle of the straight line through points of a surface."""
    slope, offset = np.polyfit(r, height, 1)
    freedom = max(1.0, len(r) * cell / diameter - 2)
    scatter = float(np.sqrt(np.sum((height - slope * r - offset) ** 2) / np.sum((r - r.mean()) ** 2) / freedom))
    return SurfaceAngle(float(-np.arctan(slope)), scatter / (1 + float(slope) ** 2))


def displacement(points: Array, others: Array) -> float:
    """RMS distance [m] from each point (n, 2) of a line to the nearest of another (m, 2).

    Raises
    ------
    DataError : one of the lines has no point
    """
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
    grid = field.grid
    return float((field.inside_fraction * cells)[rows].sum()) * grid.cell * float(grid.r_edges[1] - grid.r_edges[0])
