"""Points of a study that ended without a field, for too little time, go on for a while: their production continues.

Flow through a throat a few diameters wide comes in bursts. A run whose end falls into one has no field, and a short
while later it has; a study whose own case has none could compare nothing. A field without an error bar is no better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from granpipe.errors import CaseError, DataError
from granpipe.pipeline.failure_report import failure_folder
from granpipe.pipeline.gates import SEGMENTS
from granpipe.pipeline.provenance import Provenance
from granpipe.progress import Progress
from granpipe.sweep.file import Sweep
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import point_case
from granpipe.sweep.state import INTERRUPTED
from granpipe.sweep.variants import Variant
from granpipe.system.jsonfile import read_json

STEP = 1 / 8
"""By how much of the time that was asked for a point goes on at once."""

MOST = 1 / 2
"""By how much in all."""

_TIME = "dem.max_time"


@dataclass(frozen=True)
class _Failure:
    reason: str
    cause: str


def lengthened(sweep: Sweep, results: Path, progress: Progress) -> Sweep:
    """The points of a study, a `dem.max_time` a step longer where it was too short for a field.

    What was lengthened before, by the study's folder in `results`, stays so.
    """
    folder = Folder(results / sweep.name)
    try:
        before = folder.inputs
    except DataError:  # nothing has been run
        return sweep
    if before.text != sweep.inputs.text:
        return sweep
    asked = Folder(folder.root, sweep.inputs)
    variants = {name: _longer(folder, asked, name, progress) for name in asked.variants}
    return replace(sweep, inputs=replace(sweep.inputs, variants=variants))


def _longer(folder: Folder, asked: Folder, name: str, progress: Progress) -> Variant:
    """A point as it is to be run, by how it stands in the folder."""
    wanted, last = asked.variants[name], folder.variants.get(name)
    if last is None or _without_time(last.changes) != _without_time(wanted.changes):
        return wanted
    least, time = _time(asked, name), _time(folder, name)
    if least is None or time is None or not least <= time <= (1 + MOST) * least * (1 + 1e-6):
        return wanted
    after = time + STEP * least
    if after > (1 + MOST) * least * (1 + 1e-6) or not _too_short(folder, name):
        return last if time > least else wanted
    most = (1 + MOST) * least
    progress.note(f"{name}: no error bar after {time:.4g} s, goes on to {after:.4g} s ({most:.4g} s at most)")
    return Variant(name, wanted.changes | {_TIME: f"{after:.6g} s"})


def _without_time(changes: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in changes.items() if key != _TIME}


def _time(folder: Folder, name: str) -> float | None:
    """`dem.max_time` of a point [s]; None where it is chosen by granpipe, or no time at all."""
    try:
        time = point_case(folder, name).case.dem.max_time
    except CaseError:
        return None
    return None if time == "auto" else float(time)


def _too_short(folder: Folder, name: str) -> bool:
    """Whether a point, as it is in the folder, lacks a field or its error bar for nothing but its length."""
    state = folder.state(name)
    if folder.is_done(name):
        averaged = Provenance.read(folder.points / name).figures.get("blocks")
        return averaged is not None and not SEGMENTS.gate(averaged).passed
    if state is None or state.phase != "failed" or state.error == INTERRUPTED:
        return False
    try:
        failure = read_json(failure_folder(folder.points / name) / "failure.json", _Failure)
    except DataError:
        return False
    return failure.cause == "short" and failure.reason in state.error  # of this run, not of one before
