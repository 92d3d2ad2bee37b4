"""The DEM stages: walls, settle, produce. Each leaves a folder in the store; production is a chain of segments.

Replicas are the same case with other seeds: chains of their own, side by side, judged together.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.dem.deck import DUMP_COLUMNS, Deck, make_deck, render
from granpipe.dem.dump import Snapshot, read_snapshot
from granpipe.dem.health import FillingHealth
from granpipe.dem.overlap import measure_overlap
from granpipe.dem.run import Liggghts, Status
from granpipe.geometry.walls import build_walls
from granpipe.homogenize.average import Sums
from granpipe.planning.plan import Plan
from granpipe.progress import Progress
from granpipe.run.extra_fields import Summed
from granpipe.run.production import Chain, Judge, Together, copy_walls, limits_of, load_sums, write_hashes
from granpipe.system.cores import usable_cores
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.pool import Task, run_together
from granpipe.system.store import Store, digest, evidence_kept, key_of

REPOSE = np.radians(30)
"""Angle of repose that limits where filling can reach; only the first bed depends on it."""

_VERSION = 4


@dataclass(frozen=True)
class Production:
    """A finished chain of segments.

    Parameters
    ----------
    run : which of the replicas it is
    folder : of the chain
    segments : folders of the segments, in order
    settled : folder of the settled bed
    walls : folder of the STL files
    """

    run: int
    folder: Path
    segments: tuple[Path, ...]
    settled: Path
    walls: Path

    def sums(self) -> Iterator[Sums]:
        """The sums of each segment."""
        return (load_sums(segment, self.run) for segment in self.segments)

    def last_snapshot(self) -> Snapshot:
        """The particles at the end."""
        return read_snapshot(self.segments[-1] / "snapshot.bin", DUMP_COLUMNS)

    def reports(self) -> list[dict[str, Any]]:
        """What each segment noted of itself."""
        return [read_json(segment / "segment.json") for segment in self.segments]


def simulate(
    plan: Plan, store: Store, tools: dict[str, str], progress: Progress, judge: Judge
) -> tuple[Production, ...]:
    """Run the DEM stages of a plan, or find them done; one production for each replica that has segments."""
    walls = make_walls(plan, store, tools, progress)
    dem = plan.case.dem
    runs = [_Run(number, plan, walls, store, tools, progress) for number in range(dem.replicas)]
    together = Together(judge, [sums for run in runs for sums in run.chain.sums()])
    if not all(run.chain.complete for run in runs):
        together.look()
    tasks = (Task(run.name("DEM"), plan.dem.ranks, run.work(together)) for run in runs)
    run_together(tasks, usable_cores())
    return tuple(run.production() for run in runs if run.chain.published())


def settle(plan: Plan, store: Store, tools: dict[str, str], progress: Progress) -> Path:
    """The folder of the settled bed of a plan's first run."""
    walls = make_walls(plan, store, tools, progress)
    run = _Run(0, plan, walls, store, tools, progress)
    run_together([Task(run.name("settle"), plan.dem.ranks, run.settle())], usable_cores())
    return run.chain.settled


def make_walls(plan: Plan, store: Store, tools: dict[str, str], progress: Progress) -> Path:
    settings, outline = plan.dem, plan.outline
    facets = None if plan.case.dem.facets == "auto" else int(plan.case.dem.facets)
    numbers = {
        "top": settings.wall_top,
        "bottom": settings.bottom,
        "plate_z": settings.plate_z,
        "particle_diameter": settings.classes.sauter_diameter,
    }
    part = numbers | {
        "wall": outline.wall.tolist(),
        "obstacles": {name: polygon.tolist() for name, polygon in outline.obstacles.items()},
        "facets": facets,
        "gmsh": tools["gmsh"],
    }
    key = key_of("walls", _VERSION, part)
    progress.stage("walls", _found(store, "walls", key))

    def work(folder: Path) -> None:
        walls = build_walls(outline, folder=folder, facets=facets, **numbers)
        report = {
            "facets": walls.facets,
            "wall_radius": walls.radius,
            "inward": walls.inward,
            "triangles": dict(walls.triangles),
            "plate_area": walls.plate_area,
        }
        write_json(folder / "walls.json", report)

    return store.make("walls", key, work)


