"""From sums of particles between walls that are set back to those of the vessel as drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granpipe.field import Array, Grid, Mask, level_flow
from granpipe.homogenize.average import Sums, merge


def within_drawn(segments: Sequence[Sums], grid: Grid, inside_fraction: Array) -> list[Sums]:
    """Segments without what lies in the drawn solid; each level's flow is raised to all that passes it.

    What passes a level, and what gathers between two, stays what it was in the mean of the segments. One factor for
    each level, from all segments together, so that the operation is linear.

    Parameters
    ----------
    segments : sums on a grid with the rows of `grid` and at least its columns
    grid : of the vessel as drawn
    inside_fraction : (nz, nr) part of each cell inside the vessel as drawn
    """
    whole, columns = merge(segments), grid.shape[1]
    through, across = _open_faces(inside_fraction)
    total, kept = (level_flow(flux, whole.grid) for flux in (whole.mean_flux[1], _cut(whole, through)))
    raised = np.divide(total, kept, out=np.ones_like(total), where=(total > 0) & (kept > 0))
    between = 0.5 * (raised[1:] + raised[:-1])[:, None]
    room = inside_fraction * grid.cell_volume
    share = room / room.sum(axis=1, keepdims=True)
    return [
        replace(
            one,
            grid=grid,
            volume=one.volume[:, :columns] * inside_fraction,
            flow_r=one.flow_r[:, : columns + 1] * across * between,
            flow_z=one.flow_z[:, :columns] * through * raised[:, None],
            gain=one.gain.sum(axis=1, keepdims=True) * share,
        )
        for one in segments
    ]


def share_in_solid(segments: Sequence[Sums], inside_fraction: Array) -> float:
    """Largest part of a level's flow that passes it in the drawn solid, on average over the segments."""
    whole = merge(segments)
    through, _ = _open_faces(inside_fraction)
    total, kept = (level_flow(flux, whole.grid) for flux in (whole.mean_flux[1], _cut(whole, through)))
    return float(np.max(1 - np.divide(kept, total, out=np.zeros_like(total), where=total > 0)))


def _open_faces(inside_fraction: Array) -> tuple[Mask, Mask]:
    """(nz+1, nr), (nz, nr+1) horizontal and upright faces between cells that lie in the vessel by more than half."""
    free = inside_fraction > 0.5
    through = np.pad(free, ((1, 0), (0, 0)), mode="edge") & np.pad(free, ((0, 1), (0, 0)), mode="edge")
    across = np.pad(free, ((0, 0), (1, 0)), mode="edge") & np.pad(free, ((0, 0), (0, 1)))
    return through, across


def _cut(sums: Sums, through: Mask) -> Array:
    """Vertical flux of some sums, without that of the faces that are not open."""
    flux = np.zeros_like(sums.flow_z)
    columns = through.shape[1]
    flux[:, :columns] = sums.mean_flux[1][:, :columns] * through
    return flux
