"""Dumps averaged in space inside walls: those of a round case, or triangles that a user gives; made to conserve."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import CaseError, DataError
from granpipe.field import Array, Box, Mask, level_flow
from granpipe.geometry.in_space import inside_space
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.wall_mesh import LEVEL, WallMesh, WallOpening, nearest_opening
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, bed_packing, gathered_flow
from granpipe.homogenize.space_field import space_errors, space_field
from granpipe.homogenize.space_outlets import OutletCells
from granpipe.pipeline.averages import reference_plug
from granpipe.pipeline.dump_average import Homogenized, inside_outline, most_segments, summed_dumps, told_of
from granpipe.pipeline.dump_checks import (
    check_outside,
    check_packing,
    frame_gates,
    held_solids,
    solids_gate,
    time_gate,
)
from granpipe.pipeline.dump_grid import vessel_box
from granpipe.pipeline.dump_survey import survey
from granpipe.pipeline.dump_window import Frame, Request
from granpipe.pipeline.gates import (
    CONSERVING,
    MORE_SNAPSHOTS,
    PACKING,
    SEGMENTS,
    SPACE_BLOCKS,
    Gate,
    level_flow_gates,
    upward_gate,
)
from granpipe.pipeline.space_average import outlet_flows, outlet_notes
from granpipe.planning.flow import check_flow_rate, target_flow


@dataclass(frozen=True)
class _Vessel:
    """What the average needs to know of a vessel in space.

    Parameters
    ----------
    grid : round it
    inside : (nz, ny, nx) part of each cell inside
    within : tells which particles are centred inside
    plug : packing and flow, from the average and the particle diameter [m]
    scale : flow rate of the process over that of the dumps, from the plug
    levels : section → upper and lower level [m]
    named : what gives its walls, in words
    outlets : openings at the bottom, whose part of the flow is told
    """

    grid: Box
    inside: Array
    within: Callable[[Snapshot], Mask]
    plug: Callable[[Sums, float], Plug]
    scale: Callable[[Plug], float]
    levels: Mapping[str, tuple[float, float]]
    named: str
    outlets: tuple[WallOpening, ...] = ()


def in_space(request: Request, case: Case) -> Homogenized:
    """On a grid in space round the vessel of a case: what is not the same all round is kept.

    Raises
    ------
    DataError : dumps that do not fit the case, or a frame that contradicts it
    """
    outline = Outline.from_case(case)
    _check_frame(request.frame, "--case")
    if case.homogenize.fields:
        raise DataError("homogenize.fields are told on rings only: take them out, or leave out --plane xyz")
    across = (-outline.r_max, outline.r_max)
    grid = vessel_box((across, across, (outline.z_bottom, outline.z_top)), request.frame, most_segments(request))
    inside = inside_space(outline, grid)

    def plug(sums: Sums, diameter: float) -> Plug:
        return reference_plug(case, outline, sums, inside, diameter, case.material.packing)

    def scale(plug: Plug) -> float:
        return target_flow(case, plug.packing) / plug.bulk_flow

    vessel = _Vessel(grid, inside, inside_outline(outline), plug, scale, case.outline.levels, "the case")
    flow_notes = check_flow_rate(case, outline, find_openings(outline))
    told = _averaged(request, vessel)
    return replace(told, notes=(*flow_notes, *told.notes))


def in_walls(request: Request, paths: Sequence[Path], unit: float) -> Homogenized:
    """In walls that files of triangles give (STL, OBJ), open at the top and the bottom; at the scale of the dumps.

    Parameters
    ----------
    unit : length of the files' unit [m]

    Raises
    ------
    DataError : files or dumps that do not fit
    """
    _check_frame(request.frame, "--walls")
    if request.frame.up is not None or request.frame.axis is not None:
        raise DataError("the walls stand where the particles do, z up: leave out --up and --axis, or --walls")
    walls = read_walls(paths, unit)
    x, y, z = ((float(low), float(high)) for low, high in walls.ends)
    try:
        grid = vessel_box((x, y, z), request.frame, most_segments(request))
    except DataError as error:
        raise DataError(f"{error}; the walls are {z[1] - z[0]:.3g} m high: is --unit right?") from None
    inside = walls.inside_fraction(grid)
    low, size = (
        np.array([x[0], y[0], z[0]]),
        [edges[1] - edges[0] for edges in (grid.r_edges, grid.y_edges, grid.z_edges)],
    )

    def within(snapshot: Snapshot) -> Mask:
        cell = np.floor((snapshot.position - low) / size).astype(np.int64)
        on_grid = ((cell >= 0) & (cell < grid.shape[::-1])).all(axis=1)
        column, row, level = np.where(on_grid[:, None], cell, 0).T
        return np.asarray(on_grid & (inside[level, row, column] > 0))

    def plug(sums: Sums, diameter: float) -> Plug:
        flows = level_flow(sums.mean_flux[1], grid)
        flow = float(flows.mean())
        if not flow > 0:
            raise DataError(f"nothing flows down through the vessel: {flow:.3g} m³/s of solids on average")
        return Plug(bed_packing(sums, inside, z[0], diameter), flow, float(np.abs(flows / flow - 1).max()), z)

    vessel = _Vessel(grid, inside, within, plug, lambda _: 1.0, {}, ", ".join(map(str, paths)), walls.outlets)
    return _averaged(request, vessel)


def read_walls(paths: Sequence[Path], unit: float) -> WallMesh:
    """The walls in files of triangles, of obstacles too.

    Raises
    ------
    DataError : a file cannot be read, or the walls are not closed
    """
    from granpipe.drawings.surface import read_triangles

    points, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for path in paths:
        if not path.is_file():
            raise DataError(f"{path}: file not found; give an STL or OBJ file of the walls")
        try:
            own, corners = read_triangles(path)
        except CaseError as error:
            raise DataError(f"{path}: {error}") from None
        points.append(own * unit)
        triangles.append(corners + count)
        count += len(own)
    try:
        walls = WallMesh.of(np.concatenate(points), np.concatenate(triangles))
    except DataError as error:
        raise DataError(f"{', '.join(map(str, paths))}: {error}") from None
    low, high = walls.ends[2].tolist()
    for one in walls.outlets:
        if one.z - low > LEVEL * (high - low):
            x, y = one.centre
            raise DataError(
                f"{', '.join(map(str, paths))}: the opening at ({x:.4g}, {y:.4g}, {one.z:.4g}) m lies between bottom, "
                f"z = {low:.4g} m, and top, {high:.4g} m: of dumps only openings at the ends are known; close it"
            )
    return walls


def _averaged(request: Request, vessel: _Vessel) -> Homogenized:
    frame, grid, inside = request.frame, vessel.grid, vessel.inside
    found = survey(request, (float(grid.z_edges[0]), float(grid.z_edges[-1])), vessel.within)
    frame_marks, outside = frame_gates(found, frame), check_outside(found, vessel.named)
    collector, segments = summed_dumps(request, grid, found)
    sums = merge(segments)
    densest = check_packing(sums, inside, found.diameter)
    plug = vessel.plug(sums, found.diameter)
    cells = _outlet_cells(vessel.outlets, grid) if vessel.outlets else None
    fitted = space_field(segments, inside, plug, found.diameter, vessel.scale(plug), cells)
    field, gathered = fitted.field, gathered_flow(sums, plug.z_range)
    figures: dict[str, Any] = {"largest_packing": densest, "solids_outside_the_walls": outside}
    figures |= {"blocks": fitted.blocks, "effective_blocks": fitted.effective_blocks}
    figures["conserving_changes"] = fitted.change
    known: list[Gate] = []
    if field.flux_z_se is not None:
        figures["statistical_error"] = space_errors(field, vessel.levels)
        known.append(SPACE_BLOCKS.gate(fitted.effective_blocks))
    notes: list[str] = []
    if vessel.outlets:
        figures["outlets"] = outlets = outlet_flows(vessel.outlets, fitted.out)
        notes += outlet_notes(outlets)
    gates = [
        *frame_marks,
        *time_gate(found),
        *level_flow_gates(level_flow(sums.mean_flux[1], grid), gathered, plug.solids_flow, sums.duration),
        upward_gate(field),
        *solids_gate(found, held_solids(field), frame),
        PACKING.gate(field.bulk_packing),
        CONSERVING.gate(fitted.change),
        SEGMENTS.gate(len(segments), remedy=MORE_SNAPSHOTS),
        *known,
    ]
    told = told_of(field, "the nearest conserving flow", gates, found, collector, figures)
    return replace(told, notes=(*notes, *told.notes))


def _outlet_cells(outlets: Sequence[WallOpening], grid: Box) -> OutletCells:
    """Below the lowest cells the nearest outlet, as seen from above."""
    number = np.full([n + 2 for n in grid.shape], -1)
    middles = (0.5 * (edges[1:] + edges[:-1]) for edges in (grid.r_edges, grid.y_edges))
    number[0, 1:-1, 1:-1] = nearest_opening(outlets, *np.meshgrid(*middles))
    return OutletCells(number, (None,) * len(outlets))


def _check_frame(frame: Frame, option: str) -> None:
    """DataError for ranges that the vessel gives itself."""
    if given := [f"--{axis}" for axis in "xyz" if getattr(frame, axis) is not None]:
        raise DataError(f"the vessel gives the ranges: leave out {' and '.join(given)}, or {option}")
