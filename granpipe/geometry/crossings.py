"""Where triangles of one surface pass through each other: there it is not told what lies inside."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array

Index = NDArray[np.int64]

_AT_ONCE = 500_000  # pairs of boxes
_BITS = 10  # of each coordinate in the order of the triangles


def crossing(points: Array, triangles: Index, clear: float) -> Array | None:
    """(3,) a place where an edge of a triangle passes through another triangle; None where none does.

    Parameters
    ----------
    points : (n, 3) corners [m]
    triangles : (m, 3) which corners each triangle has
    clear : surfaces that pass through each other by less are said to touch [m]
    """
    corners = points[triangles]
    with np.errstate(invalid="ignore"):  # triangles without area meet nothing
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
    for pair in _neighbours(corners.min(axis=1), corners.max(axis=1)):
        for one, other in (pair, pair[::-1]):
            away = np.einsum("nkc,nc->nk", corners[one] - corners[other, :1], normals[other])
            through = (away.min(axis=1) < -clear) & (away.max(axis=1) > clear)
            place = _met(triangles[one[through]], triangles[other[through]], away[through], points, clear)
            if len(place):
                return np.asarray(place[0])
    return None


def _met(one: Index, other: Index, away: Array, points: Array, clear: float) -> Array:
    """(k, 3) where edges of triangles pass through others, each (n, 3) corners, farther than `clear` from all edges.

    Parameters
    ----------
    away : (n, 3) distance of the corners of the one from the plane of the other
    """
    found = []
    for k, m in ((0, 1), (1, 2), (2, 0)):
        apart = (one[:, [k, m], None] != other[:, None, :]).all(axis=(1, 2))
        apart &= (away[:, k] * away[:, m] < 0) & (np.minimum(np.abs(away[:, k]), np.abs(away[:, m])) > clear)
        begin, end, (a, b, c) = points[one[apart, k]], points[one[apart, m]], points[other[apart].T]
        part = away[apart, k] / (away[apart, k] - away[apart, m])
        place = begin + part[:, None] * (end - begin)
        normal = np.cross(b - a, c - a)
        inside = np.full(len(place), True)
        for here, following in ((a, b), (b, c), (c, a)):
            side = np.cross(following - here, place - here)
            size = np.linalg.norm(normal, axis=1) * np.linalg.norm(following - here, axis=1)
            inside &= (side * normal).sum(axis=1) > clear * size
        found.append(place[inside])
    return np.concatenate(found)


def _neighbours(low: Array, high: Array) -> Iterator[tuple[Index, Index]]:
    """Pairs of boxes (n, 3) that overlap, each once, many at a time: by a tree of boxes, from its root down."""
    order = _near_order(0.5 * (low + high))
    depth = max(0, int(len(order) - 1).bit_length())
    lows, highs = np.full((2**depth, 3), np.inf), np.full((2**depth, 3), -np.inf)
    lows[: len(order)], highs[: len(order)] = low[order], high[order]
    levels = [(lows, highs)]
    for _ in range(depth):
        lows, highs = (np.stack([one[::2], one[1::2]]) for one in levels[-1])
        levels.append((lows.min(axis=0), highs.max(axis=0)))
    waiting = [(depth, np.zeros((1, 2), dtype=np.int64))]
    while waiting:
        level, pairs = waiting.pop()
        if level == 0:
            pairs = order[pairs[pairs[:, 0] != pairs[:, 1]]]
            yield pairs[:, 0], pairs[:, 1]
            continue
        lows, highs = levels[level - 1]
        children = (2 * pairs[:, None] + np.array([(0, 0), (0, 1), (1, 0), (1, 1)])).reshape(-1, 2)
        first, second = children[children[:, 0] <= children[:, 1]].T
        meet = ((lows[first] <= highs[second]) & (lows[second] <= highs[first])).all(axis=1)
        found = np.column_stack([first[meet], second[meet]])
        waiting += [(level - 1, found[k : k + _AT_ONCE]) for k in range(0, len(found), _AT_ONCE)]


def _near_order(points: Array) -> Index:
    """(n,) order of points (n, 3) in which neighbours stand near each other: bits of x, y and z in turn (Morton)."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    cell = ((points - low) / np.where(size > 0, size, 1) * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
