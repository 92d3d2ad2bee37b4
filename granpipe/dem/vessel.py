"""What the settings of a DEM run need to know of the geometry, and how fast solids fall through its openings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from granpipe.dem import contact
from granpipe.dem.duration import MOST_SEGMENTS
from granpipe.dem.sizes import SizeClasses
from granpipe.dem.stress import BedStress, bed_stress
from granpipe.errors import KeyPath
from granpipe.field import ROUND, Measure


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


def least_limit(vessel: Vessel, limit: Callable[[Opening, float], float]) -> tuple[float, str]:
    """Least of the limits of all openings that anything flows through, and the name of that opening."""
    limits = [(limit(o, share), o.name) for o, share in zip(vessel.openings, vessel.shares, strict=True)]
    return min((value, name) for value, name in limits if value > 0)
