"""`granpipe study`: the points of a study run by the sweep's own machinery, then compared and reported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granpipe.case.reader import load_case
from granpipe.errors import RunError
from granpipe.planning.plan import Plan
from granpipe.progress import Progress
from granpipe.study.findings import Comparison, load_points
from granpipe.study.fluid import fluid_findings, fluid_refinement
from granpipe.study.points import Study
from granpipe.study.report import write_study
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import Point, plan_points
from granpipe.sweep.status import PointStatus, statuses


@dataclass(frozen=True)
class Prepared:
    """A study checked and planned: its folder, and the points that are still to be run."""

    folder: Folder
    points: list[Point]


def prepare_study(study: Study, results: Path) -> Prepared:
    """Check what is to be run; nothing is written before it is started."""
    return Prepared(*plan_points(study.sweep(), results))


def report_study(folder: Folder, other: Plan | None, progress: Progress) -> tuple[list[Path], list[PointStatus]]:
    """Compare what is done and write the report; returns its files and the points that are not done.

    RunError where the case itself is not done: there is nothing to compare then.
    """
    missing = [one for one in statuses(folder) if one.state != "done"]
    if any(one.name == next(iter(folder.variants)) for one in missing):
        raise RunError(f"the case itself is not done: {missing[0].text or missing[0].state}")
    case = load_case(folder.case)
    progress.stage("points")
    points = load_points(folder, progress)
    progress.stage("finite elements")
    solves = fluid_refinement(case, points[0].plan.grid)
    progress.stage("comparison")
    particles = any(point.finished for point in points)
    found = Comparison(case, points).findings(progress) if particles else fluid_findings(solves)
    progress.stage("report")
    return write_study(folder, case, found, solves, other, missing), missing
