"""`granpipe homogenize`: dumps that a user already has, averaged into a field without a DEM run.

On rings about an axis, in the plane x–z of a vessel that is alike all along y, or in space. The dumps are read twice:
first to see how far the particles reach and whether they can be followed, then to average them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.dem.sizes import size_classes
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.field import Box, Field, Grid, Mask, level_flow
from granpipe.geometry.in_space import inside_space
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import enclosed
from granpipe.homogenize.assemble import raw_field, unguided_plug, with_standard_errors
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.homogenize.conserve import gathered_flow
from granpipe.homogenize.psi_field import psi_field
from granpipe.homogenize.space_field import space_errors, space_field
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import AveragedField, averaged_field, reference_plug, smoothing_change
from granpipe.pipeline.convergence import average_gates
from granpipe.pipeline.dem_field import run_statistics
from granpipe.pipeline.dump_checks import (
    check_outside,
    check_packing,
    frame_gates,
    held_solids,
    solids_gate,
    time_gate,
)
from granpipe.pipeline.dump_grid import grid_round, slab_grid, vessel_box
from granpipe.pipeline.dump_survey import JUMP, Survey, survey
from granpipe.pipeline.dump_window import Request, window
from granpipe.pipeline.extra_fields import FORCES, ExtraSums, with_derived
from granpipe.pipeline.gates import PACKING, SMOOTHING, Gate, asymmetry_gate, level_flow_gates, run_notes, upward_gate
from granpipe.planning.flow import check_flow_rate, target_flow
from granpipe.planning.plane import check_plane

_SEGMENTS = 40
_MOST_THROUGH_SIDES = 0.01  # of the flow
_CHANGE = 0.05  # of the solids, during the average


@dataclass(frozen=True)
class Homogenized:
    """A field, and how it was made.

    sampling : how the flow was sampled, with the reason
    method : what was made of the average, with the reason
    gates : measured figures with limits
    notes : what the user should keep in mind
    figures : more figures
    """

    field: Field
    sampling: str
    method: str
    gates: tuple[Gate, ...]
    notes: tuple[str, ...]
    figures: dict[str, Any]

    @property
    def failed(self) -> list[Gate]:
        """Gates that mark the field."""
        return [gate for gate in self.gates if not gate.passed]


def homogenize_files(request: Request, case: Case | None) -> Homogenized:
    """Average dumps: on the outline of a case and made to conserve, or on a grid round the particles.

    The flow is sampled by the displacement of every particle between snapshots wherever they allow it. Without a case
    the field is the plain average, but for the plane x–z, where a stream function is fitted to a flow from above.

    Parameters
    ----------
    case : tells outline, method and flow rate of the vessel

    Raises
    ------
    DataError : dumps that cannot be read, hold what cannot be, or do not fit the case or the frame
    """
    frame = request.frame
    if frame.plane == "rz" and (frame.x is not None or frame.y is not None):
        raise DataError("rings have no range of x or y: leave out --x and --y, or choose --plane xz or xyz")
    if case is None:
        return _on_grid(request)
    if frame.plane == "xyz" and case.outline.symmetry == "axis":
        return _in_space(request, case)
    return _in_vessel(request, case)


def _on_grid(request: Request) -> Homogenized:
    """Without a case."""
    found = survey(request, request.frame.z)
    frame_marks = frame_gates(found, request.frame)
    grid = grid_round(found, request.frame, _most_segments(request))
    collector, segments = _averaged(request, grid, found)
    densest = check_packing(merge(segments), np.ones(grid.shape), found.diameter)
    field, method = _plain(segments, found.diameter)
    gates = [*frame_marks, *time_gate(found), *solids_gate(found, held_solids(field), request.frame)]
    return _told(
        field, method, [*gates, PACKING.gate(field.bulk_packing)], found, collector, {"largest_packing": densest}
    )


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
    found = survey(request, (outline.z_bottom, outline.z_top), _inside(outline))
    if slab:
        grid = slab_grid(found, frame, outline)
        outline = outline.of_depth(grid.measure.turn)
    else:
        grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, frame.cell)
    summed = _extra_sums(case, outline, grid, found)
    frame_marks = frame_gates(found, frame)
    outside = check_outside(found)
    collector, segments = _averaged(request, grid, found, summed)
    densest = check_packing(merge(segments), outline.inside_fraction(grid), found.diameter)
    averaged = averaged_field(case, outline, segments, found.diameter)
    field = summed.added(averaged.field, segments)
    field, derived = with_derived(field, case.homogenize.fields)
    figures = averaged.figures | summed.figures(segments) | derived | run_statistics(segments, case.outline.levels)
    gates = [*frame_marks, *time_gate(found), *_average_gates(case, averaged, segments, found.diameter, figures)]
    gates += [*solids_gate(found, held_solids(field), frame), PACKING.gate(field.bulk_packing)]
    figures |= {"largest_packing": densest, "solids_outside_the_walls": outside}
    told = _told(field, case.homogenize.method, gates, found, collector, figures)
    if case.outline.depth is not None:
        told = replace(told, field=told.field.of_depth(case.outline.depth))
        depth = f"the dumps are {grid.measure.turn:.4g} m deep, the field the {case.outline.depth:g} m of the case"
        flow_notes = (*flow_notes, depth)
    return replace(told, notes=(*flow_notes, *told.notes))


def _in_space(request: Request, case: Case) -> Homogenized:
    """On a grid in space round the vessel of a case: what is not the same all round is kept."""
    frame, outline = request.frame, Outline.from_case(case)
    if given := [f"--{axis}" for axis in "xyz" if getattr(frame, axis) is not None]:
        raise DataError(f"the outline of the case gives the ranges: leave out {' and '.join(given)}, or --case")
    if case.homogenize.fields:
        raise DataError("homogenize.fields are told on rings only: take them out, or leave out --plane xyz")
    flow_notes = check_flow_rate(case, outline, find_openings(outline))
    found = survey(request, (outline.z_bottom, outline.z_top), _inside(outline))
    grid = vessel_box(outline, frame, _most_segments(request))
    frame_marks, outside = frame_gates(found, frame), check_outside(found)
    collector, segments = _averaged(request, grid, found)
    sums, inside = merge(segments), inside_space(outline, grid)
    densest = check_packing(sums, inside, found.diameter)
    plug = reference_plug(case, outline, sums, inside, found.diameter, case.material.packing)
    scale = target_flow(case, plug.packing) / plug.bulk_flow
    fitted = space_field(segments, inside, plug, found.diameter, scale)
    field, gathered = fitted.field, gathered_flow(sums, plug.z_range)
    figures: dict[str, Any] = {"largest_packing": densest, "solids_outside_the_walls": outside}
    figures |= {"blocks": fitted.blocks, "conserving_changes": fitted.change}
    if field.flux_z_se is not None:
        figures["statistical_error"] = space_errors(field, case.outline.levels)
    gates = [
        *frame_marks,
        *time_gate(found),
        *level_flow_gates(level_flow(sums.mean_flux[1], grid), gathered, plug.solids_flow, sums.duration),
        upward_gate(field),
        *solids_gate(found, held_solids(field), frame),
        PACKING.gate(field.bulk_packing),
    ]
    told = _told(field, "the nearest conserving flow", gates, found, collector, figures)
    return replace(told, notes=(*flow_notes, *told.notes))


def _inside(outline: Outline) -> Callable[[Snapshot], Mask]:
    """Tells which particles are centred between axis (or left wall), wall and obstacles."""
    axial = outline.measure.axial
    walls = [outline.wall] if axial else [outline.wall, outline.left]
    pairs = [(wall[:-1], wall[1:]) for wall in walls]
    pairs += [(polygon, np.roll(polygon, -1, axis=0)) for polygon in outline.obstacles.values()]
    edges = np.concatenate([np.stack(pair, axis=1) for pair in pairs])

    def inside(snapshot: Snapshot) -> Mask:
        x, y, z = snapshot.position.T
        return enclosed(np.column_stack([outline.measure.across(x, y), z]), edges)

    return inside


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
    if "mixing" in case.homogenize.fields and len(size_classes(case.material.size).radius) < 2:
        raise DataError("mixing tells how sizes lie among each other, and material.size of the case is one size alone")
    classes = size_classes(case.material.size).enlarged(case.dem.coarse_grain_factor)
    return ExtraSums(case, outline, classes, grid)


def _average_gates(
    case: Case, averaged: AveragedField, segments: list[Sums], diameter: float, figures: dict[str, Any]
) -> list[Gate]:
    """What a run of granpipe would have to pass."""
    gates = [*average_gates(case, averaged, merge(segments)), upward_gate(averaged.field)]
    if "off_centre" in figures:
        gates.append(asymmetry_gate(figures["off_centre"]))
    changed = smoothing_change(averaged.field, segments, diameter)
    return gates if changed is None else [*gates, SMOOTHING.gate(changed)]


def _plain(segments: list[Sums], diameter: float) -> tuple[Field, str]:
    """The field without an outline, and what it is."""
    sums = merge(segments)
    plug, inside = unguided_plug(sums), np.ones(sums.grid.shape)
    plain = with_standard_errors(raw_field(sums, inside, plug, diameter), segments)
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


def _most_segments(request: Request) -> int:
    """How many segments are held at once; each is a grid in space."""
    return 2 * LEAST_BLOCKS if request.frame.plane == "xyz" else _SEGMENTS


def _averaged(
    request: Request, grid: Grid, found: Survey, summed: ExtraSums | None = None
) -> tuple[Collector, list[Sums]]:
    """The dumps in segments of equal numbers of samples."""
    by_path = not found.unfollowed
    jump = JUMP * found.diameter if by_path else None
    extras = summed.extras if summed else ()
    collector = Collector(grid, "displacement" if by_path else "velocity", jump=jump, extras=extras)
    samples = len(found.times) - by_path
    length = -(-samples // _most_segments(request))
    segments: list[Sums] = []
    count = -1 if by_path else 0
    for time, snapshot in window(request):
        if not len(snapshot):
            continue
        at_rest = {} if found.has_velocities else dict.fromkeys(("vx", "vy", "vz"), 0.0)
        collector.add(time, snapshot.having(**at_rest) if at_rest else snapshot)
        count += 1
        if summed is not None and count > 0:  # the first of a pair belongs to no segment
            collector.observe(summed.seen(snapshot))
        if count == length:
            segments.append(collector.take())
            count = 0
    if count:
        segments = [*segments[:-1], merge([*segments[-1:], collector.take()])]
    return collector, segments


def _told(
    field: Field, method: str, gates: list[Gate], found: Survey, collector: Collector, figures: dict[str, Any]
) -> Homogenized:
    """The result with its figures and notes."""
    first, last = found.solids_within[0], found.solids_within[-1]
    total, within, held = found.mean(found.solids), found.mean(found.solids_within), held_solids(field)
    notes = run_notes(figures)
    if found.empty:
        notes.append(f"{len(found.empty)} snapshots without particles are left out (first at step {found.empty[0]})")
    if abs(last - first) > _CHANGE * max(first, last):
        notes.append(f"the solids change from {first:.3g} to {last:.3g} m³ during the average (--start, --stop)")
    if total - held > 1e-6 * total:
        notes.append(f"{1 - held / total:.2%} of the solids lie outside the field")
    if collector.jumps:
        notes.append(f"{collector.jumps} jumps farther than particles move are taken as leaving and entering")
    figures = figures | {
        "snapshots": len(found.times),
        "averaged_from_s": found.times[0],
        "averaged_to_s": found.times[-1],
        "particles": found.particles,
        "sauter_diameter_m": found.diameter,
        "solids_m3": total,
        "solids_between_the_levels_m3": within,
        "solids_in_the_field_m3": held,
        "bulk_packing": field.bulk_packing,
        "jumps": collector.jumps,
        "empty_snapshots": len(found.empty),
    }
    reason = found.unfollowed
    sampling = f"velocities in the snapshots: {reason}" if reason else "displacement between snapshots"
    return Homogenized(field, sampling, method, tuple(gates), tuple(notes), figures)
