"""The hybrid route: DEM of the sections that need it, and a fluid of the whole vessel that follows it there.

Sparta & Halvorsen (2017), their equations (3) and (4). The sub-models' grids are rows of the vessel's own grid, so that
their stream functions are put together without interpolation.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from granpipe.errors import CaseError
from granpipe.field import Array, Field, Grid, Mask, cell_squares, flux_from_psi
from granpipe.fluid.fictitious import FluidSolution, solve_fluid, to_field
from granpipe.fluid.forcing import KnownFlow
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import StatisticalErrorCriterion
from granpipe.pipeline.dem_field import dem_field
from granpipe.pipeline.dem_stages import simulate
from granpipe.pipeline.fluid_field import section_mesh, wall_law
from granpipe.pipeline.model_result import ModelResult
from granpipe.planning.flow import target_flow
from granpipe.planning.plan import Plan
from granpipe.planning.submodel import Span

BAND_CELLS = 2
"""Largest triangle where the fluid follows a known flow, in cells of its grid: larger ones cannot follow its detail."""

Parts = list[tuple[Span, ModelResult]]


def hybrid_field(plan: Plan, context: Context) -> ModelResult:
    """Simulate every sub-model, or read an earlier field, then solve for the fluid that follows them."""
    case = plan.case
    parts: Parts = []
    for span, submodel in plan.submodels:
        context.progress.note(f"sub-model of section {span.name}")
        parts.append((span, dem_field(submodel, simulate(submodel, context, StatisticalErrorCriterion(submodel)))))
    if case.fluid.known_field is not None:
        earlier = Field.load(Path(case.fluid.known_field))
        parts += [(span, ModelResult(_cut_out(earlier, span, plan), ())) for span in plan.followed]
    context.progress.stage("fluid")
    packing = float(np.mean([made.field.bulk_packing for _, made in parts]))
    known = known_flow(plan, parts)
    bands = [(low - known.ramp, high + known.ramp, BAND_CELLS * plan.grid.cell) for low, high in known.intervals]
    solution = solve_fluid(
        section_mesh(plan, bands), wall_law(case), target_flow(case, packing), case.fluid.order, known
    )
    field = to_field(solution, plan.grid, plan.outline.inside_fraction(plan.grid), packing)
    errors = _errors(field, parts)
    field = replace(field, bulk=_bulk(field, parts), flux_r_se=errors[0], flux_z_se=errors[1])
    return ModelResult(
        field=field,
        gates=tuple(gate for _, made in parts for gate in made.gates),
        figures=_figures(field, solution, parts),
        productions=tuple(production for _, made in parts for production in made.productions),
        solution=solution,
        notes=tuple(note for _, made in parts for note in made.notes),
    )


def known_flow(plan: Plan, parts: Parts) -> KnownFlow:
    """The sub-models' stream functions on the vessel's grid, for a flow of 1 m³/s; between them the nearest row's."""
    grid = plan.grid
    psi = np.full((len(grid.z_edges), len(grid.r_edges)), np.nan)
    for _, made in parts:
        field = made.field
        if field.psi is None:
            raise CaseError(
                "must be psi for a hybrid: only a stream function can be followed", ("homogenize", "method")
            )
        rows = _rows(field.grid, grid.z_edges)
        unit = field.psi / (field.bulk_packing * field.bulk_flow)
        psi[rows, : unit.shape[1]] = unit
        psi[rows, unit.shape[1] :] = unit[:, -1:]
    known = np.flatnonzero(np.isfinite(psi[:, 0]))
    nearest = known[np.abs(np.arange(len(psi))[:, None] - known).argmin(axis=1)]
    spans = [span for span, _ in parts]
    margins = [m for span in spans for m in (span.cut_top - span.top, span.bottom - span.cut_bottom) if m > 0]
    return KnownFlow(
        r_edges=grid.r_edges,
        z_edges=grid.z_edges,
        psi=psi[nearest],
        intervals=tuple((span.bottom, span.top) for span in spans),
        ramp=min(margins, default=grid.cell),
        force_factor=plan.case.fluid.force_factor,
    )


