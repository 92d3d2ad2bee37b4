"""The variants of a study: axes, equal travel, what the scene and the budget allow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from granpipe.case.reader import load_case, varied
from granpipe.errors import CaseError
from granpipe.planning.make import make_plan
from granpipe.study import findings
from granpipe.study.axes import (
    BASE,
    BEST,
    CHEAP,
    FILLINGS,
    FINEST_SPEED,
    LIMITED,
    Basis,
    StudyVariant,
    affordable,
    point_variants,
    read_axes,
    read_point,
    study_variants,
)
from granpipe.study.points import COARSEST, make_study
from granpipe.sweep.variants import Variant

CASES = Path(__file__).parents[2] / "cases"
SMALL = {"material.size": "{diameter: 1.6 cm}", "dem.coarse_grain_factor": "1.25"}
BASIS = Basis(1e6, 1e-4, 0.02, 0.1, 16, "dem", ("dem",))


@pytest.fixture(scope="module")
def case():
    return load_case(CASES / "smoke.yaml", SMALL)


def every(variant: Variant) -> None:
    """Refuses nothing."""


def no_coarse_graining(variant: Variant) -> CaseError | None:
    return CaseError("too large for the throat") if "dem.coarse_grain_factor" in variant.changes else None


def along(variants, axis: str) -> list[dict[str, str]]:
    return [one.variant.changes for one in variants if one.axis == axis]


def test_the_case_itself_comes_first(case) -> None:
    variants = study_variants(case, BASIS, every)
    assert variants[0] == StudyVariant("", Variant(BASE, {}))
    assert len({one.variant.name for one in variants}) == len(variants)


def test_particles_are_never_smaller_than_the_material(case) -> None:
    factors = {
        float(changes["dem.coarse_grain_factor"])
        for changes in along(study_variants(case, BASIS, every), "coarse_grain_factor")
    }
    assert min(factors) == 1
    assert max(factors) == pytest.approx(1.875)


def test_another_plate_speed_means_equal_travel(case) -> None:
    for changes in along(study_variants(case, BASIS, every), "plate_speed"):
        speed, time, start = (
            float(changes[f"{key}"]) for key in ("dem.plate_speed", "dem.max_time", "homogenize.start")
        )
        assert speed * time == pytest.approx(0.02 * case.dem.max_time)
        assert speed * start == pytest.approx(0.02 * float(case.homogenize.start))


def test_replicas_share_the_averaging_time(case) -> None:
    (changes,) = along(study_variants(case, BASIS, every), "replicas")
    start = float(case.homogenize.start)
    assert 2 * (float(changes["dem.max_time"]) - start) == pytest.approx(case.dem.max_time - start)


def test_other_fillings_are_none_that_replicas_take(case) -> None:
    variants = study_variants(case, replace(BASIS, cores=2), every)
    seeds = [int(changes["dem.seed"]) for axis in ("seed", "ranks") for changes in along(variants, axis)]
    assert len(set(seeds)) == 2
    assert min(seeds) > case.dem.seed + 100


def test_ranks_are_varied_only_where_there_are_cores(case) -> None:
    assert not along(study_variants(case, BASIS, every), "ranks")


def test_the_best_point_is_finest_in_two_fillings(case) -> None:
    (changes,) = along(study_variants(case, BASIS, every), BEST)
    assert float(changes["dem.coarse_grain_factor"]) == 1
    assert changes["dem.replicas"] == "2"


def test_the_cheapest_point_is_coarsest_and_fastest(case) -> None:
    (changes,) = along(study_variants(case, BASIS, every), CHEAP)
    assert float(changes["dem.coarse_grain_factor"]) == pytest.approx(1.875)
    assert float(changes["dem.plate_speed"]) == 0.04


def test_the_finest_particles_are_run_at_every_plate_speed(case) -> None:
    found = along(study_variants(case, BASIS, every), FINEST_SPEED)
    assert {float(changes["dem.coarse_grain_factor"]) for changes in found} == {1}
    speeds = {float(changes["dem.plate_speed"]): float(changes["dem.max_time"]) for changes in found}
    assert speeds == {0.04: pytest.approx(case.dem.max_time / 2), 0.01: pytest.approx(case.dem.max_time * 2)}
    asked = study_variants(case, BASIS, every, read_axes(["coarse_grain_factor=1", "plate_speed=0.05", FINEST_SPEED]))
    assert [float(changes["dem.plate_speed"]) for changes in along(asked, FINEST_SPEED)] == [0.05]


def test_points_along_axes_with_a_limit_are_run_in_every_other_filling(case) -> None:
    words = ["seed=7,8", "youngs_modulus=2e6,4e6", "plate_speed=0.05", "facets"]
    variants = study_variants(case, BASIS, every, read_axes([*words, FILLINGS]))
    found = {
        (changes["dem.seed"], changes.get("contact.youngs_modulus"), changes.get("dem.plate_speed"))
        for changes in along(variants, FILLINGS)
    }
    stiff = {(seed, modulus, None) for seed in ("7", "8") for modulus in ("2e6", "4e6")}
    assert found == stiff | {("7", None, "0.05"), ("8", None, "0.05")}
    some = study_variants(case, BASIS, every, read_axes([*words, f"{FILLINGS}=plate_speed"]))
    assert {changes["dem.plate_speed"] for changes in along(some, FILLINGS)} == {"0.05"}
    assert len(along(some, FILLINGS)) == 2


def test_other_fillings_come_with_their_originals_and_only_where_they_are_asked_for(case) -> None:
    assert not along(study_variants(case, BASIS, every), FILLINGS)
    assert not along(study_variants(case, BASIS, every, read_axes(["plate_speed=0.05", "seed=7"])), FILLINGS)
    alone = study_variants(case, BASIS, every, read_axes([f"{FILLINGS}=plate_speed"]))
    assert {one.axis for one in alone} == {"", "plate_speed", "seed", FILLINGS}
    every_axis = study_variants(case, BASIS, every, read_axes([FILLINGS]))
    assert {one.axis for one in every_axis} >= {"coarse_grain_factor", "youngs_modulus", "time_step", "plate_speed"}


def test_facets_of_other_walls_can_be_quartered(case) -> None:
    facets = [int(changes["dem.facets"]) for changes in along(study_variants(case, BASIS, every), "facets")]
    assert facets == [8, 32]


def test_values_of_the_user_take_the_place_of_the_usual_ones(case) -> None:
    axes = read_axes(["coarse_grain_factor=3, 1", "plate_speed=4 cm/s", "seed"])
    variants = study_variants(case, BASIS, every, axes)
    factors = [changes["dem.coarse_grain_factor"] for changes in along(variants, "coarse_grain_factor")]
    assert factors == ["3", "1"]
    (fast,) = along(variants, "plate_speed")
    assert float(fast["dem.max_time"]) == pytest.approx(case.dem.max_time / 2)
    assert {one.axis for one in variants} == {"", "coarse_grain_factor", "plate_speed", "seed"}


def test_a_point_may_have_several_changes(case) -> None:
    changes = read_point("dem.plate_speed=4 cm/s, dem.coarse_grain_factor=1,dem.max_time = 3 s")
    assert changes == {"dem.plate_speed": "4 cm/s", "dem.coarse_grain_factor": "1", "dem.max_time": "3 s"}
    (one,) = point_variants(case, [changes], every)
    made = varied(case, one.variant.changes).dem
    assert (made.plate_speed, made.coarse_grain_factor, made.max_time) == (0.04, 1, 3)
    study = make_study(case, 10, 2, points=[changes, {"dem.seed": "5"}])
    assert [found.axis for found in study.variants] == ["", "point", "point"]


@pytest.mark.parametrize("same", [{"dem.seed": "5"}, {"dem.seed": "5", "dem.ranks": "1"}])
def test_a_point_that_is_on_an_axis_as_well_is_run_once(case, same) -> None:
    study = make_study(case, 10, 2, read_axes(["seed=5"]), points=[same])
    assert [found.axis for found in study.variants] == ["", "seed"]


def test_a_point_with_the_name_of_one_on_an_axis_but_other_settings_is_run(case) -> None:
    study = make_study(case, 10, 2, read_axes(["plate_speed=0.05"]), points=[{"dem.plate_speed": "0.05"}])
    assert [one.variant.name for one in study.variants] == [BASE, "plate_speed-0_05", "plate_speed-0_05-point"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("dem.plate_speed", "no value in 'dem.plate_speed'"),
        ("material.density=3", "material.density is no setting that a point may change"),
        ("dem.seed=2,dem.seed=3", "dem.seed is given twice"),
        ("dem.seed=2,", "no value in ''"),
    ],
)
def test_a_point_without_sense_is_refused(words, told) -> None:
    with pytest.raises(CaseError, match=told) as caught:
        read_point(words)
    assert str(caught.value).startswith(f"--point {words}")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"dem.seed": "x"}, "x"),
        ({"dem.coarse_grain_factor": "3"}, "too large for the throat"),
        ({"dem.seed": "1"}, "that is the point base"),
    ],
)
def test_a_point_that_the_scene_does_not_allow_says_why(case, changes, told) -> None:
    with pytest.raises(CaseError, match=told) as caught:
        list(point_variants(case, [changes], no_coarse_graining))
    assert str(caught.value).startswith("--point dem.")


def test_what_does_not_fit_the_scene_is_left_out(case) -> None:
    variants = study_variants(case, BASIS, no_coarse_graining)
    assert not along(variants, "coarse_grain_factor")
    assert not along(variants, BEST)
    assert not along(variants, FINEST_SPEED)


def test_an_open_outlet_has_no_plate_to_vary(case) -> None:
    assert not along(study_variants(case, replace(BASIS, plate_speed=0.0), every), "plate_speed")


def test_a_fluid_varies_in_its_model_only(case) -> None:
    variants = study_variants(case, Basis(0, 0, 0, 0, 0, "fluid", ("fluid", "hybrid")), every)
    assert [one.axis for one in variants] == ["", "model"]


def test_the_dearest_are_dropped_but_never_the_case() -> None:
    variants = [
        StudyVariant("", Variant(BASE, {})),
        *(StudyVariant("x", Variant(name, {})) for name in ("a", "b", "c")),
    ]
    costs = {BASE: 50.0, "a": 5.0, "b": 20.0, "c": 10.0}
    kept, dropped = affordable(variants, lambda one: costs[one.variant.name], 66.0)
    assert [one.variant.name for one in kept] == [BASE, "a", "c"]
    assert [one.variant.name for one in dropped] == ["b"]
    kept, _ = affordable(variants, lambda one: costs[one.variant.name], 1.0)
    assert [one.variant.name for one in kept] == [BASE]


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("colour", "choose from model, coarse_grain_factor"),
        ("best=3", "takes no values"),
        ("plate_speed=", "no values in 'plate_speed='"),
        ("fillings=facets", "facets is not an axis to be repeated; choose from coarse_grain_factor, mass_scaling"),
    ],
)
def test_an_axis_that_there_is_not_is_refused(word, told) -> None:
    with pytest.raises(CaseError, match=told):
        read_axes([word])


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("plate_speed=auto", "auto is not a value"),
        ("plate_speed=abc", "abc"),
        ("coarse_grain_factor=0.5", r"must be in \[1, 100\]"),
        ("coarse_grain_factor=3", "too large for the throat"),
        ("seed=1", "this is the case itself"),
    ],
)
def test_a_wrong_value_of_the_user_says_why(case, word, told) -> None:
    with pytest.raises(CaseError, match=told) as caught:
        study_variants(case, BASIS, no_coarse_graining, read_axes([word]))
    assert str(caught.value).startswith(f"--axis {word}")


@pytest.mark.parametrize("text", ["150 %", "3/2"])
def test_values_are_written_as_in_a_case(case, text) -> None:
    variants = study_variants(case, BASIS, every, read_axes([f"coarse_grain_factor={text}"]))
    (one,) = (one for one in variants if one.axis)
    assert varied(case, one.variant.changes).dem.coarse_grain_factor == 1.5


def test_an_axis_along_which_nothing_is_possible_is_refused(case) -> None:
    with pytest.raises(CaseError, match="no variant along plate_speed"):
        study_variants(case, replace(BASIS, plate_speed=0.0), every, read_axes(["plate_speed=0.1"]))


def test_all_points_have_one_grid_as_fine_as_the_smallest_particles_need(case) -> None:
    study = make_study(case, 10, 2, read_axes(["coarse_grain_factor", "plate_speed"]))
    plans = [make_plan(varied(study.case, one.variant.changes | {"dem.ranks": "1"})) for one in study.variants]
    assert len({plan.grid.cell for plan in plans}) == 1
    finest = min(part.dem.classes.sauter_diameter for plan in plans for part in plan.runs)
    assert plans[0].grid.cell <= finest / 4
    assert plans[0].grid.shape[0] % COARSEST == 0


def test_a_target_does_not_end_the_points_early(case) -> None:
    targeted = load_case(CASES / "smoke.yaml", SMALL | {"dem.statistical_error": "20 %"})
    study = make_study(targeted, 10, 2)
    assert study.case.dem.statistical_error is None


def test_a_small_budget_leaves_the_case_and_says_what_was_dropped(case) -> None:
    study = make_study(case, 1e-6, 1)
    assert [one.variant.name for one in study.variants] == [BASE]
    assert study.dropped


def test_axes_that_have_a_limit_are_those_that_can_be_repeated_in_other_fillings() -> None:
    assert set(LIMITED) == set(findings.SETTING)
