"""What a point of a sweep is doing: one small file per point, written by the process that runs it.

There is no database: a file appears by one rename, so a reader never sees half of one, and thousands are read in a
moment.
"""

from __future__ import annotations

import json
import os
import socket
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import psutil
from pydantic import Field

from granpipe.errors import DataError
from granpipe.system.files import write_whole
from granpipe.system.jsonfile import read_json

Phase = Literal["running", "done", "failed"]

INTERVAL = 3.0
"""A file is written no more often than this [s]; a new stage is noted at once."""


INTERRUPTED = "interrupted"
"""Error of a point that was stopped from outside, and may go on."""

JOB = "GRANPIPE_JOB"
"""Environment variable by which a batch script tells the job that it belongs to, as ``123_4``."""


@dataclass(frozen=True)
class State:
    """What the file of a point says.

    Parameters
    ----------
    key : of all that the point's result depends on, as far as it is known before it runs
    phase : running, done, or failed
    stage, fraction, text : where a running point is, as its progress says
    error : why it failed
    gates : quality gates that a finished point failed
    host, pid, job : who runs it; `job` as Slurm names it, empty elsewhere
    begun, updated : when it began and was last heard of [s since the epoch]
    """

    key: str
    phase: Phase
    stage: str
    fraction: float
    text: str
    error: str
    gates: tuple[str, ...]
    host: str
    pid: Annotated[int, Field(gt=0, lt=2**31)]
    job: str
    begun: float
    updated: float

    @classmethod
    def begins(cls, key: str) -> State:
        """Of a point that this process begins to run."""
        job, now = os.environ.get(JOB, ""), time.time()
        return cls(key, "running", "", 0.0, "", "", (), socket.gethostname(), os.getpid(), job, now, now)

    def save(self, path: Path) -> None:
        """Write the file, by one rename."""
        write_whole(path, json.dumps(asdict(self)))

    @classmethod
    def load(cls, path: Path) -> State | None:
        """What the file says; None where there is none, or a damaged one."""
        try:
            return read_json(path, cls)
        except DataError:
            return None

    def process_is_gone(self) -> bool:
        """Whether this machine can tell that the process has ended (another machine's it cannot)."""
        return self.host == socket.gethostname() and not psutil.pid_exists(self.pid)


class Recorder:
    """Progress that is kept in the file of a point."""

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._state = path, State.begins(key)
        self._state.save(path)

    def stage(self, name: str, detail: str = "") -> None:
        self._state = replace(self._state, stage=name, fraction=0.0, text=detail)
        self._write()

    def update(self, fraction: float, text: str) -> None:
        self._state = replace(self._state, fraction=fraction, text=text)
        if time.time() >= self._state.updated + INTERVAL:
            self._write()

    def note(self, text: str) -> None:
        """Notes are for the results and the log."""

    def done(self, gates: tuple[str, ...]) -> None:
        """The point is finished; `gates` are the quality gates that it failed."""
        self._state = replace(self._state, phase="done", fraction=1.0, text="", gates=gates)
        self._write()

    def failed(self, error: str) -> None:
        """The point cannot be finished, or was stopped."""
        self._state = replace(self._state, phase="failed", error=error)
        self._write()

    def _write(self) -> None:
        self._state = replace(self._state, updated=time.time())
        self._state.save(self._path)
