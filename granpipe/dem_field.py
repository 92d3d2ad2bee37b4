"""From the segments of a DEM run to the field, with its quality gates."""

from __future__ import annotations

from typing import Any

import numpy as np

from granpipe.case import Case
from granpipe.errors import DataError
from granpipe.field import Field, Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import paper_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, measure_plug
from granpipe.plan import Plan
from granpipe.quality import breach_gate, level_flow_gate, packing_gate, size_gate
from granpipe.results import Made
from granpipe.simulate import Production, read_json

START_SHARE = 0.4
"""Part of the production that is left out as transient unless the case says when to start averaging."""

PLUG_DIAMETERS = 0.25
"""Height of the plug in which packing and flow are measured, in outlet diameters above the outlet."""


def dem_field(plan: Plan, production: Production) -> Made:
    """Average the segments after the transient and make the field."""
    settings = plan.dem
    sums = merge(_after_transient(list(production.sums()), plan.case, settings.duration))
    field, plug = conserved_field(plan.case, plan.outline, sums, settings.classes.sauter_diameter)
    settled = read_json(production.settled / "settle.json")
    reports = production.reports()
    assert field.raw_flux_z is not None
    return Made(
        field=field,
        gates=(
            level_flow_gate(level_flow(field.raw_flux_z, field.grid), plug.solids_flow),
            size_gate(settled["mass_share"], settled["wanted_mass_share"]),
            packing_gate(plug.packing),
            *map(breach_gate, plan.breaches),
        ),
        figures={
            "averaged_from_s": sums.start,
            "averaged_to_s": sums.stop,
            "averaged_plate_travel_m": (sums.stop - sums.start) * settings.plate_speed,
            "solids_flow_m3_per_s": plug.solids_flow,
            "bulk_packing": plug.packing,
            "particles": reports[-1]["particles"],
            "inserted_to_settle": settled["inserted"],
            "short_insertions": settled["short_insertions"],
            "produce_wall_seconds": sum(_last_of_each_run(reports, "wall_seconds")),
            "averaging_seconds": sum(_last_of_each_run(reports, "averaging_seconds")),
        },
        productions=(production,),
    )


def conserved_field(case: Case, outline: Outline, sums: Sums, diameter: float) -> tuple[Field, Plug]:
    """The average made to conserve, scaled to the flow that the case asks for, and the plug that it was measured by."""
    inside = outline.inside_fraction(sums.grid)
    material = case.material
    given = None if material.bulk_density is None else material.bulk_density / material.density
    plug = measure_plug(sums, inside, _plug_range(outline, sums.grid), diameter, given)
    scale = target_flow(case, plug.packing) / plug.bulk_flow
    return paper_field(sums, inside, plug, diameter, case.homogenize.smoothing_passes, scale), plug


def target_flow(case: Case, packing: float) -> float:
    """Bulk flow [m³/s] that the case asks for; a mass flow becomes bulk of this packing."""
    rate = case.flow_rate
    if rate.volume is not None:
        return rate.volume
    assert rate.mass is not None  # the case gives one of the two
    return rate.mass / (case.material.density * packing)


def _after_transient(every: list[Sums], case: Case, duration: float) -> list[Sums]:
    start = START_SHARE * duration if case.homogenize.start == "auto" else float(case.homogenize.start)
    kept = [sums for sums in every if sums.start >= start - 1e-9 * duration]
    if not kept:
        raise DataError(f"no segment begins after homogenize.start = {start:g} s; the last at {every[-1].start:g} s")
    return kept


def _plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    """Levels between which the plug is measured [m]; the plate itself is farther below."""
    height = max(PLUG_DIAMETERS * 2 * outline.outlet_radius, 2 * grid.cell)
    return outline.z_bottom, outline.z_bottom + height


def _last_of_each_run(reports: list[dict[str, Any]], name: str) -> list[float]:
    """Counters that start anew with every resumed run: their last value of each run."""
    values = [report[name] for report in reports]
    return [value for value, after in zip(values, [*values[1:], -np.inf], strict=True) if after < value]
