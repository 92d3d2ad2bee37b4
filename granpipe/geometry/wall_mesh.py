"""Walls of a vessel in space from triangles: their openings, and how much of each cell lies inside them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array, Box, Mask
from granpipe.geometry.crossings import crossing

MOST_TRIANGLES = 500_000

LEVEL = 1e-3
"""Of the vessel's height: an opening is flat, and level, to this part."""

CROSSED = 1e-4
"""Of the vessel's size: walls that pass through each other by less are said to touch."""

FARTHEST = 1000
"""Sizes of the vessel from the origin, at most: single precision, as in STL, tells places there to 6e-5 of the size."""

_MERGED = 1e-6  # of the vessel's size: corners that are nearer than this are one; STL holds single precision
_RAYS = 4  # along each side of a cell
_SHIFTS = ((0.0123, 0.0377), (0.0661, 0.0219), (0.0431, 0.0873))  # of the distance of rays along x and y: where one
# meets an edge, all are moved

_MOST_COLUMNS = 128  # along x and y, by which triangles above a point are found
_AT_ONCE = 2_000_000  # pairs of a point and a triangle

Index = NDArray[np.int64]


@dataclass(frozen=True)
class WallOpening:
    """A flat hole in the walls.

    Parameters
    ----------
    corners : (n, 3) of its edge, in order [m]
    normal : (3,) unit vector across it, out of the vessel
    """

    corners: Array
    normal: Array

    @property
    def z(self) -> float:
        """Its height, in the middle [m]."""
        return float(self.corners[:, 2].mean())

    @property
    def plane(self) -> Array:
        """(3, 2) two unit vectors in it; along x and y where it is level."""
        if abs(self.normal[2]) > 1 - LEVEL**2:
            return np.eye(3)[:, :2]
        along = np.array([-self.normal[1], self.normal[0], 0.0]) / math.hypot(*self.normal[:2])
        return np.column_stack([along, np.cross(self.normal, along)])

    @property
    def outline(self) -> Array:
        """(n, 2) corners of its edge as seen straight on [m]."""
        return np.asarray(self.corners @ self.plane)

    @property
    def border(self) -> Array:
        """(n, 2) corners of its edge in x and y [m]."""
        return self.corners[:, :2]

    @property
    def area(self) -> float:
        """[m²]"""
        x, y = self.outline.T
        return float(0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))

    @property
    def centre(self) -> tuple[float, float]:
        """Mean of the corners in x and y [m], to a millionth of the opening."""
        digits = 6 - math.floor(math.log10(np.ptp(self.corners, axis=0).max()))
        x, y = self.border.mean(axis=0)
        return round(float(x), digits) + 0.0, round(float(y), digits) + 0.0  # no −0


