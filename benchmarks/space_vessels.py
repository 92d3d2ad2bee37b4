"""Vessels in space: a round hopper as r–z and as triangles, a square one, an outlet beside the middle, two outlets.

The two outlets are run with several seeds: do the error bars of one run cover what another filling gives?

`run` makes the runs that are missing, `page` writes docs/validation/space_vessels.md from those that are there. Every
run is an ordinary granpipe run: interrupted, it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from datetime import date
from itertools import pairwise
from math import pi, sin, sqrt
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from run import machine  # finds the fakes of the tests as well
from scipy import stats

from fakes.space_walls import two_levels, two_taps  # isort: skip
from fakes.space_walls import write_stl as fakes_stl  # isort: skip

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.errors import DataError
from granpipe.field import Box, Field, level_flow
from granpipe.geometry.extrude import write_stl
from granpipe.homogenize.average import Collector
from granpipe.homogenize.space_outlets import left_above
from granpipe.pipeline.averages import averaged_field, outlet_cells
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "validation" / "space_vessels.md"
TOLERANCE = 0.05
DIAMETER = 6e-3
FACETS = 48
SEEDS = range(2, 7)
"""Of the two outlets and of the square hopper, beside the first."""

FLOWING = 0.05
"""Of the RMS velocity: faces on which less flows on average are left out of the comparison of seeds."""

TRIED = """\
Of the six with two outlets, the errors of single faces gave 86 to 92 % with the 26 degrees of freedom of
independent blocks: a face sees few particles pass, so that its own variance is known like one of three degrees of
freedom, and the slow sidewise shifts of the vertical flow are correlated over 14 mm of plate travel. It is no
matter of the filling: the halves of one run differ as much as two runs do, and the correlation with the mean of the
other runs falls to nothing. So variances are seen through a particle diameter, and no face counts for more
independent blocks than its component. The way was chosen by these runs; the square hopper was run afterwards, and
nothing was changed by it. Halves, thirds and quarters of each run with two outlets, with 9, 8 and 6 effective
blocks, were compared as well: 93 to 95 % of the intervals held, with scatters of 1.00 to 1.13 times the claimed
errors."""

WALL = ((36.0, 85.0), (36.0, 50.0), (18.0, 5.0), (18.0, 0.0))
"""Of the round hopper [mm], from the top down."""

MATERIAL = """\
material: {density: 2500, size: {diameter: 6 mm}}
contact: {friction: 0.5, rolling_friction: 0.1, youngs_modulus: 1.5 MPa}
flow_rate: 100 kg/h
model: dem
"""
ROUND = (
    "name: round\noutline: {unit: mm, wall: " + str([list(point) for point in WALL]) + "}\n"
    "dem: {ranks: 1, max_time: 7 s}\nexport: []\nfigures: []\n" + MATERIAL
)


def in_space(name: str, seconds: float, keep: str = "none") -> str:
    """The case of an STL file of its name."""
    dem = f"dem: {{ranks: 1, max_time: {seconds} s, keep_snapshots: {keep}}}\n"
    return f"name: {name}\nvessel: {{file: {name}.stl}}\n{dem}export: [vtk]\nfigures: [rz]\n{MATERIAL}"


def circle(radius: float, z: float, x: float = 0.0) -> np.ndarray:
    """A polygon with the area of a circle [m], from mm."""
    angle = 2 * pi * np.arange(FACETS) / FACETS
    own = radius * sqrt(2 * pi / FACETS / sin(2 * pi / FACETS))
    return np.column_stack([x + own * np.cos(angle), own * np.sin(angle), np.full(FACETS, z)]) / 1000


def square(width: float, z: float) -> np.ndarray:
    """A square about the axis [m], from mm."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.column_stack([0.5 * width * signs, np.full(4, z)]) / 1000


def between(rings: list[np.ndarray]) -> np.ndarray:
    """(n, 3, 3) the walls between rings of equally many corners."""
    found = []
    for one, other in pairwise(rings):
        next_one, next_other = np.roll(one, -1, axis=0), np.roll(other, -1, axis=0)
        found += [np.stack([one, next_one, next_other], axis=1), np.stack([one, next_other, other], axis=1)]
    return np.concatenate(found)


