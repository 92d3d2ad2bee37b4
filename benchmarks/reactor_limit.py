"""The test reactor with the material's own particles, against which everything else is measured.

`pack` makes benchmarks/references/reactor_limit/ of the results of such runs, one of each filling: a results folder
with what `granpipe study --reference` and `page` read, and no more. `page` compares with it: results that are given
(other seeds, enlarged particles, walls set back, hybrids), the stored field of
benchmarks/references/friction/reactor.npz, both fluids, the hybrid that follows the stored field, and combinations of
them; it writes docs/validation/reactor_limit.md.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from friction_fluid import _enlarge, load, viscous
from set_back import told

from granpipe.analysis.compare import Difference, compare
from granpipe.analysis.regrid import on_grid
from granpipe.case.reader import load_case, resolve, varied
from granpipe.case.schema import Case
from granpipe.case.yamlfile import Places
from granpipe.dem.sizes import size_classes
from granpipe.errors import GranpipeError
from granpipe.field import Array, Field, Grid, flux_from_psi, section_rows
from granpipe.pipeline.averages import statistical_errors
from granpipe.pipeline.context import Context
from granpipe.pipeline.field_vessel import check_case
from granpipe.pipeline.frictional_field import solve_plan
from granpipe.pipeline.hybrid_field import hybrid_field
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.flow import target_flow
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent, duration_text
from granpipe.study.reference import FILES, EarlierRun, read_run, scene_differences
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.manifest import verify
from granpipe.system.publish import renewing
from granpipe.system.store import Store

HERE = Path(__file__).resolve().parent
LIMIT = HERE / "references" / "reactor_limit"
STORED = HERE / "references" / "friction"
DENSITY = "559 kg/m^3"  # of the bulk, as DEM measures it in the plug; fluids need one
PLACES = 24, 10, 10, 12  # binary places that are kept of ψ and fluxes, shares, errors, packing

HEAD = """\
# The test reactor with its own particles

{made}

`cases/reactor.yaml` enlarges the material's particles, 3 ± 1 cm in radius, twice. Here everything is measured against
runs with the material's own (`dem.coarse_grain_factor` 1), the *limit*. It is kept in
`benchmarks/references/reactor_limit/`, a results folder with the field and its settings alone; `granpipe study
cases/reactor.yaml --reference benchmarks/references/reactor_limit` counts the errors of a study from it, and `make
study-reactor` does.

```text
granpipe run cases/reactor.yaml --set name=limit_seed1 --set dem.coarse_grain_factor=1 --set dem.ranks=2 \\
    --set dem.mass_scaling=none --set 'dem.max_time=9.28 s' --set 'dem.statistical_error=2.5 %'
granpipe run cases/reactor.yaml --set name=limit_seed3 --set dem.coarse_grain_factor=1 --set dem.ranks=1 \\
    --set dem.mass_scaling=none --set 'dem.max_time=10 s' --set 'dem.statistical_error=2.2 %' --set dem.seed=3
python benchmarks/reactor_limit.py pack results/limit_seed1 results/limit_seed3
python benchmarks/reactor_limit.py page RESULTS …
```