@dataclass(frozen=True, eq=False)
class WallMesh:
    """Triangles that enclose the solids, but for flat openings.

    Parameters
    ----------
    triangles : (n, 3, 3) corners, those that close the openings included [m]
    inlets, outlets : level openings at the top, and all others
    walls : how many of the triangles are walls; the others, after them, close the openings
    parts : (walls,) which piece of the walls each of them is of, counted from 0, those with openings first
    opened : how many pieces have openings
    """

    triangles: Array
    inlets: tuple[WallOpening, ...]
    outlets: tuple[WallOpening, ...]
    walls: int
    parts: Index
    opened: int

    @classmethod
    def of(cls, points: Array, triangles: Index) -> WallMesh:
        """The walls that triangles make; z is up.

        Parameters
        ----------
        points : (n, 3) corners [m]
        triangles : (m, 3) which corners each triangle has

        Raises
        ------
        DataError : they are no closed walls with flat openings, of which one at least is a level one at the top
        """
        if len(triangles) > MOST_TRIANGLES:
            raise DataError(f"{len(triangles)} triangles are more than {MOST_TRIANGLES}; make the mesh coarser")
        size, away = float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
        if away > FARTHEST * size:
            raise DataError(
                f"they are {size:.3g} m large and reach to {away:.4g} m from the origin, more than {FARTHEST} times "
                "their size: places are not told well enough there; move them to the origin"
            )
        points, triangles = _merged(points, triangles, _MERGED * size)
        loops = list(_loops(points, _border(points, triangles)))
        low, high = float(points[:, 2].min()), float(points[:, 2].max())
        if not loops:
            raise DataError(
                "no opening at all: delete the faces of the inlet, at the top, and of the outlets; of walls with a "
                "thickness, which are closed as well, give the inner faces alone, or the space inside as a body (STEP)"
            )
        if (met := crossing(points, triangles, CROSSED * size)) is not None:
            raise DataError(
                f"they pass through each other at {_place(met)}: join the bodies there to one, and leave out what lies "
                "outside the vessel"
            )
        openings, caps = [], []
        for loop in loops:
            corners = points[loop]
            middle, normal = corners.mean(axis=0), _normal(corners)
            if np.ptp((corners - middle) @ normal) > LEVEL * (high - low):
                raise DataError(f"the opening at {_place(middle)} is not flat: close it, or cut it flat")
            openings.append(WallOpening(corners, normal))
            caps.append(
                np.stack([corners, np.roll(corners, -1, axis=0), np.broadcast_to(middle, corners.shape)], axis=1)
            )
        parts, opened = _parts(triangles, loops)
        closed = np.concatenate([points[triangles], *caps])
        turned = _outwards(cls(closed, (), (), len(triangles), parts, opened), openings)
        inlets = tuple(one for one in turned if high - one.z <= LEVEL * (high - low) and one.normal[2] > 1 - LEVEL)
        outlets = tuple(one for one in turned if not any(one is other for other in inlets))
        if not inlets:
            highest = max(turned, key=lambda one: one.corners[:, 2].max())
            raise DataError(
                "no level opening at the top: the walls must leave the inlet open; the highest opening, at "
                f"{_place(highest.corners.mean(axis=0))}, {_facing(highest.normal)}"
                + ("" if high - highest.z <= LEVEL * (high - low) else f", and walls reach to z = {high:.4g} m")
            )
        if not outlets:
            raise DataError("no opening below the top: the walls must leave the outlet open")
        return cls(closed, inlets, outlets, len(triangles), parts, opened)

    @property
    def surface(self) -> Array:
        """(walls, 3, 3) corners of the walls alone [m]."""
        return self.triangles[: self.walls]

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

    def contains(self, points: Array, without: Index | None = None) -> Mask:
        """(n,) which points (n, 3) lie inside: an odd number of triangles is above them.

        Parameters
        ----------
        without : (n,) piece of the walls that is left out for each point; none unless given
        """
        parts = np.append(self.parts, np.full(len(self.triangles) - self.walls, -1))
        found = np.zeros(len(points), dtype=np.int64)
        triangle, point = self._columns.pairs(points[:, 0] + self._aside[0], points[:, 1] + self._aside[1])
        for k in range(0, len(point), _AT_ONCE):
            which, one = point[k : k + _AT_ONCE], triangle[k : k + _AT_ONCE]
            a, b, c = self.triangles[one].swapaxes(0, 1)
            p = points[which, :2] + self._aside
            first, second, own = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], p - a[:, :2]
            twice = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
            with np.errstate(divide="ignore", invalid="ignore"):  # upright triangles are above nothing
                u = (own[:, 0] * second[:, 1] - own[:, 1] * second[:, 0]) / twice
                v = (own[:, 1] * first[:, 0] - own[:, 0] * first[:, 1]) / twice
                z = a[:, 2] + u * (b[:, 2] - a[:, 2]) + v * (c[:, 2] - a[:, 2])
                above = (u >= 0) & (v >= 0) & (u + v < 1) & (z > points[which, 2]) & (twice != 0)
            if without is not None:
                above &= parts[one] != without[which]
            found += np.bincount(which[above], minlength=len(points))
        return np.asarray(found % 2 == 1)

    @cached_property
    def _columns(self) -> _Columns:
        return _Columns.of(self.triangles)

    @cached_property
    def _aside(self) -> Array:
        """How far points are moved in x and y, so that none lies just below an edge [m]."""
        return np.array([0.37, 0.61]) * _MERGED * float(np.ptp(self.ends, axis=1).max())


