"""Which triangle of a mesh holds each node of a rectangular grid."""

from __future__ import annotations

import numpy as np

from granpipe.field import Array
from granpipe.rzmesh import Index

SLACK = 1e-9  # of a triangle: how far outside a node may lie by rounding


def locate(points: Array, triangles: Index, r: Array, z: Array) -> tuple[Index, Array]:
    """Find the grid nodes in the triangles, by looking at the nodes in each triangle's bounding box.

    Parameters
    ----------
    points, triangles : (n, 2), (m, 3) the mesh
    r, z : (nr,), (nz,) rising coordinates of the grid's nodes

    Returns
    -------
    triangle : (nz, nr) number of a triangle that holds the node, −1 where there is none
    place : (nz, nr, 2) local coordinates in it: the node is a + place₀ (b − a) + place₁ (c − a)
    """
    corner = points[triangles]
    low, high = corner.min(axis=1), corner.max(axis=1)
    slack = SLACK * (high - low).max(axis=1, keepdims=True)
    first = np.stack([np.searchsorted(axis, low[:, i] - slack[:, 0]) for i, axis in enumerate((r, z))])
    beyond = np.stack([np.searchsorted(axis, high[:, i] + slack[:, 0], "right") for i, axis in enumerate((r, z))])
    across, up = np.maximum(beyond - first, 0)
    owner = np.repeat(np.arange(len(triangles)), across * up)
    count = np.arange(len(owner)) - np.repeat(np.cumsum(across * up) - across * up, across * up)
    column, row = first[0, owner] + count % across[owner], first[1, owner] + count // across[owner]
    a, b, c = corner[owner].transpose(1, 0, 2)
    s, t = _local(a, b, c, np.stack([r[column], z[row]], axis=1))
    inside = np.minimum(np.minimum(s, t), 1 - s - t) >= -SLACK
    triangle = np.full((len(z), len(r)), -1)
    place = np.zeros((len(z), len(r), 2))
    triangle[row[inside], column[inside]] = owner[inside]
    place[row[inside], column[inside]] = np.stack([s, t], axis=1)[inside]
    return triangle, place


def _local(a: Array, b: Array, c: Array, point: Array) -> tuple[Array, Array]:
    """Local coordinates (n,), (n,) of points in the triangles a b c."""
    (br, bz), (cr, cz), (pr, pz) = (b - a).T, (c - a).T, (point - a).T
    size = br * cz - cr * bz
    return (pr * cz - cr * pz) / size, (br * pz - pr * bz) / size
