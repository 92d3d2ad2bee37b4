"""Case → Plan: which model and stages, why, what is left out and why, at what cost. Pure: no disk, no process."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.dem.gaps import check_gap
from granpipe.dem.packing import WIDEST, packable
from granpipe.dem.settings import BYTES_PER_PARTICLE, RATE, Settings, choose
from granpipe.dem.sizes import simulated_classes, size_classes
from granpipe.dem.vessel import Vessel
from granpipe.errors import CaseError, MeshError
from granpipe.field import Array, Box, Grid, section_rows
from granpipe.fluid.friction_error import ExpectedError, Rheology, expected_error
from granpipe.geometry.free_surfaces import voids
from granpipe.geometry.openings import Opening, find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import CHORD_ERROR, FEWEST_FACETS, Turn
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.planning.bulk_friction import BulkFriction, bulk_friction
from granpipe.planning.doubts import doubts, size_hint, unit_hint
from granpipe.planning.flow import check_flow_rate
from granpipe.planning.plane import check_model_between_walls, check_plane, depth_note
from granpipe.planning.scene import scene_of
from granpipe.planning.sections import section_needs, section_ranges
from granpipe.planning.set_back import check_whole, walls_of
from granpipe.planning.space import (
    check_model_in_space,
    check_space,
    check_space_flow,
    grid_decision,
    outlet_decisions,
    settings_vessel,
    space_grid,
    space_vessel,
    sums_memory,
)
from granpipe.planning.submodel import Span, spans, sub_case
from granpipe.planning.wall_factors import sections_without_law, wall_factor_decisions
from granpipe.progress import duration_text
from granpipe.system.rates import RANK_GAIN

Model = Literal["dem", "fluid", "hybrid"]

CELLS_PER_DIAMETER = 4
"""Cells per Sauter diameter: smaller than the particles, as in Sparta & Halvorsen (2017); finer gains nothing."""

LEAST_CELLS = 4
"""Across the narrowest opening: a gate marks a field on fewer cells."""

CELLS_PER_OPENING = 40
"""Cells across the narrowest opening where there are no particles to measure by."""

FILL_TIME = 2.5
"""Filling takes about this many times the free fall through the vessel where the bed is to come to rest (measured: 2 to
4; see docs/validation/filling.md)."""

CHORD_LIMIT = 0.15
"""Chord error of the wall in particle diameters beyond which a run is marked."""

LEAST_SEGMENTS = 4
"""The ψ fit weighs the average by how segments differ; up to half of them may be transient."""

FLUID_SECONDS = 3.0
"""Meshing and solving for the fictitious fluid, start-up included."""

FRICTION_SECONDS = 20.0
"""A frictional fluid, solved up to seven times: itself, and for its sensitivity, regularization and mesh."""

FRICTION_NOTE = (
    "a frictional fluid knows no arching, no intermittency and no history of filling; its error against DEM stands in "
    "docs/validation/friction_fluid.md, that of slabs in docs/validation/plane_vessels.md"
)

THICKNESS = 8.0
"""Thickness of the slice of a slab that is simulated, in d90."""

LEAST_THICKNESS = 4.0
"""The same, at least."""

TOO_WIDE = (
    "above a floor the funnel of a frictional fluid is too wide: it was 16 to 32 % wrong against DEM of four "
    "flat-bottomed silos; use particles (model: dem)"
)

OPEN_OUTLET_NOTE = (
    "the speed across the open outlet of a frictional fluid is assumed, w ∝ (1 − r²/a²)^0.7: next to it the field was "
    "14 and 19 % wrong against DEM of two silos with outlets of 6 d"
)

OUTLET_NOTE = "within one diameter of the outlet the field depends on the profile that fluid.outlet_profile prescribes"

ANNULUS = ("fluid", "annulus")
FIELDS = ("homogenize", "fields")

FROM_ANY_MODEL = ("residence_time", "strain_rate", "age")
"""What of homogenize.fields follows from flow and packing alone, however they were found."""

RHEOLOGIES: tuple[Rheology, ...] = ("viscous", "frictional")
"""From the cheapest on."""

FEWEST_DIAMETERS = 8.0
"""Openings below this many particle diameters mark a frictional fluid: they flow in jerks."""

TOTAL_ERROR, STATISTICAL_ERROR = ("total_error",), ("dem", "statistical_error")
BY_STUDY = "make a study of the case and run it with --total-error"
BY_PARTICLES = f"give model: dem with dem.statistical_error, or {BY_STUDY}"

HYBRID_GAIN = 0.8
"""`auto` takes the hybrid only where its DEM costs less than this part of a DEM run of the whole vessel."""


@dataclass(frozen=True)
class Stage:
    """One stage of the run and why the scene needs it; or what is left out and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """What will be done.

    Parameters
    ----------
    settings : of the DEM run of the whole vessel; None unless the model is "dem"
    set_back : the vessel between whose walls the particles are simulated, where it is not the one as drawn
    submodels : sub-models of a hybrid and the spans of sections that they stand for
    followed : spans in which a hybrid follows the field of an earlier run instead
    decisions : settings with their criteria; their warnings and breaches are in `warnings` and `breaches`
    unfit : sections that a fluid does not describe, and why, where the case asks for a fluid all the same
    wall_factors : those of the hoppers that a fluid describes, and the error to be expected there
    friction : what a frictional fluid goes by, alone or in a hybrid; None for a viscous one and for DEM
    space : the vessel where it is one in space; `outline` has the same area at each height then
    particle_steps : cost of DEM, filling included
    seconds, disk_bytes : forecasts for this machine's cores, LIGGGHTS running alone
    """

    case: Case
    outline: Outline
    model: Model
    grid: Grid
    settings: Settings | None
    submodels: tuple[tuple[Span, Plan], ...]
    followed: tuple[Span, ...]
    stages: tuple[Stage, ...]
    left_out: tuple[Stage, ...]
    decisions: tuple[Decision, ...]
    notes: tuple[str, ...]
    particle_steps: float
    seconds: float
    disk_bytes: float
    unfit: tuple[str, ...] = ()
    wall_factors: tuple[Decision, ...] = ()
    friction: BulkFriction | None = None
    set_back: Outline | None = None
    space: SpaceVessel | None = None

    @property
    def openings(self) -> tuple[Opening, ...]:
        """Every narrowing of the vessel, from the top down."""
        return find_openings(self.outline) if self.space is None else self.space.openings

    @property
    def simulated(self) -> Outline:
        """The vessel that particles see: its walls as drawn, or set back."""
        return self.outline if self.set_back is None else self.set_back

    @property
    def facets(self) -> int | None:
        """Facets of the walls per turn that the case asks for; None where it leaves them to granpipe."""
        return None if self.case.dem.facets == "auto" else int(self.case.dem.facets)

    @property
    def deposit_grid(self) -> Grid:
        """The grid on which particles are summed: the columns of the field's own, and more where walls are set back."""
        if self.set_back is None:
            return self.grid
        columns = Grid.covering(self.set_back.r_max, self.outline.z_bottom, self.outline.z_top, self.grid.cell)
        return Grid(columns.r_edges, self.grid.z_edges)

    @property
    def dem(self) -> Settings:
        """The settings of a plan that has a DEM run of its own."""
        assert self.settings is not None
        return self.settings

    @property
    def runs(self) -> tuple[Plan, ...]:
        """The DEM runs of the plan: its own, those of its sub-models, or none."""
        return (self,) if self.settings is not None else tuple(submodel for _, submodel in self.submodels)

    def submodel(self, name: str) -> Plan | None:
        """The plan of a sub-model; None where there is none of this name, because an earlier field is followed."""
        return next((plan for span, plan in self.submodels if span.name == name), None)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should keep in mind."""
        return (*self.notes, *(f"{c.name}: {c.warning}" for c in (*self.wall_factors, *self.decisions) if c.warning))

    @property
    def breaches(self) -> tuple[str, ...]:
        """What lies outside the stable or accurate range: such a run is marked."""
        return (
            *(f"model = fluid: {one}" for one in self.unfit),
            *(f"{c.name} = {c.value}: {c.breach}" for c in self.decisions if c.breach),
        )


def make_plan(case: Case, cores: int = 1) -> Plan:
    """Decide everything. Pure: the same case and cores give the same plan on every machine.

    Parameters
    ----------
    cores : that the run may keep busy: they decide the number of ranks and the forecast, nothing else

    Raises
    ------
    CaseError : the case asks for what is impossible, or for a model that cannot be right
    """
    if case.total_error is not None:
        return _plan_within(case, case.total_error, cores)
    if case.vessel is not None:
        return _space_plan(case, cores)
    scene = _Scene(case, cores)
    return scene.plan(scene.choose_model())


def _plan_within(case: Case, error: float, cores: int) -> Plan:
    """The cheapest model whose error is at most that which the case asks for, by vessels of the same kind."""
    check_model_between_walls(case, "auto")
    if case.vessel is not None:
        raise CaseError(f"of vessels in space no error is known; {BY_PARTICLES}", TOTAL_ERROR)
    scene = scene_of(case, _Scene(case, cores).outline)
    left: list[Stage] = []
    known = False
    for rheology in RHEOLOGIES if case.fluid.rheology == "viscous" else ("frictional",):
        expected = expected_error(rheology, scene)
        if isinstance(expected, ExpectedError):
            known = True
            plan = _fluid_within(case, rheology, expected, error, cores)
            if isinstance(plan, Plan):
                chosen = f"{rheology} fluid, the cheapest within total_error {error:.3g}: {expected.text()}"
                return _with_choice(plan, chosen, left)
            left.append(Stage(f"{rheology} fluid", plan))
        else:
            left.append(Stage(f"{rheology} fluid", expected))
    fluids = "; ".join(f"{one.name}: {one.reason}" for one in left)
    if not known:
        raise CaseError(f"no error is known to choose a model by ({fluids}); {BY_PARTICLES}", TOTAL_ERROR)
    if case.dem.coarse_grain_factor > 1:
        raise CaseError(
            f"no fluid is within it ({fluids}), and of enlarged particles no error is known: leave "
            f"dem.coarse_grain_factor out, or {BY_STUDY}",
            TOTAL_ERROR,
        )
    if case.homogenize.method == "gaussian":
        raise CaseError(
            f"no fluid is within total_error ({fluids}), and only method: psi tells the error of particles",
            ("homogenize", "method"),
        )
    if (case.dem.statistical_error or error) > error:
        raise CaseError(f"no fluid is within total_error ({fluids}), and this is beyond it", STATISTICAL_ERROR)
    target = case.dem.statistical_error or error
    dem = case.dem.model_copy(update={"statistical_error": target})
    plan = _Scene(case.model_copy(update={"dem": dem}), cores).plan("dem")
    chosen = f"particles of the material's own size, until their statistical error is {target:.3g}: no fluid is within"
    return _with_choice(plan, f"{chosen} total_error {error:.3g}", left)


def _fluid_within(case: Case, rheology: Rheology, expected: ExpectedError, error: float, cores: int) -> Plan | str:
    """The plan of a fluid, or why it is not taken."""
    if expected.worst > error:
        return f"{expected.text()}: beyond total_error {error:.3g}"
    try:
        plan = _Scene(varied(case, {"fluid.rheology": rheology}), cores).plan("fluid")
    except CaseError as problem:
        return f"not possible: {problem}"
    narrow = min(plan.openings, key=lambda opening: opening.gap)
    diameters = narrow.gap / size_classes(case.material.size).sauter_diameter
    if rheology == "frictional" and diameters < FEWEST_DIAMETERS * (1 - 1e-9):
        return f"would be marked: {narrow.name} of {diameters:.3g} d; it flows in jerks below {FEWEST_DIAMETERS:g}"
    return f"would be marked: {'; '.join(plan.breaches)}" if plan.breaches else plan


def _with_choice(plan: Plan, chosen: str, left: Iterable[Stage]) -> Plan:
    """The plan with why its model was taken, and no other."""
    hybrid = Stage("hybrid", "no error of hybrids is known from vessels of the same kind")
    return replace(plan, stages=(Stage("model", chosen), *plan.stages), left_out=(*left, hybrid, *plan.left_out))


def model_plans(case: Case, cores: int = 1) -> dict[Model, Plan | CaseError]:
    """The plans of all three models, for comparison; the error of one that the scene does not allow.

    Raises
    ------
    CaseError : no model is possible
    """
    planned = _Scene(case, cores).plan if case.vessel is None else lambda model: _space_plan(case, cores, model)
    found: dict[Model, Plan | CaseError] = {}
    for model in ("fluid", "hybrid", "dem"):
        try:
            found[model] = planned(model)
        except CaseError as error:
            found[model] = error
    return found


def other_rheology(case: Case, cores: int = 1) -> tuple[str, Plan | CaseError]:
    """The rheology of a fluid that the case does not ask for, and the plan with it."""
    name: Literal["viscous", "frictional"] = "viscous" if case.fluid.rheology == "frictional" else "frictional"
    other = case.model_copy(update={"fluid": case.fluid.model_copy(update={"rheology": name})})
    try:
        if case.vessel is not None:
            check_model_in_space("fluid")
        return name, _Scene(other, cores).plan("fluid")
    except CaseError as error:
        return name, error


class _Scene:
    """A case with what the planner derives from it once."""

    def __init__(self, case: Case, cores: int) -> None:
        self.case, self.cores = case, cores
        check_plane(case)
        self.outline = Outline.from_case(case)
        self.openings = find_openings(self.outline)
        self.needs = section_needs(case, self.outline)

    def choose_model(self) -> Model:
        """What the case says, or the least that its sections need."""
        if self.case.model != "auto":
            return self.case.model
        if self.outline.measure.walled:
            return "dem"
        by_dem = {name for name, need in self.needs.items() if need.model == "dem"}
        if not by_dem:
            return "fluid"
        if by_dem == set(self.needs) or not by_dem <= set(self.outline.sections):
            return "dem"
        fluid = {name: one for name, one in section_ranges(self.case, self.outline).items() if name not in by_dem}
        if sections_without_law(self.case, self.outline, fluid):
            return "dem"
        hybrid, dem = self.plan("hybrid"), self.plan("dem")
        return "hybrid" if hybrid.particle_steps < HYBRID_GAIN * dem.particle_steps else "dem"

    def plan(self, model: Model) -> Plan:
        """The plan of one model."""
        check_model_between_walls(self.case, model)
        return {"fluid": self._fluid, "dem": self._dem, "hybrid": self._hybrid}[model]()

    @property
    def _why_fluid(self) -> str:
        return "the case asks for a fluid" if self.case.total_error is None else "a fluid is within total_error"

    @property
    def _why_particles(self) -> str:
        walled = self.outline.measure.walled and self.case.model == "auto"
        return "between a front and a back wall nothing else is possible" if walled else "the case asks for it"

    def _fluid(self) -> Plan:
        self._check_density()
        through = self._fluid_openings()
        if self.case.fluid.rheology == "frictional":
            return self._frictional(through)
        notes = [*check_flow_rate(self.case, self.outline, through), *self._narrow(through)]
        unfit, doubts = self._unfit(self.needs)
        why = self._why_fluid if unfit or doubts else "every section is straight or a mass-flow hopper"
        left = [Stage("DEM run", self._why_fluid if unfit or doubts else "no section needs it")]
        left.append(Stage("averaging", "there are no particles"))
        if "vessel" in self.case.figures:
            left.append(Stage("3-D picture", "there are no particles to show"))
        self._leave_out_fields("there are no particles", left, notes)
        stages = [Stage("fluid", f"{why}: mesh the section and solve for the fictitious fluid"), self._results("fluid")]
        notes += doubts
        notes += [] if self.case.fluid.outlet_profile == "developed" else [OUTLET_NOTE]
        plan = self._made("fluid", self._grid(self._opening_cell()), stages, left, notes=notes, seconds=FLUID_SECONDS)
        factors = wall_factor_decisions(self.case, self.outline, section_ranges(self.case, self.outline))
        return replace(plan, unfit=tuple(unfit), wall_factors=tuple(factors))

    def _frictional(self, through: tuple[Opening, ...]) -> Plan:
        """A fluid with friction describes heaps, surfaces and hoppers; the funnel above a floor marks it."""
        case, friction = self.case, bulk_friction(self.case)
        voids(self.outline, friction.repose)
        notes = [*check_flow_rate(case, self.outline, through), *self._narrow(through), FRICTION_NOTE]
        notes += self._at_open_outlet()
        stages = [Stage("fluid", f"{self._why_fluid}, with friction: cut free surfaces, mesh, iterate")]
        left = [Stage("DEM run", self._why_fluid), Stage("averaging", "there are no particles")]
        if "vessel" in case.figures:
            left.append(Stage("3-D picture", "there are no particles to show"))
        self._leave_out_fields("there are no particles", left, notes)
        grid = self._grid(self._opening_cell())
        plan = self._made("fluid", grid, [*stages, self._results("fluid")], left, notes=notes, seconds=FRICTION_SECONDS)
        return replace(plan, friction=friction, unfit=tuple(self._on_floors(self.needs)))

    def _at_open_outlet(self) -> list[str]:
        """A note where a frictional fluid leaves through an open hole."""
        developed = self.case.fluid.outlet_profile == "developed"
        return [OPEN_OUTLET_NOTE] if self.case.dem.outlet == "open" and developed else []

    def _on_floors(self, names: Iterable[str]) -> list[str]:
        """Marks of sections that would be a frictional fluid though solids rest on a floor in them."""
        found = {name: self.needs[name].floor for name in names}
        floors = {name: floor for name, floor in found.items() if floor is not None and floor.certain}
        return [f"section {name}: solids rest on {floor.text}; {TOO_WIDE}" for name, floor in floors.items()]

    def _check_density(self) -> None:
        """CaseError unless the case tells what the fluid weighs: nothing else does without particles."""
        if self.case.material.bulk_density is None:
            raise CaseError(
                "missing; a fluid has no particles to measure the packing by, which turns its velocity into a mass "
                "flow: give the bulk density, or set model: dem",
                ("material", "bulk_density"),
            )

    def _fluid_openings(self) -> tuple[Opening, ...]:
        """The openings of the vessel, and the annulus through which the fluid is to leave."""
        if self.case.fluid.annulus is None:
            return self.openings
        (inner, outer), radius = self.case.fluid.annulus, self.outline.outlet_radius
        if outer > radius + self.outline.tolerance:
            raise CaseError(f"reaches to {outer:g} m, but the outlet has a radius of {radius:g} m", ANNULUS)
        gap, area = (outer - inner if inner else 2 * outer), math.pi * (outer**2 - inner**2)
        annulus = Opening("annular outlet", self.outline.z_bottom, inner, outer, gap, area, True, ANNULUS)
        return (*self.openings, annulus)

    def _narrow(self, openings: Iterable[Opening]) -> list[str]:
        """Notes on openings that are narrow for the particles; CaseError where one is too narrow."""
        try:
            decisions = [check_gap(opening, size_classes(self.case.material.size), 1.0) for opening in openings]
        except CaseError as error:
            raise self._with_hint(error) from None
        return [f"{decision.name}: {decision.warning}" for decision in decisions if decision.warning]

    def _unfit(self, names: Iterable[str]) -> tuple[list[str], list[str]]:
        """Marks and notes on sections that would be a fluid though one does not describe them.

        CaseError where solids rest on a floor: the fluid of a funnel is wrong by half.
        """
        unfit: list[str] = []
        doubts: list[str] = []
        for name in names:
            need = self.needs[name]
            if need.floor is not None:
                given = self.case.outline.sections.get(name)
                said = given is not None and given.model == "fluid"
                raise CaseError(
                    f"section {name} cannot be a fluid: solids rest on {need.floor.text}, and the flow above it is a "
                    f"funnel up to z = {need.floor.reach:.4g} m; use particles there (model: auto or dem)",
                    ("outline", "sections", name, "model") if said else need.floor.key,
                )
            if need.objection:
                text = f"section {name} is not for a fluid: {need.objection}"
                (doubts if need.doubtful else unfit).append(text)
        return unfit, doubts

    def _dem(self) -> Plan:
        outline, along_y = self._simulated()
        walls = walls_of(self.case, outline)
        back = walls.outline is not outline
        if back:
            self._narrow(self.openings)  # as drawn, for the material's own particles
        try:
            settings = choose(self.case, _vessel(walls.outline), self.cores)
        except CaseError as error:
            where = "between walls set back (dem.walls) " if back else ""
            raise self._with_hint(CaseError(where + error.message, error.key, error.place)) from None
        _check_duration(self.case, settings, self.cores)
        reasons = "; ".join(f"{name}: {need.dem}" for name, need in self.needs.items() if need.dem)
        stages = [
            Stage("walls", "LIGGGHTS needs the walls in space, a reservoir and the outlet"),
            _settle_stage(settings),
            Stage("produce", reasons or self._why_particles),
            Stage("field", f"average, then conserve by method {self.case.homogenize.method}"),
            self._results("dem"),
        ]
        left = [Stage("fluid solve", "the DEM run covers the whole vessel"), *_left_out_of_decks(self.case)]
        if "mixing" in self.case.homogenize.fields and len(settings.classes.radius) < 2:
            raise CaseError("mixing tells how sizes lie among each other, and material.size is one size alone", FIELDS)
        grid = self._grid(settings.classes.sauter_diameter / CELLS_PER_DIAMETER)
        grid = grid.of_slice(outline.measure)
        self._check_sections(grid)
        notes = check_flow_rate(self.case, self.outline, self.openings)
        plan = self._made("dem", grid, stages, left, notes=list(notes))
        return replace(
            plan,
            outline=outline,
            set_back=walls.outline if back else None,
            settings=settings,
            decisions=(
                *settings.decisions,
                *((walls.decision,) if walls.decision else ()),
                *(along_y or (self._facets(settings, walls.outline.r_max),)),
            ),
            particle_steps=_particle_steps(self.case, settings, settings.steps),
            seconds=_seconds(self.case, settings, settings.steps, self.cores),
            disk_bytes=self.case.dem.replicas * _disk(self.case, settings),
        )

    def _simulated(self) -> tuple[Outline, tuple[Decision, ...]]:
        """The vessel as particles fill it; of a deep slab a slice between periodic faces, with what is said of y."""
        if self.outline.measure.axial:
            if self.case.dem.thickness != "auto":
                raise CaseError("only a slab, outline.symmetry: plane, has one; leave it out", ("dem", "thickness"))
            return self.outline, ()
        classes = simulated_classes(self.case)
        given = self.case.dem.thickness
        if self.outline.measure.walled:
            if given != "auto":
                raise CaseError(
                    "particles fill the whole outline.depth between a front and a back wall (outline.front_and_back); "
                    "leave it out",
                    ("dem", "thickness"),
                )
            return self.outline, (
                Decision("slab depth", f"{self.outline.measure.turn:.3g} m", "all of it, between front and back wall"),
                check_gap(_depth_gap(self.outline), classes, self.case.dem.coarse_grain_factor),
            )
        thickness = THICKNESS * classes.d90 if given == "auto" else float(given)
        ratio = thickness / classes.d90
        if ratio < LEAST_THICKNESS:
            raise CaseError(
                f"{thickness:.3g} m is {ratio:.2g} times the particles' d90 of {classes.d90:.3g} m; a slab between "
                f"periodic faces needs {LEAST_THICKNESS:g} of them, or its particles touch their own images",
                ("dem", "thickness"),
            )
        depth = self.outline.measure.turn
        breach = "" if ratio > 0.99 * THICKNESS else f"below {THICKNESS:g} d90 the thickness may show in the field"
        if depth < min(thickness, THICKNESS * classes.d90) * (1 - 1e-9):
            breach = (
                f"the slab is {depth:.3g} m deep: its front and back walls, which are left out, would be felt; "
                "outline.front_and_back: walls puts them in"
            )
        criterion = f"{THICKNESS:g} d90 between periodic faces: half of it made no difference beyond noise"
        decision = Decision("slab thickness", f"{thickness:.3g} m", criterion, breach)
        return self.outline.of_depth(thickness), (decision,)

    def _check_sections(self, grid: Grid) -> None:
        """CaseError where a section is so thin that no row of the grid tells its error, as along a curved wall."""
        for name, rows in section_rows(grid, self.case.outline.levels).items():
            if not rows.any():
                top, low = self.case.outline.levels[name]
                raise CaseError(
                    f"section {name}, z = {low:.6g} … {top:.6g} m, holds no row of the grid, of {grid.cell:.3g} m "
                    "cells: give sections that join it with a neighbour, or a smaller homogenize.cell",
                    ("outline", "sections"),
                )

    def _facets(self, settings: Settings, radius: float) -> Decision:
        given, diameter = self.case.dem.facets, settings.classes.sauter_diameter
        if given != "auto" and given % 4:
            raise CaseError(f"must be a multiple of 4, so that quarters are equal, not {given}", ("dem", "facets"))
        try:
            turn = Turn.chosen(None if given == "auto" else given, radius, diameter)
        except MeshError as too_fine:
            raise CaseError(str(too_fine), ("material", "size")) from None
        error = turn.chord_error(radius) / diameter
        breach = "" if error <= CHORD_LIMIT else f"the facets are up to {error:.2g} particle diameters off the wall"
        criterion = (
            f"circle at most {CHORD_ERROR:g} particle diameters above the chord, at least {FEWEST_FACETS} facets"
        )
        return Decision("facets per turn", str(turn.facets), criterion, breach)

    def _hybrid(self) -> Plan:
        case = self.case
        check_whole(case)
        classes = simulated_classes(case)
        outside = [name for name, need in self.needs.items() if need.objection and name not in case.outline.sections]
        if outside:
            raise CaseError(
                f"the vessel {outside[0]} needs DEM ({self.needs[outside[0]].objection}), but no section covers it; "
                "add one, or set model: dem",
                ("outline", "sections"),
            )
        friction = bulk_friction(case) if case.fluid.rheology == "frictional" else None
        rest = {n: one for n, one in section_ranges(case, self.outline).items() if not self.needs[n].dem}
        if friction is None:
            unfit, doubts = self._unfit(rest)
        else:
            voids(self.outline, friction.repose)
            unfit, doubts = self._on_floors(rest), [FRICTION_NOTE, *self._at_open_outlet()]
        through = self._fluid_openings()
        notes = [*check_flow_rate(case, self.outline, through), *self._narrow(through), *doubts]
        found = spans(
            case,
            {n: need.dem for n, need in self.needs.items()},
            classes.d90,
            lambda z, side: float(self.outline.hydraulic_diameter(z, side)),
        )
        if not found:
            raise CaseError("no section needs DEM; set model: auto or fluid, or model: dem in a section", ("model",))
        if friction is not None and self._nothing_left(found):
            raise CaseError(
                "the sections that need DEM and their margins cover the whole vessel: nothing is left for a frictional "
                "fluid; set model: dem",
                ("model",),
            )
        grid = self._grid(classes.sauter_diameter / CELLS_PER_DIAMETER)
        cut = tuple(span.on_levels(grid.z_edges.tolist()) for span in found)
        earlier = case.fluid.known_field
        submodels = () if earlier else tuple(self._submodel(span, grid) for span in cut)
        stages = [Stage(f"{earlier or 'DEM'} in {span.name}", self._why(span)) for span in cut]
        way = "the others are forced to follow what is known" if friction is None else "joined to the others by ψ"
        stages.append(Stage("fluid", f"sections {', '.join(rest)} flow simply; {way}"))
        stages.append(self._results("hybrid"))
        left = [Stage(f"DEM of {n}", self.needs[n].reason) for n in rest]
        self._leave_out_fields("the field is that of the fluid", left, notes)
        plan = self._made("hybrid", grid, stages, left, notes=notes)
        return replace(
            plan,
            unfit=tuple(unfit),
            submodels=submodels,
            followed=cut if earlier else (),
            decisions=decisions_of(submodels),
            wall_factors=() if friction else tuple(wall_factor_decisions(case, self.outline, rest)),
            friction=friction,
            particle_steps=sum(submodel.particle_steps for _, submodel in submodels),
            seconds=(FRICTION_SECONDS if friction else FLUID_SECONDS) + sum(one.seconds for _, one in submodels),
            disk_bytes=sum(submodel.disk_bytes for _, submodel in submodels),
        )

    def _nothing_left(self, found: Iterable[Span]) -> bool:
        """Whether spans with their margins reach from the inlet to the outlet."""
        reached, slack = self.outline.z_top, self.outline.tolerance
        for span in found:  # from the top down
            if span.cut_top < reached - slack:
                return False
            reached = span.cut_bottom
        return reached <= self.outline.z_bottom + slack

    def _leave_out_fields(self, why: str, left: list[Stage], notes: list[str]) -> None:
        """Leave out what the case asks for under homogenize.fields and only particles can tell, and say so."""
        names = [name for name in self.case.homogenize.fields if name not in FROM_ANY_MODEL]
        left += [Stage(name, why) for name in names]
        notes += [f"homogenize.fields: without {', '.join(names)}: {why}"] if names else []

    def _submodel(self, span: Span, grid: Grid) -> tuple[Span, Plan]:
        """The plan of a sub-model, on the rows of the whole vessel's grid that it covers."""
        plan = make_plan(sub_case(varied(self.case, {"dem.walls": "as_drawn"}), span), self.cores)
        rows = _covered(grid.z_edges, span.cut_bottom, span.cut_top)
        columns = _covered(grid.r_edges, plan.outline.r_min, plan.outline.r_max)
        return span, replace(plan, grid=grid.part(rows, columns).of_slice(plan.outline.measure))

    def _why(self, span: Span) -> str:
        return "; ".join(f"{name}: {self.needs[name].dem or 'between its neighbours'}" for name in span.sections)

    def _made(
        self,
        model: Model,
        grid: Grid,
        stages: list[Stage],
        left: list[Stage],
        notes: list[str] | None = None,
        seconds: float = 0.0,
    ) -> Plan:
        return Plan(
            case=self.case,
            outline=self.outline,
            model=model,
            grid=grid,
            settings=None,
            submodels=(),
            followed=(),
            stages=tuple(stages),
            left_out=tuple(left),
            decisions=(),
            notes=(
                *filter(None, [depth_note(self.case)]),
                *doubts(self.case, self.outline),
                *self._coarse(grid),
                *(notes or ()),
            ),
            particle_steps=0.0,
            seconds=seconds,
            disk_bytes=0.0,
        )

    def _coarse(self, grid: Grid) -> Iterator[str]:
        """A note where the result will be marked for its cells."""
        narrowest = min(opening.gap for opening in self.openings)
        if self.case.homogenize.cell != "auto" and narrowest < LEAST_CELLS * grid.cell:
            yield (
                f"homogenize.cell: {grid.cell:.3g} m in an opening of {narrowest:.3g} m: with fewer than {LEAST_CELLS} "
                "cells across it the result will be marked"
            )

    def _grid(self, cell: float) -> Grid:
        """The grid that the case gives, or one of about this cell size [m]."""
        given = self.case.homogenize.cell
        outline = self.outline
        size = cell if given == "auto" else float(given)
        try:
            if outline.measure.axial:
                return Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, size)
            depth = (0.0, outline.measure.turn)
            return Box.within(
                (outline.r_min, outline.r_max), depth, (outline.z_bottom, outline.z_top), size, True, True
            )
        except CaseError as error:
            raise self._with_hint(error) from None

    def _with_hint(self, error: CaseError) -> CaseError:
        """The error with a question where a unit may be missing, or diameters were given as radii."""
        hint = unit_hint(self.case, self.outline) or size_hint(self.case, self.outline)
        return CaseError(error.message + hint, error.key, error.place)

    def _results(self, model: Model) -> Stage:
        figures = [f"figures: {name}" for name in self.case.figures if name == "rz" or model != "fluid"]
        fields = [name for name in self.case.homogenize.fields if model == "dem" or name in FROM_ANY_MODEL]
        return Stage("results", ", ".join(["field.npz", *fields, *self.case.export, *figures]))

    def _opening_cell(self) -> float:
        return min(opening.gap for opening in self.openings) / CELLS_PER_OPENING


