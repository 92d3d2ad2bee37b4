"""How the plate sinks: where it begins, how fast, faster at first, how long, and in what segments that is cut.

With an open outlet the solids fall freely in its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from granpipe.case.schema import Case
from granpipe.dem import contact
from granpipe.dem.decision import Decision
from granpipe.dem.duration import (
    AFTER_START,
    LEAST_TRAVEL,
    LEAST_TURNOVER,
    SNAPSHOT_TRAVEL,
    START_TURNOVER,
    Duration,
    dumps_per_segment,
    duration,
    start_pays,
)
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.stress import BedStress
from granpipe.dem.vessel import Opening, Vessel, least_limit, simulated_flow
from granpipe.errors import CaseError

BEVERLOO_SHARE = 0.1
"""Flow through every opening over its free discharge, at most: beyond it inertia shows in the field."""

MOST_BEVERLOO = 1.5
"""The same at the most: a plate that sinks faster leaves the solids behind. Beverloo is good to 10 %, and below a cone
more falls."""

START_BEVERLOO_SHARE = 0.5
"""The same for the start speed: in the test reactor the flow developed alike at 0.37 and 0.55, later at 0.73."""

MOST_START_SHARE = 0.6
"""The same for a start speed of the case: beyond it the run is marked."""

LEAST_CLEARANCE = 5.0
"""Plate below the outlet in d90 when the average begins, at least; and an outlet radius below what is not straight."""

START_CLEARANCE = 2.0
"""The same before a faster start."""

LEAST_START_GAIN = 1.5
"""Start speed over the final one, at least: less saves nothing."""

SPEED_ERROR = 0.05
"""Change of the bulk friction by inertia that the plate speed is chosen for. No key of the case: `statistical_error` is
another thing, and a tighter one must continue the same run."""


@dataclass(frozen=True)
class Start:
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


@dataclass(frozen=True)
class Segments:
    """What production is cut into.

    Parameters
    ----------
    dump_every : steps between snapshots
    steps : of a segment
    number : of segments, at the most
    start : segments at the start speed; 0 without a faster start
    left_out : segments that are not averaged, whatever is in them: those of a faster start and some after it
    start_speed : of the plate in the first ones [m/s]
    """

    dump_every: int
    steps: int
    number: int
    start: int
    left_out: int
    start_speed: float


@dataclass(frozen=True)
class Motion:
    """How the plate sinks.

    Parameters
    ----------
    open_outlet : the bed discharges freely
    speed : at last [m/s]; with an open outlet that of the bed in it; with several outlets the mean over their area
    start : what is faster at first; None without
    length : time of production
    clearance : of the plate at the beginning, below the outlet [m]
    speed_choice, time_choice : the rules behind them
    """

    open_outlet: bool
    speed: float
    start: Start | None
    length: Duration
    clearance: float
    speed_choice: Decision
    time_choice: Decision

    @property
    def plate_speed(self) -> float:
        """[m/s]; 0 with an open outlet."""
        return 0.0 if self.open_outlet else self.speed

    @property
    def highest(self) -> float:
        """Highest speed [m/s]."""
        return self.start.most if self.start else self.speed

    @property
    def travel(self) -> float:
        """Of the plate in all [m]."""
        return self.plate_speed * self.length.time + self.length.start_travel

    def segments(self, time_step: float, vessel: Vessel, diameter: float) -> Segments:
        """What production is cut into, for a time step [s] and the Sauter diameter of the particles [m]."""
        dump_every = max(1, round(SNAPSHOT_TRAVEL * diameter / (self.speed * time_step)))
        dumps = dumps_per_segment(self.length.room, time_step * dump_every, vessel.most_segments)
        time = time_step * dump_every * dumps
        start, left_out, start_speed = 0, 0, self.speed
        if self.start is not None:
            after = AFTER_START * diameter
            start, start_speed = self.start.over(self.length.start_travel - after, time)
            left_out = start + math.ceil(after / (self.speed * time) - 1e-9)
        number = left_out + max(1, round(self.length.time / time))
        return Segments(dump_every, dump_every * dumps, number, start, left_out, start_speed)

    def deepest(self, vessel: Vessel) -> float:
        """How far below `Column.plate_z` the lowest plate would be with all the room used up [m]."""
        paces = zip(vessel.plates, vessel.rises, strict=True)
        return max(part * self.plate_speed * self.length.room - up for part, up in paces)

    def decisions(self, start_speed: float) -> list[Decision]:
        """The rules behind all this, for the start speed [m/s] that whole segments make."""
        return [
            self.speed_choice,
            *([self.start.decision(start_speed)] if self.start else []),
            self.time_choice,
            *([] if self.open_outlet else [_plate_choice(self.clearance)]),
        ]


def averaged_clearance(case: Case, vessel: Vessel, classes: SizeClasses) -> float:
    """How far the plate is below the outlet when the average begins, at least [m]."""
    if case.dem.outlet == "open":
        return 0.0
    return max(LEAST_CLEARANCE * classes.d90, vessel.outlet_radius - vessel.straight_outlet)


def choose_motion(case: Case, vessel: Vessel, classes: SizeClasses, stress: BedStress) -> Motion:
    """Choose how the plate sinks, or judge what the case says of it.

    Raises
    ------
    CaseError : faster than anything falls
    """
    open_outlet = case.dem.outlet == "open"
    speed, speed_choice = _flow_speed(case, vessel, classes, stress)
    start = _faster_start(case, vessel, classes, speed)
    length = _length(case, vessel, classes, speed, start is not None)
    if start is not None and not start_pays(length, speed, classes.sauter_diameter, vessel.most_segments):
        start, length = None, _length(case, vessel, classes, speed, False)
    share = LEAST_CLEARANCE if start is None else START_CLEARANCE
    nearest = 0.0 if open_outlet else share * classes.d90
    # the plate sinks further before anything is averaged
    sunk = min(vessel.plates) * length.start_travel
    clearance = max(nearest, averaged_clearance(case, vessel, classes) - sunk)
    return Motion(open_outlet, speed, start, length, clearance, speed_choice, _time_choice(case, length))


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
    quick, quick_name = least_limit(vessel, lambda o, s: BEVERLOO_SHARE * simulated_flow(o, classes) / (s * area))
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

    calm, calm_name = least_limit(vessel, calm_speed)
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


def _faster_start(case: Case, vessel: Vessel, classes: SizeClasses, speed: float) -> Start | None:
    """The start before the plate's final speed [m/s]; None where a faster one gains nothing or is not wanted."""
    if case.dem.outlet == "open":
        return None
    given = case.dem.start_speed
    free, name = least_limit(vessel, lambda o, s: simulated_flow(o, classes) / (s * vessel.outlet_area))
    most = START_BEVERLOO_SHARE * free if given == "auto" else float(given)
    if most < LEAST_START_GAIN * speed:
        return None
    if most > MOST_BEVERLOO * free:
        raise CaseError(
            f"{most:.3g} m/s is {most / free:.2g} times what falls freely through the {name} (Beverloo): the plate "
            f"would leave the solids behind; at most {MOST_START_SHARE * free:.2g} m/s, or auto",
            key=("dem", "start_speed"),
        )
    return Start(most, free, name)


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


def _plate_choice(clearance: float) -> Decision:
    criterion = (
        f"below the outlet; when the average begins at least {LEAST_CLEARANCE:g} d90, and an outlet radius below what "
        "is not straight"
    )
    return Decision("plate", f"{clearance:.3g} m", criterion)