Errors are E = √(Σ A |δU|² / Σ A |U|²) of the bulk velocity over the cells that both call bulk, over the whole and by
section. Fields on other cells are compared on the larger of both, by their stream functions, which changes a smeared
flow by 0.5 to 1.2 %. *Beyond noise*: with the noise of both taken off, ± its standard error, or “<” its 95 % bound
where noise explains it. *In all* has the noise that the run itself told in it: the error that a user gets, and its 95 %
bound. The limit is the mean of two fillings. It has an error of its own: its noise, which is taken off, and its plate,
softness and step, which are not.
"""

SAYS = """\
**What it says** (runs of 2026-11-30 and 12-01, with E 5 MPa and mass scaling, but for the limit, the softer and
stiffer ones and the run as shipped; those of the material's own size for 6 s, enlarged 1.1 times and `drawn` in [beds
filled](filling.md) up to the feed and brought to rest, with more bed above the inlet and below the outlet, and
averaged from the [onset](onset.md) of before). The two fillings of the limit are 1.2 % apart beyond noise (95 % bound
1.6; `granpipe compare`). The material's own particles, in a third filling, are 3.2 % from it after 16 s of production;
in two others, after 6 s, 3.4 and 4.4 %, in 19 min and 18 min; how far from each other fillings can be in 6 s, and what
is left of the transient, is in these figures. With all noise, enlarged 1.25 times they are 4.0 % (95 % bound 4.3) from
it in 9 min 14 s and 3.7 % (4.0) in 9 min 20 s, two fillings of 14 s; 4.6 % (4.9) and 4.2 % (4.6) in 11 min where the
bed came nearly to rest before the faster start, and 4.1 and 4.2 % after 16 s; enlarged 1.1 times, after 6 s, 3.5 %
(3.9) in 16 min 13 s and 4.8 % (5.2) in 18 min 35 s; enlarged 1.5 times 7.0 % (7.5) in 7 min 38 s and 7.4 % (7.7) in 6
min 32 s; enlarged 1.75 times with 2.5 MPa, three fillings of 12 s, 7.8 % (8.5) in 1 min 49 s, 8.6 % (9.1) in 1 min 48
s and 7.6 % (8.0) in 1 min 49 s; enlarged 1.75 times with 5 MPa 8.8 % (9.2) in 3 min 59 s; all between walls [set
back](set_back.md), as they are by default. Enlarged twice, as the case is shipped and with nothing set, 10.7 % (11.2)
in 2 min 49 s, all gates passed. Between walls as drawn, enlarged twice they were 13.6 and 14.3 % away beyond noise,
enlarged 1.5 times 9.4 %. A softer bed, 2.5 MPa, is not farther away, nor one of 20 MPa nearer. On a plate at 0.06 m/s
the material's own particles are 6.6 % away, most below the widening; on one at 0.012 m/s 5.4 %, most in d.

**Shorter.** What three fillings keep within 10 % by their bounds, in two minutes each, are the 12 s enlarged 1.75
times with 2.5 MPa, between walls set back, with a bed that had [only fallen into place](filling.md) before the faster
start (`…_fallen`). With beds that came nearly to rest first, one of two was 9.6 % away (10.2) after 12 s and 2 min 24
s; the other had no field then, for flow through a throat seven diameters wide comes in bursts, and 23 % of it
gathered, and was 9.6 % away (10.2) after 16 s and 2 min 54 s; with 5 MPa one of two had none after 14 s. Such a chance
is left: of what passes 13 to 18 % gathered in five of the eight `…_fallen` of 12 to 16 s, and 20 % are refused.

The limit has a plate of its own, at 0.034 m/s, and E 9.7 MPa. By the points of `make study-reactor`, three of them
with the material's own particles on plates at 0.012, 0.024 and 0.06 m/s, and three stiffnesses in three fillings with
ones twice as large, it is 7.9 % (at most 8.3) from no speed and no softness: [error against time](study_reactor.md).
(The same points with beds that came nearly to rest made it 9.1, at most 9.4, and averaged from half a diameter after
the faster start 9.7, at most 10.0: the bound holds noise, not what filling and start change.) A run that this does not
go by, with the material's own particles and a plate at 0.006 m/s, is 9.4 % from the reference, noise off, and not to
be told from the limit that the others tell: below 2.7 %.

Runs of `own` for 16 s, `own_fast`, `own_slow` and most of `enlarged_…` are like points of `make study-reactor`; the
others are `granpipe run cases/reactor.yaml --set dem.coarse_grain_factor=… --set contact.youngs_modulus=5e6 --set
dem.plate_speed=0.024 --set dem.max_time=… --set dem.seed=… --set dem.ranks=1 --set 'dem.statistical_error=0.1 %'`,
with `--set dem.walls=as_drawn` for `drawn`, and `granpipe run cases/reactor.yaml --set dem.ranks=1` as shipped. One to
four other programs shared two cores with each: a particle-step took 0.47 µs with 96 000 particles, 0.39 where one
other ran; within two hours one deck took 0.33 and 0.43 µs beside one other, so times are good to a fifth. Runs of 14 s
and the one as shipped have their plate 0.4 diameters nearer to the outlet, those of 14 s a [wider
skin](deck_levers.md); `…_fallen` and the one as shipped have beds that had only fallen into place. Most are marked,
the one as shipped is not: the soft beds overlap by 5.4 to 6.2 % in their 99th percentile (8.4 % with 2.5 MPa), 5.0 are
allowed, and short averages rest on fewer than the 20 independent blocks that are wanted, so that their own error bars
are uncertain.

