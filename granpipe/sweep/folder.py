"""A sweep: many variants of one case, run here or on a cluster. What is done is not repeated.

Everything lies in ``results/<sweep>``: `case.yaml` and `points.json` (what is to be run), `points/` (the results
folders), `state/` (what each point is doing), `slurm/` (scripts and logs), and the table. The store of stages is that
of all results, so what points have in common is made once.

This module is about that folder alone: it imports little, so that one may often ask how a sweep stands.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from granpipe import __version__
from granpipe.errors import DataError
from granpipe.jsonfile import read_json
from granpipe.store import Store, key_of
from granpipe.sweep.state import State
from granpipe.sweep.variants import Variant
from granpipe.tools import library_versions

_VERSION = 1


@dataclass(frozen=True)
class Folder:
    """The folder of a sweep."""

    root: Path

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
    def plan(self) -> dict[str, Any]:
        """`points.json`: axes, chart, table, and every point with its changes."""
        return read_json(self.root / "points.json")

    @cached_property
    def variants(self) -> dict[str, Variant]:
        """Every point by name, in order."""
        return {point["name"]: Variant(**point) for point in self.plan["points"]}

    @cached_property
    def text(self) -> str:
        """Text of the case that is varied."""
        return self.case.read_text(encoding="utf-8")

    @cached_property
    def _common(self) -> dict[str, Any]:
        digest = hashlib.sha256(self.text.encode()).hexdigest()
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

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Held by a process that runs the points, or submits them; `running.json` says where it is."""
        with Store(self.root).lock("sweep", self.name):
            yield

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """While the points are run by this process."""
        with self.lock():
            replace_text(self.root / "running.json", json.dumps({"host": socket.gethostname(), "pid": os.getpid()}))
            yield


def find_folder(path: Path, results: Path) -> Folder:
    """The folder of a sweep that has been started, by itself or by its sweep.yaml."""
    from granpipe.sweep.file import read_sweep

    folder = Folder(path if path.is_dir() else results / read_sweep(path).name)
    if not (folder.root / "points.json").is_file():
        raise DataError(f"{folder.root} holds no sweep; start it with `granpipe sweep`")
    return folder


def replace_text(path: Path, text: str) -> None:
    """Write a file by one rename."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_text(text, encoding="utf-8")
    aside.replace(path)
