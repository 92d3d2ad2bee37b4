"""A study is a sweep whose points are made here: the case, and cheaper and more expensive variants of it.

All points have one grid, as fine as the smallest particles need it: deposits are exact on any cell, so that fields of
different particles are compared face by face, without interpolation that would blur noise and difference alike.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from granpipe.case.reader import resolve, varied
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.errors import CaseError
from granpipe.geometry.revolve import Turn
from granpipe.planning.forecast import forecast as forecast_of
from granpipe.planning.make import make_plan, model_plans
from granpipe.planning.plan import Model, Plan
from granpipe.planning.planner import CELLS_PER_DIAMETER
from granpipe.study.axes import BASE, Axes, Basis, StudyVariant, affordable, point_variants, study_variants
from granpipe.study.folder import study_name
from granpipe.study.inputs import Input, input_variants
from granpipe.sweep.file import Sweep
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.variants import Variant
from granpipe.system.rates import Rates

COARSEST = 4
"""Rows are a multiple of this, so that cells can be joined to twice and four times their size."""

_PLAIN = {
    "homogenize.method": "psi",
    "homogenize.fields": "[]",
    "export": "[]",
    "figures": "[]",
    "dem.replicas": "1",
    "dem.keep_snapshots": "none",
}


@dataclass(frozen=True)
class Study:
    """What is to be run.

    Parameters
    ----------
    case : the case with everything settled that the study varies
    variants : the points, the case itself first
    dropped : points that the budget does not allow
    forecast : point → wall time on one core [s], by its plan
    """

    case: Case
    variants: tuple[StudyVariant, ...]
    dropped: tuple[StudyVariant, ...]
    forecast: dict[str, float]

    @property
    def name(self) -> str:
        """Of the study's folder."""
        return study_name(self.case)

    @property
    def left_out(self) -> list[str]:
        """For the user: the points that the budget does not allow."""
        hours = {one.variant.name: self.forecast[one.variant.name] / 3600 for one in self.dropped}
        return [f"left out: {name}, {time:.2g} h; give more --hours to include it" for name, time in hours.items()]

    def sweep(self) -> Sweep:
        """The study as a sweep, with its axes beside the points."""
        axes = {"axes": {one.variant.name: one.axis for one in self.variants}, "forecast_seconds": self.forecast}
        points = {one.variant.name: one.variant for one in self.variants}
        inputs = SweepInput(self.case.to_yaml(), points, beside={"axes.json": json.dumps(axes, indent=1)})
        return Sweep(self.name, inputs, self.case.name, Places(self.name))


def make_study(
    case: Case,
    hours: float,
    cores: int,
    axes: Axes | None = None,
    rates: Rates | None = None,
    inputs: Sequence[Input] = (),
    points: Sequence[Mapping[str, str]] = (),
) -> Study:
    """The study of a case that some hours on some cores allow; CaseError where not even the case itself is possible.

    Parameters
    ----------
    axes : those to go along, all unless some are named, and their values; none where only inputs or points are
    rates : of this machine, where they are known
    inputs : what is known as a range: the case is run at both ends as well
    points : with several changes of the run's settings each
    """
    if case.vessel is not None:
        raise CaseError("a study is made of outlines only; vary a vessel in space by a sweep", ("vessel",))
    plans = model_plans(case)
    basis = replace(_basis(case, plans), cores=cores)
    settled = _settled(case, basis)

    def refusal(variant: Variant) -> CaseError | None:
        plan = _plan(settled, variant)
        return plan if isinstance(plan, CaseError) else None

    if inputs and basis.model != "dem":
        raise CaseError(
            f"inputs are varied in DEM runs, and this case is a {basis.model}: set model: dem", key=("model",)
        )
    base = StudyVariant("", Variant(BASE, {}))
    variants = (base,) if (inputs or points) and not axes else study_variants(settled, basis, refusal, axes)
    variants += (*point_variants(settled, points, refusal), *input_variants(settled, inputs, refusal))
    variants = _once(settled, variants)
    forecast = {one.variant.name: forecast_of(_needed(settled, one), rates, cores) for one in variants}
    kept, dropped = affordable(
        variants, lambda one: forecast[one.variant.name] * _busy(_needed(settled, one), cores), hours * 3600 * cores
    )
    cell = _common_cell([_needed(settled, one) for one in kept])
    settled = varied(settled, {"homogenize.cell": repr(cell)})
    return Study(settled, tuple(kept), tuple(dropped), forecast)


