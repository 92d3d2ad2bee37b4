"""The wall factor f of the fictitious fluid: cones of some angles and wall frictions by DEM, and the fluid fit to them.

`run` simulates what is missing, each scene a case of its own; `fit` searches for every scene the f whose fluid is
nearest to DEM in the hopper, fits the law f(wall friction, half-angle), and writes granpipe/fluid/wall_factor.json and
docs/wall_factor.md.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from granpipe.analysis.compare import compare
from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.field import Field
from granpipe.fluid.fictitious import solve_fluid, to_field
from granpipe.fluid.wall_factor import MeasuredCone, WallFactorLaw
from granpipe.fluid.wall_speed import WallLaw
from granpipe.pipeline.fluid_field import section_mesh
from granpipe.pipeline.run import run_case
from granpipe.planning.flow import target_flow
from granpipe.planning.make import make_plan
from granpipe.system.jsonfile import write_json

HERE = Path(__file__).resolve().parent
DIAMETER = 6.0  # mm
ANGLES = (15.0, 26.6, 40.0)  # from the vertical
FRICTIONS = (0.1, 0.3, 0.5, 0.73)
WIDENING = 1.6  # radius of the shaft over that of the outlet


@dataclass(frozen=True)
class Scene:
    """A shaft, a cone of a half-angle [°], an outlet [d]; friction on the wall, between particles, in rolling."""

    angle: float
    friction: float
    outlet: float = 10.0
    particle_friction: float = 0.5
    rolling: float = 0.1

    @property
    def name(self) -> str:
        parts = f"cone-{self.angle:g}-{self.friction:g}-{self.outlet:g}-{self.particle_friction:g}-{self.rolling:g}"
        return parts.replace(".", "_")

    def text(self) -> str:
        radius = 0.5 * self.outlet * DIAMETER
        wide, pipe, shaft = WIDENING * radius, DIAMETER, DIAMETER
        top = pipe + (wide - radius) / math.tan(math.radians(self.angle))
        wall = [[wide, top + shaft], [wide, top], [radius, pipe], [radius, 0.0]]
        sections = f"{{shaft: [{top + shaft:.6g}, {top:.6g}], hopper: [{top:.6g}, {pipe:.6g}], outlet: [{pipe:g}, 0]}}"
        return f"""\
name: {self.name}
outline:
  unit: mm
  wall: [{", ".join(f"[{r:.6g}, {z:.6g}]" for r, z in wall)}]
  sections: {sections}
