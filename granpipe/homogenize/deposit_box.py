"""Spheres → Cartesian cells: the discs of `granpipe.homogenize.slices` cut into rectangles, exactly.

With a and b the distances of two edges from a disc's centre, at most its radius s, the part of the disc between its
centre lines and these edges is P(a, b) = |a b| where their corner lies inside it, g(|a|) + g(|b|) − π s²/4 otherwise,
g(a) = (a √(s² − a²) + s² asin(a/s))/2, with the sign of a b. Rectangles are second differences of P, so that whatever
the cells, the disc is kept. Through a face flows the velocity across it times the chord of the disc on its edge.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from granpipe.field import Array, Box
from granpipe.homogenize.slices import Index, disc_radius, floor, gauss, levels, lots, slab_points
from granpipe.system.interrupts import uninterrupted

_CHUNK = 1 << 18  # corners of rectangles at a time


class _Patch(NamedTuple):
    """Edges round a disc along one direction: their distance from its centre (m, k+1) [m], number of the first (m,)."""

    edge: Array
    first: Index

    @classmethod
    def round(cls, centre: Array, radius: Array, edges: Array) -> _Patch:
        """The edges that enclose each disc; as many for all as the largest needs, clipped to the disc."""
        count, low = len(edges) - 1, edges[0]
        step = (edges[-1] - low) / count
        first = floor((centre - radius - low) / step)
        most = int((floor((centre + radius - low) / step) - first).max(initial=0)) + 2
        offset = low + (first[:, None] + np.arange(most)) * step - centre[:, None]
        return cls(np.clip(offset, -radius[:, None], radius[:, None]), first)

    @classmethod
    def across(cls, centre: Array, radius: Array, edges: Array, cut: bool) -> _Patch:
        """The two ends of the grid; unless they cut the discs, these lie wholly between them."""
        ends = edges - centre[:, None] if cut else np.array([-np.inf, np.inf])
        return cls(np.clip(ends, -radius[:, None], radius[:, None]), np.zeros(len(centre), dtype=np.int64))


class _Discs(NamedTuple):
    """Discs with what carries their volume and flow, each (m,): row (or level), place and radius [m], weight."""

    row: Index
    x: Array
    y: Array
    radius: Array
    weight: Array


def add_to_boxes(
    position: Array,
    radius: Array,
    velocity: Array,
    grid: Box,
    points: int,
    volume: Array,
    flow_x: Array,
    flow_z: Array,
    flow_y: Array,
) -> None:
    """Add spheres to the deposit on a grid in the plane or in space; only what lies inside the grid counts.

    Parameters
    ----------
    position, radius, velocity : (n, 3), (n,), (n, 3) [m, m/s]
    points : Gauss points over the height of each cell
    volume, flow_x, flow_z, flow_y : see `granpipe.homogenize.deposit.Deposit`
    """
    _kernel()(position, radius, velocity, grid, points, volume, flow_x, flow_z, flow_y)


@cache
def _kernel() -> Callable[..., None]:
    """The compiled kernel where numba is installed, otherwise numpy's."""
    try:
        import granpipe.homogenize.deposit_box_numba  # noqa: F401
    except ImportError:
        return _add
    return _add_compiled


def _add_compiled(position: Array, radius: Array, velocity: Array, grid: Box, points: int, *total: Array) -> None:
    """Add spheres to volume and flows along x, z and y."""
    from granpipe.homogenize.deposit_box_numba import add

    in_space = [array[:, None] if grid.flat and array.size else array for array in total]
    if grid.flat:
        in_space[3] = np.zeros((0, 0, 0))
    edges = grid.r_edges, grid.y_edges, grid.z_edges
    with uninterrupted():
        add(position, radius, velocity, *edges, grid.flat, grid.cut, *gauss(points), *in_space)


