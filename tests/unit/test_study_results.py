"""The error budget on synthetic points: fields of known dependence on particle size and plate speed, under noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.study_points import CASE, OWN, PER_DIAMETER, PER_FRICTION, PER_MASS, PER_SPEED, norm_of_profile, point, study

from granpipe.case.reader import varied
from granpipe.errors import DataError
from granpipe.field import Field
from granpipe.planning.make import make_plan
from granpipe.study.axes import BASE, FILLINGS, FINEST_SPEED, SEED
from granpipe.study.budget import ErrorBound, advise
from granpipe.study.findings import Comparison, Findings, StudyPoint
from granpipe.study.fluid import Solve, fluid_findings
from granpipe.study.report import study_sections
from granpipe.study.uncertainty import Uncertainty, input_part, statistical_part


def test_the_finest_is_the_reference() -> None:
    assert study(0.0).reference.name == "fine"


def test_parts_are_those_that_were_put_in() -> None:
    made = study(0.002)
    unit = norm_of_profile(made)
    for number, (diameter, speed) in enumerate([(0.015, 0.02), (0.02, 0.02), (0.012, 0.02), (0.015, 0.04)]):
        effect = made.effect(made.points[number], {})
        size, plate = effect.contributions["coarse_grain_factor"]["whole"], effect.contributions["plate_speed"]["whole"]
        assert size.value == pytest.approx(unit * PER_DIAMETER * (diameter - OWN), rel=0.1)
        assert plate.value == pytest.approx(unit * PER_SPEED * speed, rel=0.1)
        assert size.value <= size.upper


def test_mass_scaling_counts_from_none() -> None:
    sizes = "{diameter: {sieve: {edges: [6 mm, 10 mm, 12 mm], fractions: [40 %, 60 %]}}, by: mass}"
    case, sigma = varied(CASE, {"material.size": sizes}), 0.002
    points = [
        point(BASE, "", {}, sigma, 1, case),
        point("none", "mass_scaling", {"dem.mass_scaling": "none"}, sigma, 2, case),
    ]
    made = Comparison(case, points)
    factor = points[0].plan.dem.classes.mass_factor
    assert factor > 1.05
    scaled, plain = (made.effect(one, {}).contributions["mass_scaling"]["whole"] for one in points)
    assert scaled.value == pytest.approx(norm_of_profile(made) * PER_MASS * (factor - 1), rel=0.1)
    assert plain.upper == 0
    parts = made.uncertainty(made.effect(made.base, {}))["whole"]
    assert "mass scaling" not in parts.missing
    assert "mass scaling" in {part.name for part in parts.parts}


def test_the_uncertainty_of_an_input_is_what_was_put_in_and_no_end_of_it_becomes_the_reference() -> None:
    axis, sigma = "input contact.friction=0.2..0.4", 0.002
    ends = [point(f"end{end}", axis, {"contact.friction": end}, sigma, 7 + at) for at, end in enumerate(("0.2", "0.4"))]
    made = Comparison(CASE, [*study(sigma).points, *ends])
    assert made.reference.name == "fine"
    found = made.uncertainty(made.effect(made.base, {}))
    parts = {part.name: part for part in found["whole"].parts}
    expected = norm_of_profile(made) * PER_FRICTION * 0.2 / np.sqrt(12)  # a range of 0.2
    assert parts["contact.friction"].standard == pytest.approx(expected, rel=0.1)
    assert found["whole"].standard("input") == parts["contact.friction"].standard
    speed = made.effect(made.base, {}).contributions["plate_speed"]["whole"]
    assert parts["plate speed"].standard == pytest.approx(speed.upper / 2)
    assert found["whole"].missing == ["stiffness", "time step", "grid"]
    assert set(found) == {"whole", *CASE.outline.levels}


def test_an_input_without_one_of_its_ends_is_not_determined() -> None:
    end = point("end", "input contact.friction=0.2..0.4", {"contact.friction": "0.2"}, 0.0, 7)
    made = Comparison(CASE, [*study(0.002).points, end])
    assert "contact.friction" in made.uncertainty(made.effect(made.base, {}))["whole"].missing


def test_the_parts_together_foretell_the_measured_difference() -> None:
    made = study(0.002)
    unit = norm_of_profile(made)
    for name, strength in (("fast", PER_DIAMETER * 0.003 + PER_SPEED * 0.02), ("coarse", PER_DIAMETER * 0.008)):
        effect = made.effect(next(p for p in made.points if p.name == name), {})
        assert effect.predicted is not None
        assert effect.predicted["whole"].value == pytest.approx(unit * strength, rel=0.1)
        assert effect.systematic["whole"].value == pytest.approx(unit * strength, rel=0.1)


def test_the_error_of_a_field_counts_from_the_limit_not_from_the_reference() -> None:
    made = study(0.002)
    unit = norm_of_profile(made)
    assert made.distance["whole"].value == pytest.approx(unit * (PER_DIAMETER * 0.002 + PER_SPEED * 0.02), rel=0.1)
    for number, strength in ((0, PER_DIAMETER * 0.005 + PER_SPEED * 0.02), (1, PER_DIAMETER * 0.01 + PER_SPEED * 0.02)):
        one = made.points[number]
        found = made.systematic(one.field, one)["whole"]
        assert found.value == pytest.approx(unit * strength, rel=0.1)
        assert found.upper > unit * strength


def test_noise_of_a_point_on_several_axes_counts_for_what_it_adds_to_their_sum() -> None:
    """The case itself is on both axes. By the mean square over many studies."""
    made = [Comparison(CASE, [study(0.1, seed=10 * number).points[at] for at in (0, 2, 3)]) for number in range(1, 41)]
    found = np.sqrt(np.mean([one.distance["whole"].value ** 2 for one in made]))
    assert found == pytest.approx(norm_of_profile(made[0]) * (PER_DIAMETER * 0.002 + PER_SPEED * 0.02), rel=0.1)


def test_the_limit_goes_by_what_a_plate_does_to_the_finest_particles() -> None:
    sigma, steep = 0.002, 3 * PER_SPEED
    fine, fast = {"dem.coarse_grain_factor": "1.2"}, {"dem.plate_speed": "0.04", "dem.max_time": "4"}
    points = [
        point(BASE, "", {}, sigma, 1),
        point("fine", "coarse_grain_factor", fine, sigma, 2, per_speed=steep),
        point("fast", "plate_speed", fast, sigma, 3),
        point("fine-fast", FINEST_SPEED, fine | fast, sigma, 4, per_speed=steep),
    ]
    made = Comparison(CASE, points)
    unit = norm_of_profile(made)
    assert made.reference.name == "fine"
    plates = [made.effect(one, {}).contributions["plate_speed"]["whole"].value for one in points]
    expected = [PER_SPEED * 0.02, steep * 0.02, PER_SPEED * 0.04, steep * 0.04]
    assert plates == pytest.approx([unit * one for one in expected], rel=0.1)
    size = PER_DIAMETER * 0.002 + (PER_SPEED - steep) * 0.02 * 0.002 / (0.005 - 0.002)  # by a line through two sizes
    assert made.distance["whole"].value == pytest.approx(unit * (size + steep * 0.02), rel=0.1)
    assert made.systematic(points[3].field, points[3])["whole"].value == pytest.approx(
        unit * (size + steep * 0.04), rel=0.1
    )
    assert made.finest_speed is not None
    assert made.finest_speed.fit.points == 2


def in_other_fillings(told: float, scatter: float, seed: int) -> Comparison:
    """Two speeds in three fillings each, which lie `scatter` apart and tell `told`."""
    fast, points = {"dem.plate_speed": "0.04", "dem.max_time": "4"}, []
    for number, (axis, more) in enumerate({"": {}, SEED: {"dem.seed": "7"}, "third": {"dem.seed": "8"}}.items()):
        slow = point(f"slow{number}", axis.replace("third", SEED), more, scatter, seed + 2 * number)
        quick = point(f"fast{number}", FILLINGS if more else "plate_speed", fast | more, scatter, seed + 2 * number + 1)
        for one in (slow, quick):
            assert one.field.flux_z_se is not None
            named = replace(
                one.plan, case=one.plan.case.model_copy(update={"name": one.name})
            )  # as in a study's folder
            field = replace(one.field, flux_z_se=one.field.flux_z_se * told / scatter)
            points.append(replace(one, plan=named, field=field))
    return Comparison(CASE, points)


def test_all_fillings_tell_what_a_setting_does() -> None:
    one, three = (in_other_fillings(0.1, 0.1, 20), in_other_fillings(0.1, 0.1, 20))
    alone = Comparison(CASE, [one.points[0], one.points[1]])
    assert three.slopes["plate_speed"].fit.points == 6
    unit = norm_of_profile(three) * PER_SPEED * 0.02
    found = three.effect(three.points[0], {}).contributions["plate_speed"]["whole"]
    single = alone.effect(alone.points[0], {}).contributions["plate_speed"]["whole"]
    assert found.value == pytest.approx(unit, rel=0.2)
    assert found.upper - found.value < single.upper - single.value


def test_noise_counts_as_fillings_differ_where_they_differ_by_more_than_it() -> None:
    """By the mean square over many studies: noise that is told half as large as it is would be taken for an effect."""
    many = [in_other_fillings(0.05, 0.1, 100 * number) for number in range(1, 21)]
    assert np.mean([made.scatter for made in many if made.scatter]) == pytest.approx(2, rel=0.1)
    parts = [made.effect(made.points[0], {}).contributions["plate_speed"]["whole"].value for made in many]
    assert np.sqrt(np.mean(np.square(parts))) == pytest.approx(norm_of_profile(many[0]) * PER_SPEED * 0.02, rel=0.1)
    assert study(0.01).scatter is None


def test_noise_that_is_told_too_small_is_not_taken_for_the_second_order() -> None:
    made = in_other_fillings(0.05, 0.1, 7)
    slow = {"dem.plate_speed": "0.01", "dem.max_time": "16"}
    third = point("slow", "plate_speed", slow, 0.1, 90)
    assert third.field.flux_z_se is not None
    third = replace(third, field=replace(third.field, flux_z_se=third.field.flux_z_se / 2))
    fit = Comparison(CASE, [*made.points, third]).slopes["plate_speed"].fit
    assert fit.order == 1
    assert fit.misfit == pytest.approx(1, abs=0.3)


def test_a_run_that_is_only_longer_is_no_other_filling() -> None:
    points = [point(BASE, "", {}, 0.1, 1), point("longer", "point", {"dem.max_time": "20"}, 0.1, 1)]
    assert Comparison(CASE, points).scatter is None


def test_differences_from_the_limit_are_added_as_fields_not_by_their_sizes() -> None:
    """The slow point is coarser than the reference, and on the limit's side of it by its plate."""
    made = study(0.0005)
    slow = made.points[4]
    assert made.reference.name == "fine"
    found = made.systematic(slow.field, slow)["whole"]
    assert found.value == pytest.approx(norm_of_profile(made) * (PER_DIAMETER * 0.005 + PER_SPEED * 0.01), rel=0.03)


