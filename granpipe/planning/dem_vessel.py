"""The vessel of an outline, as the settings of a DEM run see it."""

from __future__ import annotations

from collections.abc import Iterator

from granpipe.dem.vessel import Vessel
from granpipe.geometry.openings import Opening, find_openings
from granpipe.geometry.outline import Outline


def depth_gap(outline: Outline) -> Opening:
    """What particles must pass between the front and the back wall of a slab, all the way down."""
    depth = outline.measure.turn
    name, key = "gap between the front and the back wall", ("outline", "depth")
    return Opening(name, outline.z_bottom, 0.0, depth, depth, outline.outlet_area, True, key)


def dem_vessel(outline: Outline) -> Vessel:
    """Openings, areas and straight ends of an outline."""
    openings = find_openings(outline)
    axial = outline.measure.axial
    straight_inlet, straight_outlet = outline.straight_ends
    return Vessel(
        wall=tuple((float(r), float(z)) for r, z in outline.wall) if axial else tuple(_widths(outline)),
        volume=outline.volume(),
        openings=openings,
        shares=tuple(1.0 if p.required else min(1.0, p.area / float(outline.area(p.z))) for p in openings),
        widest=outline.widest_area(),
        straight_inlet=straight_inlet,
        straight_outlet=straight_outlet,
        measure=outline.measure,
    )


def _widths(outline: Outline) -> Iterator[tuple[float, float]]:
    """Width of a slab and height [m] from the top down; two at one height where a wall has a ledge."""
    for z in outline.levels.tolist():
        above, below = (float(outline.wall_radius(z, side) - outline.left_end(z, side)) for side in ("above", "below"))
        if z < outline.z_top:
            yield above, z
        if z > outline.z_bottom and (z == outline.z_top or abs(above - below) > outline.tolerance):
            yield below, z
