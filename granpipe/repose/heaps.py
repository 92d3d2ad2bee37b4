"""The heaps of a search: which are in the store, and running those that are not, side by side."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from granpipe.case.schema import Case
from granpipe.dem.run import Status
from granpipe.errors import DataError
from granpipe.progress import DONE_BEFORE, Progress, duration_text
from granpipe.repose.heap import DISCARDED, DROPS, Heap, Pair, make_heap, read_motion, read_slopes, run_heap
from granpipe.system.jsonfile import read_json, write_json
from granpipe.system.pool import Task, run_together
from granpipe.system.store import Store, evidence_kept, key_of

_VERSION = 1
_RECORD = "heap.json"

STEPS_SHARE = 0.7
"""Steps of a heap over the most that it may take; 0.5 to 0.8 were seen."""

Energy = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Slope = Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)]


@dataclass(frozen=True)
class Asked:
    """A heap that is asked for: friction and seed."""

    pair: Pair
    seed: int


@dataclass(frozen=True)
class HeapRecord:
    """What a heap has shown.

    Parameters
    ----------
    slopes : tan of the angle each time that it came to rest
    motion : mean kinetic energy then
    particles : when filled
    steps, seconds : of LIGGGHTS [s]
    """

    slopes: tuple[Slope, ...]
    motion: tuple[Energy, ...]
    particles: Annotated[int, Field(ge=1)]
    steps: Annotated[int, Field(ge=1)]
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]

    @property
    def slope(self) -> float:
        """Mean of those that do not bear the filling."""
        return float(np.mean(self.slopes[DISCARDED:]))

    @property
    def scatter(self) -> float:
        """Standard deviation of one slope about the mean."""
        return float(np.std(self.slopes[DISCARDED:], ddof=1))


class Heaps:
    """Heaps of one material, kept in a store.

    Parameters
    ----------
    liggghts : version of the program
    """

    def __init__(self, case: Case, store: Store, liggghts: str, cores: int, progress: Progress) -> None:
        self._case, self._store, self._liggghts = case, store, liggghts
        self._cores, self._progress = cores, progress
        self._made: dict[Asked, Heap] = {}

    def missing(self, asked: Sequence[Asked]) -> list[Asked]:
        """Those that are not in the store."""
        return [one for one in asked if not self._store.has("heap", self._key(one))]

    def particle_steps(self, asked: Sequence[Asked]) -> float:
        """Expected of LIGGGHTS for the missing ones."""
        return sum(self._heap(one).particles * STEPS_SHARE * self._heap(one).steps for one in self.missing(asked))

    def run(self, asked: Sequence[Asked], name: str) -> list[HeapRecord]:
        """Run what is missing, and read all.

        Raises
        ------
        RunError : LIGGGHTS failed, or another process is at work on one of the heaps
        DataError : a heap is damaged
        """
        missing = self.missing(asked)
        self._progress.stage(name, "" if missing else DONE_BEFORE)
        watch = _Watch(len(missing), self._progress)
        run_together((Task(f"heap {one}", 1, self._work(one, watch)) for one in missing), self._cores)
        return [self._read(one) for one in asked]

    def _work(self, one: Asked, watch: _Watch) -> Generator[None, None, None]:
        key, heap = self._key(one), self._heap(one)

        def fill(folder: Path) -> Iterator[None]:
            begun, status = time.monotonic(), Status()
            with evidence_kept(folder, self._store.folder("evidence", key)):
                for status in run_heap(heap, folder):
                    watch.at(one, status.step / heap.steps)
                    yield
                slopes, motion = tuple(read_slopes(folder)), tuple(read_motion(folder))
            seconds = time.monotonic() - begun
            write_json(folder / _RECORD, asdict(HeapRecord(slopes, motion, heap.particles, status.step, seconds)))
            for path in [*folder.glob("rest.*.bin"), *folder.glob("*.stl"), folder / "bed.txt"]:
                path.unlink()

        yield from self._store.make_in_steps("heap", key, fill)
        watch.at(one, 1.0)

    def _read(self, one: Asked) -> HeapRecord:
        folder = self._store.folder("heap", self._key(one))
        record = read_json(folder / _RECORD, HeapRecord)
        if not len(record.slopes) == len(record.motion) == DROPS:
            raise DataError(f"{folder / _RECORD}: not {DROPS} slopes and energies; delete {folder} and run again")
        return record

    def _heap(self, one: Asked) -> Heap:
        if one not in self._made:
            self._made[one] = make_heap(self._case, one.pair, one.seed)
        return self._made[one]

    def _key(self, one: Asked) -> str:
        heap = self._heap(one)
        return key_of("heap", _VERSION, {"deck": heap.deck, "bed": heap.bed, "liggghts": self._liggghts})


class _Watch:
    """How far a number of heaps are, and how long the rest may take."""

    def __init__(self, number: int, progress: Progress) -> None:
        self._number, self._progress, self._begun = number, progress, time.monotonic()
        self._shares: dict[Asked, float] = {}

    def at(self, one: Asked, share: float) -> None:
        self._shares[one] = share
        done = sum(share == 1.0 for share in self._shares.values())
        fraction = sum(1.0 if share == 1.0 else min(0.95, share / STEPS_SHARE) for share in self._shares.values())
        fraction /= self._number
        left = (time.monotonic() - self._begun) * (1 - fraction) / max(fraction, 1e-9)
        rest = f", about {duration_text(left)} left" if fraction > 0.05 else ""
        self._progress.update(fraction, f"{done} of {self._number} heaps{rest}")
