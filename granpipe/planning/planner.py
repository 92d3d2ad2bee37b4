"""The plans of a case whose vessel is an outline: by particles, as a fluid, or as a hybrid of both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.dem.gaps import check_gap
from granpipe.dem.settings import Settings, choose
from granpipe.dem.sizes import simulated_classes, size_classes
from granpipe.errors import CaseError, MeshError
from granpipe.field import Array, Box, Grid, section_rows
from granpipe.geometry.free_surfaces import voids
from granpipe.geometry.openings import Opening, find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.revolve import CHORD_ERROR, FEWEST_FACETS, Turn
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.cost import check_duration, disk_bytes, particle_steps, wall_seconds
from granpipe.planning.dem_vessel import dem_vessel, depth_gap
from granpipe.planning.doubts import doubts, size_hint, unit_hint
from granpipe.planning.flow import check_flow_rate
from granpipe.planning.plan import Model, Plan, Stage, decisions_of
from granpipe.planning.plane import check_model_between_walls, check_plane, depth_note
from granpipe.planning.sections import section_needs, section_ranges
from granpipe.planning.set_back import check_whole, walls_of
from granpipe.planning.stages import left_out_of_decks, settle_stage
from granpipe.planning.submodel import Span, spans, sub_case
from granpipe.planning.wall_factors import sections_without_law, wall_factor_decisions

CELLS_PER_DIAMETER = 4
"""Cells per Sauter diameter: smaller than the particles, as in Sparta & Halvorsen (2017); finer gains nothing."""

LEAST_CELLS = 4
"""Across the narrowest opening: a gate marks a field on fewer cells."""

CELLS_PER_OPENING = 40
"""Cells across the narrowest opening where there are no particles to measure by."""

CHORD_LIMIT = 0.15
"""Chord error of the wall in particle diameters beyond which a run is marked."""

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

HYBRID_GAIN = 0.8
"""`auto` takes the hybrid only where its DEM costs less than this part of a DEM run of the whole vessel."""


class Planner:
    """A case with what its plans derive from it once.

    Raises
    ------
    CaseError : the case asks for what is impossible, or for a model that cannot be right; of all methods
    """

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
            settings = choose(self.case, dem_vessel(walls.outline), self.cores)
        except CaseError as error:
            where = "between walls set back (dem.walls) " if back else ""
            raise self._with_hint(CaseError(where + error.message, error.key, error.place)) from None
        check_duration(self.case, settings, self.cores)
        reasons = "; ".join(f"{name}: {need.dem}" for name, need in self.needs.items() if need.dem)
        stages = [
            Stage("walls", "LIGGGHTS needs the walls in space, a reservoir and the outlet"),
            settle_stage(settings),
            Stage("produce", reasons or self._why_particles),
            Stage("field", f"average, then conserve by method {self.case.homogenize.method}"),
            self._results("dem"),
        ]
        left = [Stage("fluid solve", "the DEM run covers the whole vessel"), *left_out_of_decks(self.case)]
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
            particle_steps=particle_steps(self.case, settings, settings.steps),
            seconds=wall_seconds(self.case, settings, settings.steps, self.cores),
            disk_bytes=self.case.dem.replicas * disk_bytes(self.case, settings),
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
                check_gap(depth_gap(self.outline), classes, self.case.dem.coarse_grain_factor),
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
        plan = Planner(sub_case(varied(self.case, {"dem.walls": "as_drawn"}), span), self.cores).plan("dem")
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
