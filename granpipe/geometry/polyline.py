"""Edges of polylines in the (r, z) plane: distances, crossings, winding. All functions take and give plain arrays."""

from __future__ import annotations

import numpy as np

from granpipe.field import Array, Mask

_PAIRS = 500_000
"""Of edges that are compared at once: more take memory."""


def edges_of(points: Array, closed: bool = False) -> Array:
    """Edges (n, 2, 2) that join the points (n or n+1, 2) in order: [edge, end, (r, z)]."""
    following = np.roll(points, -1, axis=0)
    joined = np.stack([points, following], axis=1)
    return joined if closed else joined[:-1]


def cross(a: Array, b: Array) -> Array:
    """z-component of the cross product of vectors in the plane, over the last axis."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def nearest_points(points: Array, edges: Array) -> tuple[Array, Array]:
    """Distance (n, m) from each point (n, 2) to each edge (m, 2, 2), and the nearest points (n, m, 2)."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length2 = np.maximum(np.sum(along**2, axis=-1), np.finfo(float).tiny)
    part = np.clip(np.sum((points[:, None] - start) * along, axis=-1) / length2, 0.0, 1.0)
    foot = start + part[..., None] * along
    return np.linalg.norm(points[:, None] - foot, axis=-1), foot


def distance_to(points: Array, edges: Array) -> Array:
    """(n,) distance from each point (n, 2) to the nearest of the edges (m, 2, 2)."""
    return np.asarray(nearest_points(points, edges)[0].min(axis=1))


def crossing_parts(a: Array, b: Array) -> Array:
    """(n, m) position along a[i], 0–1, where b[j] crosses or touches it; NaN where it does not or is parallel."""
    along_a, along_b = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]
    between = b[None, :, 0] - a[:, None, 0]
    turn = cross(along_a[:, None], along_b[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        on_a = cross(between, along_b[None]) / turn
        on_b = cross(between, along_a[:, None]) / turn
    met = (on_a >= 0) & (on_a <= 1) & (on_b >= 0) & (on_b <= 1)
    return np.where(met, on_a, np.nan)


def crosses(a: Array, b: Array) -> Mask:
    """(n, m) whether edge a[i] meets b[j] (parallel overlaps excepted)."""
    return np.asarray(~np.isnan(crossing_parts(a, b)))


def closest_approach(a: Array, b: Array) -> tuple[float, Array, Array]:
    """Smallest distance between two sets of edges, and the points on a and on b where it is reached."""
    met = crossing_parts(a, b)
    if not np.isnan(met).all():
        i, j = np.unravel_index(np.nanargmin(met), met.shape)
        point = a[i, 0] + met[i, j] * (a[i, 1] - a[i, 0])
        return 0.0, point, point
    from_a, foot_on_b = nearest_points(a.reshape(-1, 2), b)
    from_b, foot_on_a = nearest_points(b.reshape(-1, 2), a)
    if from_a.min() <= from_b.min():
        i, j = np.unravel_index(from_a.argmin(), from_a.shape)
        return float(from_a[i, j]), a.reshape(-1, 2)[i], foot_on_b[i, j]
    i, j = np.unravel_index(from_b.argmin(), from_b.shape)
    return float(from_b[i, j]), foot_on_a[i, j], b.reshape(-1, 2)[i]


def farther(a: Array, b: Array, distance: float) -> bool:
    """Whether points (n, 2) and (m, 2) are farther apart than a distance for certain, by the boxes that hold them."""
    between = np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))
    return bool(between.max() > distance)


def pieces(edges: Array, cutters: Array) -> Array:
    """The edges (n, 2, 2) cut where the cutters meet them: (k, 2, 2)."""
    parts = crossing_parts(edges, cutters)
    cut = []
    for edge, met in zip(edges, parts, strict=True):
        at = np.unique(np.concatenate([[0.0, 1.0], met[~np.isnan(met)]]))
        points = edge[0] + at[:, None] * (edge[1] - edge[0])
        cut.append(edges_of(points))
    return np.concatenate(cut)


def signed_area(polygon: Array) -> float:
    """Area of a closed polygon (n, 2) in the plane; positive when it runs anticlockwise in (r, z)."""
    return 0.5 * float(np.sum(cross(polygon, np.roll(polygon, -1, axis=0))))


def inside_polygon(points: Array, polygon: Array) -> Mask:
    """(n,) whether each point lies inside the closed polygon (m, 2), by the even–odd rule."""
    return enclosed(points, edges_of(polygon, closed=True))


def enclosed(points: Array, edges: Array) -> Mask:
    """(n,) whether each point lies inside what edges (m, 2, 2) in any order enclose, by the even–odd rule."""
    (r0, z0), (r1, z1) = edges.transpose(1, 2, 0)
    r, z = points[:, :1], points[:, 1:]
    spans = (z0 > z) != (z1 > z)
    slope = np.divide(r1 - r0, z1 - z0, out=np.zeros_like(r0), where=z1 != z0)
    return np.asarray((spans & (r < r0 + (z - z0) * slope)).sum(axis=1) % 2 == 1)


def gaps(a: Array, b: Array) -> Array:
    """(n, m) distance between every edge of a and every edge of b; 0 where they cross."""
    ends_of_a = nearest_points(a.reshape(-1, 2), b)[0].reshape(len(a), 2, len(b)).min(axis=1)
    ends_of_b = nearest_points(b.reshape(-1, 2), a)[0].reshape(len(b), 2, len(a)).min(axis=1).T
    return np.where(crosses(a, b), 0.0, np.minimum(ends_of_a, ends_of_b))


def self_contact(edges: Array, tolerance: float, closed: bool) -> tuple[int, int] | None:
    """First two edges of one polyline that meet although they are not neighbours, or that fold back on each other."""
    count = len(edges)
    index = np.arange(count)
    bad = np.zeros((count, count), dtype=bool)
    for rows in np.array_split(index, max(1, count * count // _PAIRS)):
        apart = np.abs(rows[:, None] - index)
        if closed:
            apart = np.minimum(apart, count - apart)
        bad[rows] = (gaps(edges[rows], edges) <= tolerance) & (apart > 1)
    along = edges[:, 1] - edges[:, 0]
    following = np.roll(along, -1, axis=0)
    flat = np.abs(cross(along, following)) <= 1e-9 * np.linalg.norm(along, axis=1) * np.linalg.norm(following, axis=1)
    folds = flat & (np.sum(along * following, axis=1) < 0)
    if not closed:
        folds[-1] = False
    bad[index[folds], (index[folds] + 1) % count] = True
    found = np.argwhere(bad)
    return (int(found[0].min()), int(found[0].max())) if len(found) else None
