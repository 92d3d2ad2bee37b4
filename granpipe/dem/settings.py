"""The numerical settings of a DEM run: taken from the case where it gives them, chosen by a stated rule otherwise.

Pure: numbers in, numbers out. The planner shows each decision with its criterion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from granpipe.case.contact import Contact
from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.duration import (
    AFTER_START,
    LEAST_TRAVEL,
    LEAST_TURNOVER,
    MOST_SEGMENTS,
    SNAPSHOT_TRAVEL,
    START_TURNOVER,
    Duration,
    dumps_per_segment,
    duration,
    start_pays,
)
from granpipe.dem.packing import packable
from granpipe.dem.sizes import MOST_DENSE, SizeClasses, simulated_classes
from granpipe.dem.stress import BedStress, bed_stress
from granpipe.errors import CaseError, KeyPath
from granpipe.field import ROUND, Measure

PACKING = 0.58
"""Random packing of a slowly moving bed of spheres; measured 0.57–0.59 above a sinking plate."""

BEVERLOO_SHARE = 0.1
"""Flow through every opening over its free discharge, at most: beyond it inertia shows in the field."""

MOST_BEVERLOO = 1.5
"""The same at the most: a plate that sinks faster leaves the solids behind. Beverloo is good to 10 %, and below a cone
more falls."""

START_BEVERLOO_SHARE = 0.5
"""The same for the start speed: in the test reactor the flow developed alike at 0.37 and 0.55, later at 0.73."""

MOST_START_SHARE = 0.6
"""The same for a start speed of the case: beyond it the run is marked."""

REST, NEAR_REST = 0.01, 0.05
"""RMS speed of particles in a bed at rest, at most, over √(g d); and before a faster start that moves the widest level,
and so all, at that speed or more. Such a start may begin earlier, once a packed bed has had the time of a free fall
through the vessel."""

FILLED = 0.9
"""Particles of the packed bed that a filling begins with, over those of a full vessel at `PACKING`, at most: what is
missing when it has settled is topped up. With so many a faster start may begin."""

LOOSE_ROOM = 0.25
"""Room for a packed bed above the feed, over that of the settled one, at the most: so much it may sink."""

LEAST_CLEARANCE = 5.0
"""Plate below the outlet in d90 when the average begins, at least; and an outlet radius below what is not straight."""

START_CLEARANCE = 2.0
"""The same before a faster start."""

LEAST_RESERVOIR = 5.0
"""Height of the bed above the inlet in d90, at least; half an inlet radius, so that the crater of a funnel stays above
the inlet; and above what is not straight a whole one. With an open outlet the bed is fast and loose below the feed: a
whole one as well."""

LEAST_START_GAIN = 1.5
"""Start speed over the final one, at least: less saves nothing."""

FEED = 8.0
"""Speed of new particles over that of the bed at the inlet: loose as they are, they must outrun the bed they top up."""

SPEED_ERROR = 0.05
"""Change of the bulk friction by inertia that the plate speed is chosen for. No key of the case: `statistical_error` is
another thing, and a tighter one must continue the same run."""

LEAST_GAP = 5.0
"""Width of an opening over d90, at least: narrower ones may arch, and wall layers are all that there is."""

LEAST_COARSE_GAP = 3.0
"""The same of particles that stand for smaller ones: such a run is marked, but it tells what coarseness costs."""

SKIN, WIDE_SKIN = 0.2, 0.4
"""Neighbour skin in mean diameters, and at the most, where the time step needs it."""

MANY_PARTICLES = 1e4
"""From so many on, where the step needs more than the usual skin, the widest costs least: what falls goes so far in a
step that lists are built every six to nine steps (docs/validation/deck_levers.md)."""

RATE = 2.6e6
"""Particle-steps per second of one rank: 2.6e6 to 3.0e6 with hertz/epsd2 and 4 000 to 100 000 spheres in the test
reactor (`benchmarks/deck_levers.py sizes`)."""

MOST_PARTICLES = 1e8
"""More than any cluster runs: a wrong unit is the likelier reason."""

BYTES_PER_PARTICLE = 72  # nine doubles a row in a snapshot


class Opening(Protocol):
    """A narrowing of the vessel [m]. `gap` is what a sphere sees; with `required` nothing passes beside it."""

    @property
    def name(self) -> str: ...
    @property
    def r_inner(self) -> float: ...
    @property
    def r_outer(self) -> float: ...
    @property
    def z(self) -> float: ...
    @property
    def gap(self) -> float: ...
    @property
    def area(self) -> float: ...
    @property
    def required(self) -> bool: ...
    @property
    def key(self) -> KeyPath: ...
    @property
    def length(self) -> float | None: ...
    @property
    def walled(self) -> bool: ...


def free_flow(opening: Opening, particle: float) -> float:
    """Free discharge through an opening as bulk flow [m³/s], of particles of this diameter [m].

    A cone above the opening speeds it up (Rose & Tanaka 1959); leaving that out is on the safe side.
    """
    if opening.length is None:
        return contact.beverloo_flow(opening.gap, particle)
    law = contact.rectangle_flow if opening.walled else contact.slot_flow
    return law(opening.length, opening.gap, particle)


def simulated_flow(opening: Opening, classes: SizeClasses) -> float:
    """Free discharge through an opening of the particles of a run [m³/s]: with mass scaling they fall more slowly."""
    return free_flow(opening, classes.mean_diameter) / math.sqrt(classes.mass_factor)


@dataclass(frozen=True)
class Vessel:
    """What the settings need to know of the geometry; lengths in m, z up.

    Parameters
    ----------
    wall : (r, z) from the inlet down to the outlet; of a slab (width, z)
    openings : every narrowing
    shares : of the flow that passes each opening
    widest : free area of the widest level [m²]
    straight_inlet, straight_outlet : height below the inlet, and above the outlet, to which the walls are straight and
        nothing stands between them [m]
    measure : what the section stands for
    plates : speed of the plate in each outlet over the mean speed of the flow through all of them
    rises : height of each outlet over the lowest point
    most_segments : that the room for the plate is cut into
    """

    wall: tuple[tuple[float, float], ...]
    volume: float
    openings: tuple[Opening, ...]
    shares: tuple[float, ...]
    widest: float
    straight_inlet: float = 0.0
    straight_outlet: float = 0.0
    measure: Measure = ROUND
    plates: tuple[float, ...] = (1.0,)
    rises: tuple[float, ...] = (0.0,)
    most_segments: int = MOST_SEGMENTS

    @property
    def top(self) -> float:
        return self.wall[0][1]

    @property
    def outlet(self) -> float:
        return self.wall[-1][1]

    @property
    def inlet_area(self) -> float:
        return float(self.measure.area(0.0, self.wall[0][0]))

    @property
    def outlet_area(self) -> float:
        return float(self.measure.area(0.0, self.wall[-1][0]))

    @property
    def inlet_radius(self) -> float:
        """Half the width of a slab."""
        return self.wall[0][0] * (1.0 if self.measure.axial else 0.5)

    @property
    def outlet_radius(self) -> float:
        """Half the width of a slab."""
        return self.wall[-1][0] * (1.0 if self.measure.axial else 0.5)

    def bed_stress(self, top: float, bottom: float, bulk_density: float, friction: float) -> BedStress:
        """That of a bed which fills the vessel and its straight ends above the inlet and below the outlet."""
        line = [(self.wall[0][0], top), *self.wall, (self.wall[-1][0], bottom)]
        return bed_stress(line, bulk_density, friction, self.measure)


@dataclass(frozen=True)
class Decision:
    """One setting with the rule behind it.

    `breach` says what is wrong when a value of the case lies outside the stable or accurate range (such a run ends with
    status 4), `warning` what to keep in mind.
    """

    name: str
    value: str
    criterion: str
    breach: str = ""
    warning: str = ""


@dataclass(frozen=True)
class Settings:
    """Everything numerical that the decks need; SI units.

    Parameters
    ----------
    classes : sizes of the simulated particles, coarse-grained ones enlarged
    youngs_modulus : of the particles [Pa]
    gravity : [m/s²]; less than that of the Earth with mass scaling, so that the bed weighs the same
    rayleigh_time : of the smallest particle [s]
    time_step : [s]
    plate_speed : downwards [m/s]; 0 with an open outlet; with several outlets the mean over their area
    plates : speed of the plate in each outlet over that
    rises : height of each plate at the start over `plate_z` [m]
    start_speed : of the plate in the first segments [m/s]
    start_segments : segments at the start speed, where it is faster; 0 without a faster start
    segments_left_out : segments that are not averaged, whatever is in them: those of a faster start and some after it
    inlet_speed : of the bed at the inlet [m/s]
    open_outlet : the bed discharges freely
    feed_bottom, feed_top : levels between which particles are inserted [m]
    bed_top : level up to which a packed bed may reach, which settles [m]
    placed : particles of that bed, at most
    rest_speed : RMS speed of particles in a settled bed, at most [m/s]
    fall_steps : steps after which a bed of `placed` particles need not be at rest; 0 where it must
    wall_top : upper end of the reservoir's wall [m]
    plate_z : level of the plate at the start, below an outlet at the vessel's lowest point [m]
    bottom : lower end of the box [m], which has room for a longer run
    skin : of the neighbour lists [m]
    dump_every : steps between snapshots
    segment_steps : steps of a segment of production
    segments : of production, at the most
    length : time of production, and by what it was chosen
    ranks : MPI processes
    particles : expected, after filling
    decisions : every setting with the rule behind it
    """

    classes: SizeClasses
    youngs_modulus: float
    gravity: float
    rayleigh_time: float
    time_step: float
    plate_speed: float
    start_speed: float
    start_segments: int
    segments_left_out: int
    inlet_speed: float
    open_outlet: bool
    feed_bottom: float
    feed_top: float
    bed_top: float
    placed: int
    rest_speed: float
    fall_steps: int
    wall_top: float
    plate_z: float
    bottom: float
    skin: float
    dump_every: int
    segment_steps: int
    segments: int
    length: Duration
    ranks: int
    particles: int
    decisions: tuple[Decision, ...]
    plates: tuple[float, ...] = (1.0,)
    rises: tuple[float, ...] = (0.0,)

    @property
    def steps(self) -> int:
        """Steps of production."""
        return self.segment_steps * self.segments

    @property
    def feed_speed(self) -> float:
        """Of new particles [m/s]."""
        return FEED * self.inlet_speed

    @property
    def duration(self) -> float:
        """Simulated time of production [s]."""
        return self.steps * self.time_step

    @property
    def pace(self) -> float:
        """Start speed over the final one."""
        return self.start_speed / self.plate_speed if self.start_segments else 1.0

    @property
    def start_steps(self) -> int:
        """Steps at the start speed."""
        return self.start_segments * self.segment_steps

    @property
    def average_from(self) -> float:
        """Time of production before which nothing is averaged [s]."""
        return self.segments_left_out * self.segment_steps * self.time_step

    def paced(self, step: int) -> float:
        """Time [s] in which the bed moves as far at its final speed as it does up to a step of production."""
        return (step + (self.pace - 1) * min(step, self.start_steps)) * self.time_step

    def plate_levels(self, step: int) -> tuple[float, ...]:
        """Level of the plate in each outlet at a step of production [m]."""
        travel = self.plate_speed * self.paced(step)
        return tuple(self.plate_z + rise - part * travel for part, rise in zip(self.plates, self.rises, strict=True))

    def plate_level(self, step: int) -> float:
        """Level of the plate, of the lowest one where there are several, at a step of production [m]."""
        return min(self.plate_levels(step))

    @property
    def lowest(self) -> float:
        """Level below which no particle gets in the time of this run [m]."""
        return self.plate_level(self.steps) - _below_plate(self.classes, self.open_outlet)


def choose(case: Case, vessel: Vessel, cores: int) -> Settings:
    """Settle every number of the DEM run for so many cores.

    Raises
    ------
    CaseError : the case asks for what is physically impossible, or for more particles than any computer holds
    """
    factor, classes = case.dem.coarse_grain_factor, simulated_classes(case)
    _check_number(classes, vessel)
    gap_decisions = [check_gap(opening, classes, factor) for opening in vessel.openings]
    _check_rest(case)
    reservoir = _reservoir_height(case, vessel, classes)
    level = vessel.top + reservoir
    open_outlet = case.dem.outlet == "open"
    least_clearance = 0.0 if open_outlet else LEAST_CLEARANCE * classes.d90
    averaged_clearance = 0.0 if open_outlet else max(least_clearance, vessel.outlet_radius - vessel.straight_outlet)
    feed = min(reservoir, 8 * classes.largest)
    stress = vessel.bed_stress(
        level, vessel.outlet - averaged_clearance, PACKING * case.material.density, case.contact.wall.friction
    )
    youngs, youngs_choice = _youngs_modulus(case, stress, classes)
    speed, speed_choice = _flow_speed(case, vessel, classes, stress)
    start = _faster_start(case, vessel, classes, speed)
    inlet_speed = speed * vessel.outlet_area / vessel.inlet_area
    length = _length(case, vessel, classes, speed, start is not None)
    if start is not None and not start_pays(length, speed, classes.sauter_diameter, vessel.most_segments):
        start, length = None, _length(case, vessel, classes, speed, False)
    # the plate sinks further before anything is averaged
    nearest = least_clearance if start is None else START_CLEARANCE * classes.d90
    clearance = max(nearest, averaged_clearance - min(vessel.plates) * length.start_travel)
    plate_z = vessel.outlet - clearance
    highest = start.most if start else speed
    gravity = contact.GRAVITY / classes.mass_factor  # so that the bed weighs the same
    fall = math.sqrt(2 * gravity * (level + feed / 2 - plate_z) + (FEED * inlet_speed) ** 2) + highest
    room = vessel.volume + vessel.inlet_area * reservoir + vessel.outlet_area * clearance
    full = PACKING * room / classes.mean_volume
    skin, skin_choice = _skin(case, classes, youngs, fall, full)
    step, rayleigh, step_choice = _time_step(case, classes, youngs, fall, skin)
    plate_speed = 0.0 if open_outlet else speed
    travel = plate_speed * length.time + length.start_travel
    dump_every = max(1, round(SNAPSHOT_TRAVEL * classes.sauter_diameter / (speed * step)))
    per_segment = dumps_per_segment(length.room, step * dump_every, vessel.most_segments)
    segment_time = step * dump_every * per_segment
    start_segments, left_out, start_speed = 0, 0, speed
    grain_speed, rest, fall_steps = math.sqrt(gravity * classes.sauter_diameter), REST, 0
    if start is not None:
        after = AFTER_START * classes.sauter_diameter
        start_segments, start_speed = start.over(length.start_travel - after, segment_time)
        slowest = start.most * vessel.outlet_area / vessel.widest
        if slowest >= NEAR_REST * grain_speed:
            rest = NEAR_REST
            if packable(classes):
                fall_steps = math.ceil(math.sqrt(2 * (level + feed / 2 - plate_z) / gravity) / step)
        left_out = start_segments + math.ceil(after / (speed * segment_time) - 1e-9)
    deepest = max(p * plate_speed * length.room - up for p, up in zip(vessel.plates, vessel.rises, strict=True))
    particles = round(full + PACKING * 0.5 * vessel.outlet_area * travel / classes.mean_volume)
    bed_top = level + feed / 2
    if packable(classes):
        bed_top += min(LOOSE_ROOM * room / vessel.inlet_area, 0.5 * (level - plate_z))
    return Settings(
        classes=classes,
        youngs_modulus=youngs,
        gravity=gravity,
        rayleigh_time=rayleigh,
        time_step=step,
        plate_speed=plate_speed,
        start_speed=start_speed,
        start_segments=start_segments,
        segments_left_out=left_out,
        inlet_speed=inlet_speed,
        open_outlet=open_outlet,
        feed_bottom=level - feed / 2,  # half its height is filled when the bed is topped up
        feed_top=level + feed / 2,
        bed_top=bed_top,
        placed=round(FILLED * full),
        rest_speed=rest * grain_speed,
        fall_steps=fall_steps,
        wall_top=bed_top + 2 * classes.largest,
        plate_z=plate_z,
        bottom=plate_z - deepest - _below_plate(classes, open_outlet),
        skin=skin,
        dump_every=dump_every,
        segment_steps=dump_every * per_segment,
        segments=left_out + max(1, round(length.time / segment_time)),
        length=length,
        ranks=_ranks(case, particles, cores),
        particles=particles,
        decisions=(
            *gap_decisions,
            *_mass_scaling(classes),
            _size_ratio(classes),
            *_coarse_graining(case),
            youngs_choice,
            step_choice,
            skin_choice,
            speed_choice,
            *([start.decision(start_speed)] if start else []),
            _time_choice(case, length),
            *([] if open_outlet else [_plate_choice(clearance)]),
            *([_reservoir_choice(reservoir)] if case.dem.reservoir_height == "auto" else []),
        ),
        plates=vessel.plates,
        rises=vessel.rises,
    )


def slab_height(classes: SizeClasses) -> float:
    """Greatest height [m] of one insertion slab: low enough to fill evenly, high enough to hold many particles."""
    return 12 * classes.largest


def _check_number(classes: SizeClasses, vessel: Vessel) -> None:
    if not vessel.volume < MOST_PARTICLES * classes.mean_volume:
        raise CaseError(
            f"the vessel of {vessel.volume:.3g} m³ would hold more than {MOST_PARTICLES:.0e} particles; use larger "
            "ones, or set dem.coarse_grain_factor",
            key=("material", "size"),
        )


def check_gap(opening: Opening, classes: SizeClasses, coarse_grain_factor: float) -> Decision:
    """One rule for every opening: at least `LEAST_GAP` of the material's own particles fit side by side.

    Larger particles that stand for them are the case's decision; from `LEAST_COARSE_GAP` on they are marked.

    Raises
    ------
    CaseError : the opening is too narrow for the particles, or none passes it
    """
    ratio = opening.gap / classes.d90
    smallest = 2 * classes.smallest / coarse_grain_factor
    if opening.gap < smallest:
        raise CaseError(
            f"the {opening.name} is {opening.gap:.4g} m wide: no particle passes it, the smallest is {smallest:.4g} m; "
            f"{_closed(opening)}",
            key=opening.key,
        )
    least = LEAST_GAP if coarse_grain_factor == 1 or ratio * coarse_grain_factor < LEAST_GAP else LEAST_COARSE_GAP
    if ratio < least:
        coarser = ", a smaller dem.coarse_grain_factor" if coarse_grain_factor > 1 else ""
        raise CaseError(
            f"the {opening.name} is {opening.gap:.4g} m wide, only {ratio:.2g} times the particles' d90 of "
            f"{classes.d90:.4g} m; it must be at least {least:g} times: use smaller particles{coarser} or a wider "
            "opening" + ("" if opening.required else f"; {_closed(opening)}"),
            key=opening.key,
        )
    breach = f"below {LEAST_GAP:g} by dem.coarse_grain_factor" if ratio < LEAST_GAP else ""
    warning = "" if ratio >= 10 or breach else f"{ratio:.2g} is below 10: expect wall layers and arching to show"
    return Decision(f"gap/d90 at the {opening.name}", f"{ratio:.3g}", "at least 5, better 10", breach, warning)


def _closed(opening: Opening) -> str:
    """What to draw where an opening was not meant to be one."""
    if opening.required:
        return "widen it, there is no other way; or is the unit of the vessel wrong?"
    width = opening.r_outer - opening.r_inner
    if math.isclose(width, opening.gap, rel_tol=1e-3) or opening.r_inner == 0:
        inner, outer = f"r = {opening.r_inner:.6g} m", f"r = {opening.r_outer:.6g} m"
        move = f"{outer} to {inner}" if opening.r_inner == 0 else f"{inner} to {outer}"
        return f"should the two sides touch? then move the points at {move}"
    near = f"[{opening.r_inner:.6g}, {opening.z:.6g}] (in m)"
    return f"should the two sides touch? then draw them with a common point near {near}"


def _mass_scaling(classes: SizeClasses) -> list[Decision]:
    """How much heavier the smallest particles are made, and what that saves."""
    heaviest = float(classes.density_factor.max())
    if heaviest == 1:
        return []
    criterion = (
        f"what is below the Sauter diameter of {classes.sauter_diameter:.3g} m gets its inertia, at most "
        f"{MOST_DENSE:g} times the density; gravity over {classes.mass_factor:.3g}: {math.sqrt(heaviest):.3g} times "
        "the time step"
    )
    return [Decision("mass scaling", f"up to {heaviest:.3g} times", criterion)]


def _size_ratio(classes: SizeClasses) -> Decision:
    ratio = classes.largest / classes.smallest
    warning = "" if ratio <= 3 else f"{ratio:.2g} > 3: static friction is less exact (arXiv 2410.14798)"
    return Decision("size ratio", f"{ratio:.3g}", "at most 3", warning=warning)


def _coarse_graining(case: Case) -> list[Decision]:
    factor = case.dem.coarse_grain_factor
    if factor == 1:
        return []
    criterion = "E, density, friction and restitution stay: slow flow of larger particles; watch the gaps above"
    return [Decision("coarse_grain_factor", f"{factor:g}", criterion)]


def _reservoir_height(case: Case, vessel: Vessel, classes: SizeClasses) -> float:
    if case.dem.reservoir_height != "auto":
        return float(case.dem.reservoir_height)
    straight = 0.0 if case.dem.outlet == "open" else vessel.straight_inlet
    return max(vessel.inlet_radius - straight, 0.5 * vessel.inlet_radius, LEAST_RESERVOIR * classes.d90)


def _check_rest(case: Case) -> None:
    """CaseError where contacts neither rub nor lose energy."""
    law = case.contact
    if law.restitution == 1 and law.friction == 0:
        raise CaseError(
            "particles that neither rub (contact.friction: 0) nor lose energy (restitution: 1) never come to rest; "
            "give one of the two",
            key=("contact", "restitution"),
        )


def _reservoir_choice(height: float) -> Decision:
    criterion = (
        f"bed above the inlet: {LEAST_RESERVOIR:g} d90, half its radius, and a whole one above what is not straight"
    )
    return Decision("reservoir_height", f"{height:.3g} m", criterion)


def _plate_choice(clearance: float) -> Decision:
    criterion = (
        f"below the outlet; when the average begins at least {LEAST_CLEARANCE:g} d90, and an outlet radius below what "
        "is not straight"
    )
    return Decision("plate", f"{clearance:.3g} m", criterion)


def _youngs_modulus(case: Case, stress: BedStress, classes: SizeClasses) -> tuple[float, Decision]:
    law, pressed = case.contact, contact.wall_stiffening(classes.largest / classes.smallest)
    bed = contact.softened_modulus(stress.mean, stress.peak, law.poisson)
    needed = bed * pressed
    youngs = contact.two_digits_up(needed) if law.youngs_modulus == "auto" else float(law.youngs_modulus)
    criterion = (
        f"overlap at most {contact.MEAN_OVERLAP:.1%} on average and {contact.P99_OVERLAP:.1%} at the 99th percentile "
        f"under Janssen's {stress.mean:.3g} Pa on average and {stress.peak:.3g} Pa at most"
    )
    if pressed > 1:
        criterion += f"; {pressed:.2g} times as stiff, so that the largest do not press the smallest through walls"
    breach = ""
    if youngs < 0.5 * bed:
        breach = f"the bed overlaps too much; it needs about {needed:.2g} Pa"
    elif youngs < 0.5 * needed:
        breach = f"the largest may press the smallest through walls; it needs about {needed:.2g} Pa"
    return youngs, Decision("youngs_modulus", f"{youngs:.3g} Pa", criterion, breach)


def step_limits(
    law: Contact, restitution: float, radius: float, density: float, youngs: float, speed: float, skin: float
) -> dict[str, float]:
    """What the time step must not exceed, in words → limit [s].

    Parameters
    ----------
    restitution : least of the contacts'
    radius : of the smallest particle [m]
    speed : of the fastest particle to be expected [m/s]
    """
    rayleigh = contact.rayleigh_time(radius, density, youngs, law.poisson)
    hertz = contact.hertz_time(radius, density, youngs, law.poisson, speed)
    share = contact.step_share(law.rolling_model, restitution)
    return {
        f"{share:.2g} of the smallest particle's Rayleigh time of {rayleigh:.3g} s": share * rayleigh,
        f"{contact.HERTZ_SHARE:g} of its collision of {hertz:.3g} s at {speed:.3g} m/s": contact.HERTZ_SHARE * hertz,
        f"{contact.SKIN_SHARE:g} of the neighbour skin of {skin:.3g} m at {speed:.3g} m/s": contact.SKIN_SHARE
        * skin
        / speed,
    }


def _time_step(
    case: Case, classes: SizeClasses, youngs: float, speed: float, skin: float
) -> tuple[float, float, Decision]:
    """Time step and Rayleigh time [s]; `speed` is that of the fastest particle to be expected [m/s]."""
    density = classes.smallest_density(case.material.density)
    rayleigh = contact.rayleigh_time(classes.smallest, density, youngs, case.contact.poisson)
    limits = _step_limits(case, classes, youngs, speed, skin)
    criterion, limit = min(limits.items(), key=lambda item: item[1])
    given = case.dem.time_step
    step = contact.two_digits(limit) if given == "auto" else float(given)
    breach = "" if step <= 1.05 * limit else f"at most {criterion} is stable; the bed may never come to rest"
    return step, rayleigh, Decision("time_step", f"{step:.3g} s", criterion, breach)


def _step_limits(case: Case, classes: SizeClasses, youngs: float, speed: float, skin: float) -> dict[str, float]:
    law, density = case.contact, classes.smallest_density(case.material.density)
    return step_limits(law, min(law.restitution, law.wall.restitution), classes.smallest, density, youngs, speed, skin)


def _skin(case: Case, classes: SizeClasses, youngs: float, speed: float, particles: float) -> tuple[float, Decision]:
    """Neighbour skin [m] of so many particles, of which none is faster than a speed [m/s]."""
    usual, wide = (contact.two_digits(share * classes.mean_diameter) for share in (SKIN, WIDE_SKIN))
    given = case.dem.time_step
    allowed = min(_step_limits(case, classes, youngs, speed, math.inf).values())
    step = contact.two_digits(allowed) if given == "auto" else float(given)
    needed = contact.two_digits_up(step * speed / contact.SKIN_SHARE)
    criterion = f"{SKIN:g} of the mean diameter"
    if needed <= usual:
        return usual, Decision("neighbour skin", f"{usual:.3g} m", criterion)
    skin = wide if particles >= MANY_PARTICLES else min(needed, wide)
    criterion += (
        f", at most {WIDE_SKIN:g} where the time step needs more: so much with {MANY_PARTICLES:g} particles and above"
    )
    return skin, Decision("neighbour skin", f"{skin:.3g} m", criterion)


def _flow_speed(case: Case, vessel: Vessel, classes: SizeClasses, stress: BedStress) -> tuple[float, Decision]:
    """Plate speed [m/s]; with an open outlet the mean speed of the free discharge through the narrowest opening."""
    area = vessel.outlet_area
    if case.dem.outlet == "open":
        required = [opening for opening in vessel.openings if opening.required]
        narrowest = min(required, key=lambda opening: simulated_flow(opening, classes))
        free = simulated_flow(narrowest, classes)
        return free / area, Decision(
            "flow", f"{free:.3g} m³/s", f"free discharge at the {narrowest.name} after Beverloo"
        )
    quick, quick_name = _least(vessel, lambda o, s: BEVERLOO_SHARE * simulated_flow(o, classes) / (s * area))
    inertia = SPEED_ERROR / contact.FRICTION_SLOPE

    def calm_speed(opening: Opening, share: float) -> float:
        """Plate speed at which the inertial number in an opening is at its limit."""
        at_one = contact.inertial_number(
            share * area / opening.area,
            min(opening.gap, opening.length) if opening.walled and opening.length else opening.gap,
            classes.sauter_diameter,
            case.material.density * classes.mass_factor,
            stress.at(opening.z),
        )
        return inertia / at_one

    calm, calm_name = _least(vessel, calm_speed)
    given = case.dem.plate_speed
    speed = contact.two_digits(min(quick, calm)) if given == "auto" else float(given)
    free = quick / BEVERLOO_SHARE
    if speed > MOST_BEVERLOO * free:
        raise CaseError(
            f"{speed:.3g} m/s is {speed / free:.2g} times what falls freely through the {quick_name} (Beverloo): the "
            f"plate would leave the solids behind; at most {MOST_BEVERLOO * free:.2g} m/s, or dem.outlet: open",
            key=("dem", "plate_speed"),
        )
    criterion = (
        f"at most {BEVERLOO_SHARE:.0%} of the free discharge (Beverloo) at the {quick_name}: {quick:.3g} m/s; "
        f"inertial number at most {inertia:.2g} at the {calm_name}: {calm:.3g} m/s"
    )
    breach = "" if speed <= 1.05 * min(quick, calm) else f"{speed / min(quick, calm):.2g} times too fast: inertia shows"
    return speed, Decision("plate_speed", f"{speed:.3g} m/s", criterion, breach)


@dataclass(frozen=True)
class _Start:
    """A faster start of the plate.

    Parameters
    ----------
    most : speed that it has at the most [m/s]
    free : speed at which free discharge through the narrowest opening would move the plate [m/s]
    opening : name of that opening
    """

    most: float
    free: float
    opening: str

    def over(self, travel: float, segment_time: float) -> tuple[int, float]:
        """Number of whole segments [s], and the speed [m/s], at which the plate sinks so far [m]."""
        segments = math.ceil(travel / (self.most * segment_time) - 1e-9)
        return segments, travel / (segments * segment_time)

    def decision(self, speed: float) -> Decision:
        criterion = (
            f"at most {START_BEVERLOO_SHARE:.0%} of the free discharge (Beverloo) at the {self.opening}, in whole "
            f"segments, until {START_TURNOVER:.2g} of the content is gone; it and {AFTER_START:g} particle diameters "
            "after it are not averaged"
        )
        share = speed / self.free
        breach = "" if share <= MOST_START_SHARE else f"{share:.2g} of free discharge: the solids lag behind"
        return Decision("start_speed", f"{speed:.3g} m/s", criterion, breach)


def _faster_start(case: Case, vessel: Vessel, classes: SizeClasses, speed: float) -> _Start | None:
    """The start before the plate's final speed [m/s]; None where a faster one gains nothing or is not wanted."""
    if case.dem.outlet == "open":
        return None
    given = case.dem.start_speed
    free, name = _least(vessel, lambda o, s: simulated_flow(o, classes) / (s * vessel.outlet_area))
    most = START_BEVERLOO_SHARE * free if given == "auto" else float(given)
    if most < LEAST_START_GAIN * speed:
        return None
    if most > MOST_BEVERLOO * free:
        raise CaseError(
            f"{most:.3g} m/s is {most / free:.2g} times what falls freely through the {name} (Beverloo): the plate "
            f"would leave the solids behind; at most {MOST_START_SHARE * free:.2g} m/s, or auto",
            key=("dem", "start_speed"),
        )
    return _Start(most, free, name)


