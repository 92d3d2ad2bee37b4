"""From the sums of production segments to a conserving field: where averaging begins, the plug, the method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Array, Box, Field, Grid, cell_squares, level_flow, section_rows
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import gaussian_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, bed_packing, measure_plug, plug_levels
from granpipe.homogenize.drawn_walls import share_in_solid, within_drawn
from granpipe.homogenize.psi_field import MOST_STORAGE, psi_field
from granpipe.homogenize.smooth import flowing_faces, smooth
from granpipe.homogenize.space_outlets import OutletCells, within_vessel
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, onset, standard_error
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan

Levels = Mapping[str, tuple[float, float]]

PLUG_DIAMETERS = 0.25
"""Height of the plug in which packing and flow are measured, in outlet diameters above the outlet."""

DILATED_DIAMETERS = 1.0
"""Height above an open outlet, in its diameters, up to which the bed is dilated and its packing does not count."""


_STORAGE_ERROR = 0.4
"""Error of a field over the part of the flow that gathers while it is averaged, by which the start is chosen: 0.12 to
0.19 in runs of the test reactor of which 30 to 42 % gathered; more here, since there is no field from a fifth on."""

_NO_FIELD = 1.0
"""Squared error, over the square of the flow, of a start that gives no field."""

_SEEN = 2.0
"""Particle diameters in the boxes over which fluxes are summed to be compared: finer noise does not reach the field."""


@dataclass(frozen=True)
class AveragedField:
    """A field made to conserve, the plug that it was measured by, and figures of the method.

    `left` is what has left above each level (nz+1,), in the plain average, through outlets that lie higher [m³/s].
    """

    field: Field
    plug: Plug
    figures: dict[str, Any]
    left: Array | float = 0.0


def averaged_field(case: Case, outline: Outline, segments: Sequence[Sums], diameter: float) -> AveragedField:
    """The average of some segments, made to conserve by the case's method and scaled to the flow that it asks for."""
    sums = merge(segments)
    inside = outline.inside_fraction(sums.grid)
    plug = reference_plug(case, outline, sums, inside, diameter, case.material.packing)
    scale = outline.measure.share(case.outline.depth) * target_flow(case, plug.packing) / plug.bulk_flow
    if case.homogenize.method == "gaussian":
        field = gaussian_field(sums, inside, plug, diameter, case.homogenize.smoothing_passes, scale)
        return AveragedField(field, plug, {})
    fitted = psi_field(segments, inside, plug, diameter, scale)
    figures: dict[str, Any] = {
        "smoothing_length_m": fitted.smoothing_length,
        "blocks": fitted.blocks,
        "effective_blocks": fitted.effective_blocks,
        "storage_taken_off": fitted.storage,
    }
    if fitted.scatter is not None:
        figures["scatter_of_runs_over_error"] = fitted.scatter
    if fitted.field.flux_z_se is not None:
        figures["statistical_error"] = statistical_errors(fitted.field, case.outline.levels)
    return AveragedField(fitted.field, plug, figures)


def statistical_errors(field: Field, levels: Levels) -> dict[str, float]:
    """E = √(Σ A SE² / Σ A F²) over the bulk cells, whole and per section; A the area of each ring."""
    assert field.flux_r_se is not None
    assert field.flux_z_se is not None
    weight = np.where(field.bulk, field.grid.ring_area, 0.0)
    flux, error = (
        weight * cell_squares(r, z) for r, z in ((field.flux_r, field.flux_z), (field.flux_r_se, field.flux_z_se))
    )
    rows = section_rows(field.grid, levels)
    return {name: float(np.sqrt(error[at].sum() / max(flux[at].sum(), 1e-300))) for name, at in rows.items()}


