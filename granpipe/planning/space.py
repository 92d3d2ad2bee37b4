"""What the planner needs to know of a vessel in space, and what such a vessel cannot have: refused in one place."""

from __future__ import annotations

import math
from functools import lru_cache

from granpipe.case.fluid import Fluid
from granpipe.case.schema import Case
from granpipe.case.vessel import VesselSpec, vessel_triangles
from granpipe.dem.decision import Decision
from granpipe.dem.duration import MOST_SEGMENTS, ROOM
from granpipe.dem.sizes import simulated_classes, size_classes
from granpipe.dem.vessel import Vessel, free_flow
from granpipe.errors import CaseError
from granpipe.field import MOST_CELLS, Box
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.planning.flow import FreeFlow, against_free_flow

EXPORTS = ("comsol", "vtk")
"""Formats that are made for x, y and z."""

CELLS_PER_DIAMETER = 2
"""Cells per Sauter diameter in space: four, as on rings, would be eight times as many, each with fewer particles."""

LEAST_BLOCKS = 24
"""Segments that the shortest run is cut into, at least: the error of a field needs blocks."""

BYTES_PER_CELL = 48
"""Of the sums of a segment."""

MOST_BYTES = 2e9
"""Memory for the sums of the shortest sensible run: segments are longer where it would be more."""

KEY = ("vessel",)


def check_space(case: Case) -> None:
    """Make sure that what a case asks for can be had in a vessel in space.

    Raises
    ------
    CaseError : it cannot
    """
    check_model_in_space(case.model)
    if case.fluid != Fluid():
        raise CaseError("a vessel in space is computed by particles only; leave it out", ("fluid",))
    if case.dem.outlet != "plate":
        raise CaseError("the outlets of a vessel in space have plates; leave it out", ("dem", "outlet"))
    if case.dem.walls == "set_back":
        raise CaseError("walls in space stay where they are; leave it out", ("dem", "walls"))
    if case.dem.facets != "auto":
        raise CaseError("the walls of a vessel in space are those of its file; leave it out", ("dem", "facets"))
    if case.dem.thickness != "auto":
        raise CaseError("only a slab, outline.symmetry: plane, has one; leave it out", ("dem", "thickness"))
    if case.homogenize.method != "psi":
        raise CaseError(
            "in space the nearest conserving flow is taken, there is no other method; leave it out",
            ("homogenize", "method"),
        )
    if others := [name for name in case.export if name not in EXPORTS]:
        raise CaseError(f"{others[0]} is not made in space; choose of {', '.join(EXPORTS)}", ("export",))
    if "animation" in case.figures:
        raise CaseError("an animation is made for r and z only; leave it out in a vessel in space", ("figures",))
    if case.homogenize.fields:
        raise CaseError(
            f"{case.homogenize.fields[0]} is summed on rings only; leave it out in a vessel in space",
            ("homogenize", "fields"),
        )


def check_model_in_space(model: str) -> None:
    """CaseError for a model other than particles."""
    if model not in ("auto", "dem"):
        raise CaseError("a vessel in space is computed by particles only: set dem", ("model",))


def space_vessel(case: Case) -> SpaceVessel:
    """The vessel of a case, with the narrowest passage to each outlet.

    Raises
    ------
    CaseError : its file cannot be read, or is not that of a vessel
    """
    assert case.vessel is not None
    return _loaded(case.vessel.model_dump_json(), simulated_classes(case).mean_diameter)


@lru_cache(maxsize=4)
def _loaded(spec: str, diameter: float) -> SpaceVessel:
    vessel = VesselSpec.model_validate_json(spec)
    found = SpaceVessel.of(*vessel_triangles(vessel), vessel.outlets, vessel.metres)
    return found.with_passages(0.5 * diameter)


def settings_vessel(vessel: SpaceVessel, grid: Box) -> Vessel:
    """What the settings of a DEM run go by: areas of levels, and the outlets."""
    outline = vessel.outline
    cells = math.prod(grid.shape)
    segments = ROOM * max(LEAST_BLOCKS, MOST_BYTES / (BYTES_PER_CELL * cells))
    return Vessel(
        wall=tuple((float(r), float(z)) for r, z in outline.wall),
        volume=outline.volume(),
        openings=vessel.openings,
        shares=tuple(one.load for one in vessel.outlets),
        widest=outline.widest_area(),
        plates=vessel.plate_speeds,
        rises=vessel.rises,
        most_segments=min(MOST_SEGMENTS, int(segments)),
    )


def space_grid(case: Case, vessel: SpaceVessel) -> Box:
    """The grid round the vessel, of half a particle diameter or what the case gives.

    Raises
    ------
    CaseError : it would have too many cells
    """
    given = case.homogenize.cell
    size = simulated_classes(case).sauter_diameter / CELLS_PER_DIAMETER if given == "auto" else float(given)
    ends = [(float(low), float(high)) for low, high in vessel.walls.ends]
    cells = math.prod(max(1.0, (high - low) / size) for low, high in ends)
    if cells > MOST_CELLS:
        width, depth, height = (high - low for low, high in ends)
        raise CaseError(
            f"a vessel of {width:.3g} × {depth:.3g} × {height:.3g} m has {cells:.3g} cells of {size:.3g} m, more than "
            f"{MOST_CELLS:.0e}; give a larger homogenize.cell, or larger particles (dem.coarse_grain_factor); is "
            "vessel.unit right?",
            KEY,
        )
    return Box.within(ends[0], ends[1], ends[2], size, flat=False, cut=True)


def check_space_flow(case: Case, vessel: SpaceVessel, packing: float | None = None) -> tuple[str, ...]:
    """What the user should keep in mind of the flow rate, each outlet with its share of it.

    Parameters
    ----------
    packing : packing fraction of the bulk, where it is known better than by the case

    Raises
    ------
    CaseError : more is asked for than falls freely through an outlet
    """
    particle = size_classes(case.material.size).mean_diameter
    free = [
        FreeFlow(opening.name, free_flow(opening, particle) / outlet.load)
        for opening, outlet in zip(vessel.openings, vessel.outlets, strict=True)
    ]
    return against_free_flow(case, min(free, key=lambda one: one.bulk), packing)


def outlet_decisions(vessel: SpaceVessel, plate_speed: float) -> list[Decision]:
    """The speed of the plate in each of several outlets."""
    if len(vessel.outlets) == 1:
        return []
    return [
        Decision(
            f"plate in {one.name}",
            f"{plate_speed * speed:.3g} m/s",
            f"{one.share:.4g} of the flow through {one.spout.area:.3g} m²",
        )
        for one, speed in zip(vessel.outlets, vessel.plate_speeds, strict=True)
    ]


def sums_memory(grid: Box, segments: int) -> float:
    """What the sums of a run take [bytes]."""
    return BYTES_PER_CELL * math.prod(grid.shape) * (segments + 2 * LEAST_BLOCKS)


def grid_decision(grid: Box, segments: int) -> Decision:
    """Size of the grid, and what it costs."""
    cells = " × ".join(map(str, grid.shape))
    needed = sums_memory(grid, segments)
    criterion = f"cells of {grid.cell:.3g} m; {segments} segments of sums take {needed / 1e9:.2g} GB of memory and disk"
    return Decision("grid in space", cells, criterion)
