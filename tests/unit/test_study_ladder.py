"""The ladder of a study: axes, equal travel, what the scene and the budget allow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from granpipe.case.reader import load_case, varied
from granpipe.errors import CaseError
from granpipe.planning.plan import make_plan
from granpipe.study.ladder import BASE, BEST, CHEAP, Basis, Rung, affordable, ladder, read_axes
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


def along(rungs, axis: str) -> list[dict[str, str]]:
    return [rung.variant.changes for rung in rungs if rung.axis == axis]


def test_the_case_itself_comes_first(case) -> None:
    rungs = ladder(case, BASIS, every)
    assert rungs[0] == Rung("", Variant(BASE, {}))
    assert len({rung.variant.name for rung in rungs}) == len(rungs)


def test_particles_are_never_smaller_than_the_material(case) -> None:
    factors = {
        float(changes["dem.coarse_grain_factor"])
        for changes in along(ladder(case, BASIS, every), "coarse_grain_factor")
    }
    assert min(factors) == 1
    assert max(factors) == pytest.approx(1.875)


def test_another_plate_speed_means_equal_travel(case) -> None:
    for changes in along(ladder(case, BASIS, every), "plate_speed"):
        speed, time, start = (
            float(changes[f"{key}"]) for key in ("dem.plate_speed", "dem.max_time", "homogenize.start")
        )
        assert speed * time == pytest.approx(0.02 * case.dem.max_time)
        assert speed * start == pytest.approx(0.02 * float(case.homogenize.start))


def test_replicas_share_the_averaging_time(case) -> None:
    (changes,) = along(ladder(case, BASIS, every), "replicas")
    start = float(case.homogenize.start)
    assert 2 * (float(changes["dem.max_time"]) - start) == pytest.approx(case.dem.max_time - start)


def test_other_fillings_are_none_that_replicas_take(case) -> None:
    rungs = ladder(case, replace(BASIS, cores=2), every)
    seeds = [int(changes["dem.seed"]) for axis in ("seed", "ranks") for changes in along(rungs, axis)]
    assert len(set(seeds)) == 2
    assert min(seeds) > case.dem.seed + 100


def test_ranks_are_varied_only_where_there_are_cores(case) -> None:
    assert not along(ladder(case, BASIS, every), "ranks")


def test_the_best_point_is_finest_in_two_fillings(case) -> None:
    (changes,) = along(ladder(case, BASIS, every), BEST)
    assert float(changes["dem.coarse_grain_factor"]) == 1
    assert changes["dem.replicas"] == "2"


def test_the_cheapest_point_is_coarsest_and_fastest(case) -> None:
    (changes,) = along(ladder(case, BASIS, every), CHEAP)
    assert float(changes["dem.coarse_grain_factor"]) == pytest.approx(1.875)
    assert float(changes["dem.plate_speed"]) == 0.04


def test_facets_of_other_walls_can_be_quartered(case) -> None:
    facets = [int(changes["dem.facets"]) for changes in along(ladder(case, BASIS, every), "facets")]
    assert facets == [8, 32]


def test_values_of_the_user_take_the_place_of_the_usual_ones(case) -> None:
    axes = read_axes(["coarse_grain_factor=3, 1", "plate_speed=4 cm/s", "seed"])
    rungs = ladder(case, BASIS, every, axes)
    factors = [changes["dem.coarse_grain_factor"] for changes in along(rungs, "coarse_grain_factor")]
    assert factors == ["3", "1"]
    (fast,) = along(rungs, "plate_speed")
    assert float(fast["dem.max_time"]) == pytest.approx(case.dem.max_time / 2)
    assert {rung.axis for rung in rungs} == {"", "coarse_grain_factor", "plate_speed", "seed"}


def test_what_does_not_fit_the_scene_is_left_out(case) -> None:
    rungs = ladder(case, BASIS, no_coarse_graining)
    assert not along(rungs, "coarse_grain_factor")
    assert not along(rungs, BEST)


def test_an_open_outlet_has_no_plate_to_vary(case) -> None:
    assert not along(ladder(case, replace(BASIS, plate_speed=0.0), every), "plate_speed")


def test_a_fluid_varies_in_its_model_only(case) -> None:
    rungs = ladder(case, Basis(0, 0, 0, 0, 0, "fluid", ("fluid", "hybrid")), every)
    assert [rung.axis for rung in rungs] == ["", "model"]


def test_the_dearest_are_dropped_but_never_the_case() -> None:
    rungs = [Rung("", Variant(BASE, {})), *(Rung("x", Variant(name, {})) for name in ("a", "b", "c"))]
    costs = {BASE: 50.0, "a": 5.0, "b": 20.0, "c": 10.0}
    kept, dropped = affordable(rungs, lambda rung: costs[rung.variant.name], 66.0)
    assert [rung.variant.name for rung in kept] == [BASE, "a", "c"]
    assert [rung.variant.name for rung in dropped] == ["b"]
    kept, _ = affordable(rungs, lambda rung: costs[rung.variant.name], 1.0)
    assert [rung.variant.name for rung in kept] == [BASE]


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("colour", "there are model, coarse_grain_factor"),
        ("best=3", "takes no values"),
        ("plate_speed=", "no values in 'plate_speed='"),
    ],
)
def test_an_axis_that_there_is_not_is_refused(word, told) -> None:
    with pytest.raises(CaseError, match=told):
        read_axes([word])


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("plate_speed=auto", "auto is no value to go to"),
        ("plate_speed=abc", "abc"),
        ("coarse_grain_factor=0.5", r"must be in \[1, 100\]"),
        ("coarse_grain_factor=3", "too large for the throat"),
        ("seed=1", "that is what the case has"),
    ],
)
def test_a_wrong_value_of_the_user_says_why(case, word, told) -> None:
    with pytest.raises(CaseError, match=told) as caught:
        ladder(case, BASIS, no_coarse_graining, read_axes([word]))
    assert str(caught.value).startswith(f"--axis {word}")


@pytest.mark.parametrize("text", ["150 %", "3/2"])
def test_values_are_written_as_in_a_case(case, text) -> None:
    rungs = ladder(case, BASIS, every, read_axes([f"coarse_grain_factor={text}"]))
    (rung,) = (rung for rung in rungs if rung.axis)
    assert varied(case, rung.variant.changes).dem.coarse_grain_factor == 1.5


def test_an_axis_along_which_nothing_is_possible_is_refused(case) -> None:
    with pytest.raises(CaseError, match="nothing along plate_speed"):
        ladder(case, replace(BASIS, plate_speed=0.0), every, read_axes(["plate_speed=0.1"]))


def test_all_points_have_one_grid_as_fine_as_the_smallest_particles_need(case) -> None:
    study = make_study(case, 10, 2, read_axes(["coarse_grain_factor", "plate_speed"]))
    plans = [make_plan(varied(study.case, rung.variant.changes | {"dem.ranks": "1"})) for rung in study.rungs]
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
    assert [rung.variant.name for rung in study.rungs] == [BASE]
    assert study.dropped