def _covered(edges: Array, low: float, high: float) -> slice:
    """The cells between edges that two ends enclose, parts of cells included [m]."""
    slack = 1e-9 * float(edges[1] - edges[0])
    first = int(np.searchsorted(edges, low + slack, side="right")) - 1
    return slice(max(0, first), int(np.searchsorted(edges, high - slack)))


def _check_duration(case: Case, settings: Settings, cores: int) -> None:
    """CaseError for a production that is too short for an average."""
    averaged = settings.segments - settings.segments_left_out
    if case.homogenize.method == "psi" and averaged < LEAST_SEGMENTS:
        segment = settings.segment_steps * settings.time_step
        steps = (settings.segments_left_out + LEAST_SEGMENTS) * settings.segment_steps
        raise CaseError(
            f"{settings.length.time:g} s is {averaged} segments of {segment:.3g} s; the ψ fit needs "
            f"{LEAST_SEGMENTS}: simulate {LEAST_SEGMENTS * segment:.2g} s or more, which takes about "
            f"{duration_text(_seconds(case, settings, steps, cores))} to compute, or set homogenize.method: gaussian",
            ("dem", "max_time"),
        )
    start = case.homogenize.start
    if start != "auto" and start >= settings.length.time:
        raise CaseError(
            f"must be below the time of production, which is {settings.length.time:g} s: give a longer "
            "dem.max_time, or leave the start out",
            ("homogenize", "start"),
        )


