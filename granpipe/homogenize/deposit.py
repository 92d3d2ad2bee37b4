"""Spheres → grid: the exact volume of every sphere in every ring, and its flow through the rings' faces.

A slice through a sphere is a disc of radius s at axis distance D. The part of the disc within radius R of the axis is
the lens of two circles; cells take differences of it in R, integrated over their height by Gauss–Legendre. The area
of the whole disc is quadratic in z, so two points already keep the sphere's volume to rounding.

The flow is staggered: through z-faces v_z times the lens differences at the face's height, through r-faces the local
radial component of the sphere's velocity, v_r cos φ, over the arc of the circle R inside the disc. Both are the exact
rate of change of the deposited volume, up to quadrature in z: ∂V/∂t + ∇·flow = 0 cell by cell.

Cartesian cells (`granpipe.homogenize.deposit_box`) cut the same discs into rectangles.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from granpipe.field import Array, Box, Grid, Mask
from granpipe.homogenize.deposit_box import add_to_boxes
from granpipe.homogenize.slices import Index, disc_radius, floor, gauss, levels, lots, slab_points, spans
from granpipe.system.interrupts import uninterrupted

_LEAST_DISTANCE = 1e-30
_LEAST_K2 = 1e-200  # root far below the least distance
_NEAR_AXIS = 0.25  # part of a sphere's radius
_CHUNK = 1 << 15  # lens evaluations at a time: bounds the memory, and fits the cache


class Deposit(NamedTuple):
    """Solids on a grid.

    volume : (nz, nr) solids in each cell [m³]; in space (nz, ny, nx)
    flow_r : (nz, nr+1) solids flow through the cylindrical faces, positive outwards, or through those across x [m³/s]
    flow_z : (nz+1, nr) solids flow through the horizontal faces, positive upwards [m³/s]
    flow_y : (nz, ny+1, nx) in space solids flow through the faces across y [m³/s]; otherwise empty
    """

    volume: Array
    flow_r: Array
    flow_z: Array
    flow_y: Array = np.zeros(0)


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
    touching = (position[:, 2] + radius > grid.z_edges[0]) & (position[:, 2] - radius < grid.z_edges[-1])
    spheres = position[touching], radius[touching], velocity[touching]
    if not isinstance(grid, Box):
        return _deposited(_cylindrical(*spheres), grid, points)
    total = empty_deposit(grid)
    add_to_boxes(*spheres, grid, points, *total)
    return total


def _deposited(spheres: _Spheres, grid: Grid, points: int) -> Deposit:
    """The deposit of some spheres.

    Where a sphere's axis is nearly that of the vessel its discs appear and vanish in whole rings: rare, but three
    points are then off by up to 0.24 % of the sphere in a cell.
    """
    total = empty_deposit(grid)
    near_axis = spheres.distance < _NEAR_AXIS * spheres.radius
    add = _kernel()
    add(spheres.chosen(~near_axis), grid, points, total)
    add(spheres.chosen(near_axis), grid, 3 * points, total)
    return total


def empty_deposit(grid: Grid) -> Deposit:
    """Zeros, to add to."""
    rows, *across, columns = grid.shape
    flow_y = np.zeros((rows, across[0] + 1, columns)) if across else np.zeros(0)
    return Deposit(
        np.zeros(grid.shape), np.zeros((rows, *across, columns + 1)), np.zeros((rows + 1, *across, columns)), flow_y
    )


def deposit_paths(
    start: Array,
    path: Array,
    radius: Array,
    duration: float,
    grid: Grid,
    points: int = 3,
) -> Deposit:
    """Time average of the deposit of spheres on straight paths at steady speed.

    The flow integrates to the change of the deposited volume between the ends of the paths, up to quadrature along
    them: Gauss–Legendre with 2 points up to a cell of path, 4 up to two, and so on up to 32.

    Parameters
    ----------
    start : (n, 3) centres at the beginning [m]
    path : (n, 3) from beginning to end [m]
    radius : (n,) [m]
    duration : between the two [s]
    points : Gauss points over the height of each cell
    """
    total = empty_deposit(grid)
    low, high = np.minimum(start[:, 2], start[:, 2] + path[:, 2]), np.maximum(start[:, 2], start[:, 2] + path[:, 2])
    touching = (high + radius > grid.z_edges[0]) & (low - radius < grid.z_edges[-1])
    start, path, radius = start[touching], path[touching], radius[touching]
    cells = np.linalg.norm(path, axis=1) / grid.cell
    numbers = 2 ** np.clip(np.ceil(np.log2(np.maximum(cells, 1))) + 1, 1, 5).astype(int)
    for number in np.unique(numbers):
        chosen = numbers == number
        begin, way = start[chosen], path[chosen]
        for node, weight in zip(*gauss(int(number)), strict=True):
            part = deposit(begin + 0.5 * (1 + node) * way, radius[chosen], way / duration, grid, points)
            for array, added in zip(total, part, strict=True):
                array += 0.5 * weight * added
    return total


class _Spheres(NamedTuple):
    """Spheres as the axis sees them, each (n,): centre's height and axis distance, radius [m], velocity [m/s]."""

    z: Array
    distance: Array
    radius: Array
    radial_velocity: Array
    vertical_velocity: Array

    def chosen(self, which: Index | Mask) -> _Spheres:
        return _Spheres(*(values[which] for values in self))


