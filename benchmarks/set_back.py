"""Walls set back by (k − 1) r for enlarged particles, and deposits with the material's own radius: what they gain.

`run` simulates two vessels with the material's own particles and with ones enlarged k times, between the walls as drawn
and between walls set back; `page` compares the fields and writes docs/validation/set_back.md. Runs that were broken off
go on where they were.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from scipy import ndimage

from granpipe.analysis.compare import ONE_SIDED_95, Difference, compare
from granpipe.case.reader import read_case
from granpipe.case.schema import Case
from granpipe.console import Console
from granpipe.dem.deck import DUMP_COLUMNS
from granpipe.dem.dump import first_step, read_snapshot
from granpipe.errors import DataError
from granpipe.field import Array, Field, Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Collector, Sums, merge
from granpipe.pipeline.averages import after_transient, averaged_field, statistical_errors
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import Convergence
from granpipe.pipeline.dem_field import dem_field
from granpipe.pipeline.dem_stages import simulate
from granpipe.pipeline.production import Production
from granpipe.pipeline.softness import as_rigid
from granpipe.planning.plan import Plan, make_plan
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.publish import publishing
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

HERE = Path(__file__).resolve().parent
CASE = """\
name: {name}
outline: {{unit: mm, wall: {wall}, obstacles: {obstacles}, sections: {sections}}}
material:
  density: 2500 kg/m^3
  size: {{diameter: {{normal: {{mean: {mean:g} mm, std: {std:g} mm, min: {low:g} mm, max: {high:g} mm}}}}, classes: 3}}
contact: {{youngs_modulus: {modulus:g} Pa, friction: 0.5, rolling_friction: 0.1, wall: {{friction: {friction:g}}}}}
flow_rate: 0.2 kg/s
model: dem
dem: {{coarse_grain_factor: {factor:g}, replicas: {replicas}, plate_speed: {speed:g} m/s, max_time: {time:g} s,
  reservoir_height: {reservoir:g} mm, ranks: 1, keep_snapshots: all}}
