"""Runs the stability suite: every row as a granpipe run of its own, and the truth test beside it.

A row that is done is not repeated: its folder holds ``rest.json`` and ``verdict.json``, each written when it is known.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import date
from pathlib import Path
from typing import Any

from granpipe.analysis.compare import Difference, compare
from granpipe.case.reader import load_case, varied
from granpipe.case.schema import Case
from granpipe.dem.contact import GRAVITY, effective_modulus
from granpipe.dem.deck import render
from granpipe.dem.dump import first_step, read_snapshot
from granpipe.dem.filling import PACKING
from granpipe.dem.run import Liggghts
from granpipe.dem.settings import Settings
from granpipe.dem.snapshot import Snapshot
from granpipe.errors import CaseError, RunError
from granpipe.field import Field, Grid
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import compose_deck, make_walls
from granpipe.pipeline.records import SettleRecord
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Progress, Silent
from granpipe.system.pool import Task, run_together
from granpipe.system.publish import publishing
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions
from stability.page import Similar, draw_map, page
from stability.rows import Judged, Row, Truth, Verdict, flow_truth, rest_truth

PATIENCE = 900.0
"""Time that a granpipe run of a row may take [s]."""

FALLS_TO_FILL, FALLS_TO_REST, FALLS_WATCHED = 2.0, 4.0, 1.0
"""How long the truth test fills, waits and watches, in free falls through the vessel."""

WATCHES = 8
NOISE_GATES = ("raw flow through the worst level", "part of the flow that gathers", "statistical error", "independent")
"""Gates that a run as short as a row's need not pass."""

Work = Generator[object, None, None]


def run_suite(rows: Sequence[Row], folder: Path, cores: int, progress: Progress) -> list[Judged]:
    """Run the rows that are not done; return all of them, judged."""
    progress.stage("stability", f"{len(rows)} rows")
    todo = [row for row in rows if not is_done(row, folder)]
    done = len(rows) - len(todo)

    def finished(row: Row) -> None:
        nonlocal done
        done += 1
        judged = _judged(row, folder)
        progress.update(done / len(rows), f"{row.name}: {judged.verdict}")
        progress.note(f"{done}/{len(rows)} {row.name}: {judged.verdict}; {'; '.join(judged.faults) or 'stable'}")

    versions = library_versions() | program_versions(folder / "programs.json")
    run_together((Task(row.name, _ranks(row), _work(row, folder, versions, finished)) for row in todo), cores)
    return [_judged(row, folder) for row in rows]


def _ranks(row: Row) -> int:
    return int(row.changes.get("dem.ranks", "1"))


def is_done(row: Row, folder: Path) -> bool:
    """Whether a row need not be run again."""
    return all((folder / row.name / name).is_file() for name in ("rest.json", "verdict.json"))


def _judged(row: Row, folder: Path) -> Judged:
    said, rest = _read(folder / row.name / "verdict.json"), _read(folder / row.name / "rest.json")
    return Judged(row, said["verdict"], said["said"], Truth(**rest), Truth(**said["flow"]))


def _work(row: Row, folder: Path, versions: Mapping[str, str], finished: Callable[[Row], None]) -> Work:
    """Whatever of a row is not done: the bed left alone, then granpipe's own run of it."""
    own = folder / row.name
    own.mkdir(parents=True, exist_ok=True)
    case = scene(row)
    changes = changes_of(row, case)
    try:
        plan = make_plan(varied(case, changes))
    except CaseError:
        plan = None  # refused: there is nothing to leave alone
    if not (own / "rest.json").is_file():
        yield from _rest(plan, own, versions, row.patience)
    if not (own / "verdict.json").is_file():
        yield from _verdict(row, changes, plan, own)
    finished(row)


def scene(row: Row) -> Case:
    """The case that a row varies."""
    return load_case(_scene_file(row))


def _scene_file(row: Row) -> Path:
    return Path(__file__).parent / "scenes" / f"{row.scene.replace(' ', '_')}.yaml"


def changes_of(row: Row, case: Case) -> dict[str, str]:
    """All keys that a row changes, its multiples worked out."""
    if not row.multiples and not row.similar:
        return dict(row.changes)
    settings = make_plan(varied(case, row.changes)).dem
    if row.similar:
        return similar(case, settings, *row.scale)
    measures = {
        "dem.time_step": settings.rayleigh_time,
        "dem.max_time": settings.rayleigh_time,
        "dem.plate_speed": settings.plate_speed,
        "contact.youngs_modulus": _weight(case, settings) / effective_modulus(1.0, case.contact.poisson),
    }
    return dict(row.changes) | {key: repr(float(factor * measures[key])) for key, factor in row.multiples.items()}


