"""A sweep: many variants of one case, run here or on a cluster. What is done is not repeated.

Everything lies in ``results/<sweep>``: `case.yaml` and `points.json` (what is to be run), `points/` (the results
folders), `state/` (what each point is doing), `slurm/` (scripts and logs), and the table. The store of stages is that
of all results, so what points have in common is made once.
"""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import os
import socket
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from granpipe import __version__
from granpipe.case import CaseFile, resolve
from granpipe.errors import CaseError, DataError, GranpipeError
from granpipe.jsonfile import read_json
from granpipe.pipeline import plan_case, run_case
from granpipe.progress import Both, Progress
from granpipe.store import Store, key_of
from granpipe.study.state import Recorder, State
from granpipe.study.variants import Variant
from granpipe.sweepfile import Sweep
from granpipe.tools import library_versions
from granpipe.yamlfile import Places, parse_yaml, text_of

_VERSION = 1


@dataclass(frozen=True)
class Point:
    """A point that is to be run: `ranks` that its case gives (0: auto), and whether it has particles."""

    name: str
    ranks: int
    particles: bool


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
    def _text(self) -> str:
        return self.case.read_text(encoding="utf-8")

    @cached_property
    def _parsed(self) -> tuple[dict[str, Any], Places]:
        return parse_yaml(self._text, self.case.name)

    @cached_property
    def _common(self) -> dict[str, Any]:
        digest = hashlib.sha256(self._text.encode()).hexdigest()
        return {"case": digest, "granpipe": __version__, "tools": library_versions()}

    def file(self, name: str, **changes: str) -> CaseFile:
        """The case of a point, with further changes of the keys of `dem`; CaseError where it is wrong."""
        data, places = copy.deepcopy(self._parsed)
        more = {f"dem.{key}": text for key, text in changes.items()}
        return resolve(data, places, self.variants[name].changes | {"name": name} | more)

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
    from granpipe.sweepfile import read_sweep

    folder = Folder(path if path.is_dir() else results / read_sweep(path).name)
    if not (folder.root / "points.json").is_file():
        raise DataError(f"{folder.root} holds no sweep; start it with `granpipe sweep`")
    return folder


def prepare(sweep: Sweep, results: Path) -> tuple[Folder, list[Point]]:
    """Write down what is to be run; return the points whose results are missing, each checked and planned."""
    folder = Folder(results / sweep.name)
    if (folder.root / "provenance.json").exists():
        raise CaseError(f"{folder.root} holds the results of a case; name the sweep otherwise", ("name",), "sweep")
    for path in (folder.root / "state", folder.points):
        path.mkdir(parents=True, exist_ok=True)
    plan = {
        "axes": sweep.axes,
        "chart": sweep.chart,
        "table": sweep.table,
        "points": [asdict(variant) for variant in sweep.variants],
    }
    replace_text(folder.case, text_of(sweep.case))
    replace_text(folder.root / "points.json", json.dumps(plan, indent=1, ensure_ascii=False))
    missing = [variant for variant in sweep.variants if not folder.is_done(variant.name)]
    return folder, [_point(sweep, folder, variant) for variant in missing]


def _point(sweep: Sweep, folder: Folder, variant: Variant) -> Point:
    try:
        ranks = folder.file(variant.name).case.dem.ranks
        plan = plan_case(
            folder.file(variant.name, ranks="1")
        )  # they may be too many for this machine, but run elsewhere
    except CaseError as error:
        raise sweep.explain(error, variant) from None
    return Point(variant.name, 0 if ranks == "auto" else ranks, plan.settings is not None or bool(plan.parts))


def replace_text(path: Path, text: str) -> None:
    """Write a file by one rename."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_text(text, encoding="utf-8")
    aside.replace(path)


def run_points(folder: Folder, names: Iterable[str], ranks: int, progress: Progress) -> None:
    """Run points one after the other in this process; what goes wrong is noted in the point's state, not raised."""
    for name in names:
        if name not in folder.variants or folder.is_done(name):
            progress.note(f"{name}: done before, or no point of this sweep any more")
            continue
        progress.note(f"{name}: {folder.variants[name].changes}")
        recorder = Recorder(folder.state_file(name), folder.key(name))
        both = Both(progress, recorder)
        store = Store(folder.root.parent / ".store", waiting=partial(both.stage, "waiting"))
        try:
            outcome = run_case(folder.file(name, ranks=str(ranks)), folder.points, both, store)
        except KeyboardInterrupt:
            recorder.failed("interrupted")
            raise
        except (GranpipeError, OSError) as error:
            recorder.failed(str(error))
            progress.note(f"{name}: {error}")
        except Exception as error:
            recorder.failed(f"{type(error).__name__}: {error}; this is a fault of granpipe, its log tells more")
            progress.note(traceback.format_exc())
        else:
            recorder.done(tuple(map(str, outcome.failed)))
