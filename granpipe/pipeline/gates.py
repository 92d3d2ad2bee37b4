"""Gates and notes: every measured figure that has a limit, defined once; `gates_page` writes them down for users.

A run that fails a gate keeps its results, marked, and ends with status 4. A note tells what to keep in mind of a result
that is right as far as it goes; it marks nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from granpipe.dem.contact import MEAN_OVERLAP, P99_OVERLAP
from granpipe.field import Array, Field, level_flow
from granpipe.homogenize.statistics import LEAST_BLOCKS
from granpipe.planning.plan import Plan
from granpipe.planning.planner import LEAST_CELLS
from granpipe.planning.within_error import FEWEST_DIAMETERS as FEWEST_OF_FRICTION

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Gate:
    """One measured figure, its limit in words, and whether it holds."""

    name: str
    value: float
    limit: str
    passed: bool

    def as_dict(self) -> dict[str, Any]:
        """For ``provenance.json``."""
        return asdict(self)

    def of(self, part: str) -> Gate:
        """The same gate, named as that of a part of the run."""
        return replace(self, name=f"{part}: {self.name}")

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.3g}, must be {self.limit}"


@dataclass(frozen=True)
class Limit:
    """A figure that a run measures, and between which limits it must lie.

    Parameters
    ----------
    name : of the figure
    models : for which models it is measured
    why : what is wrong beyond the limits, and what was measured for them
    low, high : the limits
    remedy : what a user can do
    percent : whether the figure is a part of something
    """

    name: str
    models: str
    why: str
    low: float = -math.inf
    high: float = math.inf
    remedy: str = ""
    percent: bool = False

    def gate(self, value: float, where: str = "", remedy: str | None = None) -> Gate:
        """The gate for a measured value; what is not a number fails, what differs from a limit by rounding holds."""
        remedy = self.remedy if remedy is None else remedy
        return Gate(
            f"{self.name}{where}",
            value,
            f"{self.range}{f' ({remedy})' if remedy else ''}",
            bool(self.low - _ROUNDING * abs(self.low) <= value <= self.high + _ROUNDING * abs(self.high)),
        )

    @property
    def range(self) -> str:
        """The limits in words."""
        low, high = (f"{one:.3g}" if not self.percent else f"{100 * one:.3g}%" for one in (self.low, self.high))
        if math.isinf(self.low) and math.isinf(self.high):
            return "as the case has it"
        if math.isinf(self.low):
            return f"at most {high}"
        return f"at least {low}" if math.isinf(self.high) else f"{low} to {high}"


PARTICLES, ANY, FLUID = "dem, hybrid", "dem, fluid, hybrid", "fluid, hybrid"

LEVEL_FLOW = Limit(
    "raw flow through the worst level less what gathers below it, relative to the plug's",
    PARTICLES,
    "Before any adjustment every level must carry what the plate takes away, but for what the measured change of the "
    "filling explains. More is a fault of the average, not noise.",
    high=0.05,
    percent=True,
    remedy="average longer: dem.max_time",
)
STORAGE = Limit(
    "part of the flow that gathers between the plug and the worst level",
    PARTICLES,
    "The field is made steady by taking this part off; what is taken off is uncertain by a fifth of itself. Beyond 20 "
    "% no field is made at all.",
    high=0.1,
    percent=True,
    remedy="average later or longer: homogenize.start, dem.max_time",
)
STATISTICAL_ERROR = Limit(
    "statistical error",
    PARTICLES,
    "The limit is `dem.statistical_error` of the case, which every section must reach; there is no gate where the case "
    "gives none.",
    percent=True,
)
BLOCKS = Limit(
    "independent blocks",
    PARTICLES,
    "Of how many independent stretches the error is made: an error bar from 20 is itself uncertain by 16 %.",
    low=20,
)
TRAVEL = Limit(
    "travel of the widest level during the average, in particle diameters",
    PARTICLES,
    "An error that is told by how a run scatters in time holds nothing of what changes more slowly than the run is "
    "long: how the particles lie. Over less than two diameters, fields of four seeds in two vessels scatter by up to "
    "1.7 times the error that they tell (1.9 in the worst section); see `benchmarks/short_averages.py`.",
    low=2,
)
SEGMENTS = Limit(
    "segments averaged",
    PARTICLES,
    "How far a field is off by chance is told by how segments of its run differ. Fewer than seven tell nothing: the "
    "field has no error bar then. `homogenize.method: gaussian` gives none at all.",
    low=LEAST_BLOCKS,
    remedy="average longer: dem.max_time",
)
MORE_SNAPSHOTS = "average more snapshots"
"""The remedy for dumps that a user brings."""

SIZE_SHARE = Limit(
    "mass share of the worst size class, deviation",
    PARTICLES,
    "The bed must hold the sizes that the case describes.",
    high=0.02,
)
OVERLAPS = tuple(
    Limit(
        f"{name} overlap of particles",
        PARTICLES,
        "Of the flowing bed, over the average. Softer particles than these flow differently and pack denser.",
        high=high,
        remedy="contact.youngs_modulus",
    )
    for name, high in (("mean", MEAN_OVERLAP), ("99th percentile of the", P99_OVERLAP))
)
FORCES_BALANCE = Limit(
    "weight of the bed that neither contacts nor walls bear",
    "dem, with `homogenize.fields: [stress]`",
    "Between the lowest and the highest level of the vessel the forces of the contacts must bear the weight; where "
    "they do not, contacts are missing or the bed is not steady.",
    high=0.05,
    percent=True,
    remedy="average longer: dem.max_time",
)
DISCHARGE = Limit(
    "discharge rate, deviation from LIGGGHTS' own counter",
    PARTICLES,
    "Of an open outlet. Two standard errors of the rate are allowed where they are more.",
    high=0.01,
    percent=True,
)
PACKING = Limit(
    "reference packing",
    PARTICLES,
    "Of the plug above a plate, or of the bed above an open outlet. "
    "Spheres that are looser are not at rest against each other, denser ones overlap.",
    low=0.5,
    high=0.68,
)
SMOOTHING = Limit(
    "change of the field by smoothing, beyond noise",
    PARTICLES,
    "Smoothing may take away noise and layers of particles, no more: √(E² − noise²), E the relative difference of the "
    "final field from the raw average, both seen through a Gaussian of half a diameter. Measured on the smoke scene: 0 "
    "with `method: psi` and with 2 passes of the Gaussian, 9.7 % with 10, 22 % with 100.",
    high=0.1,
    percent=True,
    remedy="fewer homogenize.smoothing_passes, or homogenize.method: psi",
)
CONSERVING = Limit(
    "change of a field in space by conserving, beyond noise",
    PARTICLES,
    "In space the flow is taken that conserves and is nearest to the average. It may differ by noise, no more: "
    "√(E² − noise²) as for smoothing, each level of the average scaled to the field's own flow. Measured: 0 on a "
    "square hopper whose statistical error was 20 %; a sidewise flow that no wall allows, of half the flow, is a mark.",
    high=0.1,
    percent=True,
    remedy="average longer: dem.max_time",
)
OUTLET_SHARE = Limit(
    "share of an outlet in the flow apart from the one asked for",
    "dem of a vessel in space with several outlets",
    "The plates take the shares by volume of the bed; solids packed looser above one of them leave with fewer. The "
    "field has the shares that were asked for.",
    high=0.03,
    percent=True,
    remedy="average longer: dem.max_time",
)
SPACE_BLOCKS = Limit(
    "independent blocks behind the error bars in space",
    "dem of a vessel in space, and dumps in space",
    "Blocks of segments over their correlation time, of the component that is correlated longest. Measured down to "
    "six: with Student's t of one degree of freedom less, 93 to 95 % of the 95 % intervals hold. With fewer it is not "
    "known. No gate where there are fewer than seven segments, and so no error bars.",
    low=6,
    remedy="average longer: dem.max_time",
)
ASYMMETRY = Limit(
    "flow that is not the same all round",
    PARTICLES,
    "Amplitude a of a flow ∝ 1 + a cos θ (to one side) or 1 + a cos 2θ around the axis, 0 where it is less than four "
    "standard errors. A field of r and z cannot show it: the flow at one place differs from it by a/√2. Without any "
    "such flow the chance of an alarm is 3e-4 for each amplitude.",
    high=0.1,
    percent=True,
    remedy="average longer, or keep in mind that the flow is not axisymmetric",
)
SURFACE = Limit(
    "change of the field if a bent free surface had one slope",
    PARTICLES,
    "The surface of a material at rest has one slope. One that is bent, in a section that turned over less than once, "
    "may be left from the filling. It counts by what flows between it and a surface as steep as the half that flows "
    "more: E of the section. 0 where the halves differ by less than three standard errors, or are shorter than two "
    "particle diameters. In the test reactor the outer half is flatter by 12 to 35° in eighteen runs of five sizes, "
    "whatever the filling, over solids that hardly move: 0.2 to 0.9 %.",
    high=0.02,
    percent=True,
    remedy="average longer, until the section has turned over: dem.max_time",
)
UPWARD = Limit(
    "upward flow through the worst level, relative to the whole flow",
    ANY,
    "Solids that empty by their weight do not flow upwards on average, but a viscous fluid does, in eddies above "
    "ledges (2.6 to 4.3 % of the flow were measured) and flat floors (10 to 340 %). Cones of a half-angle up to 70°: "
    "0; steps of a tenth of the radius: 0.7 %; DEM of the smoke scene: 0.01 %.",
    high=0.01,
    percent=True,
    remedy="the sections there need particles: model: dem or hybrid",
)
PEAK = Limit(
    "fastest downward velocity over the mean of its level",
    FLUID,
    "In mass flow the core is about twice as fast as the mean. Measured: cones of up to 45° with any wall factor from "
    "0.1 on 1.1 to 2.9, obstacles 1.4 to 1.8, flat floors and ledges 4.6 and more. Where a hybrid follows particles, "
    "and within a diameter of an outlet whose profile the case gives, it does not count.",
    high=3.0,
    remedy="the sections there need particles: model: dem or hybrid",
)
CLEAN_UP = Limit(
    "velocity that was not divergence-free before ψ replaced it",
    FLUID,
    "The elements conserve only on average; the stream function conserves exactly and replaces their velocity. "
    "Measured: 1e-14 (pipe) to 0.75 % in vessels, 1.6 % with an annular outlet of a hundredth of the radius, 47 % with "
    "one of 1e-8 cm.",
    high=0.03,
    percent=True,
    remedy="make narrow openings wider, fluid.force_factor smaller, or fluid.order larger",
)
RESIDUAL = Limit(
    "residual of the fluid's linear system",
    FLUID,
    "At most 6e-14 was measured; above 1e-8 there is no result.",
    high=1e-10,
)
TENSION = Limit(
    "part of a frictional fluid that would have to pull",
    FLUID,
    "Where the pressure is not positive the solids come apart: a free surface or an arch that the fluid does not know.",
    high=0.05,
    percent=True,
    remedy="use particles there: model: dem or hybrid",
)
REGULARIZATION = Limit(
    "change of a frictional fluid's field with twice the regularization",
    FLUID,
    "Slow shear is viscous below a regularization of 0.03 U/R; the field must not depend on it.",
    high=0.02,
    percent=True,
    remedy="use particles: model: dem",
)
MESH = Limit(
    "change of a frictional fluid's field with a coarser mesh",
    FLUID,
    "10 triangles across in place of 14. In seven vessels (`benchmarks/friction_floors.py mesh`) that changed 0.1 to "
    "1.0 %; 28 triangles changed 1 to 2 times as much, at most 1.1 %.",
    high=0.02,
    percent=True,
    remedy="use particles: model: dem",
)
FEWEST_DIAMETERS = Limit(
    "narrowest opening of a frictional fluid, in particle diameters",
    FLUID,
    "Narrower openings flow in jerks, which a steady fluid does not know; the fluid was compared with DEM from 10 on.",
    low=FEWEST_OF_FRICTION,
    remedy="use particles: model: dem",
)
CONSERVED = Limit(
    "flow through the worst level, deviation from the flow asked for",
    FLUID,
    "The field conserves by construction, to rounding.",
    high=1e-9,
)
CELLS = Limit(
    "cells of the grid across the narrowest opening",
    ANY,
    "On fewer cells the velocity in an opening is an average over most of it. By default there are 40 (fluid), or 4 in "
    "a particle diameter.",
    low=LEAST_CELLS,
    remedy="homogenize.cell",
)
IN_SOLID = Limit(
    "part of a level's flow that passes it in the drawn solid",
    "dem, between walls set back",
    "What enlarged particles carry beyond the drawn walls is left out, and the rest of the level raised by it. In the "
    "vessels in which that was compared with the material's own particles it was 1 to 3 %, in the test reactor 3 to "
    "8 %.",
    high=0.1,
    percent=True,
    remedy="a smaller dem.coarse_grain_factor",
)
FOLLOWED = Limit(
    "difference of the fluid from the flow that it follows",
    "hybrid",
    "Relative difference E in the sections that were simulated. Measured: 0.1 to 1.8 % with the force as it is by "
    "default, 5 to 7 % with one that is a thousand times weaker or more.",
    high=0.05,
    percent=True,
    remedy="a larger fluid.force_factor",
)
SEAM = Limit(
    "difference at a seam",
    "hybrid",
    "Relative difference E, beyond noise, of a fluid that follows nothing from the particles in the margin where the "
    "two meet. There both describe the same flow, or the section beyond the margin is not one for a fluid. Measured: "
    "22 % in hopper and throat of the test reactor; 54 % where the core of a pipe is twice as fast as its mean, 76 % "
    "where it is four times as fast.",
    high=0.35,
    percent=True,
    remedy="model: dem for the section beyond it",
)
BREACH = Limit(
    "setting of the case",
    ANY,
    "A value outside the stable or accurate range is taken as it is, and the result is marked. `granpipe plan` shows "
    "it before the run.",
)

GATES = (
    BREACH,
    UPWARD,
    CELLS,
    IN_SOLID,
    LEVEL_FLOW,
    STORAGE,
    SEGMENTS,
    STATISTICAL_ERROR,
    BLOCKS,
    TRAVEL,
    FORCES_BALANCE,
    DISCHARGE,
    PACKING,
    SIZE_SHARE,
    *OVERLAPS,
    SMOOTHING,
    CONSERVING,
    OUTLET_SHARE,
    SPACE_BLOCKS,
    ASYMMETRY,
    SURFACE,
    PEAK,
    CLEAN_UP,
    RESIDUAL,
    TENSION,
    REGULARIZATION,
    MESH,
    FEWEST_DIAMETERS,
    CONSERVED,
    FOLLOWED,
    SEAM,
)
"""Every gate, in the order of the page."""

TURNOVERS = Limit(
    "turnovers of a section during the average",
    PARTICLES,
    "Below one the section still holds what it was filled with, so its packing, the mixture of sizes and the shape of "
    "heaps may depend on the filling. Not a gate: a velocity is steady long before. In the test reactor, whose field "
    "is within 10 % of that of an independent run, the shaft turns over 0.3 times, the sections with heaps 0.2 times.",
    low=1,
)
UNEVEN = Limit(
    "amplitude of a flow that is not the same all round, or swirl, in standard errors",
    PARTICLES,
    "Three standard errors are exceeded by chance in 1 % of cases: a hint that asks for a look or a longer average.",
    high=3,
)
TREND = Limit(
    "trend of the solids or of their kinetic energy",
    PARTICLES,
    "Chance that a steady run shows such a trend, by Student's t on blocks. Not a gate: what a trend of the solids "
    "does to the balance is measured by the level flow and the storage, which are.",
    low=0.01,
)
SCATTER = Limit(
    "scatter of the replicas over the standard error",
    PARTICLES,
    "Replicas that lie farther apart than their error bars allow: the bars are too small by about this factor. Not a "
    "gate: few replicas give the factor itself only roughly.",
    high=2,
)
PACKING_APART = Limit(
    "packing fraction of the simulated bed apart from that of the case's bulk density",
    PARTICLES,
    "Soft particles alone make 3 %. Not a gate: velocities follow the bulk density that the case gives.",
    high=0.03,
    percent=True,
)
NOTES = (TURNOVERS, UNEVEN, TREND, SCATTER, PACKING_APART)
"""Every measured note, in the order of the page."""

LEAST_BEND = 3
"""Standard errors below which a bend of a free surface is none for the gate."""

TOLD_BEND = 10
"""Degrees beyond which the slopes of both halves of a free surface are told."""

LEAST_ASYMMETRY = 4
"""Standard errors below which an asymmetry is none for the gate."""

_SHAPES = ("to one side", "to two sides")


def level_flow_gates(raw_flow: Array, gathered: Array, solids_flow: float, duration: float) -> list[Gate]:
    """Balance of every level (n,) before any adjustment against the flow in the plug [m³/s].

    Parameters
    ----------
    raw_flow : through every level
    gathered : what of it the change of the filling between the plug and the level explains
    solids_flow : in the plug
    duration : simulated time that was averaged [s], for a forecast of what is missing
    """
    balance = np.abs((raw_flow - gathered) / solids_flow - 1)
    storage = float(np.abs(gathered / solids_flow).max())
    remedy = None
    if storage > STORAGE.high:  # a volume that fills or empties once is a share of the flow that falls as 1/t
        more = duration * (storage / STORAGE.high - 1)
        remedy = f"{STORAGE.remedy}, about {more:.2g} s more if no other part of the vessel begins to fill"
    return [LEVEL_FLOW.gate(float(balance.max())), STORAGE.gate(storage, remedy=remedy)]


def error_gates(
    errors: Mapping[str, float], effective: float, travel: float, target: float, duration: float
) -> list[Gate]:
    """Statistical error of the worst section and of the whole, and on how much it rests.

    Parameters
    ----------
    errors : section → statistical error of the final field; empty where it is not known
    effective : independent blocks
    travel : of the widest level during the average, in particle diameters
    target : the error that the case allows
    duration : simulated time that was averaged [s], for a forecast of what is missing
    """
    worst = max(errors, key=errors.__getitem__, default="whole")
    missing = missing_time(errors, effective, travel, target, duration)
    remedy = "" if missing == 0 else f"dem.max_time: about {missing:.3g} s more"
    return [
        replace(STATISTICAL_ERROR, high=target).gate(errors.get(worst, math.inf), f", section {worst}", remedy),
        BLOCKS.gate(effective, remedy=remedy),
        TRAVEL.gate(travel, remedy=remedy),
    ]


def missing_time(errors: Mapping[str, float], effective: float, travel: float, target: float, duration: float) -> float:
    """Simulated time [s] that an average still lacks, its error falling with the square root of its length."""
    error = (max(errors.values(), default=math.inf) / target) ** 2
    share = max(error, BLOCKS.low / effective, TRAVEL.low / travel if travel > 0 else math.inf)
    return duration * max(0.0, share - 1)


def breach_gates(breaches: Iterable[str]) -> list[Gate]:
    """Values of the case outside the stable or accurate range."""
    return [Gate(f"{BREACH.name}: {breach}", 1.0, "inside the range", False) for breach in breaches]


def upward_gate(field: Field) -> Gate:
    """Flow upwards through the level where it is largest."""
    upward = -level_flow(np.maximum(field.flux_z, 0.0), field.grid)
    return UPWARD.gate(float(upward.max() / (field.bulk_flow * field.bulk_packing)))


def cells_gate(plan: Plan) -> Gate:
    """Cells of the grid across the narrowest opening, and across the annulus through which a fluid leaves."""
    widths = [opening.gap for opening in plan.openings]
    if plan.case.fluid.annulus is not None and plan.model != "dem":
        widths.append(plan.case.fluid.annulus[1] - plan.case.fluid.annulus[0])
    return CELLS.gate(min(widths) / plan.grid.cell)


def asymmetry_gate(off_centre: Mapping[str, Mapping[str, Any]]) -> Gate:
    """Largest asymmetry of the flow, of all sections, that is beyond doubt.

    Parameters
    ----------
    off_centre : section → amplitudes of the flow off the centre, of the first and second order, and their errors
    """
    sure = {
        f", {shape} in section {name}": amplitude
        for name, one in off_centre.items()
        for shape, amplitude, error in _amplitudes(one)
        if amplitude > LEAST_ASYMMETRY * error
    }
    worst = max(sure, key=sure.__getitem__, default="")
    return ASYMMETRY.gate(sure.get(worst, 0.0), worst)


def surface_gates(figures: Mapping[str, Any]) -> list[Gate]:
    """What the worst bend, beyond doubt, of the free surfaces that may be left from the filling makes; none without."""
    bends = {
        f", section {name}": surface["change"] if bend["angle"] > LEAST_BEND * bend["error"] else 0.0
        for name, surface in figures.get("surface_angles", {}).items()
        if (bend := surface.get("apart")) and not figures.get("turnovers", {}).get(name, 0.0) >= TURNOVERS.low
    }
    worst = max(bends, key=bends.__getitem__, default=None)
    return [] if worst is None else [SURFACE.gate(bends[worst], worst)]


def _amplitudes(off_centre: Mapping[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Shape, amplitude and standard error of the flow that is not the same all round."""
    yield from zip(_SHAPES, off_centre["amplitudes"], off_centre["amplitudes_se"], strict=True)


