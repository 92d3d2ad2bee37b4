"""Writes the results folder of a case. Files that the user puts there are kept."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

from granpipe import __version__
from granpipe.case.reader import CaseFile
from granpipe.case.schema import Case
from granpipe.dem.decision import Decision
from granpipe.errors import DataError, RunError
from granpipe.export.run_report import write_run_report
from granpipe.pipeline.exports import write_exports, write_space_exports
from granpipe.pipeline.gates import Gate
from granpipe.pipeline.model_result import ModelResult
from granpipe.pipeline.production import Production
from granpipe.pipeline.provenance import Identity, Origin
from granpipe.pipeline.summary import field_summary, space_summary
from granpipe.planning.forecast import forecast
from granpipe.planning.plan import Plan
from granpipe.system.jsonfile import write_json
from granpipe.system.manifest import has_manifest, is_whole
from granpipe.system.publish import renewing
from granpipe.system.rates import known_rates
from granpipe.system.store import key_of

_VERSION = 2

MOST_FRAMES = 60
"""Of an animation."""


def results_key(case: Case, versions: Mapping[str, str]) -> str:
    """Key of all that the results depend on: the case but for what only changes how it is run, and the versions."""
    part = _data(case, {"dem": {"ranks", "keep_snapshots"}, "vessel": {"file"}})
    return key_of("results", _VERSION, {"case": part, "granpipe": __version__, "tools": versions})


def _data(case: Case, without: dict[str, Any]) -> dict[str, Any]:
    """A case as plain data; the key of a vessel in space only where it has one."""
    data = case.model_dump(mode="json", exclude=without)
    return data if case.vessel is not None else {name: value for name, value in data.items() if name != "vessel"}


def is_current(folder: Path, key: str) -> tuple[Gate, ...] | None:
    """The failed gates of results that are whole and belong to this key; None if they are to be made."""
    try:
        made = Identity.read(folder)
    except DataError:
        return None
    current = made.key == key and is_whole(folder)
    return tuple(gate for gate in made.quality if not gate.passed) if current else None


def check_folder(folder: Path, file: CaseFile) -> None:
    """Make sure that the results of a case may go into a folder; asked before the work and not after it.

    Raises
    ------
    RunError : it holds something else, or the results of another case, or cannot be written
    """
    try:
        names = {path.name for path in folder.iterdir()} if folder.exists() else set()
    except NotADirectoryError:
        raise RunError(f"{folder} is a file; move it away or choose another --results") from None
    unfinished = all(name.startswith(".granpipe.") for name in names)
    if not unfinished and "provenance.json" not in names and not has_manifest(folder):
        raise RunError(f"{folder} exists and is not granpipe's; move it away or choose another --results")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise RunError(f"{there} is a file; move it away or choose another --results")
    if not os.access(there, os.W_OK):
        raise RunError(f"{there}: not writable; choose another folder with --results")
    if (other := _other_case(folder, file)) is not None:
        raise RunError(
            f"{folder} holds the results of another case of this name, {other}; change `name` in {file.places.file}, "
            f"choose another --results, or move {folder} away"
        )


def case_origin(file: CaseFile) -> Origin:
    """What tells a case from another one of the same name: where its file is, its outline, and all of it."""
    case = _data(file.case, {})
    return Origin(
        file=str(file.path.resolve()) if file.path else "",
        outline=key_of("outline", 1, case.get("vessel", case["outline"])),
        case=key_of("case", 1, case),
    )


def _other_case(folder: Path, file: CaseFile) -> str | None:
    """The file of the other case whose results are in a folder; None where they are of this one.

    A case whose keys are changed goes on, and so does one whose file was copied, or moved while its outline stays.
    """
    try:
        there = Identity.read(folder).origin
    except DataError:
        return None
    ours = case_origin(file)
    if there.case == ours.case:
        return None
    elsewhere = ours.file and "\0" not in there.file and Path(there.file).is_file()
    if there.file == ours.file != "" or (there.outline == ours.outline and not elsewhere):
        return None
    return there.file or "with another outline"


def write_results(
    folder: Path,
    plan: Plan,
    made: ModelResult,
    provenance: Mapping[str, Any],
    begun: float,
    note: Callable[[str], None],
) -> tuple[Gate, ...]:
    """Write everything; return the gates that failed.

    Parameters
    ----------
    provenance : what is known of the run beforehand: key, versions, origin of the case
    begun : when it began [s, monotonic]
    note : is told which files were kept aside because somebody had changed them
    """
    with renewing(folder, note) as aside:
        (aside / "case.yaml").write_text(plan.case.to_yaml())
        write_json(aside / "plan.json", plan_summary(plan))
        made.field.save(aside / "field.npz")
        if plan.space is None:
            write_exports(made.field, plan.case, aside)
        else:
            write_space_exports(made.field, plan.case, aside)
        _fluid_mesh(aside, plan, made)
        _figures(aside, plan, made, note)
        write_logs(aside, made.productions)
        record = {
            "case": plan.case.name,
            **made_now(),
            **provenance,
            "wall_seconds": round(time.monotonic() - begun, 2),
            "forecast_seconds": round(forecast(plan, known_rates()), 2),
            "field": (field_summary if plan.space is None else space_summary)(made.field, plan.case),
            **_record(plan if plan.model == "dem" else None, made),
            "submodels": {name: _record(plan.submodel(name), submodel) for name, submodel in made.submodels.items()},
        }
        write_json(aside / "provenance.json", record)
        write_run_report(aside)
    return tuple(gate for gate in made.gates if not gate.passed)


def made_now() -> dict[str, str]:
    """When and by which version results are made."""
    return {"made": datetime.now().astimezone().isoformat(timespec="seconds"), "granpipe": __version__}


def _record(plan: Plan | None, made: ModelResult) -> dict[str, Any]:
    """What a run has measured; `plan` is that of its DEM run, None where it has none of its own."""
    seeds = [] if plan is None else [plan.case.dem.seed + replica for replica in range(plan.case.dem.replicas)]
    return {
        "seed": seeds[0] if seeds else None,
        "seeds": seeds,
        "figures": made.figures,
        "quality": [gate.as_dict() for gate in made.gates],
        "notes": list(made.notes),
    }


def _plain(decisions: Iterable[Decision]) -> list[dict[str, str]]:
    return [{"name": c.name, "value": c.value, "criterion": c.criterion} for c in decisions]


def plan_summary(plan: Plan) -> dict[str, Any]:
    """The plan as plain data."""
    summary: dict[str, Any] = {
        "model": plan.model,
        "stages": [{"stage": stage.name, "reason": stage.reason} for stage in plan.stages],
        "left_out": [{"what": stage.name, "reason": stage.reason} for stage in plan.left_out],
        "grid": {"cells": plan.grid.shape, "cell_m": plan.grid.cell},
        "warnings": plan.warnings,
        "outside_the_range": plan.breaches,
        "wall_factors": _plain(plan.wall_factors),
    }
    if plan.settings is not None:
        dem = plan.settings
        summary["dem"] = {
            "decisions": _plain(plan.decisions),
            "radii_m": dem.classes.radius.tolist(),
            "number_shares": dem.classes.number_share.tolist(),
            "mass_factor": dem.classes.mass_factor,
            "time_step_s": dem.time_step,
            "youngs_modulus_pa": dem.youngs_modulus,
            "plate_speed_m_per_s": dem.plate_speed,
            "start_speed_m_per_s": dem.start_speed if dem.start_segments else dem.plate_speed,
            "averaged_from_s_at_the_earliest": dem.average_from,
            "production_s": dem.duration,
            "steps": dem.steps,
            "segments": dem.segments,
            "particles": dem.particles,
            "ranks": dem.ranks,
            "particle_steps": plan.particle_steps,
            "seconds": plan.seconds,
            "disk_bytes": plan.disk_bytes,
        }
    summary["submodels"] = {
        span.name: {"z_m": [span.cut_top, span.cut_bottom], **plan_summary(submodel)}
        for span, submodel in plan.submodels
    }
    return summary


def _fluid_mesh(folder: Path, plan: Plan, made: ModelResult) -> None:
    if made.solution is None or "vtk" not in plan.case.export:
        return
    from granpipe.export.vtk import write_fluid_vtu

    fluid = made.solution
    write_fluid_vtu(fluid.mesh.points, fluid.mesh.triangles, fluid.u, fluid.w, fluid.psi, folder / "fluid.vtu")


def _figures(folder: Path, plan: Plan, made: ModelResult, note: Callable[[str], None]) -> None:
    outline = plan.outline
    if plan.case.figures:
        (folder / "figures").mkdir()
    if "rz" in plan.case.figures and plan.space is not None:
        from granpipe.export.space_pictures import write_space_figure

        write_space_figure(made.field, plan.case.name, folder / "figures" / "space_w.png")
    elif "rz" in plan.case.figures:
        from granpipe.export.pictures import rz_figures
        from granpipe.export.profiles import profile_figures, section_profiles

        obstacles = {name: polygon.tolist() for name, polygon in outline.obstacles.items()}
        levels = plan.case.outline.levels
        rz_figures(
            made.field,
            outline.wall.tolist(),
            obstacles,
            folder / "figures",
            levels,
            plan.case.name,
            outline.left_wall,
        )
        profile_figures(section_profiles(made.field, levels), folder / "figures")
    if "vessel" in plan.case.figures:
        for number, (part, simulated, production) in enumerate(_simulated(plan, made), start=1):
            from granpipe.export.pictures import vessel_figure

            particles = production.last_snapshot()
            vessel_figure(
                sorted(production.walls.glob("*.stl")),
                particles.position,
                particles.radius,
                particles.velocity,
                folder / "figures" / ("vessel.png" if number == 1 else f"vessel-{number}.png"),
                simulated.field.flow_scale,
                (part.outline.z_bottom, part.outline.z_top),
                _cut(part),
            )
    if "animation" in plan.case.figures:
        for part, simulated, production in islice(_simulated(plan, made), 1):
            _animate(folder / "figures" / "animation.gif", part, simulated, production, note)


def _cut(plan: Plan) -> float:
    """Where in y the 3-D picture cuts the vessel [m]: in its middle, or at the front of a slice, which is open."""
    if plan.space is not None:
        return plan.space.middle
    measure = plan.outline.measure
    return 0.5 * measure.turn if measure.walled else 0.0


def _simulated(plan: Plan, made: ModelResult) -> Iterator[tuple[Plan, ModelResult, Production]]:
    """Every simulation of particles, with the plan and the result that it belongs to: of the case or of a sub-model."""
    parts = [(plan.submodel(name) or plan, part) for name, part in made.submodels.items()] or [(plan, made)]
    return ((part, simulated, production) for part, simulated in parts for production in simulated.productions)


def _animate(path: Path, plan: Plan, made: ModelResult, production: Production, note: Callable[[str], None]) -> None:
    from granpipe.export.animation import Frame, animation

    outline, time_step = plan.simulated, made.figures["time_step_s"]
    frames = [Frame(step * time_step, particles) for step, particles in production.kept_frames(MOST_FRAMES)]
    if len(frames) < 2:
        note("no animation: the run kept no snapshots; `granpipe clean` and run again with dem.keep_snapshots: thinned")
        return
    obstacles = {name: polygon.tolist() for name, polygon in outline.obstacles.items()}
    animation(frames, outline.wall.tolist(), obstacles, made.field.flow_scale, path)


def write_logs(folder: Path, productions: Iterable[Production]) -> None:
    """Copy what LIGGGHTS said into ``logs/``."""
    for number, production in enumerate(productions, start=1):
        logs = folder / "logs" / ("" if number == 1 else str(number))
        logs.mkdir(parents=True)
        shutil.copyfile(production.settled / "output.txt", logs / "settle.txt")
        for log in sorted((production.folder / "logs").glob("*.txt")):
            shutil.copyfile(log, logs / log.name)
