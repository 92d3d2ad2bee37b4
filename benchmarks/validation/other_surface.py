"""The free surface below a widening by LAMMPS and by LIGGGHTS, from the same settled bed."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import free_surface
import numpy as np

from granpipe.analysis.compare import compare
from granpipe.dem.dump import first_step, read_snapshot
from granpipe.dem.snapshot import OWN_COLUMNS
from granpipe.field import Field
from granpipe.planning.plan import Plan
from validation.case import Case, Data, Verdict
from validation.lammps import bed_data, cylinder, deck, ring, run_lammps, version
from validation.other_code import ONE_SPEED, homogenize
from validation.simulate import production_of, rounded, run_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "widening"
SCENE = free_surface.Scene(0.5, 0.1, 60.0)
SECONDS, START = 9.0, 4.0  # in 1.5 s the chamber still fills: granpipe refuses a field then
WINDOW = (START, SECONDS)
RESERVOIR = 320  # mm: enough for the whole run, so that LAMMPS needs no feed
SNAPSHOTS = 10  # of the window, whose surfaces are averaged
GAP = 1e-3  # m between walls that end at one edge, so that a particle there touches one of them
VELOCITY, ANGLE = 0.05, 3.0  # relative, degrees

MM = 1e-3 * free_surface.DIAMETER
THROAT, CHAMBER = free_surface.THROAT * MM, free_surface.CHAMBER * MM
FLOOR, CEILING = free_surface.PIPE * MM, (free_surface.PIPE + free_surface.HEIGHT) * MM


def text() -> str:
    own = f"dem: {{max_time: {SECONDS:g} s, reservoir_height: {5 * free_surface.DIAMETER:g} mm, ranks: 1}}"
    dem = f"{{max_time: {SECONDS:g} s, start_speed: {ONE_SPEED}, reservoir_height: {RESERVOIR} mm, ranks: 1"
    written = SCENE.text(SECONDS)
    assert own in written
    return written.replace(own, f"dem: {dem}, keep_snapshots: all}}\nhomogenize: {{start: {START:g} s}}").replace(
        f"name: {SCENE.name}", f"name: {NAME}"
    )


def liggghts(folder: Path) -> Data:
    """The scene by granpipe's own LIGGGHTS."""
    run_scene(NAME, text(), folder)
    plan, production = production_of(NAME, folder)
    dumps = list((production.folder / "snapshots").glob("*.bin"))
    homogenize(dumps, plan, folder / f"{NAME}.yaml", "liggghts", WINDOW)
    return {"angles": angles(dumps, plan), "particles": len(read_snapshot(dumps[0], OWN_COLUMNS))}


def lammps(folder: Path) -> Data:
    """The same by LAMMPS from the bed that LIGGGHTS settled, and how far the fields are apart."""
    plan, production = production_of(NAME, folder)
    bed = read_snapshot(production.settled / "settled.bin", OWN_COLUMNS)
    work = folder / "lammps"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    (work / "bed.data").write_text(bed_data(bed, plan.case.material.density))
    (work / "in.lammps").write_text(deck(plan, walls(plan), SECONDS, every=plan.dem.dump_every))
    seconds = run_lammps(work)
    dumps = list(work.glob("dump.*.txt"))
    homogenize(dumps, plan, folder / f"{NAME}.yaml", "lammps", WINDOW)
    one, other = (Field.load(folder / f"field-{label}" / "field.npz") for label in ("liggghts", "lammps"))
    found = compare(one, other, plan.case.outline.levels, plan.dem.classes.sauter_diameter)
    return {
        "version": version(work),
        "processor_seconds": rounded(seconds, 4),
        "particles": len(bed),
        "angles": angles(dumps, plan),
        "apart": {d.name: rounded([d.observed, d.noise, d.noise_free, d.upper], 4) for d in found},
    }