homogenize: {{cell: {cell:g} mm, start: {start:g} s}}
"""

SCALED = ("volume", "flow_r", "flow_z", "gain", "level_flow", "solids", "kinetic", "moments")


@dataclass(frozen=True)
class Vessel:
    """One vessel and its material; lengths in mm.

    Parameters
    ----------
    size : mean, standard deviation, least and largest diameter
    friction : of the walls
    modulus : Young's modulus [Pa]
    speeds : coarse-grain factor → speed of the plate [m/s]
    seeds : coarse-grain factor → number of runs
    travel : of the plate, in all and before the average begins [m]
    """

    title: str
    wall: tuple[tuple[float, float], ...]
    sections: dict[str, tuple[float, float]]
    size: tuple[float, float, float, float]
    friction: float
    modulus: float
    reservoir: float
    cell: float
    speeds: dict[float, float]
    seeds: dict[float, int]
    travel: tuple[float, float]
    diameter: float
    obstacles: dict[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)

    def case(self, folder: Path, factor: float, back: bool, seeds: int = 1) -> Case:
        """The case with particles enlarged by a factor, its walls set back or as drawn."""
        wall, obstacles = np.array(self.wall), {name: np.array(one) for name, one in self.obstacles.items()}
        if back:
            wall, obstacles = set_back(wall, obstacles, (factor - 1) * self.diameter / 2)
        mean, std, low, high = self.size
        text = CASE.format(
            name=folder.name,
            wall=wall.round(6).tolist(),
            obstacles={name: one.round(6).tolist() for name, one in obstacles.items()},
            sections={name: list(levels) for name, levels in self.sections.items()},
            mean=mean,
            std=std,
            low=low,
            high=high,
            friction=self.friction,
            factor=factor,
            replicas=seeds,
            modulus=self.modulus,
            speed=self.speeds[factor],
            time=self.travel[0] / self.speeds[factor],
            reservoir=self.reservoir,
            cell=self.cell,
            start=self.travel[1] / self.speeds[factor],
        )
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "case.yaml").write_text(text)
        return read_case(folder / "case.yaml").case


VESSELS = {
    "flat": Vessel(
        "a shaft of 20 d on a flat floor, outlet of 10 d",
        ((60, 108), (60, 6), (30, 6), (30, 0)),
        {"shaft": (108, 54), "bottom": (54, 6), "outlet": (6, 0)},
        (6, 0.6, 5, 7),
        friction=0.3,
        modulus=1.5e6,
        reservoir=30,
        cell=1.521,
        speeds={1.0: 0.038, 2.0: 0.025},
        seeds={1.0: 1, 2.0: 2},
        travel=(0.15, 0.07),
        diameter=6.07,
    ),
    "hopper": Vessel(
        "a cone of 26.6°, outlet of 14 d",
        ((67.2, 62.3232), (67.2, 56.3232), (42, 6), (42, 0)),
        {"shaft": (62.3232, 56.3232), "hopper": (56.3232, 6), "outlet": (6, 0)},
        (6, 0.6, 5, 7),
        friction=0.3,
        modulus=1.3e6,
        reservoir=30,
        cell=1.521,
        speeds={1.0: 0.051, 2.0: 0.038},
        seeds={1.0: 1, 2.0: 2},
        travel=(0.2, 0.058),
        diameter=6.07,
    ),
    "narrow": Vessel(
        "a shaft of 9.4 d, a cone of 26.6°, a throat of 6.4 d",
        ((95.07, 290), (95.07, 168.8031354), (65.07, 108.8031354), (65.07, 0)),
        {"shaft": (290, 170), "hopper": (170, 110), "throat": (110, 0)},
        (20, 2, 16, 24),
        friction=0.5,
        modulus=2.6e6,
        reservoir=90,
        cell=2.5,
        speeds={1.0: 0.04, 1.5: 0.04},
        seeds={1.0: 4, 1.5: 6},
        travel=(0.2, 0.05),
        diameter=20.28,
    ),
}


def set_back(wall: Array, obstacles: dict[str, Array], distance: float) -> tuple[Array, dict[str, Array]]:
    """Walls and obstacles with every face moved into the solid by a distance; corners stay corners, the axis stays.

    The free section, mirrored at the axis and made longer at both ends, grows by the distance; what an obstacle's part
    of the solid has left is the new obstacle.
    """
    top, bottom = wall[0, 1], wall[-1, 1]
    beyond = 10 * distance + 1e-9
    longer = np.array([[wall[0, 0], top + beyond], *wall, [wall[-1, 0], bottom - beyond]])
    vessel = shapely.Polygon([*longer, *(longer[::-1] * [-1, 1])])
    solid = shapely.union_all([shapely.Polygon(one * [side, 1]) for one in obstacles.values() for side in (1, -1)])
    wider, free = (
        shape.buffer(distance, join_style="mitre", mitre_limit=20) for shape in (vessel, vessel.difference(solid))
    )
    within = shapely.box(0, bottom, 2 * wall[:, 0].max() + beyond, top)
    left = wider.difference(free).intersection(within)
    found = {}
    for name, one in obstacles.items():
        part = left.intersection(shapely.Polygon(one).buffer(distance))
        if not isinstance(part, shapely.Polygon) or part.is_empty:
            raise ValueError(f"obstacle {name} is thinner than walls set back by {distance:g} leave")
        found[name] = np.array(part.exterior.coords)[:-1]
    corners = np.array(shapely.simplify(wider.intersection(within), 1e-9).exterior.coords)[:-1]
    outer = corners[corners[:, 0] > 1e-9]
    turn = np.lexsort((outer[:, 0], -outer[:, 1]))[0]
    ordered = np.roll(outer, -turn, axis=0)
    if ordered[1, 1] == ordered[0, 1] or ordered[1, 1] > ordered[-1, 1]:
        return ordered, found
    return np.roll(ordered[::-1], 1, axis=0), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--vessels", nargs="*", default=list(VESSELS))
    parser.add_argument("--results", type=Path, default=Path("results-set-back"))
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "validation" / "set_back.md")
    options = parser.parse_args()
    if options.what == "run":
        for name in options.vessels:
            for factor, seeds in VESSELS[name].seeds.items():
                for back in (False, True)[: 1 if factor == 1 else 2]:
                    run(name, factor, back, seeds, options.results)
    else:
        text = page(options.results, f"{datetime.now(UTC):%Y-%m-%d}")
        options.out.write_text(text)
        print(text)


def folder_of(results: Path, name: str, factor: float, back: bool) -> Path:
    return results / f"{name}-{factor:g}{'-back' if back else ''}".replace(".", "_")


def run(name: str, factor: float, back: bool, seeds: int, results: Path) -> None:
    """Simulate, unless that is done, and deposit every snapshot on the grid of the vessel as drawn, in each way."""
    vessel, folder = VESSELS[name], folder_of(results, name, factor, back)
    if factor == 1 and (folder / "field.npz").exists():
        return
    plan = make_plan(vessel.case(folder, factor, back, seeds), 1)
    store = Store(results / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    with Console() as console:
        productions = simulate(plan, Context(store, versions, console, 1), lambda _: Convergence())
    if factor == 1:
        dem_field(plan, productions).field.save(folder / "field.npz")
        return
    reports = [production.reports() for production in productions]
    write_json(
        folder / "run.json",
        {
            "overlap": float(np.mean([report.reference_overlap for of in reports for report in of])),
            "particles": float(np.mean([of[-1].particles for of in reports])),
            "processor_seconds": [of[-1].processor_seconds for of in reports],
        },
    )
    grid = make_plan(vessel.case(results / f"{name}-drawn", factor, False), 1).grid
    for deposits in {way.deposits for way in WAYS if way.back == back}:
        for production in productions:
            if not (target := folder / f"{deposits}-{production.run}").exists():
                kept = Kept(production, plan, 1 / factor if deposits == "own" else 1.0)
                with publishing(target) as made:
                    for number, sums in enumerate(kept.sums(grid, beyond=plan.grid if deposits == "cut" else None)):
                        sums.save(made / f"{number:04d}.npz")


@dataclass(frozen=True)
class Kept:
    """The snapshots that a production has kept, its particles deposited with a share of their radius."""

    production: Production
    plan: Plan
    share: float

    def sums(self, grid: Grid, beyond: Grid | None) -> Iterator[Sums]:
        """Sums of each segment on a grid; `beyond`: a wider one, on which particles are deposited before it is cut."""
        collector = Collector(beyond or grid, "displacement")
        pairs = self.plan.dem.segment_steps // self.plan.dem.dump_every
        paths = sorted((self.production.folder / "snapshots").glob("*.bin"), key=first_step)
        for count, path in enumerate(paths):
            snapshot = read_snapshot(path, DUMP_COLUMNS)
            snapshot = snapshot.having(radius=snapshot.radius * self.share)
            collector.add(first_step(path) * self.plan.dem.time_step, snapshot)
            if count and count % pairs == 0:
                sums = collector.take()
                weighed = {key: self.share**-3 * getattr(sums, key) for key in SCALED}
                yield cut(replace(sums, **weighed), grid)


def cut(sums: Sums, grid: Grid) -> Sums:
    """What of some sums lies on a grid with fewer columns."""
    columns = grid.shape[1]
    return replace(
        sums,
        grid=grid,
        volume=sums.volume[:, :columns],
        flow_r=sums.flow_r[:, : columns + 1],
        flow_z=sums.flow_z[:, :columns],
        gain=sums.gain[:, :columns],
    )


def within(segments: Sequence[Sums], inside_fraction: Array) -> list[Sums]:
    """Segments without the flow of what lies in the solid; the rest of each level is raised to the level's flow."""
    grid, mean = segments[0].grid, merge(segments).mean_flux[1]
    free = inside_fraction > 0.5
    through = np.pad(free, ((1, 0), (0, 0)), mode="edge") & np.pad(free, ((0, 1), (0, 0)), mode="edge")
    raised = level_flow(mean, grid) / level_flow(mean * through, grid)
    between = 0.5 * (raised[1:] + raised[:-1])[:, None]
    across = np.pad(free, ((0, 0), (1, 0)), mode="edge") & np.pad(free, ((0, 0), (0, 1)))
    return [
        replace(one, flow_z=one.flow_z * through * raised[:, None], flow_r=one.flow_r * across * between)
        for one in segments
    ]


