"""Picking a setting by its total error: the right scene, the cheapest that is good enough, told honestly."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from granpipe.case.reader import CaseFile, load_case, read_case, varied
from granpipe.dem.contact import filling_angle
from granpipe.errors import CaseError, DataError
from granpipe.planning.make import make_plan
from granpipe.study import recommend as study_recommend
from granpipe.study.budget import ErrorBound, Option
from granpipe.study.points import make_study
from granpipe.study.recommend import carried_over, recommend, shipped
from granpipe.study.report import read_study

SMOKE = Path(__file__).parents[2] / "cases" / "smoke.yaml"


def option(
    point: str,
    method: str,
    seconds: float,
    noise: float,
    rest: float,
    changes: dict[str, str],
    upper: float | None = None,
    blocks: float = 1e4,
) -> Option:
    part = {"whole": ErrorBound(rest, upper or rest)}
    return Option(point, method, 1.0, seconds, 1, {"whole": noise}, blocks, part, changes)


OPTIONS = [
    option(
        "fast",
        "psi",
        10,
        0.08,
        0.06,
        {"dem.plate_speed": "0.05", "dem.max_time": "3", "homogenize.start": "1", "dem.seed": "1001"},
    ),
    option("base", "raw", 5, 0.03, 0.0, {}),
    option("base", "psi", 40, 0.03, 0.0, {"dem.max_time": "7"}),
]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Results with a study of the smoke scene."""
    folder = tmp_path / "smoke-study"
    folder.mkdir()
    write_study(folder / "study.json")
    return tmp_path


@pytest.fixture
def brought_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same study, but one of granpipe's own."""
    monkeypatch.setattr(study_recommend, "SHIPPED", tmp_path / "shipped")
    (tmp_path / "shipped").mkdir()
    write_study(tmp_path / "shipped" / "smoke.json")


def write_study(file: Path, fill_angle: float | None = None, options: list[Option] = OPTIONS, **changes: str) -> None:
    settings = {key.replace("__", "."): text for key, text in changes.items()}
    case = make_study(load_case(SMOKE, settings), 1, 1, {"plate_speed": []}).case
    now = math.degrees(filling_angle(case.contact.friction, case.contact.rolling_friction))
    stored = {
        "case": case.model_dump(mode="json", exclude_none=True),
        "fill_angle_deg": now if fill_angle is None else fill_angle,
        "options": [asdict(one) for one in options],
        "unknown": ["time_step"],
    }
    file.write_text(json.dumps(stored))


def smoke(**changes: str) -> CaseFile:
    return read_case(SMOKE, {key.replace("__", "."): text for key, text in changes.items()})


def test_the_cheapest_that_is_good_enough_is_taken_with_its_settings(results: Path) -> None:
    chosen = recommend(smoke(), results, 0.11)
    assert chosen.option.point == "fast"
    assert chosen.proven
    assert chosen.file.case.dem.plate_speed == 0.05
    assert chosen.file.case.homogenize.start == 1
    assert "10.0%" in chosen.expected


def test_an_option_of_few_blocks_takes_the_time_until_a_run_has_enough(results: Path) -> None:
    """Ten blocks in 30 s are twenty in 60 s; the plain time of an average with smoothing, which no noise ends."""
    few, many = (
        option("base", "psi", time, 0.03, 0.0, {"dem.max_time": str(n)}, blocks=n) for time, n in ((30, 10), (50, 20))
    )
    own_study(results, few, many)
    assert "in 50 s on one core" in recommend(smoke(), results, 0.05).expected
    own_study(results, few)
    assert "in 60 s on one core" in recommend(smoke(), results, 0.05).expected
    own_study(results, replace(few, changes={"homogenize.method": "gaussian"}))
    assert "in 30 s on one core" in recommend(smoke(), results, 0.05).expected


def test_a_tighter_tolerance_takes_a_dearer_one_and_never_the_plain_average(results: Path) -> None:
    chosen = recommend(smoke(), results, 0.05)
    assert (chosen.option.point, chosen.option.method) == ("base", "psi")


def test_flow_rate_pictures_and_seed_stay_those_of_the_case(results: Path) -> None:
    case = recommend(smoke(flow_rate="3 kg/h", figures="[rz]", dem__seed="5"), results, 0.11).file.case
    assert case.flow_rate.mass == pytest.approx(3 / 3600)
    assert case.figures == ("rz",)
    assert case.dem.seed == 5


def own_study(results: Path, *options: Option) -> None:
    write_study(results / "smoke-study" / "study.json", options=list(options))


def test_a_run_ends_when_noise_makes_the_total(results: Path) -> None:
    """3-4-5: an estimate of 4 % leaves 3 % of 5 % for the noise; the run may take longer than the study's."""
    own_study(results, option("base", "psi", 40, 0.02, 0.04, {"dem.max_time": "7"}, upper=0.06))
    chosen = recommend(smoke(), results, 0.05)
    assert not chosen.proven
    assert chosen.file.case.dem.statistical_error == pytest.approx(0.03, rel=1e-3)
    assert chosen.file.case.dem.max_time == "auto"
    assert "ends when the statistical error is 3.0% in every section, which with 4.0% of systematic" in chosen.expected


