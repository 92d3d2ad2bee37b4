"""The DEM stages: walls, settle, produce. Each leaves a folder in the store; production is a chain of segments.

LIGGGHTS runs on from segment to segment. At each boundary the sums over the segment's snapshots and the restart file
appear together, by one rename, and the snapshots are gone: the disk never holds more than a few of them. Running again
continues after the last segment whose restart file is whole. Replicas are the same case with other seeds: chains of
their own, side by side, judged together.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.dem.deck import DUMP_COLUMNS, Deck, make_deck, render
from granpipe.dem.dump import Snapshot, is_complete, read_snapshot
from granpipe.dem.run import Liggghts, Status
from granpipe.errors import RunError
from granpipe.geometry.walls import build_walls
from granpipe.homogenize.average import Collector, Sums
from granpipe.jsonfile import read_json, write_json
from granpipe.plan import Plan
from granpipe.progress import Progress
from granpipe.store import Store, check_space, digest, key_of, publishing
from granpipe.study.pool import Task, run_together

REPOSE = np.radians(30)
"""Angle of repose that limits where filling can reach; only the first bed depends on it."""

_KEPT_RESTARTS = 2
_AT_ONCE = 8  # snapshots
_VERSION = 2


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


def load_sums(segment: Path, run: int) -> Sums:
    """The sums of a published segment."""
    return replace(Sums.load(segment / "sums.npz"), run=run)


@dataclass(frozen=True)
class Standing:
    """How good the average of a run in progress is.

    errors : section → statistical error of the final field, the whole included; empty while it is not known
    enough : the case is content
    missing : simulated time [s] that is still missing, for all replicas together; None if nothing can be said
    """

    errors: dict[str, float] = field(default_factory=dict)
    enough: bool = False
    missing: float | None = None

    def __str__(self) -> str:
        if not self.errors:
            return "error not known yet"
        sections = ", ".join(f"{name} {100 * e:.2g}" for name, e in self.errors.items() if name != "whole")
        return f"error {100 * self.errors['whole']:.2g} % ({sections})"


Judge = Callable[[Sequence[Sums]], Standing]


def simulate(
    plan: Plan, store: Store, tools: dict[str, str], progress: Progress, judge: Judge
) -> tuple[Production, ...]:
    """Run the DEM stages of a plan, or find them done; one production for each replica that has segments."""
    walls = _walls(plan, store, tools, progress)
    dem = plan.case.dem
    runs = [_Run(number, plan, walls, store, tools, progress) for number in range(dem.replicas)]
    together = Together(judge, [sums for run in runs for sums in run.chain.sums()])
    if not all(run.chain.complete for run in runs):
        together.look()
    tasks = (Task(run.name("DEM"), plan.dem.ranks, run.work(together)) for run in runs)
    run_together(tasks, len(os.sched_getaffinity(0)))
    return tuple(run.production() for run in runs if run.chain.published())


def _walls(plan: Plan, store: Store, tools: dict[str, str], progress: Progress) -> Path:
    settings, outline = plan.dem, plan.outline
    numbers = {
        "top": settings.wall_top,
        "bottom": settings.bottom,
        "plate_z": settings.plate_z,
        "particle_diameter": settings.classes.sauter_diameter,
    }
    part = numbers | {
        "wall": outline.wall.tolist(),
        "obstacles": {name: polygon.tolist() for name, polygon in outline.obstacles.items()},
        "gmsh": tools["gmsh"],
    }
    key = key_of("walls", _VERSION, part)
    progress.stage("walls", _found(store, "walls", key))

    def work(folder: Path) -> None:
        walls = build_walls(outline, folder=folder, **numbers)
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
        self.deck = _deck(self.plan, walls)
        self.fill, produce = render(self.deck, "fill.in"), render(self.deck, "produce.in")
        stls = {path.name: digest(path) for path in sorted(walls.glob("*.stl"))}
        part: dict[str, Any] = {"deck": self.fill, "walls": stls, "liggghts": tools["liggghts"]}
        self.settle_key = key_of("settle", _VERSION, part)
        settled, grid = store.folder("settle", self.settle_key), plan.grid
        part = {"deck": produce, "settled": settled.name, "cell": grid.cell, "z": [grid.z_edges[0], grid.z_edges[-1]]}
        self.chain_key = key_of("produce", _VERSION, part)
        self.chain = Chain(store.folder("produce", self.chain_key), self.plan, settled, produce, number)

    def name(self, stage: str) -> str:
        """The stage's name, with the replica's number where there are several."""
        return stage if self.plan.case.dem.replicas == 1 else f"{stage}, replica {self.number + 1}"

    def work(self, together: Together) -> Generator[None, None, None]:
        """Settle and produce what is missing; nothing where the others are good enough."""
        if together.enough and not self.chain.published():
            return
        yield from self._settle()
        if self.chain.complete or together.enough:
            self.progress.stage(self.name("produce"), "done before")
            return
        with self.store.lock("produce", self.chain_key):
            yield from self.chain.run(self.walls, together, self.name("produce"), self.progress)

    def production(self) -> Production:
        """What there is."""
        chain = self.chain
        return Production(self.number, chain.folder, tuple(chain.published()), chain.settled, self.walls)

    def _settle(self) -> Generator[None, None, None]:
        self.progress.stage(self.name("settle"), _found(self.store, "settle", self.settle_key))
        yield from self.store.make_in_steps("settle", self.settle_key, self._fill)

    def _fill(self, folder: Path) -> Iterator[None]:
        settings = self.plan.dem
        _copy_walls(self.walls, folder)
        (folder / "fill.in").write_text(self.fill)
        status = Status()
        with Liggghts("fill.in", folder, settings.ranks, {}) as process:
            for status in process.wait():
                share = min(1.0, status.particles / settings.particles)
                rest = "" if status.message != "full" else ", settling"
                self.progress.update(share, f"{status.particles} particles{rest}")
                yield
        bed = read_snapshot(folder / "settled.bin", DUMP_COLUMNS)
        _check_balance(status.inserted, 0, len(bed), "filling")
        write_json(folder / "settle.json", _settle_report(status, bed, self.deck))
        for path in folder.glob("*.stl"):
            path.unlink()


def _deck(plan: Plan, walls: Path) -> Deck:
    settings, outline = plan.dem, plan.outline
    report = read_json(walls / "walls.json")
    margin = settings.classes.largest + settings.skin / 2 + report["inward"]
    frusta = outline.insertion_frusta(
        settings.feed_top, settings.plate_z, margin, float(REPOSE), 2 * settings.classes.smallest
    )
    meshes = [f"obstacle_{name}" for name in outline.obstacles]
    return make_deck(plan.case, settings, frusta, meshes, report["wall_radius"])


def _settle_report(status: Status, bed: Snapshot, deck: Deck) -> dict[str, Any]:
    """What was inserted, class by class: LIGGGHTS inserts the largest first, and a shortfall distorts the sizes."""
    radii = np.array([c.radius for c in deck.classes])
    members = np.abs(bed.radius[:, None] - radii).argmin(axis=1)
    mass = np.bincount(members, minlength=len(radii)) * radii**3
    wanted = np.array([c.share for c in deck.classes]) * radii**3
    return {
        "steps": status.step,
        "particles": len(bed),
        "inserted": status.inserted,
        "short_insertions": status.short_insertions,
        "mass_share": (mass / mass.sum()).tolist(),
        "wanted_mass_share": (wanted / wanted.sum()).tolist(),
    }


class Together:
    """What the replicas of a case share while they run: the sums so far, and whether their average is good enough.

    The judge is asked when there are a good part more segments than at the last time: it takes about a second.
    """

    _MORE = 1.08

    def __init__(self, judge: Judge, parts: Sequence[Sums]) -> None:
        self._judge, self._parts, self._next = judge, list(parts), 0.0
        self.standing = Standing()

    def add(self, sums: Sums) -> None:
        """Take in a new segment of one of the runs."""
        self._parts.append(sums)
        self.look()

    def renew(self, run: int, parts: Iterator[Sums]) -> None:
        """Take these for all that there is of one of the runs: a damaged segment may have been dropped."""
        self._parts = [sums for sums in self._parts if sums.run != run] + list(parts)

    def look(self) -> None:
        """Judge what there is, if it is enough more than before."""
        if len(self._parts) >= self._next:
            self._next = self._MORE * len(self._parts)
            self.standing = self._judge(self._parts)

    @property
    def enough(self) -> bool:
        """No run need go on."""
        return self.standing.enough


class Chain:
    """Production in segments, in a folder of the store.

    Parameters
    ----------
    folder : of the chain
    settled : folder of the bed that it starts from
    deck : text of the LIGGGHTS deck
    number : which of the replicas it is
    """

    def __init__(self, folder: Path, plan: Plan, settled: Path, deck: str, number: int = 0) -> None:
        self.folder, self.plan, self.settled, self.deck, self.number = folder, plan, settled, deck, number
        self.settings = plan.dem

    def published(self) -> list[Path]:
        """Folders of the segments that are done, in order, up to the first that is missing."""
        found: list[Path] = []
        while len(found) < self.settings.segments and (path := self._segment(len(found) + 1)).is_dir():
            found.append(path)
        return found

    @property
    def complete(self) -> bool:
        """Nothing is left to do, whatever the target."""
        return self._segment(self.settings.segments).is_dir()

    def sums(self) -> Iterator[Sums]:
        """The sums of the segments that are done."""
        return (load_sums(segment, self.number) for segment in self.published())

    def _segment(self, number: int) -> Path:
        return self.folder / f"segment-{number:05d}"

    def run(self, walls: Path, together: Together, stage: str, progress: Progress) -> Iterator[None]:
        """Run LIGGGHTS from the last good restart file to the last segment, or until the average is good enough."""
        done, restart = self._resume_point()
        together.renew(self.number, self.sums())
        progress.stage(stage, f"continues after segment {done} of {self.settings.segments}" if done else "")
        work = self.folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        check_space(work, int(self.plan.disk_bytes))
        _copy_walls(walls, work)
        shutil.copyfile(restart, work / "start.restart")
        (work / "produce.in").write_text(self.deck)
        present = len(read_snapshot(self.settled / "settled.bin", DUMP_COLUMNS))
        if done:
            present = int(read_json(self._segment(done) / "segment.json")["particles"])
        variables = {"first": done + 1, "last": self.settings.segments}
        watch = _Watch(self, work, done, present, together, progress)
        with Liggghts("produce.in", work, self.settings.ranks, variables) as process:
            for status in process.wait():
                watch.look(status)
                if together.enough:
                    break
                yield
            else:
                watch.finish(process.status)
        logs = self.folder / "logs"
        logs.mkdir(exist_ok=True)
        (work / "output.txt").replace(logs / f"produce-from-segment-{done + 1}.txt")
        shutil.rmtree(work)

    def _resume_point(self) -> tuple[int, Path]:
        """Number of segments to build on and the restart file after them; damaged ones are dropped."""
        for segment in reversed(self.published()):
            restart = segment / "restart"
            if restart.is_file() and _is_whole(restart, read_json(segment / "segment.json")):
                return int(segment.name[-5:]), restart
            shutil.rmtree(segment)
        return 0, self.settled / "settled.restart"

    def publish(self, number: int, sums: Sums, restart: Path, snapshot: Path, report: dict[str, Any]) -> None:
        """Let a segment appear, and take the restart file from all but the newest."""
        with publishing(self._segment(number)) as folder:
            sums.save(folder / "sums.npz")
            restart.replace(folder / "restart")
            shutil.copyfile(snapshot, folder / "snapshot.bin")
            whole = {"size": (folder / "restart").stat().st_size, "sha256": digest(folder / "restart")}
            write_json(folder / "segment.json", report | whole)
        if number > _KEPT_RESTARTS:
            old = self._segment(number - _KEPT_RESTARTS)
            for name in ("restart", "snapshot.bin"):
                (old / name).unlink(missing_ok=True)


class _Watch:
    """Follows a running production: takes in snapshots, publishes segments, keeps the particle balance."""

    def __init__(
        self, chain: Chain, work: Path, done: int, present: int, together: Together, progress: Progress
    ) -> None:
        self.chain, self.work, self.progress, self.present = chain, work, progress, present
        self.together = together
        self.settings = chain.settings
        self.collector = Collector(chain.plan.grid, "displacement")
        self.segment = done + 1
        self.next_step = done * self.settings.segment_steps
        self.start_step, self.started = self.next_step, time.monotonic()
        self.averaging = 0.0
        self.count = 0
        self.disk = 0

    def look(self, status: Status) -> None:
        """Take in what has appeared since the last look, but not so much that the output goes unread."""
        for _ in range(_AT_ONCE):
            if not self._take_snapshot(status):
                break
        self._report(status)

    def _report(self, status: Status) -> None:
        made = status.step - self.start_step
        if made <= 0:
            return
        wanted = self.settings.steps - status.step
        if self.together.standing.missing is not None:
            missing = self.together.standing.missing / self.chain.plan.case.dem.replicas
            wanted = min(wanted, round(missing / self.settings.time_step))
        left = (time.monotonic() - self.started) * wanted / made
        self.progress.update(
            1 - wanted / max(1, status.step + wanted),
            f"step {status.step}, {status.particles} particles, {self.together.standing}, {_duration(left)} left, "
            f"{self.disk / 1e6:.0f} MB",
        )

    def finish(self, status: Status) -> None:
        """The last look, after LIGGGHTS has ended well."""
        while self._take_snapshot(status):
            pass
        _check_balance(self.present + status.inserted, status.discharged, status.particles, "production")
        if self.segment <= self.settings.segments:
            raise RunError(f"LIGGGHTS ended without the snapshots of segment {self.segment}; see {self.work}")

    def _take_snapshot(self, status: Status) -> bool:
        """Add the next snapshot if it is there; at the end of a segment wait for its restart file as well."""
        path = self.work / f"snapshot.{self.next_step}.bin"
        if self.segment > self.settings.segments or not (path.exists() and is_complete(path)):
            return False
        ends = self.next_step == self.segment * self.settings.segment_steps
        restart = self.work / f"segment.{self.segment}.restart"
        if ends and not restart.exists():
            return False
        begun = time.process_time()
        snapshot = read_snapshot(path, DUMP_COLUMNS)
        self.collector.add(self.next_step * self.settings.time_step, snapshot)
        self.count = len(snapshot)
        sums = self.collector.take() if ends else None
        self.averaging += time.process_time() - begun
        if sums is not None:
            self._publish(sums, restart, path, status)
        self._keep(path, ends)
        self.next_step += self.settings.dump_every
        return True

    def _publish(self, sums: Sums, restart: Path, snapshot: Path, status: Status) -> None:
        report = {
            "particles": self.count,
            "inserted": status.inserted,
            "discharged": status.discharged,
            "averaging_seconds": self.averaging,
            "wall_seconds": time.monotonic() - self.started,
            "ranks": self.settings.ranks,
        }
        check_space(self.chain.folder, 3 * restart.stat().st_size)
        self.chain.publish(self.segment, sums, restart, snapshot, report)
        self.segment += 1
        self.disk = sum(path.stat().st_size for path in self.chain.folder.rglob("*") if path.is_file())
        self.together.add(replace(sums, run=self.chain.number))

    def _keep(self, path: Path, ends: bool) -> None:
        kept = self.chain.plan.case.dem.keep_snapshots
        if kept == "all" or (kept == "thinned" and ends):
            folder = self.chain.folder / "snapshots"
            folder.mkdir(exist_ok=True)
            path.replace(folder / path.name)
        else:
            path.unlink()


def _check_balance(inserted: int, discharged: int, present: int, during: str) -> None:
    if inserted - discharged != present:
        raise RunError(
            f"the particle balance of {during} does not close: {inserted} inserted − {discharged} discharged "
            f"≠ {present} present; particles were lost (too large a time step, or a leak in the walls)"
        )


def _is_whole(restart: Path, report: dict[str, Any]) -> bool:
    return bool(restart.stat().st_size == report["size"] > 0 and digest(restart) == report["sha256"])


def _copy_walls(walls: Path, folder: Path) -> None:
    for path in walls.glob("*.stl"):
        shutil.copyfile(path, folder / path.name)


def _found(store: Store, stage: str, key: str) -> str:
    return "done before" if store.folder(stage, key).is_dir() else ""


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
