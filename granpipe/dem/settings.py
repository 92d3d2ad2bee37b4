"""The numerical settings of a DEM run: taken from the case where it gives them, chosen by a stated rule otherwise.

Pure: numbers in, numbers out. The planner shows each decision with its criterion. The rules stand in `gaps`, `plate`,
`filling` and `step`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.decision import Decision
from granpipe.dem.duration import Duration
from granpipe.dem.filling import PACKING, Column, reservoir_decision, reservoir_height, settled
from granpipe.dem.gaps import check_gap
from granpipe.dem.plate import averaged_clearance, choose_motion
from granpipe.dem.sizes import MOST_DENSE, SizeClasses, simulated_classes
from granpipe.dem.step import choose_step
from granpipe.dem.vessel import Vessel
from granpipe.errors import CaseError

FEED = 8.0
"""Speed of new particles over that of the bed at the inlet: loose as they are, they must outrun the bed they top up."""

RATE = 2.6e6
"""Particle-steps per second of one rank: 2.6e6 to 3.0e6 with hertz/epsd2 and 4 000 to 100 000 spheres in the test
reactor (`benchmarks/deck_levers.py sizes`)."""

MOST_PARTICLES = 1e8
"""More than any cluster runs: a wrong unit is the likelier reason."""

BYTES_PER_PARTICLE = 72  # nine doubles a row in a snapshot


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
    classes = simulated_classes(case)
    _check_number(classes, vessel)
    gaps = [check_gap(opening, classes, case.dem.coarse_grain_factor) for opening in vessel.openings]
    _check_rest(case)
    reservoir = reservoir_height(case, vessel, classes)
    bottom = vessel.outlet - averaged_clearance(case, vessel, classes)
    bulk_density = PACKING * case.material.density
    stress = vessel.bed_stress(vessel.top + reservoir, bottom, bulk_density, case.contact.wall.friction)
    motion = choose_motion(case, vessel, classes, stress)
    column = Column.of(vessel, classes, reservoir, motion.clearance)
    gravity = contact.GRAVITY / classes.mass_factor  # so that the bed weighs the same
    inlet_speed = motion.speed * vessel.outlet_area / vessel.inlet_area
    fastest = column.fall_speed(gravity, FEED * inlet_speed) + motion.highest
    step = choose_step(case, classes, stress, fastest, column.particles)
    segments = motion.segments(step.time_step, vessel, classes.sauter_diameter)
    start = motion.start.most * vessel.outlet_area / vessel.widest if motion.start else 0.0
    rest = settled(column, gravity, step.time_step, start)
    # half of the space that the plate leaves
    particles = round(column.particles + PACKING * 0.5 * vessel.outlet_area * motion.travel / classes.mean_volume)
    return Settings(
        classes=classes,
        youngs_modulus=step.youngs_modulus,
        gravity=gravity,
        rayleigh_time=step.rayleigh_time,
        time_step=step.time_step,
        plate_speed=motion.plate_speed,
        start_speed=segments.start_speed,
        start_segments=segments.start,
        segments_left_out=segments.left_out,
        inlet_speed=inlet_speed,
        open_outlet=motion.open_outlet,
        feed_bottom=column.feed_bottom,
        feed_top=column.feed_top,
        bed_top=column.bed_top,
        placed=column.placed,
        rest_speed=rest.speed,
        fall_steps=rest.fall_steps,
        wall_top=column.bed_top + 2 * classes.largest,
        plate_z=column.plate_z,
        bottom=column.plate_z - motion.deepest(vessel) - _below_plate(classes, motion.open_outlet),
        skin=step.skin,
        dump_every=segments.dump_every,
        segment_steps=segments.steps,
        segments=segments.number,
        length=motion.length,
        ranks=_ranks(case, particles, cores),
        particles=particles,
        decisions=(
            *gaps,
            *_mass_scaling(classes),
            _size_ratio(classes),
            *_coarse_graining(case),
            *step.decisions,
            *motion.decisions(segments.start_speed),
            *reservoir_decision(case, reservoir),
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


def _check_rest(case: Case) -> None:
    """CaseError where contacts neither rub nor lose energy."""
    law = case.contact
    if law.restitution == 1 and law.friction == 0:
        raise CaseError(
            "particles that neither rub (contact.friction: 0) nor lose energy (restitution: 1) never come to rest; "
            "give one of the two",
            key=("contact", "restitution"),
        )


def _below_plate(classes: SizeClasses, open_outlet: bool) -> float:
    """Height of the box below the plate at its lowest [m]."""
    return (6 if open_outlet else 4) * classes.largest


def _ranks(case: Case, particles: int, cores: int) -> int:
    """What the case says, or no more than cores; below some thousand particles a rank they cost more than they give."""
    if case.dem.ranks != "auto":
        return int(case.dem.ranks)
    useful = max(1, particles // 3000)
    return next(n for n in (64, 32, 16, 8, 4, 2, 1) if n <= min(max(1, cores // case.dem.replicas), useful))