def test_of_a_proven_option_the_bounds_make_the_total(results: Path) -> None:
    """At most 4 %, and a noise of 20 blocks, which at 95 % is at most 1.37 times what it is found to be."""
    own_study(results, option("base", "psi", 40, 0.02, 0.01, {"dem.max_time": "7"}, upper=0.04))
    chosen = recommend(smoke(), results, 0.05)
    assert chosen.proven
    noise = chosen.file.case.dem.statistical_error
    assert noise is not None
    assert math.hypot(noise * math.sqrt(19 / 10.117), 0.04) == pytest.approx(0.05, rel=1e-3)
    assert "with at most 4.0% of systematic" in chosen.expected


def test_a_systematic_error_above_the_total_is_refused_with_the_remedy(results: Path) -> None:
    own_study(results, option("base", "psi", 40, 0.001, 0.051, {"dem.max_time": "7"}))
    with pytest.raises(
        CaseError, match=r"the best has 5\.1%; a study with a smaller dem\.coarse_grain_factor, a slower"
    ):
        recommend(smoke(), results, 0.05)


def test_a_target_of_the_case_gives_way_to_the_total(results: Path) -> None:
    asked = [recommend(smoke(dem__statistical_error=text), results, 0.11).file.case.dem for text in ("1 %", "20 %")]
    assert asked[0] == asked[1]


@pytest.mark.parametrize(("method", "blocks"), [("psi", math.inf), ("gaussian", 12.0)])
def test_where_no_noise_is_known_the_length_is_the_studys(results: Path, method: str, blocks: float) -> None:
    changes = {"dem.max_time": "7", "homogenize.method": method}
    own_study(results, option("base", method, 40, 0.02, 0.0, changes, blocks=blocks))
    chosen = recommend(smoke(dem__statistical_error="1 %"), results, 0.05)
    assert (chosen.file.case.dem.statistical_error, chosen.file.case.dem.max_time) == (None, 7)
    assert "ends when" not in chosen.expected


def test_nothing_good_enough_names_the_best(results: Path) -> None:
    with pytest.raises(CaseError, match=r"the best has 3\.0%"):
        recommend(smoke(), results, 0.01)


def test_a_study_of_another_way_of_filling_is_marked(results: Path) -> None:
    assert "filled" not in recommend(smoke(), results, 0.11).expected
    write_study(results / "smoke-study" / "study.json", fill_angle=30.0)
    assert "marked: the study filled vessels up to 30° below edges" in recommend(smoke(), results, 0.11).expected


def test_what_the_study_could_not_tell_is_named(results: Path) -> None:
    assert "(not counting time_step, which the study did not vary)" in recommend(smoke(), results, 0.11).expected


def test_a_bulk_density_does_not_make_another_scene(results: Path) -> None:
    assert not recommend(smoke(material__bulk_density="600 kg/m^3"), results, 0.11).guessed


def test_a_study_of_another_material_is_refused(results: Path) -> None:
    with pytest.raises(CaseError, match="another vessel or material"):
        recommend(smoke(contact__friction="0.5"), results, 0.11)


def test_without_any_study_the_remedy_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_recommend, "SHIPPED", tmp_path / "none")
    with pytest.raises(CaseError, match="granpipe study"):
        recommend(smoke(), tmp_path, 0.11)


@pytest.mark.usefixtures("brought_along")
def test_a_study_that_granpipe_brings_along_counts_for_its_scene(tmp_path: Path) -> None:
    chosen = recommend(smoke(), tmp_path, 0.11)
    assert (chosen.option.point, chosen.guessed) == ("fast", False)
    assert "granpipe's study of smoke" in chosen.expected


@pytest.mark.usefixtures("brought_along")
def test_for_another_scene_its_setting_is_a_guess_in_that_scenes_measures(tmp_path: Path) -> None:
    chosen = recommend(smoke(material__size="{diameter: 1 cm}"), tmp_path, 0.05)
    assert chosen.guessed
    assert "a guess, which granpipe study would test" in chosen.expected
    there, here = make_plan(smoke(dem__max_time="7").case), make_plan(chosen.file.case)
    assert here.dem.classes.d90 == pytest.approx(there.dem.classes.d90, rel=1e-3)
    assert here.case.dem.coarse_grain_factor == pytest.approx(2, rel=1e-3)