def _weight(case: Case, settings: Settings) -> float:
    """ρ g H of the whole bed, voids included [Pa]."""
    return case.material.density * PACKING * GRAVITY * (settings.feed_top - settings.plate_z)


def similar(case: Case, settings: Settings, length: float, density: float) -> dict[str, str]:
    """The changes that scale a case, so that all its dimensionless groups stay; gravity is what it is."""
    time_scale = math.sqrt(length)
    assert case.flow_rate.mass is not None
    diameter = settings.classes.mean_diameter * length
    return {
        "outline.wall": json.dumps([[r * length, z * length] for r, z in case.outline.wall]),
        "material.size": f"{{diameter: {diameter!r}}}",
        "material.density": repr(case.material.density * density),
        "contact.youngs_modulus": repr(settings.youngs_modulus * density * length),
        "dem.time_step": repr(settings.time_step * time_scale),
        "dem.plate_speed": repr(settings.plate_speed * time_scale),
        "dem.max_time": repr(SIMILAR_TIME * time_scale),
        "homogenize.start": repr(0.25 * SIMILAR_TIME * time_scale),
        "homogenize.method": "psi",
        "flow_rate": f"{case.flow_rate.mass * density * length**2.5!r} kg/s",
    }


SIMILAR_TIME = 8.0
"""Production of a similar scene at the scale of its model [s]."""


def _verdict(row: Row, changes: Mapping[str, str], plan: Plan | None, own: Path) -> Work:
    """Let granpipe run the row, as a user would, and keep what it says."""
    sets = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    shutil.rmtree(own / "results" / scene(row).name, ignore_errors=True)  # the dumps of what is done are gone
    command = [sys.executable, "-m", "granpipe", "run", str(_scene_file(row)), *sets, "--results", str(own / "results")]
    begun = time.monotonic()
    with (own / "granpipe.txt").open("w") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
        try:
            while process.poll() is None:
                if time.monotonic() - begun > PATIENCE:
                    raise RunError(f"{row.name}: no end after {PATIENCE:g} s; see {own}")
                yield None
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
    verdict, said = _told(process.returncode, (own / "granpipe.txt").read_text())
    found = {
        "verdict": verdict,
        "said": said,
        "seconds": round(time.monotonic() - begun, 1),
        "changes": dict(changes),
        "flow": asdict(Truth() if plan is None else _flow(plan, own)),
    }
    _write(own / "verdict.json", found)
    shutil.rmtree(own / "results" / ".store", ignore_errors=True)


def _told(status: int, text: str) -> tuple[Verdict, str]:
    """Verdict and reason from exit status and output of a granpipe run."""
    own = [line.removeprefix("granpipe: ") for line in text.splitlines() if line.startswith("granpipe: ")]
    gates = [line.partition("quality gate failed: ")[2] for line in text.splitlines() if "quality gate failed" in line]
    gates = [gate for gate in gates if not gate.startswith(NOISE_GATES)]
    if status in (0, 4):
        return ("flagged", "; ".join(gates)) if gates else ("done", "")
    if status in (2, 3):
        return "refused" if status == 2 else "stopped", own[0] if own else text.strip()[-300:]
    raise RunError(f"granpipe ended with status {status}: {text.strip()[-300:]}")


def _rest(plan: Plan | None, own: Path, versions: Mapping[str, str], patience: float) -> Work:
    """Fill the vessel, leave the bed alone whatever becomes of it, and keep what is to be seen."""
    if plan is None:
        _write(own / "rest.json", asdict(Truth()))
        return
    settings = plan.dem
    walls = make_walls(plan, Context(Store(own / "results" / ".store"), versions, Silent(), plan.dem.ranks))
    deck = compose_deck(plan, walls)
    fall = math.sqrt(2 * (settings.feed_top - settings.plate_z) / GRAVITY) / settings.time_step
    every = max(1, round(FALLS_WATCHED * fall / WATCHES))
    variables = {
        "fill": round(FALLS_TO_FILL * fall),
        "relax": round(patience * FALLS_TO_REST * fall),
        "watch": WATCHES * every,
        "every": every,
    }
    with publishing(own / "rest") as folder:
        for path in walls.glob("*.stl"):
            (folder / path.name).write_bytes(path.read_bytes())
        (folder / "rest.in").write_text(render(deck, "rest.in"))
        broken = ""
        try:
            with Liggghts("rest.in", folder, settings.ranks, variables) as process:
                for _ in process.wait():
                    yield None
        except RunError as error:
            broken = str(error).splitlines()[0]
        beds = _snapshots(folder)
        for path in folder.iterdir():
            if path.name != "output.txt":
                path.unlink()
    outline = plan.outline
    if broken or not beds:
        truth = Truth(broken=broken or "LIGGGHTS left no dump")
    else:
        pipe = settings.plate_z + 2 * settings.classes.largest, outline.z_bottom
        truth = rest_truth([bed for _, bed in beds], GRAVITY, pipe, outline.outlet_radius)
    _write(own / "rest.json", asdict(truth))


