"""The vessels of the gallery: drawn by their script, planned, and (slow) run to a field without a mark."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path

import pytest

from granpipe.case.reader import read_case
from granpipe.pipeline.run import run_case
from granpipe.planning.make import make_plan
from granpipe.progress import Silent

GALLERY = Path(__file__).parents[2] / "cases" / "gallery"
CASES = sorted(path.stem for path in GALLERY.glob("*.yaml"))


def test_the_script_draws_what_is_there(tmp_path: Path) -> None:
    script = Path(shutil.copy(GALLERY / "draw.py", tmp_path))
    runpy.run_path(str(script), run_name="__main__")
    drawn = {path.name: path.read_text() for path in tmp_path.iterdir() if path.suffix in (".csv", ".yaml")}
    assert len(drawn) == 16
    assert drawn == {name: (GALLERY / name).read_text() for name in drawn}


@pytest.mark.parametrize("name", CASES)
def test_a_vessel_is_planned_from_its_drawing_with_few_particles(name: str) -> None:
    file = read_case(GALLERY / f"{name}.yaml")
    plan = make_plan(file.case, 1)
    assert plan.model == "dem"
    assert plan.dem.particles < 6500
    assert plan.breaches == ()


@pytest.mark.slow
@pytest.mark.liggghts
@pytest.mark.parametrize("name", CASES)
def test_a_vessel_runs_from_its_drawing_to_a_field_that_passes_every_gate(name: str, tmp_path: Path) -> None:
    file = read_case(GALLERY / f"{name}.yaml", {"figures": "[]", "dem.ranks": "1"})
    assert run_case(file, tmp_path, Silent()).failed == ()
