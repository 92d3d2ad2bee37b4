"""How much of each cell of a grid in space lies in a vessel of revolution."""

from __future__ import annotations

import numpy as np

from granpipe.field import Array, Box, Grid
from granpipe.geometry.outline import Outline

_POINTS = 16  # along each side of a cell
_RINGS = 8  # across a cell


def inside_space(outline: Outline, grid: Box) -> Array:
    """(nz, ny, nx) part of each cell that lies in the vessel and outside the obstacles.

    Exact along z and r, by 16 × 16 points in each cell's horizontal section: to about 1 % of a cell that a wall cuts.

    Parameters
    ----------
    grid : whose z-axis is the axis of the vessel
    """
    x, y = (_points(edges) for edges in (grid.r_edges, grid.y_edges))
    width = grid.cell / _RINGS
    farthest = float(np.hypot(np.abs(x).max(), np.abs(y).max()))
    rings = Grid(np.asarray(width * np.arange(int(np.ceil(farthest / width)) + 1), dtype=float), grid.z_edges)
    part = outline.inside_fraction(rings)
    found = np.zeros(grid.shape)
    for along_x in x:
        for along_y in y:
            ring = np.floor(np.hypot(along_y[:, None], along_x) / width).astype(np.int64)
            found += part[:, np.minimum(ring, part.shape[1] - 1)]
    found /= len(x) * len(y)
    found[found > 1 - 1e-12] = 1.0
    return np.asarray(found)


def _points(edges: Array) -> Array:
    """(points, cells) evenly spaced in each cell."""
    share = (np.arange(_POINTS) + 0.5) / _POINTS
    return np.asarray(edges[:-1] + share[:, None] * np.diff(edges))