@dataclass(frozen=True)
class Way:
    """A way to get at the field with enlarged particles.

    Parameters
    ----------
    back : walls are set back
    deposits : "enlarged": with the radius of the particles, what reaches beyond the outermost wall counts before it;
        "own": with that of the material's; "cut": with the radius of the particles, what lies in the solid is left out
    """

    title: str
    back: bool
    deposits: Literal["enlarged", "own", "cut"]


WAYS = (
    Way("as drawn", False, "enlarged"),
    Way("as drawn, deposits r", False, "own"),
    Way("set back, deposits kr", True, "enlarged"),
    Way("set back, deposits kr, cut", True, "cut"),
    Way("set back, deposits r", True, "own"),
)


class Fields:
    """Fields of one vessel from the runs in a folder, on one grid."""

    def __init__(self, name: str, results: Path) -> None:
        self.name, self.results, self.vessel = name, results, VESSELS[name]
        case = self.vessel.case(results / f"{name}-drawn", 1.0, False)
        self.diameter = 1e-3 * self.vessel.diameter
        self.outline, self.levels = Outline.from_case(case), case.outline.levels
        self.truth = Field.load(folder_of(results, name, 1.0, False) / "field.npz")

    def seeds(self, factor: float, way: Way) -> range:
        """The runs that there are with a factor, by number."""
        folder = folder_of(self.results, self.name, factor, way.back)
        return range(len([*folder.glob(f"{way.deposits}-*")]))

    def of(self, factor: float, way: Way, seeds: Sequence[int]) -> Field:
        """The field of some of the runs together."""
        folder = folder_of(self.results, self.name, factor, way.back)
        case = self.vessel.case(self.results / f"{self.name}-drawn", factor, False)
        segments: list[Sums] = []
        for run in seeds:
            paths = sorted((folder / f"{way.deposits}-{run}").glob("*.npz"))
            segments += [replace(Sums.load(path), run=run) for path in paths]
        overlap = float(read_json(folder / "run.json")["overlap"])
        steady = as_rigid(after_transient(segments, case), overlap)
        if way.deposits == "cut":
            steady = within(steady, self.outline.inside_fraction(steady[0].grid))
        return averaged_field(case, self.outline, steady, factor * self.diameter).field

    def wrong(self, factor: float, way: Way, seeds: Sequence[int]) -> dict[str, Difference]:
        """Differences from the truth; none where the segments give no field, as where an arch held the flow up."""
        try:
            return self.errors(self.of(factor, way, seeds), factor)
        except DataError:
            return {}

    def errors(self, field: Field, factor: float) -> dict[str, Difference]:
        """Differences from the truth: whole, sections, and the cells that are a large particle away from walls."""
        found = {one.name: one for one in compare(self.truth, field, self.levels, factor * self.diameter)}
        reach = int(np.ceil(max(self.vessel.speeds) * self.diameter / field.grid.cell))
        walled = np.pad(field.inside_fraction, ((0, 0), (0, reach)))
        least = ndimage.minimum_filter(walled, 2 * reach + 1, mode="nearest")[:, : field.grid.shape[1]]
        within = replace(field, bulk=field.bulk & (least > 1 - 1e-9))
        inner = compare(self.truth, within, self.levels, factor * self.diameter)[0]
        return {"whole": found.pop("whole"), "away from walls": inner} | found


