"""The average of a DEM run in space: a conserving field with the shares of the outlets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Box
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.wall_mesh import WallOpening
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, measure_plug
from granpipe.homogenize.space_field import space_errors, space_field
from granpipe.homogenize.space_outlets import OutletFaces, flows, left_above
from granpipe.homogenize.statistics import LEAST_BLOCKS, blocks, standard_error
from granpipe.pipeline.averages import AveragedField, averaged_field, measured_packing, outlet_cells, plug_range
from granpipe.pipeline.gates import CONSERVING, OUTLET_SHARE, SPACE_BLOCKS, Gate
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
    assert isinstance(sums.grid, Box)
    inside, cells = vessel.inside_fraction(sums.grid), outlet_cells(plan)
    faces = cells.faces(inside > 0)
    left = left_above(faces, flows(sums))
    plug = _plug(plan, sums, case.material.packing, left)
    scale = target_flow(case, plug.packing) / plug.bulk_flow
    fitted = space_field(segments, inside, plug, diameter, scale, cells, BLOCKS)
    figures: dict[str, Any] = {"blocks": fitted.blocks, "effective_blocks": fitted.effective_blocks}
    figures |= {"conserving_changes": fitted.change, "outlets": _measured(vessel, segments, faces)}
    if fitted.field.flux_z_se is not None:
        figures["statistical_error"] = space_errors(fitted.field, {})
    return AveragedField(fitted.field, plug, figures, left)


def _plug(plan: Plan, sums: Sums, packing: float | None, left: Array) -> Plug:
    """The plug above the lowest outlet; its flow is that through all of them."""
    vessel = plan.space
    assert vessel is not None
    assert isinstance(sums.grid, Box)
    low, high = plug_range(plan.outline, sums.grid)
    lowest = max(low, min(float(one.opening.corners[:, 2].min()) for one in vessel.outlets))
    inside, diameter = vessel.inside_fraction(sums.grid), plan.dem.classes.sauter_diameter
    return measure_plug(sums, inside, (lowest, lowest + high - low), diameter, packing, left)


def measured_packing_of(plan: Plan, sums: Sums) -> float | None:
    """φ of the plug as simulated; None where the vessel is too narrow to tell."""
    diameter = plan.dem.classes.sauter_diameter
    if plan.space is None:
        return measured_packing(plan.case, plan.outline, sums, diameter)
    try:
        return _plug(plan, sums, None, left_above(_faces(plan), flows(sums))).packing
    except DataError:
        return None


def space_gates(figures: Mapping[str, Any]) -> list[Gate]:
    """What a field in space must hold to, from its figures."""
    apart = max(abs(one["measured_share"] - one["share"]) for one in figures["outlets"])
    gates = [CONSERVING.gate(figures["conserving_changes"]), OUTLET_SHARE.gate(apart)]
    if "statistical_error" in figures:
        gates.append(SPACE_BLOCKS.gate(figures["effective_blocks"]))
    return gates


def outlet_flows(outlets: Sequence[WallOpening], out: Array) -> list[dict[str, Any]]:
    """Share of the flow of each outlet, and its standard error from blocks.

    Parameters
    ----------
    out : (1 + blocks, outlets) solids that leave through each, of the whole average and of each block [m³/s]
    """
    found = []
    for outlet, share in zip(outlets, (out / out.sum(axis=1, keepdims=True)).T, strict=True):
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


def _measured(vessel: SpaceVessel, segments: Sequence[Sums], faces: Sequence[OutletFaces]) -> list[dict[str, Any]]:
    """Shares of the outlets as asked for and as simulated."""
    several = blocks(segments) if len(segments) >= LEAST_BLOCKS else []
    out = np.array([[one.out(flows(sums)) for one in faces] for sums in (merge(segments), *several)])
    measured = outlet_flows([one.opening for one in vessel.outlets], out)
    return [
        one | {"name": outlet.name, "share": outlet.share, "measured_share": one["share"]}
        for outlet, one in zip(vessel.outlets, measured, strict=True)
    ]


def _faces(plan: Plan) -> list[OutletFaces]:
    """Faces between the vessel and what lies beyond each outlet."""
    assert plan.space is not None
    assert isinstance(plan.grid, Box)
    return outlet_cells(plan).faces(plan.space.inside_fraction(plan.grid) > 0)