The filling that fails a gate, below, has a free surface that is bent; by the [gate of today](../reference/gates.md),
what a bend can change in the field, that is 0.45 % of section d for the mean of both, and no mark.

Earlier runs, in beds that were dropped in, are not in the tables any more. At the automatic plate speed of 0.031 m/s
two fillings of the material's own particles were 1.4 and 2.3 % from the limit after 9 s, on a plate at 0.05 m/s 4.8 %.
Neither [going on in size](several_runs.md) from two runs nor means with the frictional fluid nor its change with size
is clearly better on the whole than the finer run alone.
"""

FOUND = """\
Fluids go by the contact parameters alone (bulk density {density}); *frictional fluid, 6 cm* takes the
particles for as large as those of runs with that size. The stored field has its noise by section, not by cell.
Combinations of DEM runs: *mean* is that of all with particles of one size; *half and half* is the mean of a run and the
frictional fluid at the material's size; *size by the fluid* is the run, plus the fluid at the material's size, less the
fluid at the run's. [Several runs](several_runs.md) are added up on a page of their own. Processor time is that of
LIGGGHTS, filling included where the results tell it, or that of the fluid.
"""


@dataclass(frozen=True)
class Entry:
    """A field to compare with the limit.

    Parameters
    ----------
    field : on its own cells
    diameter : of the particles that it is of [m]; 0 for a fluid
    size : mean radius of these, as text
    statistical : section → error that the run told; empty where there is none
    seconds : processor time as text
    walls : as_drawn or set_back for a DEM run of the whole vessel; empty for other models, which are not combined
    """

    name: str
    field: Field
    diameter: float
    size: str = ""
    statistical: Mapping[str, float] = field(default_factory=dict)
    seconds: str = ""
    walls: str = ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["pack", "page"])
    parser.add_argument("results", type=Path, nargs="*", help="pack: those of the limit; page: what to compare as well")
    parser.add_argument("--limit", type=Path, default=LIMIT, help="results folder of the limit, packed or not")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "reactor_limit.md")
    options = parser.parse_args()
    if options.what == "pack":
        if not options.results:
            parser.error("pack takes results folders, one of each filling")
        pack(options.results, options.limit)
    else:
        options.out.write_text(page(options.limit, options.results))
        print(options.out.read_text())


# ── the limit as a small results folder ──────────────────────────────────────


def pack(folders: Sequence[Path], target: Path) -> None:
    """The results folder of a run with what a reference needs alone, its field to the digits that mean something.

    Of several fillings it is that of the first, as if they were its replicas: the field is their mean, by travel.
    """
    runs = [read_run(folder) for folder in folders]
    for run in runs[1:]:
        if apart := [*scene_differences(runs[0].plan.case, run.plan.case)]:
            raise SystemExit(f"{run.folder}: another scene: {'; '.join(apart)}")
    travel = sum(run.travel for run in runs)
    mean = mixed([(run.travel / travel, at_flow_of(runs[0].field, run.field)) for run in runs])
    with renewing(target, print) as aside:
        lean(mean).save(aside / "field.npz")
        shutil.copyfile(folders[0] / "plan.json", aside / "plan.json")
        case = varied(load_case(folders[0] / "case.yaml"), {"dem.replicas": str(len(runs))})
        (aside / "case.yaml").write_text(case.to_yaml())
        told = read_json(folders[0] / "provenance.json")
        told["origin"]["file"] = Path(told["origin"]["file"]).name  # its folder is that of one machine
        others = [read_json(folder / "provenance.json") for folder in folders[1:]]
        told["quality"] += [
            gate for other in others for gate in other["quality"] if gate["name"] != "independent blocks"
        ]  # of which each filling has its own
        told["figures"] |= {
            "effective_blocks": sum(run.blocks for run in runs),
            "averaged_plate_travel_m": travel,
            "averaged_to_s": max(run.time for run in runs),
            "processor_seconds": [
                spent for one in (told, *others) for spent in one["figures"].get("processor_seconds", [])
            ],
            "statistical_error": statistical_errors(mean, runs[0].plan.case.outline.levels),
        }
        write_json(aside / "provenance.json", told)
    size = sum(file.stat().st_size for file in target.iterdir())
    print(f"{target}: {size / 1e3:.0f} kB")
    for gate in dict.fromkeys(gate for run in runs for gate in run.failed):
        print(f"quality gate failed: {gate}")


def at_flow_of(one: Field, other: Field) -> Field:
    """Another field with fluxes at the flow of solids of the first."""
    scale = one.bulk_flow * one.bulk_packing / (other.bulk_flow * other.bulk_packing)
    return replace(scaled(other, scale), bulk_flow=one.bulk_flow, bulk_packing=one.bulk_packing)


def lean(one: Field) -> Field:
    """Without plain averages and what else was asked for; ψ as in single precision, errors to three digits."""
    assert one.psi is not None
    smooth, shares, errors, packing = PLACES
    psi = rounded(one.psi, smooth)
    flux_r, flux_z = (rounded(flux, smooth) for flux in flux_from_psi(psi, one.grid))
    return replace(
        one,
        inside_fraction=rounded(one.inside_fraction, shares),
        psi=psi,
        flux_r=flux_r,
        flux_z=flux_z,
        packing_fraction=None if one.packing_fraction is None else rounded(one.packing_fraction, packing),
        flux_r_se=None if one.flux_r_se is None else rounded(one.flux_r_se, errors),
        flux_z_se=None if one.flux_z_se is None else rounded(one.flux_z_se, errors),
        raw_flux_r=None,
        raw_flux_z=None,
        raw_flux_r_se=None,
        raw_flux_z_se=None,
        extra={},
    )


def rounded(values: Array, places: int) -> Array:
    """To so many binary places of each value, so that it packs well."""
    part, power = np.frexp(values)
    return np.asarray(np.ldexp(np.round(part * 2.0**places), power - places))


# ── what is compared ─────────────────────────────────────────────────────────


def page(limit_folder: Path, folders: Sequence[Path]) -> str:
    limit = read_run(limit_folder)
    made = f"Made by `benchmarks/reactor_limit.py page` on {datetime.now(UTC):%Y-%m-%d}."
    with tempfile.TemporaryDirectory() as scratch:
        entries = [*(result(folder, limit) for folder in folders), stored(limit)]
        models = list(fluids(limit, Path(scratch)))
    rows = [*entries, *models, *combined(limit, entries)]
    return "\n".join([HEAD.format(made=made), SAYS, *tables(limit, rows), FOUND.format(density=DENSITY)])


def result(folder: Path, limit: EarlierRun) -> Entry:
    """A results folder of the same scene, of any model."""
    verify(folder, *FILES)
    case, own = load_case(folder / "case.yaml"), Field.load(folder / "field.npz")
    check_case(own, case, folder / "field.npz")
    if apart := list(scene_differences(limit.plan.case, case)):
        raise SystemExit(f"{folder}: another scene: {'; '.join(apart)}")
    planned, record = read_json(folder / "plan.json"), read_json(folder / "provenance.json")
    particles = case.model != "fluid" and ("dem" in planned or planned["submodels"])
    diameter = size_classes(case.material.size).sauter_diameter * case.dem.coarse_grain_factor if particles else 0.0
    return Entry(
        name=folder.name,
        field=unit(own, limit.plan.case),
        diameter=diameter,
        size=radius_text(limit, diameter),
        statistical=record["figures"].get("statistical_error", {}),
        seconds=time_told(planned, record),
        walls=walls_told(planned) if planned["model"] == "dem" else "",
    )


def walls_told(planned: Mapping[str, Any]) -> str:
    """Between which walls a DEM run was simulated."""
    told = {one["name"]: one["value"] for one in planned["dem"]["decisions"]}
    return "set_back" if told.get("walls", "as drawn") != "as drawn" else "as_drawn"


def time_told(planned: Mapping[str, Any], record: Mapping[str, Any]) -> str:
    """Processor time of a run; that of production alone where its results tell no more."""
    figures = record["figures"]
    if "processor_seconds" in figures:
        return duration_text(sum(figures["processor_seconds"]))
    if "produce_wall_seconds" in figures:
        return f"{duration_text(sum(figures['produce_wall_seconds']) * planned['dem']['ranks'])} without filling"
    return duration_text(record["wall_seconds"])


def stored(limit: EarlierRun) -> Entry:
    """The field of 6 cm particles that the fluids were measured against."""
    kept = load(STORED, "reactor")
    own = with_noise(unit(kept.field, limit.plan.case), kept.noise, limit.plan.case.outline.levels)
    diameter = kept.plan.dem.classes.sauter_diameter if kept.plan.settings else sauter(kept.plan.case)
    return Entry("stored", own, diameter, radius_text(limit, diameter), kept.noise, walls="as_drawn")


def with_noise(one: Field, noise: Mapping[str, float], levels: Mapping[str, tuple[float, float]]) -> Field:
    """A field with an error in z that is alike all over a section, so that each section has its noise."""
    none = np.zeros_like(one.flux_z)
    bare = replace(one, flux_r_se=np.zeros_like(one.flux_r), flux_z_se=none + 1.0)
    per_unit, rows = statistical_errors(bare, levels), section_rows(one.grid, levels)
    of_row = np.full(one.grid.shape[0], noise["whole"] / per_unit["whole"])
    for name in levels:
        of_row[rows[name]] = noise[name] / per_unit[name]
    at_levels = np.sqrt(0.5 * (np.append(of_row, of_row[-1]) ** 2 + np.append(of_row[0], of_row) ** 2))
    return replace(bare, flux_z_se=none + at_levels[:, None])


def fluids(limit: EarlierRun, scratch: Path) -> Iterator[Entry]:
    """Both fluids at the material's size, and the hybrid of the frictional one with the stored field."""
    for name, make in (
        ("frictional fluid", lambda: frictional(limit, 1.0)),
        ("viscous fluid", lambda: viscous(fluid_plan(limit, 1.0, "viscous"))),
        ("hybrid of the stored field and the frictional fluid", lambda: hybrid(limit, scratch)),
    ):
        begun = time.process_time()
        try:
            made = make()
        except GranpipeError as error:
            print(f"{name}: {error}")
            continue
        yield Entry(name, unit(made, limit.plan.case), 0.0, seconds=duration_text(time.process_time() - begun))


