"""Production in segments: LIGGGHTS runs on from one to the next; finished segments survive any interruption.

At each boundary the sums over the segment's snapshots, the restart file and their hashes appear together, by one
rename, and the snapshots are deleted: the disk never holds more than a few. Running again continues after the last
segment that is whole.
"""

from __future__ import annotations

import shutil
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from granpipe.dem.deck import DUMP_COLUMNS, Deck, render
from granpipe.dem.dump import read_snapshot
from granpipe.dem.dump_binary import is_complete
from granpipe.dem.health import FlowHealth
from granpipe.dem.overlap import Overlap
from granpipe.dem.run import Liggghts, Limits, Status
from granpipe.dem.settings import RATE
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import DataError
from granpipe.homogenize.average import Collector, Sums
from granpipe.pipeline.convergence import RunningAverage
from granpipe.pipeline.extra_fields import ExtraSums
from granpipe.pipeline.health_limits import flow_limits, space_limits
from granpipe.pipeline.records import OverlapRecord, SegmentRecord
from granpipe.pipeline.softness import reference_overlap
from granpipe.planning.plan import Plan
from granpipe.progress import Progress, duration_text
from granpipe.system.files import check_space
from granpipe.system.manifest import is_unchanged, is_whole, read_manifest, verify
from granpipe.system.publish import publishing
from granpipe.system.store import evidence_kept

_LASTING = ("sums.npz", SegmentRecord.name)
_TO_RESUME = ("restart", "snapshot.bin")
_KEPT_RESTARTS = 2
_AT_ONCE = 8  # snapshots
_MOST_AHEAD = 64  # snapshots by which LIGGGHTS may be ahead of the averaging
_KEPT_SNAPSHOTS = 2  # as evidence, should the run fail


def load_sums(segment: Path, run: int) -> Sums:
    """The sums of a published segment.

    Raises
    ------
    DataError : the file is damaged, or of another version
    """
    return replace(Sums.load(segment / "sums.npz"), run=run)


