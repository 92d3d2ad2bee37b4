"""A sweep: many variants of one case, run here or on a cluster. What is done is not repeated.

Everything lies in ``results/<sweep>``: `case.yaml` and `points.json` (what is to be run), `points/` (the results
folders), `state/` (what each point is doing), `slurm/` (scripts and logs), and the table. The store of stages is that
of all results, so what points have in common is made once.

This module is about that folder alone: it imports little, so that one may often ask how a sweep stands.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from granpipe import __version__
from granpipe.errors import CaseError, DataError
from granpipe.sweep.inputs import SweepInput
from granpipe.sweep.state import State
from granpipe.sweep.variants import Variant
from granpipe.system.jsonfile import read_json
from granpipe.system.locks import Owner, holder, locked
from granpipe.system.manifest import is_whole
from granpipe.system.store import key_of
from granpipe.system.versions import library_versions

_VERSION = 1

_PATIENCE = 2.0
"""How long a lock is tried for [s]: `granpipe sweep status` may look at it for a moment."""


@dataclass(frozen=True)
class Folder:
    """The folder of a sweep; `new` is what is to be run where that is not in it yet."""

    root: Path
    new: SweepInput | None = None

    @property
    def name(self) -> str:
        """Name of the sweep."""
        return self.root.name

    @property
    def case(self) -> Path:
        """The case that is varied, as it was when the sweep was started."""
        return self.root / "case.yaml"

    @property
    def points(self) -> Path:
        """Where the results folders of the points lie."""
        return self.root / "points"

    @cached_property
    def inputs(self) -> SweepInput:
        """What is to be run.

        Raises
        ------
        DataError : the folder holds no sweep, or it is damaged
        """
        return self.new or SweepInput.read(self.root)

    @property
    def variants(self) -> dict[str, Variant]:
        """Every point by name, in order."""
        return self.inputs.variants

    @cached_property
    def _common(self) -> dict[str, Any]:
        digest = hashlib.sha256(self.inputs.text.encode()).hexdigest()
        return {"case": digest, "granpipe": __version__, "tools": library_versions()}

    def state_file(self, name: str) -> Path:
        """The file that tells what a point is doing."""
        return self.root / "state" / f"{name}.json"

    def state(self, name: str) -> State | None:
        """What a point is doing or did; None where that was another case than today's."""
        state = State.load(self.state_file(name))
        return state if state is not None and state.key == self.key(name) else None

    def key(self, name: str) -> str:
        """Key of what a point's results depend on, but for LIGGGHTS: it may be known on the compute nodes alone."""
        return key_of("point", _VERSION, self._common | {"changes": self.variants[name].changes})

    def is_done(self, name: str) -> bool:
        """Whether the results of a point are there."""
        state = self.state(name)
        return state is not None and state.phase == "done" and (self.points / name / "provenance.json").is_file()

    def is_whole(self, name: str) -> bool:
        """Whether a point is done, its results are its own, and every file of them is as it was written."""
        return self.is_done(name) and is_whole(self.points / name) and _case_in(self.points / name) == name

    @contextlib.contextmanager
    def started(self) -> Iterator[None]:
        """Held by a process that runs the points, or submits them; what is to be run is written down first.

        RunError where another process holds it: nothing is written then.
        """

        def busy(owner: Owner) -> str:
            return (
                f"{owner} is running {self.root} already, and nothing was changed; wait for it, or end it with "
                f"`granpipe sweep cancel {self.root}`"
            )

        with locked(self._lock, busy, patience=_PATIENCE):
            for path in (self.root / "state", self.points):
                path.mkdir(exist_ok=True)
            if self.new is not None:
                self.new.write(self.root)
            yield

    def owner(self) -> Owner | None:
        """The process that runs the points, or submits them; None where there is none."""
        return holder(self._lock)

    @property
    def _lock(self) -> Path:
        return self.root / f".sweep-{self.name}.lock"


@dataclass(frozen=True)
class _Record:
    case: str


def _case_in(results: Path) -> str:
    """The case that a results folder is of, which is named as its point."""
    try:
        return read_json(results / "provenance.json", _Record).case
    except DataError:
        return ""


def find_folder(path: Path, results: Path) -> Folder:
    """The folder of a sweep that has been started, by itself or by its sweep.yaml.

    Raises
    ------
    DataError : the folder holds no sweep
    CaseError : there is no such file or folder
    """
    from granpipe.sweep.file import sweep_name

    if not path.exists():
        raise CaseError("not found; give a sweep.yaml, or the folder of a sweep or study", place=str(path))
    folder = Folder(path if path.is_dir() else results / sweep_name(path))
    if not (folder.root / "points.json").is_file():
        raise DataError(f"{folder.root} holds no sweep; start it with `granpipe sweep run`")
    return folder