def _cut_out(field: Field, span: Span, plan: Plan) -> Field:
    """The part of an earlier field that a span covers, on the vessel's rows; ψ by a bicubic spline in z and r²."""
    from scipy.interpolate import RectBivariateSpline

    name, old = plan.case.fluid.known_field, field.grid
    slack = 0.5 * plan.grid.cell
    if old.z_edges[0] > span.cut_bottom + slack or old.z_edges[-1] < span.cut_top - slack:
        raise CaseError(
            f"{name} covers z = {old.z_edges[0]:g} … {old.z_edges[-1]:g} m; section {span.name} with its margins needs "
            f"{span.cut_bottom:g} … {span.cut_top:g} m",
            ("fluid", "known_field"),
        )
    if field.psi is None:
        raise CaseError(f"{name} has no stream function; make it with homogenize.method: psi", ("fluid", "known_field"))
    levels = plan.grid.z_edges
    grid = Grid(plan.grid.r_edges, levels[(levels > span.cut_bottom - slack) & (levels < span.cut_top + slack)])
    spline = RectBivariateSpline(old.z_edges, old.r_edges**2, field.psi)
    psi = spline(grid.z_edges, np.minimum(grid.r_edges, old.r_edges[-1]) ** 2)
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


def _rows(part: Grid, z_edges: Array) -> slice:
    """Where the levels of a sub-model's grid stand among those of the vessel."""
    first = int(np.abs(z_edges - part.z_edges[0]).argmin())
    return slice(first, first + len(part.z_edges))


def _bulk(field: Field, parts: Parts) -> Mask:
    """Solids everywhere inside, but for the voids that the sub-models found."""
    bulk = field.bulk.copy()
    for _, made in parts:
        rows = _rows(made.field.grid, field.grid.z_edges)
        cells = slice(rows.start, rows.stop - 1), slice(0, made.field.grid.shape[1])
        bulk[cells] &= made.field.bulk
    return bulk


def _errors(field: Field, parts: Parts) -> tuple[Array | None, Array | None]:
    """Standard errors of the flux where the fluid follows a DEM that has them; the fluid of its own has no noise."""
    error_r, error_z = np.zeros_like(field.flux_r), np.zeros_like(field.flux_z)
    for _, made in parts:
        part = made.field
        if part.flux_r_se is None or part.flux_z_se is None:
            return None, None
        rows = _rows(part.grid, field.grid.z_edges)
        scale = part.velocity_scale / field.velocity_scale
        error_r[rows.start : rows.stop - 1, : part.flux_r_se.shape[1]] = part.flux_r_se * scale
        error_z[rows, : part.flux_z_se.shape[1]] = part.flux_z_se * scale
    return error_r, error_z


def _figures(field: Field, solution: FluidSolution, parts: Parts) -> dict[str, object]:
    figures: dict[str, object] = {"unknowns": solution.unknowns, "residual": solution.residual}
    for span, made in parts:
        figures[f"known in {span.name}"] = made.figures
        figures[f"difference from what is known in {span.name}"] = _difference(field, made.field, span.bottom, span.top)
        if span.cut_top > span.top:
            figures[f"difference at the upper seam of {span.name}"] = _difference(
                field, made.field, span.top, span.cut_top
            )
        if span.cut_bottom < span.bottom:
            figures[f"difference at the lower seam of {span.name}"] = _difference(
                field, made.field, span.cut_bottom, span.bottom
            )
    return figures


def _difference(field: Field, part: Field, low: float, high: float) -> float:
    """E = √(Σ A |δU|² / Σ A |U|²) over the bulk cells of both between two levels, A their ring areas × height."""
    rows = _rows(part.grid, field.grid.z_edges)
    at = slice(rows.start, rows.stop - 1)
    columns = part.grid.shape[1]
    chosen = part.bulk & field.bulk[at, :columns]
    chosen &= ((part.grid.z_centres > low) & (part.grid.z_centres < high))[:, None]
    a, b = field.velocity_scale, part.velocity_scale
    apart_r, apart_z = (
        field.flux_r[at, : columns + 1] * a - part.flux_r * b,
        field.flux_z[rows, :columns] * a - part.flux_z * b,
    )
    weight = np.where(chosen, part.grid.ring_area, 0.0)
    error = float((weight * cell_squares(apart_r, apart_z)).sum())
    return float(np.sqrt(error / (weight * cell_squares(part.flux_r * b, part.flux_z * b)).sum()))
