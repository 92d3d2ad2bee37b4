"""Walls, openings and flow scales of a vessel, from which the health checks of a DEM run take their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from granpipe.dem import contact
from granpipe.dem.filling import PACKING
from granpipe.dem.health import FlowLimits
from granpipe.dem.settings import Settings
from granpipe.dem.vessel import simulated_flow
from granpipe.field import Array, Mask
from granpipe.geometry.openings import Opening, find_openings
from granpipe.geometry.outline import Outline
from granpipe.geometry.polyline import inside_polygon
from granpipe.geometry.revolve import Turn
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.walls import facet_turns
from granpipe.planning.flow import free_discharge

PROFILE = 2.0
"""Fastest over mean speed of a level, at most: a hopper's axis has twice the wall's speed."""

_ROWS = 1000


def flow_limits(outline: Outline, settings: Settings, wall_friction: float, facets: int | None) -> FlowLimits:
    """Walls, openings and the scales of the flow; `facets` per turn are the case's, None where it leaves them."""
    turns = facet_turns(outline, settings.classes.sauter_diameter, facets) if outline.measure.axial else {}
    bulk_flow = settings.inlet_speed * outline.inlet_area
    speed = bulk_flow / outline.outlet_area
    openings = find_openings(outline)
    # a stream leaves the highest opening with something below it to fall into; a plug sits on the plate
    edges = [opening for opening in openings if settings.open_outlet or opening.z > outline.z_bottom]
    return FlowLimits(
        measure=outline.measure,
        inside=lambda at: _inside(outline, turns, at),
        levels={_described(opening): opening.z for opening in openings},
        areas={_described(opening): _free_area(outline, opening.z) for opening in openings},
        loads={_described(opening): _load(outline, settings, opening, bulk_flow) for opening in openings},
        flow=PACKING * bulk_flow,
        speed=speed,
        flow_energy=_flow_energy(outline, bulk_flow),
        elastic_energy=_elastic_energy(outline, settings, wall_friction),
        fall=max((opening.z - settings.lowest for opening in edges), default=0.0),
        brink=max((opening.area for opening in edges), default=0.0),
    )


def space_limits(vessel: SpaceVessel, settings: Settings, wall_friction: float) -> FlowLimits:
    """The same of a vessel in space; flow scales are those of the outline that has its areas."""
    outline, bulk_flow = vessel.outline, settings.inlet_speed * vessel.outline.inlet_area
    names = {_described(opening): outlet for opening, outlet in zip(vessel.openings, vessel.outlets, strict=True)}
    return FlowLimits(
        measure=None,
        inside=vessel.contains,
        levels={name: one.opening.z for name, one in names.items()},
        areas={name: one.spout.area for name, one in names.items()},
        loads={
            name: bulk_flow * outlet.load / simulated_flow(opening, settings.classes)
            for (name, outlet), opening in zip(names.items(), vessel.openings, strict=True)
        },
        flow=PACKING * bulk_flow,
        speed=bulk_flow / vessel.outlet_area,
        flow_energy=_flow_energy(outline, bulk_flow) * max(vessel.plate_speeds) ** 2,
        elastic_energy=_elastic_energy(outline, settings, wall_friction),
        fall=max(one.spout.fall for one in vessel.outlets),
        brink=max(one.spout.area if one.spout.fall else 0.0 for one in vessel.outlets),
        shares={name: one.share for name, one in names.items()},
        left_by=vessel.left_by,
    )


def _described(opening: Opening) -> str:
    return f"{opening.name} at z = {opening.z:.4g} m"


def _free_area(outline: Outline, z: float) -> float:
    """Narrowest free area at a level, ledges included, at most that of the outlet [m²]."""
    here = (float(outline.area(z, side)) for side in ("above", "below"))
    return min(outline.outlet_area, *here)


def _load(outline: Outline, settings: Settings, opening: Opening, bulk_flow: float) -> float:
    """Flow that the plate asks for over the free discharge at the level of an opening; 0 without a plate."""
    if settings.open_outlet:
        return 0.0
    free = free_discharge(outline, opening, settings.classes.mean_diameter).bulk
    return bulk_flow / free * math.sqrt(settings.classes.mass_factor)  # they fall more slowly


def _flow_energy(outline: Outline, bulk_flow: float) -> float:
    """Mean of ½v² over the vessel where v is the highest speed of each level [J/kg]."""
    middles = outline.z_bottom + (np.arange(_ROWS) + 0.5) / _ROWS * (outline.z_top - outline.z_bottom)
    area = outline.area(middles)
    return float(0.5 * (PROFILE * bulk_flow) ** 2 * (1 / area).sum() / area.sum())


def _elastic_energy(outline: Outline, settings: Settings, wall_friction: float) -> float:
    """Most work by mass [J/kg] that the bed's weight does on its contacts: stress over density times their overlap."""
    height = settings.wall_top - settings.lowest
    widest = outline.measure.hydraulic_diameter(outline.width)
    return contact.MEAN_OVERLAP * contact.janssen_step(0.0, 1.0, widest, wall_friction, height)


def _inside(outline: Outline, turns: Mapping[str, Turn], centres: Array) -> Mask:
    """(n,) whether points (n, 3) lie within the walls and outside the obstacles, as flat as their facets are.

    Small particles get into corners between facets that stand outside the circle, and press on their middles inside it.
    """
    x, y, z = centres.T

    def across(name: str) -> Array:
        return turns[name].circle(x, y) if turns else outline.measure.across(x, y)

    r = across("")
    free = outline.measure.within_depth(y)
    free &= r < np.maximum(outline.wall_radius(z, "below"), outline.wall_radius(z, "above"))
    if not outline.measure.axial:
        free &= r > np.minimum(outline.left_end(z, "below"), outline.left_end(z, "above"))
    for name, polygon in outline.obstacles.items():
        free &= ~inside_polygon(np.column_stack([across(name), z]), polygon)
    return np.asarray(free)
