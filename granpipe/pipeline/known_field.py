"""The field of an earlier run that a hybrid follows: read, checked against the vessel, and cut to what is followed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from granpipe.case.material import LEAST_PACKING, MOST_PACKING
from granpipe.errors import CaseError
from granpipe.field import Field, flux_from_psi
from granpipe.pipeline.field_vessel import kind_of, other_vessel
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.model_result import ModelResult
from granpipe.pipeline.provenance import known_gates
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
from granpipe.planning.submodel import Span
from granpipe.system.manifest import MANIFEST, read_manifest, verify

KEY = ("fluid", "known_field")

FLOW_TOLERANCE = 1e-3
"""Largest deviation of ψ on the wall from the flow that the field says it has, relative."""


def known_results(plan: Plan) -> list[tuple[Span, ModelResult]]:
    """What the hybrid follows in each span, with the gates that the earlier run has failed.

    Raises
    ------
    CaseError
        the field is not one of this vessel, does not cover the spans, has no stream function, or no downward flow
    DataError
        the file cannot be read, or it or its gates have changed since granpipe wrote them
    """
    path = Path(plan.case.fluid.known_field or "")
    if path.name == "field.npz" and (path.parent / MANIFEST).exists():
        verify(path.parent, path.name, *({"provenance.json"} & read_manifest(path.parent).keys()))
    field = Field.load(path)
    _check_flow(field, plan, path)
    if plan.case.outline.depth is not None:
        field = field.of_depth(plan.case.outline.depth)
    gates, notes = _quality(path)
    return [(span, ModelResult(_cut_out(field, span, plan, path), gates, notes=notes)) for span in plan.followed]


def _check_flow(field: Field, plan: Plan, path: Path) -> None:
    if (found := kind_of(field.grid)) != (needed := kind_of(plan.grid)):
        raise CaseError(f"{path} is a field in {found}; this vessel needs one in {needed}", KEY)
    if field.psi is None:
        raise CaseError(f"{path} has no stream function; make it with homogenize.method: psi", KEY)
    if not field.bulk_flow > 0:
        raise CaseError(
            f"{path} has a flow of {field.bulk_flow:g} m³/s; a hybrid follows a downward flow, above 0", KEY
        )
    if not LEAST_PACKING <= field.bulk_packing <= MOST_PACKING:
        raise CaseError(
            f"{path} has a reference packing of {field.bulk_packing:.3g}; that of a bed that flows by its weight is "
            f"between {LEAST_PACKING:g} and {MOST_PACKING:g}",
            KEY,
        )
    turn = field.grid.measure.turn
    carried = -turn * (field.psi[:, -1] - field.psi[:, 0]) / (field.bulk_flow * field.bulk_packing)
    worst = int(np.abs(carried - 1).argmax())
    if abs(carried[worst] - 1) > FLOW_TOLERANCE:
        raise CaseError(
            f"{path} contradicts itself: at z = {field.grid.z_edges[worst]:g} m its stream function carries "
            f"{carried[worst]:.3g} of the flow that it says it has; make it anew",
            KEY,
        )


def _quality(path: Path) -> tuple[tuple[Gate, ...], tuple[str, ...]]:
    """Gates that the run of the field has failed, as its results folder tells; a note where there is none."""
    gates = known_gates(path.parent)
    if gates is None:
        return (), (f"{path} has no provenance.json beside it: whether its run passed its gates is not known",)
    return tuple(gate.of(str(path)) for gate in gates if not gate.passed), ()


def _cut_out(field: Field, span: Span, plan: Plan, path: Path) -> Field:
    """The part of the field that a span covers, on the vessel's rows; ψ by a bicubic spline in z and ∫ r dr (or x)."""
    from scipy.interpolate import RectBivariateSpline

    old, slack = field.grid, 0.5 * plan.grid.cell
    if old.z_edges[0] > span.cut_bottom + slack or old.z_edges[-1] < span.cut_top - slack:
        raise CaseError(
            f"{path} covers z = {old.z_edges[0]:g} … {old.z_edges[-1]:g} m; section {span.name} with its margins needs "
            f"{span.cut_bottom:g} … {span.cut_top:g} m",
            KEY,
        )
    if found := other_vessel(field, plan.outline, span.cut_bottom, span.cut_top):
        raise CaseError(f"{path} is the field of another vessel: {found}; give a field of this outline", KEY)
    levels = plan.grid.z_edges
    grid = replace(plan.grid, z_edges=levels[(levels > span.cut_bottom - slack) & (levels < span.cut_top + slack)])
    reach = grid.measure.reach
    spline = RectBivariateSpline(old.z_edges, reach(old.r_edges), field.psi)
    psi = spline(grid.z_edges, reach(np.clip(grid.r_edges, *old.r_edges[[0, -1]])))
    psi[:, 0] = 0.0
    flux_r, flux_z = flux_from_psi(psi, grid)
    row = np.clip(np.searchsorted(old.z_edges, grid.z_centres) - 1, 0, old.shape[0] - 1)
    column = np.clip(np.searchsorted(old.r_edges, grid.r_centres) - 1, 0, old.shape[1] - 1)
    return Field(
        grid=grid,
        inside_fraction=plan.outline.inside_fraction(grid),
        bulk=field.bulk[np.ix_(row, column)],
        flux_r=flux_r,
        flux_z=flux_z,
        bulk_flow=field.bulk_flow,
        bulk_packing=field.bulk_packing,
        flow_scale=target_flow(plan.case, field.bulk_packing) / field.bulk_flow,
        psi=psi,
    )