def _bend(surface: Mapping[str, Any]) -> str:
    """The slopes of both halves of a free surface, where they are told apart, sure or not."""
    if math.degrees(surface.get("apart", {"angle": 0.0})["angle"]) <= TOLD_BEND:
        return ""
    inner, outer = (
        f"{math.degrees(one['angle']):.0f} ± {math.degrees(one['error']):.0f}°"
        for one in (surface["inner"], surface["outer"])
    )
    return f" ({inner} inside r = {surface['radius']:.3g} m, {outer} beyond)"


def run_notes(figures: Mapping[str, Any]) -> list[str]:
    """What to keep in mind of a DEM run, from its figures."""
    notes = []
    few = {name: turned for name, turned in figures.get("turnovers", {}).items() if not turned >= TURNOVERS.low}
    if few:
        sections = ", ".join(f"{name} {turned:.2g}" for name, turned in few.items())
        notes.append(f"turned over less than once during the average, so it may depend on the filling: {sections}")
    travel = figures.get("widest_level_travel_diameters", TRAVEL.low)
    if "statistical_error" in figures and not travel >= TRAVEL.low:
        notes.append(
            f"during the average the widest level moved by {travel:.2g} particle diameters: below {TRAVEL.low:g} the "
            "statistical error is told too small"
        )
    given, found = figures.get("bulk_packing"), figures.get("measured_packing")
    if given is not None and found is not None and abs(found / given - 1) > PACKING_APART.high:
        notes.append(
            f"the case's bulk density makes a packing fraction of {given:.3f}, the simulated bed has {found:.3f}: "
            "velocities follow the case's"
        )
    for name, surface in figures.get("surface_angles", {}).items():
        angle, error = (math.degrees(surface[key]) for key in ("angle", "error"))
        renewed = "; it may depend on the filling" if name in few else ""
        notes.append(
            f"section {name}: free surface at {angle:.0f} ± {error:.0f}° below the horizontal{_bend(surface)}{renewed}"
        )
    for name, one in figures.get("off_centre", {}).items():
        for shape, amplitude, error in _amplitudes(one):
            if amplitude > UNEVEN.high * error:
                notes.append(f"section {name}: {amplitude:.0%} ± {error:.0%} of the flow lean {shape}")
        if abs(one["swirl"]) > UNEVEN.high * one["swirl_se"]:
            notes.append(f"section {name}: turns at {one['swirl']:.0%} ± {one['swirl_se']:.0%} of its downward speed")
    for what in ("solids", "kinetic_energy"):
        trend = figures.get(f"trend_of_{what}")
        if trend is not None and trend["p_value"] < TREND.low:
            change, chance = trend["relative_change"], trend["p_value"]
            notes.append(f"{what.replace('_', ' ')}: changes by {change:+.1%} over the average (p = {chance:.1g})")
    scatter = figures.get("scatter_of_runs_over_error")
    if scatter is not None and not scatter <= SCATTER.high:
        notes.append(f"the replicas scatter {scatter:.2g} times as far as the standard errors let expect")
    return notes
