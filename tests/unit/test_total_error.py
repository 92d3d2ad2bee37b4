"""`model: auto` with `total_error`: the cheapest model whose error in vessels of the same kind is within it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from fakes.small_vessels import FLAT, case_of, hopper, plan_of, said

import granpipe.fluid.friction_error as errors
from granpipe.case.reader import read_case
from granpipe.errors import CaseError
from granpipe.fluid.friction_error import ExpectedError, Scene, expected_error
from granpipe.pipeline.results import plan_summary
from granpipe.planning.make import make_plan, model_plans, other_rheology
from granpipe.planning.text import plan_text

CONE = Scene("hopper", 26.0, 10.0, 0.42, 0.25, open_outlet=False)
RING = "{ring: [[60, 190], [90, 190], [90, 200], [60, 200]]}"


def worst(rheology: errors.Rheology) -> float:
    found = expected_error(rheology, CONE)
    assert isinstance(found, ExpectedError)
    return found.worst


def test_the_cheaper_fluid_is_taken_where_its_worst_hopper_is_within_the_error() -> None:
    loose, tight = (worst(one) + 0.001 for one in ("viscous", "frictional"))
    assert plan_of(hopper(20), total_error=f"{loose}", **said(20)).case.fluid.rheology == "viscous"
    plan = plan_of(hopper(20), total_error=f"{tight}", **said(20))
    assert (plan.model, plan.case.fluid.rheology, plan.friction is not None) == ("fluid", "frictional", True)
    assert plan.breaches == ()
    assert not any("the case asks" in stage.reason for stage in (*plan.stages, *plan.left_out))


def test_below_that_particles_run_until_their_error_is_that_of_the_case() -> None:
    just_below = worst("frictional") - 0.001
    plan = plan_of(hopper(20), total_error=f"{just_below}", **said(20))
    assert (plan.model, plan.case.dem.statistical_error) == ("dem", pytest.approx(just_below))
    kept = plan_of(hopper(20), total_error="5 %", dem__statistical_error="3 %", **said(20))
    assert kept.case.dem.statistical_error == pytest.approx(0.03)


def test_a_fluid_that_would_be_marked_is_not_taken() -> None:
    assert plan_of(hopper(20), total_error="40 %").case.fluid.rheology == "frictional"  # no word of mass flow
    plan = plan_of(FLAT, total_error="60 %", dem__max_time="100 s")
    assert plan.model == "dem"
    reasons = {stage.name: stage.reason for stage in plan.left_out}
    assert "rest on the ledge" in reasons["frictional fluid"]
    assert "rest on the ledge" in reasons["viscous fluid"]
    narrow = plan_of(hopper(20), total_error="40 %", size="{diameter: 6.5 mm}", dem__max_time="100 s")
    assert "flows in jerks" in {stage.name: stage.reason for stage in narrow.left_out}["frictional fluid"]


def test_the_choice_its_reason_and_what_was_left_out_are_told() -> None:
    case = case_of(hopper(20), total_error="16 %", **said(20))
    plan = make_plan(case)
    text = plan_text(plan, model_plans(case), other_rheology(case), None)
    for told in (text, json.dumps(plan_summary(plan), ensure_ascii=False)):
        assert "frictional fluid, the cheapest within total_error 0.16" in told
        assert "beyond total_error 0.16" in told
        assert "no error of hybrids" in told


def test_a_resolved_case_is_planned_the_same(tmp_path: Path) -> None:
    for error in ("40 %", "16 %", "5 %"):
        plan = plan_of(hopper(20), total_error=error, **said(20))
        (tmp_path / "again.yaml").write_text(plan.case.to_yaml())
        again = make_plan(read_case(tmp_path / "again.yaml").case)
        assert (again.model, again.case, again.stages) == (plan.model, plan.case, plan.stages)


@pytest.mark.parametrize(
    ("wall", "changes", "message"),
    [
        ("[[90, 400], [90, 0]]", {}, r"of its kind \(pipe\) 0 vessels"),
        (hopper(55), {}, "up to 45° from the vertical, it up to 55°"),
        (hopper(20), {"dem__outlet": "open"}, "its outlet is open"),
        (hopper(20), {"contact__friction": "0.1", "contact__rolling_friction": "0"}, "have a bulk friction of"),
        ("[[90, 400], [90, 0]]", {"outline__obstacles": RING, "size": "{diameter: 30 mm}"}, "have openings of 5 d"),
        (hopper(20), {"model": "dem"}, "belongs to model: auto"),
        (hopper(20), {"outline__sections": "{a: {z: [100, 50], model: fluid}}"}, "one model for the whole vessel"),
        (hopper(20), {"total_error": "0"}, "total_error"),
    ],
)
def test_what_no_error_is_known_of_is_refused(wall: str, changes: dict[str, str], message: str) -> None:
    with pytest.raises(CaseError, match=message):
        plan_of(wall, **{"total_error": "20 %"} | changes)


def test_particles_whose_error_is_not_known_are_refused() -> None:
    with pytest.raises(CaseError, match="of enlarged particles no error is known") as refused:
        plan_of(hopper(20), total_error="5 %", dem__coarse_grain_factor="2")
    assert refused.value.key == ("total_error",)
    with pytest.raises(CaseError, match="this is beyond it") as refused:
        plan_of(hopper(20), total_error="5 %", dem__statistical_error="8 %")
    assert refused.value.key == ("dem", "statistical_error")
    with pytest.raises(CaseError, match="only method: psi tells"):
        plan_of(hopper(20), total_error="5 %", homogenize__method="gaussian")


def test_a_kind_needs_three_scenes_and_its_range_is_not_left(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene("hopper", 20, 10, 0.4, 0.2, open_outlet=False)
    row = errors._Row(scene, {"frictional": {"error": 0.1, "sensitivity": 0.02}, "viscous": {"error": 0.2}})
    other = errors._Row(scene, row.results | {"frictional": {"error": 0.3, "sensitivity": 0.04}})
    monkeypatch.setattr(errors, "_table", lambda: {"a": row, "b": row})
    assert "2 vessels are in the table" in str(expected_error("frictional", scene))
    monkeypatch.setattr(errors, "_table", lambda: {"a": row, "b": row, "c": other})
    found = expected_error("frictional", scene)
    assert isinstance(found, ExpectedError)
    assert (found.least, found.worst, found.worst_scene) == (0.1, 0.3, "c")
    assert found.mean == pytest.approx(0.5 / 3)
    assert found.sensitivity == pytest.approx(0.08 / 3)
    for beyond in ({"half_angle": 25}, {"opening": 8}, {"internal": 0.5}, {"wall": 0.1}, {"open_outlet": True}):
        assert isinstance(expected_error("viscous", replace(scene, **beyond)), str)
    for within in ({"half_angle": 5}, {"opening": 80}, {"wall": 0.21}):
        assert isinstance(expected_error("viscous", replace(scene, **within)), ExpectedError)


def test_a_frictional_fluid_through_an_open_outlet_says_that_its_profile_is_assumed() -> None:
    changes = {"model": "fluid", "fluid__rheology": "frictional"}
    assert "w ∝ (1 − r²/a²)^0.7" in "".join(plan_of(hopper(20), dem__outlet="open", **changes).notes)
    assert "^0.7" not in "".join(plan_of(hopper(20), **changes).notes)
