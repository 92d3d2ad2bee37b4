"""Mass flow or funnel flow in cones, against Jenike's limit."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import friction_fluid
import numpy as np
import wall_factor

from granpipe.case.reader import read_case
from granpipe.case.schema import Case as CaseFile
from granpipe.field import Field, section_rows
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.jenike import MARGIN, mass_flow_limit
from validation.case import Case, Data, Verdict
from validation.simulate import rounded, run_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCES = Path(__file__).resolve().parents[1] / "references" / "friction"
LAYER = 1.0  # d along the wall
AT_REST = 0.05  # of the mean speed at the same height


FLAT = [wall_factor.Scene(60.0, 0.1), wall_factor.Scene(60.0, 0.5)]
"""Cones beyond the limit, which the wall factor does without."""


def cones(folder: Path) -> Data:
    """The cones of the wall factor, from the references that are kept of them."""
    loaded = [(scene, friction_fluid.load(REFERENCES, scene.name)) for scene in wall_factor.SCENES]
    return {scene.name: one_cone(scene, reference.plan.case, reference.field) for scene, reference in loaded}


def flat(folder: Path, number: int) -> Data:
    """A flat cone, by a run of its own."""
    scene = FLAT[number]
    field, _ = run_scene(scene.name, scene.text(), folder)
    return {scene.name: one_cone(scene, read_case(folder / f"{scene.name}.yaml").case, field)}


def one_cone(scene: wall_factor.Scene, case: CaseFile, field: Field) -> Data:
    """A cone's slowest flow along the wall over the mean at its height, and Jenike's limit [°]."""
    grid, diameter = field.grid, wall_factor.DIAMETER * 1e-3
    rows = section_rows(grid, case.outline.levels)["hopper"]
    slowest = []
    area = grid.ring_area
    for row in np.flatnonzero(rows):
        z = float(grid.z_centres[row])
        wall = radius_at(scene, z)
        down = -0.5 * (field.flux_z[row] + field.flux_z[row + 1])
        inside = grid.r_centres < wall
        near = inside & (grid.r_centres > wall - LAYER * diameter)
        mean = (down * area)[inside].sum() / area[inside].sum()
        slowest.append((down * area)[near].sum() / area[near].sum() / mean)
    friction = bulk_friction(case)
    internal, wall_angle = math.asin(friction.internal), math.atan(friction.wall)
    limit = mass_flow_limit(internal, min(wall_angle, internal))
    return {
        "half_angle": scene.angle,
        "wall_friction": scene.friction,
        "slowest": rounded(min(slowest), 3),
        "limit": None if limit is None else rounded(math.degrees(limit), 3),
        "internal": rounded(math.degrees(internal), 3),
        "wall": rounded(math.degrees(wall_angle), 3),
    }


def radius_at(scene: wall_factor.Scene, z: float) -> float:
    """Radius of the cone [m] at a height [m] above the end of its outlet pipe."""
    radius = 0.5 * scene.outlet * wall_factor.DIAMETER
    return 1e-3 * (radius + (1e3 * z - wall_factor.DIAMETER) * math.tan(math.radians(scene.angle)))


def every(data: Data) -> list[Data]:
    """All cones of all pieces."""
    return [one for piece in data.values() for one in piece.values()]


NEAR = """
    *60°, wall friction 0.1*: the cone is 3.1° above the limit, hardly outside the margin of 3°, and the limit itself
    rests on friction angles from virtual shear cells. Along the wall the solids creep at 8 % of the mean, above the 5 %
    that were agreed upon for rest; with wall friction 0.5, far above the limit, they do so at 3 %. The creep is no
    remainder of the start: the hopper's content is renewed 7.8 times, and the three thirds of the run give 8, 7 and
    8 %. Jenike's limit is one of plasticity, which knows no creep: a stricter or laxer figure for rest decides.
"""


def judge(data: Data) -> list[Verdict]:
    verdicts = []
    for one in every(data):
        limit, angle = one["limit"], one["half_angle"]
        if limit is None:
            continue
        near = abs(angle - limit) < math.degrees(MARGIN)
        mass = angle < limit
        moves = one["slowest"] > AT_REST
        verdicts.append(
            Verdict(
                f"{angle:g}°, wall friction {one['wall_friction']:g}",
                f"limit {limit:.0f}°: " + ("either" if near else "mass flow" if mass else "funnel flow"),
                f"slowest along the wall {100 * one['slowest']:.0f} % of the mean: "
                + ("mass flow" if moves else "funnel flow"),
                None if near else mass == moves,
                NEAR if angle - limit < 1.2 * math.degrees(MARGIN) else "",
            )
        )
    return verdicts


def draw(data: Data, figure: Figure) -> None:
    axes = figure.add_subplot()
    ones = every(data)
    for one in ones:
        moves = one["slowest"] > AT_REST
        axes.plot(one["wall"], one["half_angle"], "o" if moves else "x", color="C0" if moves else "C3")
        axes.annotate(f" {100 * one['slowest']:.0f} %", (one["wall"], one["half_angle"]), fontsize=8)
    internal = math.radians(ones[0]["internal"])
    walls = np.linspace(0, internal, 100)
    limits = [math.degrees(mass_flow_limit(internal, float(wall)) or 0.0) for wall in walls]
    axes.plot(np.degrees(walls), limits, "k-", lw=0.8, label="Jenike's limit")
    axes.set(xlabel="wall friction angle of the bulk, °", ylabel="half-angle of the cone, °")
    axes.set_title("o all moves, x a zone at rest; slowest flow along the wall over the mean", fontsize=9)
    axes.legend(fontsize=8)


CASE = Case(
    name="hoppers",
    title="Mass flow and funnel flow",
    about="""
        Twelve cones of three half-angles and four wall frictions, simulated on 2026-11-28 for the [wall
        factor](wall_factor.md) and kept: the flow within one particle diameter of the wall, over the mean at its
        height, at the level where it is slowest. Jenike's limit is taken for the bulk's own angles of friction, which
        virtual shear cells give for the contact parameters ([bulk friction](bulk_friction.md)): a wall's is 14° at
        most there, since particles roll along it, so that none of the twelve lies beyond the limit; two flatter cones
        of 60° were added.
    """,
    source="Jenike (1964), in the closed form of Arnold & McLean, Powder Technology 13, 255 (1976).",
    criterion="""
        More than 3° below the limit everything moves, at least at 5 % of the mean; more than 3° above it there is a
        zone at rest along the wall. (The cones had been run before this criterion was written.)
    """,
    pieces={"cones": cones} | {f"flat{number + 1}": partial(flat, number=number) for number in range(len(FLAT))},
    judge=judge,
    draw=draw,
    short=["cones"],
)
