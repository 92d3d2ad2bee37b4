"""The route of the frictional fluid: outline → free surfaces → mesh → fixed point → ψ → field, and its sensitivity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granpipe.analysis.compare import compare
from granpipe.dem.sizes import size_classes
from granpipe.errors import GranpipeError
from granpipe.field import Array, Field, Mask, cell_squares
from granpipe.fluid.fictitious import FluidSolution, to_field
from granpipe.fluid.friction_law import LENGTH, FrictionLaw
from granpipe.fluid.frictional import FrictionSolution
from granpipe.fluid.frictional_vessel import SURFACE, Outlet, solve_frictional
from granpipe.fluid.wall_packing import packed_along_walls
from granpipe.geometry.free_surfaces import voids
from granpipe.geometry.openings import find_openings
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.fluid_field import flow_gates, solve_figures
from granpipe.pipeline.gates import FEWEST_DIAMETERS, MESH, REGULARIZATION, TENSION, Gate, breach_gates
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.bulk_friction import BulkFriction
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
from granpipe.rzmesh import RZMesh

RESERVOIR, PIPE = 1.0, 2.0
"""The vessel goes on straight above its inlet and below its outlet by this many radii (in a slab half widths), as that
of a DEM run does."""

CELLS_ACROSS, COARSE_CELLS, CORNER_REFINEMENT = 14.0, 10.0, 3.0
"""The mesh of the field has 14 cells across; the coarser one tells how much the field depends on it."""

WALL_CHANGE, ANGLE_CHANGE = 0.2, np.radians(5)
"""For the sensitivity: part of the wall friction, and of the angle of surfaces, by which they change both ways."""


@dataclass(frozen=True)
class Solved:
    """A frictional fluid and its field on the grid of the plan."""

    field: Field
    solution: FluidSolution
    friction: FrictionSolution


@dataclass(frozen=True)
class Assessment:
    """How much the field of a frictional fluid depends on what it goes by.

    Parameters
    ----------
    sensitivity : (nz, nr) change of the bulk velocity with friction and surfaces [m/s], the larger of either way; no
        noise
    """

    sensitivity: Array
    gates: tuple[Gate, ...]
    figures: dict[str, Any]
    notes: tuple[str, ...]


def frictional_field(plan: Plan, friction: BulkFriction) -> ModelResult:
    """Solve for the flow rate of the case, and again with other friction, surfaces, regularization and mesh."""
    packing = plan.case.material.packing
    assert packing is not None  # the plan of a fluid refuses a case without bulk density
    solved = solve_plan(plan, friction, packing)
    told = assess(plan, friction, solved)
    field = replace(solved.field, extra={"sensitivity": told.sensitivity})
    gates = (*flow_gates(plan, field, solved.solution), *told.gates, *breach_gates(plan.breaches))
    vessel = _within(solved.solution, plan)
    return ModelResult(field=field, gates=gates, figures=told.figures, solution=vessel, notes=told.notes)


def assess(
    plan: Plan, friction: BulkFriction, solved: Solved, followed: Sequence[tuple[float, float]] = ()
) -> Assessment:
    """Solve again with other friction, surfaces, regularization and mesh.

    Parameters
    ----------
    followed : lower and upper ends of what a hybrid follows [m], where changes of the fluid do not count
    """

    def own(z: Array) -> Mask:
        return np.asarray(np.all([np.ones(len(z), bool), *((z < low) | (z > high) for low, high in followed)], axis=0))

    field = replace(solved.field, bulk=solved.field.bulk & own(plan.grid.z_centres)[:, None])
    packing, diameter = field.bulk_packing, size_classes(plan.case.material.size).sauter_diameter
    others: dict[str, list[Field]] = {}
    notes = [f"{one.name} = {one.value}: {one.criterion}" for one in friction.decisions()]
    for name, changed in _changed(plan, friction):
        try:
            others.setdefault(name, []).append(solve_plan(plan, changed, packing).field)
        except GranpipeError as error:
            notes.append(f"{name}, one way, was not tried: {error}")
    sensitivity = {name: max(_difference(field, one, diameter) for one in found) for name, found in others.items()}
    twice = solve_plan(plan, friction, packing, 2 * FrictionLaw.regularization).field
    dependence = _difference(field, twice, diameter)
    by_mesh = _difference(field, solve_plan(plan, friction, packing, cells_across=COARSE_CELLS).field, diameter)
    openings = find_openings(plan.outline)
    gaps = np.array([opening.gap for opening in openings])[own(np.array([opening.z for opening in openings]))]
    gates = (
        TENSION.gate(solved.friction.tension),
        REGULARIZATION.gate(dependence),
        MESH.gate(by_mesh),
        *([FEWEST_DIAMETERS.gate(gaps.min() / diameter)] if gaps.size else []),
    )
    figures = solve_figures(solved.solution) | {
        "steps": solved.friction.steps,
        "change_in_last_step": solved.friction.change,
        "sensitivity": sensitivity,
        "regularization": dependence,
        "mesh": by_mesh,
    }
    notes += [f"{name} changes the field by {value:.1%}" for name, value in sensitivity.items()]
    return Assessment(_changes(field, others.values()), gates, figures, tuple(notes))


def _changed(plan: Plan, friction: BulkFriction) -> Iterator[tuple[str, BulkFriction]]:
    """What is tried for the sensitivity, and its name; no wall rubs more than the bulk."""
    for factor in (1 - WALL_CHANGE, 1 + WALL_CHANGE):
        if (wall := min(friction.wall * factor, friction.internal)) != friction.wall:
            yield "wall friction ± 20 %", replace(friction, wall=wall)
    if voids(plan.outline, friction.repose):
        for change in (-ANGLE_CHANGE, ANGLE_CHANGE):
            yield "angle of surfaces ± 5°", replace(friction, repose=friction.repose + change)


def _within(solution: FluidSolution, plan: Plan) -> FluidSolution:
    """The solution on the mesh of the vessel alone, without the pipes above and below."""
    mesh, kept = solution.mesh.between(plan.outline.z_bottom, plan.outline.z_top)
    return replace(solution, mesh=mesh, u=solution.u[kept], w=solution.w[kept], psi=solution.psi[kept])


def solve_plan(
    plan: Plan,
    friction: BulkFriction,
    packing: float,
    regularization: float = FrictionLaw.regularization,
    cells_across: float = CELLS_ACROSS,
) -> Solved:
    """The fluid of a plan with some friction and φ_ref; what is void is not bulk."""
    case = plan.case
    classes = size_classes(case.material.size)
    law = FrictionLaw(friction.internal, friction.wall, LENGTH * classes.sauter_diameter, regularization)
    empty = voids(plan.outline, friction.repose)
    mesh = friction_mesh(plan, empty, cells_across)
    solution, found = solve_frictional(mesh, law, target_flow(case, packing), _outlet(plan))
    inside = plan.outline.inside_fraction(plan.grid)
    field = to_field(solution, plan.grid, inside, packing)
    field = packed_along_walls(field, from_solids(plan), 2 * classes.radius, classes.mass_share)
    return Solved(replace(field, bulk=field.bulk & ~_in_any(empty, plan)), solution, found)


def friction_mesh(plan: Plan, empty: list[Array], cells_across: float = CELLS_ACROSS) -> RZMesh:
    """Mesh of the vessel without its voids, with a straight pipe above, and below where a plate moves down in one."""
    outline = plan.outline
    inlet, outlet = (float(outline.measure.radius(area)) for area in (outline.inlet_area, outline.outlet_area))

    def longer(side: Array) -> Array:
        (r_in, z_in), (r_out, z_out) = side[0], side[-1]
        below = [[r_out, z_out - PIPE * outlet]] if _outlet(plan) == Outlet() else []
        return np.array([[r_in, z_in + RESERVOIR * inlet], *side, *below])

    surfaces = {f"{SURFACE} {i}": polygon for i, polygon in enumerate(empty, start=1)}
    return mesh_section(
        longer(outline.wall),
        dict(outline.obstacles) | surfaces,
        plan.case.outline.levels,
        cells_across=cells_across,
        corner_refinement=CORNER_REFINEMENT,
        outlet_radii=plan.case.fluid.annulus or (),
        left=longer(outline.left),
        measure=outline.measure,
    )


def _difference(one: Field, other: Field, diameter: float) -> float:
    whole, *_ = compare(one, other, {}, diameter)
    return whole.observed


def _outlet(plan: Plan) -> Outlet:
    fluid = plan.case.fluid
    if fluid.annulus is not None:
        return Outlet("plate", fluid.annulus)
    return Outlet("open" if plan.case.dem.outlet == "open" and fluid.outlet_profile == "developed" else "plate")


def from_solids(plan: Plan) -> Array:
    """(nz+1, nr) distance from the middle of each horizontal face of the grid to the nearest wall or obstacle [m]."""
    import shapely

    outline, grid = plan.outline, plan.grid
    solids = [*map(shapely.LineString, outline.walls), *(shapely.Polygon(p) for p in outline.obstacles.values())]
    r, z = np.meshgrid(grid.r_centres, grid.z_edges)
    return np.asarray(shapely.distance(shapely.points(r, z), shapely.union_all(solids)))


def _in_any(polygons: list[Array], plan: Plan) -> Mask:
    """(nz, nr) cells whose middle lies in a void."""
    import shapely

    r, z = np.meshgrid(plan.grid.r_centres, plan.grid.z_centres)
    return np.asarray(shapely.contains_xy(shapely.union_all([shapely.Polygon(p) for p in polygons]), r, z))


def _changes(field: Field, others: Iterable[list[Field]]) -> Array:
    """(nz, nr) change of the bulk velocity [m/s]: over what was changed, root of the sum of squares of the largest."""
    largest = [
        np.max([cell_squares(one.flux_r - field.flux_r, one.flux_z - field.flux_z) for one in found], axis=0)
        for found in others
    ]
    return np.asarray(np.sqrt(np.sum([np.zeros(field.grid.shape), *largest], axis=0)) / field.bulk_packing)