def frictional(limit: EarlierRun, factor: float) -> Field:
    """The frictional fluid for particles enlarged by a factor, on the cells of the limit."""
    plan = fluid_plan(limit, factor, "frictional")
    packing = plan.case.material.packing
    assert packing is not None
    return solve_plan(plan, bulk_friction(plan.case), packing).field


def fluid_plan(limit: EarlierRun, factor: float, rheology: str) -> Plan:
    return replace(make_plan(fluid_case(limit, factor, rheology, "fluid", {})), grid=limit.field.grid)


def fluid_case(limit: EarlierRun, factor: float, rheology: str, model: str, more: Mapping[str, str]) -> Case:
    given: dict[str, Any] = limit.plan.case.model_dump(mode="json", exclude_unset=True)
    _enlarge(given["material"]["size"], factor)
    given["dem"].pop("coarse_grain_factor", None)
    given["dem"].pop("statistical_error", None)
    given["material"].pop("bulk_density", None)
    changes = {"model": model, "fluid.rheology": rheology, "material.bulk_density": DENSITY, "export": "[]"}
    return resolve(given, Places("reactor"), changes | {"figures": "[]", "homogenize.fields": "[]"} | dict(more)).case


def hybrid(limit: EarlierRun, scratch: Path) -> Field:
    """The hybrid that follows the stored field where it needs particles, the frictional fluid elsewhere."""
    kept = load(STORED, "reactor").field
    kept.save(scratch / "stored.npz")
    known = {"fluid.known_field": str(scratch / "stored.npz"), "homogenize.cell": repr(float(kept.grid.cell))}
    plan = make_plan(fluid_case(limit, 1.0, "frictional", "hybrid", known))
    return hybrid_field(plan, Context(Store(scratch / "store"), {}, Silent(), 1)).field


