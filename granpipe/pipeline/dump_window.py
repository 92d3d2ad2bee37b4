"""The user's snapshots that are averaged, rotated and moved so that z is up and the axis is at x = y = 0."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from granpipe.dem.dump import first_step, read_dumps
from granpipe.dem.snapshot import Snapshot, check_plausible
from granpipe.errors import DataError
from granpipe.field import Array

Plane = Literal["rz", "xz", "xyz"]
Up = Literal["x", "y", "z", "-x", "-y", "-z"]
Range = tuple[float, float]

TURNS: dict[Up, Array] = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x": np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]),
    "-x": np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]),
}
"""Rotations that bring a direction of the dump to z."""

_SAME_TIME = 1e-3


@dataclass(frozen=True)
class Frame:
    """What part of space is averaged, and how.

    plane : rings about the axis (rz), a slab averaged over y (xz), or space (xyz)
    cell : edge length of a cell [m]
    x, y, z : ranges [m]; None: as far as the particles reach, within the box
    up : direction of the dump against gravity; None: z, and not said
    axis : where the axis stands in the dump's two other directions, in the order of the alphabet [m]; None: at 0, 0,
        and not said
    """

    plane: Plane
    cell: float
    x: Range | None = None
    y: Range | None = None
    z: Range | None = None
    up: Up | None = None
    axis: tuple[float, float] | None = None


@dataclass(frozen=True)
class Request:
    """What is to be averaged.

    dumps : files of one simulation
    time_step : [s]
    columns : names of the columns of binary dumps that are not granpipe's own
    start, stop : times between which snapshots are averaged [s]
    radius : of all particles, where the dumps do not tell [m]
    """

    dumps: tuple[Path, ...]
    frame: Frame
    time_step: float
    columns: tuple[str, ...] | None = None
    start: float = -np.inf
    stop: float = np.inf
    radius: float | None = None


def window(request: Request) -> Iterator[tuple[float, Snapshot]]:
    """Times [s] and particles of the snapshots between start and stop, turned and moved to where the field is.

    Raises
    ------
    DataError : none lies between them; what cannot be read, or cannot be
    """
    first, last, found = np.inf, -np.inf, False
    slack = 1e-9 * abs(request.time_step)
    for snapshot in read_dumps(request.dumps, request.columns, request.stop / request.time_step + 1e-6):
        time = snapshot.step * request.time_step
        first, last = min(first, time), time
        if request.start - slack - 1e-9 * abs(time) <= time:
            found = True
            _check_time(snapshot, time)
            yield time, _moved(_with_radius(snapshot, request.radius), request.frame)
    if not found:
        if not np.isfinite(first):
            first = last = min(map(first_step, request.dumps)) * request.time_step
        raise DataError(
            f"the snapshots run from {first:g} to {last:g} s; none lies between --start {request.start:g} s and "
            f"--stop {request.stop:g} s"
        )


def _check_time(snapshot: Snapshot, time: float) -> None:
    if snapshot.time is not None and abs(snapshot.time - time) > _SAME_TIME * max(abs(time), abs(snapshot.time)):
        raise DataError(
            f"step {snapshot.step}: the dump says {snapshot.time:g} s, --time-step gives {time:g} s; give "
            f"--time-step {snapshot.time / max(snapshot.step, 1):.6g} if it was the same in the whole run"
        )


def _with_radius(snapshot: Snapshot, radius: float | None) -> Snapshot:
    if "radius" in snapshot.columns:
        if radius is not None:
            raise DataError(f"step {snapshot.step}: the dump holds radii; leave out --radius")
        return snapshot
    if radius is None:
        raise DataError(
            f"step {snapshot.step}: the dump has no column 'radius' or 'diameter' (it has "
            f"{', '.join(snapshot.columns)}); if all particles are of one size, give it: --radius"
        )
    return snapshot.having(radius=radius)


def _moved(snapshot: Snapshot, frame: Frame) -> Snapshot:
    """Checked as it was dumped, then turned and moved."""
    check_plausible(snapshot)
    if frame.up in (None, "z") and frame.axis in (None, (0.0, 0.0)):
        return snapshot
    turn = TURNS[frame.up or "z"]
    shift = turn @ axis_point(frame)
    place = snapshot.position @ turn.T - shift
    added = dict(zip("xyz", place.T, strict=True))
    if {"vx", "vy", "vz"} <= set(snapshot.columns):
        added |= dict(zip(("vx", "vy", "vz"), (snapshot.velocity @ turn.T).T, strict=True))
    box = np.sort(turn @ snapshot.box, axis=1) - shift[:, None]
    moved = snapshot.having(**added)
    return Snapshot(moved.step, box, moved.columns, moved.values, moved.time)


def axis_point(frame: Frame) -> Array:
    """(3,) a point of the axis, in the dump's directions [m]."""
    point = np.zeros(3)
    if frame.axis is not None:
        point[["xyz".index(name) for name in "xyz" if name != (frame.up or "z")[-1]]] = frame.axis
    return point
