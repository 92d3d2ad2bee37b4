"""Bins for what is known of particles one by one: groups of cells about half a diameter wide, read through windows.

A window is a bin with its neighbours, about one and a half diameters wide: fields that are not smooth below the size
of a particle are seen through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granpipe.field import Array, Grid

PER_DIAMETER = 2
"""Bins per particle diameter."""

_REACH = 1  # bins of a window on each side


@dataclass(frozen=True)
class Bins:
    """Square groups of cells of a grid, from the axis (or the left) and from below; the last ones may be smaller.

    Parameters
    ----------
    grid : the cells
    factor : cells per bin along each direction
    """

    grid: Grid
    factor: int

    @classmethod
    def of(cls, grid: Grid, diameter: float) -> Bins:
        """Bins for particles of this diameter [m]."""
        return cls(grid, max(1, round(diameter / (PER_DIAMETER * grid.cell))))

    @property
    def shape(self) -> tuple[int, int]:
        """(bz, br)."""
        rows, columns = self.grid.shape
        return -(-rows // self.factor), -(-columns // self.factor)

    @property
    def r_edges(self) -> Array:
        """(br+1,) [m]."""
        return np.append(self.grid.r_edges[:-1][:: self.factor], self.grid.r_edges[-1])

    @property
    def z_edges(self) -> Array:
        """(bz+1,) [m]."""
        return np.append(self.grid.z_edges[:-1][:: self.factor], self.grid.z_edges[-1])

    def joined(self, cells: Array) -> Array:
        """(bz, br) sums of (nz, nr) values of cells."""
        for axis in (0, 1):
            cells = np.add.reduceat(cells, np.arange(0, cells.shape[axis], self.factor), axis=axis)
        return cells

    def sums(self, r: Array, z: Array, values: Array) -> Array:
        """(k, bz, br) sums over points at (n,) r and z of (k, n) values; points beyond the ends are left out.

        Those beyond the walls count in the outermost bins: soft contacts overlap the wall.
        """
        rows, columns = self.shape
        size, low = self.factor * self.grid.cell, self.grid.z_edges[0]
        width, left = self.factor * (self.grid.r_edges[1] - self.grid.r_edges[0]), self.grid.r_edges[0]
        there = (z >= low) & (z < self.grid.z_edges[-1])
        row = np.minimum(((z[there] - low) / size).astype(np.int64), rows - 1)
        place = row * columns + ((r[there] - left) / width).astype(np.int64).clip(0, columns - 1)
        added = [np.bincount(place, value[there], rows * columns) for value in np.asarray(values)]
        return np.array(added, dtype=float).reshape(-1, rows, columns)

    def window(self, sums: Array) -> Array:
        """(…, bz, br) sums over the window round each bin."""
        for axis in (-2, -1):
            width = [(0, 0)] * sums.ndim
            width[axis] = (_REACH, _REACH)
            padded, count = np.pad(sums, width), sums.shape[axis]
            sums = np.sum([np.take(padded, np.arange(k, k + count), axis) for k in range(2 * _REACH + 1)], axis=0)
        return sums

    def on_cells(self, values: Array) -> Array:
        """(…, nz, nr) the value of its bin in every cell."""
        rows, columns = self.grid.shape
        spread = np.repeat(np.repeat(values, self.factor, axis=-2), self.factor, axis=-1)
        return np.asarray(spread[..., :rows, :columns])
