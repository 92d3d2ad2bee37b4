"""The DEM stages: walls, settle, produce. Each leaves a folder in the store; production is a chain of segments.

LIGGGHTS runs on from segment to segment. At each boundary the sums over the segment's snapshots and the restart file
appear together, by one rename, and the snapshots are gone: the disk never holds more than a few of them. Running again
continues after the last segment whose restart file is whole.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from granpipe.dem.deck import DUMP_COLUMNS, Deck, make_deck, render
from granpipe.dem.dump import Snapshot, is_complete, read_snapshot
from granpipe.dem.run import Liggghts, Status
from granpipe.dem.settings import Settings
from granpipe.errors import DataError, RunError
from granpipe.geometry.walls import build_walls
from granpipe.homogenize.average import Collector, Sums
from granpipe.plan import Plan
from granpipe.progress import Progress
from granpipe.store import Store, check_space, digest, key_of, publishing

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
    folder : of the chain
    segments : folders of the segments, in order
    settled : folder of the settled bed
    walls : folder of the STL files
    """

    folder: Path
    segments: tuple[Path, ...]
    settled: Path
    walls: Path

    def sums(self) -> Iterator[Sums]:
        """The sums of each segment."""
        return (Sums.load(segment / "sums.npz") for segment in self.segments)

    def last_snapshot(self) -> Snapshot:
        """The particles at the end."""
        return read_snapshot(self.segments[-1] / "snapshot.bin", DUMP_COLUMNS)

    def reports(self) -> list[dict[str, Any]]:
        """What each segment noted of itself."""
        return [read_json(segment / "segment.json") for segment in self.segments]


def simulate(plan: Plan, store: Store, tools: dict[str, str], progress: Progress) -> Production:
    """Run the DEM stages of a plan, or find them done."""
    walls = _walls(plan, store, tools, progress)
    deck = _deck(plan, walls)
    settled = _settle(deck, walls, plan.dem, store, tools, progress)
    return _produce(deck, walls, settled, plan, store, progress)


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


def _deck(plan: Plan, walls: Path) -> Deck:
    settings, outline = plan.dem, plan.outline
    report = read_json(walls / "walls.json")
    margin = settings.classes.largest + settings.skin / 2 + report["inward"]
    frusta = outline.insertion_frusta(
        settings.feed_top, settings.plate_z, margin, float(REPOSE), 2 * settings.classes.smallest
    )
    meshes = [f"obstacle_{name}" for name in outline.obstacles]
    return make_deck(plan.case, settings, frusta, meshes, report["wall_radius"])


def _settle(
    deck: Deck, walls: Path, settings: Settings, store: Store, tools: dict[str, str], progress: Progress
) -> Path:
    text = render(deck, "fill.in")
    part = {"deck": text, "walls": _stl_digests(walls), "liggghts": tools["liggghts"]}
    key = key_of("settle", _VERSION, part)
    progress.stage("settle", _found(store, "settle", key))

    def work(folder: Path) -> None:
        _copy_walls(walls, folder)
        (folder / "fill.in").write_text(text)
        status = Status()
        with Liggghts("fill.in", folder, settings.ranks, {}) as process:
            for status in process.wait():
                share = min(1.0, status.particles / settings.particles)
                rest = "" if status.message != "full" else ", settling"
                progress.update(share, f"{status.particles} particles{rest}")
        bed = read_snapshot(folder / "settled.bin", DUMP_COLUMNS)
        _check_balance(status.inserted, 0, len(bed), "filling")
        write_json(folder / "settle.json", _settle_report(status, bed, deck))
        for path in folder.glob("*.stl"):
            path.unlink()

    return store.make("settle", key, work)


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


def _produce(deck: Deck, walls: Path, settled: Path, plan: Plan, store: Store, progress: Progress) -> Production:
    text = render(deck, "produce.in")
    grid = plan.grid
    part = {"deck": text, "settled": settled.name, "cell": grid.cell, "z": [grid.z_edges[0], grid.z_edges[-1]]}
    key = key_of("produce", _VERSION, part)
    chain = Chain(store.folder("produce", key), plan, settled)
    if len(chain.published()) < plan.dem.segments:
        with store.lock("produce", key):
            chain.run(text, walls, progress)
    else:
        progress.stage("produce", "done before")
    return Production(chain.folder, tuple(chain.published()[: plan.dem.segments]), settled, walls)


class Chain:
    """Production in segments, in a folder of the store."""

    def __init__(self, folder: Path, plan: Plan, settled: Path) -> None:
        self.folder, self.plan, self.settled = folder, plan, settled
        self.settings = plan.dem

    def published(self) -> list[Path]:
        """Folders of the segments that are done, in order, up to the first that is missing."""
        found: list[Path] = []
        while (path := self._segment(len(found) + 1)).is_dir():
            found.append(path)
        return found

    def _segment(self, number: int) -> Path:
        return self.folder / f"segment-{number:05d}"

    def run(self, deck: str, walls: Path, progress: Progress) -> None:
        """Run LIGGGHTS from the last good restart file to the last segment."""
        done, restart = self._resume_point()
        progress.stage("produce", f"continues after segment {done} of {self.settings.segments}" if done else "")
        work = self.folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        check_space(work, int(self.plan.disk_bytes))
        _copy_walls(walls, work)
        shutil.copyfile(restart, work / "start.restart")
        (work / "produce.in").write_text(deck)
        present = len(read_snapshot(self.settled / "settled.bin", DUMP_COLUMNS))
        if done:
            present = int(read_json(self._segment(done) / "segment.json")["particles"])
        variables = {"first": done + 1, "last": self.settings.segments}
        watch = _Watch(self, work, done, present, progress)
        with Liggghts("produce.in", work, self.settings.ranks, variables) as process:
            for status in process.wait():
                watch.look(status)
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

    def __init__(self, chain: Chain, work: Path, done: int, present: int, progress: Progress) -> None:
        self.chain, self.work, self.progress, self.present = chain, work, progress, present
        self.settings = chain.settings
        self.collector = Collector(chain.plan.grid, "displacement")
        self.segment = done + 1
        self.next_step = done * self.settings.segment_steps
        self.start_step, self.started = self.next_step, time.monotonic()
        self.averaging = 0.0
        self.count = 0

    def look(self, status: Status) -> None:
        """Take in what has appeared since the last look, but not so much that the output goes unread."""
        for _ in range(_AT_ONCE):
            if not self._take_snapshot(status):
                break
        done = (status.step - self.start_step) / max(1, self.settings.steps - self.start_step)
        if 0 < done <= 1:
            left = (time.monotonic() - self.started) * (1 - done) / done
            self.progress.update(
                status.step / self.settings.steps,
                f"step {status.step} of {self.settings.steps}, {status.particles} particles, {_duration(left)} left",
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


def _stl_digests(walls: Path) -> dict[str, str]:
    return {path.name: digest(path) for path in sorted(walls.glob("*.stl"))}


def _copy_walls(walls: Path, folder: Path) -> None:
    for path in walls.glob("*.stl"):
        shutil.copyfile(path, folder / path.name)


def _found(store: Store, stage: str, key: str) -> str:
    return "done before" if store.folder(stage, key).is_dir() else ""


def read_json(path: Path) -> dict[str, Any]:
    try:
        data: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: damaged ({error}); delete {path.parent} and run again") from error
    return data


def write_json(path: Path, data: dict[str, Any]) -> None:
    path.write_text(json.dumps(data, indent=2) + "\n")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
