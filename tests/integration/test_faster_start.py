"""A plate with a faster start on the real LIGGGHTS: it is where it should be, however the run was cut."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from fakes.runs import run

from granpipe.case.reader import read_case
from granpipe.dem.deck import DUMP_COLUMNS, render
from granpipe.dem.dump import read_snapshot
from granpipe.dem.settings import Settings
from granpipe.pipeline.dem_stages import compose_deck
from granpipe.planning.make import make_plan

pytestmark = pytest.mark.liggghts


def test_the_plate_goes_on_from_where_a_run_was_cut_before_at_and_after_its_change_of_speed(
    tiny: Path, tmp_path: Path
) -> None:
    tall = {"outline.wall": "[[6, 30], [6, 0]]"}
    file = read_case(tiny, tall | {"dem.start_speed": "auto", "homogenize.start": "auto", "dem.max_time": "0.5 s"})
    run(file, tmp_path / "results")
    store, plan = tmp_path / "results" / ".store", make_plan(file.case)
    work, start = tmp_path / "work", plan.dem.start_segments
    shutil.copytree(next(store.glob("walls-*")), work)
    shutil.copyfile(next(store.glob("settle-*")) / "settled.restart", work / "start.restart")
    (work / "produce.in").write_text(render(compose_deck(plan, work), "produce.in"))
    for first, last in (1, start - 1), (start, start), (start + 1, start + 2), (start + 3, start + 5):
        variables = {"first": first, "last": last, "px": 1, "py": 1, "pz": 1}
        given = [word for name, value in variables.items() for word in ("-var", name, str(value))]
        subprocess.run(["liggghts", "-in", "produce.in", *given], cwd=work, check=True, capture_output=True)
        shutil.copyfile(work / f"segment.{last}.restart", work / "start.restart")
        assert_the_bed_stands_on_the_plate(work / f"snapshot.{last * plan.dem.segment_steps}.bin", plan.dem)


def assert_the_bed_stands_on_the_plate(path: Path, settings: Settings) -> None:
    """The lowest spheres overlap the plate by no more than one in twenty of a diameter, and move at its speed."""
    bed = read_snapshot(path, DUMP_COLUMNS)
    height = bed.position[:, 2] - bed.radius - settings.plate_level(bed.step)
    assert -0.05 * 2 * bed.radius[0] < height.min() < 0
    speed = settings.start_speed if bed.step <= settings.start_steps else settings.plate_speed
    assert -bed.velocity[height < 0.5 * bed.radius, 2].mean() == pytest.approx(speed, rel=0.2)
