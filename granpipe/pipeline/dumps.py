"""`granpipe homogenize`: dumps that a user already has, averaged into a field without a DEM run.

On rings about an axis, in the plane x–z of a vessel that is alike all along y, or in space.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.dump import read_dumps
from granpipe.dem.sizes import size_classes
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.field import Box, Field, Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import raw_field, unguided_plug, with_standard_errors
from granpipe.homogenize.average import Collector, Extra, Sums, merge
from granpipe.homogenize.psi_field import psi_field
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import averaged_field
from granpipe.pipeline.dump_grid import Frame, grid_round
from granpipe.pipeline.extra_fields import ExtraSums, with_derived
from granpipe.system.store import publishing

_SEGMENTS = 20
_MOST_THROUGH_SIDES = 0.01  # of the flow
_LONGEST_TRAVEL = 1.0  # Sauter diameters between snapshots, for most particles: paths are taken as straight
_MOST = 0.9
_PAIRS = 5  # of snapshots, before their travel is judged: motion may come in bursts


@dataclass(frozen=True)
class Request:
    """What is to be averaged; times in s. `columns` name those of binary dumps not granpipe's own."""

    dumps: tuple[Path, ...]
    frame: Frame
    time_step: float
    columns: tuple[str, ...] | None = None
    start: float = -np.inf
    stop: float = np.inf


@dataclass(frozen=True)
class Homogenized:
    """A field, and in words how the flow was sampled and what was made of the average, with reasons."""

    field: Field
    sampling: str
    method: str


def homogenize_files(request: Request, case: Case | None) -> Homogenized:
    """Average dumps: on the outline of a case and made to conserve, or on a grid round the particles.

    The flow is sampled by the displacement of every particle between snapshots wherever they allow it. Without a case
    the field is the plain average, but for the plane x–z, where a stream function is fitted to a flow from above.

    Parameters
    ----------
    case : tells outline, method and flow rate of a vessel of revolution
    """
    first = next(iter(read_dumps(request.dumps, request.columns)), None)
    if first is None or len(first) == 0:
        raise DataError(f"{request.dumps[0]}: no particles")
    diameter = _sauter_diameter(first)
    if case is None:
        grid = grid_round(first, request.frame, diameter, 2 * _most_segments(request))
        parts, sampling = _sampled(request, grid, diameter)
        field, method = _plain(parts, diameter)
        return Homogenized(field, sampling, method)
    if request.frame.plane != "rz":
        raise DataError(f"a case describes a vessel of revolution: leave out --plane {request.frame.plane} or --case")
    outline = Outline.from_case(case)
    grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, request.frame.cell)
    extra = _extra_sums(case, outline)
    parts, sampling = _sampled(request, grid, diameter, extra.extras)
    field = averaged_field(case, outline, parts, diameter).field
    field = replace(field, extra=extra.arrays(parts, field.inside_fraction))
    return Homogenized(with_derived(field, case.homogenize.fields)[0], sampling, case.homogenize.method)


def _extra_sums(case: Case, outline: Outline) -> ExtraSums:
    """What the case asks for beside the field; DataError for what dumps of particles do not tell."""
    if "wall_pressure" in case.homogenize.fields:
        raise DataError("dumps of particles hold no forces: take wall_pressure out of homogenize.fields")
    classes = size_classes(case.material.size).enlarged(case.dem.coarse_grain_factor)
    return ExtraSums(case.homogenize.fields, outline, classes)


def _plain(parts: list[Sums], diameter: float) -> tuple[Field, str]:
    """The field without an outline, and what it is."""
    sums = merge(parts)
    plug, inside = unguided_plug(sums), np.ones(sums.grid.shape)
    plain = with_standard_errors(raw_field(sums, inside, plug, diameter), parts)
    if not (isinstance(sums.grid, Box) and sums.grid.flat):
        return plain, "plain average"
    try:
        _check_closed(sums)
        return psi_field(parts, inside, plug, diameter).field, "psi"
    except DataError as error:
        return plain, f"plain average: {error}"


def _check_closed(sums: Sums) -> None:
    """Refuse a stream function where solids pass through the left or right end."""
    if not (level_flow(sums.mean_flux[1], sums.grid) > 0).all():
        raise DataError("the flow is not downwards through every level")
    sides = float(np.abs(sums.flow_r[:, [0, -1]]).sum() / np.abs(sums.flow_z).sum(axis=1).max())
    if sides > _MOST_THROUGH_SIDES:
        raise DataError(f"{sides:.1%} of the flow passes through the ends of the range of x")


def _most_segments(request: Request) -> int:
    """Half the number of segments that are held; each is a grid in space."""
    return LEAST_BLOCKS if request.frame.plane == "xyz" else _SEGMENTS


def _sampled(request: Request, grid: Grid, diameter: float, extras: Sequence[Extra] = ()) -> tuple[list[Sums], str]:
    """Segments sampled by displacement, or by velocity from the first pair of snapshots on that does not allow it."""
    try:
        collector = Collector(grid, "displacement", extras=extras)
        return _segments(request, collector, diameter), "displacement between snapshots"
    except _NoPathsError as error:
        collector = Collector(grid, "velocity", extras=extras)
        return _segments(request, collector, diameter), f"velocities in the snapshots: {error}"