class _Slices(NamedTuple):
    """Horizontal discs: their row (or level) on the grid, axis distance D and radius s [m], each (m,)."""

    row: Index
    distance: Array
    radius: Array


def _cylindrical(position: Array, radius: Array, velocity: Array) -> _Spheres:
    # on the axis itself no direction is radial; what crosses a ring there cancels over the circle
    distance = np.maximum(np.hypot(position[:, 0], position[:, 1]), _LEAST_DISTANCE)
    radial_velocity = (velocity[:, 0] * position[:, 0] + velocity[:, 1] * position[:, 1]) / distance
    return _Spheres(position[:, 2], distance, radius, radial_velocity, velocity[:, 2])


@cache
def _kernel() -> Callable[[_Spheres, Grid, int, Deposit], None]:
    """The compiled kernel where numba is installed, otherwise numpy's."""
    try:
        import granpipe.homogenize.deposit_numba  # noqa: F401
    except ImportError:
        return _add
    return _add_compiled


def _add_compiled(spheres: _Spheres, grid: Grid, points: int, total: Deposit) -> None:
    """Add spheres to the deposit, with the same number of Gauss points for all."""
    from granpipe.homogenize.deposit_numba import add

    with uninterrupted():
        add(*spheres, grid.r_edges, grid.z_edges, *gauss(points), *total[:3])


def _add(spheres: _Spheres, grid: Grid, points: int, total: Deposit) -> None:
    """The same by numpy alone."""
    across = 2 * spheres.radius / grid.cell + 1
    cost = np.minimum(across, grid.shape[0]) * (points + 1) * np.minimum(across, grid.shape[1])
    for lot in lots(spheres.z, cost, _CHUNK):
        some = spheres.chosen(lot)
        owner, row, height, weight = slab_points(some.z, some.radius, grid, points)
        arc_weight = weight * some.radial_velocity[owner]
        first, parts, arcs = _ring_parts(_slices(some, owner, row, height), grid, weight, arc_weight)
        total.volume[first : first + len(parts)] += parts
        total.flow_r[first : first + len(arcs)] += arcs
        owner, level = levels(some.z, some.radius, grid)
        slices = _slices(some, owner, level, grid.z_edges[level])
        first, parts, _ = _ring_parts(slices, grid, some.vertical_velocity[owner])
        total.flow_z[first : first + len(parts)] += parts


def _slices(spheres: _Spheres, owner: Index, row: Index, height: Array) -> _Slices:
    """Discs of the spheres `owner` at heights [m]."""
    return _Slices(row, spheres.distance[owner], disc_radius(spheres.z[owner], spheres.radius[owner], height))


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
    first = np.maximum(floor((D - s) / cell) + 1, 1)
    last = np.minimum(floor((D + s) / cell), outermost)
    whole = np.where(first < edges, weight * np.pi * s**2, 0)  # otherwise the disc lies outside the grid

    def scatter(at: Index, amount: Array) -> Array:
        return np.asarray(np.bincount(at, amount, shape[0] * edges).reshape(shape), dtype=float)

    owner, edge = spans(first, last)
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
