"""Bulk and wall friction from contact parameters: a virtual shear cell of real LIGGGHTS runs.

`run` shears a layer 12 particles high between two rough plates of frozen particles under constant pressure (`bulk`), or
between a rough plate and a flat wall that slides below it (`wall`); both directions along the plates are periodic. The
upper plate moves up and down so that its pressure stays constant. `fit` fits the laws of
granpipe/fluid/bulk_friction.py to the ratios of shear to normal stress, and writes granpipe/fluid/bulk_friction.json
and docs/validation/bulk_friction.md.

Units of the runs: mean diameter, particle density and pressure are 1. Young's modulus is 2000 pressures, the inertial
number about 0.006. The stresses are those on the upper plate, from half the sliding on.
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from granpipe.fluid.bulk_friction import BulkFrictionLaw
from granpipe.system.jsonfile import read_json, write_json

HERE = Path(__file__).resolve().parent
LENGTH, WIDTH, HEIGHT = 12, 8, 12  # particles
SPACING, SPREAD = 1.22, 0.2  # of the first lattice; half the range of diameters
SPEED, TIME_STEP, SLIDING = 0.08, 0.009, 60.0  # of the lower plate or wall; sliding in all, in diameters
LOOP, GAIN, FASTEST = 200, 0.03, 0.05  # steps between two corrections of the plate's speed, and how strong they are


@dataclass(frozen=True)
class Scene:
    """Friction and rolling friction of particles; friction on the flat wall, None between two rough plates."""

    friction: float
    rolling: float
    wall: float | None = None

    @property
    def name(self) -> str:
        kind = "bulk" if self.wall is None else f"wall-{self.wall:g}"
        return f"{kind}-{self.friction:g}-{self.rolling:g}".replace(".", "_")


FRICTIONS, ROLLINGS = (0.1, 0.3, 0.5, 0.73, 1.0), (0.0, 0.1, 0.21)
SCENES = [
    Scene(0.5, 0.1),
    Scene(0.73, 0.21),
    Scene(0.5, 0.0),
    *(Scene(0.5, 0.1, wall) for wall in (0.1, 0.3, 0.5, 0.73)),
    Scene(0.73, 0.21, 0.73),
    *(Scene(friction, 0.1) for friction in (0.1, 0.3, 0.73, 1.0)),
    *(Scene(friction, 0.21) for friction in (0.3, 0.5, 1.0)),
    *(Scene(friction, 0.0) for friction in (0.1, 0.3, 1.0)),
    Scene(0.5, 0.0, 0.3),
    Scene(0.5, 0.0, 0.73),
    Scene(0.73, 0.21, 0.3),
    Scene(0.5, 0.5),
    Scene(1.0, 0.5),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["names", "run", "fit"])
    parser.add_argument("--only", nargs="*", default=[], help="names of scenes")
    parser.add_argument("--results", type=Path, default=Path("results-bulk-friction"))
    parser.add_argument("--data", type=Path, default=HERE.parent / "granpipe" / "fluid" / "bulk_friction.json")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "bulk_friction.md")
    options = parser.parse_args()
    scenes = [scene for scene in SCENES if not options.only or scene.name in options.only]
    if options.what == "names":
        print(*(scene.name for scene in scenes), sep="\n")
    elif options.what == "run":
        for scene in scenes:
            run(scene, options.results / scene.name)
    else:
        fit([scene for scene in scenes if (options.results / scene.name / "ratio.json").exists()], options)


def run(scene: Scene, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "atoms.txt").write_text("\n".join(atoms(scene)))
    (folder / "in.txt").write_text(deck(scene))
    with (folder / "screen.txt").open("w") as screen:
        subprocess.run(["liggghts", "-in", "in.txt"], cwd=folder, stdout=screen, check=True)
    step, shear, normal, height = np.loadtxt(folder / "stress.txt").T
    late = step * TIME_STEP * SPEED > 0.5 * SLIDING
    blocks = [
        np.sum(s) / np.sum(n) for s, n in zip(*(np.array_split(a[late], 8) for a in (shear, normal)), strict=True)
    ]
    ratio, error = float(np.mean(blocks)), float(np.std(blocks, ddof=1) / np.sqrt(len(blocks)))
    found = {
        "ratio": ratio,
        "error": error,
        "pressure": float(normal[late].mean()),
        "height": float(height[late].mean()),
    }
    write_json(folder / "ratio.json", found)
    print(scene.name, found, flush=True)


def atoms(scene: Scene) -> Iterator[str]:
    """A lattice with diameters at random, so that it does not order; types: 1 the layer, 2 lower and 3 upper plate."""
    random = np.random.default_rng(1)
    levels = HEIGHT + (1 if scene.wall is None else 0) + 1
    place = np.stack(np.meshgrid(*(np.arange(n) for n in (LENGTH, levels, WIDTH)), indexing="ij"), -1).reshape(-1, 3)
    kind = np.ones(len(place), dtype=int)
    kind[place[:, 1] == levels - 1] = 3
    if scene.wall is None:
        kind[place[:, 1] == 0] = 2
    diameter = 1 + SPREAD * random.uniform(-1, 1, len(place))
    position = (place + 0.5) * SPACING + 0.05 * random.uniform(-1, 1, place.shape)
    position[:, [0, 2]] *= 1.05 / SPACING
    position[:, 1] *= 1.1
    yield from ("", "", f"{len(place)} atoms", "4 atom types")
    yield f"0 {1.05 * LENGTH} xlo xhi"
    yield f"-3 {levels * SPACING * 1.1 + 3} ylo yhi"
    yield f"0 {1.05 * WIDTH} zlo zhi"
    yield from ("", "Atoms", "")
    for number, (one, d, at) in enumerate(zip(kind, diameter, position, strict=True), start=1):
        yield f"{number} {one} {d:.6f} 1.0 {at[0]:.6f} {at[1]:.6f} {at[2]:.6f}"


def deck(scene: Scene) -> str:
    wall = scene.friction if scene.wall is None else scene.wall
    pairs = {(i, j): scene.friction for i in range(4) for j in range(4)} | {(3, k): wall for k in range(4)}
    pairs |= {(k, 3): wall for k in range(4)}

    def matrix(value: float) -> str:
        return "4 " + " ".join(f"{value:g}" for _ in range(16))

    friction = "4 " + " ".join(f"{pairs[i, j]:g}" for i in range(4) for j in range(4))
    area = 1.05 * LENGTH * 1.05 * WIDTH
    lower = (
        "group lower type 2\nfix slide lower nve/noforce\nvelocity lower set ${V} 0 0\n"
        if scene.wall is None
        else "fix floor all wall/gran model hertz tangential history rolling_friction epsd2 "
        "primitive type 4 yplane 0.0 shear x ${V}\n"
    )
    return f"""\