def _snapshots(folder: Path) -> list[tuple[int, Snapshot]]:
    """Steps and snapshots of a folder, in order."""
    paths = sorted(folder.glob("*.bin"), key=first_step)
    return [(first_step(path), read_snapshot(path)) for path in paths]


def _flow(plan: Plan, own: Path) -> Truth:
    """What the snapshots of granpipe's own run show."""
    beds = [found for folder in own.glob("results/.store/produce-*/snapshots") for found in _snapshots(folder)]
    settings = _run_settings(plan, own)
    times = [step * settings.time_step for step, _ in beds]
    outlet = plan.outline.z_bottom
    return flow_truth(times, [bed for _, bed in beds], settings.plate_speed, settings.plate_z, outlet)


def _run_settings(plan: Plan, own: Path) -> Settings:
    """The settings of the run: a bed that was too soft is filled again, stiffer, with a shorter time step."""
    filled = [SettleRecord.read(path.parent).youngs_modulus for path in own.glob("results/.store/settle-*/settle.json")]
    youngs = max(filled, default=plan.dem.youngs_modulus)
    if youngs == plan.dem.youngs_modulus:
        return plan.dem
    return make_plan(varied(plan.case, {"contact.youngs_modulus": repr(youngs)})).dem


def write_page(judged: Sequence[Judged], folder: Path, page_folder: Path) -> Path:
    """Write ``stability.md`` and its map into a folder; return the page."""
    picture = page_folder / "images" / "stability.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    draw_map(judged, picture)
    program = program_versions(folder / "programs.json")["liggghts"]
    text = page(judged, similar_fields(judged, folder), "images/stability.png", date.today().isoformat(), program)
    (page_folder / "stability.md").write_text(text)
    return page_folder / "stability.md"


def similar_fields(judged: Sequence[Judged], folder: Path) -> list[Similar]:
    """The fields of similar scenes against that of their model, in the model's units."""
    rows = [one.row for one in judged if one.row.similar and one.verdict in ("done", "flagged")]
    fields = {row.scale: _in_units_of_the_model(row, folder) for row in rows}
    if (1.0, 1.0) not in fields:
        return []
    case = scene(rows[0])
    diameter = make_plan(case).dem.classes.sauter_diameter
    return [
        _similar(scale, compare(fields[1.0, 1.0], field, case.outline.levels, diameter))
        for scale, field in fields.items()
        if scale != (1.0, 1.0)
    ]


def _similar(scale: tuple[float, float], found: Sequence[Difference]) -> Similar:
    return Similar(*scale, {d.name: d.noise_free for d in found}, {d.name: d.upper for d in found})


def _in_units_of_the_model(row: Row, folder: Path) -> Field:
    """The field of a similar scene with lengths over its scale and velocities over the root of it."""
    field = Field.load(folder / row.name / "results" / "reactor" / "field.npz")
    length, speed = row.scale[0], field.velocity_scale / math.sqrt(row.scale[0])
    assert field.flux_r_se is not None  # the ψ fit knows its errors
    assert field.flux_z_se is not None
    return replace(
        field,
        grid=Grid(field.grid.r_edges / length, field.grid.z_edges / length),
        flux_r=field.flux_r * speed,
        flux_z=field.flux_z * speed,
        flux_r_se=field.flux_r_se * speed,
        flux_z_se=field.flux_z_se * speed,
        bulk_packing=1.0,
        flow_scale=1.0,
    )


def _read(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def _write(path: Path, data: Mapping[str, Any]) -> None:
    part = path.with_suffix(".part")
    part.write_text(json.dumps(data, indent=2) + "\n")
    part.replace(path)
