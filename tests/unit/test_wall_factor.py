"""The law of the wall factor, what a case gets by it, and the error that plan and result tell."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from granpipe.case.reader import load_case
from granpipe.fluid.wall_factor import MeasuredCone, WallFactorLaw, wall_factor_law
from granpipe.pipeline.fluid_field import wall_law
from granpipe.pipeline.results import plan_summary
from granpipe.planning.make import make_plan, other_rheology
from granpipe.planning.text import plan_text
from granpipe.planning.wall_factors import wall_friction

HOPPER = Path(__file__).parents[2] / "cases" / "hopper.yaml"
LAW = WallFactorLaw(3.0, 0.2, 1.5, 0.1, (MeasuredCone(0.3, 0.1, 0.8, 0.03, 0.4), MeasuredCone(0.7, 0.7, 0.3, 0.2, 0.5)))


def hopper(**changes: str):
    return load_case(HOPPER, {key.replace("__", "."): value for key, value in changes.items()})


def test_upright_or_frictionless_walls_move_with_the_bulk() -> None:
    assert LAW.factor(0.0, 0.7) == 1
    assert LAW.factor(0.5, 0.0) == 1


def test_rougher_and_flatter_walls_are_slower_and_never_turn() -> None:
    law = wall_factor_law()
    factors = [
        [law.factor(math.radians(angle), friction) for friction in (0.1, 0.3, 0.7, 2.0)] for angle in (10, 30, 60)
    ]
    assert all(a > b > 0 for row in factors for a, b in pairwise(row))
    assert all(a > b for column in zip(*factors, strict=True) for a, b in pairwise(column))


def test_the_law_is_that_of_its_formula() -> None:
    """exp(−3 (1 − e^−1.5) tan^1.5 0.5), by hand: exp(−3 · 0.77687 · 0.40379)."""
    assert LAW.factor(0.5, 0.3) == pytest.approx(0.39021, abs=2e-5)


@pytest.mark.parametrize("coefficient", ["strength", "friction_scale", "exponent"])
@pytest.mark.parametrize("change", [0.95, 1.05])
def test_no_other_coefficients_meet_what_was_measured_better(coefficient: str, change: float) -> None:
    law = wall_factor_law()
    other = replace(law, **{coefficient: change * getattr(law, coefficient)})
    best, worse = (
        sum((one.factor(cone.half_angle, cone.friction) - cone.factor) ** 2 for cone in law.cones)
        for one in (law, other)
    )
    assert best < worse


def test_the_law_meets_what_was_measured_within_its_scatter() -> None:
    law = wall_factor_law()
    off = [law.factor(cone.half_angle, cone.friction) - cone.factor for cone in law.cones]
    assert len(off) >= 4
    assert math.sqrt(sum(one**2 for one in off) / len(off)) == pytest.approx(law.scatter, rel=0.1, abs=2e-3)


def test_the_expected_error_is_that_of_the_nearest_cone_with_what_the_factor_adds() -> None:
    assert LAW.expected_error(0.32, 0.12, LAW.factor(0.32, 0.12)) == pytest.approx(math.hypot(0.03, 0.4 * 0.1))
    far = LAW.factor(0.7, 0.7) + 0.3
    assert LAW.expected_error(0.7, 0.7, far) == pytest.approx(math.hypot(0.2, 0.5 * math.hypot(0.1, 0.3)))


def test_a_given_factor_stays_and_plan_and_summary_tell_its_error() -> None:
    plan = make_plan(hopper())
    assert wall_law(plan.case).section_factors == {"b": pytest.approx(2 / 3)}
    (factor,) = plan.wall_factors
    assert factor.name == "wall factor of section b"
    assert "the case says so" in factor.criterion
    assert "expect an error of about" in plan_text(plan, {}, other_rheology(plan.case), None)
    assert plan_summary(plan)["wall_factors"][0]["value"] == "0.67"


def test_without_one_the_law_takes_the_friction_of_the_case() -> None:
    case = hopper(outline__sections__b="{z: [4.9, 3.9], regime: mass_flow}", contact__wall__friction="0.3")
    plan = make_plan(case)
    assert wall_law(case).section_factors == {}
    assert wall_law(case).friction == 0.3
    expected = wall_factor_law().factor(math.atan(0.5), 0.3)
    assert float(plan.wall_factors[0].value) == pytest.approx(expected, abs=0.006)
    assert "contact.wall.friction" in plan.wall_factors[0].criterion
    assert not any("assumed" in warning for warning in plan.warnings)


def test_a_friction_that_the_case_does_not_give_is_said_to_be_assumed() -> None:
    assert any("0.73 is assumed" in warning for warning in make_plan(hopper()).warnings)


def test_a_measured_angle_of_wall_friction_is_taken_where_no_contact_is_given() -> None:
    assert wall_friction(hopper(material__wall_friction_angle="20 deg")).value == pytest.approx(
        math.tan(math.radians(20))
    )
    both = hopper(material__wall_friction_angle="20 deg", contact__friction="0.5")
    assert wall_friction(both).value == 0.5


def test_slipping_walls_and_straight_sections_have_no_wall_factor() -> None:
    assert make_plan(hopper(fluid__walls="slip")).wall_factors == ()
    straight = hopper(outline__wall="[[1, 5.9], [1, 3.4]]")
    assert make_plan(straight).wall_factors == ()