units si
soft_particles yes
atom_style granular
atom_modify map array
boundary p f p
newton off
communicate single vel yes
read_data atoms.txt
neighbor 0.3 bin
neigh_modify delay 0
fix m1 all property/global youngsModulus peratomtype 2000 2000 2000 2000
fix m2 all property/global poissonsRatio peratomtype 0.3 0.3 0.3 0.3
fix m3 all property/global coefficientRestitution peratomtypepair {matrix(0.43)}
fix m4 all property/global coefficientFriction peratomtypepair {friction}
fix m5 all property/global coefficientRollingFriction peratomtypepair {matrix(scene.rolling)}
fix m6 all property/global coefficientRollingViscousDamping peratomtypepair {matrix(0.2)}
pair_style gran model hertz tangential history rolling_friction epsd2
pair_coeff * *
variable V equal {SPEED}
{lower}group upper type 3
fix hold upper freeze
group free type 1 3
fix move free nve/sphere
timestep {TIME_STEP}
thermo 20000
compute top upper reduce ave y
variable shear equal f_hold[1]/{area}
variable normal equal f_hold[2]/{area}
variable up equal (v_normal-1)*{GAIN}
variable speed equal "{FASTEST}*((v_up>{FASTEST})-(v_up<-{FASTEST}))+v_up*(v_up<={FASTEST})*(v_up>=-{FASTEST})"
fix stress all ave/time 4 {LOOP // 4} {LOOP} v_shear v_normal c_top file stress.txt
variable loop loop {round(SLIDING / SPEED / TIME_STEP / LOOP)}
label again
variable now equal ${{speed}}
velocity upper set NULL ${{now}} NULL
run {LOOP} post no
next loop
jump SELF again
"""


def fit(scenes: list[Scene], options: argparse.Namespace) -> None:
    """Both laws by least squares; writes data and page."""
    found = {scene: read_json(options.results / scene.name / "ratio.json") for scene in scenes}
    bulk = [(scene, found[scene]["ratio"]) for scene in scenes if scene.wall is None]
    walls = [(scene, scene.wall, found[scene]["ratio"]) for scene in scenes if scene.wall is not None]

    def law(values: list[float]) -> BulkFrictionLaw:
        return BulkFrictionLaw(*(float(f"{value:.3g}") for value in values))

    def misses(values: list[float]) -> list[float]:
        one = BulkFrictionLaw(*values)
        off = [one.internal(scene.friction, scene.rolling) - ratio for scene, ratio in bulk]
        return off + [one.wall(contact, s.friction, s.rolling) - ratio for s, contact, ratio in walls]

    start, most = [0.15, 0.35, 0.15, 0.1, 0.2, 0.2, 0.5], [0.4, 0.6, 1, 1, 1, 1, 5]
    best = law(list(least_squares(misses, start, bounds=([0, 0.1, 0, 0.02, 0.02, 0.01, 0], most)).x))
    off = [float(abs(value)) for value in misses(list(vars(best).values())[:7])]
    scatter = [float(f"{np.sqrt(np.mean(np.square(part))):.2g}") for part in (off[: len(bulk)], off[len(bulk) :])]
    names = list(vars(best))
    data = dict(zip(names, [*list(vars(best).values())[:7], *scatter], strict=True))
    rows = [
        {"friction": s.friction, "rolling": s.rolling, "wall": s.wall, **{k: round(v, 4) for k, v in found[s].items()}}
        for s in scenes
    ]
    write_json(options.data, {"made_by": "benchmarks/bulk_friction.py", "law": data, "runs": rows})
    options.out.write_text(page(rows, BulkFrictionLaw(**data)))


def page(rows: list[dict[str, float]], law: BulkFrictionLaw) -> str:
    lines = [
        "# Bulk friction from contact parameters",
        "",
        f"Made by `benchmarks/bulk_friction.py run` and `fit` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        f"A layer of particles {HEIGHT} diameters high (diameters ± {SPREAD:.0%}) is sheared between two rough plates,",
        "or between a rough plate and a flat wall that slides, at constant pressure of 1/2000 of Young's modulus. The",
        "ratio of shear to normal stress is μ_i, or μ_w of the bulk on that wall; ± is the standard error of 8 blocks.",
        "The laws stand in `granpipe/fluid/bulk_friction.py`, their coefficients in `bulk_friction.json`;",
        f"measured and fitted differ by {law.scatter:.2g} (μ_i) and {law.wall_scatter:.2g} (μ_w), root mean square.",
        "On a rough flat wall particles roll: the bulk's friction there is then less than that of the contacts.",
        "",
        "| μ | μ_r | μ on the wall | measured | law | pressure |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        mu, rolling, wall = row["friction"], row["rolling"], row["wall"]
        fitted = law.internal(mu, rolling) if wall is None else law.wall(wall, mu, rolling)
        place = "rough plate" if wall is None else f"{wall:g}"
        measured = f"{row['ratio']:.3f} ± {row['error']:.3f}"
        lines.append(f"| {mu:g} | {rolling:g} | {place} | {measured} | {fitted:.3f} | {row['pressure']:.2f} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
