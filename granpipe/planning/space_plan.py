"""The plan of a vessel in space, which is computed by particles."""

from __future__ import annotations

from granpipe.case.schema import Case
from granpipe.dem.settings import choose
from granpipe.planning.cost import check_duration, disk_bytes, particle_steps, wall_seconds
from granpipe.planning.plan import Model, Plan, Stage
from granpipe.planning.space import (
    check_model_in_space,
    check_space,
    check_space_flow,
    grid_decision,
    outlet_decisions,
    settings_vessel,
    space_grid,
    space_vessel,
    sums_memory,
)
from granpipe.planning.stages import left_out_of_decks, settle_stage


def space_plan(case: Case, cores: int, model: Model = "dem") -> Plan:
    """The plan of a vessel in space, which is computed by particles."""
    check_model_in_space(model)
    check_space(case)
    vessel = space_vessel(case)
    grid = space_grid(case, vessel)
    settings = choose(case, settings_vessel(vessel, grid), cores)
    check_duration(case, settings, cores)
    stages = (
        Stage("walls", "LIGGGHTS needs a reservoir above the inlet, and a plate below each outlet"),
        settle_stage(settings),
        Stage("produce", "a vessel in space is computed by particles"),
        Stage("field", "average in space, then take the nearest flow that conserves"),
        Stage("results", ", ".join(["field.npz", *case.export, *(f"figures: {name}" for name in case.figures)])),
    )
    left = (
        Stage("fluid, hybrid", "a vessel in space is computed by particles only"),
        *(stage for stage in left_out_of_decks(case) if stage.name != "obstacle meshes"),
    )
    decisions = (*settings.decisions, *outlet_decisions(vessel, settings.plate_speed))
    return Plan(
        case=case,
        outline=vessel.outline,
        model="dem",
        grid=grid,
        settings=settings,
        submodels=(),
        followed=(),
        stages=stages,
        left_out=left,
        decisions=(*decisions, grid_decision(grid, settings.segments)),
        notes=check_space_flow(case, vessel),
        particle_steps=particle_steps(case, settings, settings.steps),
        seconds=wall_seconds(case, settings, settings.steps, cores),
        disk_bytes=case.dem.replicas * (disk_bytes(case, settings) + sums_memory(grid, settings.segments)),
        space=vessel,
    )