def combined(limit: EarlierRun, entries: Sequence[Entry]) -> Iterator[Entry]:
    """Combinations of each run with the fluid, and of all runs with particles of one size."""
    larger_than = 1.001 * sauter(limit.plan.case)
    runs = [one for one in entries if one.walls and one.diameter > larger_than and one.field.psi is not None]
    fluid = unit(frictional(limit, 1.0), limit.plan.case)
    enlarged: dict[str, Field | None] = {}
    for one in runs:
        yield Entry(f"half and half: {one.name}", mixed([(0.5, one.field), (0.5, fluid)]), one.diameter, one.size)
        if one.size not in enlarged:
            enlarged[one.size] = fluid_of(limit, one)
            if (own := enlarged[one.size]) is not None:
                yield Entry(f"frictional fluid, {one.size}", own, 0.0, one.size)
        if (own := enlarged[one.size]) is not None:
            moved = mixed([(1.0, one.field), (1.0, fluid), (-1.0, own)])
            yield Entry(f"size by the fluid: {one.name}", moved, one.diameter, one.size)
    for size, walls in dict.fromkeys((run.size, run.walls) for run in runs):
        alike = [run for run in runs if (run.size, run.walls) == (size, walls)]
        if len(alike) > 1:
            mean = mixed([(1 / len(alike), run.field) for run in alike])
            yield Entry(f"mean: {', '.join(run.name for run in alike)}", mean, alike[0].diameter, size)


