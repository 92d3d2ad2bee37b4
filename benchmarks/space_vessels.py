"""Vessels in space: a round hopper as r–z and as triangles, a square one, an outlet beside the middle, two outlets.

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
from typing import Any

import numpy as np
from run import machine

from granpipe.analysis.compare import compare
from granpipe.case.reader import CaseFile, read_case
from granpipe.field import Box, Field, level_flow
from granpipe.geometry.extrude import write_stl
from granpipe.homogenize.average import Collector
from granpipe.pipeline.averages import averaged_field
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.run import run_case
from granpipe.planning.plan import make_plan
from granpipe.progress import Silent
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "validation" / "space_vessels.md"
TOLERANCE = 0.05
DIAMETER = 6e-3
FACETS = 48

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
    PAGE.write_text("\n".join([*head(), *as_rings(results), *exact(results)]) + "\n")


def cases(results: Path) -> dict[str, CaseFile]:
    """Every run by its name; files of walls are written."""
    results.mkdir(parents=True, exist_ok=True)
    for name, surface in SURFACES.items():
        write_stl(surface(), results / f"{name}.stl")
    texts = {"round": ROUND, "round-stl": in_space("round-stl", 7, "all")}
    texts |= {name: in_space(name, 4) for name in ("square", "off-centre")}
    found = {}
    for name, text in texts.items():
        path = results / f"{name}.yaml"
        path.write_text(text)
        found[name] = read_case(path)
    return found | {"two_outlets": read_case(ROOT / "cases" / "two_outlets.yaml", {"dem.ranks": "1"})}


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
    yield "Largest deviation of a level's flow from the flow of the case, largest imbalance of a cell over the flow,"
    yield "and the shares of the outlets: of the field, and as simulated."
    yield ""
    yield "| vessel | particles | statistical error | levels | cells | shares | as simulated | gates passed |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for name in (*SURFACES, "two_outlets"):
        if not (results / name / "field.npz").exists():
            yield f"| {name} | not run yet | | | | | | |"
            continue
        field, told = Field.load(results / name / "field.npz"), provenance(results / name)
        grid = field.grid
        assert isinstance(grid, Box)
        assert field.flux_y is not None
        flows = level_flow(field.flux_z, grid)
        areas = grid.side_area[0], grid.front_area, grid.ring_area[0]
        x, y, z = (flux * area for flux, area in zip((field.flux_r, field.flux_y, field.flux_z), areas, strict=True))
        out = np.diff(x, axis=2) + np.diff(y, axis=1) + np.diff(z, axis=0)
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
