"""Walls of a vessel in space from triangles: their openings, and how much of each cell lies inside them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array, Box

MOST_TRIANGLES = 500_000

LEVEL = 1e-3
"""Of the vessel's height: an opening is level, and at its top or bottom, to this part."""

_MERGED = 1e-6  # of the vessel's size: corners that are nearer than this are one; STL holds single precision
_RAYS = 4  # along each side of a cell
_SHIFTS = ((0.0123, 0.0377), (0.0661, 0.0219), (0.0431, 0.0873))  # of the distance of rays along x and y: where one
# meets an edge, all are moved

Index = NDArray[np.int64]


@dataclass(frozen=True)
class WallOpening:
    """A level hole in the walls.

    Parameters
    ----------
    z : its height [m]
    border : (n, 2) corners of its edge in x and y, in order [m]
    """

    z: float
    border: Array

    @property
    def area(self) -> float:
        """[m²]"""
        x, y = self.border.T
        return float(0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))

    @property
    def centre(self) -> tuple[float, float]:
        """Mean of the corners [m], to a millionth of the opening."""
        digits = 6 - math.floor(math.log10(np.ptp(self.border, axis=0).max()))
        x, y = self.border.mean(axis=0)
        return round(float(x), digits) + 0.0, round(float(y), digits) + 0.0  # no −0


@dataclass(frozen=True)
class WallMesh:
    """Triangles that enclose the solids, but for level openings at the top and the bottom.

    Parameters
    ----------
    triangles : (n, 3, 3) corners, those that close the openings included [m]
    inlets, outlets : openings at the top and at the bottom
    """

    triangles: Array
    inlets: tuple[WallOpening, ...]
    outlets: tuple[WallOpening, ...]

    @classmethod
    def of(cls, points: Array, triangles: Index) -> WallMesh:
        """The walls that triangles make; z is up.

        Parameters
        ----------
        points : (n, 3) corners [m]
        triangles : (m, 3) which corners each triangle has

        Raises
        ------
        DataError : they are no closed walls with level openings at the top and the bottom
        """
        if len(triangles) > MOST_TRIANGLES:
            raise DataError(f"{len(triangles)} triangles are more than {MOST_TRIANGLES}; make the mesh coarser")
        size = float(np.ptp(points, axis=0).max())
        points, triangles = _merged(points, triangles, _MERGED * size)
        loops = list(_loops(points, _border(points, triangles)))
        low, high = float(points[:, 2].min()), float(points[:, 2].max())
        found: dict[str, list[WallOpening]] = {"top": [], "bottom": []}
        caps = []
        for loop in loops:
            corners = points[loop]
            z, where = float(corners[:, 2].mean()), _place(corners.mean(axis=0))
            if np.ptp(corners[:, 2]) > LEVEL * (high - low):
                raise DataError(f"the opening at {where} is not level: close it, or cut it level")
            near = {"top": high - z, "bottom": z - low}
            end = min(near, key=lambda one: near[one])
            if near[end] > LEVEL * (high - low):
                raise DataError(
                    f"the opening at {where} lies between bottom, z = {low:.4g} m, and top, "
                    f"{high:.4g} m: only openings at the ends are computed; close it"
                )
            found[end].append(WallOpening(z, corners[:, :2]))
            middle = np.broadcast_to(corners.mean(axis=0), corners.shape)
            caps.append(np.stack([corners, np.roll(corners, -1, axis=0), middle], axis=1))
        for end, what in (("top", "inlet"), ("bottom", "outlet")):
            if not found[end]:
                raise DataError(f"no opening at the {end}: the walls must leave the {what} open")
        return cls(np.concatenate([points[triangles], *caps]), tuple(found["top"]), tuple(found["bottom"]))

    @property
    def ends(self) -> Array:
        """(3, 2) lowest and highest x, y and z [m]."""
        corners = self.triangles.reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)

    def inside_fraction(self, grid: Box) -> Array:
        """(nz, ny, nx) part of each cell inside: exact along z, by 4 × 4 vertical rays in each cell.

        Raises
        ------
        DataError : the walls are not closed, as rays tell
        """
        for shift in _SHIFTS:
            x, y = (_rays(edges, part) for edges, part in zip((grid.r_edges, grid.y_edges), shift, strict=True))
            ray, z = _crossings(self.triangles, x, y)
            order = np.lexsort((z, ray))
            ray, z = ray[order], z[order]
            odd = np.flatnonzero(np.bincount(ray, minlength=len(x) * len(y)) % 2)
            if not len(odd):
                return _filled(grid, ray, z, len(x))
        row, column = divmod(int(odd[0]), len(x))
        raise DataError(f"the walls are not closed above or below x = {x[column]:.4g} m, y = {y[row]:.4g} m")


