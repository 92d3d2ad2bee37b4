"""Runs of granpipe that the cases share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from granpipe.case.reader import read_case
from granpipe.console import Console
from granpipe.field import Field
from granpipe.pipeline.context import Context
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.pipeline.production import Production
from granpipe.pipeline.run import run_case
from granpipe.pipeline.stiffness import with_checked_stiffness
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.progress import Silent
from granpipe.system.jsonfile import read_json
from granpipe.system.store import Store
from granpipe.system.versions import library_versions, program_versions

SPHERES = "diameter: {normal: {mean: 6 mm, std: 0.6 mm, min: 5 mm, max: 7 mm}}"
"""Sizes of nearly all scenes, as in the references of the wall factor."""

DIAMETER = 6e-3
"""Their mean [m]."""


def run_scene(name: str, text: str, folder: Path) -> tuple[Field, dict[str, Any]]:
    """Run a case, or find it done; its field and the figures of its provenance."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.yaml"
    path.write_text(text)
    with Console() as console:
        run_case(read_case(path), folder, console)
    provenance = read_json(folder / name / "provenance.json")
    failed = [gate["name"] for gate in provenance["quality"] if not gate["passed"]]
    return Field.load(folder / name / "field.npz"), provenance["figures"] | {"failed": failed}


def production_of(name: str, folder: Path) -> tuple[Plan, Production]:
    """The plan of a scene that has been run, with the stiffness that was chosen, and its production in the store."""
    store = Store(folder / ".store")
    versions = library_versions() | program_versions(store.root / "programs.json")
    plan = make_plan(read_case(folder / f"{name}.yaml").case, 1)
    plan = with_checked_stiffness(plan, Context(store, versions, Silent(), 1))
    (production,) = finished_productions(plan, store, versions)
    return plan, production


def rounded(values: Any, digits: int = 5) -> Any:
    """Numbers and lists of numbers with few digits, so that files of results stay small."""
    if isinstance(values, float | int):
        return float(f"{values:.{digits}g}")
    return [rounded(value, digits) for value in values]
