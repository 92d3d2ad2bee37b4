"""The fields of a study's points: whole and shorter averages, larger cells, other methods, all from the same segments.

Nothing is run here: production has left its sums, segment by segment, and the time that each took.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from granpipe.analysis.regrid import on_grid
from granpipe.case.schema import Case
from granpipe.errors import DataError
from granpipe.field import Array, Field
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.coarsen import coarsened
from granpipe.homogenize.statistics import BLOCKS, LEAST_BLOCKS, blocks, flux_errors
from granpipe.pipeline.averages import averaged_field, statistical_errors, steady_segments
from granpipe.pipeline.production import Production
from granpipe.pipeline.records import SegmentRecord, SettleRecord
from granpipe.pipeline.softness import as_rigid, mean_reference_overlap
from granpipe.planning.plan import Plan

WINDOWS, SHORTER = 7, 0.8
"""Lengths of a run that are looked at, and each over the one before: early ones are all transient."""


@dataclass(frozen=True)
class Method:
    """A way from segments to a field: how, and on cells how many times as large."""

    name: str
    joined: int = 1

    def changes(self, cell: float) -> dict[str, str]:
        """Of the case, that make a run use it on cells of its own, those of the study being of this size [m]."""
        found = {"homogenize.cell": f"{self.joined * cell:.6g}"}
        passes = {"rows": "0"}.get(self.name)
        if self.name in ("gaussian", "rows"):
            found["homogenize.method"] = "gaussian"
        return found if passes is None else found | {"homogenize.smoothing_passes": passes}

    def __str__(self) -> str:
        return self.name if self.joined == 1 else f"{self.name}, cells × {self.joined}"


PSI = Method("psi")
RAW = Method("raw")
METHODS = (PSI, Method("psi", 2), Method("psi", 4), Method("gaussian"), Method("rows"), RAW)
"""`rows` is the Gaussian method without smoothing, `raw` the plain average."""


@dataclass(frozen=True)
class FinishedRun:
    """A point that has particles, run.

    Parameters
    ----------
    plan : of the point, or of the one sub-model of a hybrid
    productions : its chains
    """

    plan: Plan
    productions: tuple[Production, ...]

    @cached_property
    def segments(self) -> list[Sums]:
        """The segments of all chains."""
        return [sums for production in self.productions for sums in production.sums()]

    @cached_property
    def _overlap(self) -> float:
        """Mean overlap where the reference packing is taken."""
        return mean_reference_overlap([production.reports() for production in self.productions])

    @cached_property
    def clocks(self) -> list[Array]:
        """Time [s] that each chain takes, settling included, up to the end of each of its segments.

        It is LIGGGHTS's processor time per rank: the wall time on cores that nothing else keeps busy.
        """
        return [_clock(production) for production in self.productions]

    @property
    def ends(self) -> list[float]:
        """Simulated times at which averages may end [s], the longest first."""
        run = min((p.run for p in self.productions), default=0)
        stops = [sums.stop for sums in self.segments if sums.run == run]
        counts = sorted({int(len(stops) * SHORTER**times) for times in range(WINDOWS)}, reverse=True)
        return [stops[count - 1] for count in counts if count * len(self.productions) >= LEAST_BLOCKS]

    def max_time(self, end: float) -> float:
        """`dem.max_time` of a run that ends at a simulated time [s]: a case counts from the end of a faster start."""
        return end - self.plan.dem.average_from

    def until(self, end: float) -> list[Sums]:
        """The segments up to a time, after the transient as a run of that length would see it, of rigid particles.

        Raises
        ------
        DataError : no segment is left after the transient
        """
        near = end * (1 + 1e-9)
        steady = steady_segments([sums for sums in self.segments if sums.stop <= near], self.plan)
        return as_rigid(steady, self._overlap)

    def seconds(self, end: float) -> float:
        """Time up to a simulated time: that of the slowest chain, for they run side by side."""
        seconds = []
        for production, clock in zip(self.productions, self.clocks, strict=True):
            reached = np.searchsorted(self._stops(production.run), end * (1 - 1e-9))
            seconds.append(clock[min(int(reached), len(clock) - 1)])
        return float(max(seconds))

    @cached_property
    def wall_seconds(self) -> float:
        """Wall time that the chains took one after the other, other programs beside them or not."""
        reports = (production.reports()[-1] for production in self.productions)
        return sum(report.wall_seconds for report in reports)

    def _stops(self, run: int) -> list[float]:
        return [sums.stop for sums in self.segments if sums.run == run]

    @property
    def cores(self) -> int:
        """How many cores the chains keep busy side by side."""
        return sum(production.reports()[-1].ranks for production in self.productions)


def _clock(production: Production) -> Array:
    """Segments note the time since LIGGGHTS was last started; where it falls, production was resumed."""
    seconds = [_per_rank(report) for report in production.reports()]
    resumed = np.cumsum([0.0, *(before if after < before else 0.0 for before, after in pairwise(seconds))])
    return _per_rank(SettleRecord.read(production.settled)) + resumed + seconds


def _per_rank(report: SettleRecord | SegmentRecord) -> float:
    return report.processor_seconds / report.ranks


@dataclass(frozen=True)
class Average:
    """A field on the point's own cells, and how many independent blocks its standard errors rest on."""

    field: Field
    blocks: float

    def errors(self, case: Case) -> dict[str, float]:
        """Statistical error of the whole and of each section."""
        return statistical_errors(self.field, case.outline.levels)


