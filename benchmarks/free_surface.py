"""The angle of the free surface below a widening, for four frictions and two ways of filling.

`run` simulates one scene: a throat above a chamber whose corner stands still while the core flows. `page` measures the
surface of the settled bed and of the flowing one, its standard error from 8 sectors, and writes docs/free_surface.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from unittest import mock

import numpy as np

from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.dem.contact import filling_angle
from granpipe.dem.dump import read_snapshot
from granpipe.dem.snapshot import OWN_COLUMNS, Snapshot
from granpipe.pipeline import dem_stages
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import StatisticalErrorCriterion
from granpipe.pipeline.records import SettleRecord
from granpipe.pipeline.stiffness import with_checked_stiffness
from granpipe.planning.make import make_plan
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
DIAMETER = 6.0  # mm
THROAT, CHAMBER, HEIGHT, PIPE = 4.0, 11.0, 8.0, 1.0  # radii, heights of chamber and outlet pipe [d]
FRICTIONS = ((0.3, 0.05), (0.5, 0.1), (0.73, 0.21), (1.0, 0.5))  # sliding, rolling
STEEP = 60.0  # angle under edges up to which the other way fills [°]
SECTORS = 8
CLEAR = (1.0, 1.0)  # left out of the fit: from the throat's edge, from the wall [d]
PACKING = 0.58


@dataclass(frozen=True)
class Scene:
    """A friction and a way of filling."""

    friction: float
    rolling: float
    filling: float

    @property
    def name(self) -> str:
        return f"widening-{self.friction:g}-{self.filling:g}".replace(".", "_")

    def text(self, seconds: float) -> str:
        pipe = PIPE * DIAMETER
        throat, chamber, top = THROAT * DIAMETER, CHAMBER * DIAMETER, pipe + HEIGHT * DIAMETER
        corners = [(throat, top + pipe), (throat, top), (chamber, top), (chamber, pipe), (throat, pipe), (throat, 0)]
        wall = ", ".join(f"[{r:g}, {z:g}]" for r, z in corners)
        return f"""\
name: {self.name}
outline:
  unit: mm
  wall: [{wall}]
  sections: {{throat: [{top + pipe:g}, {top:g}], chamber: [{top:g}, {pipe:g}], outlet: [{pipe:g}, 0]}}