class _NoPathsError(Exception):
    """Why particles cannot be followed from one snapshot to the next."""


def _segments(request: Request, collector: Collector, diameter: float) -> list[Sums]:
    """The dumps between start and stop in segments of equal numbers of samples, at most twice `_most_segments`."""
    parts, length, count = [], 1, 0
    by_path = collector.sampling == "displacement"
    through_depth = isinstance(collector.grid, Box) and not collector.grid.cut  # then y does not matter
    axes = [0, 2] if through_depth else [0, 1, 2]
    last: Snapshot | None = None
    travel: list[float] = []
    for time, snapshot in _chosen(request):
        if by_path:
            travel += _travel(last, snapshot, axes)
            if len(travel) >= _PAIRS:
                _check_travel(travel, diameter)
        collector.add(time, snapshot)
        count += 1 if last is not None or not by_path else 0
        last = snapshot
        if count == length:
            parts.append(collector.take())
            count = 0
        if len(parts) == 2 * _most_segments(request):
            parts = [merge(pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
            length *= 2
    if count:
        parts = [*parts[:-1], merge([*parts[-1:], collector.take()])]
    if not parts:
        raise _NoPathsError("there is only one")
    if travel:
        _check_travel(travel, diameter)
    return parts


def _chosen(request: Request) -> Iterator[tuple[float, Snapshot]]:
    """Time [s] and content of the snapshots between start and stop."""
    first, last, found = np.inf, -np.inf, False
    for snapshot in read_dumps(request.dumps, request.columns):
        time = snapshot.step * request.time_step
        first, last = min(first, time), time
        if request.start <= time <= request.stop:
            found = True
            yield time, snapshot
    if not found:
        raise DataError(
            f"the snapshots run from {first:g} to {last:g} s; none lies between --start {request.start:g} s and "
            f"--stop {request.stop:g} s"
        )


def _travel(old: Snapshot | None, new: Snapshot, axes: list[int]) -> list[float]:
    """How far most particles at most travel from the old snapshot to the new one [m]; nothing for the first one."""
    if "id" not in new.columns:
        raise _NoPathsError("the particles have no ids")
    number = new.id
    if len(np.unique(number)) != len(number):
        raise _NoPathsError(f"ids occur twice at step {new.step}")
    if old is None:
        return []
    _, at_old, at_new = np.intersect1d(old.id, number, return_indices=True)
    if not len(at_old):
        raise _NoPathsError(f"steps {old.step} and {new.step} have no particle in common")
    path = np.abs(new.position[at_new] - old.position[at_old])[:, axes]
    if (path > 0.5 * np.diff(new.box[axes], axis=1).T).any():
        raise _NoPathsError(f"particles leave on one side of the box and come back on the other at step {new.step}")
    return [float(np.quantile(np.linalg.norm(path, axis=1), _MOST))]


def _check_travel(travel: list[float], diameter: float) -> None:
    """Refuse paths that are too long, in the mean over pairs of snapshots, to be taken as straight."""
    mean = float(np.mean(travel)) / diameter
    if mean > _LONGEST_TRAVEL:
        raise _NoPathsError(
            f"{_MOST:.0%} of the particles travel up to {mean:.2g} diameters between two of them, of which "
            f"{_LONGEST_TRAVEL:g} is the most; dump more often"
        )


def write_field(field: Field, case: Case | None, folder: Path) -> None:
    """Write ``field.npz``, a file for ParaView and, but for rings without a case, text files for COMSOL."""
    if folder.exists():
        raise DataError(f"{folder} exists already; give --out a new folder")
    with publishing(folder) as aside:
        field.save(aside / "field.npz")
        if len(field.grid.shape) == 3:
            write_space(field, aside)
        else:
            write_plane(field, case, aside)


def write_plane(field: Field, case: Case | None, folder: Path) -> None:
    """Write the files of a field on rings or in the plane x–z."""
    from granpipe.export.comsol import write_interpolation
    from granpipe.export.nodes import nodal_values
    from granpipe.export.tables import write_tables
    from granpipe.export.vtk import write_vtu
    from granpipe.pipeline.results import write_comsol_folder

    write_vtu(field, folder / "field.vtu")
    write_tables(field, folder)
    if case is not None:
        write_comsol_folder(field, case, folder)
    elif not field.grid.axial:
        (folder / "comsol").mkdir()
        write_interpolation(
            nodal_values(field), folder / "comsol", name="homogenized", date=datetime.now().astimezone()
        )


def write_space(field: Field, folder: Path) -> None:
    """Write the files of a field in space."""
    from granpipe.export.space import write_text, write_vtr

    write_vtr(field, folder / "field.vtr")
    (folder / "comsol").mkdir()
    write_text(field, folder / "comsol", name="homogenized", date=datetime.now().astimezone())


def _sauter_diameter(snapshot: Snapshot) -> float:
    radius = snapshot.radius
    return float(2 * (radius**3).sum() / (radius**2).sum())