class _Run:
    """One replica: what it is known by, and the work to be done for it."""

    def __init__(
        self, number: int, plan: Plan, walls: Path, store: Store, tools: dict[str, str], progress: Progress
    ) -> None:
        dem = plan.case.dem
        self.plan = replace(plan, case=plan.case.varied({"dem.seed": str(dem.seed + number)}))
        self.number, self.walls, self.store, self.progress = number, walls, store, progress
        self.deck = compose_deck(self.plan, walls)
        self.fill, produce = render(self.deck, "fill.in"), render(self.deck, "produce.in")
        stls = {path.name: digest(path) for path in sorted(walls.glob("*.stl"))}
        part: dict[str, Any] = {"deck": self.fill, "walls": stls, "liggghts": tools["liggghts"]}
        self.settle_key = key_of("settle", _VERSION, part)
        settled, grid = store.folder("settle", self.settle_key), plan.grid
        part = {"deck": produce, "settled": settled.name, "cell": grid.cell, "z": [grid.z_edges[0], grid.z_edges[-1]]}
        part |= Summed.of(plan).key
        self.chain_key = key_of("produce", _VERSION, part)
        self.chain = Chain(store.folder("produce", self.chain_key), self.plan, settled, self.deck, number)

    def name(self, stage: str) -> str:
        """The stage's name, with the replica's number where there are several."""
        return stage if self.plan.case.dem.replicas == 1 else f"{stage}, replica {self.number + 1}"

    def work(self, together: Together) -> Generator[None, None, None]:
        """Settle and produce what is missing; nothing where the others are good enough."""
        if together.enough and not self.chain.published():
            return
        yield from self.settle()
        if self.chain.complete or together.enough:
            self.progress.stage(self.name("produce"), "done before")
            return
        with self.store.lock("produce", self.chain_key):
            together.renew(self.number, self.chain.sums())  # another process may have been at it until now
            together.look()
            if self.chain.complete or together.enough:
                return
            yield from self.chain.run(self.walls, together, self.name("produce"), self.progress)

    def production(self) -> Production:
        """What there is."""
        chain = self.chain
        return Production(self.number, chain.folder, tuple(chain.published()), chain.settled, self.walls)

    def settle(self) -> Generator[None, None, None]:
        """Fill the vessel and come to rest, unless that is done."""
        self.progress.stage(self.name("settle"), _found(self.store, "settle", self.settle_key))
        yield from self.store.make_in_steps("settle", self.settle_key, self._fill)

    def _fill(self, folder: Path) -> Iterator[None]:
        settings, begun = self.plan.dem, time.monotonic()
        copy_walls(self.walls, folder)
        (folder / "fill.in").write_text(self.fill)
        health = FillingHealth(settings, self.plan.case)
        limits = limits_of(
            self.deck, self.plan, self.deck.chunk_steps * (self.deck.fill_chunks + self.deck.settle_chunks)
        )
        status = Status()
        with (
            evidence_kept(folder, self.store.folder("evidence", self.settle_key)),
            Liggghts("fill.in", folder, settings.ranks, {}, limits) as process,
        ):
            for status in process.wait(health.row):
                share = min(1.0, status.particles / settings.particles)
                rest = "" if status.message != "full" else ", settling"
                self.progress.update(share, f"{status.particles} particles{rest}")
                yield
        bed = read_snapshot(folder / "settled.bin", DUMP_COLUMNS)
        spent = {
            "wall_seconds": time.monotonic() - begun,
            "processor_seconds": process.processor_seconds(),
            "ranks": settings.ranks,
        }
        write_json(folder / "settle.json", _settle_report(status, bed, self.deck) | spent)
        write_hashes(folder, "settled.bin", "settled.restart")
        for path in folder.glob("*.stl"):
            path.unlink()


def compose_deck(plan: Plan, walls: Path) -> Deck:
    settings, outline = plan.dem, plan.outline
    report = read_json(walls / "walls.json")
    margin = settings.classes.largest + settings.skin / 2 + report["inward"]
    above_plate = settings.plate_z + settings.classes.largest + settings.skin / 2
    frusta = outline.insertion_frusta(
        settings.feed_top, above_plate, margin, float(REPOSE), 2 * settings.classes.smallest
    )
    meshes = [f"obstacle_{name}" for name in outline.obstacles]
    return make_deck(plan.case, settings, frusta, meshes, report["wall_radius"])


def _settle_report(status: Status, bed: Snapshot, deck: Deck) -> dict[str, Any]:
    """What was inserted, class by class: LIGGGHTS inserts the largest first, and a shortfall distorts the sizes."""
    radii = np.array([c.radius for c in deck.classes])
    members = np.abs(bed.radius[:, None] - radii).argmin(axis=1)
    mass = np.bincount(members, minlength=len(radii)) * radii**3
    wanted = np.array([c.share for c in deck.classes]) * radii**3
    overlap = measure_overlap(bed.position, bed.radius)
    return {
        "steps": status.step,
        "particles": len(bed),
        "inserted": status.inserted,
        "short_insertions": status.short_insertions,
        "mass_share": (mass / mass.sum()).tolist(),
        "wanted_mass_share": (wanted / wanted.sum()).tolist(),
        "youngs_modulus": deck.youngs_modulus,
        "overlap": {"mean": overlap.mean, "p99": overlap.p99},
    }


def _found(store: Store, stage: str, key: str) -> str:
    return "done before" if store.folder(stage, key).is_dir() else ""
