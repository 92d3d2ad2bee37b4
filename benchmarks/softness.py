"""What soft particles do to the packing: the same straight shaft with stiffer and stiffer particles.

`run` simulates, `page` writes docs/softness.md: packing of the plug as it is and corrected for the overlap.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.dem.overlap import measure_overlap
from granpipe.field import Array
from granpipe.homogenize.average import Sums
from granpipe.homogenize.conserve import measure_plug
from granpipe.homogenize.statistics import blocks
from granpipe.pipeline.averages import after_transient
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import StatisticalErrorCriterion
from granpipe.pipeline.dem_stages import simulate
from granpipe.pipeline.records import SettleRecord
from granpipe.pipeline.softness import rigid_share
from granpipe.planning.make import make_plan
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
MODULI = (5e5, 1e6, 4e6, 1.6e7, 6.4e7)
CASE = """\
name: {name}
outline: {{unit: mm, wall: [[36, 36], [36, 0]]}}
material:
  density: 2500 kg/m^3
  size: {{diameter: {{normal: {{mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}}}, classes: 3}}
contact: {{youngs_modulus: {modulus:g} Pa, friction: 0.5, rolling_friction: 0.1}}
flow_rate: 0.1 kg/s
model: dem
dem: {{max_time: 0.6 s, plate_speed: 0.03 m/s, reservoir_height: 30 mm, ranks: 1}}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--only", type=float, nargs="*", default=MODULI, help="Young's moduli")
    parser.add_argument("--results", type=Path, default=Path("results-softness"))
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "softness.md")
    options = parser.parse_args()
    if options.what == "run":
        for modulus in options.only:
            run(modulus, options.results)
    else:
        text = page(options.results)
        options.out.write_text(text)
        print(text)


def run(modulus: float, results: Path) -> None:
    """Fill, settle and let flow; leaves packing and overlap of the plug in a file."""
    results.mkdir(exist_ok=True)
    path = results / f"softness-{modulus:.0e}.yaml"
    path.write_text(CASE.format(name="softness", modulus=modulus))
    case = read_case(path).case
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    plan = make_plan(case, 1)
    with Console() as console:
        (production,) = simulate(plan, Context(store, versions, console, 1), StatisticalErrorCriterion(plan))
    steady = after_transient(list(production.sums()), plan)
    bulk = (0.0, 0.036)
    inside, d = plan.outline.inside_fraction(plan.grid), plan.dem.classes.sauter_diameter

    def packing(sums: Sums) -> float:
        return measure_plug(sums, inside, bulk, d).packing

    values = np.array([packing(block) for block in blocks(steady)])
    last = production.last_snapshot()
    z = last.position[:, 2]
    within: Array = (z > bulk[0]) & (z < bulk[1])
    overlap = measure_overlap(last.position[within], last.radius[within])
    write_json(
        path.with_suffix(".json"),
        {
            "modulus": modulus,
            "packing": values.mean(),
            "packing_se": values.std(ddof=1) / np.sqrt(len(values)),
            "overlap": overlap.mean,
            "contacts_per_particle": 2 * overlap.contacts / within.sum(),
            "settled": asdict(SettleRecord.read(production.settled).overlap),
        },
    )
    print(path.with_suffix(".json").read_text())


def page(results: Path) -> str:
    lines = [
        "# Soft particles and the packing",
        "",
        f"Made by `benchmarks/softness.py run` and `page` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        "DEM particles are far softer than the material, so that the time step can be long. Under the bed's",
        "weight they overlap, their centres come closer, and the bed becomes denser. granpipe takes that off: δ",
        "being the mean overlap of the contacts over the mean diameter, where the reference packing is measured,",
        "all packings and solids flows are multiplied by (1 − δ)³, the volume change of an affine compression",
        "that makes touching spheres overlap by δ. So φ_ref and ρ_ref = ρ_s φ_ref are the material's, ρ_ref U is",
        "its mass flux, and velocities are as simulated. Counting the lens that two spheres share only once would",
        "not do: it is of second order in δ (π/4 δ² d³ of a contact), here less than a thousandth.",
        "",
        "A straight shaft of 12 d, d = 6 mm, 2500 kg/m³, friction 0.5, rolling friction 0.1, that moves at 30 mm/s:",
        "",
        "| E [Pa] | mean overlap | contacts of a particle | packing as simulated | (1 − δ)³ | corrected |",
        "|---" * 6 + "|",
    ]
    found = [read_json(path) for path in results.glob("softness-*.json")]
    for one in sorted(found, key=lambda one: float(one["modulus"])):
        packing, error, overlap = one["packing"], one["packing_se"], one["overlap"]
        share = rigid_share(overlap)
        lines.append(
            f"| {one['modulus']:.1e} | {overlap:.2%} | {one['contacts_per_particle']:.1f} "
            f"| {packing:.4f} ± {error:.4f} | {share:.4f} | {share * packing:.4f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
