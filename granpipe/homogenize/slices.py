"""Spheres cut into horizontal discs at Gauss points over the height of every row of a grid: what all deposits share."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array, Grid

Index = NDArray[np.int64]


@cache
def gauss(points: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss–Legendre quadrature on −1 … 1."""
    node, weight = np.polynomial.legendre.leggauss(points)
    return node, weight


def lots(z: Array, cost: Array, most: float) -> Iterator[Index]:
    """Yield indices of the spheres from below, so that a lot fills few rows, in lots of about `most` of their costs."""
    order = np.argsort(z)
    lot = (np.cumsum(cost[order]) / most).astype(np.int64)
    yield from np.split(order, np.flatnonzero(np.diff(lot)) + 1) if len(order) else ()


def slab_points(z: Array, radius: Array, grid: Grid, points: int) -> tuple[Index, Index, Array, Array]:
    """Gauss points of every sphere in every row that it touches: owner, row, height and weight [m]."""
    low, high = z - radius, z + radius
    owner, row = spans(
        np.maximum(floor((low - grid.z_edges[0]) / grid.cell), 0),
        np.minimum(floor((high - grid.z_edges[0]) / grid.cell), grid.shape[0] - 1),
    )
    start = np.maximum(grid.z_edges[row], low[owner])
    half = 0.5 * np.maximum(np.minimum(grid.z_edges[row + 1], high[owner]) - start, 0)
    node, weight = gauss(points)
    height = (start + half)[:, None] + half[:, None] * node
    return np.repeat(owner, len(node)), np.repeat(row, len(node)), height.ravel(), (half[:, None] * weight).ravel()


def levels(z: Array, radius: Array, grid: Grid) -> tuple[Index, Index]:
    """Every level of the grid that cuts a sphere: (owner, level)."""
    bottom, cell = grid.z_edges[0], grid.cell
    return spans(
        np.maximum(floor((z - radius - bottom) / cell) + 1, 0),
        np.minimum(floor((z + radius - bottom) / cell), grid.shape[0]),
    )


def disc_radius(z: Array, radius: Array, height: Array) -> Array:
    """Radius [m] of the disc that a height cuts out of a sphere; 0 where it misses."""
    return np.sqrt(np.maximum(radius**2 - (height - z) ** 2, 0))


def spans(first: Index, last: Index) -> tuple[Index, Index]:
    """All (owner, value) with first ≤ value ≤ last of each owner, as two flat arrays."""
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(first)), count)
    start = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (first - start)[owner]


def floor(values: Array) -> Index:
    """Rounded down to whole numbers."""
    return np.floor(values).astype(np.int64)
