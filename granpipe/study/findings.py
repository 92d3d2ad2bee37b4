"""What a study found: the error of every option against its reference, what it is made of, and what it took.

The error of an option has two parts. *Statistical* is the standard error of its own average. *Systematic* is what is
left of the difference from the reference when the noise of both is taken off; it belongs to the point and the method,
and is measured once, on the point's whole average.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from granpipe.analysis.compare import Cells, Difference, compare
from granpipe.case.reader import varied
from granpipe.case.schema import Case
from granpipe.dem.sizes import size_classes
from granpipe.errors import DataError
from granpipe.field import Array, Field, section_rows
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.pipeline.averages import statistical_errors
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.provenance import Provenance
from granpipe.pipeline.run import plan_case
from granpipe.planning.plan import Plan
from granpipe.progress import Progress
from granpipe.study.axes import FILLINGS, FINEST_SPEED, SEED, repeated_axis
from granpipe.study.budget import ErrorBound, Option, Size
from granpipe.study.fields import PSI, FinishedRun, Method, field_of, methods_of
from granpipe.study.inputs import INPUT, Input
from granpipe.study.reference import EarlierRun
from granpipe.study.scene import Scene
from granpipe.study.slopes import SAME_SETTING, AxisFit, AxisPoint, AxisSlope, Term, middles, same_setting, total
from granpipe.study.uncertainty import Part, Uncertainty, input_part, numerical_part, statistical_part
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import point_case
from granpipe.system.jsonfile import read_json
from granpipe.system.manifest import verify
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

ErrorBounds = dict[str, ErrorBound]
"""Section, or the whole → part of an error."""

SETTING: dict[str, Callable[[Plan], float]] = {
    # the setting of each axis that has a limit, in the power in which the error is expected to be linear
    "coarse_grain_factor": lambda plan: plan.dem.classes.sauter_diameter,
    "plate_speed": lambda plan: plan.dem.plate_speed,
    "youngs_modulus": lambda plan: plan.dem.youngs_modulus ** (-2 / 3),  # Hertz: overlaps go with this power
    "time_step": lambda plan: plan.dem.time_step,
    "mass_scaling": lambda plan: plan.dem.classes.mass_factor - 1,
}


_LABELS = {
    "coarse_grain_factor": "particle size",
    "plate_speed": "plate speed",
    "youngs_modulus": "stiffness",
    "time_step": "time step",
    "mass_scaling": "mass scaling",
}
"""Axis → what the table of uncertainty calls it."""

REFERENCE = "reference"
"""Name and axis of an earlier run that is the reference."""


@dataclass(frozen=True)
class StudyPoint:
    """A finished point of a study.

    Parameters
    ----------
    name, axis, changes : of its variant
    plan : its plan
    field : its best field: ψ fit, whole average
    finished : its segments; None where the point is no DEM run of the whole vessel
    seconds : time of its stages, as `FinishedRun.clocks` has it
    cores : that they kept busy
    forecast : of the wall time, by its plan, or None
    """

    name: str
    axis: str
    changes: Mapping[str, str]
    plan: Plan
    field: Field
    finished: FinishedRun | None
    seconds: float
    cores: int
    forecast: float | None

    @property
    def too_short(self) -> bool:
        """Whether its run has a field, but was too short for an error bar: then nothing can be compared with it."""
        return self.finished is not None and self.field.flux_z_se is None

    @property
    def diameter(self) -> float:
        """Largest Sauter diameter of its particles [m]; 0 without any."""
        return max((run.dem.classes.sauter_diameter for run in self.plan.runs), default=0.0)

    @property
    def setting(self) -> dict[str, float]:
        """Axis → value of the setting that has a limit."""
        return {axis: read(self.plan) for axis, read in SETTING.items()} if self.plan.settings else {}


@dataclass(frozen=True)
class Effect:
    """What one variant changes: error against the reference, and difference from the case as it stands.

    Parameters
    ----------
    point, axis : its name and axis
    seconds, cores, forecast : time taken, and the wall time that its plan foretold
    statistical : of the whole average
    systematic : difference from the reference without noise
    from_base : difference from the case itself without noise
    contributions : axis → the part of the error that comes from its setting, against the axis's limit
    predicted : difference from the reference that these together let expect; None where there are none
    measures : name → difference from the reference
    """

    point: str
    axis: str
    seconds: float
    cores: int
    forecast: float | None
    statistical: Mapping[str, float]
    systematic: ErrorBounds
    from_base: ErrorBounds
    contributions: Mapping[str, ErrorBounds]
    predicted: ErrorBounds | None
    measures: Mapping[str, float]


@dataclass(frozen=True)
class Findings:
    """All that a study found.

    Parameters
    ----------
    reference : name of the best point
    distance : section → how far it is itself from the limit: the material's own size, no speed, no softness, no
        step, no mass scaling
    unknown : axes of which no two points tell what they add to that
    options, effects : what was measured
    axis_fits : along each axis that has a limit
    scatter : how far fields of other fillings lie apart, over what their standard errors let expect; None without such
    spread : name → difference of the measures between halves of the reference
    rate : particle-steps per second of one core
    uncertainty : section → that of the case itself; none where its field has no error bar
    earlier : the earlier run that is the reference, where one was given
    """

    reference: str
    distance: Mapping[str, ErrorBound]
    unknown: tuple[str, ...]
    options: tuple[Option, ...]
    effects: tuple[Effect, ...]
    axis_fits: tuple[AxisFit, ...]
    scatter: float | None
    spread: Mapping[str, float]
    rate: float | None
    uncertainty: Mapping[str, Uncertainty]
    earlier: ReferenceRun | None = None


@dataclass(frozen=True)
class ReferenceRun:
    """The earlier run from which errors count.

    Parameters
    ----------
    folder : of its results, as it was given
    diameter : Sauter diameter of its particles [m]
    own_size : whether these are the material's own
    plate_speed : [m/s]; 0 where the outlet is open
    youngs_modulus : [Pa]
    time_step : [s]
    cell : of its own grid [m]
    statistical : section → standard error of its field
    blocks : effective blocks that these rest on
    failed : quality gates that it failed
    """

    folder: str
    diameter: float
    own_size: bool
    plate_speed: float
    youngs_modulus: float
    time_step: float
    cell: float
    statistical: Mapping[str, float]
    blocks: float
    failed: tuple[str, ...]


@dataclass(frozen=True)
class Notes:
    """What ``axes.json`` tells of the points, by name: their axes, and how long they were expected to take [s]."""

    axes: dict[str, str]
    forecast_seconds: dict[str, Size]


def load_points(folder: Folder, progress: Progress) -> list[StudyPoint]:
    """Every finished point, with its segments; nothing is run.

    Raises
    ------
    DataError : the results of a point are damaged
    """
    store = Store(folder.root.parent / ".store")
    notes = read_json(folder.root / "axes.json", Notes, "run the study again")
    tools = library_versions()
    done = [name for name in folder.variants if folder.is_done(name)]
    found = []
    for number, name in enumerate(done):
        progress.update(number / len(done), name)
        forecast = notes.forecast_seconds.get(name)
        found.append(_point(folder, name, notes.axes.get(name, ""), forecast, store, tools))
    return found


def _point(
    folder: Folder, name: str, axis: str, forecast: float | None, store: Store, tools: Mapping[str, str]
) -> StudyPoint:
    file = point_case(folder, name, ranks=1)
    plan, results = plan_case(file, cores=1), folder.points / name
    verify(results, "field.npz")
    field, provenance = Field.load(results / "field.npz"), Provenance.of_point(results)
    runs = [_finished_run(submodel, store, tools) for submodel in plan.runs]
    finished = runs[0] if plan.settings is not None else None
    cores = max((one.cores for one in runs), default=1)
    seconds = sum(one.seconds(np.inf) for one in runs)
    if finished is None:  # what is not DEM counts as well
        wall = provenance.wall_seconds
        waited = sum(one.wall_seconds for one in runs)
        seconds += wall - waited if wall > waited else wall  # the DEM may have been done before
    return StudyPoint(name, axis, folder.variants[name].changes, plan, field, finished, seconds, cores, forecast)


def _finished_run(plan: Plan, store: Store, tools: Mapping[str, str]) -> FinishedRun:
    """What the store has of a DEM run that is done."""
    versions = {**tools, **program_versions(store.root / "programs.json")}
    return FinishedRun(plan, finished_productions(plan, store, versions))


class Comparison:
    """Points that are done, compared with the best of them, or with an earlier run that is given."""

    def __init__(self, case: Case, points: Sequence[StudyPoint], earlier: EarlierRun | None = None) -> None:
        self.case, self.earlier = case, earlier
        self.points = [point for point in points if not point.axis.startswith(INPUT)]
        self.ends = [point for point in points if point.axis.startswith(INPUT)]
        self.levels = case.outline.levels
        self.base = points[0]
        self.reference = self._finest() if earlier is None else _reference_point(case, earlier, self.base.plan)

    def _finest(self) -> StudyPoint:
        particles = [point for point in self.points if point.finished and point.field.flux_z_se is not None]
        if not particles:
            raise DataError(
                "no DEM run of the study has an error bar: give more --hours, or average longer (dem.max_time)"
            )
        return min(particles, key=_accuracy_order)

    def findings(self, progress: Progress) -> Findings:
        """Everything, computed."""
        scene = Scene(self.case)
        best = scene.measures(self.reference.field)
        effects, options = [], list[Option]()
        for number, point in enumerate(self.points):
            progress.update(number / len(self.points), point.name)
            measures = dict(scene.measures(point.field).against(best)) if point is not self.reference else {}
            effects.append(self.effect(point, measures))
            options += self._options(point)
        if self.earlier is not None:
            effects.append(self.effect(self.reference, {}))
            options += self._reference_option(self.earlier)
        rates = [p.plan.particle_steps / p.seconds for p in self.points if p.finished and p.cores == 1]
        return Findings(
            reference=self.reference.name,
            distance=self.distance,
            unknown=self.unknown,
            options=tuple(options),
            effects=tuple(effects),
            axis_fits=tuple(slope.fit for slope in (*self.slopes.values(), self.finest_speed) if slope is not None),
            scatter=self.scatter,
            spread=self._spread(scene),
            rate=float(np.median(rates)) if rates else None,
            uncertainty=self.uncertainty(effects[0]),
            earlier=None if self.earlier is None else self._told(self.earlier),
        )

    def _told(self, earlier: EarlierRun) -> ReferenceRun:
        dem = earlier.plan.dem
        return ReferenceRun(
            folder=str(earlier.folder),
            diameter=dem.classes.sauter_diameter,
            own_size=self._at_own_size,
            plate_speed=dem.plate_speed,
            youngs_modulus=dem.youngs_modulus,
            time_step=dem.time_step,
            cell=earlier.field.grid.cell,
            statistical=self._statistical(self.reference),
            blocks=earlier.blocks,
            failed=earlier.failed,
        )

    @property
    def _at_own_size(self) -> bool:
        """Whether an earlier run with the material's own particles is the reference."""
        return self.earlier is not None and same_setting(self.reference.diameter, self._limit("coarse_grain_factor"))

    def uncertainty(self, base: Effect) -> dict[str, Uncertainty]:
        """Of the case itself: of the whole field and of every section; none where its field has no error bar."""
        if self.base.finished is None or self.base.field.flux_z_se is None:
            return {}
        grid, ends = self._grid_error(self.base.finished), self._between_ends()
        return {name: Uncertainty(tuple(self._parts(name, base, grid, ends))) for name in self._sections}

    def _parts(
        self, name: str, base: Effect, grid: ErrorBounds, ends: Mapping[str, tuple[tuple[str, ...], ErrorBounds]]
    ) -> Iterator[Part]:
        yield statistical_part(base.statistical[name])
        for axis, label in _LABELS.items():
            part = base.contributions.get(axis)
            if axis == "coarse_grain_factor" and self.case.dem.coarse_grain_factor == 1:
                yield Part(label, "numerical", 0.0, "the material's own size")
            elif axis == "plate_speed" and self.base.plan.dem.open_outlet:
                continue  # it flows as fast as it does in the process
            elif axis == "mass_scaling" and self.base.plan.dem.classes.mass_factor == 1:
                continue  # masses are the material's
            elif axis == "coarse_grain_factor" and self._at_own_size and base.systematic[name].upper:
                basis = "the reference has the material's own size; half the 95 % bound of the difference from it"
                yield numerical_part(label, base.systematic[name], basis)
            elif part is None:
                yield numerical_part(label, None, f"not determined: --axis {axis}")
            else:
                fit = self.slopes[axis].fit
                basis = f"{fit.points} runs, order {fit.order:g}, against the limit; half its 95 % bound"
                yield numerical_part(label, part[name], basis)
        basis = "cells twice as large, first order; half the difference"
        yield numerical_part("grid", grid.get(name), basis if grid else "not determined: the average is too short")
        for key, (values, apart) in ends.items():
            yield input_part(key, values, apart.get(name))

    def _grid_error(self, finished: FinishedRun) -> ErrorBounds:
        """The field against that on cells twice as large, from the same segments, so that there is no noise to it."""
        if not finished.ends:
            return {}
        try:
            coarse = field_of(finished.plan, finished.until(finished.ends[0]), Method("psi", 2)).field
        except DataError:  # too short for a field of its own
            return {}
        found = compare(self.base.field, coarse, self.levels, self.base.diameter)
        return {one.name: ErrorBound(one.observed, one.observed) for one in found}

    def _between_ends(self) -> dict[str, tuple[tuple[str, ...], ErrorBounds]]:
        """Input → the ends of its range, and the difference between the fields there; none where one is missing."""
        found: dict[str, tuple[tuple[str, ...], ErrorBounds]] = {}
        for axis in dict.fromkeys(point.axis for point in self.ends):
            one = Input.of(axis)
            points = [self._at(one, end) for end in one.ends]
            low, high = points
            found[one.key] = (one.ends, self._difference(low, high.field, high) if low and high else {})
        return found

    def _at(self, one: Input, end: str) -> StudyPoint | None:
        """The point at an end of an input's range, which may be the case itself."""
        for point in self.ends:
            if point.axis == one.axis and point.changes[one.key] == end:
                return point
        return self.base if varied(self.case, {one.key: end}).model_dump() == self.case.model_dump() else None

    def effect(self, point: StudyPoint, measures: Mapping[str, float]) -> Effect:
        """What one point changes, and what its error is made of.

        Raises
        ------
        DataError : the fields have different grids
        """
        return Effect(
            point=point.name,
            axis=point.axis,
            seconds=point.seconds,
            cores=point.cores,
            forecast=point.forecast,
            statistical=self._statistical(point),
            systematic=self._difference(self.reference, point.field, point),
            from_base=self._difference(self.base, point.field, point),
            contributions={
                axis: self._contribution(slope, axis, point)
                for axis, slope in self._slopes_near(point).items()
                if point.setting
            },
            predicted=self._predicted(point) if point.setting and self.slopes else None,
            measures=measures,
        )

    @property
    def _sections(self) -> list[str]:
        return ["whole", *self.levels]

    def _statistical(self, point: StudyPoint) -> dict[str, float]:
        """Of the point's field; none where nothing is noisy."""
        if point.field.flux_r_se is None:
            return dict.fromkeys(self._sections, 0.0)
        return statistical_errors(point.field, self.levels)

    def _difference(self, base: StudyPoint, field: Field, point: StudyPoint) -> ErrorBounds:
        """Difference of a field of a point from the best field of another, noise taken off.

        There is none from itself, nor from more or less of the same runs, whose noise would not be independent.
        """
        if self._alike(base, point):
            return dict.fromkeys(self._sections, ErrorBound(0.0, 0.0))
        found = compare(base.field, field, self.levels, max(base.diameter, point.diameter))
        return {difference.name: _bound(difference) for difference in found}

    def _alike(self, one: StudyPoint, other: StudyPoint) -> bool:
        """Whether two points are of the same runs."""
        if one is other or self.earlier is None or REFERENCE not in (one.axis, other.axis):
            return _runs(one) == _runs(other)
        return self.earlier.is_of(other.plan if one.axis == REFERENCE else one.plan)

    def _from_earlier(self, field: Field, point: StudyPoint) -> ErrorBounds:
        """Difference of a field of a point from an earlier run that is the reference; none where it is no such run."""
        return {} if self.earlier is None else self._difference(self.reference, field, point)

    def systematic(self, field: Field, point: StudyPoint) -> ErrorBounds:
        """Difference of a field of a point from the limit, noise taken off.

        The limit is the reference less what its settings add. Its noise is that of the points that tell this, so that
        where these are the point itself, theirs is not independent.
        """
        terms = self._from_limit(self.reference)
        if not self._alike(self.reference, point):
            terms += [Term(1.0, field, point.name), Term(-1.0, self.reference.field, self._reference_run)]
        return self._norms(terms, np.where(field.bulk & self.reference.field.bulk, self._weight, 0.0), point)

    def _options(self, point: StudyPoint) -> Iterator[Option]:
        if point.finished is None:
            yield Option(
                point=point.name,
                method=point.plan.model,
                travel=0.0,
                seconds=point.seconds,
                cores=point.cores,
                statistical=self._statistical(point),
                blocks=np.inf,
                systematic=self.systematic(point.field, point),
                changes=dict(point.changes),
                from_reference=self._from_earlier(point.field, point),
            )
            return
        for method in methods_of(point.finished) if point is self.base else [PSI]:
            if method == PSI or point is not self.reference:
                yield from self._lengths(point, point.finished, method)

    def _reference_option(self, earlier: EarlierRun) -> Iterator[Option]:
        """The reference as a setting of its own, where its time is told; its systematic error is its distance."""
        if earlier.seconds is None:
            return
        yield Option(
            point=self.reference.name,
            method=str(PSI),
            travel=earlier.travel / earlier.plan.outline.outlet_width,
            seconds=earlier.seconds,
            cores=earlier.cores,
            statistical=self._statistical(self.reference),
            blocks=earlier.blocks,
            systematic=self.distance,
            changes=earlier.changes,
            from_reference=self._from_earlier(self.reference.field, self.reference),
        )

    def _lengths(self, point: StudyPoint, finished: FinishedRun, method: Method) -> Iterator[Option]:
        """A method on averages of every length; those that are too short for it are left out."""
        systematic: ErrorBounds | None = None
        from_reference: ErrorBounds = {}
        for end in finished.ends:
            try:
                average = field_of(finished.plan, finished.until(end), method)
            except DataError:
                continue
            if systematic is None:
                systematic = self.systematic(average.field, point)
                from_reference = self._from_earlier(average.field, point)
            yield Option(
                point=point.name,
                method=str(method),
                travel=self._travel(finished, end),
                seconds=finished.seconds(end),
                cores=finished.cores,
                statistical=average.errors(self.case),
                blocks=average.blocks,
                systematic=systematic,
                changes=dict(point.changes)
                | {"dem.max_time": f"{finished.max_time(end):.4g}"}
                | method.changes(finished.plan.grid.cell),
                from_reference=from_reference,
            )

    def _travel(self, finished: FinishedRun, end: float) -> float:
        averaged = sum(sums.duration for sums in finished.until(end))
        outline, speed = finished.plan.outline, finished.plan.dem.inlet_speed
        at_outlet = speed * outline.inlet_area / outline.outlet_area
        return averaged * at_outlet / outline.outlet_width

    def _spread(self, scene: Scene) -> dict[str, float]:
        """Differences of the measures between halves of the reference: their uncertainty."""
        finished = self.reference.finished
        if finished is None:  # of an earlier run there is the field alone
            return {}
        segments = finished.until(np.inf)
        half = len(segments) // 2
        halves = segments[:half], segments[half:]
        if finished.plan.case.dem.replicas > 1 or half < LEAST_BLOCKS:
            return {}
        try:
            first, second = (scene.measures(field_of(finished.plan, some).field) for some in halves)
        except DataError:
            return {}  # a half is too short for a field
        return dict(first.against(second))

    @cached_property
    def slopes(self) -> dict[str, AxisSlope]:
        """Axis → how the field changes along it, where two points or more tell."""
        found = {}
        for axis in SETTING:
            along = [point for point in self.points if _axis(point) in ("", axis) and point.setting]
            if len({point.setting[axis] for point in along}) > 1:
                found[axis] = self._slope(axis, axis, along)
        return found

    @cached_property
    def scatter(self) -> float | None:
        """How far fields of the same settings in other fillings lie apart, over what their standard errors let expect.

        The root mean square over all pairs of them; None where there is none. A filling has much in common with itself
        for longer than a run lasts, of which its standard error tells nothing.
        """
        known = [point for point in self.points if point.finished and point.field.flux_z_se is not None]
        pairs = [pair for pair in combinations(known, 2) if _bed(pair[0]) == _bed(pair[1]) and not self._alike(*pair)]
        found = [compare(one.field, other.field, {}, max(one.diameter, other.diameter))[0] for one, other in pairs]
        squares = [(apart.observed / apart.noise) ** 2 for apart in found if apart.noise > 0]
        return float(np.sqrt(np.mean(squares))) if squares else None

    @property
    def _noise(self) -> float:
        """By how much squares of noise are larger than runs tell, as their fillings do."""
        return max(1.0, self.scatter or 1.0) ** 2

    @cached_property
    def finest_speed(self) -> AxisSlope | None:
        """How the field of the finest particles changes with the plate's speed, where two points or more tell."""
        fast = [point for point in self.points if point.axis == FINEST_SPEED and point.setting]
        sizes = [point for point in self.points if _axis(point) == "coarse_grain_factor" and point.setting]
        along = fast + [point for point in sizes if fast and same_setting(point.diameter, fast[0].diameter)]
        if len({point.setting["plate_speed"] for point in along}) < 2:
            return None
        return self._slope(FINEST_SPEED, "plate_speed", along)

    def _slope(self, name: str, axis: str, along: Sequence[StudyPoint]) -> AxisSlope:
        points = [AxisPoint(point.setting[axis], point.field, point.name) for point in along]
        return AxisSlope.of(name, points, self._limit(axis), self._noise)

    def _slopes_near(self, point: StudyPoint) -> dict[str, AxisSlope]:
        """The slopes by points whose particles are as large as those of this one as may be."""
        finest = min((one.diameter for one in self.points if one.axis == FINEST_SPEED), default=0.0)
        if self.finest_speed is None or point.diameter**2 > finest * self.base.diameter:
            return self.slopes
        return self.slopes | {"plate_speed": self.finest_speed}

    @cached_property
    def distance(self) -> ErrorBounds:
        """Section → difference of the reference from the limit, by the axes that tell it."""
        return self._norms(self._from_limit(self.reference), self._weight, self.reference)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Axes along which the reference is away from the limit, and no two points tell how far."""
        setting, slack = self.reference.setting, 1 + SAME_SETTING
        return tuple(axis for axis in setting if axis not in self.slopes and setting[axis] > slack * self._limit(axis))

    def _limit(self, axis: str) -> float:
        """The material's own size; no speed, no softness, no step, no mass scaling."""
        if axis != "coarse_grain_factor":
            return 0.0
        return size_classes(self.case.material.size).sauter_diameter

    def _contribution(self, slope: AxisSlope, axis: str, point: StudyPoint) -> ErrorBounds:
        return self._norms(slope.change(point.setting[axis], slope.limit), slope.weight, point)

    def _predicted(self, point: StudyPoint) -> ErrorBounds:
        """The changes along all axes from the reference's settings to the point's, added."""
        return self._norms(self._changes(self.reference.setting, point), self._weight, point)

    def _from_limit(self, point: StudyPoint) -> list[Term]:
        """What the settings of a point add to the limit: a sum of fields."""
        return self._changes({axis: self._limit(axis) for axis in SETTING}, point)

    def _changes(self, base: Mapping[str, float], point: StudyPoint) -> list[Term]:
        """The changes along all axes from these settings to the point's: a sum of fields."""
        slopes = self._slopes_near(self.reference)
        return [term for axis, slope in slopes.items() for term in slope.change(point.setting[axis], base[axis])]

    @property
    def _reference_run(self) -> str:
        """Name of the point whose run is the reference."""
        same = (point.name for point in self.points if self._alike(self.reference, point))
        return next(same, self.reference.name)

    @cached_property
    def _weight(self) -> Array:
        """(nz, nr) area of each ring, 0 where a field that tells of the limit is no bulk [m²]."""
        weights = [slope.weight for slope in self._slopes_near(self.reference).values()]
        grid = self.reference.field.grid
        return np.asarray(np.min([np.broadcast_to(grid.ring_area, grid.shape), *weights], axis=0))

    def _norms(self, terms: Sequence[Term], weight: Array, point: StudyPoint) -> ErrorBounds:
        """Size of a sum of fields over the whole and each section, relative to the reference, its noise taken off."""
        best = self.reference.field
        velocity, variance = total(terms, best.grid)
        variance *= self._noise
        cells = Cells(weight, (middles(best) ** 2).sum(axis=0), (velocity**2).sum(axis=0), variance)
        shared = max(1.0, (max(point.diameter, self.reference.diameter) / best.grid.cell) ** 2)
        rows = section_rows(best.grid, self.levels)
        return {name: _bound(cells.compare(name, at, shared)) for name, at in rows.items()}


