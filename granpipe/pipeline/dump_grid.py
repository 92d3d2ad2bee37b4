"""The grid on which the user's own dumps are averaged: it encloses the particles, in the chosen plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import psutil

from granpipe.errors import DataError
from granpipe.field import Array, Box, Grid
from granpipe.geometry.outline import Outline
from granpipe.pipeline.dump_survey import Survey
from granpipe.pipeline.dump_window import Frame, Range

LEAST_CELL = 0.02
"""Sauter diameters: smaller cells resolve nothing but the shape of single spheres, and cost time and memory."""

_ARRAYS = 30  # of the size of the grid while a snapshot is added, besides the sums of the segments
_SUMS = 6  # arrays per segment


def grid_round(found: Survey, frame: Frame, segments: int) -> Grid:
    """The grid of a frame round the particles.

    Parameters
    ----------
    found : where the particles are, and how large
    segments : how many of them will be held at once

    Raises
    ------
    DataError : ranges that make no sense, cells that are too small, or more than the memory holds
    """
    if not frame.cell >= LEAST_CELL * found.diameter:
        raise DataError(
            f"--cell {frame.cell:g} m is less than {LEAST_CELL:g} of the particles' Sauter diameter of "
            f"{found.diameter:.3g} m; {found.diameter / 4:.2g} m is fine enough"
        )
    ends = {axis: _range(found, frame, axis) for axis in "xyz"}
    lengths = [ends[axis][1] - ends[axis][0] for axis in ("xz" if frame.plane == "xz" else "xyz")]
    if frame.plane == "rz":
        lengths = [found.reach, lengths[2]]
    _check_memory(np.ceil(np.array(lengths) / frame.cell), segments)
    if frame.plane == "rz":
        return Grid.covering(found.reach, *ends["z"], frame.cell)
    flat = frame.plane == "xz"
    return Box.within(ends["x"], ends["y"], ends["z"], frame.cell, flat, cut=not flat or frame.y is not None)


def slab_grid(found: Survey, frame: Frame, outline: Outline) -> Grid:
    """The grid of a slab's section, as deep as the dumps.

    Raises
    ------
    DataError : ranges that make no sense, or other ones than those between the front and the back wall of the case
    """
    x, y, z = (outline.r_min, outline.r_max), _range(found, frame, "y"), (outline.z_bottom, outline.z_top)
    measure = outline.measure
    if measure.walled and abs(y[1] - y[0] - measure.turn) > 0.5 * found.diameter:
        raise DataError(
            f"the dumps are {y[1] - y[0]:.4g} m deep (y = {y[0]:.4g} … {y[1]:.4g} m), the case {measure.turn:.4g} m "
            "between its front and back wall, and the mean over the depth goes with it: give the depth of the dumps, "
            "all of it, or front_and_back: periodic"
        )
    grid = Box.within(x, y, z, frame.cell, flat=True, cut=frame.y is not None)
    return replace(grid, walled=measure.walled)


def vessel_box(ends: tuple[Range, Range, Range], frame: Frame, segments: int) -> Box:
    """The grid in space round a vessel.

    Parameters
    ----------
    ends : of the vessel along x, y and z [m]
    segments : how many of them will be held at once

    Raises
    ------
    DataError : more cells than the memory holds
    """
    _check_memory(np.ceil(np.ptp(np.array(ends), axis=1) / frame.cell), segments)
    return Box.within(*ends, frame.cell, flat=False, cut=True)


def _range(found: Survey, frame: Frame, axis: str) -> Range:
    """The range asked for along an axis, or that of the particles."""
    given: Range | None = getattr(frame, axis)
    number = "xyz".index(axis)
    if given is None:
        return float(found.low[number]), float(found.high[number])
    if not given[0] < given[1]:
        raise DataError(f"--{axis} {given[0]:g} {given[1]:g}: give the lower end first")
    if given[0] >= found.high[number] or given[1] <= found.low[number]:
        raise DataError(
            f"--{axis} {given[0]:g} {given[1]:g}: no particles there; they fill {found.low[number]:g} … "
            f"{found.high[number]:g} m"
        )
    return given


def _check_memory(cells: Array, segments: int) -> None:
    """Refuse a grid whose sums do not fit into the memory that is free."""
    needed = 8 * float(np.prod(cells)) * (_SUMS * segments + _ARRAYS)
    free = psutil.virtual_memory().available
    if needed > free:
        larger = (needed / free) ** (1 / len(cells))
        raise DataError(
            f"a grid of {' × '.join(f'{n:.0f}' for n in cells)} cells takes {needed / 1e9:.3g} GB of memory, of which "
            f"{free / 1e9:.3g} GB are free; make --cell {larger:.2g} times larger, or give smaller ranges"
        )