def smoothing_change(field: Field, segments: Sequence[Sums], diameter: float) -> float | None:
    """Relative difference of a field from its raw average, beyond noise, in what is larger than a particle.

    √(max(0, E² − Σ A SE² / Σ A F²)) over the bulk cells, each level of the raw average scaled to the field's own flow.
    Both are seen through a Gaussian of half a particle diameter, which takes away the layers that particles form along
    walls. None where there are too few segments for a standard error.
    """
    if len(segments) < LEAST_BLOCKS or field.raw_flux_r is None or field.raw_flux_z is None:
        return None
    grid, faces = field.grid, flowing_faces(field.bulk, field.inside_fraction)
    passes = max(1, round((0.5 * diameter / grid.cell) ** 2))
    carried = level_flow(field.flux_z, grid)

    def seen(flux_r: Array, flux_z: Array) -> tuple[Array, Array]:
        scale = carried / level_flow(flux_z * faces[1], grid)
        return smooth(flux_r * (0.5 * (scale[1:] + scale[:-1]))[:, None], flux_z * scale[:, None], faces, passes)

    final, raw = seen(field.flux_r, field.flux_z), seen(field.raw_flux_r, field.raw_flux_z)
    several = zip(*(smooth(*block.mean_flux, faces, passes) for block in blocks(segments)), strict=True)
    error = [standard_error(np.array(fluxes)) for fluxes in several]
    weight = np.where(field.bulk, grid.ring_area, 0.0)
    change, noise, flux = (
        float((weight * cell_squares(r, z)).sum()) for r, z in ((final[0] - raw[0], final[1] - raw[1]), error, final)
    )
    return float(np.sqrt(max(0.0, change - noise) / flux))


def steady_segments(segments: Sequence[Sums], plan: Plan) -> list[Sums]:
    """The segments of each run after the transient, in the vessel as drawn, without what lies beyond its outlets.

    Raises
    ------
    DataError : no segment begins after the start that the case gives
    """
    if plan.space is not None and not plan.space.at_bottom:
        assert isinstance(plan.grid, Box)
        segments = within_vessel(segments, plan.space.inside_fraction(plan.grid), outlet_cells(plan))
    steady = after_transient(segments, plan)
    if plan.set_back is None:
        return steady
    return within_drawn(steady, plan.grid, plan.outline.inside_fraction(plan.grid))


def outlet_cells(plan: Plan) -> OutletCells:
    """The cells beyond the outlets of a vessel in space, with their shares."""
    assert plan.space is not None
    assert isinstance(plan.grid, Box)
    return OutletCells(plan.space.beyond(plan.grid), tuple(one.share for one in plan.space.outlets))


def in_solid(segments: Sequence[Sums], plan: Plan) -> float:
    """Largest part of a level's flow that passes it in the drawn solid, after the transient."""
    return share_in_solid(after_transient(segments, plan), plan.outline.inside_fraction(plan.grid))


def after_transient(segments: Sequence[Sums], plan: Plan) -> list[Sums]:
    """The segments of each run from the start that the case gives, or from one that suits its data.

    Raises
    ------
    DataError : no segment begins after a faster start, or after the start that the case gives
    """
    earliest = plan.dem.average_from
    segments = [sums for sums in segments if sums.start >= earliest * (1 - 1e-9)]
    if not segments:
        raise DataError(f"no segment begins after the faster start, which ends at {earliest:.3g} s")
    runs = [[sums for sums in segments if sums.run == run] for run in sorted({sums.run for sums in segments})]
    return [sums for run in runs for sums in _from_start(run, plan)]


def _from_start(segments: list[Sums], plan: Plan) -> list[Sums]:
    given = plan.case.homogenize.start
    start = _steady_start(segments, plan) if given == "auto" else plan.dem.average_from + float(given)
    kept = [sums for sums in segments if sums.start >= start - 1e-9 * segments[-1].stop]
    if not kept:
        raise DataError(f"no segment begins after homogenize.start = {start:g} s; the last at {segments[-1].start:g} s")
    return kept


def _steady_start(segments: list[Sums], plan: Plan) -> float:
    """Where averaging begins [s]: from where on the error of the field is expected to be least.

    Flow above an obstacle comes in bursts. An average that holds more rests than bursts, or more bursts than rests, has
    solids gather or leave, which adds to its error. A start from which the ψ fit gives no field for that is taken only
    where no start in the first half gives one.
    """
    width = max(1, round(_SEEN * plan.dem.classes.sauter_diameter / segments[0].grid.cell))
    products, size = _compared(segments, width)
    gathered = _gathered(segments, plan)
    more = (_STORAGE_ERROR * gathered) ** 2
    if plan.space is None and plan.case.homogenize.method == "psi":
        more += np.where(gathered < MOST_STORAGE, 0.0, _NO_FIELD)
    return segments[onset(products, size * more)].start


