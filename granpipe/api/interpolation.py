"""Velocity between the nodes of the grid.

Where there is a stream function the velocity is derived from it, u = −(1/r)∂ψ/∂z and w = (1/r)∂ψ/∂r. ψ is a piecewise
bicubic (Hermite) polynomial in r² and z that takes ψ and its derivatives at the nodes: the velocity there is the one
that is exported, it is continuous, free of divergence at every point, and between nodes exactly as much flows as in the
field. Plug and parabola are exact; elsewhere the error falls with the square of the cell, but at the edge of a ledge or
an obstacle, where the velocity jumps, it overshoots within the cells that touch it.

ψ is constant beyond a wall, so in a cell that a wall cuts it has a kink that no polynomial follows. Nodes outside such
a wall take instead the ψ that the exported velocities lead to from the nodes inside; the flow up to such a wall is then
met to the accuracy of these velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granpipe.export.nodes import GROWN_LAYERS, WHOLE, Nodes
from granpipe.field import Array, Field, Mask

Index = NDArray[np.intp]
Basis = Callable[[Array], tuple[Array, Array, Array, Array]]


@dataclass(frozen=True)
class Places:
    """Points in cells of a grid: the cells' rows and columns, and where the points are in them, (n,) each.

    Parameters
    ----------
    row, column : of the cell
    up, out : coordinates in the cell along its second and first axis, from 0 to 1
    """

    row: Index
    column: Index
    up: Array
    out: Array


def cells_at(axes: tuple[Array, ...], points: tuple[Array, ...], cells: Mask) -> tuple[tuple[Index, ...], Mask]:
    """Indices, last axis first, of the marked cells that points lie in or on, and whether each point has one.

    Parameters
    ----------
    axes : edges of the cells along each coordinate, rising
    points : (n,) coordinates
    cells : which cells count, indexed by the last coordinate first
    """
    shape = points[0].shape
    found, index = np.zeros(shape, dtype=bool), tuple(np.zeros(shape, dtype=np.intp) for _ in axes)
    for signs in np.ndindex(*(2 for _ in axes)):  # a point on an edge belongs to the cells on both sides of it
        here, inside = [], ~found
        for edges, values, sign in zip(axes, points, signs, strict=True):
            place = np.searchsorted(edges, values + (1 - 2 * sign) * 1e-9 * (edges[1] - edges[0]), side="right") - 1
            inside = inside & (place >= 0) & (place < len(edges) - 1)
            here.append(place.clip(0, len(edges) - 2))
        here.reverse()
        inside = inside & cells[tuple(here)]
        index = tuple(np.where(inside, new, old) for new, old in zip(here, index, strict=True))
        found = found | inside
    return index, found


def bilinear(values: Array, at: Places) -> Array:
    """(n,) values on nodes, linear along both coordinates."""
    low, high = ((1 - at.out) * values[row, at.column] + at.out * values[row, at.column + 1]
                 for row in (at.row, at.row + 1))  # fmt: skip
    return np.asarray((1 - at.up) * low + at.up * high)


@dataclass(frozen=True)
class StreamSurface:
    """ψ of a field as a smooth function.

    Parameters
    ----------
    x, z : coordinates of the nodes: r² or, without an axis, x; and z
    axial : whether x is r²
    psi, psi_x, psi_z, psi_xz : (nz, nx) ψ and its derivatives at the nodes
    """

    x: Array
    z: Array
    axial: bool
    psi: Array
    psi_x: Array
    psi_z: Array
    psi_xz: Array

    @classmethod
    def of(cls, field: Field, nodes: Nodes) -> StreamSurface:
        """From the ψ and the velocities on nodes, which must have a ψ."""
        assert nodes.psi is not None
        axial, z = nodes.measure.axial, nodes.z
        x = nodes.r**2 if axial else nodes.r
        psi_x, psi_z = nodes.bulk_w / (2 if axial else 1), -nodes.measure.weight(nodes.r) * nodes.bulk_u
        psi = _beyond_cut_walls(nodes.psi, psi_x, psi_z, x, z, field, nodes)
        upward = np.pad(nodes.cells, ((0, 0), (1, 0))) | np.pad(nodes.cells, ((0, 0), (0, 1)))
        slope = np.pad(np.diff(psi_x, axis=0) / np.diff(z)[:, None] * upward, ((1, 1), (0, 0)))
        count = np.pad(upward.astype(float), ((1, 1), (0, 0)))
        psi_xz = (slope[1:] + slope[:-1]) / np.maximum(1, count[1:] + count[:-1])
        return cls(x, z, axial, psi, psi_x, psi_z, psi_xz)

    def value(self, r: Array, at: Places) -> Array:
        """(n,) ψ at radii r in cells [m³/s per radian]."""
        return self._sum(r, at, _hermite, _hermite)

    def velocity(self, r: Array, at: Places) -> tuple[Array, Array]:
        """(n,) u and w at radii r in cells [m/s]."""
        wide, tall = self._size(at)
        psi_x, psi_z = self._sum(r, at, _slope, _hermite) / wide, self._sum(r, at, _hermite, _slope) / tall
        if not self.axial:
            return -psi_z, psi_x
        return np.divide(-psi_z, r, out=np.zeros_like(r), where=r > 0), 2 * psi_x

    def _size(self, at: Places) -> tuple[Array, Array]:
        return self.x[at.column + 1] - self.x[at.column], self.z[at.row + 1] - self.z[at.row]

    def _sum(self, r: Array, at: Places, across: Basis, up: Basis) -> Array:
        wide, tall = self._size(at)
        along = across(((r**2 if self.axial else r) - self.x[at.column]) / wide)
        upward = up(at.up)
        total = np.zeros(len(r))
        for i, j in np.ndindex(2, 2):
            corner = at.row + j, at.column + i
            total += (
                along[i] * (upward[j] * self.psi[corner] + upward[2 + j] * tall * self.psi_z[corner])
                + along[2 + i] * wide * (upward[j] * self.psi_x[corner] + upward[2 + j] * tall * self.psi_xz[corner])
            )  # fmt: skip
        return total


def _hermite(t: Array) -> tuple[Array, Array, Array, Array]:
    """Weights of the values at the ends 0 and 1 and of the slopes there."""
    return (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t), t * (1 - t) ** 2, t**2 * (t - 1)


def _slope(t: Array) -> tuple[Array, Array, Array, Array]:
    """Derivatives of these weights."""
    return 6 * t * (t - 1), 6 * t * (1 - t), (1 - t) * (1 - 3 * t), t * (3 * t - 2)


def _beyond_cut_walls(psi: Array, psi_x: Array, psi_z: Array, x: Array, z: Array, field: Field, nodes: Nodes) -> Array:
    """ψ on the nodes; on those outside a wall that cuts their cells, what the derivatives lead to from known nodes.

    A node strictly inside a straight wall has no cell round it that lies wholly outside; one outside has.
    """
    inside = field.inside_fraction
    outside = np.pad(inside <= 0, 1)
    outside[:, -1] = True  # beyond the grid lies the wall
    unknown = nodes.solids & _touching(outside) & _touching(np.pad((inside > 0) & (inside < WHOLE), 1))
    known, cells = nodes.solids & ~unknown, np.pad(nodes.cells, 1)
    level, upright = cells[1:, 1:-1] | cells[:-1, 1:-1], cells[1:-1, 1:] | cells[1:-1, :-1]
    outwards = 0.5 * np.diff(x) * (psi_x[:, 1:] + psi_x[:, :-1])
    upwards = 0.5 * np.diff(z)[:, None] * (psi_z[1:] + psi_z[:-1])
    steps: list[tuple[Any, Any, Array, Mask]] = [  # to a node, from its neighbour along an edge of a solid cell
        (np.s_[:, 1:], np.s_[:, :-1], outwards, level),
        (np.s_[1:], np.s_[:-1], upwards, upright),
    ]
    steps += [(start, end, -change, edge) for end, start, change, edge in steps]
    for _ in range(GROWN_LAYERS):
        total, count = np.zeros_like(psi), np.zeros_like(psi)
        for end, start, change, edge in steps:
            usable = edge & known[start]
            total[end] += np.where(usable, psi[start] + change, 0.0)
            count[end] += usable
        new = unknown & ~known & (count > 0)
        psi = np.where(new, total / np.maximum(count, 1.0), psi)
        known = known | new
    return psi


def _touching(cells: Mask) -> Mask:
    """(nz+1, nr+1) nodes that touch one of these cells (nz+2, nr+2), of which the outermost lie round the grid."""
    return np.asarray(cells[1:, 1:] | cells[1:, :-1] | cells[:-1, 1:] | cells[:-1, :-1])
