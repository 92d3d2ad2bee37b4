"""What `check` and `plan` echo of a vessel: doubts, contents, and the free surfaces of the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.errors import CaseError
from granpipe.export.plan_picture import REPOSE, free_surfaces
from granpipe.pipeline.plan_picture import draw_plan
from granpipe.planning.plan import make_plan
from granpipe.planning.vessel_text import contents_text

WALL = np.array([[1.0, 4.0], [1.0, 2.0], [2.0, 2.0], [2.0, 0.0]])


def test_a_free_surface_falls_from_a_ledge_to_the_wall_at_the_angle_of_repose() -> None:
    (line,) = free_surfaces(WALL, {})
    np.testing.assert_allclose(line, [[1.0, 2.0], [2.0, 2.0 - np.tan(REPOSE)]], atol=1e-5)


def test_a_ring_has_two_free_surfaces_under_it_and_a_cone_upright_on_the_axis_one() -> None:
    pipe = np.array([[2.0, 4.0], [2.0, 0.0]])
    ring = np.array([[1.0, 3.0], [1.4, 3.0], [1.4, 3.2], [1.0, 3.2]])
    assert len(free_surfaces(pipe, {"ring": ring})) == 2
    cone = np.array([[0.0, 3.0], [0.5, 2.0], [0.0, 2.0]])
    (line,) = free_surfaces(pipe, {"cone": cone})
    np.testing.assert_allclose(line[-1], [0.0, 2.0 - 0.5 * np.tan(REPOSE)], atol=1e-5)


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