def _compared(segments: list[Sums], width: int) -> tuple[Array, float]:
    """(n, n) products with each other of what the segments' fluxes differ from their mean by, and the mean's square.

    Area by area, as they count in the error of a field.

    Parameters
    ----------
    width : of the boxes over which fluxes are summed, in cells
    """
    grid, size, products = segments[0].grid, 0.0, np.zeros((len(segments), len(segments)))
    faces: dict[str, Array | float] = {"flow_r": grid.side_area, "flow_z": grid.ring_area}
    if isinstance(grid, Box) and not grid.flat:
        faces["flow_y"] = grid.front_area
    for name, area in faces.items():  # of a grid in space only the boxes are held
        flows = [_box_sums(getattr(sums, name), width) / sums.weight for sums in segments]
        areas = _box_sums(np.broadcast_to(area, getattr(segments[0], name).shape), width)
        scaled = np.array([(flow / np.sqrt(np.where(areas > 0, areas, 1.0))).ravel() for flow in flows])
        mean = scaled.mean(axis=0)
        scaled -= mean
        size += float(mean @ mean)
        products += scaled @ scaled.T
    return products, size


def _box_sums(values: Array, width: int) -> Array:
    """Sums over boxes of so many cells in every direction; those at the ends may be smaller."""
    for axis in range(values.ndim):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], width), axis=axis)
    return values


def _gathered(segments: list[Sums], plan: Plan) -> Array:
    """(n,) largest part of the flow that gathers between the plug and any level, from each segment to the end.

    In space, where there is no plug, between the bottom and any level. 1 where nothing flows down but something moves.
    """
    grid = segments[0].grid
    levels = np.arange(len(grid.z_edges)) == 0
    if plan.space is None:
        levels = plug_levels(grid, plug_range(plan.outline, grid))
    duration = np.array([sums.duration for sums in segments])
    gained = np.array([np.cumsum(np.concatenate([[0.0], sums.row_gain])) for sums in segments])
    gained -= gained[:, levels].mean(axis=1, keepdims=True)
    passed = duration * np.array([sums.level_flow[:, levels].mean() for sums in segments])
    gained, passed = gained[::-1].cumsum(axis=0)[::-1], passed[::-1].cumsum()[::-1]
    most = np.abs(gained).max(axis=1)
    moves = (most > 0) | (passed != 0)
    return np.asarray(np.divide(most, passed, out=moves.astype(float), where=passed > 0))


def reference_plug(
    case: Case, outline: Outline, sums: Sums, inside_fraction: Array, diameter: float, packing: float | None
) -> Plug:
    """The plug with a packing fraction that is given, or measured: in the plug, or in the bed above an open outlet."""
    if packing is None and case.dem.outlet == "open":
        packing = bed_packing(sums, inside_fraction, reference_range(case, outline, sums.grid)[0], diameter)
    return measure_plug(sums, inside_fraction, plug_range(outline, sums.grid), diameter, packing)


def measured_packing(case: Case, outline: Outline, sums: Sums, diameter: float) -> float | None:
    """φ of the plug, or of the bed above an open outlet, as simulated; None where the vessel is too narrow to tell."""
    try:
        return reference_plug(case, outline, sums, outline.inside_fraction(sums.grid), diameter, None).packing
    except DataError:
        return None


def reference_range(case: Case, outline: Outline, grid: Grid) -> tuple[float, float]:
    """Levels between which the reference packing is measured [m]: the plug, or the bed above an open outlet."""
    if case.dem.outlet != "open":
        return plug_range(outline, grid)
    bottom = outline.z_bottom + DILATED_DIAMETERS * outline.outlet_width
    return (bottom if bottom < outline.z_top else outline.z_bottom), outline.z_top


def plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    """Levels between which the plug is measured [m]; the plate itself is farther below."""
    height = max(PLUG_DIAMETERS * outline.outlet_width, 2 * grid.cell)
    return outline.z_bottom, outline.z_bottom + height