def fluid_of(limit: EarlierRun, one: Entry) -> Field | None:
    """The frictional fluid for particles as large as those of a run; None where it takes no such particles."""
    try:
        return unit(frictional(limit, one.diameter / sauter(limit.plan.case)), limit.plan.case)
    except GranpipeError as error:
        print(f"frictional fluid, {one.size}: {error}")
        return None


def mixed(parts: Sequence[tuple[float, Field]]) -> Field:
    """A weighted sum of fields at one flow rate, on the largest of their cells; their noise is independent."""
    grid = parts[0][1].grid
    for _, one in parts[1:]:
        grid = larger(grid, one.grid)
    placed = [(weight, on_cells(one, grid)) for weight, one in parts]

    def summed(of: Callable[[Field], Array | None]) -> Array:
        return np.asarray(sum(weight * known for weight, one in placed if (known := of(one)) is not None))

    def noise(of: Callable[[Field], Array | None], like: Array) -> Array:
        squares = sum(weight**2 * known**2 for weight, one in placed if (known := of(one)) is not None)
        return np.asarray(np.sqrt(squares + np.zeros_like(like)))

    first = placed[0][1]
    return replace(
        first,
        bulk=np.logical_and.reduce([one.bulk for _, one in placed]),
        psi=summed(lambda one: one.psi),
        flux_r=summed(lambda one: one.flux_r),
        flux_z=summed(lambda one: one.flux_z),
        flux_r_se=noise(lambda one: one.flux_r_se, first.flux_r),
        flux_z_se=noise(lambda one: one.flux_z_se, first.flux_z),
    )


def unit(one: Field, case: Case) -> Field:
    """The field as bulk velocities at the flow rate of a case."""
    flow = target_flow(case, one.bulk_packing)
    scale = flow / one.bulk_flow / one.bulk_packing

    return replace(scaled(one, scale), bulk_flow=flow, bulk_packing=1.0, flow_scale=1.0)


def scaled(one: Field, scale: float) -> Field:
    """The field with all fluxes times a number."""

    def times(values: Array | None) -> Array | None:
        return None if values is None else scale * values

    return replace(
        one,
        psi=times(one.psi),
        flux_r=scale * one.flux_r,
        flux_z=scale * one.flux_z,
        flux_r_se=times(one.flux_r_se),
        flux_z_se=times(one.flux_z_se),
    )