@dataclass(frozen=True)
class Production:
    """What production has left: the segments of one replica.

    Parameters
    ----------
    run : which of the replicas it is
    folder : of the production
    segments : folders of the segments that the case asks for, in order
    last : folder of the last segment there is, which has a snapshot; later than `segments` where a longer case ran too
    settled : folder of the settled bed
    walls : folder of the STL files
    """

    run: int
    folder: Path
    segments: tuple[Path, ...]
    last: Path
    settled: Path
    walls: Path

    def sums(self) -> Iterator[Sums]:
        """The sums of each segment.

        Raises
        ------
        DataError : the sums of a segment are damaged
        """
        return (load_sums(segment, self.run) for segment in self.segments)

    def last_snapshot(self) -> Snapshot:
        """The particles at the end.

        Raises
        ------
        DataError : the snapshot is damaged
        """
        return read_snapshot(self.last / "snapshot.bin", DUMP_COLUMNS)

    def kept_frames(self, most: int) -> list[tuple[int, Snapshot]]:
        """Step and particles of snapshots that the case has kept, at most so many, spread evenly over the run."""
        paths = {int(path.name.split(".")[1]): path for path in (self.folder / "snapshots").glob("snapshot.*.bin")}
        steps = sorted(paths)
        chosen = sorted({steps[k * (len(steps) - 1) // max(1, most - 1)] for k in range(most)}) if steps else []
        return [(step, read_snapshot(paths[step], DUMP_COLUMNS)) for step in chosen]

    def reports(self) -> list[SegmentRecord]:
        """What each segment noted of itself."""
        return [SegmentRecord.read(segment) for segment in self.segments]


class ProductionRun:
    """Production in segments, in a folder of the store.

    Parameters
    ----------
    folder : of the production
    settled : folder of the bed that it starts from
    deck : what LIGGGHTS runs
    number : which of the replicas it is
    """

    def __init__(self, folder: Path, plan: Plan, settled: Path, deck: Deck, number: int = 0) -> None:
        self.folder, self.plan, self.settled, self.deck, self.number = folder, plan, settled, deck, number
        self.settings = plan.dem
        self._whole: set[tuple[Path, tuple[str, ...]]] = set()
        self._resumed = 0  # after which segment

    def published(self) -> list[Path]:
        """Folders of the segments that are done, in order, up to the first that is missing or damaged.

        Another case may have asked for more of them than this one, with the same particles.
        """
        found: list[Path] = []
        while self._has(path := self._segment(len(found) + 1), _LASTING):
            found.append(path)
        while found and not self._has(found[-1], ("snapshot.bin",)):  # pictures and figures are made from the last one
            found.pop()
        return found

    def _has(self, segment: Path, names: tuple[str, ...]) -> bool:
        """Whether files of a segment are as they were published; each is read once."""
        if (segment, names) not in self._whole and is_whole(segment, names):
            self._whole.add((segment, names))
        return (segment, names) in self._whole

    @property
    def damaged(self) -> bool:
        """Whether there are more segments than are whole."""
        return len(list(self.folder.glob("segment-*"))) > len(self.published())

    @property
    def complete(self) -> bool:
        """Nothing is left to do, whatever the target."""
        return len(self.published()) >= self.settings.segments

    def sums(self) -> Iterator[Sums]:
        """The sums of the segments that are done and asked for.

        Raises
        ------
        DataError : the sums of a segment are damaged
        """
        return (load_sums(segment, self.number) for segment in self.published()[: self.settings.segments])

    def production(self, walls: Path) -> Production | None:
        """What there is; None where there is no segment."""
        if found := self.published():
            segments = tuple(found[: self.settings.segments])
            return Production(self.number, self.folder, segments, found[-1], self.settled, walls)
        return None

    def _segment(self, number: int) -> Path:
        return self.folder / f"segment-{number:05d}"

    def run(self, walls: Path, average: RunningAverage, stage: str, progress: Progress) -> Iterator[None]:
        """Run LIGGGHTS from the last good restart file to the last segment, or until the average is good enough."""
        done, restart, bed = self._resume_point()
        self._resumed = done
        average.replace(self.number, self.sums())
        progress.stage(stage, f"continues after segment {done} of {self.settings.segments}" if done else "")
        work = self.folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        check_space(work, int(self.plan.disk_bytes))
        copy_walls(walls, work)
        shutil.copyfile(restart, work / "start.restart")
        (work / "produce.in").write_text(render(self.deck, "produce.in"))
        variables = {"first": done + 1, "last": self.settings.segments}
        limits = limits_of(self.deck, self.plan, self.settings.steps)
        with (
            evidence_kept(work, self.folder / "evidence"),
            Liggghts("produce.in", work, self.settings.ranks, variables, limits) as process,
        ):
            watch = _Watch(self, process, done, self._health(bed), average, progress)
            for status in process.wait(watch.health.row):
                watch.look(status)
                if average.reached:
                    break
                yield
            else:
                watch.finish(process.status)
        logs = self.folder / "logs"
        logs.mkdir(exist_ok=True)
        (work / "output.txt").replace(logs / f"produce-from-segment-{done + 1}.txt")
        shutil.rmtree(work)

    def _resume_point(self) -> tuple[int, Path, Snapshot]:
        """Number of segments to build on, restart file and particles after them; what comes later is dropped."""
        whole = [segment for segment in self.published() if is_whole(segment, _TO_RESUME)]
        done = int(whole[-1].name[-5:]) if whole else 0
        for segment in self.folder.glob("segment-*"):
            if int(segment.name[-5:]) > done:
                shutil.rmtree(segment)
                self._whole = {(path, names) for path, names in self._whole if path != segment}
        for left in self.folder.glob(".segment-*.part"):  # of processes that were killed while a segment appeared
            shutil.rmtree(left, ignore_errors=True)
        if done:
            return done, whole[-1] / "restart", read_snapshot(whole[-1] / "snapshot.bin", DUMP_COLUMNS)
        verify(self.settled, "settled.restart", "settled.bin")
        return 0, self.settled / "settled.restart", read_snapshot(self.settled / "settled.bin", DUMP_COLUMNS)

    def _health(self, bed: Snapshot) -> FlowHealth:
        """The health to be kept by a run that starts from this bed."""
        settings = self.settings
        friction = self.plan.case.contact.wall.friction
        if self.plan.space is None:
            vessel = flow_limits(self.plan.simulated, settings, friction, self.plan.facets)
        else:
            vessel = space_limits(self.plan.space, settings, friction)
        catcher = settings.plate_z - self.deck.catcher_depth if settings.open_outlet else float("-inf")
        fallen = int((bed.position[:, 2] < catcher).sum())
        return FlowHealth(settings, self.plan.case, vessel, len(bed), fallen)

    def publish(self, number: int, sums: Sums, restart: Path, snapshot: Path, report: SegmentRecord) -> None:
        """Let a segment appear, and take restart file and snapshot from all but the newest.

        The snapshot after which this process resumed stays: the case that ended there may be about to read it.
        """
        with publishing(self._segment(number)) as folder:
            sums.save(folder / "sums.npz")
            restart.replace(folder / "restart")
            shutil.copyfile(snapshot, folder / "snapshot.bin")
            report.write(folder)
        if number > _KEPT_RESTARTS:
            old = self._segment(number - _KEPT_RESTARTS)
            (old / "restart").unlink(missing_ok=True)
            if number - _KEPT_RESTARTS != self._resumed:
                (old / "snapshot.bin").unlink(missing_ok=True)


class _Watch:
    """Follows a running production: checks its health, takes in snapshots, publishes segments."""

    def __init__(
        self,
        run: ProductionRun,
        process: Liggghts,
        done: int,
        health: FlowHealth,
        average: RunningAverage,
        progress: Progress,
    ) -> None:
        self.run, self.process, self.work = run, process, process.folder
        self.progress, self.average = progress, average
        self.settings, self.health = run.settings, health
        self.extra_sums = ExtraSums.of(run.plan)
        self.collector = Collector(run.plan.deposit_grid, "displacement", extras=self.extra_sums.extras)
        self.segment = done + 1
        self.next_step = done * self.settings.segment_steps
        self.start_step, self.started = self.next_step, time.monotonic()
        self.averaging = self.checking = 0.0
        self.overlap = self.reference_overlap = Overlap(0.0, 0.0, 0)
        self.count = 0
        self.disk = self.counted = 0
        self.recent: deque[Path] = deque()

    def look(self, status: Status) -> None:
        """Take in what has appeared since the last look, but not so much that the output goes unread."""
        for _ in range(_AT_ONCE):
            if self.average.reached or not self._take_snapshot(status):
                break
        ahead = (status.step - self.next_step) / self.settings.dump_every
        self.process.pause(ahead > (_AT_ONCE if self.process.paused else _MOST_AHEAD))
        check_space(self.work)
        self._report(status)

    def _report(self, status: Status) -> None:
        made = status.step - self.start_step
        if made <= 0:
            return
        wanted = self.settings.steps - status.step
        if self.average.convergence.missing is not None:
            missing = self.average.convergence.missing / self.run.plan.case.dem.replicas
            wanted = min(wanted, round(missing / self.settings.time_step))
        left = (time.monotonic() - self.started) * wanted / made
        self.progress.update(
            1 - wanted / max(1, status.step + wanted),
            f"{duration_text(left)} left, {self.average.convergence}, step {status.step}, "
            f"{status.particles} particles, {self.disk / 1e6:.0f} MB",
        )

    def finish(self, status: Status) -> None:
        """The last look, after LIGGGHTS has ended well."""
        while not self.average.reached and self._take_snapshot(status):
            pass
        if self.segment <= self.settings.segments and not self.average.reached:
            raise DataError(
                f"LIGGGHTS ended well, but snapshot.{self.next_step}.bin or its restart file is missing or cut short; "
                "look for a full disk, then run again: it resumes"
            )

    def _take_snapshot(self, status: Status) -> bool:
        """Add the next snapshot if it is there; at the end of a segment wait for its restart file as well."""
        path = self.work / f"snapshot.{self.next_step}.bin"
        if self.segment > self.settings.segments or not self._is_there(path, status):
            return False
        ends = self.next_step == self.segment * self.settings.segment_steps
        restart = self.work / f"segment.{self.segment}.restart"
        if ends and not restart.exists():
            return False
        begun = time.process_time()
        snapshot = read_snapshot(path, DUMP_COLUMNS)
        self.collector.add(self.next_step * self.settings.time_step, snapshot)
        beside = self.extra_sums.observed(self.work, self.next_step, snapshot)
        if self.next_step > self.start_step:  # the first belongs to the segment before
            self.collector.observe(beside)
        self.count = len(snapshot)
        if ends:
            plan = self.run.plan
            self.reference_overlap = reference_overlap(snapshot, plan.case, plan.outline, plan.grid)
        sums = self.collector.take() if ends else None
        averaged = time.process_time()
        self._check_health(snapshot, closely=ends)
        self.averaging += averaged - begun
        self.checking += time.process_time() - averaged
        if sums is not None:
            self._publish(sums, restart, path, status)
        self._keep(path, ends)
        self.next_step += self.settings.dump_every
        return True

    def _is_there(self, path: Path, status: Status) -> bool:
        """Whether a snapshot is wholly written; DataError if it never will be, for LIGGGHTS is far beyond it."""
        if path.exists() and is_complete(path):
            return True
        if status.step >= self.next_step + 2 * self.settings.dump_every:
            raise DataError(
                f"{path.name} is {'incomplete' if path.exists() else 'missing'} though LIGGGHTS has reached step "
                f"{status.step}; look for a full disk, then run again: it resumes"
            )
        return False

    def _check_health(self, snapshot: Snapshot, *, closely: bool) -> None:
        self.health.snapshot(snapshot)
        if closely:
            self.overlap = self.health.closely(snapshot)

    def _publish(self, sums: Sums, restart: Path, snapshot: Path, status: Status) -> None:
        report = SegmentRecord(
            particles=self.count,
            inserted=status.inserted,
            discharged=status.discharged,
            discharged_mass_kg=status.discharged_mass,
            counted_to_step=status.step,
            overlap=OverlapRecord(self.overlap.mean, self.overlap.p99),
            reference_overlap=self.reference_overlap.mean,
            averaging_seconds=self.averaging,
            checking_seconds=self.checking,
            wall_seconds=time.monotonic() - self.started,
            processor_seconds=self.process.processor_seconds(),
            ranks=self.settings.ranks,
        )
        check_space(self.run.folder, 3 * restart.stat().st_size)
        self.run.publish(self.segment, sums, restart, snapshot, report)
        self.segment += 1
        if self.segment >= 1.1 * self.counted:  # to look at every file each time would take longer and longer
            self.counted = self.segment
            self.disk = sum(path.stat().st_size for path in self.run.folder.rglob("*") if path.is_file())
        self.average.add(replace(sums, run=self.run.number))

    def _keep(self, path: Path, ends: bool) -> None:
        kept = self.run.plan.case.dem.keep_snapshots
        if kept == "all" or (kept == "thinned" and ends):
            folder = self.run.folder / "snapshots"
            folder.mkdir(exist_ok=True)
            path.replace(folder / path.name)
            return
        self.recent.append(path)
        if len(self.recent) > _KEPT_SNAPSHOTS:
            self.recent.popleft().unlink()


def limits_of(deck: Deck, plan: Plan, steps: int) -> Limits:
    """What a run of this plan may use."""
    settings = plan.dem
    return Limits.of(settings.particles, settings.ranks, steps, deck.thermo_every * settings.particles / RATE)


def copy_walls(walls: Path, folder: Path) -> None:
    """Copy the STL files of a vessel; DataError where a copy is not what was made."""
    for name, sha256 in read_manifest(walls).items():
        if name.endswith(".stl"):
            shutil.copyfile(walls / name, folder / name)
            if not is_unchanged(folder / name, sha256):
                raise DataError(f"{walls / name}: damaged; run again: it is made anew")