def _particle_steps(case: Case, settings: Settings, steps: int) -> float:
    """Of all replicas with so many steps of production, filling included."""
    return case.dem.replicas * settings.particles * (steps + _fill_steps(settings))


def _seconds(case: Case, settings: Settings, steps: int, cores: int) -> float:
    """Wall time of that [s]."""
    together = min(case.dem.replicas, max(1, cores // settings.ranks))
    return _particle_steps(case, settings, steps) / (together * assumed_rate(settings.ranks))


def _space_plan(case: Case, cores: int, model: Model = "dem") -> Plan:
    """The plan of a vessel in space, which is computed by particles."""
    check_model_in_space(model)
    check_space(case)
    vessel = space_vessel(case)
    grid = space_grid(case, vessel)
    settings = choose(case, settings_vessel(vessel, grid), cores)
    _check_duration(case, settings, cores)
    stages = (
        Stage("walls", "LIGGGHTS needs a reservoir above the inlet, and a plate below each outlet"),
        _settle_stage(settings),
        Stage("produce", "a vessel in space is computed by particles"),
        Stage("field", "average in space, then take the nearest flow that conserves"),
        Stage("results", ", ".join(["field.npz", *case.export, *(f"figures: {name}" for name in case.figures)])),
    )
    left = (
        Stage("fluid, hybrid", "a vessel in space is computed by particles only"),
        *(stage for stage in _left_out_of_decks(case) if stage.name != "obstacle meshes"),
    )
    decisions = (*settings.decisions, *outlet_decisions(vessel, settings.plate_speed))
    return Plan(
        case=case,
        outline=vessel.outline,
        model="dem",
        grid=grid,
        settings=settings,
        submodels=(),
        followed=(),
        stages=stages,
        left_out=left,
        decisions=(*decisions, grid_decision(grid, settings.segments)),
        notes=check_space_flow(case, vessel),
        particle_steps=_particle_steps(case, settings, settings.steps),
        seconds=_seconds(case, settings, settings.steps, cores),
        disk_bytes=case.dem.replicas * (_disk(case, settings) + sums_memory(grid, settings.segments)),
        space=vessel,
    )


def _depth_gap(outline: Outline) -> Opening:
    """What particles must pass between the front and the back wall of a slab, all the way down."""
    depth = outline.measure.turn
    name, key = "gap between the front and the back wall", ("outline", "depth")
    return Opening(name, outline.z_bottom, 0.0, depth, depth, outline.outlet_area, True, key)


def _vessel(outline: Outline) -> Vessel:
    openings = find_openings(outline)
    axial = outline.measure.axial
    straight_inlet, straight_outlet = outline.straight_ends
    return Vessel(
        wall=tuple((float(r), float(z)) for r, z in outline.wall) if axial else tuple(_widths(outline)),
        volume=outline.volume(),
        openings=openings,
        shares=tuple(1.0 if p.required else min(1.0, p.area / float(outline.area(p.z))) for p in openings),
        widest=outline.widest_area(),
        straight_inlet=straight_inlet,
        straight_outlet=straight_outlet,
        measure=outline.measure,
    )


def _widths(outline: Outline) -> Iterator[tuple[float, float]]:
    """Width of a slab and height [m] from the top down; two at one height where a wall has a ledge."""
    for z in outline.levels.tolist():
        above, below = (float(outline.wall_radius(z, side) - outline.left_end(z, side)) for side in ("above", "below"))
        if z < outline.z_top:
            yield above, z
        if z > outline.z_bottom and (z == outline.z_top or abs(above - below) > outline.tolerance):
            yield below, z


def decisions_of(submodels: Iterable[tuple[Span, Plan]]) -> tuple[Decision, ...]:
    """The decisions of sub-models, each once."""
    return tuple(dict.fromkeys(decision for _, submodel in submodels for decision in submodel.decisions))


def assumed_rate(ranks: int) -> float:
    """Particle-steps per second that `Plan.seconds` goes by."""
    return RATE * ranks * (RANK_GAIN if ranks > 1 else 1.0)


def _settle_stage(settings: Settings) -> Stage:
    if settings.fall_steps:
        return Stage("settle", "a packed bed falls into place; it is topped up then and in the faster start")
    if packable(settings.classes):
        return Stage("settle", "a packed bed, topped up until the vessel is full, comes to rest")
    return Stage("settle", f"particles drop in until the vessel is full and at rest: sizes over {WIDEST:g} : 1")


def _left_out_of_decks(case: Case) -> list[Stage]:
    contact, left = case.contact, []
    if contact.rolling_model == "none" or max(contact.rolling_friction, contact.wall.rolling_friction) == 0:
        left.append(Stage("rolling model", "no rolling friction"))
    if max(contact.friction, contact.wall.friction) == 0:
        left.append(Stage("tangential history", "no friction"))
    if case.material.size.kind == "mono":
        left.append(Stage("size classes", "one size"))
    if case.dem.outlet == "open":
        left.append(Stage("moving plate", "the outlet is open"))
    if not case.outline.obstacles:
        left.append(Stage("obstacle meshes", "no obstacles"))
    return left


def _fill_steps(settings: Settings) -> float:
    if settings.fall_steps:
        return settings.fall_steps
    height = settings.feed_top - settings.plate_z
    return FILL_TIME * math.sqrt(2 * height / settings.gravity) / settings.time_step


def _disk(case: Case, settings: Settings) -> float:
    """Most bytes on disk at once: restart files (about 500 bytes a particle, contacts included) and snapshots."""
    restart = 8 * BYTES_PER_PARTICLE * settings.particles
    snapshots = BYTES_PER_PARTICLE * settings.particles
    kept = {"none": 3, "thinned": settings.segments, "all": settings.steps // settings.dump_every}
    return float(3 * restart + kept[case.dem.keep_snapshots] * snapshots)