def _reference_point(case: Case, earlier: EarlierRun, plan: Plan) -> StudyPoint:
    """An earlier run as a point: its field on the cells of the study, at the flow rate of the case."""
    return StudyPoint(
        name=REFERENCE,
        axis=REFERENCE,
        changes={},
        plan=earlier.plan,
        field=earlier.at(case, plan.grid, plan.outline.inside_fraction(plan.grid)),
        finished=None,
        seconds=earlier.seconds or 0.0,
        cores=earlier.cores,
        forecast=None,
    )


def _runs(point: StudyPoint) -> dict[str, Any]:
    """What makes a point's runs what they are, but for how many they are and how long, and on how many ranks."""
    return point.plan.case.model_dump(
        exclude={"name": True, "dem": {"replicas", "max_time", "ranks"}, "homogenize": {"start"}}
    )


def _axis(point: StudyPoint) -> str:
    """The axis along which a point lies, whatever its filling."""
    return repeated_axis(point.changes) if point.axis in (SEED, FILLINGS) else point.axis


def _bed(point: StudyPoint) -> dict[str, Any]:
    """What makes a point's runs what they are, but for their filling."""
    runs = _runs(point)
    del runs["dem"]["seed"]
    return runs


def _accuracy_order(point: StudyPoint) -> tuple[float, float, float]:
    """Finest particles first, then the slowest plate, then the longest average."""
    assert point.finished is not None
    averaged = sum(sums.duration for sums in point.finished.segments)
    return point.diameter, point.plan.dem.plate_speed, -averaged


def _bound(difference: Difference) -> ErrorBound:
    return ErrorBound(difference.noise_free, difference.upper)
