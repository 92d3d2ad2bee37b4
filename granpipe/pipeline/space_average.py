"""The average of a DEM run in space: a conserving field with the shares of the outlets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granpipe.errors import DataError
from granpipe.field import Array, Box
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.wall_mesh import WallOpening, nearest_opening
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.space_field import space_errors, space_field
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, standard_error
from granpipe.pipeline.averages import AveragedField, averaged_field, measured_packing, reference_plug
from granpipe.pipeline.gates import CONSERVING, OUTLET_SHARE, Gate
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan

BLOCKS = 24
"""That the standard errors of a run rest on, where it has so many segments."""


def averaged_of(plan: Plan, segments: Sequence[Sums]) -> AveragedField:
    """The average of some segments of a plan's run, made to conserve and scaled to the flow that the case asks for.

    Raises
    ------
    DataError : it gives no field
    """
    diameter = plan.dem.classes.sauter_diameter
    if plan.space is None:
        return averaged_field(plan.case, plan.outline, segments, diameter)
    vessel, sums, case = plan.space, merge(segments), plan.case
    grid = sums.grid
    assert isinstance(grid, Box)
    inside = vessel.inside_fraction(grid)
    plug = reference_plug(case, plan.outline, sums, inside, diameter, case.material.packing)
    scale = target_flow(case, plug.packing) / plug.bulk_flow
    columns = _columns([one.opening for one in vessel.outlets], grid)
    leaving = [(columns == k, one.share) for k, one in enumerate(vessel.outlets)]
    fitted = space_field(segments, inside, plug, diameter, scale, leaving, BLOCKS)
    figures: dict[str, Any] = {"blocks": fitted.blocks, "effective_blocks": float(fitted.blocks)}
    figures |= {"conserving_changes": fitted.change, "outlets": _measured(vessel, segments, grid)}
    if fitted.field.flux_z_se is not None:
        figures["statistical_error"] = space_errors(fitted.field, {})
    return AveragedField(fitted.field, plug, figures)


def measured_packing_of(plan: Plan, sums: Sums) -> float | None:
    """φ of the plug as simulated; None where the vessel is too narrow to tell."""
    diameter = plan.dem.classes.sauter_diameter
    if plan.space is None:
        return measured_packing(plan.case, plan.outline, sums, diameter)
    assert isinstance(sums.grid, Box)
    try:
        inside = plan.space.inside_fraction(sums.grid)
        return reference_plug(plan.case, plan.outline, sums, inside, diameter, None).packing
    except DataError:
        return None


def space_gates(figures: Mapping[str, Any]) -> list[Gate]:
    """What a field in space must hold to, from its figures."""
    apart = max(abs(one["measured_share"] - one["share"]) for one in figures["outlets"])
    return [CONSERVING.gate(figures["conserving_changes"]), OUTLET_SHARE.gate(apart)]


def outlet_flows(outlets: Sequence[WallOpening], grid: Box, out: Array) -> list[dict[str, Any]]:
    """Share of the flow of each outlet, and its standard error from blocks.

    Parameters
    ----------
    out : (1 + blocks, ny, nx) solids that leave through the lowest faces, of the whole average and of each block [m³/s]
    """
    nearest = _columns(outlets, grid)
    whole = out.sum(axis=(1, 2))
    found = []
    for k, outlet in enumerate(outlets):
        share = np.where(nearest == k, out, 0.0).sum(axis=(1, 2)) / whole
        error = float(standard_error(share[1:])) if len(share) > 2 else float("nan")
        (x_m, y_m), z_m = outlet.centre, outlet.z
        found.append({"x_m": x_m, "y_m": y_m, "z_m": z_m, "area_m2": outlet.area, "share": share[0], "share_se": error})
    return found


def outlet_notes(outlets: Sequence[Mapping[str, Any]]) -> list[str]:
    """The shares of several outlets in words."""
    if len(outlets) < 2:
        return []
    return [
        f"outlet at x = {one['x_m']:.4g} m, y = {one['y_m']:.4g} m: {one['share']:.1%} ± {one['share_se']:.1%} "
        "of the flow"
        for one in outlets
    ]


def _measured(vessel: SpaceVessel, segments: Sequence[Sums], grid: Box) -> list[dict[str, Any]]:
    """Shares of the outlets as asked for and as simulated."""
    several = blocks(segments) if len(segments) >= LEAST_BLOCKS else []
    out = np.array([-sums.mean_flux[1][0] * grid.ring_area[0] for sums in (merge(segments), *several)])
    measured = outlet_flows([one.opening for one in vessel.outlets], grid, out)
    return [
        one | {"name": outlet.name, "share": outlet.share, "measured_share": one["share"]}
        for outlet, one in zip(vessel.outlets, measured, strict=True)
    ]


def _columns(outlets: Sequence[WallOpening], grid: Box) -> NDArray[np.int64]:
    """(ny, nx) number of the outlet below each column of cells."""
    middles = (0.5 * (edges[1:] + edges[:-1]) for edges in (grid.r_edges, grid.y_edges))
    return nearest_opening(outlets, *np.meshgrid(*middles))