def field_of(plan: Plan, steady: Sequence[Sums], method: Method = PSI) -> Average:
    """The field of the average of some segments; DataError where they are too few for standard errors."""
    if len(steady) < LEAST_BLOCKS:
        raise DataError(f"{len(steady)} segments give no standard error; at least {LEAST_BLOCKS} are needed")
    segments = [coarsened(sums, method.joined) for sums in steady]
    case, diameter = _by(plan.case, method.name), plan.dem.classes.sauter_diameter
    made = averaged_field(case, plan.outline, segments, diameter)
    if method.name == "psi":
        inside = plan.outline.inside_fraction(plan.grid)
        return Average(on_grid(made.field, plan.grid, inside), made.figures["effective_blocks"])
    if method.name == "raw":
        flux_r, flux_z = merge(segments).mean_flux
        return _with_errors(
            replace(made.field, flux_r=flux_r, flux_z=flux_z), segments, diameter, lambda block: block.mean_flux
        )
    return _with_errors(
        made.field, segments, diameter, lambda block: _flux(averaged_field(case, plan.outline, [block], diameter).field)
    )


def _by(case: Case, method: str) -> Case:
    """The case with another method; what the planner settled stays."""
    if method == "psi":
        return case
    passes = case.homogenize.smoothing_passes if method == "gaussian" else 0
    changed = case.homogenize.model_copy(update={"method": "gaussian", "smoothing_passes": passes})
    return case.model_copy(update={"homogenize": changed})


def _flux(field: Field) -> tuple[Array, Array]:
    return field.flux_r, field.flux_z


def _with_errors(
    field: Field, segments: Sequence[Sums], diameter: float, make: Callable[[Sums], tuple[Array, Array]]
) -> Average:
    """The field with standard errors from how blocks differ that are each made a field of their own."""
    joined, fluxes = _blocks_made(segments, make)
    grid, run = field.grid, np.array([block.run for block in joined])
    errors, effective = flux_errors(fluxes, run, grid, diameter)
    return Average(replace(field, flux_r_se=errors[0], flux_z_se=errors[1]), effective)


def _blocks_made(
    segments: Sequence[Sums], make: Callable[[Sums], tuple[Array, Array]]
) -> tuple[list[Sums], list[tuple[Array, Array]]]:
    """Blocks and their fields; few long blocks where a level of a short one carries too little to be scaled."""
    for count in (min(len(segments), BLOCKS), LEAST_BLOCKS):
        joined = blocks(segments, count)
        try:
            return joined, [make(block) for block in joined]
        except DataError:
            continue
    raise DataError("the blocks of this average are too short for this method")


def methods_of(finished: FinishedRun) -> Iterator[Method]:
    """Methods that this point's cells allow; in a slab those of the vessel's own cells that need no rows of rings."""
    grid = finished.plan.grid
    methods = METHODS if grid.measure.axial else (PSI, RAW)
    return (method for method in methods if grid.shape[0] % method.joined == 0)
