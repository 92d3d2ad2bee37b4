"""How the vessel is filled: how high the bed stands, how much of it is there at first, and when it has settled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.dem.packing import packable
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.vessel import Vessel

PACKING = 0.58
"""Random packing of a slowly moving bed of spheres; measured 0.57–0.59 above a sinking plate."""

REST, NEAR_REST = 0.01, 0.05
"""RMS speed of particles in a bed at rest, at most, over √(g d); and before a faster start that moves the widest level,
and so all, at that speed or more. Such a start may begin earlier, once a packed bed has had the time of a free fall
through the vessel."""

FILLED = 0.9
"""Particles of the packed bed that a filling begins with, over those of a full vessel at `PACKING`, at most: what is
missing when it has settled is topped up. With so many a faster start may begin."""

LOOSE_ROOM = 0.25
"""Room for a packed bed above the feed, over that of the settled one, at the most: so much it may sink."""

LEAST_RESERVOIR = 5.0
"""Height of the bed above the inlet in d90, at least; half an inlet radius, so that the crater of a funnel stays above
the inlet; and above what is not straight a whole one. With an open outlet the bed is fast and loose below the feed: a
whole one as well."""


@dataclass(frozen=True)
class Column:
    """The bed from the plate to the feed, as it is when it has settled.

    Parameters
    ----------
    reservoir : its height above the inlet [m]
    level : of its top, in the middle of the feed [m]
    feed : height of the space in which particles are inserted [m]
    plate_z : level of the plate, below an outlet at the vessel's lowest point [m]
    room : for the bed [m³]
    inlet_area : [m²]
    classes : of its particles
    """

    reservoir: float
    level: float
    feed: float
    plate_z: float
    room: float
    inlet_area: float
    classes: SizeClasses

    @classmethod
    def of(cls, vessel: Vessel, classes: SizeClasses, reservoir: float, clearance: float) -> Column:
        """The bed of a vessel, so high above its inlet and so far below its outlet [m]."""
        return cls(
            reservoir=reservoir,
            level=vessel.top + reservoir,
            feed=min(reservoir, 8 * classes.largest),
            plate_z=vessel.outlet - clearance,
            room=vessel.volume + vessel.inlet_area * reservoir + vessel.outlet_area * clearance,
            inlet_area=vessel.inlet_area,
            classes=classes,
        )

    @property
    def feed_bottom(self) -> float:
        """[m]; half the feed's height is filled when the bed is topped up."""
        return self.level - self.feed / 2

    @property
    def feed_top(self) -> float:
        """[m]."""
        return self.level + self.feed / 2

    @property
    def particles(self) -> float:
        """How many it holds at `PACKING`."""
        return PACKING * self.room / self.classes.mean_volume

    @property
    def placed(self) -> int:
        """Particles of the packed bed that filling begins with, at most."""
        return round(FILLED * self.particles)

    @property
    def bed_top(self) -> float:
        """Level up to which that bed may reach, which settles [m]."""
        if not packable(self.classes):
            return self.feed_top
        return self.feed_top + min(LOOSE_ROOM * self.room / self.inlet_area, 0.5 * (self.level - self.plate_z))

    def fall_time(self, gravity: float) -> float:
        """Of a particle from the top of the feed to the plate [s]."""
        return math.sqrt(2 * (self.feed_top - self.plate_z) / gravity)

    def fall_speed(self, gravity: float, feed_speed: float) -> float:
        """Of a particle that is inserted at a speed and falls from the top of the feed to the plate [m/s]."""
        return math.sqrt(2 * gravity * (self.feed_top - self.plate_z) + feed_speed**2)


def reservoir_height(case: Case, vessel: Vessel, classes: SizeClasses) -> float:
    """Height of the bed above the inlet [m]."""
    if case.dem.reservoir_height != "auto":
        return float(case.dem.reservoir_height)
    straight = 0.0 if case.dem.outlet == "open" else vessel.straight_inlet
    return max(vessel.inlet_radius - straight, 0.5 * vessel.inlet_radius, LEAST_RESERVOIR * classes.d90)


def reservoir_decision(case: Case, height: float) -> list[Decision]:
    """The rule behind it; none where the case gives it."""
    if case.dem.reservoir_height != "auto":
        return []
    criterion = (
        f"bed above the inlet: {LEAST_RESERVOIR:g} d90, half its radius, and a whole one above what is not straight"
    )
    return [Decision("reservoir_height", f"{height:.3g} m", criterion)]


@dataclass(frozen=True)
class Rest:
    """When a bed has settled.

    Parameters
    ----------
    speed : RMS speed of its particles, at most [m/s]
    fall_steps : steps after which a bed of `Column.placed` particles need not be at rest; 0 where it must
    """

    speed: float
    fall_steps: int


def settled(column: Column, gravity: float, time_step: float, start: float) -> Rest:
    """When a bed has settled, before a faster start that moves the widest level at a speed [m/s], 0 without one."""
    grain_speed = math.sqrt(gravity * column.classes.sauter_diameter)
    if start < NEAR_REST * grain_speed:
        return Rest(REST * grain_speed, 0)
    steps = math.ceil(column.fall_time(gravity) / time_step) if packable(column.classes) else 0
    return Rest(NEAR_REST * grain_speed, steps)
