"""From the segments of a DEM run to the field, with its quality gates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, cell_squares, level_flow, section_rows
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import paper_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, gathered_flow, measure_plug
from granpipe.homogenize.psi_field import psi_field
from granpipe.homogenize.statistics import (
    LEAST_BLOCKS,
    OffCentre,
    blocks,
    off_centre,
    onset,
    trend,
    turnovers,
)
from granpipe.planning.plan import Plan
from granpipe.run.dem_stages import Production
from granpipe.run.extra_fields import Summed
from granpipe.run.gates import (
    Gate,
    breach_gate,
    error_gates,
    level_flow_gates,
    missing_time,
    overlap_gates,
    packing_gate,
    size_gate,
)
from granpipe.run.production import Precision
from granpipe.run.results import Made
from granpipe.system.jsonfile import read_json

Levels = Mapping[str, tuple[float, float]]

PLUG_DIAMETERS = 0.25
"""Height of the plug in which packing and flow are measured, in outlet diameters above the outlet."""


def dem_field(plan: Plan, productions: Sequence[Production]) -> Made:
    """Average the segments of all runs after their transients and make the field."""
    settings = plan.dem
    parts = [sums for production in productions for sums in production.sums()]
    steady = after_transient(parts, plan.case)
    conserved = conserved_field(plan.case, plan.outline, steady, settings.classes.sauter_diameter)
    field = replace(conserved.field, extra=Summed.of(plan).arrays(steady, conserved.field.inside_fraction))
    settled = [read_json(production.settled / "settle.json") for production in productions]
    reports = [production.reports() for production in productions]
    figures = conserved.figures | run_statistics(steady, plan.case.outline.levels)
    return Made(
        field=field,
        gates=(
            *_average_gates(plan, conserved, merge(steady)),
            *(size_gate(bed["mass_share"], bed["wanted_mass_share"]) for bed in settled),
            *overlap_gates(settled[0]["overlap"]["mean"], settled[0]["overlap"]["p99"]),
            packing_gate(conserved.plug.packing),
            *map(breach_gate, plan.breaches),
        ),
        figures=figures
        | {
            "averaged_from_s": min(sums.start for sums in steady),
            "averaged_to_s": max(sums.stop for sums in steady),
            "averaged_plate_travel_m": merge(steady).duration * settings.plate_speed,
            "solids_flow_m3_per_s": conserved.plug.solids_flow,
            "bulk_packing": conserved.plug.packing,
            "particles": [run[-1]["particles"] for run in reports],
            "youngs_modulus_pa": settings.youngs_modulus,
            "time_step_s": settings.time_step,
            "settled_overlap": [bed["overlap"] for bed in settled],
            "inserted_to_settle": [bed["inserted"] for bed in settled],
            "short_insertions": [bed["short_insertions"] for bed in settled],
            "produce_wall_seconds": [sum(_last_of_each_run(run, "wall_seconds")) for run in reports],
            "averaging_seconds": [sum(_last_of_each_run(run, "averaging_seconds")) for run in reports],
        },
        productions=tuple(productions),
    )


def _average_gates(plan: Plan, conserved: Conserved, steady: Sums) -> list[Gate]:
    """The gates that a longer average can pass."""
    field, plug, target = conserved.field, conserved.plug, plan.case.dem.statistical_error
    assert field.raw_flux_z is not None
    gates = level_flow_gates(
        level_flow(field.raw_flux_z, field.grid), gathered_flow(steady, plug.z_range), plug.solids_flow
    )
    if target is not None:
        errors, effective = conserved.figures.get("statistical_error", {}), conserved.figures["effective_blocks"]
        gates += error_gates(errors, effective, target, steady.duration)
    return gates


class Judge:
    """Says of a run in progress how good its average is, and whether that is enough."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def __call__(self, parts: Sequence[Sums]) -> Precision:
        """The precision of the segments so far."""
        plan = self._plan
        if len(parts) < LEAST_BLOCKS or plan.case.homogenize.method == "paper":
            return Precision()
        try:
            steady = after_transient(parts, plan.case)
            conserved = conserved_field(plan.case, plan.outline, steady, plan.dem.classes.sauter_diameter)
        except DataError:
            return Precision()  # no flow at some level yet, or the filling still changes too fast
        target, errors = plan.case.dem.statistical_error, conserved.figures.get("statistical_error", {})
        if target is None or not errors:
            return Precision(errors)
        whole = merge(steady)
        enough = all(gate.passed for gate in _average_gates(plan, conserved, whole))
        effective = conserved.figures["effective_blocks"]
        return Precision(errors, enough, missing_time(errors, effective, target, whole.duration))


def run_statistics(parts: Sequence[Sums], levels: Levels) -> dict[str, Any]:
    """What the average is worth and what it hides: turnovers, trends, flow off the centre.

    Below one turnover a section still holds what it was filled with. Empty where there are too few segments for errors.
    """
    if len(parts) < LEAST_BLOCKS:
        return {}
    whole, joined = merge(parts), blocks(parts)
    ranges = {name: (low, top) for name, (top, low) in levels.items()}
    return {
        "turnovers": {name: turnovers(whole, z) for name, z in ranges.items()},
        "trend_of_solids": _trend([block.solids.mean() for block in joined]),
        "trend_of_kinetic_energy": _trend([block.kinetic.mean() for block in joined]),
        "off_centre": {name: _plain(off_centre(parts, z)) for name, z in ranges.items()},
    }


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


