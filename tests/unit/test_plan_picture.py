"""What `check` and `plan` echo of a vessel: doubts, contents, and the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.errors import CaseError
from granpipe.pipeline.plan_picture import draw_plan, planned
from granpipe.planning.make import make_plan
from granpipe.planning.vessel_text import contents_text


def test_contents_are_volume_times_density(tiny: Path) -> None:
    text = contents_text(make_plan(load_case(tiny)))
    tonnes, number = np.pi * 0.06**2 * 0.1 * 1.16, 0.58 * np.pi * 0.06**2 * 0.1 / (np.pi / 6 * 0.02**3)
    assert f"{tonnes:.3g} t" in text
    assert f"particles {number:.0f} " in text
    assert "outlet: 6 × d90" in text


def test_metres_that_were_millimetres_radii_that_were_diameters_and_gaps_are_asked_about(tiny: Path) -> None:
    huge = {"outline.unit": "m", "outline.wall": "[[60, 100], [60, 0]]", "material.size": "{diameter: 5 m}"}
    assert any("is outline.unit right?" in one for one in make_plan(load_case(tiny, huge)).warnings)
    with pytest.raises(CaseError, match="if these are diameters, write diameter"):
        make_plan(load_case(tiny, {"material.size": "{radius: 2 cm}"}))
    gap = {"outline.sections": "{a: [10, 6], b: [4, 0]}"}
    assert any("no section covers z = 0.04 … 0.06 m" in one for one in make_plan(load_case(tiny, gap)).warnings)


def test_a_plan_is_drawn_and_an_unwritable_place_is_said(tiny: Path, tmp_path: Path) -> None:
    plan = make_plan(load_case(tiny))
    assert draw_plan(plan, tmp_path / "plan.png") == f"picture   {tmp_path / 'plan.png'}"
    assert (tmp_path / "plan.png").stat().st_size > 10_000
    assert draw_plan(plan, tmp_path / "none" / "plan.png").startswith("no picture")


def test_walls_that_particles_see_are_drawn_where_they_are_set_back(tiny: Path) -> None:
    back = {"material.size": "{diameter: 1 cm}", "dem.coarse_grain_factor": "2", "dem.walls": "set_back"}
    (wall,) = planned(make_plan(load_case(tiny, back))).set_back
    assert wall[:, 0] == pytest.approx(0.0625)
    assert planned(make_plan(load_case(tiny))).set_back == ()
