"""The fictitious-fluid route: outline → mesh → Stokes solve → stream function → field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.field import Field, level_flow
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.gates import CLEAN_UP, CONSERVED, PEAK, RESIDUAL, Gate, breach_gates, cells_gate, upward_gate
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
from granpipe.planning.plane import depth_note
from granpipe.planning.wall_factors import wall_friction
from granpipe.rzmesh import RZMesh


def section_mesh(plan: Plan, bands: Sequence[tuple[float, float, float]] = ()) -> RZMesh:
    """Mesh of the r–z half section; `bands` are height ranges and the largest triangle there: (low, high, size) [m]."""
    sections = plan.case.outline.levels
    return mesh_section(
        plan.outline.wall,
        plan.outline.obstacles,
        sections,
        bands=bands,
        outlet_radii=plan.case.fluid.annulus or (),
        left=plan.outline.left,
        measure=plan.outline.measure,
    )


def wall_law(case: Case) -> WallLaw:
    """How the boundary moves, after the case."""
    fluid = case.fluid
    factors = {name: s.wall_factor for name, s in case.outline.sections.items() if s.wall_factor is not None}
    return WallLaw(
        walls=fluid.walls,
        friction=wall_friction(case).value,
        section_factors=factors,
        solids=fluid.solids,
        outlet_profile=fluid.outlet_profile,
        annulus=fluid.annulus,
    )


def fluid_field(plan: Plan) -> ModelResult:
    """Solve for the flow rate of the case; the field is exact in conservation at every level and cell."""
    case, outline = plan.case, plan.outline
    packing = case.material.packing
    assert packing is not None  # the plan of a fluid refuses a case without bulk density
    mesh = section_mesh(plan)
    flow = target_flow(case, packing)
    solution = solve_fluid(mesh, wall_law(case), flow, case.fluid.order)
    field = to_field(solution, plan.grid, outline.inside_fraction(plan.grid), packing)
    gates = (*fluid_gates(plan, field, solution), *breach_gates(plan.breaches))
    notes = (*filter(None, [depth_note(case)]), *wall_factor_notes(plan))
    return ModelResult(field=field, gates=gates, figures=solve_figures(solution), solution=solution, notes=notes)


def wall_factor_notes(plan: Plan) -> tuple[str, ...]:
    """What the hoppers of a fluid go by and how wrong they may be, for the user of the results."""
    return tuple(f"{one.name} = {one.value}: {one.criterion}" for one in plan.wall_factors)


def solve_figures(solution: FluidSolution) -> dict[str, Any]:
    """Figures of the solve."""
    return {
        "triangles": len(solution.mesh.triangles),
        "unknowns": solution.unknowns,
        "residual": solution.residual,
        "velocity_corrected_by_psi": solution.correction,
    }


def fluid_gates(
    plan: Plan, field: Field, solution: FluidSolution, followed: Sequence[tuple[float, float]] = ()
) -> list[Gate]:
    """The gates of a field that a fluid has made.

    Parameters
    ----------
    followed : lower and upper ends of what a hybrid follows [m], where the fluid has no say
    """
    return [PEAK.gate(_peak(plan, field, followed)), *flow_gates(plan, field, solution)]


def flow_gates(plan: Plan, field: Field, solution: FluidSolution) -> list[Gate]:
    """The gates of every fluid: upward flow, clean-up by ψ, the linear system, conservation, cells."""
    flow = field.bulk_flow * field.bulk_packing
    carried = level_flow(field.flux_z, field.grid) / flow
    return [
        upward_gate(field),
        CLEAN_UP.gate(solution.correction),
        RESIDUAL.gate(solution.residual),
        CONSERVED.gate(float(np.abs(carried - 1).max())),
        cells_gate(plan),
    ]


def _peak(plan: Plan, field: Field, followed: Sequence[tuple[float, float]]) -> float:
    """Fastest downward velocity over the mean of its level, of all levels that are the fluid's own."""
    outline, z = plan.outline, field.grid.z_edges
    own = np.ones(len(z), dtype=bool)
    for low, high in followed:
        own &= (z < low) | (z > high)
    if plan.case.fluid.outlet_profile != "developed":
        own &= z > outline.z_bottom + outline.outlet_width
    if not own.any():
        return 1.0
    area = np.minimum(outline.area(z, "below"), outline.area(z, "above"))
    mean = field.bulk_flow * field.bulk_packing / area
    return float((np.maximum(-field.flux_z, 0).max(axis=1) / mean)[own].max())