material:
  density: 2500 kg/m^3
  size: {{diameter: {{normal: {{mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}}}, classes: 3}}
contact: {{friction: {self.friction:g}, rolling_friction: {self.rolling:g}}}
flow_rate: 0.1 kg/s
model: dem
dem: {{max_time: {seconds:g} s, reservoir_height: {5 * DIAMETER:g} mm, ranks: 1}}
export: []
figures: []
"""


SCENES = [
    Scene(*friction, filling)
    for friction in FRICTIONS
    for filling in (float(round(np.degrees(filling_angle(*friction)))), STEEP)
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["names", "run", "page"])
    parser.add_argument("--only", nargs="*", default=[], help="names of scenes")
    parser.add_argument("--seconds", type=float, default=1.5, help="simulated time of production")
    parser.add_argument("--flow", action="store_true", help="let flow, not only fill and settle")
    parser.add_argument("--results", type=Path, default=Path("results-free-surface"))
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "free_surface.md")
    options = parser.parse_args()
    scenes = [scene for scene in SCENES if not options.only or scene.name in options.only]
    if options.what == "names":
        print(*(scene.name for scene in scenes), sep="\n")
    elif options.what == "run":
        for scene in scenes:
            run(scene, options.results, options.seconds, options.flow)
    else:
        text = page([scene for scene in scenes if (options.results / f"{scene.name}.json").exists()], options.results)
        options.out.write_text(text)
        print(text)


def run(scene: Scene, results: Path, seconds: float, flow: bool) -> None:
    """Fill, settle and let flow; leaves the angles of both beds in a file of the scene's name."""
    results.mkdir(exist_ok=True)
    path = results / f"{scene.name}.yaml"
    path.write_text(scene.text(seconds))
    case = read_case(path).case
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    with Console() as console, filling(scene.filling):
        context = Context(store, versions, console, 1)
        plan = with_checked_stiffness(make_plan(case, 1), context)
        settled = dem_stages.settle(plan, context)
        angles = {"settled": surface(read_snapshot(settled / "settled.bin", OWN_COLUMNS))}
        if flow:
            (production,) = dem_stages.simulate(plan, context, StatisticalErrorCriterion(plan))
            angles["flowing"] = surface(production.last_snapshot())
    report = asdict(SettleRecord.read(settled))
    kept = {name: report[name] for name in ("steps", "particles", "wall_seconds", "overlap")}
    write_json(results / f"{scene.name}.json", {"angles": angles, "seconds": seconds, "settle": kept})
    print(scene.name, angles)


@contextmanager
def filling(degrees: float) -> Iterator[None]:
    """Meanwhile granpipe fills under edges up to another angle."""
    with mock.patch.object(dem_stages, "filling_angle", return_value=np.radians(degrees)):
        yield


def surface(snapshot: Snapshot) -> tuple[float, float]:
    """Angle [°] of the surface in the chamber and its standard error, from the slopes of 8 sectors.

    A ring's height is that of its solids at the packing of a bed, so single particles on the surface hardly count; the
    solids of a particle are spread over points within it, so that layers along the wall do not show.
    """
    points = np.random.default_rng(1).normal(size=(200, 3))
    points *= (np.random.default_rng(2).random(200) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    spread = snapshot.position[:, None] + snapshot.radius[:, None, None] * points
    x, y, z = spread.reshape(-1, 3).T / (1e-3 * DIAMETER)
    volume = np.repeat(4 / 3 * np.pi * (snapshot.radius / (1e-3 * DIAMETER)) ** 3 / len(points), len(points))
    r, sector = np.hypot(x, y), (np.arctan2(y, x) / (2 * np.pi) % 1 * SECTORS).astype(int) % SECTORS
    edges = np.arange(THROAT + CLEAR[0], CHAMBER - CLEAR[1] + 1e-9, 0.5)
    inside = (z > PIPE) & (z < PIPE + HEIGHT)
    area = PACKING * np.pi * np.diff(edges**2) / SECTORS
    middle, slopes = 0.5 * (edges[1:] + edges[:-1]), []
    for number in range(SECTORS):
        mine = inside & (sector == number)
        height = np.histogram(r[mine], edges, weights=volume[mine])[0] / area
        slopes.append(-np.polyfit(middle, height, 1)[0])
    slope, error = np.mean(slopes), np.std(slopes, ddof=1) / np.sqrt(SECTORS)
    return float(np.degrees(np.arctan(slope))), float(np.degrees(error / (1 + slope**2)))


def page(scenes: list[Scene], results: Path) -> str:
    lines = [
        "# The free surface below a widening",
        "",
        f"Made by `benchmarks/free_surface.py run --flow` and `page` on {datetime.now(UTC):%Y-%m-%d}.",
        "",
        f"A throat of {2 * THROAT:g} particle sizes d opens into a chamber {CHAMBER - THROAT:g} d wider on each",
        "side; the corner of the chamber stands still while the core flows out through a hole in its floor.",
        "Filling puts particles only below a line that falls at the *filling* angle from the edge: 10° steeper than",
        f"heaps of the material are, or {STEEP:g}°. The surface is left from the filling where its angle follows the",
        "filling, and the material's own where both give the same. Angles from the horizontal, with the standard",
        "error of 8 sectors; *flowing*: at the end.",
        "",
        "| μ | μ_r | filling | settled | flowing | after |",
        "|---" * 6 + "|",
    ]
    for scene in scenes:
        found = read_json(results / f"{scene.name}.json")
        angles = {name: f"{angle:.1f} ± {error:.1f}°" for name, (angle, error) in found["angles"].items()}
        lines.append(
            f"| {scene.friction:g} | {scene.rolling:g} | {scene.filling:g}° | {angles['settled']} "
            f"| {angles.get('flowing', '')} | {found['seconds']:g} s |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