def spread(one: Difference) -> float:
    """Standard error of the squared difference."""
    return (one.upper**2 - one.noise_free**2) / ONE_SIDED_95


def told(one: Difference) -> str:
    """A difference in %, with its standard error where it is beyond noise, else its bound."""
    error = spread(one)
    if one.noise_free**2 < ONE_SIDED_95 * error:
        return f"< {100 * one.upper:.1f}"
    return f"{100 * one.noise_free:.1f} ± {50 * error / one.noise_free:.1f}"


def gain(before: Difference, after: Difference) -> float:
    """By how many of its standard errors the squared difference went down; the noise of the truth is counted twice."""
    error = float(np.hypot(spread(before), spread(after)))
    free = [max(0.0, one.noise_free) ** 2 for one in (before, after)]
    return (free[0] - free[1]) / error if error > 0 else 0.0


def page(results: Path, made: str) -> str:
    """The page: a table for each vessel, before and after."""
    lines = [HEAD.format(date=made)]
    for name, vessel in VESSELS.items():
        fields = Fields(name, results) if (folder_of(results, name, 1.0, False) / "field.npz").exists() else None
        rows = [] if fields is None else list(table(fields))
        if fields is not None and rows:
            names = ["whole", "away from walls", *fields.levels]
            noise = ", ".join(
                f"{100 * error:.1f}" for error in statistical_errors(fields.truth, fields.levels).values()
            )
            lines += [
                f"## {name.capitalize()}: {vessel.title}\n",
                f"Noise of the truth, whole and by section: {noise} %. Errors in %.\n",
                "| k | particles | runs | walls, deposits | " + " | ".join(names) + " | better by |",
                "|---" * (5 + len(names)) + "|",
                *rows,
                "",
            ]
    return "\n".join(lines)


