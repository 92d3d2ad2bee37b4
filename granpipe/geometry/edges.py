"""Edges of the vessel's solids, and the exact sums over them that give free areas and volumes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from granpipe.field import Array, Grid, Mask
from granpipe.geometry.polyline import edges_of

Side = Literal["below", "above"]


@dataclass(frozen=True)
class Edges:
    """The slanted and upright edges of all solids; levels of area and volume are sums over them.

    Parameters
    ----------
    low, high : (n, 2) lower and upper end (r, z) [m]
    sign : (n,) +1 where the free space lies on the axis side of the edge, −1 where it lies outside
    owner : (n,) 0 the wall, k the k-th obstacle
    """

    low: Array
    high: Array
    sign: Array
    owner: Array

    @classmethod
    def of(cls, wall: Array, obstacles: Mapping[str, Array]) -> Edges:
        """Edges of the wall (downwards) and of anticlockwise polygons: free space lies left of what runs down."""
        lines = [edges_of(wall), *(edges_of(polygon, closed=True) for polygon in obstacles.values())]
        ends = np.concatenate(lines)
        owner = np.repeat(np.arange(len(lines)), [len(c) for c in lines])
        upright = ends[:, 0, 1] != ends[:, 1, 1]
        ends, owner = ends[upright], owner[upright]
        down = ends[:, 0, 1] > ends[:, 1, 1]
        low = np.where(down[:, None], ends[:, 1], ends[:, 0])
        high = np.where(down[:, None], ends[:, 0], ends[:, 1])
        return cls(low, high, np.where(down, 1.0, -1.0), owner)

    @property
    def slope(self) -> Array:
        """(n,) dr/dz."""
        return np.asarray((self.high[:, 0] - self.low[:, 0]) / (self.high[:, 1] - self.low[:, 1]))

    def at(self, z: Array, side: Side) -> tuple[Mask, Array]:
        """Whether each edge spans the levels z (k,), seen from below or above, and its radius there: two (n, k)."""
        z_low, z_high = self.low[:, 1:], self.high[:, 1:]
        spans = (z_low < z) & (z <= z_high) if side == "below" else (z_low <= z) & (z < z_high)
        return spans, self.low[:, :1] + self.slope[:, None] * (z - z_low)

    def frustum_volumes(self) -> Array:
        """(n,) volume between each edge and the axis [m³] (Pappus)."""
        r0, r1 = self.low[:, 0], self.high[:, 0]
        return np.asarray(np.pi / 3 * (self.high[:, 1] - self.low[:, 1]) * (r0 * r0 + r0 * r1 + r1 * r1))

    def volume_within(self, grid: Grid) -> Array:
        """(nz, nr+1) free volume in each row of the grid within each edge radius [m³]: ∫ Σ ± π min(r(z), R)² dz."""
        total = np.zeros((grid.shape[0], grid.shape[1] + 1))
        z0, z1 = grid.z_edges[:-1], grid.z_edges[1:]
        for low, high, sign, slope in zip(self.low, self.high, self.sign, self.slope, strict=True):
            begin, end = np.clip(z0, low[1], high[1]), np.clip(z1, low[1], high[1])
            rows = np.flatnonzero(end > begin)
            from_r = low[0] + slope * (begin[rows] - low[1])
            to_r = low[0] + slope * (end[rows] - low[1])
            total[rows] += sign * np.pi * _clipped_square(from_r, to_r, end[rows] - begin[rows], grid.r_edges)
        return total


def _clipped_square(from_r: Array, to_r: Array, height: Array, limit: Array) -> Array:
    """(k, m) ∫ min(r, limit)² dz over a height on which r changes linearly; (k,) values against (m,) limits."""
    small, large = np.minimum(from_r, to_r)[:, None], np.maximum(from_r, to_r)[:, None]
    reach = np.where(large > small, large - small, 1.0)
    part = np.where(large > small, np.clip((limit - small) / reach, 0.0, 1.0), small <= limit)
    middle = np.where(part < 1, limit, large)
    inner = part / 3 * (small * small + small * middle + middle * middle)
    return np.asarray(height[:, None] * (inner + (1 - part) * limit**2))
