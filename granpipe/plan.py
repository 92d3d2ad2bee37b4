"""Case → Plan: which model and stages, why, what is left out and why, at what cost. Pure: no disk, no process."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from granpipe.case import Case
from granpipe.dem.settings import BYTES_PER_PARTICLE, RATE, Settings, Vessel, choose
from granpipe.field import Grid
from granpipe.geometry.outline import Outline
from granpipe.geometry.passages import Passage

CELLS_PER_DIAMETER = 4
"""Cells per Sauter diameter: smaller than the particles, as the paper has it; finer costs time and gains nothing."""

CELLS_PER_OPENING = 40
"""Cells across the narrowest opening where there are no particles to measure by."""

FILL_TIME = 3.0
"""Filling and settling take about this many times the free fall through the vessel (measured: 2.5–3)."""

RANK_GAIN = 0.9
"""Parallel efficiency of up to four ranks on idle cores (measured with two: 0.9–1.05)."""


@dataclass(frozen=True)
class Stage:
    """One stage of the run and why the scene needs it."""

    name: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """What will be done. `seconds` and `disk_bytes` are forecasts for this machine's cores, LIGGGHTS running alone."""

    case: Case
    outline: Outline
    model: Literal["dem", "fluid"]
    grid: Grid
    settings: Settings | None
    stages: tuple[Stage, ...]
    left_out: tuple[Stage, ...]
    warnings: tuple[str, ...]
    breaches: tuple[str, ...]
    seconds: float
    disk_bytes: float

    @property
    def dem(self) -> Settings:
        """The settings of a plan that has a DEM run."""
        assert self.settings is not None
        return self.settings

    @property
    def particle_steps(self) -> float:
        """Cost of the DEM run as particles times steps, filling included."""
        return 0.0 if self.settings is None else self.settings.particles * (self.settings.steps + self._fill_steps)

    @property
    def _fill_steps(self) -> float:
        height = self.dem.feed_top - self.dem.plate_z
        return FILL_TIME * math.sqrt(2 * height / 9.81) / self.dem.time_step


def make_plan(case: Case) -> Plan:
    """Decide everything; CaseError where the case asks for the impossible."""
    outline = Outline.from_case(case)
    passages = outline.passages()
    needs = {name: _needs_dem(case, outline, name) for name in outline.sections}
    model = _model(case, needs)
    settings = choose(case, _vessel(outline, passages)) if model == "dem" else None
    choices = settings.choices if settings else ()
    plan = Plan(
        case=case,
        outline=outline,
        model=model,
        grid=_grid(case, outline, passages, settings),
        settings=settings,
        stages=tuple(_stages(case, model, needs)),
        left_out=tuple(_left_out(case, model)),
        warnings=(*_model_warnings(case, model, needs), *(f"{c.name}: {c.warning}" for c in choices if c.warning)),
        breaches=tuple(f"{c.name} = {c.value}: {c.breach}" for c in choices if c.breach),
        seconds=0.0,
        disk_bytes=0.0,
    )
    return plan if settings is None else _with_cost(plan, settings)


def _vessel(outline: Outline, passages: tuple[Passage, ...]) -> Vessel:
    return Vessel(
        top=outline.z_top,
        outlet=outline.z_bottom,
        inlet_radius=outline.inlet_radius,
        outlet_radius=outline.outlet_radius,
        largest_radius=outline.r_max,
        volume=outline.volume(),
        openings=passages,
    )


def _needs_dem(case: Case, outline: Outline, name: str) -> str:
    """Why a section cannot go to the fictitious fluid; empty if it can."""
    section = case.outline.sections[name]
    if section.model is not None:
        return "the case says so" if section.model == "dem" else ""
    for obstacle, polygon in outline.obstacles.items():
        if polygon[:, 1].min() < section.z_top and polygon[:, 1].max() > section.z_bottom:
            return f"obstacle {obstacle} stands in it"
    tops = [z for z in (section.z_top, *outline.wall[:, 1]) if section.z_bottom < z <= section.z_top]
    if any(outline.wall_radius(z, "below") > outline.wall_radius(z, "above") + outline.tolerance for z in tops):
        return "it widens: a free surface forms"
    inner = [z for z in outline.wall[:, 1] if section.z_bottom < z < section.z_top]
    slopes = [float(outline.wall_slope(z)) for z in (section.z_top, *inner)]
    if any(slope < 0 for slope in slopes):
        return "it widens: a free surface forms"
    if any(slope > 0 for slope in slopes) and section.regime != "mass_flow":
        return "a hopper that the case does not call mass_flow"
    above = [n for n, s in case.outline.sections.items() if s.z_bottom >= section.z_top - outline.tolerance]
    disturbed = next((n for n in above if _needs_dem(case, outline, n)), None)
    return f"it lies below section {disturbed}, whose flow is not simple" if disturbed else ""


