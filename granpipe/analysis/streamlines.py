"""Streamlines of a field with the time that the solids take along them, and their age in every cell.

In each cell the flux through opposite faces is interpolated linearly, which is what a stream function that is bilinear
in ∫ r dr (x in a slab) and z gives; the path through a cell and its time then follow exactly: D. W. Pollock,
Semianalytical computation of path lines for finite-difference models, Ground Water 26 (1988) 743. Solids move at
v = F/φ, each cell with its φ.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log1p

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Field

MOST_STEPS = 100_000
"""Cells along one line; a line that is longer goes round in circles."""


@dataclass(frozen=True)
class Streamline:
    """Where solids go that enter at one place.

    Parameters
    ----------
    within : part of the flow between the axis (the left wall of a slab) and this line
    r, z : (n,) points, from the inlet on [m]
    time : (n,) since the inlet, at the flow rate of the process [s]
    leaves : whether it comes to the outlet
    """

    within: float
    r: Array
    z: Array
    time: Array
    leaves: bool


def streamlines(field: Field, count: int = 20) -> list[Streamline]:
    """Lines from the inlet, each amid one of `count` streamtubes of equal flow; the first is the nearest to the axis.

    Raises
    ------
    DataError : the field has no stream function
    """
    if field.psi is None:
        raise DataError("the field has no stream function to draw streamlines by; use homogenize.method: psi")
    part = np.maximum.accumulate(field.psi[-1] / field.psi[-1, -1])
    within = (np.arange(count) + 0.5) / count
    measure = field.grid.measure
    start = np.interp(within, part, measure.reach(field.grid.r_edges))
    paths = _Paths(field)
    return [
        Streamline(float(share), measure.from_reach(x), z, time, leaves)
        for share, (x, z, time, leaves) in (
            (share, paths.follow(float(x), float(field.grid.z_edges[-1])))
            for share, x in zip(within, start, strict=True)
        )
    ]


def age(field: Field) -> Array:
    """(nz, nr) time since the solids in the middle of each cell entered at the inlet [s].

    It is that at the flow rate of the process; NaN where they did not enter: in voids, at rest, and in closed eddies.

    Raises
    ------
    DataError : the field has no stream function
    """
    if field.psi is None:
        raise DataError("the field has no stream function to tell ages by; use homogenize.method: psi")
    if field.grid.measure.walled:
        raise DataError("a mean over the depth tells no ages where front and back walls hold solids back")
    paths = _Paths(field, upstream=True)
    found = np.full(field.grid.shape, np.nan)
    edges = field.grid.measure.reach(field.grid.r_edges)
    middles = 0.5 * (edges[1:] + edges[:-1])
    for row, column in np.argwhere(field.bulk).tolist():
        _, _, time, reached = paths.follow(middles[column], float(field.grid.z_centres[row]))
        found[row, column] = time[-1] if reached else np.nan
    return found


class _Paths:
    """Paths through the cells in x = ∫ r dr (x itself in a slab) and z.

    Speeds are those of x and z through the faces of a cell: dx/dt = r u, linear in x, and dz/dt = w, linear in z.
    """

    def __init__(self, field: Field, upstream: bool = False) -> None:
        assert field.psi is not None
        grid, sign = field.grid, -1.0 if upstream else 1.0
        reach = grid.measure.reach(grid.r_edges)
        self.x, self.z = reach.tolist(), grid.z_edges.tolist()
        solids = np.full(grid.shape, field.bulk_packing) if field.packing_fraction is None else field.packing_fraction
        share = solids * field.inside_fraction
        scale = np.where(field.bulk & (share > 0), sign * field.flow_scale / np.maximum(share, 1e-30), 0.0)
        across = -np.diff(field.psi, axis=0) / np.diff(grid.z_edges)[:, None]
        upward = np.diff(field.psi, axis=1) / np.diff(reach)
        speeds = (across[:, :-1], across[:, 1:], upward[:-1], upward[1:])
        self.left, self.right, self.below, self.above = ((scale * speed).tolist() for speed in speeds)
        self.end = len(self.z) - 1 if upstream else 0

    def follow(self, x: float, z: float) -> tuple[Array, Array, Array, bool]:
        """Points of a path in x = ∫ r dr and z, their times, and whether it leaves through the far end."""
        column = min(max(int(np.searchsorted(self.x, x, side="right")) - 1, 0), len(self.x) - 2)
        row = min(max(int(np.searchsorted(self.z, z, side="right")) - 1, 0), len(self.z) - 2)
        xs, zs, times = [x], [z], [0.0]
        for _ in range(MOST_STEPS):
            x_low, x_high, z_low, z_high = self.x[column], self.x[column + 1], self.z[row], self.z[row + 1]
            left, right = self.left[row][column], self.right[row][column]
            below, above = self.below[row][column], self.above[row][column]
            time_x, out = _exit_time(x, x_low, x_high, left, right)
            time_z, up = _exit_time(z, z_low, z_high, below, above)
            time = min(time_x, time_z)
            if time == inf:
                return np.array(xs), np.array(zs), np.array(times), False
            if time_x < time_z:
                x, z = (x_low, x_high)[out], _moved(z, z_low, z_high, below, above, time)
                column += 1 if out else -1
            else:
                x, z = _moved(x, x_low, x_high, left, right, time), (z_low, z_high)[up]
                row += 1 if up else -1
            xs.append(x)
            zs.append(z)
            times.append(times[-1] + time)
            if not 0 <= row < len(self.z) - 1:
                return np.array(xs), np.array(zs), np.array(times), z == self.z[self.end]
            if not 0 <= column < len(self.x) - 1:
                break
        return np.array(xs), np.array(zs), np.array(times), False


def _exit_time(place: float, low: float, high: float, at_low: float, at_high: float) -> tuple[float, int]:
    """Time in which a place between `low` and `high` comes to one of them, and to which, 0 or 1. Speed is linear."""
    slope = (at_high - at_low) / (high - low)
    speed = at_low + slope * (place - low)
    end, way, target = (1, high - place, at_high) if speed > 0 else (0, low - place, at_low)
    if speed == 0 or speed * target <= 0:  # at rest, or it stands still before the end
        return inf, end
    if abs(slope * way) < 1e-9 * abs(speed):
        return way / speed, end
    return log1p(slope * way / speed) / slope, end


def _moved(place: float, low: float, high: float, at_low: float, at_high: float, time: float) -> float:
    """Where a place between `low` and `high` is after a time."""
    slope = (at_high - at_low) / (high - low)
    speed = at_low + slope * (place - low)
    moved = speed * time if abs(slope * time) < 1e-9 else speed * float(np.expm1(slope * time)) / slope
    return min(max(place + moved, low), high)