def test_axes_that_the_study_cannot_tell_are_named() -> None:
    assert study(0.002).unknown == ("youngs_modulus", "time_step")
    alone = Comparison(CASE, study(0.002).points[:1])
    assert alone.unknown == ("coarse_grain_factor", "plate_speed", "youngs_modulus", "time_step")
    assert alone.distance["whole"].upper == 0


def test_sections_are_told_apart_from_the_whole() -> None:
    made = study(0.002)
    effect = made.effect(made.points[1], {})
    assert list(effect.systematic) == ["whole", "shaft", "hopper", "throat", "chamber"]


def test_what_noise_hides_is_unresolved_and_stays_below_its_bound() -> None:
    made = study(0.3)
    unit = norm_of_profile(made)
    effect = made.effect(made.points[0], {})
    part = effect.contributions["plate_speed"]["whole"]
    assert not part.resolved
    assert part.upper > unit * PER_SPEED * 0.02


def test_the_reference_has_no_difference_from_itself() -> None:
    made = study(0.01)
    effect = made.effect(made.reference, {})
    assert effect.systematic["whole"].upper == 0


def test_without_error_bars_there_is_nothing_to_compare() -> None:
    bare = study(0.0).points[0]
    field = Field(
        bare.field.grid, bare.field.inside_fraction, bare.field.bulk, bare.field.flux_r, bare.field.flux_z, 1, 1, 1
    )
    alone = StudyPoint(BASE, "", {}, bare.plan, field, bare.finished, 1.0, 1, None)
    with pytest.raises(DataError, match="average longer"):
        Comparison(CASE, [alone])


