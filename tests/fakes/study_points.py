"""Points of a study without runs: fields of known dependence on particle size, speed and friction, under noise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granpipe.case.reader import load_case, varied
from granpipe.case.schema import Case
from granpipe.field import Field, flux_from_psi
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.study.axes import BASE
from granpipe.study.findings import Comparison, StudyPoint

CASES = Path(__file__).parents[2] / "cases"
CASE = load_case(
    CASES / "smoke.yaml",
    {
        "material.size": "{diameter: 1 cm}",
        "dem.coarse_grain_factor": "1.5",
        "dem.plate_speed": "0.02",
        "homogenize.cell": "2.5 mm",
        "dem.ranks": "1",
    },
)
OWN = 0.01  # m, the material's own diameter
PER_DIAMETER, PER_SPEED, PER_FRICTION, PER_MASS = 6.0, 2.0, 0.5, 0.8
"""Relative change of the profile with the diameter beyond the material's own [1/m], the speed [s/m], friction, and the
mass that mass scaling adds."""


@dataclass
class Segment:
    duration: float


@dataclass
class FakeRun:
    """Segments that only tell how long they are."""

    segments: list
    plan: Plan
    ends: tuple[float, ...] = ()


def shapes(grid):
    """Two fluxes: a plug, and one that carries nothing in sum but has a profile."""
    t = (grid.r_edges / grid.r_edges[-1]) ** 2
    rows = len(grid.z_edges)
    plug, bump = np.tile(-t, (rows, 1)), np.tile(-(t * (1 - t)), (rows, 1))
    return flux_from_psi(plug, grid), flux_from_psi(bump, grid)


def point(
    name: str,
    axis: str,
    changes: dict[str, str],
    sigma: float,
    seed: int,
    case: Case = CASE,
    per_speed: float = PER_SPEED,
) -> StudyPoint:
    """Profile strength: as the diameter and the speed have it."""
    plan = make_plan(varied(case, changes))
    grid, rng = plan.grid, np.random.default_rng(seed)
    (plug_r, plug_z), (bump_r, bump_z) = shapes(grid)
    diameter, speed = plan.dem.classes.sauter_diameter, plan.dem.plate_speed
    strength = PER_DIAMETER * (diameter - OWN) + per_speed * speed
    strength += PER_FRICTION * (plan.case.contact.friction - CASE.contact.friction)
    strength += PER_MASS * (plan.dem.classes.mass_factor - 1)
    scale = np.abs(plug_z).mean()
    flux_z = plug_z + strength * bump_z + sigma * scale * rng.standard_normal(plug_z.shape)
    error_z = np.full_like(flux_z, sigma * scale / np.sqrt(2))  # two faces make the middle of a cell
    ones = np.ones(grid.shape)
    field = Field(
        grid, ones, ones > 0, plug_r + strength * bump_r, flux_z, 1.0, 1.0, 1.0,
        flux_r_se=np.zeros_like(plug_r), flux_z_se=error_z,
    )  # fmt: skip
    finished = FakeRun([Segment(1.0)], plan)
    return StudyPoint(name, axis, changes, plan, field, finished, 10.0, 1, 10.0)  # type: ignore[arg-type]


def study(sigma: float, seed: int = 1) -> Comparison:
    points = [
        point(BASE, "", {}, sigma, seed),
        point("coarse", "coarse_grain_factor", {"dem.coarse_grain_factor": "2"}, sigma, seed + 1),
        point("fine", "coarse_grain_factor", {"dem.coarse_grain_factor": "1.2"}, sigma, seed + 2),
        point("fast", "plate_speed", {"dem.plate_speed": "0.04", "dem.max_time": "4"}, sigma, seed + 3),
        point("slow", "plate_speed", {"dem.plate_speed": "0.01", "dem.max_time": "16"}, sigma, seed + 4),
    ]
    return Comparison(CASE, points)


def norm_of_profile(made: Comparison) -> float:
    """E of the profile at unit strength against the reference, by the definition."""
    grid = made.reference.field.grid
    (_, _), (_, bump) = shapes(grid)
    best = made.reference.field.flux_z
    middle = lambda flux: 0.5 * (flux[1:] + flux[:-1])  # noqa: E731
    return float(np.sqrt((grid.ring_area * middle(bump) ** 2).sum() / (grid.ring_area * middle(best) ** 2).sum()))
