"""Jenike's mass-flow limit against values read from the published chart and its limiting cases."""

import math

import pytest

from granpipe.planning.jenike import hopper_regime, mass_flow_limit


def degrees(internal: float, wall: float) -> float:
    limit = mass_flow_limit(math.radians(internal), math.radians(wall))
    assert limit is not None
    return math.degrees(limit)


def test_a_smooth_wall_lets_a_cone_be_as_flat_as_the_formula_allows() -> None:
    sine = math.sin(math.radians(50))
    assert degrees(50, 0) == pytest.approx(90 - 0.5 * math.degrees(math.acos((1 - sine) / (2 * sine))))


@pytest.mark.parametrize(("internal", "wall", "low", "high"), [(50, 20, 25, 32), (40, 20, 26, 33), (30, 10, 38, 46)])
def test_limits_lie_where_the_chart_for_cones_has_them(internal: float, wall: float, low: float, high: float) -> None:
    assert low < degrees(internal, wall) < high


def test_a_rough_wall_needs_a_steeper_cone() -> None:
    assert degrees(50, 10) > degrees(50, 20) > degrees(50, 30)


def test_there_is_no_limit_outside_the_formulas_range() -> None:
    assert mass_flow_limit(math.radians(15), math.radians(5)) is None
    assert mass_flow_limit(math.radians(30), math.radians(35)) is None


def test_a_cone_within_three_degrees_of_the_limit_is_undecided() -> None:
    limit = degrees(50, 20)
    for angle, regime in ((limit - 4, "mass_flow"), (limit - 2, "undecided"), (limit + 1, "funnel_flow")):
        assert hopper_regime(math.radians(angle), math.radians(50), math.radians(20))[0] == regime