def test_carried_over_settings_are_equal_in_the_measures_of_both_scenes() -> None:
    model = make_plan(smoke(dem__plate_speed="5 cm/s").case)
    wall = [(2 * r, 2 * z) for r, z in model.case.outline.wall]
    sections = {"a": [wall[0][1], wall[-1][1]]}
    case = smoke(outline__wall=json.dumps(wall), outline__sections=json.dumps(sections), outline__unit="m").case
    plan = make_plan(varied(case, carried_over(model, case)))
    assert plan.case.dem.coarse_grain_factor == pytest.approx(2, rel=1e-3)
    pace = [p.dem.plate_speed / make_plan(varied(p.case, {"dem.plate_speed": "auto"})).dem.plate_speed
            for p in (model, plan)]  # fmt: skip
    assert pace[0] == pytest.approx(pace[1], rel=0.01)


def test_walls_are_set_back_as_the_studys_were_where_a_scene_allows_it() -> None:
    material = {"material__size": "{diameter: 8 mm}", "dem__coarse_grain_factor": "1.5"}
    model = make_plan(smoke(dem__walls="set_back", **material).case)
    assert carried_over(model, smoke(**material).case)["dem.walls"] == "auto"
    slab = load_case(Path(__file__).parents[2] / "cases" / "slot_hopper.yaml", {"model": "dem"})
    assert make_plan(varied(slab, carried_over(model, slab))).set_back is None
    drawn = make_plan(smoke(dem__walls="as_drawn", **material).case)
    assert carried_over(drawn, smoke(**material).case)["dem.walls"] == "as_drawn"


def test_every_study_that_granpipe_brings_along_can_be_read() -> None:
    for study in shipped():
        assert read_study(study).options


def test_afterwards_it_says_what_it_got(results: Path) -> None:
    chosen = recommend(smoke(), results, 0.11)
    folder = results / "smoke"
    folder.mkdir()
    provenance = {"case": "a", "wall_seconds": 12.3, "quality": [], "figures": {"statistical_error": {"whole": 0.08}}}
    (folder / "provenance.json").write_text(json.dumps(provenance))
    assert chosen.obtained(folder) == "took 12 s; error 10.0%: 8.0% statistical as measured now, 6.0% from the study"


def test_its_95_percent_bound_counts_how_many_blocks_the_noise_rests_on(results: Path) -> None:
    """3-4-5 once more: 20 blocks may be 1.37 times too small."""
    own_study(results, option("base", "psi", 40, 0.02, 0.03, {"dem.max_time": "7"}, upper=0.04))
    chosen, folder = recommend(smoke(), results, 0.05), results / "smoke"
    folder.mkdir()
    figures = {"statistical_error": {"whole": 0.03 / math.sqrt(19 / 10.117)}, "effective_blocks": 20.0}
    provenance = {"case": "a", "wall_seconds": 12.3, "quality": [], "figures": figures}
    (folder / "provenance.json").write_text(json.dumps(provenance))
    assert "error 3.7%, at most 5.0%: 2.2% statistical as measured now" in chosen.obtained(folder)


def test_the_average_begins_as_that_of_the_study_did(results: Path, tmp_path: Path) -> None:
    """A start that was given is part of what the study measured; one that it found, the run finds from its own data."""
    assert recommend(smoke(), results, 0.11).file.case.homogenize.start == 1  # of the option, at its own speed
    write_study(tmp_path / "smoke-study" / "study.json", options=[OPTIONS[-1]], homogenize__start="auto")
    found = recommend(smoke(homogenize__start="3 s", dem__start_speed="0.026"), tmp_path, 0.05).file.case
    assert (found.homogenize.start, found.dem.start_speed) == ("auto", "auto")


def test_what_is_marked_and_what_is_set_is_told_before_the_run(results: Path) -> None:
    told = recommend(smoke(), results, 0.11).expected.splitlines()
    assert any(line.startswith("settings: ") and "dem.plate_speed = 0.05" in line for line in told)
    assert any(line.startswith("marked: plate_speed") and "too fast" in line for line in told)


def test_a_damaged_study_is_told(tmp_path: Path) -> None:
    (tmp_path / "smoke-study").mkdir()
    (tmp_path / "smoke-study" / "study.json").write_text("{}")
    with pytest.raises(DataError, match=r"damaged \(case: Field required\); run the study again"):
        recommend(smoke(), tmp_path, 0.11)


def test_the_walls_that_are_recommended_are_those_of_the_study_whatever_the_case_says(tmp_path: Path) -> None:
    (tmp_path / "smoke-study").mkdir()
    write_study(tmp_path / "smoke-study" / "study.json", options=[OPTIONS[-1]], dem__walls="as_drawn")
    back = smoke(dem__walls="set_back", dem__coarse_grain_factor="1.5")
    assert recommend(back, tmp_path, 0.05).file.case.dem.walls == "as_drawn"


@pytest.mark.usefixtures("brought_along")
def test_so_are_those_that_are_guessed_from_another_scene(tmp_path: Path) -> None:
    back = smoke(dem__walls="set_back", dem__coarse_grain_factor="1.5", material__size="{diameter: 1 cm}")
    assert recommend(back, tmp_path, 0.05).file.case.dem.walls == "as_drawn"