material:
  density: 2500 kg/m^3
  size: {{diameter: {{normal: {{mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}}}, classes: 3}}
contact:
  friction: {self.particle_friction:g}
  rolling_friction: {self.rolling:g}
  wall: {{friction: {self.friction:g}}}
flow_rate: 0.2 kg/s
model: dem
dem: {{max_time: 4 s, reservoir_height: {5 * DIAMETER:g} mm, ranks: 1}}
export: []
figures: []
"""


@dataclass(frozen=True)
class Measured:
    """What a cone tells: best f, the most that noise may have moved it, error of the fluid with it, dE/df, noise."""

    half_angle: float
    friction: float
    factor: float
    uncertainty: float
    error: float
    steepness: float
    noise: float

    def error_with(self, factor: float) -> float:
        """Error of the fluid with another factor."""
        return math.hypot(self.error, self.steepness * (factor - self.factor))


PROBES = (0.3, 0.6, 0.9)
SCENES = [Scene(angle, friction) for friction in FRICTIONS for angle in ANGLES]
OTHERS = [  # what the law does not know of
    Scene(26.6, 0.3, outlet=14.0),
    Scene(26.6, 0.3, particle_friction=0.73, rolling=0.21),
    Scene(26.6, 0.3, particle_friction=0.3, rolling=0.0),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "fit", "names"])
    parser.add_argument("--only", nargs="*", default=[], help="names of scenes")
    parser.add_argument("--results", type=Path, default=Path("results-wall-factor"))
    parser.add_argument("--data", type=Path, default=HERE.parent / "granpipe" / "fluid" / "wall_factor.json")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "wall_factor.md")
    options = parser.parse_args()
    scenes = [scene for scene in (*SCENES, *OTHERS) if not options.only or scene.name in options.only]
    if options.what == "names":
        print(*(scene.name for scene in scenes), sep="\n")
    elif options.what == "run":
        for scene in scenes:
            run(scene, options.results)
    else:
        report({scene: found for scene in scenes if (found := measure(scene, options.results))}, options)


def run(scene: Scene, results: Path) -> None:
    results.mkdir(exist_ok=True)
    path = results / f"{scene.name}.yaml"
    path.write_text(scene.text())
    with Console() as console:
        outcome = run_case(read_case(path), results, console)
    for gate in outcome.failed:
        print(f"failed: {gate}")


def measure(scene: Scene, results: Path) -> Measured | None:
    """The best factor of a scene that has been run: the fluid depends linearly on f, so E² is a parabola of it."""
    if not (results / scene.name / "field.npz").exists():
        return None
    case = read_case(results / f"{scene.name}.yaml").case
    plan, field = make_plan(case), Field.load(results / scene.name / "field.npz")
    mesh, inside = section_mesh(plan), plan.outline.inside_fraction(plan.grid)
    squares, noise = [], 0.0
    for factor in PROBES:
        law = WallLaw(section_factors={"hopper": factor})
        solution = solve_fluid(mesh, law, target_flow(case, field.bulk_packing))
        fluid = to_field(solution, plan.grid, inside, field.bulk_packing)
        differences = {d.name: d for d in compare(field, fluid, case.outline.levels, plan.dem.classes.sauter_diameter)}
        squares.append(differences["hopper"].observed ** 2)
        noise = differences["hopper"].noise
    curvature, slope, constant = np.polyfit(PROBES, squares, 2)
    best = -slope / (2 * curvature)
    least = constant - slope**2 / (4 * curvature) - noise**2
    error, steepness = math.sqrt(max(least, 0.0)), math.sqrt(curvature)
    return Measured(math.radians(scene.angle), scene.friction, float(best), noise / steepness, error, steepness, noise)


def fit(measured: Sequence[Measured]) -> WallFactorLaw:
    """The law by least squares in what f does to the field, with three digits."""

    def misses(coefficients: np.ndarray) -> list[float]:
        return [m.steepness * (law(coefficients).factor(m.half_angle, m.friction) - m.factor) for m in measured]

    def law(coefficients: Sequence[float], scatter: float = 0.0) -> WallFactorLaw:
        cones = tuple(MeasuredCone(m.half_angle, m.friction, m.factor, m.error, m.steepness) for m in measured)
        return WallFactorLaw(*(float(f"{c:.3g}") for c in coefficients), scatter, cones)

    found = law(least_squares(misses, (3.0, 0.15, 1.5), diff_step=0.02).x)
    off = [found.factor(m.half_angle, m.friction) - m.factor for m in measured]
    return replace(found, scatter=float(f"{np.sqrt(np.mean(np.square(off))):.2g}"))


def report(found: dict[Scene, Measured], options: argparse.Namespace) -> None:
    law = fit([measured for scene, measured in found.items() if scene in SCENES])
    cones = [
        {
            "half_angle_deg": round(math.degrees(cone.half_angle), 3),
            "friction": cone.friction,
            "factor": round(cone.factor, 3),
            "error": round(cone.error, 3),
            "steepness": round(cone.steepness, 3),
        }
        for cone in law.cones
    ]
    write_json(
        options.data,
        {
            "made_by": "benchmarks/wall_factor.py",
            "strength": law.strength,
            "friction_scale": law.friction_scale,
            "exponent": law.exponent,
            "scatter": law.scatter,
            "cones": cones,
        },
    )
    text = page(found, law)
    options.out.write_text(text)
    print(text)


def page(found: dict[Scene, Measured], law: WallFactorLaw) -> str:
    def row(m: Measured) -> str:
        fitted = law.factor(m.half_angle, m.friction)
        errors = (m.error, m.error_with(fitted), m.error_with(2 / 3), m.noise)
        values = [
            f"{math.degrees(m.half_angle):.3g}°",
            f"{m.friction:g}",
            f"{m.factor:.2f} ± {m.uncertainty:.2f}",
            f"{fitted:.2f}",
        ]
        return "| " + " | ".join(values + [f"{100 * e:.0f} %" for e in errors]) + " |"

    head = [
        "| half-angle | μ_w | best f | f by the law | error, best f | by the law | with 2/3 | noise |",
        "|---" * 8 + "|",
    ]
    lines = [
        "# The wall factor of hoppers",
        "",
        f"Made by `benchmarks/wall_factor.py run` and `fit` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        "How fast material slides down a hopper's wall, over the mean speed at its height, is the wall factor f",
        "of the fictitious fluid. Cones of some half-angles and wall frictions were simulated by DEM: an outlet",
        "of 10 particle diameters, friction between particles 0.5, rolling friction 0.1, d = 6 mm; the fluid was",
        "solved with the same outline, and f is best where the fluid differs least from DEM in the hopper",
        "(relative RMS of the velocity, noise taken off; ± is the most that noise can have moved f). The law",
        "",
        f"    f = exp(−{law.strength:g} (1 − exp(−μ_w/{law.friction_scale:g})) tan^{law.exponent:g} θ)",
        "",
        f"was fit to them; measured and fitted f differ by {law.scatter:.2f} (RMS). It is what a case gets that",
        "gives no `wall_factor`. The table is `granpipe/fluid/wall_factor.json`: plan and result tell the error",
        "to be expected, that of the nearest cone with what the scatter of the law adds.",
        "",
        *head,
        *(row(m) for scene, m in found.items() if scene in SCENES),
        "",
    ]
    if others := {scene: m for scene, m in found.items() if scene in OTHERS}:
        lines += [
            "What the law does not know of: another outlet, another friction between particles.",
            "",
            head[0].replace("| half", "| outlet/d | μ | μ_r | half"),
            "|---" * 11 + "|",
            *(f"| {s.outlet:g} | {s.particle_friction:g} | {s.rolling:g} " + row(m) for s, m in others.items()),
            "",
        ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
