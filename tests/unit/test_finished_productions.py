"""What points left is read for the report of a study; LIGGGHTS and gmsh are never started for it."""

from __future__ import annotations

from pathlib import Path

import pytest
from fakes.records import WALLS

from granpipe.case.reader import read_case
from granpipe.errors import DataError
from granpipe.pipeline import dem_stages
from granpipe.pipeline.dem_stages import finished_productions
from granpipe.planning.make import make_plan
from granpipe.system.store import Store

VERSIONS = {"gmsh": "4", "liggghts": "3.8"}


@pytest.mark.parametrize("walls_are_left", [False, True])
def test_what_the_store_has_lost_is_an_error_and_is_not_made_again(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, walls_are_left: bool
) -> None:
    def started(*_: object, **__: object) -> None:
        pytest.fail("something was started")

    for name in ("Liggghts", "build_walls", "run_together"):
        monkeypatch.setattr(dem_stages, name, started)
    plan, store = make_plan(read_case(tiny).case), Store(tmp_path / "store")
    if walls_are_left:
        folder = store.folder("walls", dem_stages._walls_key(plan, VERSIONS))
        folder.mkdir(parents=True)
        WALLS.write(folder)
    with pytest.raises(DataError, match="run it again"):
        finished_productions(plan, store, VERSIONS)