def table(fields: Fields) -> Iterator[str]:
    """Rows of the table of one vessel."""
    for factor in (one for one in fields.vessel.speeds if one > 1):
        drawn = fields.wrong(factor, WAYS[0], fields.seeds(factor, WAYS[0]))
        for way in WAYS:
            every = fields.seeds(factor, way)
            if not every:
                continue
            particles = read_json(folder_of(fields.results, fields.name, factor, way.back) / "run.json")["particles"]
            half = len(every) // 2
            for seeds in (every, *((every[:half], every[half:]) if half else ())):
                found = fields.wrong(factor, way, seeds)
                cells = " | ".join(told(one) for one in found.values())
                cells = cells or " | ".join(["no field"] * (2 + len(fields.levels)))
                better = f"{gain(drawn['whole'], found['whole']):+.1f}" if drawn and found and len(seeds) > half else ""
                runs = f"{seeds[0] + 1} to {seeds[-1] + 1}" if len(seeds) > 1 else f"{seeds[0] + 1}"
                yield f"| {factor:g} | {particles:.0f} | {runs} | {way.title} | {cells} | {better} |"


HEAD = """\
# Walls set back for enlarged particles

Made by `benchmarks/set_back.py run` and `page` on {date}.

With `dem.coarse_grain_factor` k, particles of radius kr stand for those of radius r. Their centres stay kr away from
the walls, not r, and openings are narrower for them. Two remedies were tried, neither of which is in granpipe:

- **walls set back** by (k − 1) r into the solid, so that centres get as near to the drawn walls as the material's;
- **deposits r**: the volume that a particle stands for is spread over a sphere of the material's own radius.

Each run is compared with a truth, the material's own particles between the walls as drawn, on one grid by
`granpipe compare`: its relative difference in bulk velocity with the noise of both taken off, ± its standard error, or
“<” its 95 % bound where noise explains it. Spheres that reach into the solid (*deposits kr* between walls set back)
count within the outermost wall, as in granpipe; *cut*: what lies in the solid is left out, and each level raised
to its flow. *Away from walls*: at least an enlarged diameter from all of them. *Better by*: how much smaller the
squared error is than with walls as drawn and deposits kr, in standard errors; the noise of the truth, common to both,
is counted twice, so this is on the safe side.

**What is known so far** (k = 2, two runs each). Walls set back, with what reaches into the solid left out, take the
error of the flat-bottomed silo from 21.3 ± 1.3 to 12.1 ± 1.5 % (4.7 standard errors of the difference), and leave
that of the hopper as it is, 13.3 ± 0.8 and 12.6 ± 0.7 %, 9.6 and 7.4 % away from walls. In the narrow vessel enlarged
particles between walls as drawn arch and give no field; between walls set back they give one. Without leaving that out
the hopper becomes worse (15.6 %). Deposits with the material's own radius are no remedy: in the hopper and the narrow
vessel they raise the error of the whole by half and more. Enlarged particles form layers along walls that are k times
as thick as the material's, and small deposits show them in full. Not tried: obstacles, the reactor, k = 3, an open
outlet. The truths of `flat` and `hopper` are one run each.
"""


if __name__ == "__main__":
    main()
