"""An earlier run as the reference of a study: errors as they were put in, and refusals with their remedy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from fakes.earlier_runs import SLOW, earlier, results
from fakes.study_points import CASE, OWN, PER_DIAMETER, PER_SPEED, norm_of_profile, study

from granpipe.case.reader import varied
from granpipe.errors import CaseError, DataError
from granpipe.planning.make import make_plan
from granpipe.progress import Silent
from granpipe.study.budget import advise
from granpipe.study.findings import Comparison
from granpipe.study.reference import EarlierRun, check_cells, read_reference, read_run
from granpipe.study.report import study_intro, study_sections


def compared(run: EarlierRun, sigma: float = 0.002, *points: int) -> Comparison:
    """Some of the synthetic points, or all, with the reference."""
    made = study(sigma).points
    return Comparison(CASE, [made[number] for number in points] or made, run)


def test_its_distance_from_the_limit_is_that_of_its_plate_alone() -> None:
    found = compared(earlier())
    assert found.reference.name == "reference"
    assert found.distance["whole"].value == pytest.approx(norm_of_profile(found) * PER_SPEED * SLOW, rel=0.1)
    own = found.effect(found.reference, {})
    assert own.contributions["coarse_grain_factor"]["whole"].upper == 0
    assert str(own.contributions["coarse_grain_factor"]["whole"]) == "0"
    assert own.systematic["whole"].upper == 0
    assert found.unknown == ("youngs_modulus", "time_step")


def test_errors_are_the_difference_from_it_and_its_own_distance() -> None:
    found = compared(earlier())
    unit = norm_of_profile(found)
    for one, strength in zip(found.points, (0.03 + 0.04, 0.06 + 0.04, 0.012 + 0.04, 0.03 + 0.08), strict=False):
        error = found.systematic(one.field, one)["whole"]
        assert error.value == pytest.approx(unit * strength, rel=0.1)
        assert error.upper > unit * strength
        foretold = found.effect(one, {}).predicted
        assert foretold is not None
        assert foretold["whole"].value == pytest.approx(unit * (strength - PER_SPEED * SLOW), rel=0.15)


def test_without_points_along_the_size_it_is_known_all_the_same() -> None:
    """The case alone: what the reference is away from the limit by its other settings stays unknown, and is named."""
    found = compared(earlier(), 0.002, 0)
    assert found.unknown == ("plate_speed", "youngs_modulus", "time_step")
    effect = found.effect(found.base, {})
    expected = norm_of_profile(found) * (PER_DIAMETER * 0.005 + PER_SPEED * 0.005)
    assert effect.systematic["whole"].value == pytest.approx(expected, rel=0.1)
    parts = {part.name: part for part in found.uncertainty(effect)["whole"].parts}
    assert parts["particle size"].standard == pytest.approx(effect.systematic["whole"].upper / 2)
    assert "the material's own size" in parts["particle size"].basis


def test_its_noise_is_in_the_bound_and_taken_off_the_difference() -> None:
    quiet, noisy = (compared(earlier(sigma)) for sigma in (0.0, 0.06))
    sure, unsure = (found.systematic(found.base.field, found.base)["whole"] for found in (quiet, noisy))
    assert unsure.upper > 1.2 * sure.upper
    assert unsure.value == pytest.approx(sure.value, rel=0.35)


def test_on_finer_cells_it_gives_the_same_errors() -> None:
    for cell in ("2.5 mm", "1.66667 mm"):
        found = compared(earlier(homogenize__cell=cell))
        error = found.systematic(found.base.field, found.base)["whole"].value
        assert error == pytest.approx(norm_of_profile(found) * 0.07, rel=0.1), cell


def test_a_point_that_is_the_same_run_has_no_difference_from_it() -> None:
    run = earlier(dem__coarse_grain_factor="1.5", dem__plate_speed="0.02", dem__seed=str(CASE.dem.seed))
    found = compared(run)
    assert found.effect(found.base, {}).systematic["whole"].upper == 0
    assert found.effect(found.points[1], {}).systematic["whole"].upper > 0
    assert not earlier().is_of(found.base.plan)


def test_it_is_an_option_of_its_own_whose_settings_make_such_a_run() -> None:
    run = earlier(0.01, dem__facets="32")
    found = compared(run).findings(Silent())
    option = next(one for one in found.options if one.point == "reference")
    assert option.systematic["whole"] == found.distance["whole"]
    assert (option.core_seconds, option.blocks) == (1000.0, 30.0)
    assert option.travel == pytest.approx(0.4 / 0.15)  # the outlet is 15 cm wide
    plan = make_plan(varied(CASE, option.changes | {"dem.seed": "9"}))
    assert run.is_of(plan)
    assert advise(found.options, 0.06).option == option
    untold = Comparison(CASE, study(0.002).points, replace(run, seconds=None)).findings(Silent())
    assert "reference" not in {one.point for one in untold.options}


def test_page_and_file_say_what_errors_count_from() -> None:
    found = compared(earlier(0.01)).findings(Silent())
    assert found.earlier is not None
    assert (found.earlier.folder, found.earlier.own_size, found.earlier.blocks) == ("limit", True, 30.0)
    told = " ".join(study_intro(found))
    assert "an earlier run, limit: particles of 10 mm (the material's own size), plate 0.015 m/s" in told
    assert "failed a quality gate: packing in the plug 0.7" in told
    budget = next(section for section in study_sections(found, [], None) if section.title == "Error budget")
    row = next(row for row in budget.rows if row[0] == "reference")
    assert row[2] == "0"


def test_settings_are_recommended_by_the_reference_alone_as_well() -> None:
    """Its own plate adds 1.7 % to its error against the limit, and nothing to that against itself."""
    found = compared(earlier()).findings(Silent())
    (option,) = (one for one in found.options if one.point == "reference")
    assert option.error().value == pytest.approx(0.0173, rel=0.02)
    assert option.against_reference().error().upper == 0
    sections = list(study_sections(found, [], None))[:2]
    assert [one.title for one in sections] == ["Recommended settings", "Settings by the reference alone"]
    assert [one.rows[0][5] for one in sections] == ["1.7%", "0.0%"]


def test_larger_cells_than_those_of_the_study_are_refused() -> None:
    check_cells(earlier(), 0.0024)
    with pytest.raises(CaseError, match=r"--reference: limit has cells of 0\.0025 m.*homogenize\.cell: 0\.0018 m"):
        check_cells(earlier(), 0.0018)


def test_a_results_folder_is_read_with_the_settings_it_was_made_with(tmp_path: Path) -> None:
    def stiffer(files: dict) -> None:
        files["plan"]["dem"]["youngs_modulus_pa"] = 7e6  # as a run has it whose bed was too soft

    run = read_reference(results(tmp_path / "run", stiffer), CASE)
    assert run.plan.dem.youngs_modulus == 7e6
    assert run.plan.dem.plate_speed == SLOW
    assert run.plan.dem.classes.sauter_diameter == pytest.approx(OWN)
    assert (run.blocks, run.seconds, run.travel) == (30.0, 500.0, 0.3)
    assert len(run.failed) == 1


def test_another_flow_rate_and_other_numerical_settings_are_no_other_scene(tmp_path: Path) -> None:
    run = read_reference(results(tmp_path / "run", flow_rate="5 kg/h", dem__reservoir_height="5 cm"), CASE)
    assert run.plan.case.flow_rate.mass == pytest.approx(5 / 3600)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ({"contact.friction": "0.5"}, r"another vessel or material \(contact\.friction is 0\.5 there, 0\.3 here"),
        ({"material.density": "1200"}, r"material\.density is 1200\.0 there"),
        ({"outline.wall": "[[0.075, 0.12], [0.075, 0.08], [0.06, 0.04], [0.06, -0.04]]"},
         r"outline\.wall differs"),
        ({"dem.walls": "as_drawn", "dem.coarse_grain_factor": "1.2"}, r"set dem\.walls: as_drawn here, too"),
        ({"dem.outlet": "open", "dem.plate_speed": "auto"}, r"outlet is open there, plate here"),
    ],
)  # fmt: skip
def test_another_scene_is_refused_with_what_differs(tmp_path: Path, case: dict[str, str], message: str) -> None:
    folder = tmp_path / "run"
    results(folder, **{key.replace(".", "__"): value for key, value in case.items()})
    with pytest.raises(CaseError, match=message) as refused:
        read_reference(folder, CASE)
    assert str(refused.value).startswith("--reference: ")


def test_a_run_with_other_masses_than_its_case_has_now_is_refused(tmp_path: Path) -> None:
    """As runs before mass scaling are: their plan tells no factor."""
    sizes = "{diameter: {sieve: {edges: [6 mm, 10 mm, 12 mm], fractions: [40 %, 60 %]}}, by: mass}"

    def true_masses(files: dict) -> None:
        assert files["plan"]["dem"].pop("mass_factor") > 1.05

    read_reference(results(tmp_path / "scaled", material__size=sizes), varied(CASE, {"material.size": sizes}))
    with pytest.raises(DataError, match="run it again"):
        read_run(results(tmp_path / "former", true_masses, material__size=sizes))
    read_run(results(tmp_path / "true", dem__mass_scaling="none", material__size=sizes))


def test_another_model_and_a_field_without_errors_are_refused(tmp_path: Path) -> None:
    def fluid(files: dict) -> None:
        files["plan"] = {"model": "fluid"}

    def bare(files: dict) -> None:
        files["field"] = replace(files["field"], flux_r_se=None, flux_z_se=None)

    for name, change, message in (("fluid", fluid, "results of a fluid"), ("bare", bare, "no standard error")):
        with pytest.raises(CaseError, match=message):
            read_reference(results(tmp_path / name, change), CASE)


def test_what_is_damaged_or_no_results_folder_is_refused(tmp_path: Path) -> None:
    folder = results(tmp_path / "run")
    with pytest.raises(CaseError, match="give the results folder that holds it"):
        read_reference(folder / "field.npz", CASE)
    with pytest.raises(CaseError, match="no such folder"):
        read_reference(tmp_path / "nowhere", CASE)
    plan = json.loads((folder / "plan.json").read_text())
    plan["dem"]["time_step_s"] = 1e-3
    (folder / "plan.json").write_text(json.dumps(plan))
    with pytest.raises(CaseError, match=r"plan\.json: missing, damaged or changed"):
        read_reference(folder, CASE)
    (folder / "manifest.json").unlink()
    with pytest.raises(CaseError, match="not a folder that granpipe wrote"):
        read_reference(folder, CASE)
