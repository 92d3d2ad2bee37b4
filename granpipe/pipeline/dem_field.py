"""From the segments of a DEM run to the field, with its quality gates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from granpipe.analysis.surfaces import surface_angle, surface_halves
from granpipe.dem.health import ArchError
from granpipe.errors import DataError
from granpipe.field import Field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.statistics import (
    LEAST_BLOCKS,
    OffCentre,
    blocks,
    off_centre,
    trend,
    turnovers,
)
from granpipe.pipeline.averages import (
    Levels,
    in_solid,
    plug_range,
    smoothing_change,
    steady_segments,
)
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import StatisticalErrorCriterion, average_gates, widest_level_travel
from granpipe.pipeline.dem_stages import finished_productions, simulate
from granpipe.pipeline.discharge import Discharge, measure_discharge
from granpipe.pipeline.extra_fields import ExtraSums
from granpipe.pipeline.failure import held_up, no_field
from granpipe.pipeline.gates import (
    FORCES_BALANCE,
    IN_SOLID,
    OVERLAPS,
    PACKING,
    SIZE_SHARE,
    SMOOTHING,
    Gate,
    asymmetry_gate,
    breach_gates,
    cells_gate,
    run_notes,
    surface_gates,
    upward_gate,
)
from granpipe.pipeline.model_result import ModelResult
from granpipe.pipeline.production import Production
from granpipe.pipeline.records import OverlapRecord, SegmentRecord, SettleRecord
from granpipe.pipeline.softness import as_rigid, mean_reference_overlap, rigid_share
from granpipe.pipeline.space_average import averaged_of, measured_packing_of, space_gates
from granpipe.planning.plan import Plan


def simulated_field(plan: Plan, context: Context) -> ModelResult:
    """Run the DEM stages of a plan, or find them done, and make the field.

    Raises
    ------
    RunError : LIGGGHTS failed, or what it does is no physics
    NoFieldError : the segments give no field, and why
    """
    try:
        productions = simulate(plan, context, StatisticalErrorCriterion(plan))
    except ArchError as error:
        try:
            productions = finished_productions(plan, context.store, context.versions)
        except DataError:  # no segment has been finished: there is nothing to draw
            raise error from None
        segments = [sums for production in productions for sums in production.sums()]
        raise held_up(error, plan, productions, segments) from None
    context.progress.stage("field")
    return dem_field(plan, productions)


def dem_field(plan: Plan, productions: Sequence[Production]) -> ModelResult:
    """Average the segments of all runs after their transients and make the field.

    Raises
    ------
    NoFieldError : the segments give none, and why
    """
    segments = [sums for production in productions for sums in production.sums()]
    try:
        return _field(plan, productions, segments)
    except DataError as error:
        if not segments:
            raise
        raise no_field(str(error), plan, productions, segments) from None


def _field(plan: Plan, productions: Sequence[Production], segments: Sequence[Sums]) -> ModelResult:
    settings = plan.dem
    simulated = steady_segments(segments, plan)
    reports = [production.reports() for production in productions]
    overlap = mean_reference_overlap(reports)
    steady = as_rigid(simulated, overlap)
    whole = merge(steady)
    averaged = averaged_of(plan, steady)
    summed = ExtraSums.of(plan)
    field = summed.added(averaged.field, steady)
    if plan.case.outline.depth is not None:
        field = field.of_depth(plan.case.outline.depth)
    settled = [SettleRecord.read(production.settled) for production in productions]
    flowing = _flowing_overlaps(zip(segments, (one for run in reports for one in run), strict=True), steady)
    figures = averaged.figures | summed.figures(steady) | run_statistics(steady, _levels(plan))
    if (
        plan.space is not None and "turnovers" in figures
    ):  # solids leave at several heights, not only through the lowest
        figures["turnovers"] = {"whole": averaged.plug.solids_flow * whole.duration / float(whole.mean_volume.sum())}
    if angles := _surface_angles(field, plan):
        figures["surface_angles"] = angles
    discharge = _discharge(plan, simulated, productions)
    if discharge is not None:
        figures["discharge"] = discharge.figures
    packing: float | None = averaged.plug.packing
    if plan.case.material.packing is not None:
        packing = measured_packing_of(plan, whole)
    figures |= {"bulk_packing": averaged.plug.packing, "measured_packing": packing}
    figures["widest_level_travel_diameters"] = widest_level_travel(averaged, whole, settings.classes.sauter_diameter)
    changed = None
    if plan.space is None:
        changed = smoothing_change(averaged.field, steady, settings.classes.sauter_diameter)
    return ModelResult(
        field=field,
        gates=(
            *average_gates(plan.case, averaged, whole, settings.classes.sauter_diameter),
            *(_size_gate(bed) for bed in settled),
            *_overlap_gates(flowing),
            *(() if packing is None else (PACKING.gate(packing),)),
            *(discharge.gates if discharge is not None else ()),
            *((FORCES_BALANCE.gate(abs(figures["forces"]["imbalance"])),) if "forces" in figures else ()),
            upward_gate(field),
            cells_gate(plan),
            *((IN_SOLID.gate(in_solid(segments, plan)),) if plan.set_back is not None else ()),
            *(() if changed is None else (SMOOTHING.gate(changed),)),
            *(() if plan.space is None else space_gates(figures)),
            *((asymmetry_gate(figures["off_centre"]),) if "off_centre" in figures else ()),
            *surface_gates(figures),
            *breach_gates(plan.breaches),
        ),
        figures=figures
        | {
            "averaged_from_s": min(sums.start for sums in steady),
            "averaged_to_s": max(sums.stop for sums in steady),
            "averaged_plate_travel_m": whole.duration * settings.plate_speed,
            "solids_flow_m3_per_s": field.bulk_flow * field.bulk_packing,
            "bulk_density_kg_per_m3": plan.case.material.density * averaged.plug.packing,
            "reference_overlap": overlap,
            "overlap_correction": rigid_share(overlap),
            "particles": [run[-1].particles for run in reports],
            "youngs_modulus_pa": settings.youngs_modulus,
            "time_step_s": settings.time_step,
            "settled_overlap": [asdict(bed.overlap) for bed in settled],
            "flowing_overlap": [asdict(overlap) for overlap in flowing],
            "inserted_to_settle": [bed.inserted for bed in settled],
            "short_insertions": [bed.short_insertions for bed in settled],
            "produce_wall_seconds": [sum(_last_of_each_run([one.wall_seconds for one in run])) for run in reports],
            "processor_seconds": [
                bed.processor_seconds + sum(_last_of_each_run([one.processor_seconds for one in run]))
                for bed, run in zip(settled, reports, strict=True)
            ],
            "averaging_seconds": [sum(_last_of_each_run([one.averaging_seconds for one in run])) for run in reports],
        },
        productions=tuple(productions),
        notes=(*(() if discharge is None else (f"discharge rate: {discharge}",)), *run_notes(figures)),
    )


def _discharge(plan: Plan, steady: Sequence[Sums], productions: Sequence[Production]) -> Discharge | None:
    """The discharge rate of an open outlet; None above a plate, which sets the flow."""
    if not plan.dem.open_outlet:
        return None
    reports = {production.run: production.reports() for production in productions}
    near_outlet = plug_range(plan.outline, plan.grid)
    found = measure_discharge(steady, near_outlet, plan.case.material.density, reports, plan.dem.time_step)
    return found.times(1 / plan.outline.measure.share(plan.case.outline.depth))


def _levels(plan: Plan) -> Levels:
    """Section → upper and lower level; a vessel in space is one section."""
    return plan.case.outline.levels if plan.space is None else {"whole": (plan.space.z_top, plan.space.z_bottom)}


def _surface_angles(field: Field, plan: Plan) -> dict[str, dict[str, Any]]:
    """Section → angle of its free surface below the horizontal, with its standard error [rad], and of its halves."""
    if plan.space is not None or not plan.outline.measure.axial:
        return {}  # a slab may have one on either side, a vessel in space anywhere
    diameter = plan.dem.classes.sauter_diameter
    found: dict[str, dict[str, Any]] = {}
    for name, (top, low) in plan.case.outline.levels.items():
        if (angle := surface_angle(field, (low, top), diameter)) is not None:
            found[name] = angle._asdict()
            if (halves := surface_halves(field, (low, top), diameter)) is not None:
                parts = {"inner": halves.inner, "outer": halves.outer, "apart": halves.apart}
                found[name] |= {key: part._asdict() for key, part in parts.items()}
                found[name] |= {"radius": halves.radius, "change": halves.change}
    return found


def _flowing_overlaps(segments: Iterable[tuple[Sums, SegmentRecord]], steady: Sequence[Sums]) -> list[OverlapRecord]:
    """Overlap of particles in the bed of each run that is averaged, mean over the ends of its steady segments."""
    averaged = {(sums.run, sums.start) for sums in steady}
    beds: dict[int, list[OverlapRecord]] = {}
    for sums, report in segments:
        if (sums.run, sums.start) in averaged:
            beds.setdefault(sums.run, []).append(report.overlap)
    return [
        OverlapRecord(float(np.mean([bed.mean for bed in run])), float(np.mean([bed.p99 for bed in run])))
        for run in beds.values()
    ]


def _overlap_gates(beds: Sequence[OverlapRecord]) -> list[Gate]:
    """Overlap of the particles of the softest bed."""
    mean, p99 = OVERLAPS
    return [mean.gate(max(bed.mean for bed in beds)), p99.gate(max(bed.p99 for bed in beds))]


def _size_gate(bed: SettleRecord) -> Gate:
    """Mass share of each size class in the bed against the distribution of the case."""
    return SIZE_SHARE.gate(float(np.abs(np.array(bed.mass_share) - np.array(bed.wanted_mass_share)).max()))


def run_statistics(segments: Sequence[Sums], levels: Levels) -> dict[str, Any]:
    """Quality figures of the average: turnovers, trends, and off-centre flow where there is an axis.

    Below one turnover a section still holds what it was filled with. Empty where there are too few segments for errors.
    """
    if len(segments) < LEAST_BLOCKS:
        return {}
    whole, joined = merge(segments), blocks(segments)
    ranges = {name: (low, top) for name, (top, low) in levels.items()}
    found: dict[str, Any] = {
        "turnovers": {name: turnovers(whole, z) for name, z in ranges.items()},
        "trend_of_solids": _trend([block.solids.mean() for block in joined]),
        "trend_of_kinetic_energy": _trend([block.kinetic.mean() for block in joined]),
    }
    if whole.grid.measure.axial:
        found["off_centre"] = {name: _plain(off_centre(segments, z)) for name, z in ranges.items()}
    return found


def _trend(values: list[float]) -> dict[str, float]:
    found = trend(np.array(values) / np.mean(values))
    return {"relative_change": found.change, "p_value": found.p_value}


def _plain(asymmetry: OffCentre) -> dict[str, Any]:
    return {
        "amplitudes": asymmetry.amplitude.tolist(),
        "amplitudes_se": asymmetry.amplitude_se.tolist(),
        "swirl": asymmetry.swirl,
        "swirl_se": asymmetry.swirl_se,
    }


def _last_of_each_run(values: list[float]) -> list[float]:
    """Counters that start anew with every resumed run: their last value of each run."""
    return [value for value, after in zip(values, [*values[1:], -np.inf], strict=True) if after < value]
