"""The whole run: case → plan → stages → results."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import psutil

from granpipe.case.reader import CaseFile
from granpipe.errors import CaseError, RunError
from granpipe.field import Box
from granpipe.pipeline.context import Context
from granpipe.pipeline.failure import NoFieldError
from granpipe.pipeline.failure_report import failure_folder, withdraw, write_failure
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.model_result import ModelResult
from granpipe.pipeline.results import case_origin, check_folder, is_current, results_key, write_results
from granpipe.planning.forecast import forecast
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Model, Plan
from granpipe.planning.space import sums_memory
from granpipe.progress import Progress, counted, duration_text
from granpipe.system.cores import free_cores, usable_cores
from granpipe.system.files import digest
from granpipe.system.locks import Owner, locked
from granpipe.system.publish import lock_file
from granpipe.system.rates import known_rates
from granpipe.system.store import Store
from granpipe.system.surroundings import require_memory, require_style
from granpipe.system.versions import library_versions, program_versions


@dataclass(frozen=True)
class Outcome:
    """What a run ended with: the results folder and the gates that failed; `made` is False where nothing was to do."""

    folder: Path
    failed: tuple[Gate, ...] = ()
    made: bool = True


def plan_case(file: CaseFile, cores: int) -> Plan:
    """The plan of a case for so many cores; a CaseError says where in the file."""
    try:
        return make_plan(file.case, cores)
    except CaseError as error:
        raise file.places.explain(error) from None


def run_case(
    file: CaseFile,
    results: Path,
    progress: Progress,
    store: Store | None = None,
    agreed: Callable[[float], bool] = lambda _: True,
) -> Outcome:
    """Run a case into ``results/<name>``; stages that are done are not repeated.

    Parameters
    ----------
    store : holds the stages; ``results/.store`` does unless given
    agreed : is asked with the forecast [s] whether the work is to begin

    Raises
    ------
    RunError : it is not, or a program failed
    """
    begun = time.monotonic()
    for path in filter(None, (file.path, results)):
        _require_text(path)
    folder, store, cores = results / file.case.name, store or Store(results / ".store"), usable_cores()
    plan = plan_case(file, cores)
    require_memory()
    require_style()
    with store.in_use(), _alone(folder, store):
        return _run(file, plan, folder, Context(store, _versions(file, plan, store), progress, cores), begun, agreed)


def _require_text(path: Path) -> None:
    """RunError for a path that is no text: it could not stand in records, and gmsh could not open it."""
    try:
        os.path.abspath(path).encode()  # noqa: PTH100  # what a link is called does not matter
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode(errors="replace")
        raise RunError(f"{shown}: its path is not UTF-8 text; rename it") from None


def _alone(folder: Path, store: Store) -> AbstractContextManager[None]:
    """Keep other processes off a results folder."""

    def busy(owner: Owner) -> str:
        return f"another granpipe ({owner}) is running {folder.name} into {folder}; wait for it, or stop it"

    return locked(lock_file(folder), busy, store.waiting)


def _versions(file: CaseFile, plan: Plan, store: Store) -> dict[str, str]:
    """What the results depend on beside the case."""
    versions = library_versions()
    if plan.runs:
        versions |= program_versions(store.root / "programs.json")
    if (known := file.case.fluid.known_field) is not None and plan.model == "hybrid":
        versions["known field"] = _digest(file, known)
    return versions


def _run(
    file: CaseFile, plan: Plan, folder: Path, context: Context, begun: float, agreed: Callable[[float], bool]
) -> Outcome:
    key = results_key(file.case, context.versions)
    check_folder(folder, file)
    if (failed := is_current(folder, key)) is not None:
        return Outcome(folder, failed, made=False)
    for warning in plan.warnings:
        context.progress.note(f"note: {warning}")
    plan = _beside_others(file, plan, context)
    seconds = forecast(plan, known_rates())
    if plan.runs:
        context.progress.note(
            f"forecast: about {duration_text(seconds)}, less where stages are done or the error is met"
        )
    if not agreed(seconds):
        raise RunError("not begun; a larger dem.coarse_grain_factor or a shorter dem.max_time takes less time")
    try:
        if plan.runs:
            _require_sums(plan)
            _require_cores(plan, context.cores)
            _require_programs(plan)
            plan = _with_checked_stiffness(plan, context)
        made = _ROUTES[plan.model](plan, context)
    except CaseError as error:
        raise file.places.explain(error) from None
    except NoFieldError as error:
        context.progress.stage("report", "there is no field")
        provenance = {"key": key, "versions": context.versions, "origin": asdict(case_origin(file))}
        error.kept = write_failure(folder, plan, error.story, provenance, context.progress.note)
        raise
    withdraw(failure_folder(folder), context.progress.note)
    if file.case.homogenize.fields:
        made = _with_derived(made, file.case.homogenize.fields)
    made = replace(made, notes=(*file.library, *made.notes))
    for note in made.notes:
        context.progress.note(f"note: {note}")
    context.progress.stage("results")
    provenance = {"key": key, "versions": context.versions, "origin": asdict(case_origin(file))}
    failed = write_results(folder, plan, made, provenance, begun, context.progress.note)
    return Outcome(folder, failed)


def _with_derived(made: ModelResult, wanted: Sequence[str]) -> ModelResult:
    """The field with what else the case asks for and the field alone can tell."""
    from granpipe.pipeline.extra_fields import with_derived

    field, figures = with_derived(made.field, wanted)
    return replace(made, field=field, figures=made.figures | figures)


def _digest(file: CaseFile, known: str) -> str:
    try:
        return digest(Path(known))
    except OSError as error:
        message = f"{known} cannot be read ({error.strerror}); give the path of a field.npz"
        raise file.places.explain(CaseError(message, ("fluid", "known_field"))) from None


def _with_checked_stiffness(plan: Plan, context: Context) -> Plan:
    from granpipe.pipeline.stiffness import with_checked_stiffness

    return with_checked_stiffness(plan, context)


def _dem(plan: Plan, context: Context) -> ModelResult:
    from granpipe.pipeline.dem_field import simulated_field

    return simulated_field(plan, context)


def _fluid(plan: Plan, context: Context) -> ModelResult:
    if plan.friction is not None:
        from granpipe.pipeline.frictional_field import frictional_field

        return frictional_field(plan, plan.friction)
    from granpipe.pipeline.fluid_field import fluid_field

    context.progress.stage("fluid")
    return fluid_field(plan)


def _hybrid(plan: Plan, context: Context) -> ModelResult:
    from granpipe.pipeline.hybrid_field import hybrid_field

    return hybrid_field(plan, context)


def _beside_others(file: CaseFile, plan: Plan, context: Context) -> Plan:
    """The plan with fewer ranks where other programs keep cores busy: ranks wait for the one that runs the least."""
    ranks = max((run.dem.ranks for run in plan.runs), default=1)
    if file.case.dem.ranks != "auto" or ranks == 1 or (free := free_cores()) >= context.cores:
        return plan
    made = plan_case(file, free)
    if (fewer := max(run.dem.ranks for run in made.runs)) < ranks:
        context.progress.note(
            f"note: other programs keep cores busy: {counted(fewer, 'rank')} in place of {ranks}, which "
            "would wait for each other; dem.ranks decides it"
        )
    return made


def _require_cores(plan: Plan, cores: int) -> None:
    """CaseError where the case asks for more ranks than there are cores: two on one core wait for each other."""
    if (wanted := max(run.dem.ranks for run in plan.runs)) > cores:
        raise CaseError(f"{wanted} ranks, but this machine has {counted(cores, 'core')}", ("dem", "ranks"))


def _require_sums(plan: Plan) -> None:
    """CaseError where the sums of a run in space take more memory than is free."""
    if plan.space is None or not isinstance(plan.grid, Box):
        return
    needed, free = sums_memory(plan.grid, plan.dem.segments), psutil.virtual_memory().available
    if needed > free:
        raise CaseError(
            f"the sums of {plan.dem.segments} segments on {' × '.join(map(str, plan.grid.shape))} cells take "
            f"{needed / 1e9:.3g} GB of memory, of which {free / 1e9:.3g} GB are free: give a larger cell than "
            f"{plan.grid.cell:.3g} m",
            ("homogenize", "cell"),
        )


def _require_programs(plan: Plan) -> None:
    """Refuse before the long work what would fail after it: without EGL or a display VTK ends the whole process."""
    from granpipe.system.doctor import require

    needed = ["gmsh library"]
    if any(run.dem.ranks > 1 for run in plan.runs):
        needed.append("mpirun")
    if "vessel" in plan.case.figures and not os.environ.get("DISPLAY"):
        needed.append("EGL library")
    require(*needed)


_ROUTES: dict[Model, Callable[[Plan, Context], ModelResult]] = {
    "dem": _dem,
    "fluid": _fluid,
    "hybrid": _hybrid,
}
