"""`granpipe homogenize`: dumps that a user already has, averaged into a field without a DEM run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.case import Case
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import Snapshot, read_dumps
from granpipe.dem_field import conserved_field
from granpipe.errors import DataError
from granpipe.field import Field, Grid
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import raw_field, unguided_plug
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.store import publishing

_SEGMENTS = 20


@dataclass(frozen=True)
class Request:
    """What is to be averaged; times in s, the cell in m. `columns` name those of a binary dump."""

    dumps: tuple[Path, ...]
    cell: float
    time_step: float
    columns: tuple[str, ...] = DUMP_COLUMNS
    start: float = -np.inf
    stop: float = np.inf


def homogenize_files(request: Request, case: Case | None) -> Field:
    """Average dumps: on the outline of a case and made to conserve, or plainly on a grid round the particles.

    Parameters
    ----------
    case : tells outline, method and flow rate; without one the field is the raw average
    """
    first = next(iter(read_dumps(request.dumps, request.columns)), None)
    if first is None or len(first) == 0:
        raise DataError(f"{request.dumps[0]}: no particles")
    diameter = _sauter_diameter(first)
    if case is None:
        sums = merge(_segments(request, _grid_round(first, request.cell)))
        return raw_field(sums, np.ones(sums.grid.shape), unguided_plug(sums), diameter)
    outline = Outline.from_case(case)
    grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, request.cell)
    return conserved_field(case, outline, _segments(request, grid), diameter).field


def _segments(request: Request, grid: Grid) -> list[Sums]:
    """The dumps between start and stop in at most 2 × `_SEGMENTS` segments of equal numbers of snapshots."""
    collector, parts, length, count = Collector(grid), [], 1, 0
    first, last = np.inf, -np.inf
    for snapshot in read_dumps(request.dumps, request.columns):
        time = snapshot.step * request.time_step
        first, last = min(first, time), time
        if not request.start <= time <= request.stop:
            continue
        collector.add(time, snapshot)
        count += 1
        if count == length:
            parts.append(collector.take())
            count = 0
        if len(parts) == 2 * _SEGMENTS:
            parts = [merge(pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
            length *= 2
    if count:
        parts = [*parts[:-1], merge([*parts[-1:], collector.take()])]
    if not parts:
        raise DataError(
            f"the snapshots run from {first:g} to {last:g} s; none lies between --start {request.start:g} s and "
            f"--stop {request.stop:g} s"
        )
    return parts


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