def _merged(points: Array, triangles: Index, tolerance: float) -> tuple[Array, Index]:
    """Corners that are one made one; triangles without area, and second ones, left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(points), len(points)))
    count, of = connected_components(graph, directed=False)
    mean = np.stack([np.bincount(of, points[:, k], count) for k in range(3)], axis=1) / np.bincount(of)[:, None]
    corners = of[triangles].astype(np.int64)
    corners = corners[(np.diff(np.sort(corners, axis=1), axis=1) > 0).all(axis=1)]
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    return mean, corners[np.sort(first)]


def _border(points: Array, triangles: Index) -> Index:
    """(n, 2) edges that one triangle alone has.

    Raises
    ------
    DataError : three triangles or more meet at an edge
    """
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    if (count > 2).any():
        where = points[unique[count > 2][0]].mean(axis=0)
        raise DataError(f"{(count > 2).sum()} edges belong to three triangles or more, one at {_place(where)}")
    return np.asarray(unique[count == 1])


def _loops(points: Array, edges: Index) -> Iterator[Index]:
    """Corners of each closed line that edges make, in order."""
    beside: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    for corner, others in beside.items():
        if len(others) != 2:
            raise DataError(f"the edge of an opening branches at {_place(points[corner])}")
    while beside:
        start = next(iter(beside))
        loop, here = [start], beside.pop(start)[0]
        while here != start:
            following = next(one for one in beside[here] if one != loop[-1])
            loop.append(here)
            del beside[here]
            here = following
        yield np.array(loop)


def _rays(edges: Array, shift: float) -> Array:
    """Places of rays along one side of the grid."""
    share = (np.arange(_RAYS) + 0.5 + shift) / _RAYS
    return np.asarray((edges[:-1, None] + share * np.diff(edges)[:, None]).ravel())


def _crossings(triangles: Array, x: Array, y: Array) -> tuple[Index, Array]:
    """Which ray meets a triangle (number of its y times the number of x, plus that of its x), and where [m]."""
    rays, heights = [np.zeros(0, np.int64)], [np.zeros(0)]
    low, high = triangles[:, :, :2].min(axis=1), triangles[:, :, :2].max(axis=1)
    first_x, last_x = np.searchsorted(x, low[:, 0]), np.searchsorted(x, high[:, 0])
    first_y, last_y = np.searchsorted(y, low[:, 1]), np.searchsorted(y, high[:, 1])
    for k in np.flatnonzero((last_x > first_x) & (last_y > first_y)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[k]
        twice = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if twice == 0:  # upright
            continue
        px, py = x[first_x[k] : last_x[k]][None, :] - ax, y[first_y[k] : last_y[k]][:, None] - ay
        b = (px * (cy - ay) - py * (cx - ax)) / twice
        c = (py * (bx - ax) - px * (by - ay)) / twice
        rows, columns = np.nonzero((b >= 0) & (c >= 0) & (b + c < 1))
        rays.append((rows + first_y[k]) * len(x) + columns + first_x[k])
        heights.append(az + b[rows, columns] * (bz - az) + c[rows, columns] * (cz - az))
    return np.concatenate(rays), np.concatenate(heights)


def _filled(grid: Box, ray: Index, z: Array, across: int) -> Array:
    """Part of each cell between every first and second crossing of its rays."""
    rows, *_ = grid.shape
    step = float(grid.z_edges[-1] - grid.z_edges[0]) / rows
    height = np.clip((z - grid.z_edges[0]) / step, 0, rows)
    sign = np.where(np.arange(len(z)) % 2, 1.0, -1.0)  # sorted: enters, leaves, …
    row = np.minimum(height.astype(np.int64), rows - 1)
    column = ray % across // _RAYS, ray // across // _RAYS
    found, whole = np.zeros(grid.shape), np.zeros(grid.shape)
    np.add.at(found, (row, column[1], column[0]), sign * (height - row))
    np.add.at(whole, (row, column[1], column[0]), sign)
    above = np.cumsum(whole[::-1], axis=0)[::-1] - whole
    part = (found + above) / _RAYS**2
    return np.asarray(np.where(np.abs(part - np.round(part)) < 1e-9, np.round(part), part))


def _place(point: Sequence[float] | Array) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*point)