def _add(
    position: Array,
    radius: Array,
    velocity: Array,
    grid: Box,
    points: int,
    volume: Array,
    flow_x: Array,
    flow_z: Array,
    flow_y: Array,
) -> None:
    """The same by numpy alone."""
    across = 2 * radius / grid.cell + 2
    cost = across * (points + 1) * across * (2 if grid.flat else across)
    for lot in lots(position[:, 2], cost, _CHUNK):
        (x, y, z), a, v = position[lot].T, radius[lot], velocity[lot]
        owner, row, height, weight = slab_points(z, a, grid, points)
        discs = _Discs(row, x[owner], y[owner], disc_radius(z[owner], a[owner], height), weight)
        along_x, along_y = _patches(discs, grid)
        _scatter(volume, discs, along_x, along_y, _areas(discs, along_x, along_y))
        pushed = discs._replace(weight=weight * v[owner, 0])
        _scatter(flow_x, pushed, along_x, along_y, _chords(discs.radius, along_x.edge, along_y.edge))
        if not grid.flat:
            pushed = discs._replace(weight=weight * v[owner, 1])
            chords = _chords(discs.radius, along_y.edge, along_x.edge).transpose(0, 2, 1)
            _scatter(flow_y, pushed, along_x, along_y, chords)
        owner, level = levels(z, a, grid)
        discs = _Discs(level, x[owner], y[owner], disc_radius(z[owner], a[owner], grid.z_edges[level]), v[owner, 2])
        along_x, along_y = _patches(discs, grid)
        _scatter(flow_z, discs, along_x, along_y, _areas(discs, along_x, along_y))


def _patches(discs: _Discs, grid: Box) -> tuple[_Patch, _Patch]:
    along_x = _Patch.round(discs.x, discs.radius, grid.r_edges)
    if grid.flat:
        return along_x, _Patch.across(discs.y, discs.radius, grid.y_edges, grid.cut)
    return along_x, _Patch.round(discs.y, discs.radius, grid.y_edges)


def _areas(discs: _Discs, along_x: _Patch, along_y: _Patch) -> Array:
    """(m, ky, kx) part of each disc in each rectangle of its patch [m²]."""
    a, b, s = along_x.edge[:, None, :], along_y.edge[:, :, None], discs.radius[:, None, None]
    beyond = _half(a, s) + _half(b, s) - 0.25 * np.pi * s**2
    part = np.copysign(np.where(a**2 + b**2 < s**2, np.abs(a * b), np.maximum(beyond, 0)), a * b)
    return np.diff(np.diff(part, axis=1), axis=2)


def _half(a: Array, s: Array) -> Array:
    """g(|a|): half the area of a disc of radius s between its centre line and the chord at a."""
    sine = np.divide(np.abs(a), s, out=np.zeros(np.broadcast_shapes(a.shape, s.shape)), where=s > 0)
    return np.asarray(0.5 * s**2 * (sine * np.sqrt(np.maximum(1 - sine**2, 0)) + np.arcsin(np.minimum(sine, 1))))


def _chords(radius: Array, edge: Array, ends: Array) -> Array:
    """(m, k, e) length of the chord that each edge (m, e) cuts out of its disc, in each of the intervals (m, k+1)."""
    half = np.sqrt(np.maximum(radius[:, None] ** 2 - edge**2, 0))[:, None, :]
    return np.diff(np.clip(ends[:, :, None], -half, half), axis=1)


def _scatter(total: Array, discs: _Discs, along_x: _Patch, along_y: _Patch, values: Array) -> None:
    """Add weight × values (m, ky, kx) of each disc to where its patch lies on the grid."""
    if not values.size:
        return
    shape = (total.shape[0], total.size // (total.shape[0] * total.shape[-1]), total.shape[-1])
    first = int(discs.row.min())
    rows = int(discs.row.max()) - first + 1
    ix = along_x.first[:, None] + np.arange(values.shape[2])
    iy = along_y.first[:, None] + np.arange(values.shape[1])
    on_x, on_y = (ix >= 0) & (ix < shape[2]), (iy >= 0) & (iy < shape[1])
    at = ((discs.row - first)[:, None, None] * shape[1] + (iy * on_y)[:, :, None]) * shape[2] + (ix * on_x)[:, None, :]
    amount = values * (discs.weight[:, None, None] * on_y[:, :, None] * on_x[:, None, :])
    added = np.bincount(at.ravel(), amount.ravel(), rows * shape[1] * shape[2])
    total[first : first + rows] += added.reshape(rows, *total.shape[1:])