def _model(case: Case, needs: dict[str, str]) -> Literal["dem", "fluid"]:
    if case.model != "auto":
        return case.model
    return "dem" if any(needs.values()) else "fluid"


def _model_warnings(case: Case, model: str, needs: dict[str, str]) -> list[str]:
    if model == "dem":
        return []
    return [f"section {name}: {why}; the fictitious fluid does not describe that" for name, why in needs.items() if why]


def _grid(case: Case, outline: Outline, passages: tuple[Passage, ...], settings: Settings | None) -> Grid:
    if case.homogenize.cell != "auto":
        cell = float(case.homogenize.cell)
    elif settings is not None:
        cell = settings.classes.sauter_diameter / CELLS_PER_DIAMETER
    else:
        cell = min(passage.gap for passage in passages) / CELLS_PER_OPENING
    return Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, cell)


def _stages(case: Case, model: str, needs: dict[str, str]) -> list[Stage]:
    if model == "fluid":
        why = "the case asks for it" if case.model == "fluid" else "every section is straight or a mass-flow hopper"
        stages = [Stage("fluid", f"{why}: mesh the section and solve for the fictitious fluid")]
    else:
        reasons = [f"{name}: {why}" for name, why in needs.items() if why]
        why = "the case asks for it" if case.model == "dem" else "; ".join(reasons)
        stages = [
            Stage("walls", "LIGGGHTS needs the revolved walls, a reservoir and the outlet"),
            Stage("settle", "fill by repeated insertion and come to rest"),
            Stage("produce", why),
            Stage("field", f"average, then conserve by method {case.homogenize.method}"),
        ]
    return [*stages, Stage("results", ", ".join(["field.npz", *case.export, *_figures(case, model)]))]


def _figures(case: Case, model: str) -> list[str]:
    return [f"figures: {name}" for name in case.figures if name == "rz" or model == "dem"]


def _left_out(case: Case, model: str) -> list[Stage]:
    if model == "fluid":
        left = [Stage("DEM run", "no section needs it"), Stage("averaging", "there are no particles")]
        if "vessel" in case.figures:
            left.append(Stage("3-D picture", "there are no particles to show"))
        return left
    left = [Stage("fluid solve", "the DEM run covers the whole vessel")]
    parts = case.contact
    if parts.rolling_model == "none" or max(parts.rolling_friction, parts.wall.rolling_friction) == 0:
        left.append(Stage("rolling model", "no rolling friction"))
    if max(parts.friction, parts.wall.friction) == 0:
        left.append(Stage("tangential history", "no friction"))
    if case.material.size.kind == "mono":
        left.append(Stage("size classes", "one size"))
    if case.dem.outlet == "open":
        left.append(Stage("moving plate", "the outlet is open"))
    if not case.outline.obstacles:
        left.append(Stage("obstacle meshes", "no obstacles"))
    return left


def _with_cost(plan: Plan, settings: Settings) -> Plan:

    rate = RATE * settings.ranks * (RANK_GAIN if settings.ranks > 1 else 1.0)
    restart = 8 * BYTES_PER_PARTICLE * settings.particles  # measured: about 500 bytes a particle, contacts included
    snapshots = BYTES_PER_PARTICLE * settings.particles
    kept = {"none": 3, "thinned": settings.segments, "all": settings.steps // settings.dump_every}
    disk = 3 * restart + kept[plan.case.dem.keep_snapshots] * snapshots
    return replace(plan, seconds=plan.particle_steps / rate, disk_bytes=float(disk))
