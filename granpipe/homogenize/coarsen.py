"""Sums on larger cells: cells are merged exactly, without depositing the spheres again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Grid
from granpipe.homogenize.average import Sums


def coarsened(sums: Sums, factor: int) -> Sums:
    """The sums as they would stand on cells `factor` times as large; columns beyond the outermost edge are empty.

    What is summed per cell beside volume and flow (`Sums.extra`) is left out. DataError where rows cannot be joined.
    """
    if factor == 1:
        return sums
    rows, columns = sums.grid.shape
    if rows % factor:
        raise DataError(f"{rows} rows of cells cannot be joined by {factor}; choose homogenize.cell accordingly")
    short = -columns % factor
    cell = sums.grid.cell * factor
    grid = Grid(cell * np.arange((columns + short) // factor + 1.0), sums.grid.z_edges[::factor])
    return replace(
        sums,
        grid=grid,
        volume=_joined(_joined(_widened(sums.volume, short), factor, 0), factor, 1),
        gain=_joined(_joined(_widened(sums.gain, short), factor, 0), factor, 1),
        flow_r=_joined(_widened(sums.flow_r, short)[:, ::factor], factor, 0),
        flow_z=_joined(_widened(sums.flow_z, short)[::factor], factor, 1),
        level_flow=sums.level_flow[:, ::factor],
        moments=None if sums.moments is None else _joined(sums.moments, factor, 1),
        extra={},
    )


def _widened(values: Array, columns: int) -> Array:
    return np.pad(values, ((0, 0), (0, columns)))


def _joined(values: Array, factor: int, axis: int) -> Array:
    """Sums of `factor` neighbours along an axis."""
    return np.add.reduceat(values, np.arange(0, values.shape[axis], factor), axis=axis)
