"""The hybrid route: DEM of the sections that need it, and a fluid of the whole vessel that follows it there.

A viscous fluid is made to follow by a volume force: Sparta & Halvorsen (2017), their equations (3) and (4). A
frictional fluid is left alone, because the force would carry the weight on which friction depends: its stream function
and that of the particles are joined in the margins, where both describe the same flow. The sub-models' grids are rows
of the vessel's own grid, so that their stream functions are put together without interpolation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granpipe.errors import CaseError
from granpipe.field import Array, Field, Mask, cell_squares, flux_from_psi
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.forcing import KnownFlow
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_field import simulated_field
from granpipe.pipeline.fluid_field import (
    flow_gates,
    fluid_gates,
    section_mesh,
    solve_figures,
    wall_factor_notes,
    wall_law,
)
from granpipe.pipeline.frictional_field import assess, solve_plan
from granpipe.pipeline.gates import FOLLOWED, SEAM, Gate, breach_gates
from granpipe.pipeline.known_field import known_results
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
from granpipe.planning.submodel import Span

BAND_CELLS = 2
"""Largest triangle where the fluid follows a known flow, in cells of its grid: larger ones cannot follow its detail."""

Followed = list[tuple[Span, ModelResult]]
"""Spans of sections, and the field that the fluid follows in each."""


def hybrid_field(plan: Plan, context: Context) -> ModelResult:
    """Simulate every sub-model, or read an earlier field, then solve for the fluid that follows them.

    Raises
    ------
    CaseError
        what is to be followed has no stream function, or is an earlier field that does not fit
    """
    case = plan.case
    followed: Followed = []
    for span, submodel in plan.submodels:
        context.progress.note(f"sub-model of section {span.name}")
        followed.append((span, simulated_field(submodel, context)))
    if case.fluid.known_field is not None:
        followed += known_results(plan)
    context.progress.stage("fluid")
    packing = float(np.mean([made.field.bulk_packing for _, made in followed]))
    known = known_flow(plan, followed)
    fluid = (_forced if plan.friction is None else _joined)(plan, followed, known, packing)
    errors = _errors(fluid.field, followed)
    field = replace(fluid.field, flux_r_se=errors[0], flux_z_se=errors[1])
    differences = {span.name: _differences(field, fluid.free, made.field, span) for span, made in followed}
    return ModelResult(
        field=field,
        gates=(
            *breach_gates(plan.unfit),
            *(gate.of(span.name) for span, made in followed for gate in made.gates),
            *_following_gates(differences),
            *fluid.gates,
        ),
        figures=fluid.figures | {"difference_from_what_is_followed": differences},
        notes=fluid.notes + tuple(f"{span.name}: {note}" for span, made in followed for note in made.notes),
        productions=tuple(production for _, made in followed for production in made.productions),
        solution=fluid.solution,
        submodels={span.name: made for span, made in followed},
    )


@dataclass(frozen=True)
class _Fluid:
    """The whole vessel's field, that of a fluid which follows nothing, and what belongs to the fluid in the result."""

    field: Field
    free: Field
    gates: tuple[Gate, ...]
    figures: dict[str, Any]
    notes: tuple[str, ...]
    solution: FluidSolution | None


def _forced(plan: Plan, followed: Followed, known: KnownFlow, packing: float) -> _Fluid:
    """A viscous fluid that a volume force makes follow the known flow."""
    case = plan.case
    inside, flow = plan.outline.inside_fraction(plan.grid), target_flow(case, packing)
    bands = [(low - known.ramp, high + known.ramp, BAND_CELLS * plan.grid.cell) for low, high in known.intervals]
    solution = solve_fluid(section_mesh(plan, bands), wall_law(case), flow, case.fluid.order, known)
    field = to_field(solution, plan.grid, inside, packing)
    free = to_field(solve_fluid(section_mesh(plan), wall_law(case), flow, case.fluid.order), plan.grid, inside, packing)
    gates = fluid_gates(plan, field, solution, [(span.cut_bottom, span.cut_top) for span, _ in followed])
    field = replace(field, bulk=_bulk(field, followed))
    return _Fluid(field, free, tuple(gates), solve_figures(solution), wall_factor_notes(plan), solution)


def _joined(plan: Plan, followed: Followed, known: KnownFlow, packing: float) -> _Fluid:
    """A frictional fluid beyond the margins, the known flow in the sections, and their stream functions joined between.

    Both stream functions are the same on axis and walls, so whatever lies between them conserves and passes no wall. A
    margin that reaches the vessel's end has no fluid beyond it: there the known flow is taken as it is.
    """
    assert plan.friction is not None
    top, bottom, slack = plan.outline.z_top, plan.outline.z_bottom, plan.outline.tolerance
    ends = tuple(
        (bottom if span.cut_bottom <= bottom + slack else span.bottom, top if span.cut_top >= top - slack else span.top)
        for span, _ in followed
    )
    known = replace(known, intervals=ends)
    share, shared_cells = (known.strength(z)[:, None] for z in (plan.grid.z_edges, plan.grid.z_centres))
    solved = solve_plan(plan, plan.friction, packing)
    told = assess(plan, plan.friction, solved, ends)
    free, flow = solved.field, solved.field.bulk_flow
    assert free.psi is not None
    unit = known.psi / (-known.measure.turn * known.psi[:, -1:])
    psi = share * unit * packing * flow + (1 - share) * free.psi
    flux_r, flux_z = flux_from_psi(psi, plan.grid)
    field = replace(
        free,
        bulk=_bulk(free, followed),
        flux_r=flux_r,
        flux_z=flux_z,
        psi=psi,
        extra={"sensitivity": (1 - shared_cells) * told.sensitivity},
    )
    gates = (*flow_gates(plan, field, solved.solution), *told.gates)
    return _Fluid(field, free, gates, told.figures, told.notes, None)