def _once(case: Case, variants: Sequence[StudyVariant]) -> tuple[StudyVariant, ...]:
    """Variants of the same settings once, as what they are first; others of the same name with another one."""
    found: list[StudyVariant] = []
    seen: list[object] = []
    for one in variants:
        settings = varied(case, {"dem.ranks": "1"} | one.variant.changes).model_dump()
        if settings in seen:
            continue
        seen.append(settings)
        name = one.variant.name
        while name in {other.variant.name for other in found}:
            name += f"-{one.axis}"
        found.append(replace(one, variant=replace(one.variant, name=name)))
    return tuple(found)


def _basis(case: Case, plans: Mapping[Model, Plan | CaseError]) -> Basis:
    possible = tuple(name for name, plan in plans.items() if isinstance(plan, Plan))
    chosen = make_plan(case)
    particles = plans["dem"]
    if not isinstance(particles, Plan):
        return Basis(0.0, 0.0, 0.0, 0.0, 0, chosen.model, possible)
    dem, measure = particles.dem, particles.outline.measure
    return Basis(
        youngs_modulus=dem.youngs_modulus,
        time_step=dem.time_step,
        plate_speed=dem.plate_speed,
        reservoir_height=0.5 * (dem.feed_bottom + dem.feed_top) - particles.outline.z_top,
        facets=Turn.within(particles.outline.r_max, dem.classes.sauter_diameter).facets if measure.axial else 0,
        thickness=0.0 if measure.axial or measure.walled else measure.turn,
        model=chosen.model,
        models=possible,
        max_time=dem.length.time,
        mass_scaled=dem.classes.mass_factor > 1,
    )


def _settled(case: Case, basis: Basis) -> Case:
    """The case with what would follow from other settings given as numbers, so that each can be varied alone."""
    given = case.model_dump(mode="json", exclude_unset=True)
    given.get("dem", {}).pop("statistical_error", None)  # runs of full length tell of all shorter ones
    changes = _PLAIN | {"model": basis.model}
    if basis.youngs_modulus:
        changes |= {
            "contact.youngs_modulus": repr(basis.youngs_modulus),
            "dem.max_time": repr(basis.max_time),
        }
    if basis.plate_speed:
        changes["dem.plate_speed"] = repr(basis.plate_speed)
    return resolve(given, Places(case.name), changes).case


def _plan(case: Case, variant: Variant) -> Plan | CaseError:
    """Its plan, on one rank unless it says otherwise, or why the scene does not allow it."""
    try:
        return make_plan(varied(case, {"dem.ranks": "1"} | variant.changes))
    except CaseError as error:
        return error


def _busy(plan: Plan, cores: int) -> int:
    """How many of the cores a plan keeps busy, as its forecast has it."""
    ranks = max((run.dem.ranks for run in plan.runs), default=1)
    return ranks * min(plan.case.dem.replicas, max(1, cores // ranks))


def _needed(case: Case, one: StudyVariant) -> Plan:
    plan = _plan(case, one.variant)
    assert isinstance(plan, Plan)  # it has been tried
    return plan


def _common_cell(plans: Sequence[Plan]) -> float:
    """The finest of the cells that the points would have of their own, so that rows are a multiple of `COARSEST`."""
    diameters = [run.dem.classes.sauter_diameter for plan in plans for run in plan.runs]
    height = plans[0].outline.z_top - plans[0].outline.z_bottom
    size = min(diameters) / CELLS_PER_DIAMETER if diameters else plans[0].grid.cell
    return height / (COARSEST * math.ceil(height / (COARSEST * size)))
