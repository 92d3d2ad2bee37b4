"""The surfaces that solids touch, cut into short pieces in the (r, z) plane: places for what is measured at walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granpipe.field import Array, Measure
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import edges_of, nearest_points

Index = NDArray[np.int64]

_AT_ONCE = 1 << 18  # pairs of a point and an edge


@dataclass(frozen=True)
class WallPieces:
    """Equal pieces of the edges of the walls and the obstacles; solid lies to their left.

    The outer wall runs from the top down, and so does the right one of a slab; its left one runs upwards.

    Parameters
    ----------
    names : of the surfaces: ``wall``, or ``right`` and ``left`` in a slab, then the obstacles
    surface : (edges,) which of the names each edge is of
    edges : (edges, 2, 2) [edge, end, (r, z)] [m]
    counts : (edges,) number of pieces of each edge
    measure : what the plane stands for
    """

    names: tuple[str, ...]
    surface: Index
    edges: Array
    counts: Index
    measure: Measure

    @classmethod
    def of(cls, outline: Outline, length: float) -> WallPieces:
        """Pieces no longer than `length` [m]."""
        walls = {"wall": outline.wall}
        if not outline.measure.axial:
            walls = {"right": outline.wall, "left": outline.left[::-1]}
        surfaces = [
            *(edges_of(wall) for wall in walls.values()),
            *(edges_of(polygon, closed=True) for polygon in outline.obstacles.values()),
        ]
        edges = np.concatenate(surfaces)
        reach = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
        return cls(
            names=(*walls, *outline.obstacles),
            surface=np.repeat(np.arange(len(surfaces)), [len(one) for one in surfaces]),
            edges=edges,
            counts=np.maximum(1, np.ceil(reach / length - 1e-9)).astype(np.int64),
            measure=outline.measure,
        )

    def __len__(self) -> int:
        return int(self.counts.sum())

    @property
    def labels(self) -> NDArray[np.str_]:
        """(m,) name of the surface that each piece is of."""
        return np.repeat(np.array(self.names)[self.surface], self.counts)

    @property
    def ends(self) -> Array:
        """(m, 2, 2) [piece, end, (r, z)] [m]."""
        return np.concatenate(
            [
                edges_of(start + np.linspace(0, 1, count + 1)[:, None] * (end - start))
                for (start, end), count in zip(self.edges, self.counts, strict=True)
            ]
        )

    @property
    def tangent(self) -> Array:
        """(m, 2) unit vectors (r, z) along the pieces: downwards on the outer wall, upwards on the left of a slab."""
        along = self.edges[:, 1] - self.edges[:, 0]
        return np.repeat(along / np.linalg.norm(along, axis=1, keepdims=True), self.counts, axis=0)

    @property
    def normal(self) -> Array:
        """(m, 2) unit normals (r, z) that point into the solid."""
        along = self.tangent
        return np.column_stack([-along[:, 1], along[:, 0]])

    @property
    def area(self) -> Array:
        """(m,) area of the surface that each piece sweeps about the axis, or along the depth of a slab [m²]."""
        ends = self.ends
        around = self.measure.turn * self.measure.weight(ends[:, :, 0]).mean(axis=1)
        return np.asarray(around * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def nearest(self, points: Array) -> tuple[Index, Array]:
        """Nearest piece (n,) of each point (n, 2) and the distance to it (n,) [m]."""
        lots = np.array_split(points, len(points) * len(self.edges) // _AT_ONCE + 1)
        piece, distance = zip(*(self._nearest(lot) for lot in lots), strict=True)
        return np.concatenate(piece), np.concatenate(distance)

    def _nearest(self, points: Array) -> tuple[Index, Array]:
        distance, foot = nearest_points(points, self.edges)
        edge = distance.argmin(axis=1)
        each = np.arange(len(points))
        start, end = self.edges[edge, 0], self.edges[edge, 1]
        part = np.linalg.norm(foot[each, edge] - start, axis=1) / np.linalg.norm(end - start, axis=1)
        number = np.minimum((part * self.counts[edge]).astype(np.int64), self.counts[edge] - 1)
        first = np.cumsum(self.counts) - self.counts
        return first[edge] + number, distance[each, edge]
