"""The fictitious-fluid route: outline → mesh → Stokes solve → stream function → field."""

from __future__ import annotations

from collections.abc import Sequence

from granpipe.case.schema import Case
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.fluid.wall_speed import WallLaw
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
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
    )


def wall_law(case: Case) -> WallLaw:
    """How the boundary moves, after the case."""
    fluid = case.fluid
    factors = {name: s.wall_factor for name, s in case.outline.sections.items() if s.wall_factor is not None}
    return WallLaw(
        walls=fluid.walls,
        section_factors=factors,
        solids=fluid.solids,
        outlet_profile=fluid.outlet_profile,
        annulus=fluid.annulus,
    )


def fluid_field(plan: Plan) -> ModelResult:
    """Solve for the flow rate of the case; the field is exact in conservation at every level and cell."""
    case, outline = plan.case, plan.outline
    material = case.material
    packing = 1.0 if material.bulk_density is None else material.bulk_density / material.density
    mesh = section_mesh(plan)
    solution = solve_fluid(mesh, wall_law(case), target_flow(case, packing), case.fluid.order)
    field = to_field(solution, plan.grid, outline.inside_fraction(plan.grid), packing)
    figures = {
        "triangles": len(mesh.triangles),
        "unknowns": solution.unknowns,
        "residual": solution.residual,
        "velocity_corrected_by_psi": solution.correction,
    }
    return ModelResult(field=field, gates=(), figures=figures, solution=solution)