@dataclass(frozen=True)
class Conserved:
    """A field made to conserve, the plug that it was measured by, and figures of the method."""

    field: Field
    plug: Plug
    figures: dict[str, Any]


def conserved_field(case: Case, outline: Outline, parts: Sequence[Sums], diameter: float) -> Conserved:
    """The average of some segments, made to conserve by the case's method and scaled to the flow that it asks for."""
    sums = merge(parts)
    inside = outline.inside_fraction(sums.grid)
    material = case.material
    given = None if material.bulk_density is None else material.bulk_density / material.density
    plug = measure_plug(sums, inside, _plug_range(outline, sums.grid), diameter, given)
    scale = target_flow(case, plug.packing) / plug.bulk_flow
    if case.homogenize.method == "paper":
        field = paper_field(sums, inside, plug, diameter, case.homogenize.smoothing_passes, scale)
        return Conserved(field, plug, {})
    fitted = psi_field(parts, inside, plug, diameter, scale)
    figures: dict[str, Any] = {
        "smoothing_length_m": fitted.smoothing_length,
        "blocks": fitted.blocks,
        "effective_blocks": fitted.effective_blocks,
        "storage_taken_off": fitted.storage,
    }
    if fitted.scatter is not None:
        figures["scatter_of_runs_over_error"] = fitted.scatter
    if fitted.field.flux_z_se is not None:
        figures["statistical_error"] = statistical_errors(fitted.field, case.outline.levels)
    return Conserved(fitted.field, plug, figures)


def statistical_errors(field: Field, levels: Levels) -> dict[str, float]:
    """E = √(Σ A SE² / Σ A F²) over the bulk cells, whole and per section; A the area of each ring."""
    assert field.flux_r_se is not None
    assert field.flux_z_se is not None
    weight = np.where(field.bulk, field.grid.ring_area, 0.0)
    flux, error = (
        weight * cell_squares(r, z) for r, z in ((field.flux_r, field.flux_z), (field.flux_r_se, field.flux_z_se))
    )
    rows = section_rows(field.grid, levels)
    return {name: float(np.sqrt(error[at].sum() / max(flux[at].sum(), 1e-300))) for name, at in rows.items()}


def target_flow(case: Case, packing: float) -> float:
    """Bulk flow [m³/s] that the case asks for; a mass flow becomes bulk of this packing."""
    rate = case.flow_rate
    if rate.volume is not None:
        return rate.volume
    assert rate.mass is not None  # the case gives one of the two
    return rate.mass / (case.material.density * packing)


def after_transient(parts: Sequence[Sums], case: Case) -> list[Sums]:
    """The segments of each run from the start that the case gives, or from one that suits its data."""
    runs = [[sums for sums in parts if sums.run == run] for run in sorted({sums.run for sums in parts})]
    return [sums for run in runs for sums in _from_start(run, case)]


def _from_start(parts: list[Sums], case: Case) -> list[Sums]:
    start = _steady_start(parts) if case.homogenize.start == "auto" else float(case.homogenize.start)
    kept = [sums for sums in parts if sums.start >= start - 1e-9 * parts[-1].stop]
    if not kept:
        raise DataError(f"no segment begins after homogenize.start = {start:g} s; the last at {parts[-1].start:g} s")
    return kept


def _steady_start(parts: list[Sums]) -> float:
    """Where averaging begins [s]: after the onset that MSER-5 finds, within the first half of the run.

    Flow above an obstacle comes in bursts. Of the segments that may be first, the one is taken from which on the
    filling changes least to the end, so that the average holds bursts and rests alike.
    """
    whole = merge(parts)
    onset_time = float(whole.time[onset(whole.level_flow, whole.solids, whole.kinetic)])
    latest = max(onset_time, 0.5 * (parts[0].start + parts[-1].stop))
    first = [i for i, part in enumerate(parts) if onset_time - part.duration < part.start <= latest] or [0]
    net = _net_storage(parts)
    return parts[min(first, key=lambda i: float(net[i]))].start


def _net_storage(parts: list[Sums]) -> Array:
    """(n,) largest rate at which solids gather below any level, on average from each segment to the end [m³/s]."""
    gain = np.cumsum([part.gain.sum(axis=1) for part in parts[::-1]], axis=0)[::-1]
    duration = np.cumsum([part.duration for part in parts[::-1]])[::-1]
    return np.asarray(np.abs(np.cumsum(gain, axis=1)).max(axis=1) / duration)


def _plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    """Levels between which the plug is measured [m]; the plate itself is farther below."""
    height = max(PLUG_DIAMETERS * 2 * outline.outlet_radius, 2 * grid.cell)
    return outline.z_bottom, outline.z_bottom + height


def _last_of_each_run(reports: list[dict[str, Any]], name: str) -> list[float]:
    """Counters that start anew with every resumed run: their last value of each run."""
    values = [report[name] for report in reports]
    return [value for value, after in zip(values, [*values[1:], -np.inf], strict=True) if after < value]