def walls(plan: Plan) -> dict[str, str]:
    """Exact walls: two pipes, the chamber between them, its ceiling and its floor."""
    return {
        "throat": cylinder(THROAT, CEILING, 0.5),
        "ceiling": ring(THROAT + GAP, CHAMBER, CEILING),
        "chamber": cylinder(CHAMBER, FLOOR, CEILING),
        "floor": ring(THROAT, CHAMBER + GAP, FLOOR),
        "pipe": cylinder(THROAT, plan.dem.bottom, FLOOR - GAP),
        "plate": f"plane 0 0 {plan.dem.plate_z:.10g} 0 0 1 move NULL NULL v_sunk",
    }


def angles(dumps: Iterable[Path], plan: Plan) -> list[list[float]]:
    """Angle of the surface and its standard error [°] in some snapshots of the window."""
    times = {path: first_step(path) * plan.dem.time_step for path in dumps}
    chosen = [min(times, key=lambda path: abs(times[path] - time)) for time in np.linspace(*WINDOW, SNAPSHOTS)]
    return [rounded(list(free_surface.surface(read_snapshot(path, OWN_COLUMNS))), 4) for path in chosen]


def mean_angle(one: Data) -> tuple[float, float]:
    """Mean of the snapshots, and the mean of their standard errors: the same particles lie on all of them [°]."""
    values = np.array(one["angles"])
    return float(values[:, 0].mean()), float(values[:, 1].mean())


def judge(data: Data) -> list[Verdict]:
    if "lammps" not in data:
        return []
    (own, own_se), (other, other_se) = (mean_angle(data[code]) for code in ("liggghts", "lammps"))
    off, reach = abs(own - other), 1.96 * float(np.hypot(own_se, other_se))
    verdicts = [
        Verdict(
            "angle of the free surface",
            f"LAMMPS {other:.1f} ± {1.96 * other_se:.1f}°",
            f"{own:.1f} ± {1.96 * own_se:.1f}°",
            False if off - reach > ANGLE else True if off <= ANGLE else None,
        )
    ]
    for name, (_, noise, free, upper) in data["lammps"]["apart"].items():
        passed = True if upper <= VELOCITY else (False if free > VELOCITY else None)
        found = f"differs by {100 * free:.1f} %, 95 % below {100 * upper:.1f} %"
        verdicts.append(Verdict(f"velocity, {name}", f"LAMMPS, noise {100 * noise:.1f} %", found, passed))
    return verdicts


def draw(data: Data, figure: Figure) -> None:
    axes = figure.add_subplot()
    for code, colour in (("liggghts", "C0"), ("lammps", "C1")):
        if one := data.get(code):
            value, error = np.array(one["angles"]).T
            axes.errorbar(np.linspace(*WINDOW, SNAPSHOTS), value, 1.96 * error, fmt=f"{colour}o-", lw=0.8, label=code)
    axes.set(xlabel="time, s", ylabel="angle of the free surface, °")
    axes.legend(fontsize=8)


CASE = Case(
    name="other_surface",
    title="Another DEM code below a widening",
    about=f"""
        A throat of 8 d opens into a chamber 7 d wider on each side, whose corner stands still
        ([its own page](free_surface.md); μ {SCENE.friction:g}, μ_r {SCENE.rolling:g}). The bed that LIGGGHTS settled
        goes to LAMMPS, as above; the chamber's floor and ceiling are rings. The angle is the mean of {SNAPSHOTS}
        snapshots from {START:g} to {SECONDS:g} s, its error (±: 95 %) that of one of them, from 8 sectors.
    """,
    source="LAMMPS, as above.",
    criterion=f"""
        The angles differ by at most {ANGLE:g}°; in every section the 95 % bound of the noise-free relative RMS
        difference of the velocity is at most 5 % (not resolved: the difference is below, its bound above).
    """,
    pieces={"liggghts": liggghts, "lammps": lammps},
    judge=judge,
    draw=draw,
)
