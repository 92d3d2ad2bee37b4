"""The DEM stages: walls, settle, produce. Each leaves a folder in the store; production runs in segments.

Replicas are the same case with other seeds: runs of their own, side by side, averaged together.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.case.reader import varied
from granpipe.dem.contact import filling_angle
from granpipe.dem.deck import DUMP_COLUMNS, Deck, bed_lines, make_deck, render
from granpipe.dem.dump import read_snapshot
from granpipe.dem.health import FillingHealth
from granpipe.dem.overlap import measure_overlap
from granpipe.dem.packing import LARGEST_OVERLAP, LOOSE, Bed, packed_bed
from granpipe.dem.run import Liggghts, Status
from granpipe.dem.settings import Settings, slab_height
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.field import Boxes, Frustum
from granpipe.geometry.extrude import MOST_DEPTHS
from granpipe.geometry.insertion import insertion_frusta
from granpipe.geometry.space_vessel import SpaceVessel
from granpipe.geometry.space_walls import build_space_walls, plate_name
from granpipe.geometry.walls import build_walls
from granpipe.pipeline.context import Context
from granpipe.pipeline.convergence import Criterion, RunningAverage
from granpipe.pipeline.extra_fields import ExtraSums
from granpipe.pipeline.production import Production, ProductionRun, copy_walls, limits_of
from granpipe.pipeline.records import OverlapRecord, SettleRecord, WallRecord
from granpipe.planning.plan import Plan
from granpipe.progress import DONE_BEFORE, Silent, duration_text
from granpipe.system.files import digest
from granpipe.system.pool import Task, run_together
from granpipe.system.store import Store, evidence_kept, key_of

_LEAST_VOLUME = 10  # of an insertion region, in particles

_VERSION = 8
_WALLS_VERSION = 6


def simulate(plan: Plan, context: Context, criterion: Criterion) -> tuple[Production, ...]:
    """Run the DEM stages of a plan, or find them done; one production for each replica that has segments."""
    walls = make_walls(plan, context)
    dem = plan.case.dem
    replicas = [_Replica(number, plan, walls, context) for number in range(dem.replicas)]
    done = [sums for replica in replicas for sums in replica.production_run.sums()]
    average = RunningAverage(criterion, done, target=dem.statistical_error is not None)
    if not all(replica.production_run.complete for replica in replicas):
        average.evaluate()
    tasks = (Task(replica.name("DEM"), plan.dem.ranks, replica.work(average)) for replica in replicas)
    run_together(tasks, context.cores)
    return tuple(replica.production for replica in replicas if replica.production is not None)


def settle(plan: Plan, context: Context) -> Path:
    """The folder of the settled bed of a plan's first run."""
    walls = make_walls(plan, context)
    replica = _Replica(0, plan, walls, context)
    run_together([Task(replica.name("settle"), plan.dem.ranks, replica.settle())], context.cores)
    return replica.production_run.settled


def finished_productions(plan: Plan, store: Store, versions: Mapping[str, str]) -> tuple[Production, ...]:
    """The productions that an earlier run of a plan has left in the store; nothing is run.

    Raises
    ------
    DataError : the store does not hold them any more
    """
    key = _walls_key(plan, versions)
    if store.has("walls", key):
        context = Context(store, versions, Silent(), plan.dem.ranks)
        walls = store.folder("walls", key)
        replicas = [_Replica(number, plan, walls, context) for number in range(plan.case.dem.replicas)]
        if any(replica.production_run.damaged for replica in replicas):
            raise DataError(f"{store.root}: the segments of {plan.case.name} are damaged; run it again")
        found = [replica.production_run.production(walls) for replica in replicas]
        if productions := tuple(one for one in found if one is not None):
            return productions
    raise DataError(f"{store.root}: the stages of {plan.case.name} are not there any more; run it again")


def make_walls(plan: Plan, context: Context) -> Path:
    """The folder of the STL files of a plan's vessel."""
    key = _walls_key(plan, context.versions)
    context.progress.stage("walls", _found(context.store, "walls", key))

    def work(folder: Path) -> None:
        if plan.space is None:
            walls = build_walls(plan.simulated, folder=folder, facets=plan.facets, **_wall_lengths(plan))
        else:
            walls = build_space_walls(plan.space, folder=folder, **_wall_lengths(plan))
        triangles = dict(walls.triangles)
        WallRecord(walls.facets, walls.sides, walls.inward, triangles, walls.plate_area).write(folder)

    return context.store.make("walls", key, work)