def test_without_particles_the_finite_elements_are_the_options() -> None:
    solves = [Solve(10, 2, 100, 1.0, 0.02), Solve(10, 3, 200, 2.0, 0.004), Solve(20, 2, 400, 4.0, 0.01)]
    found = fluid_findings(solves)
    assert [option.changes for option in found.options] == [{"fluid.order": "2"}, {"fluid.order": "3"}]
    advice = advise(found.options, 0.01)
    assert advice.option is found.options[1]
    assert "Error budget" not in {section.title for section in study_sections(found, solves, None)}


def test_each_advice_says_how_much_longer_another_case_takes() -> None:
    found = replace(fluid_findings([Solve(10, 2, 100, 2.0, 0.02)]), rate=1e6)
    other = make_plan(CASE)
    sections = {one.title: one for one in study_sections(found, [], other)}
    assert "Finite elements" not in sections  # there are none
    section = sections["Recommended settings"]
    assert section.head[-1] == "smoke takes"
    by_tolerance = {row[0]: row[-1] for row in section.rows}
    assert by_tolerance["2%"] == f"× {other.particle_steps / 1e6 / 2.0:.3g}"


def test_levers_are_told_against_the_case_and_its_time() -> None:
    studied = study(0.0)
    base, coarse = (studied.effect(point, {}) for point in studied.points[:2])
    found = Findings(BASE, {}, (), (), (base, replace(coarse, seconds=3 * base.seconds)), (), None, {}, None, {})
    (section,) = (one for one in study_sections(found, [], None) if one.title == "Effects")
    ((name, times, difference),) = section.rows
    assert (name, times) == (coarse.point, "× 3.00")
    assert difference == str(coarse.from_base["whole"])


def test_the_table_of_uncertainty_marks_what_noise_hides_section_by_section() -> None:
    def parts(*, hidden: bool) -> Uncertainty:
        apart = ErrorBound(0.01, 0.06) if hidden else ErrorBound(0.05, 0.06)
        return Uncertainty((statistical_part(0.03), input_part("contact.friction", ("0.2", "0.4"), apart)))

    base = study(0.0).effect(study(0.0).base, {})
    both = {"whole": parts(hidden=False), "shaft": parts(hidden=True)}
    found = Findings(BASE, {}, (), (), (base,), (), None, {}, None, both)
    (section,) = (one for one in study_sections(found, [], None) if one.title == "Uncertainty")
    assert section.rows[1][:4] == ("contact.friction", "input", "1.4%", "≤ 1.7%")
    assert any("≤" in text for text in section.text)