def _length(case: Case, vessel: Vessel, classes: SizeClasses, speed: float, faster_start: bool) -> Duration:
    """Time of production, for a mean speed in the outlet [m/s]."""
    outlet, given = vessel.outlet_area, case.dem.max_time
    return duration(
        None if given == "auto" else float(given),
        case.dem.statistical_error,
        speed,
        vessel.widest / outlet,
        vessel.volume / outlet,
        classes.sauter_diameter,
        START_TURNOVER * vessel.volume / outlet if faster_start else 0.0,
    )


def _time_choice(case: Case, length: Duration) -> Decision:
    criterion = (
        f"{LEAST_TRAVEL:g} particle diameters in the widest section, {LEAST_TURNOVER:g} of the content"
        f"{', the start taken off' if length.start_travel else ''}: {length.least:.3g} s"
    )
    if (error := case.dem.statistical_error) is not None:
        criterion += f"; an error of {error:.3g} is expected to need {length.expected:.3g} s"
    criterion += f"; up to {length.longest:.3g} s a longer time continues the run"
    return Decision("max_time", f"{length.time:.4g} s", criterion, warning=length.warning)


def _below_plate(classes: SizeClasses, open_outlet: bool) -> float:
    """Height of the box below the plate at its lowest [m]."""
    return (6 if open_outlet else 4) * classes.largest


def _least(vessel: Vessel, limit: Callable[[Opening, float], float]) -> tuple[float, str]:
    """Least of the limits of all openings that anything flows through, and the name of that opening."""
    limits = [(limit(o, share), o.name) for o, share in zip(vessel.openings, vessel.shares, strict=True)]
    return min((value, name) for value, name in limits if value > 0)


def _ranks(case: Case, particles: int, cores: int) -> int:
    """What the case says, or no more than cores; below some thousand particles a rank they cost more than they give."""
    if case.dem.ranks != "auto":
        return int(case.dem.ranks)
    useful = max(1, particles // 3000)
    return next(n for n in (64, 32, 16, 8, 4, 2, 1) if n <= min(max(1, cores // case.dem.replicas), useful))
