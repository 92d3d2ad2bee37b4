"""Error against time of the finite elements: order and mesh of the fictitious fluid, on the scene of a study."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from granpipe.analysis.compare import compare
from granpipe.case.schema import Case
from granpipe.field import Grid
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.geometry.outline import Outline
from granpipe.geometry.section import mesh_section
from granpipe.pipeline.fluid_field import wall_law
from granpipe.planning.flow import target_flow
from granpipe.study.axes import BASE
from granpipe.study.budget import ErrorBound, Option
from granpipe.study.findings import Findings

ACROSS = (5, 10, 20)
"""Elements from the axis to the wall."""

ORDERS = (2, 3, 4)

DEFAULT = 10
"""Elements across of a run: what a case can choose is the order."""

FINEST = 40
"""Elements across of the reference, at the highest order."""

_PACKING = 1.0  # a factor of every field, which the comparison does not see


@dataclass(frozen=True)
class Solve:
    """One solve: elements across, order, unknowns, wall time with the mesh [s], error against the finest."""

    across: int
    order: int
    unknowns: int
    seconds: float
    error: float


def fluid_refinement(case: Case, grid: Grid) -> tuple[Solve, ...]:
    """The fluid on coarser and finer meshes, each order, against the finest; none between front and back walls."""
    outline = Outline.from_case(case)
    if outline.measure.walled:
        return ()
    inside = outline.inside_fraction(grid)
    flow = target_flow(case, case.material.packing or 0.6)

    def solve(across: int, order: int):  # type: ignore[no-untyped-def]
        begun = time.monotonic()
        mesh = mesh_section(
            outline.wall,
            outline.obstacles,
            case.outline.levels,
            cells_across=across,
            outlet_radii=case.fluid.annulus or (),
            left=outline.left,
            measure=outline.measure,
        )
        solution = solve_fluid(mesh, wall_law(case), flow, order)
        field = to_field(solution, grid, inside, _PACKING)
        return field, solution.unknowns, time.monotonic() - begun

    finest, _, _ = solve(FINEST, ORDERS[-1])
    found = []
    for order in ORDERS:
        for across in ACROSS:
            field, unknowns, seconds = solve(across, order)
            found.append(Solve(across, order, unknowns, seconds, compare(finest, field, {}, grid.cell)[0].observed))
    return tuple(found)


def fluid_findings(solves: Sequence[Solve]) -> Findings:
    """What the finite elements alone tell of a scene that has no particles: one option for each order."""
    options = tuple(
        Option(
            point=BASE,
            method=f"fluid, order {solve.order}",
            travel=0.0,
            seconds=solve.seconds,
            cores=1,
            statistical={"whole": 0.0},
            blocks=math.inf,
            systematic={"whole": ErrorBound(solve.error, solve.error)},
            changes={"fluid.order": str(solve.order)},
        )
        for solve in solves
        if solve.across == DEFAULT
    )
    reference = f"the fluid, order {ORDERS[-1]}, {FINEST} elements across"
    return Findings(
        reference, {}, (), options, effects=(), axis_fits=(), scatter=None, spread={}, rate=None, uncertainty={}
    )