def known_flow(plan: Plan, followed: Followed) -> KnownFlow:
    """ψ of what is followed on the vessel's grid, for a flow of 1 m³/s; between the spans that of the nearest row.

    Raises
    ------
    CaseError : what is followed has no stream function
    """
    grid = plan.grid
    psi = np.full((len(grid.z_edges), len(grid.r_edges)), np.nan)
    for _, made in followed:
        field = made.field
        if field.psi is None:
            raise CaseError(
                "must be psi for a hybrid: only a stream function can be followed", ("homogenize", "method")
            )
        rows, columns = (_nodes(cells) for cells in grid.where(field.grid))
        unit = field.psi / (field.bulk_packing * field.bulk_flow)
        beside = columns.start, len(grid.r_edges) - columns.stop  # where ψ is that of the wall
        psi[rows] = np.pad(unit, ((0, 0), beside), mode="edge")
    known = np.flatnonzero(np.isfinite(psi[:, 0]))
    nearest = known[np.abs(np.arange(len(psi))[:, None] - known).argmin(axis=1)]
    spans = [span for span, _ in followed]
    margins = [m for span in spans for m in (span.cut_top - span.top, span.bottom - span.cut_bottom) if m > 0]
    return KnownFlow(
        r_edges=grid.r_edges,
        z_edges=grid.z_edges,
        psi=psi[nearest],
        intervals=tuple((span.bottom, span.top) for span in spans),
        ramp=min(margins, default=grid.cell),
        force_factor=plan.case.fluid.force_factor,
        measure=grid.measure,
    )


def _nodes(cells: slice) -> slice:
    """The nodes, or the faces across, of a range of cells."""
    return slice(cells.start, cells.stop + 1)


def _bulk(field: Field, followed: Followed) -> Mask:
    """The fluid's own bulk; where particles were simulated, solids everywhere but in the voids that these found."""
    bulk = field.bulk.copy()
    for _, made in followed:
        cells = field.grid.where(made.field.grid)
        bulk[cells] = (field.inside_fraction[cells] > 0) & made.field.bulk
    return bulk


def _errors(field: Field, followed: Followed) -> tuple[Array | None, Array | None]:
    """Standard errors of the flux where the fluid follows a DEM that has them, nan where it is alone.

    A fluid has no noise, but that does not make it right: how far off it is there is not known.
    """
    error_r, error_z = np.full_like(field.flux_r, np.nan), np.full_like(field.flux_z, np.nan)
    for _, made in followed:
        part = made.field
        if part.flux_r_se is None or part.flux_z_se is None:
            return None, None
        rows, columns = field.grid.where(part.grid)
        scale = part.velocity_scale / field.velocity_scale
        error_r[rows], error_z[_nodes(rows)] = 0.0, 0.0  # beside the part nothing flows
        error_r[rows, _nodes(columns)] = part.flux_r_se * scale
        error_z[_nodes(rows), columns] = part.flux_z_se * scale
    return error_r, error_z


def _differences(field: Field, free: Field, part: Field, span: Span) -> dict[str, float]:
    """How far the fluid is from what it follows in the span's sections, and the free fluid in the margins, less noise.

    In the margins the fluid is pulled towards the particles, so that only a fluid without the force (`free`) tells
    whether both describe the same flow there.
    """
    seams = {"upper seam": (span.top, span.cut_top), "lower seam": (span.cut_bottom, span.bottom)}
    return {"sections": _difference(field, part, span.bottom, span.top, noise=False)} | {
        name: _difference(free, part, low, high, noise=True) for name, (low, high) in seams.items() if low < high
    }


def _following_gates(differences: Mapping[str, Mapping[str, float]]) -> list[Gate]:
    return [
        (FOLLOWED if where == "sections" else SEAM).gate(value, f", {where} of {name}")
        for name, found in differences.items()
        for where, value in found.items()
    ]


def _difference(field: Field, part: Field, low: float, high: float, noise: bool) -> float:
    """E = √(Σ A |δU|² / Σ A |U|²) over the bulk cells of both between two levels, A their ring areas × height.

    With `noise` less what the standard errors of the part explain; 0 where there is nothing to compare.
    """
    rows, columns = field.grid.where(part.grid)
    chosen = part.bulk & field.bulk[rows, columns]
    chosen &= ((part.grid.z_centres > low) & (part.grid.z_centres < high))[:, None]
    scale = field.velocity_scale / part.velocity_scale
    apart_r = field.flux_r[rows, _nodes(columns)] * scale - part.flux_r
    apart_z = field.flux_z[_nodes(rows), columns] * scale - part.flux_z
    weight = np.where(chosen, part.grid.ring_area, 0.0)
    error, flux = (
        float((weight * cell_squares(r, z)).sum()) for r, z in ((apart_r, apart_z), (part.flux_r, part.flux_z))
    )
    if noise and part.flux_r_se is not None and part.flux_z_se is not None:
        error -= float((weight * cell_squares(part.flux_r_se, part.flux_z_se)).sum())
    return float(np.sqrt(max(0.0, error) / flux)) if flux else 0.0
