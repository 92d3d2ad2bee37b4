"""The picture of a plan: what was understood, and what will be simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from granpipe.export.plan_picture import Planned, plan_picture
from granpipe.export.space_plan_picture import PlannedInSpace, PlannedOutlet, space_plan_picture
from granpipe.geometry.free_surfaces import free_surfaces
from granpipe.geometry.openings import find_openings
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.plan import Plan
from granpipe.planning.sections import section_ranges
from granpipe.system.files import check_picture


def draw_plan(plan: Plan, path: Path) -> str:
    """Draw a plan into a PNG file; a line that says where it is, or why it is not there.

    Raises
    ------
    RunError : something else stands where the picture is to go
    """
    check_picture(path)
    title = f"{plan.case.name}: model {plan.model}"
    try:
        if plan.space is None:
            plan_picture(planned(plan), title, path)
        else:
            space_plan_picture(planned_in_space(plan, plan.space), title, path)
    except OSError as error:
        return f"no picture: {path} cannot be written ({error.strerror})"
    return f"picture   {path}"


def planned_in_space(plan: Plan, vessel: SpaceVessel) -> PlannedInSpace:
    """What the picture of a plan in space shows."""
    dem = plan.dem
    levels = zip(dem.plate_levels(0), dem.plate_levels(dem.steps), strict=True)
    return PlannedInSpace(
        walls=vessel.walls.surface,
        simulated=vessel.surface(dem.feed_top, dem.plate_level(dem.steps), most_rows=1),
        inlet=vessel.inlet.corners,
        outlets=[
            PlannedOutlet(one.name, one.share, one.opening.corners, one.spout.ring, plate)
            for one, plate in zip(vessel.outlets, levels, strict=True)
        ],
    )


def planned(plan: Plan) -> Planned:
    """What the picture of a plan shows."""
    outline, runs, seen = plan.outline, plan.runs, plan.set_back
    by_particles = [(run.outline.z_bottom, run.outline.z_top) for run in runs]

    def simulated(top: float, bottom: float) -> bool:
        return any(low <= 0.5 * (top + bottom) <= high for low, high in by_particles)

    ranges = section_ranges(plan.case, outline)
    dem = plan.settings
    repose = bulk_friction(plan.case).repose
    return Planned(
        wall=outline.wall,
        left=outline.left,
        axial=outline.measure.axial,
        obstacles=outline.obstacles,
        sections={n: (s.z_top, s.z_bottom, simulated(s.z_top, s.z_bottom)) for n, s in ranges.items()},
        openings={one.name: (one.z, one.r_inner, one.r_outer) for one in find_openings(outline)},
        feed=None if dem is None else (dem.feed_bottom, dem.feed_top),
        plate=None if dem is None or dem.open_outlet else (dem.plate_z, dem.plate_level(dem.steps)),
        surfaces=free_surfaces(outline, repose),
        repose=repose,
        set_back=() if seen is None else (seen.wall, *(np.vstack([p, p[:1]]) for p in seen.obstacles.values())),
    )
