"""`granpipe homogenize`: dumps that a user already has, averaged into a field without a DEM run.

On rings about an axis, in the plane x–z of a vessel that is alike all along y, or in space. The dumps are read twice:
first to see how far the particles reach and whether they can be followed, then to average them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.sizes import simulated_classes
from granpipe.errors import DataError
from granpipe.field import Box, Field, Grid, level_flow
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import raw_field, unguided_plug, with_standard_errors
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.psi_field import psi_field
from granpipe.homogenize.space_field import space_errors
from granpipe.pipeline.averages import AveragedField, averaged_field, smoothing_change, statistical_errors
from granpipe.pipeline.convergence import average_gates, widest_level_travel
from granpipe.pipeline.dem_field import run_statistics
from granpipe.pipeline.dump_average import Homogenized, inside_outline, most_segments, summed_dumps, told_of
from granpipe.pipeline.dump_checks import (
    check_outside,
    check_packing,
    frame_gates,
    held_solids,
    solids_gate,
    time_gate,
)
from granpipe.pipeline.dump_grid import grid_round, slab_grid
from granpipe.pipeline.dump_space import in_space, in_walls
from granpipe.pipeline.dump_survey import Survey, survey
from granpipe.pipeline.dump_window import Request
from granpipe.pipeline.extra_fields import FORCES, ExtraSums, with_derived
from granpipe.pipeline.gates import MORE_SNAPSHOTS, PACKING, SEGMENTS, SMOOTHING, Gate, asymmetry_gate, upward_gate
from granpipe.planning.flow import check_flow_rate
from granpipe.planning.plane import check_plane, depth_note
from granpipe.planning.set_back import check_dumps

_MOST_THROUGH_SIDES = 0.01  # of the flow


@dataclass(frozen=True)
class Walls:
    """Files of triangles that enclose the solids, and the length of their unit [m]."""

    paths: tuple[Path, ...]
    unit: float


def homogenize_files(request: Request, case: Case | None, walls: Walls | None = None) -> Homogenized:
    """Average dumps: on the outline of a case and made to conserve, or on a grid round the particles.

    The flow is sampled by the displacement of every particle between snapshots wherever they allow it. Without a case
    the field is the plain average, but for the plane x–z, where a stream function is fitted to a flow from above.

    Parameters
    ----------
    case : tells outline, method and flow rate of the vessel
    walls : those of a vessel in space, in place of a case

    Raises
    ------
    DataError : dumps that cannot be read, hold what cannot be, or do not fit the case or the frame
    CaseError : the case asks for what dumps cannot give
    """
    frame = request.frame
    if frame.plane == "rz" and (frame.x is not None or frame.y is not None):
        raise DataError("rings have no range of x or y: leave out --x and --y, or choose --plane xz or xyz")
    if walls is not None:
        if case is not None or frame.plane != "xyz":
            raise DataError("--walls are those of a vessel in space: give --plane xyz, and leave out --case")
        return in_walls(request, walls.paths, walls.unit)
    if case is None:
        return _on_grid(request)
    check_dumps(case)
    if case.vessel is not None:
        raise DataError(
            "the case has a vessel in space: give its file by --plane xyz --walls and --unit, and leave out --case"
        )
    if frame.plane == "xyz" and case.outline.symmetry == "axis":
        return in_space(request, case)
    return _in_vessel(request, case)


def _on_grid(request: Request) -> Homogenized:
    """Without a case."""
    found = survey(request, request.frame.z)
    frame_marks = frame_gates(found, request.frame)
    grid = grid_round(found, request.frame, most_segments(request))
    collector, segments = summed_dumps(request, grid, found)
    densest = check_packing(merge(segments), np.ones(grid.shape), found.diameter)
    field, method = _plain(segments, found.diameter)
    gates = [*frame_marks, *time_gate(found), *solids_gate(found, held_solids(field), request.frame)]
    gates += [SEGMENTS.gate(len(segments), remedy=MORE_SNAPSHOTS), PACKING.gate(field.bulk_packing)]
    figures: dict[str, Any] = {"largest_packing": densest}
    if field.flux_z_se is not None:
        errors = statistical_errors if field.flux_y is None else space_errors
        figures["statistical_error"] = errors(field, {})
    return told_of(field, method, gates, found, collector, figures)


def _in_vessel(request: Request, case: Case) -> Homogenized:
    """On the outline of a case."""
    frame, slab = request.frame, case.outline.symmetry == "plane"
    if frame.plane != ("xz" if slab else "rz"):
        what, plane = ("slab", "--plane xz") if slab else ("vessel of revolution", f"no --plane {frame.plane}")
        raise DataError(f"the case describes a {what}: give {plane}, or leave out --case")
    if frame.z is not None:
        raise DataError("the outline of the case gives the range of z: leave out --z or --case")
    if frame.x is not None:
        raise DataError("the outline of the case gives the range of x: leave out --x or --case")
    check_plane(case, by_dumps=True)
    outline = Outline.from_case(case)
    flow_notes = check_flow_rate(case, outline, find_openings(outline))
    found = survey(request, (outline.z_bottom, outline.z_top), inside_outline(outline))
    if slab:
        grid = slab_grid(found, frame, outline)
        outline = outline.of_depth(grid.measure.turn)
    else:
        grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, frame.cell)
    summed = _extra_sums(case, outline, grid, found)
    frame_marks = frame_gates(found, frame)
    outside = check_outside(found)
    collector, segments = summed_dumps(request, grid, found, summed)
    whole = merge(segments)
    densest = check_packing(whole, outline.inside_fraction(grid), found.diameter)
    averaged = averaged_field(case, outline, segments, found.diameter)
    field = summed.added(averaged.field, segments)
    field, derived = with_derived(field, case.homogenize.fields)
    figures = averaged.figures | summed.figures(segments) | derived | run_statistics(segments, case.outline.levels)
    gates = [*frame_marks, *time_gate(found), *_average_gates(case, averaged, segments, found.diameter, figures)]
    gates += [*solids_gate(found, held_solids(field), frame), PACKING.gate(field.bulk_packing)]
    figures |= {"largest_packing": densest, "solids_outside_the_walls": outside}
    figures["widest_level_travel_diameters"] = widest_level_travel(averaged, whole, found.diameter)
    told = told_of(field, case.homogenize.method, gates, found, collector, figures)
    if case.outline.depth is not None:
        told = replace(told, field=told.field.of_depth(case.outline.depth))
        depth = f"the dumps are {grid.measure.turn:.4g} m deep, the field the {case.outline.depth:g} m of the case"
        flow_notes = (*flow_notes, depth_note(case) if case.outline.walled else depth)
    return replace(told, notes=(*flow_notes, *told.notes))


def _extra_sums(case: Case, outline: Outline, grid: Grid, found: Survey) -> ExtraSums:
    """What the case asks for beside the field; DataError for what these dumps do not tell."""
    if without := [name for name in FORCES if name in case.homogenize.fields]:
        raise DataError(
            f"dumps of particles hold no forces of contacts: take {' and '.join(without)} out of homogenize.fields, or "
            "let granpipe run the case, which dumps them"
        )
    if "granular_temperature" in case.homogenize.fields and not found.has_velocities:
        raise DataError(
            "the dumps hold no velocities, which the granular temperature is of: dump vx vy vz as well, or take "
            "granular_temperature out of homogenize.fields"
        )
    if "mixing" in case.homogenize.fields and len(simulated_classes(case).radius) < 2:
        raise DataError("mixing tells how sizes lie among each other, and material.size of the case is one size alone")
    return ExtraSums(case, outline, simulated_classes(case), grid)


def _average_gates(
    case: Case, averaged: AveragedField, segments: list[Sums], diameter: float, figures: dict[str, Any]
) -> list[Gate]:
    """What a run of granpipe would have to pass."""
    gates = [*average_gates(case, averaged, merge(segments), diameter), upward_gate(averaged.field)]
    if "off_centre" in figures:
        gates.append(asymmetry_gate(figures["off_centre"]))
    changed = smoothing_change(averaged.field, segments, diameter)
    return gates if changed is None else [*gates, SMOOTHING.gate(changed)]


def _plain(segments: list[Sums], diameter: float) -> tuple[Field, str]:
    """The field without an outline, and what it is."""
    sums = merge(segments)
    plug, inside = unguided_plug(sums), np.ones(sums.grid.shape)
    plain = with_standard_errors(raw_field(sums, inside, plug, diameter), segments, diameter)
    if not (isinstance(sums.grid, Box) and sums.grid.flat):
        return plain, "plain average"
    try:
        _check_closed(sums)
        return psi_field(segments, inside, plug, diameter).field, "psi"
    except DataError as error:
        return plain, f"plain average: {error}"


def _check_closed(sums: Sums) -> None:
    """Refuse a stream function where solids pass through the left or right end."""
    if not (level_flow(sums.mean_flux[1], sums.grid) > 0).all():
        raise DataError("the flow is not downwards through every level")
    sides = float(np.abs(sums.flow_r[:, [0, -1]]).sum() / np.abs(sums.flow_z).sum(axis=1).max())
    if sides > _MOST_THROUGH_SIDES:
        raise DataError(f"{sides:.1%} of the flow passes through the ends of the range of x")
