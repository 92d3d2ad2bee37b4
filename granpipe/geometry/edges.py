"""Edges of the vessel's solids, and the exact sums over them that give free areas and volumes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from granpipe.field import Array, Grid, Mask, Measure
from granpipe.geometry.polyline import edges_of

Side = Literal["below", "above"]

LEFT = -1
"""Owner of the edges of a left wall."""


@dataclass(frozen=True)
class Edges:
    """The slanted and upright edges of all solids; levels of area and volume are sums over them.

    Parameters
    ----------
    low, high : (n, 2) lower and upper end (r, z) [m]
    sign : (n,) +1 where the free space lies on the axis side of the edge, −1 where it lies outside
    owner : (n,) 0 the wall, k the k-th obstacle, LEFT the left wall of a slab
    """

    low: Array
    high: Array
    sign: Array
    owner: Array

    @classmethod
    def of(cls, wall: Array, obstacles: Mapping[str, Array], left: Array | None = None) -> Edges:
        """Edges of walls, given downwards, and of anticlockwise polygons: free space lies left of what runs down."""
        lines = [edges_of(wall), *(edges_of(polygon, closed=True) for polygon in obstacles.values())]
        owners = list(range(len(lines)))
        if left is not None:
            lines.append(edges_of(left[::-1]))
            owners.append(LEFT)
        ends = np.concatenate(lines)
        owner = np.repeat(owners, [len(c) for c in lines])
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

    def volumes(self, measure: Measure) -> Array:
        """(n,) volume between each edge and r = 0 [m³]: π r² or depth × x, integrated over its height."""
        r0, r1 = self.low[:, 0], self.high[:, 0]
        return measure.turn * (self.high[:, 1] - self.low[:, 1]) * _mean_reach(measure, r0, r1)

    def volume_within(self, grid: Grid) -> Array:
        """(nz, nr+1) free volume in each row of the grid within each edge of r [m³]: ∫ Σ ± π min(r(z), R)² dz."""
        measure = grid.measure
        total = np.zeros((grid.shape[0], grid.shape[1] + 1))
        z0, z1 = grid.z_edges[:-1], grid.z_edges[1:]
        for low, high, sign, slope in zip(self.low, self.high, self.sign, self.slope, strict=True):
            begin, end = np.clip(z0, low[1], high[1]), np.clip(z1, low[1], high[1])
            rows = np.flatnonzero(end > begin)
            from_r = low[0] + slope * (begin[rows] - low[1])
            to_r = low[0] + slope * (end[rows] - low[1])
            height = (end[rows] - begin[rows])[:, None]
            total[rows] += sign * measure.turn * height * _clipped_reach(measure, from_r, to_r, grid.r_edges)
        return total


def _mean_reach(measure: Measure, r0: Array, r1: Array) -> Array:
    """Mean of `Measure.reach` along a straight edge from r0 to r1."""
    return (r0 * r0 + r0 * r1 + r1 * r1) / 6 if measure.axial else 0.5 * (r0 + r1)


def _clipped_reach(measure: Measure, from_r: Array, to_r: Array, limit: Array) -> Array:
    """(k, m) mean of `Measure.reach` of min(r, limit) where r changes linearly; (k,) values against (m,) limits."""
    small, large = np.minimum(from_r, to_r)[:, None], np.maximum(from_r, to_r)[:, None]
    reach = np.where(large > small, large - small, 1.0)
    part = np.where(large > small, np.clip((limit - small) / reach, 0.0, 1.0), small <= limit)
    middle = np.where(part < 1, limit, large)
    return np.asarray(part * _mean_reach(measure, small, middle) + (1 - part) * measure.reach(limit))