def _walls_key(plan: Plan, versions: Mapping[str, str]) -> str:
    outline = plan.simulated
    if plan.space is not None:
        vessel = plan.case.vessel
        assert vessel is not None
        outlets = [one.name for one in plan.space.outlets]
        inputs = _wall_lengths(plan) | {"file": vessel.sha256, "unit": vessel.metres, "outlets": outlets}
        return key_of("walls", _WALLS_VERSION, inputs | {"gmsh": versions["gmsh"]})
    inputs = _wall_lengths(plan) | {
        "wall": outline.wall.tolist(),
        "obstacles": {name: polygon.tolist() for name, polygon in outline.obstacles.items()},
        "facets": plan.facets,
        "gmsh": versions["gmsh"],
    }
    if not outline.measure.axial:
        inputs |= {"left": outline.left.tolist(), "depth": outline.measure.turn, "longest": MOST_DEPTHS}
    if outline.measure.walled:
        inputs["walled"] = True
    return key_of("walls", _WALLS_VERSION, inputs)


def _wall_lengths(plan: Plan) -> dict[str, float]:
    settings = plan.dem
    return {
        "top": settings.wall_top,
        "bottom": settings.bottom,
        "plate_z": settings.plate_z,
        "particle_diameter": settings.classes.sauter_diameter,
    }


class _Replica:
    """One replica: what it is known by, and the work to be done for it."""

    def __init__(self, number: int, plan: Plan, walls: Path, context: Context) -> None:
        dem = plan.case.dem
        self.plan = replace(plan, case=varied(plan.case, {"dem.seed": str(dem.seed + number)}))
        self.number, self.walls = number, walls
        self.store, self.progress = context.store, context.progress
        self.deck = compose_deck(self.plan, walls)
        self.fill, produce = render(self.deck, "fill.in"), render(self.deck, "produce.in")
        stls = {path.name: digest(path) for path in sorted(walls.glob("*.stl"))}
        part: dict[str, Any] = {"deck": self.fill, "walls": stls, "liggghts": context.versions["liggghts"]}
        # what bed.data has of its own
        part |= {"box": [f"{end:.10g}" for end in self.deck.box], "packing": [LOOSE, LARGEST_OVERLAP]}
        part["placed"] = plan.dem.placed
        self.settle_key = key_of("settle", _VERSION, part)
        settled, grid = self.store.folder("settle", self.settle_key), plan.deposit_grid
        part = {"deck": produce, "settled": settled.name, "cell": grid.cell, "z": [grid.z_edges[0], grid.z_edges[-1]]}
        part |= ExtraSums.of(plan).key
        self.produce_key = key_of("produce", _VERSION, part)
        self.production_run = ProductionRun(
            self.store.folder("produce", self.produce_key), self.plan, settled, self.deck, number
        )
        self.production: Production | None = None  # what `work` has left

    def name(self, stage: str) -> str:
        """The stage's name, with the replica's number where there are several."""
        return stage if self.plan.case.dem.replicas == 1 else f"{stage}, replica {self.number + 1}"

    def work(self, average: RunningAverage) -> Generator[None, None, None]:
        """Settle and produce what is missing; nothing where the others are good enough."""
        if average.reached and not self.production_run.published():
            return
        yield from self.settle()
        with self.store.lock("produce", self.produce_key):
            average.replace(self.number, self.production_run.sums())  # another process may have been at it until now
            if not self.production_run.complete:
                average.evaluate()
            if self.production_run.complete or average.reached:
                self.progress.stage(self.name("produce"), DONE_BEFORE)
            else:
                self.store.begin("produce", self.produce_key)
                yield from self.production_run.run(self.walls, average, self.name("produce"), self.progress)
            self.production = self.production_run.production(self.walls)  # as long as no other process adds to it

    def settle(self) -> Generator[None, None, None]:
        """Fill the vessel and let the bed settle, unless that is done."""
        self.progress.stage(self.name("settle"), _found(self.store, "settle", self.settle_key))
        yield from self.store.make_in_steps("settle", self.settle_key, self._fill)

    def _fill(self, folder: Path) -> Iterator[None]:
        settings, begun = self.plan.dem, time.monotonic()
        self.progress.update(0.0, "packing the bed")
        placed = compose_bed(self.plan, self.walls, self.deck)
        copy_walls(self.walls, folder)
        (folder / "fill.in").write_text(self.fill if len(placed) else render(self.deck, "fill.in", bed=""))
        with (folder / "bed.data").open("w") as file:
            file.writelines(bed_lines(self.deck, placed))
        health = FillingHealth(settings, self.plan.case, len(placed))
        limits = limits_of(self.deck, self.plan, self.deck.chunk_steps * self.deck.fill_chunks)
        status, work, step = Status(), 0.0, 0
        with (
            evidence_kept(folder, self.store.folder("evidence", self.settle_key)),
            Liggghts("fill.in", folder, settings.ranks, {}, limits) as process,
        ):
            for status in process.wait(health.row):
                work, step = work + status.particles * max(0, status.step - step), status.step
                share = min(1.0, status.particles / settings.particles)
                self.progress.update(share, f"{status.particles} particles")
                yield
        bed = read_snapshot(folder / "settled.bin", DUMP_COLUMNS)
        seconds = time.monotonic() - begun, process.processor_seconds()
        if work > 0:
            left = duration_text(seconds[0] * len(bed) * settings.steps / work)
            self.progress.note(f"at the speed of the filling production takes about {left} at the most")
        _settle_record(status, len(placed), bed, self.deck, seconds, settings.ranks).write(folder)
        for path in (*folder.glob("*.stl"), folder / "bed.data"):
            path.unlink()


