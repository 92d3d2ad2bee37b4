"""`granpipe homogenize`: dumps that a user already has, averaged into a field without a DEM run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.case import Case
from granpipe.dem.dump import Snapshot, read_dumps
from granpipe.dem_field import conserved_field
from granpipe.errors import DataError
from granpipe.field import Field, Grid
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import raw_field, unguided_plug
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.store import publishing

_SEGMENTS = 20
_LONGEST_TRAVEL = 0.5  # Sauter diameters between snapshots, for nearly all particles: paths are taken as straight
_NEARLY_ALL = 0.99


@dataclass(frozen=True)
class Request:
    """What is to be averaged; times in s, the cell in m. `columns` name those of binary dumps not granpipe's own."""

    dumps: tuple[Path, ...]
    cell: float
    time_step: float
    columns: tuple[str, ...] | None = None
    start: float = -np.inf
    stop: float = np.inf


@dataclass(frozen=True)
class Homogenized:
    """A field, and in words how the flow was sampled and why."""

    field: Field
    sampling: str


def homogenize_files(request: Request, case: Case | None) -> Homogenized:
    """Average dumps: on the outline of a case and made to conserve, or plainly on a grid round the particles.

    The flow is sampled by the displacement of every particle between snapshots wherever they allow it.

    Parameters
    ----------
    case : tells outline, method and flow rate; without one the field is the raw average
    """
    first = next(iter(read_dumps(request.dumps, request.columns)), None)
    if first is None or len(first) == 0:
        raise DataError(f"{request.dumps[0]}: no particles")
    diameter = _sauter_diameter(first)
    outline = None if case is None else Outline.from_case(case)
    if outline is None:
        grid = _grid_round(first, request.cell)
    else:
        grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, request.cell)
    parts, sampling = _sampled(request, grid, diameter)
    if case is None or outline is None:
        sums = merge(parts)
        return Homogenized(raw_field(sums, np.ones(grid.shape), unguided_plug(sums), diameter), sampling)
    return Homogenized(conserved_field(case, outline, parts, diameter).field, sampling)


def _sampled(request: Request, grid: Grid, diameter: float) -> tuple[list[Sums], str]:
    """Segments sampled by displacement, or by velocity from the first pair of snapshots on that does not allow it."""
    try:
        return _segments(request, Collector(grid, "displacement"), diameter), "displacement between snapshots"
    except _NoPathsError as error:
        return _segments(request, Collector(grid, "velocity"), diameter), f"velocities in the snapshots: {error}"


class _NoPathsError(Exception):
    """Why particles cannot be followed from one snapshot to the next."""


def _segments(request: Request, collector: Collector, diameter: float) -> list[Sums]:
    """The dumps between start and stop in at most 2 × `_SEGMENTS` segments of equal numbers of samples."""
    parts, length, count = [], 1, 0
    by_path = collector.sampling == "displacement"
    last: Snapshot | None = None
    for time, snapshot in _chosen(request):
        if by_path:
            _check_paths(last, snapshot, diameter)
        collector.add(time, snapshot)
        count += 1 if last is not None or not by_path else 0
        last = snapshot
        if count == length:
            parts.append(collector.take())
            count = 0
        if len(parts) == 2 * _SEGMENTS:
            parts = [merge(pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
            length *= 2
    if count:
        parts = [*parts[:-1], merge([*parts[-1:], collector.take()])]
    if not parts:
        raise _NoPathsError("there is only one")
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


def _check_paths(old: Snapshot | None, new: Snapshot, diameter: float) -> None:
    """Refuse pairs of snapshots between which the way of a particle is not known."""
    if "id" not in new.columns:
        raise _NoPathsError("the particles have no ids")
    number = new.id
    if len(np.unique(number)) != len(number):
        raise _NoPathsError(f"ids occur twice at step {new.step}")
    if old is None:
        return
    _, at_old, at_new = np.intersect1d(old.id, number, return_indices=True)
    if not len(at_old):
        raise _NoPathsError(f"steps {old.step} and {new.step} have no particle in common")
    path = np.abs(new.position[at_new] - old.position[at_old])
    travel = float(np.quantile(np.linalg.norm(path, axis=1), _NEARLY_ALL))
    if travel > _LONGEST_TRAVEL * diameter:
        raise _NoPathsError(
            f"between steps {old.step} and {new.step} particles travel up to {travel / diameter:.2g} diameters "
            f"({_NEARLY_ALL:.0%} of them less); dump more often, {_LONGEST_TRAVEL:g} is the most"
        )
    if (path > 0.5 * np.diff(new.box, axis=1).T).any():
        raise _NoPathsError(f"particles leave on one side of the box and come back on the other at step {new.step}")


def write_field(field: Field, case: Case | None, folder: Path) -> None:
    """Write ``field.npz`` and ``field.vtu`` into a new folder, and the COMSOL files where a case tells the density."""
    from granpipe.export.vtk import write_vtu
    from granpipe.results import write_comsol_folder

    if folder.exists():
        raise DataError(f"{folder} exists already; give --out a new folder")
    with publishing(folder) as aside:
        field.save(aside / "field.npz")
        write_vtu(field, aside / "field.vtu")
        if case is not None:
            write_comsol_folder(field, case, aside)


def _grid_round(snapshot: Snapshot, cell: float) -> Grid:
    position, radius = snapshot.position, snapshot.radius
    reach = float((np.hypot(position[:, 0], position[:, 1]) + radius).max())
    z = position[:, 2]
    return Grid.covering(reach, float((z - radius).min()), float((z + radius).max()), cell)


def _sauter_diameter(snapshot: Snapshot) -> float:
    radius = snapshot.radius
    return float(2 * (radius**3).sum() / (radius**2).sum())
