"""Spheres → (r, z) grid: the exact volume of every sphere in every ring, and its flow through the rings' faces.

A slice through a sphere is a disc of radius s at axis distance D. The part of the disc within radius R of the axis is
the lens of two circles; cells take differences of it in R, integrated over their height by Gauss–Legendre. The area
of the whole disc is quadratic in z, so two points already keep the sphere's volume to rounding.

The flow is staggered: through z-faces v_z times the lens differences at the face's height, through r-faces the local
radial component of the sphere's velocity, v_r cos φ, over the arc of the circle R inside the disc. Both are the exact
rate of change of the deposited volume, up to quadrature in z: ∂V/∂t + ∇·flow = 0 cell by cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array, Grid

Index = NDArray[np.int64]

_LEAST_DISTANCE = 1e-30
_LEAST_K2 = 1e-200  # root far below the least distance
_CHUNK = 1 << 15  # lens evaluations at a time: bounds the memory, and fits the cache


class Deposit(NamedTuple):
    """Solids on a grid.

    volume : (nz, nr) solids in each cell [m³]
    flow_r : (nz, nr+1) solids flow through the cylindrical faces, positive outwards [m³/s]
    flow_z : (nz+1, nr) solids flow through the horizontal faces, positive upwards [m³/s]
    """

    volume: Array
    flow_r: Array
    flow_z: Array


def deposit(position: Array, radius: Array, velocity: Array, grid: Grid, points: int = 3) -> Deposit:
    """Deposit spheres and their flow on a grid.

    Spheres that reach above or below the grid count with their part in it. Spheres that reach across its outermost
    radius count there wholly, in the outermost ring, as long as their centre is inside (contacts are soft: walls are
    overlapped by a little, and no volume shall be lost there); of those with the centre outside, only the inner part.

    Parameters
    ----------
    position : (n, 3) centres [m], the grid's axis is x = y = 0
    radius : (n,) [m]
    velocity : (n, 3) [m/s]
    points : Gauss points over the height of each cell
    """
    rows, columns = grid.shape
    volume, flow_r, flow_z = np.zeros((rows, columns)), np.zeros((rows, columns + 1)), np.zeros((rows + 1, columns))
    # on the axis itself no direction is radial; what crosses a ring there cancels over the circle
    axis_distance = np.maximum(np.hypot(position[:, 0], position[:, 1]), _LEAST_DISTANCE)
    radial_velocity = (velocity[:, :2] * position[:, :2]).sum(axis=1) / axis_distance
    gauss = np.polynomial.legendre.leggauss(points)
    for chunk in _chunks(position[:, 2], radius, grid, points):
        z, a, D = position[chunk, 2], radius[chunk], axis_distance[chunk]
        owner, row, height, weight = _slab_points(z, a, grid, gauss)
        slices = _slices(owner, row, height, z, a, D)
        first, parts, arcs = _ring_parts(slices, grid, weight, weight * radial_velocity[chunk][owner])
        volume[first : first + len(parts)] += parts
        flow_r[first : first + len(arcs)] += arcs
        owner, level = _levels(z, a, grid)
        slices = _slices(owner, level, grid.z_edges[level], z, a, D)
        first, parts, _ = _ring_parts(slices, grid, velocity[chunk, 2][owner])
        flow_z[first : first + len(parts)] += parts
    return Deposit(volume, flow_r, flow_z)


class _Slices(NamedTuple):
    """Horizontal discs: their row (or level) on the grid, axis distance D and radius s [m], each (m,)."""

    row: Index
    distance: Array
    radius: Array


def _slices(owner: Index, row: Index, height: Array, z: Array, a: Array, D: Array) -> _Slices:
    """Discs at `height` of the spheres `owner` of centres z, radii a and axis distances D."""
    return _Slices(row, D[owner], np.sqrt(np.maximum(a[owner] ** 2 - (height - z[owner]) ** 2, 0)))


def _chunks(height: Array, radius: Array, grid: Grid, points: int) -> Iterator[Index]:
    """Yield indices of the spheres that touch the grid, from below, in lots of about `_CHUNK` lens evaluations."""
    touching = np.flatnonzero((height + radius > grid.z_edges[0]) & (height - radius < grid.z_edges[-1]))
    touching = touching[np.argsort(height[touching])]  # a lot then fills few rows
    across = 2 * radius[touching] / grid.cell + 1
    cost = np.minimum(across, grid.shape[0]) * (points + 1) * np.minimum(across, grid.shape[1])
    lot = (np.cumsum(cost) / _CHUNK).astype(np.int64)
    yield from np.split(touching, np.flatnonzero(np.diff(lot)) + 1) if len(touching) else ()


def _spans(first: Index, last: Index) -> tuple[Index, Index]:
    """All (owner, value) with first ≤ value ≤ last of each owner, as two flat arrays."""
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(first)), count)
    start = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (first - start)[owner]


def _slab_points(
    height: Array, radius: Array, grid: Grid, gauss: tuple[Array, Array]
) -> tuple[Index, Index, Array, Array]:
    """Gauss points of every sphere in every row that it touches: owner, row, z and weight [m]."""
    bottom, cell = grid.z_edges[0], grid.cell
    first = np.maximum(np.floor((height - radius - bottom) / cell).astype(np.int64), 0)
    last = np.minimum(np.floor((height + radius - bottom) / cell).astype(np.int64), grid.shape[0] - 1)
    owner, row = _spans(first, last)
    low = np.maximum(grid.z_edges[row], (height - radius)[owner])
    half = 0.5 * np.maximum(np.minimum(grid.z_edges[row + 1], (height + radius)[owner]) - low, 0)
    node, weight = gauss
    z = (low + half)[:, None] + half[:, None] * node
    return np.repeat(owner, len(node)), np.repeat(row, len(node)), z.ravel(), (half[:, None] * weight).ravel()


def _levels(height: Array, radius: Array, grid: Grid) -> tuple[Index, Index]:
    """Every level that cuts a sphere: (owner, level)."""
    bottom, cell = grid.z_edges[0], grid.cell
    first = np.maximum(np.ceil((height - radius - bottom) / cell).astype(np.int64), 0)
    last = np.minimum(np.floor((height + radius - bottom) / cell).astype(np.int64), grid.shape[0])
    return _spans(first, last)


def _ring_parts(
    slices: _Slices, grid: Grid, weight: Array, arc_weight: Array | None = None
) -> tuple[int, Array, Array]:
    """Sum weight × disc area per ring, and arc_weight × ∫cos φ dl per edge, over all slices of each row.

    Only edges that cut a disc are evaluated: the lens area A(R) there is added to the ring inside the edge and taken
    from the one outside it; the whole disc goes to the ring that holds its far side.

    Returns
    -------
    first : the first row that holds anything
    parts : (rows, nr) [weight · m²]
    arcs : (rows, nr+1) [arc_weight · m]; no rows without `arc_weight`
    """
    edges, cell = len(grid.r_edges), grid.cell
    row, D, s = slices
    if not len(row):
        return 0, np.zeros((0, edges - 1)), np.zeros((0, edges))
    first_row = int(row.min())
    shape = int(row.max()) - first_row + 1, edges
    base = (row - first_row) * edges
    # a centre inside the outermost radius keeps its disc: the outermost edge then does not cut it
    outermost = np.where(grid.r_edges[-1] >= D, edges - 2, edges - 1)
    first = np.maximum(np.floor((D - s) / cell).astype(np.int64) + 1, 1)
    last = np.minimum(np.ceil((D + s) / cell).astype(np.int64) - 1, outermost)
    whole = np.where(first < edges, weight * np.pi * s**2, 0)  # otherwise the disc lies outside the grid

    def scatter(at: Index, amount: Array) -> Array:
        return np.asarray(np.bincount(at, amount, shape[0] * edges).reshape(shape), dtype=float)

    owner, edge = _spans(first, last)
    area, chord = _lens(grid.r_edges[edge], D[owner], s[owner])
    at = base[owner] + edge
    parts = np.diff(scatter(at, weight[owner] * area), axis=1) + scatter(base + last, whole)[:, :-1]
    arcs = np.zeros((0, edges)) if arc_weight is None else scatter(at, arc_weight[owner] * chord)
    return first_row, parts, arcs


def _lens(R: Array, D: Array, s: Array) -> tuple[Array, Array]:
    """Area of a disc within radius R of the axis, and ∫cos φ dl over the arc of the circle R inside the disc.

    A = R² θ_axis + s² θ_disc − k/2 with k four times the area of the triangle of sides R, D, s, and θ its angles, by
    half-angle formulas, which need no quadrant; ∫cos φ dl = k/D. Where the circles do not cross, k is (nearly) 0 and
    one of the angles 0 or 2π: the limits come out of the same formula with the denominators clipped at 0.
    """
    across = R + D
    outer = across - s
    across += s
    far = D - R
    inner = s - far
    far += s
    outer *= across
    inner *= far
    inner *= outer
    far *= across
    k = np.sqrt(np.maximum(inner, _LEAST_K2, out=inner), out=inner)
    with np.errstate(divide="ignore"):
        axis_angle = np.arctan(k / np.maximum(outer, 0, out=outer), out=outer)
        disc_angle = np.arctan(k / np.maximum(far, 0, out=far), out=far)
    disc = s * s
    area = 2 * (R * R * axis_angle + disc * disc_angle) - 0.5 * k
    return np.minimum(area, np.pi * disc), k / D