def larger(one: Grid, other: Grid) -> Grid:
    return one if one.cell >= other.cell else other


def on_cells(one: Field, grid: Grid) -> Field:
    """A field on other cells, which hold of the vessel what its own held."""
    if one.grid.shape == grid.shape:
        return one
    blank = on_grid(one, grid, np.ones(grid.shape))
    return replace(blank, inside_fraction=blank.bulk.astype(float))


def sauter(case: Case) -> float:
    return size_classes(case.material.size).sauter_diameter


def radius_text(limit: EarlierRun, diameter: float) -> str:
    """Mean radius of particles that are as much larger than the material's as their diameter."""
    return f"{300 * diameter / sauter(limit.plan.case) / 100:.2g} cm" if diameter else ""


# ── the tables ───────────────────────────────────────────────────────────────


def differences(limit: EarlierRun, one: Entry) -> dict[str, Difference]:
    case = limit.plan.case
    truth = unit(limit.field, case)
    grid = larger(truth.grid, one.field.grid)
    diameter = max(one.diameter, limit.plan.dem.classes.sauter_diameter)
    found = compare(on_cells(truth, grid), on_cells(one.field, grid), case.outline.levels, diameter)
    return {difference.name: difference for difference in found}


def tables(limit: EarlierRun, rows: Sequence[Entry]) -> Iterator[str]:
    dem, levels = limit.plan.dem, limit.plan.case.outline.levels
    sections = ["whole", *levels]
    noise = ", ".join(f"{name} {100 * v:.1f}" for name, v in statistical_errors(limit.field, levels).items())
    spent = read_json(limit.folder / "provenance.json")["figures"].get("processor_seconds", [])
    took = f"; {duration_text(sum(spent))} of one core" if spent else ""
    yield (
        f"**The limit**: particles of {1000 * dem.classes.sauter_diameter:.0f} mm (Sauter diameter), plate "
        f"{dem.plate_speed:.3g} m/s, E {dem.youngs_modulus:.2g} Pa, step {dem.time_step:.2g} s, cells of "
        f"{1000 * limit.field.grid.cell:.1f} mm; {limit.travel:.2f} m of plate travel averaged in "
        f"{limit.plan.case.dem.replicas} fillings{took}. Its own "
        f"statistical error, %: {noise} ({limit.blocks:.0f} effective blocks).\n"
    )
    for gate in dict.fromkeys(limit.failed):
        yield f"A filling failed a quality gate: {gate}.\n"
    found = [(one, differences(limit, one)) for one in rows]
    columns = " | ".join(sections)
    yield f"## Beyond noise, %\n\n| | mean radius | {columns} | told by the run, whole | in all | processor time |"
    yield "|---" * (len(sections) + 5) + "|"
    for one, of in found:
        own, total = "", ""
        if one.statistical:
            noise = one.statistical["whole"]
            own = f"{100 * noise:.1f}"
            total = f"{100 * hypot(noise, of['whole'].noise_free):.1f} (< {100 * hypot(noise, of['whole'].upper):.1f})"
        cells = " | ".join(told(of[name]) for name in sections)
        yield f"| {one.name} | {one.size} | {cells} | {own} | {total} | {one.seconds} |"
    yield f"\n## As it stands (noise of both), %\n\n| | {columns} |\n{'|---' * (len(sections) + 1)}|"
    for one, of in found:
        cells = " | ".join(f"{100 * of[name].observed:.1f} ({100 * of[name].noise:.1f})" for name in sections)
        yield f"| {one.name} | {cells} |"
    yield f"\n## 95 % bound, %\n\n| | {columns} |\n{'|---' * (len(sections) + 1)}|"
    for one, of in found:
        yield f"| {one.name} | {' | '.join(f'{100 * of[name].upper:.1f}' for name in sections)} |"
    yield ""
    yield "## Statistical error that each run told, %\n"
    for one in rows:
        if one.statistical:
            yield f"- {one.name}: " + ", ".join(f"{name} {100 * v:.1f}" for name, v in one.statistical.items())
    yield ""


if __name__ == "__main__":
    main()
