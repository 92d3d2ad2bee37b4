"""The points of a sweep: each checked and planned before any is run, and run one after the other in a worker."""

from __future__ import annotations

import copy
import traceback
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from granpipe.case.reader import CaseFile, resolve
from granpipe.case.yamlfile import Places, parse_yaml
from granpipe.errors import CaseError, GranpipeError
from granpipe.pipeline.run import plan_case, run_case
from granpipe.progress import Both, Progress
from granpipe.sweep.file import Sweep
from granpipe.sweep.folder import Folder
from granpipe.sweep.state import INTERRUPTED, Recorder
from granpipe.sweep.variants import Variant
from granpipe.system.store import Store


@dataclass(frozen=True)
class Point:
    """A point that is to be run: `ranks` that its case gives (0: auto), and whether it has particles."""

    name: str
    ranks: int
    particles: bool


def point_case(folder: Folder, name: str, ranks: int | None = None, file: str = "case.yaml") -> CaseFile:
    """The case of a point, with `ranks` MPI ranks where they are given; CaseError, naming `file`, where it is wrong."""
    data, places = copy.deepcopy(_parsed(folder.inputs.text, file))
    more = {} if ranks is None else {"dem.ranks": str(ranks)}
    found = resolve(data, places, folder.variants[name].changes | {"name": name} | more)
    return replace(found, path=folder.case)


@cache
def _parsed(text: str, file: str) -> tuple[dict[str, Any], Places]:
    return parse_yaml(text, file)


def plan_points(sweep: Sweep, results: Path) -> tuple[Folder, list[Point]]:
    """The folder of a sweep, and the points whose results are missing, each checked and planned; nothing is written.

    Raises
    ------
    CaseError : a point is refused, or the folder holds the results of a case
    """
    folder = Folder(results / sweep.name, sweep.inputs)
    if (folder.root / "provenance.json").exists():
        raise CaseError(f"{folder.root} holds the results of a case; name the sweep otherwise", ("name",), "sweep")
    missing = [variant for variant in folder.variants.values() if not folder.is_whole(variant.name)]
    return folder, [_point(sweep, folder, variant) for variant in missing]


def _point(sweep: Sweep, folder: Folder, variant: Variant) -> Point:
    try:
        ranks = point_case(folder, variant.name, file=sweep.file).case.dem.ranks
        plan = plan_case(point_case(folder, variant.name, ranks=1, file=sweep.file), cores=1)
    except CaseError as error:
        raise sweep.explain(error, variant) from None
    return Point(variant.name, 0 if ranks == "auto" else ranks, bool(plan.runs))


def run_points(folder: Folder, names: Iterable[str], ranks: int, progress: Progress) -> None:
    """Run points one after the other in this process; what goes wrong is noted in the point's state, not raised."""
    for name in names:
        if name not in folder.variants or folder.is_whole(name):
            progress.note(f"{name}: done before, or no point of this sweep any more")
            continue
        progress.note(f"{name}: {folder.variants[name].changes}")
        recorder = Recorder(folder.state_file(name), folder.key(name))
        both = Both(progress, recorder)
        store = Store(folder.root.parent / ".store", waiting=partial(both.stage, "waiting"))
        try:
            outcome = run_case(point_case(folder, name, ranks), folder.points, both, store)
        except KeyboardInterrupt:
            recorder.failed(INTERRUPTED)
            raise
        except (GranpipeError, OSError) as error:
            recorder.failed(str(error))
            progress.note(f"{name}: {error}")
        except Exception as error:
            recorder.failed(f"{type(error).__name__}: {error}; this is a fault of granpipe, its log tells more")
            progress.note(traceback.format_exc())
        else:
            recorder.done(tuple(map(str, outcome.failed)))