def compose_deck(plan: Plan, walls: Path) -> Deck:
    settings, report = plan.dem, WallRecord.read(walls)
    pieces = _insertion(plan, report.inward, settings.classes.largest + settings.skin / 2, settings.feed_top)
    if plan.space is not None:
        plates = [plate_name(plan.space, one) for one in plan.space.outlets]
        return make_deck(plan.case, settings, pieces, (), report.sides, plates)
    meshes = [f"obstacle_{name}" for name in plan.simulated.obstacles]
    return make_deck(plan.case, settings, pieces, meshes, report.sides)


def compose_bed(plan: Plan, walls: Path, deck: Deck) -> Bed:
    """Particles for most of the settled bed, packed wherever they may be inserted, as close to walls as each can lie.

    In space as close as the largest can: where a size can lie takes long to find there.
    """
    settings, report = plan.dem, WallRecord.read(walls)
    (x0, x1), (y0, y1) = report.sides
    ends = np.array([x0, y0, settings.plate_z]), np.array([x1, y1, settings.bed_top])
    radii = settings.classes.radius.tolist()
    if plan.space is not None:
        pieces = [_insertion(plan, report.inward, radii[-1], settings.bed_top)] * len(radii)
    else:
        pieces = [_insertion(plan, report.inward, radius, settings.bed_top) for radius in radii]
    return packed_bed(settings.classes, LOOSE, deck.bed_seed, pieces, ends, deck.periodic).lowest(settings.placed)


def _insertion(plan: Plan, inward: float, clearance: float, top: float) -> Sequence[Frustum | Boxes]:
    """Where centres of particles may be put that keep so far from walls and plate [m], from a level [m] down.

    `inward` is how far flat facets lie inside the true wall, at most [m].
    """
    settings = plan.dem
    bottom, margin = settings.plate_z + clearance, clearance + inward
    if plan.space is not None:
        return insertion_boxes(plan.space, settings, bottom, margin, top)
    angle = filling_angle(plan.case.contact.friction, plan.case.contact.rolling_friction)
    return insertion_frusta(plan.simulated, top, bottom, margin, angle, 2 * settings.classes.smallest)


def insertion_boxes(vessel: SpaceVessel, settings: Settings, bottom: float, margin: float, top: float) -> list[Boxes]:
    """Where particles are put into a vessel in space, from a level [m] down: the feed as one piece, then the rest."""
    classes = settings.classes
    found = vessel.insertion(top, bottom, margin, classes.largest, slab_height(classes))
    feed = Boxes(tuple(block for one in found for block in one.cut(settings.feed_bottom, top).blocks))
    bed = [one.cut(bottom, settings.feed_bottom) for one in found]
    return [one for one in (feed, *bed) if one.volume > _LEAST_VOLUME * classes.mean_volume]


def _settle_record(
    status: Status, placed: int, bed: Snapshot, deck: Deck, seconds: tuple[float, float], ranks: int
) -> SettleRecord:
    """What was placed and inserted, class by class; `seconds` are wall and processor time."""
    radii = np.array([c.radius for c in deck.classes])
    members = np.abs(bed.radius[:, None] - radii).argmin(axis=1)
    mass = np.bincount(members, minlength=len(radii)) * radii**3
    wanted = np.array([c.share for c in deck.classes]) * radii**3
    overlap = measure_overlap(bed.position, bed.radius)
    return SettleRecord(
        steps=status.step,
        particles=len(bed),
        inserted=placed + status.inserted,
        short_insertions=status.short_insertions,
        mass_share=tuple((mass / mass.sum()).tolist()),
        wanted_mass_share=tuple((wanted / wanted.sum()).tolist()),
        youngs_modulus=deck.youngs_modulus,
        overlap=OverlapRecord(overlap.mean, overlap.p99),
        wall_seconds=seconds[0],
        processor_seconds=seconds[1],
        ranks=ranks,
    )


def _found(store: Store, stage: str, key: str) -> str:
    return DONE_BEFORE if store.has(stage, key) else ""