LEVELS = """\
name: levels
vessel:
  file: levels.stl
  unit: mm
  outlets:
    low: {at: [22.5, 22.5, 0], share: 60 %}
    high: {at: [67.5, 22.5, 30], share: 40 %}
material: {density: 2500, size: {diameter: 6 mm}}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 100 kg/h
model: dem
dem: {ranks: 1, max_time: 4 s}
"""
"""Two outlets at different heights, in a floor with a step."""

TAPS = """\
name: taps
vessel:
  file: taps.stl
  unit: mm
  outlets:
    low: {at: [0, 22.5, 15], share: 60 %}
    high: {at: [60, 22.5, 45], share: 40 %}
material: {density: 2500, size: {diameter: 4 mm}}
contact: {friction: 0.5, rolling_friction: 0.1}
flow_rate: 100 kg/h
model: dem
dem: {ranks: 1, max_time: 3 s}
"""
"""Two outlets in side walls: one at the floor, one higher."""

SURFACES = {
    "round-stl": lambda: between([circle(r, z) for r, z in WALL]),
    "square": lambda: between([square(60, 80), square(60, 55), square(36, 0)]),
    "off-centre": lambda: between([circle(36, 80), circle(36, 45), circle(18, 0, x=14)]),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", choices=("run", "page"))
    parser.add_argument("--results", type=Path, default=ROOT / "results" / "space_vessels")
    parser.add_argument("--only", help="one run by name; all unless given")
    options = parser.parse_args()
    results: Path = options.results
    if options.step == "run":
        for name, case in cases(results).items():
            if options.only in (None, name):
                outcome = run_case(case, results, Silent())
                figures = provenance(outcome.folder)["figures"]
                print(name, figures.get("statistical_error"), figures.get("outlets"), outcome.failed, flush=True)
                if name == "round-stl":
                    on_rings(case, cases(results)["round"], results).save(results / "rings.npz")
        return
    PAGE.write_text(
        "\n".join([*head(), *as_rings(results), *exact(results), *covered(results), *costs(results)]) + "\n"
    )


def cases(results: Path) -> dict[str, CaseFile]:
    """Every run by its name; files of walls are written."""
    results.mkdir(parents=True, exist_ok=True)
    for name, surface in SURFACES.items():
        write_stl(surface(), results / f"{name}.stl")
    texts = {"round": ROUND, "round-stl": in_space("round-stl", 7, "all")}
    texts |= {name: in_space(name, 4) for name in ("square", "off-centre")}
    fakes_stl(results / "levels.stl", two_levels(height=9, size=7.5))
    fakes_stl(results / "taps.stl", two_taps(height=9, size=7.5))
    texts |= {"levels": LEVELS, "taps": TAPS}
    found = {}
    for name, text in texts.items():
        path = results / f"{name}.yaml"
        path.write_text(text)
        found[name] = read_case(path)
    two_outlets = ROOT / "cases" / "two_outlets.yaml"
    found["two_outlets"] = read_case(two_outlets, {"dem.ranks": "1"})
    for name, path in (("two_outlets", two_outlets), ("square", results / "square.yaml")):
        for seed in SEEDS:
            changes = {"dem.ranks": "1", "dem.seed": str(seed), "name": f"{name}-{seed}"}
            found[f"{name}-{seed}"] = read_case(path, changes)
    return found


def on_rings(file: CaseFile, drawn: CaseFile, results: Path) -> Field:
    """The field of the snapshots of a vessel in space, on rings within a round outline."""
    plan, own = make_plan(file.case), make_plan(drawn.case)
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    (production,) = finished_productions(plan, store, versions)
    collector, segments = Collector(own.grid, "displacement"), []
    for step, snapshot in production.kept_frames(10**6):
        collector.add(step * plan.dem.time_step, snapshot)
        if step and step % plan.dem.segment_steps == 0:
            segments.append(collector.take())
    start = provenance(results / file.case.name)["figures"]["averaged_from_s"]
    steady = [one for one in segments if one.start >= start - 1e-9]
    return averaged_field(own.case, own.outline, steady, DIAMETER).field


def as_rings(results: Path) -> Iterator[str]:
    """The round hopper by its outline and by its triangles."""
    if not (results / "rings.npz").exists() or not (results / "round" / "field.npz").exists():
        yield "The round hopper by its outline and by triangles: not run yet."
        return
    levels = cases(results)["round"].case.outline.levels
    apart = compare(Field.load(results / "round" / "field.npz"), Field.load(results / "rings.npz"), levels, DIAMETER)
    yield f"## A round hopper, drawn as an outline and as a surface of {FACETS} facets"
    yield ""
    yield "Two simulations of their own: other walls, other filling, other particles. The snapshots of the one in space"
    yield "were averaged on the rings of the other."
    yield ""
    yield "| part | difference | noise of both | beyond noise | 95 % bound | |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for one in apart:
        told = " | ".join(f"{value:.1%}" for value in (one.observed, one.noise, one.noise_free, one.upper))
        yield f"| {one.name} | {told} | {one.verdict(TOLERANCE)} |"
    yield ""


def exact(results: Path) -> Iterator[str]:
    """How exactly each field conserves."""
    yield "## What must be exact"
    yield ""
    yield "Largest deviation of a level's flow, with what has left above it, from the flow of the case, largest"
    yield "imbalance of a cell over the flow, and the shares of the outlets: of the field, and as simulated."
    yield ""
    yield "| vessel | particles | statistical error | levels | cells | shares | as simulated | gates passed |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    made = cases(results)
    for name in (*SURFACES, "two_outlets", "levels", "taps"):
        if not (results / name / "field.npz").exists():
            yield f"| {name} | not run yet | | | | | | |"
            continue
        field, told = Field.load(results / name / "field.npz"), provenance(results / name)
        grid = field.grid
        assert isinstance(grid, Box)
        assert field.flux_y is not None
        areas = grid.side_area[0], grid.front_area, grid.ring_area[0]
        x, y, z = (flux * area for flux, area in zip((field.flux_r, field.flux_y, field.flux_z), areas, strict=True))
        plan = make_plan(made[name].case)
        assert plan.space is not None
        leaving = outlet_cells(plan).faces(plan.space.inside_fraction(grid) > 0)
        flows = level_flow(field.flux_z, grid) + left_above(leaving, (x, y, z))
        out = (np.diff(x, axis=2) + np.diff(y, axis=1) + np.diff(z, axis=0))[field.bulk]
        figures = told["figures"]
        outlets = figures["outlets"]
        passed = [gate["passed"] for gate in told["quality"]]
        cells = [
            name,
            str(figures["particles"][0]),
            f"{figures['statistical_error']['whole']:.1%}",
            f"{np.abs(flows / flows.mean() - 1).max():.1e}",
            f"{np.abs(out).max() / flows.mean():.1e}",
            " : ".join(f"{100 * one['share']:.4g}" for one in outlets),
            " : ".join(f"{100 * one['measured_share']:.1f} ± {100 * one['share_se']:.1f}" for one in outlets),
            f"{sum(passed)} of {len(passed)}",
        ]
        yield f"| {' | '.join(cells)} |"


def covered(results: Path) -> Iterator[str]:
    """Scatter of several seeds over the errors that each of them claims."""
    yield ""
    yield "## Do the error bars cover?"
    yield ""
    yield from wrap(
        "Scatter of the fields of several seeds over the standard errors that they claim (RMS over the faces that "
        "carry flow), and how many of their 95 % intervals hold the mean of the others (Student's t of one degree of "
        "freedom less than the effective blocks; the error of that mean is allowed for). After ± what leaving out one "
        "seed after the other gives.",
        110,
    )
    yield ""
    yield "| vessel | seeds | effective blocks | along | scatter / claimed | intervals that hold |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for vessel in ("two_outlets", "square"):
        names = [name for name in (vessel, *(f"{vessel}-{seed}" for seed in SEEDS)) if (results / name).exists()]
        if len(names) < 3:
            yield f"| {vessel} | not run yet | | | | |"
            continue
        fields = [Field.load(results / name / "field.npz") for name in names]
        effective = [provenance(results / name)["figures"]["effective_blocks"] for name in names]
        for along, name in (("x", "flux_r"), ("y", "flux_y"), ("z", "flux_z")):
            ratio, held = scatter(fields, name, effective)
            kept = [[at for at in range(len(fields)) if at != out] for out in range(len(fields))]
            left = np.array([scatter([fields[i] for i in at], name, [effective[i] for i in at]) for at in kept])
            ratio_se, held_se = np.sqrt((len(left) - 1) * left.var(axis=0))
            told = f"{vessel} | {len(fields)} | {min(effective):.0f} to {max(effective):.0f} | {along}"
            yield f"| {told} | {ratio:.2f} ± {ratio_se:.2f} | {100 * held:.1f} ± {100 * held_se:.1f} % |"
    yield ""
    yield from wrap(TRIED, 110)


def scatter(fields: list[Field], name: str, effective: list[float]) -> tuple[float, float]:
    """Scatter of fields over what they claim, and the share of 95 % intervals that hold the others' mean."""
    flux = np.array([getattr(one, name) * one.velocity_scale for one in fields])
    error = np.array([getattr(one, f"{name}_se") * one.velocity_scale for one in fields])
    size = sqrt(np.mean([np.mean((one.flux_z * one.velocity_scale) ** 2) for one in fields]))
    flowing = (np.abs(flux.mean(axis=0)) > FLOWING * size) & (error > 0).all(axis=0)
    ratio = sqrt(flux.var(axis=0, ddof=1)[flowing].sum() / (error**2).mean(axis=0)[flowing].sum())
    wide = stats.t.ppf(0.975, np.array(effective) - 1)[:, None, None, None]
    others = (flux.sum(axis=0) - flux) / (len(flux) - 1)
    held = (np.abs(flux - others) <= sqrt(1 + 1 / (len(flux) - 1)) * wide * error)[:, flowing]
    return ratio, float(held.mean())


def costs(results: Path) -> Iterator[str]:
    """Processor time and memory of each run."""
    yield ""
    yield "## What it costs"
    yield ""
    yield from wrap(
        "Processor time of the production, as the runs have noted it, beside other work on two cores: of LIGGGHTS for "
        "a million particle-steps, and of granpipe for a million particles in snapshots, which it sums. Memory of the "
        "sums of all segments. The first is the vessel on rings, the second the same vessel in space.",
        110,
    )
    yield ""
    yield "| vessel | triangles | cells | LIGGGHTS [s] | summing [s] | sums [MB] |"
    yield "| --- | --- | --- | --- | --- | --- |"
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    for name, file in cases(results).items():
        if not (results / name / "field.npz").exists() or name.split("-")[-1].isdigit():
            continue
        plan = make_plan(file.case)
        try:
            (production,) = finished_productions(plan, store, versions)
        except DataError:
            continue
        reports, sums, dem = production.reports(), list(production.sums()), plan.dem
        particle_steps = sum(one.particles for one in reports) * dem.segment_steps
        liggghts = ended([one.processor_seconds for one in reports]) / particle_steps
        summing = ended([one.averaging_seconds for one in reports]) / particle_steps * dem.dump_every
        memory = sum(array.nbytes for one in sums for array in vars(one).values() if isinstance(array, np.ndarray))
        triangles = sum(json.loads((production.walls / "walls.json").read_text())["triangles"].values())
        cells = " × ".join(map(str, plan.grid.shape))
        told = [name, triangles, cells, f"{1e6 * liggghts:.2f}", f"{1e6 * summing:.0f}", f"{memory / 1e6:.0f}"]
        yield f"| {' | '.join(map(str, told))} |"


def ended(values: list[float]) -> float:
    """Sum of counters that begin anew with every resumed run."""
    return sum(value for value, after in zip(values, [*values[1:], -1.0], strict=True) if after < value)


def head() -> Iterator[str]:
    """Title, and how the page is made."""
    yield "# Vessels in space"
    yield ""
    yield f"Made on {date.today()} by `python benchmarks/space_vessels.py run` and `page` on {machine()}."
    yield ""


def provenance(folder: Path) -> dict[str, Any]:
    """What a run has measured."""
    found: dict[str, Any] = json.loads((folder / "provenance.json").read_text())
    return found


if __name__ == "__main__":
    main()
