"""From the segments of a DEM run to the field, with its quality gates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from granpipe.case import Case
from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.assemble import paper_field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.conserve import Plug, measure_plug
from granpipe.homogenize.psi_field import psi_field
from granpipe.homogenize.statistics import (
    LEAST_BLOCKS,
    OffCentre,
    blocks,
    effective_samples,
    off_centre,
    onset,
    trend,
    turnovers,
)
from granpipe.plan import Plan
from granpipe.quality import breach_gate, level_flow_gate, packing_gate, size_gate
from granpipe.results import Made
from granpipe.simulate import Production, read_json

PLUG_DIAMETERS = 0.25
"""Height of the plug in which packing and flow are measured, in outlet diameters above the outlet."""


def dem_field(plan: Plan, production: Production) -> Made:
    """Average the segments after the transient and make the field."""
    settings = plan.dem
    parts = after_transient(list(production.sums()), plan.case)
    conserved = conserved_field(plan.case, plan.outline, parts, settings.classes.sauter_diameter)
    field, plug = conserved.field, conserved.plug
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
        figures=conserved.figures
        | run_statistics(parts, plan.outline)
        | {
            "averaged_from_s": parts[0].start,
            "averaged_to_s": parts[-1].stop,
            "averaged_plate_travel_m": (parts[-1].stop - parts[0].start) * settings.plate_speed,
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


def run_statistics(parts: Sequence[Sums], outline: Outline) -> dict[str, Any]:
    """What the average is worth and what it hides: independent samples, turnovers, trends, flow off the centre.

    Below one turnover a section still holds what it was filled with. Empty where there are too few segments for errors.
    """
    if len(parts) < LEAST_BLOCKS:
        return {}
    whole = merge(parts)
    ranges = {name: (section.z_bottom, section.z_top) for name, section in outline.sections.items()}
    solids, kinetic = (np.array([getattr(b, name).mean() for b in blocks(parts)]) for name in ("solids", "kinetic"))
    return {
        "effective_samples": effective_samples(parts),
        "turnovers": {name: turnovers(whole, levels) for name, levels in ranges.items()},
        "trend_of_solids": {"relative_change": trend(solids / solids.mean()).change, "p_value": trend(solids).p_value},
        "trend_of_kinetic_energy": {
            "relative_change": trend(kinetic / kinetic.mean()).change,
            "p_value": trend(kinetic).p_value,
        },
        "off_centre": {name: _plain(off_centre(parts, levels)) for name, levels in ranges.items()},
    }


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
        "independent_blocks": fitted.blocks,
        "storage_taken_off": fitted.storage,
    }
    if fitted.field.flux_z_se is not None:
        figures["statistical_error"] = statistical_errors(fitted.field, outline)
    return Conserved(fitted.field, plug, figures)


def statistical_errors(field: Field, outline: Outline) -> dict[str, float]:
    """E = √(Σ A SE² / Σ A F²) over the bulk cells, whole and per section; A the area of each ring."""
    assert field.flux_r_se is not None
    assert field.flux_z_se is not None
    square = [_on_cells(a**2, b**2) for a, b in ((field.flux_r, field.flux_z), (field.flux_r_se, field.flux_z_se))]
    weight = np.where(field.bulk, field.grid.ring_area, 0.0)
    errors = {}
    for name, section in {"whole": None, **outline.sections}.items():
        rows = slice(None)
        if section is not None:
            z = field.grid.z_centres
            rows = (z < section.z_top) & (z > section.z_bottom)  # type: ignore[assignment]
        flux, error = (float((weight * values)[rows].sum()) for values in square)
        errors[name] = float(np.sqrt(error / flux)) if flux > 0 else 0.0
    return errors


def _on_cells(flux_r: Array, flux_z: Array) -> Array:
    """(nz, nr) sum of both components' squares, each the mean of its two faces."""
    return 0.5 * (flux_r[:, 1:] + flux_r[:, :-1] + flux_z[1:] + flux_z[:-1])


def target_flow(case: Case, packing: float) -> float:
    """Bulk flow [m³/s] that the case asks for; a mass flow becomes bulk of this packing."""
    rate = case.flow_rate
    if rate.volume is not None:
        return rate.volume
    assert rate.mass is not None  # the case gives one of the two
    return rate.mass / (case.material.density * packing)


def after_transient(parts: list[Sums], case: Case) -> list[Sums]:
    """The segments from the start that the case gives, or from one that suits the data."""
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
    return parts[min(first, key=lambda i: _net_storage(parts[i:]))].start


def _net_storage(parts: list[Sums]) -> float:
    """Largest rate at which solids gather below any level [m³/s]."""
    return float(np.abs(np.cumsum(merge(parts).storage.sum(axis=1))).max())


def _plug_range(outline: Outline, grid: Grid) -> tuple[float, float]:
    """Levels between which the plug is measured [m]; the plate itself is farther below."""
    height = max(PLUG_DIAMETERS * 2 * outline.outlet_radius, 2 * grid.cell)
    return outline.z_bottom, outline.z_bottom + height


def _last_of_each_run(reports: list[dict[str, Any]], name: str) -> list[float]:
    """Counters that start anew with every resumed run: their last value of each run."""
    values = [report[name] for report in reports]
    return [value for value, after in zip(values, [*values[1:], -np.inf], strict=True) if after < value]
