"""An earlier run of the synthetic study's scene, with the material's own particles: in memory, and as a folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from fakes.study_points import CASE, OWN, PER_DIAMETER, PER_SPEED, shapes

from granpipe.case.reader import varied
from granpipe.field import Field, flux_from_psi
from granpipe.pipeline.results import plan_summary
from granpipe.planning.flow import target_flow
from granpipe.planning.make import make_plan
from granpipe.study.reference import EarlierRun
from granpipe.system.manifest import write_manifest

SLOW = 0.015  # m/s
SETTINGS = {"dem.coarse_grain_factor": "1", "dem.plate_speed": repr(SLOW), "dem.seed": "9"}


def earlier(sigma: float = 0.0, **changes: str) -> EarlierRun:
    """A run with the material's own particles and the plate at SLOW, made for twice the flow rate of the case."""
    plan = make_plan(varied(CASE, SETTINGS | {key.replace("__", "."): value for key, value in changes.items()}))
    grid, dem = plan.grid, plan.dem
    t = (grid.r_edges / grid.r_edges[-1]) ** 2
    strength = PER_DIAMETER * (dem.classes.sauter_diameter - OWN) + PER_SPEED * dem.plate_speed
    psi = np.tile(-(t + strength * t * (1 - t)), (len(grid.z_edges), 1))
    flux_r, flux_z = flux_from_psi(psi, grid)
    scale = np.abs(shapes(grid)[0][1]).mean()
    flux_z += sigma * scale * np.random.default_rng(11).standard_normal(flux_z.shape)
    ones, none, error = np.ones(grid.shape), np.zeros_like(flux_r), np.full_like(flux_z, sigma * scale / np.sqrt(2))
    flow = target_flow(CASE, 1.0)  # at which the velocities are those of the points
    field = Field(grid, ones, ones > 0, flux_r, flux_z, flow, 1.0, 2.0, psi=psi, flux_r_se=none, flux_z_se=error)
    return EarlierRun(Path("limit"), plan, field, 30.0, 0.4, 20.0, 500.0, 2, ("packing in the plug 0.7",))


def results(folder: Path, changes: Callable[[dict], None] = lambda _: None, **case: str) -> Path:
    """A results folder of such a run, with what a reference is read from."""
    folder.mkdir()
    run = earlier(0.01, **case)
    field = replace(run.field, bulk_flow=2 * np.pi, flux_r_se=np.zeros_like(run.field.flux_r))
    still = replace(field, inside_fraction=run.plan.outline.inside_fraction(field.grid), flux_z=flux_from_psi(
        field.psi, field.grid)[1])  # fmt: skip
    still = replace(still, bulk=still.inside_fraction > 0)
    stored = {
        "case": "smoke",
        "origin": {"file": "/srv/cases/smoke.yaml", "outline": "1", "case": "2"},
        "wall_seconds": 1.0,
        "quality": [{"name": "packing", "value": 0.7, "limit": "0.5 to 0.68", "passed": False}],
        "figures": {
            "effective_blocks": 30.0,
            "averaged_plate_travel_m": 0.3,
            "averaged_to_s": 20.0,
            "processor_seconds": [500.0],
        },
    }
    files = {"field": still, "plan": plan_summary(run.plan), "provenance": stored}
    changes(files)
    files["field"].save(folder / "field.npz")
    (folder / "case.yaml").write_text(run.plan.case.to_yaml())
    for name in ("plan", "provenance"):
        (folder / f"{name}.json").write_text(json.dumps(files[name]))
    write_manifest(folder)
    return folder