@dataclass(frozen=True)
class _Columns:
    """Which triangles lie above and below each of many equal columns in x and y.

    Parameters
    ----------
    low, size : corner of the first column and widths of all [m]
    count : columns along x and y
    first : (columns + 1,) where those of each begin in `members`
    """

    low: Array
    size: Array
    count: tuple[int, int]
    first: Index
    members: Index

    @classmethod
    def of(cls, triangles: Array) -> _Columns:
        flat = triangles[:, :, :2]
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        side = int(np.clip(np.sqrt(len(triangles)), 1, _MOST_COLUMNS))
        size = (high - low) / side
        ends = flat.min(axis=1), flat.max(axis=1)
        begin, end = (np.clip(((one - low) / size).astype(np.int64), 0, side - 1) for one in ends)
        wide, deep = (end - begin + 1).T
        owner = np.repeat(np.arange(len(triangles)), wide * deep)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(wide * deep) - wide * deep, wide * deep)
        column = begin[owner, 0] + number % wide[owner] + side * (begin[owner, 1] + number // wide[owner])
        order = np.argsort(column, kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=side * side))])
        return cls(low, size, (side, side), first.astype(np.int64), owner[order])

    def pairs(self, x: Array, y: Array) -> tuple[Index, Index]:
        """Triangles and points that share a column."""
        place = np.floor((np.column_stack([x, y]) - self.low) / self.size).astype(np.int64)
        there = np.flatnonzero(((place >= 0) & (place < self.count)).all(axis=1))
        column = place[there, 0] + self.count[0] * place[there, 1]
        start, length = self.first[column], self.first[column + 1] - self.first[column]
        number = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        return self.members[np.repeat(start, length) + number], np.repeat(there, length)


def _normal(corners: Array) -> Array:
    """(3,) unit normal of a polygon (n, 3), by Newell's sums; its sense is that of the corners."""
    own = corners - corners.mean(axis=0)
    total = np.cross(own, np.roll(own, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(total))
    if not length > 0:
        raise DataError(f"the opening at {_place(corners.mean(axis=0))} has no area: close it")
    unit = total / length
    return np.asarray(np.round(unit) + 0.0 if np.abs(unit).max() > 1 - 1e-12 else unit)


def _outwards(walls: WallMesh, openings: Sequence[WallOpening]) -> list[WallOpening]:
    """Openings whose normals lead out of closed walls."""
    from shapely import Polygon

    found = []
    for one in openings:
        middle, place = one.corners.mean(axis=0), Polygon(one.outline).representative_point()
        inside = middle + one.plane @ (np.array([place.x, place.y]) - middle @ one.plane)  # surely within its edge
        step = 1e-3 * math.sqrt(one.area) * one.normal
        ahead, behind = walls.contains(np.array([inside + step, inside - step]))
        if ahead == behind:
            raise DataError(
                f"it is not clear what is inside at the opening at {_place(middle)}: "
                + (
                    f"{walls.opened} pieces have openings; join them to one, and close obstacles on all sides"
                    if walls.opened > 1
                    else "walls lie in it, or cross there"
                )
            )
        found.append(WallOpening(one.corners, -one.normal + 0.0) if ahead else one)
    return found


def nearest_opening(openings: Sequence[WallOpening], x: Array, y: Array) -> Index:
    """Which opening is nearest, seen from above, to points of any one shape [m]."""
    from shapely import Polygon, distance, points

    places = points(x, y)
    return np.asarray(np.argmin([distance(Polygon(one.border), places) for one in openings], axis=0))


def _parts(triangles: Index, loops: Sequence[Index]) -> tuple[Index, int]:
    """(n,) which connected piece each triangle is of, those with openings first, and how many of these there are."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = int(triangles.max()) + 1
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, of = connected_components(graph, directed=False)
    opened = np.unique([of[loop[0]] for loop in loops])
    order = np.concatenate([opened, np.setdiff1d(of[triangles[:, 0]], opened)])
    place = np.zeros(int(of.max()) + 1, dtype=np.int64)
    place[order] = np.arange(len(order))
    return place[of[triangles[:, 0]]], len(opened)


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
        raise DataError(
            f"{(count > 2).sum()} edges belong to three triangles or more, one at {_place(where)}: leave out faces "
            "within the vessel and outside it, and give obstacles as closed surfaces"
        )
    return np.asarray(unique[count == 1])


def _loops(points: Array, edges: Index) -> Iterator[Index]:
    """Corners of each closed line that edges make, in order."""
    beside: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    for corner, others in beside.items():
        if len(others) != 2:
            raise DataError(
                f"the edge of an opening branches at {_place(points[corner])}: triangles there do not meet corner to "
                "corner, or two openings touch; export one closed mesh, without gaps"
            )
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


def _facing(normal: Array) -> str:
    """How an opening lies, by its normal out of the vessel."""
    lean = math.degrees(math.acos(min(1.0, abs(float(normal[2])))))
    way = "upwards" if normal[2] > 0 else "downwards"
    return "faces sideways" if lean > 89.9 else f"faces {way}" + (f" and leans by {lean:.3g}°" if lean > 0.1 else "")


def _place(point: Sequence[float] | Array) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*point)
