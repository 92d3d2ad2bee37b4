"""The grid on which dumps that a user brings are averaged: round the particles, in the plane asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.field import Array, Box, Grid

Plane = Literal["rz", "xz", "xyz"]
Range = tuple[float, float]

LEAST_CELL = 0.02
"""Sauter diameters: smaller cells resolve nothing but the shape of single spheres, and cost time and memory."""

_ARRAYS = 30  # of the size of the grid while a snapshot is added, besides the sums of the segments
_SUMS = 6  # arrays per segment


@dataclass(frozen=True)
class Frame:
    """What part of space is averaged, and how.

    plane : rings about the axis (rz), a slab averaged over y (xz), or space (xyz)
    cell : edge length of a cell [m]
    x, y, z : ranges [m]; None: as far as the particles of the first snapshot reach, within the box
    """

    plane: Plane
    cell: float
    x: Range | None = None
    y: Range | None = None
    z: Range | None = None


def grid_round(snapshot: Snapshot, frame: Frame, diameter: float, segments: int) -> Grid:
    """The grid of a frame; DataError where it makes no sense or does not fit into memory.

    Parameters
    ----------
    diameter : Sauter diameter [m]
    segments : how many of them will be held at once
    """
    if not frame.cell >= LEAST_CELL * diameter:
        raise DataError(
            f"--cell {frame.cell:g} m is less than {LEAST_CELL:g} of the particles' Sauter diameter of "
            f"{diameter:.3g} m; {diameter / 4:.2g} m is fine enough"
        )
    ends = {axis: _range(snapshot, frame, axis) for axis in "xyz"}
    lengths = [ends[axis][1] - ends[axis][0] for axis in ("xz" if frame.plane == "xz" else "xyz")]
    if frame.plane == "rz":
        reach = float((np.hypot(snapshot.position[:, 0], snapshot.position[:, 1]) + snapshot.radius).max())
        lengths = [reach, lengths[2]]
    _check_memory(np.ceil(np.array(lengths) / frame.cell), segments)
    if frame.plane == "rz":
        return Grid.covering(reach, *ends["z"], frame.cell)
    flat = frame.plane == "xz"
    return Box.within(ends["x"], ends["y"], ends["z"], frame.cell, flat, cut=not flat or frame.y is not None)


def _range(snapshot: Snapshot, frame: Frame, axis: str) -> Range:
    """The range asked for along an axis, or that of the particles within the box."""
    given: Range | None = getattr(frame, axis)
    if given is not None:
        if not given[0] < given[1]:
            raise DataError(f"--{axis} {given[0]:g} {given[1]:g}: give the lower end first")
        return given
    number = "xyz".index(axis)
    place, radius, (low, high) = snapshot.position[:, number], snapshot.radius, snapshot.box[number]
    return max(float((place - radius).min()), float(low)), min(float((place + radius).max()), float(high))


def _check_memory(cells: Array, segments: int) -> None:
    """Refuse a grid whose sums do not fit into the memory that is free."""
    needed = 8 * float(np.prod(cells)) * (_SUMS * segments + _ARRAYS)
    free = _free_memory()
    if needed > free:
        larger = (needed / free) ** (1 / len(cells))
        raise DataError(
            f"a grid of {' × '.join(f'{n:.0f}' for n in cells)} cells takes {needed / 1e9:.3g} GB of memory, of which "
            f"{free / 1e9:.3g} GB are free; make --cell {larger:.2g} times larger, or give smaller ranges"
        )


def _free_memory() -> float:
    """Bytes that can be had without swapping."""
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return 1024.0 * float(line.split()[1])
    return np.inf
