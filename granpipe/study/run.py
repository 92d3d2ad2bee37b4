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
from granpipe.study.longer import lengthened
from granpipe.study.points import Study
from granpipe.study.reference import EarlierRun, check_cells
from granpipe.study.report import write_study
from granpipe.sweep.folder import Folder
from granpipe.sweep.points import plan_points
from granpipe.sweep.run import run_missing
from granpipe.sweep.status import PointStatus, marked, statuses

_TOO_SHORT = "too short for an error bar; average longer (dem.max_time)"


@dataclass(frozen=True)
class StudyRun:
    """What became of a study.

    Parameters
    ----------
    text : what was written, or how to follow the jobs
    problems : points that are not done or failed a quality gate
    complete : whether all that this run had to do is done
    """

    text: str
    problems: tuple[str, ...] = ()
    complete: bool = True


def run_study(
    study: Study,
    results: Path,
    other: Plan | None,
    cores: int,
    cluster: Path | None,
    progress: Progress,
    earlier: EarlierRun | None = None,
) -> StudyRun:
    """Run the points that are missing, then compare and report; on a cluster, submit them.

    Points that are too short for a field go on, by half of their time at the most.

    Parameters
    ----------
    results : folder of all results
    other : another case, whose run time is forecast
    cores : to keep busy here
    cluster : what each job requests from the cluster; None: run here
    earlier : the run that is the reference; None: the finest point

    Raises
    ------
    CaseError : a point cannot be run, or the reference has larger cells
    RunError : the case itself is not done: there is nothing to compare
    DataError, MeshError, SolveError : the comparison failed
    """
    if earlier is not None:
        check_cells(earlier, float(study.case.homogenize.cell))
    folder, points = plan_points(lengthened(study.sweep(), results, progress), results)
    while True:
        if not run_missing(folder, points, cores, cluster if points else None, progress):
            return StudyRun(f"follow it with: granpipe sweep status {folder.root}; then run this command again")
        before = folder.variants
        folder, left = plan_points(lengthened(study.sweep(), results, progress), results)
        points = [one for one in left if folder.variants[one.name] != before[one.name]]
        if not points:
            break
    files, missing = report_study(folder, other, progress, earlier)
    problems = [f"{one.name}: {one.text or one.state}" for one in missing]
    if names := marked(folder):
        where = f"granpipe sweep status {folder.root}"
        problems.insert(0, f"quality gates failed in {', '.join(names)}; see {where}")
    return StudyRun("\n".join(f"wrote {file}" for file in files), tuple(problems), not missing)


def report_study(
    folder: Folder, other: Plan | None, progress: Progress, earlier: EarlierRun | None = None
) -> tuple[list[Path], list[PointStatus]]:
    """Compare what is done and write the report; returns its files and the points that are not done.

    Raises
    ------
    RunError : the case itself is not done: there is nothing to compare
    CaseError, DataError, MeshError, SolveError : what a point left is damaged, or a solution failed
    """
    missing = [one for one in statuses(folder) if one.state != "done"]
    if any(one.name == next(iter(folder.variants)) for one in missing):
        raise RunError(f"the case itself is not done: {missing[0].text or missing[0].state}")
    case = load_case(folder.case)
    progress.stage("points")
    points = load_points(folder, progress)
    if points[0].too_short:
        raise RunError(f"the case itself is not done: {_TOO_SHORT}")
    missing += [PointStatus(point.name, "failed", _TOO_SHORT) for point in points if point.too_short]
    points = [point for point in points if not point.too_short]
    progress.stage("finite elements")
    solves = fluid_refinement(case, points[0].plan.grid)
    progress.stage("comparison")
    compared = earlier is not None or any(point.finished for point in points)
    found = Comparison(case, points, earlier).findings(progress) if compared else fluid_findings(solves)
    progress.stage("report")
    return write_study(folder, case, found, solves, other, missing), missing
