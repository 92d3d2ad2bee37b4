"""`dem.walls`: what particles see is set back, what the user gets is as drawn; refused where it cannot be right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case, varied
from granpipe.errors import CaseError
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.planning.vessel_text import contents_text
from granpipe.study.points import make_study

CASES = Path(__file__).parents[2] / "cases"
BACK = {"material.size": "{diameter: 1 cm}", "dem.coarse_grain_factor": "2", "dem.walls": "set_back"}


def plan_of(path: Path, **changes: str) -> Plan:
    given = BACK | {key.replace("__", "."): value for key, value in changes.items()}
    return make_plan(load_case(path, given))


def test_particles_see_walls_set_back_by_what_they_are_larger(tiny: Path) -> None:
    plan, drawn = plan_of(tiny), plan_of(tiny, dem__walls="as_drawn")
    assert plan.simulated.r_max == pytest.approx(0.0625)  # half of (2 − 1) × 5 mm
    assert plan.outline.r_max == 0.06
    assert drawn.simulated is drawn.outline
    # openings, particles and speeds are those between the walls that particles see
    gap = {one.name: one for one in plan.decisions}["gap/d90 at the outlet"]
    assert float(gap.value) == pytest.approx(0.125 / 0.02)
    assert plan.dem.particles / drawn.dem.particles == pytest.approx((0.0625 / 0.06) ** 2, rel=0.03)
    (walls,) = (one for one in plan.decisions if one.name == "walls")
    assert walls.value == "back 0.0025 m"
    assert "walls" not in {one.name for one in drawn.decisions}


def test_the_fields_grid_is_that_of_the_vessel_as_drawn(tiny: Path) -> None:
    plan, drawn = plan_of(tiny), plan_of(tiny, dem__walls="as_drawn")
    assert np.array_equal(plan.grid.r_edges, drawn.grid.r_edges)
    assert drawn.deposit_grid is drawn.grid
    wide = plan.deposit_grid
    assert np.array_equal(wide.z_edges, plan.grid.z_edges)
    assert np.array_equal(wide.r_edges[: len(plan.grid.r_edges)], plan.grid.r_edges)
    assert wide.r_edges[-1] >= 0.0625


def test_the_contents_that_are_told_are_those_between_the_walls_set_back(tiny: Path) -> None:
    told, drawn = (contents_text(plan_of(tiny, dem__walls=walls)) for walls in ("set_back", "as_drawn"))
    assert "outlet: 6.25 × d90" in told
    assert "outlet: 6 × d90" in drawn
    more = [int(text.split("particles ")[1].split()[0]) for text in (drawn, told)]
    assert more[1] / more[0] == pytest.approx((0.0625 / 0.06) ** 2, rel=0.01)


def test_of_several_sizes_the_sauter_radius_counts(tiny: Path) -> None:
    sieve = "{diameter: {sieve: {edges: [8 mm, 10 mm, 12 mm], fractions: [50 %, 50 %]}}, by: mass}"
    plan = plan_of(tiny, material__size=sieve)
    assert plan.simulated.r_max - 0.06 == pytest.approx(0.125 * plan.dem.classes.sauter_diameter, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"dem__outlet": "open"}, "walls", "open outlet"),
        ({"homogenize__fields": "[wall_pressure]"}, "fields", "wall_pressure"),
        ({"homogenize__fields": "[residence_time, stress]", "homogenize__method": "psi"}, "fields", "stress"),
        ({"homogenize__fields": "[particle_velocity]"}, "fields", "particle_velocity"),
        (
            {"material__size": "{diameter: 2 cm}", "dem__coarse_grain_factor": "4"},
            1,
            "between walls set back .* only 1.88",
        ),
        ({"material__size": "{diameter: 2.5 cm}", "dem__coarse_grain_factor": "1.1"}, 1, "is 0.12 m wide, only 4.8"),
        ({"outline__obstacles": "{pin: [[0, 4], [0.2, 4], [0.2, 6], [0, 6]]}"}, "pin", "nothing is left"),
    ],
)
def test_what_cannot_be_right_is_refused(tiny: Path, changes: dict[str, str], key: str | int, what: str) -> None:
    with pytest.raises(CaseError, match=what) as refused:
        plan_of(tiny, **changes)
    assert refused.value.key[-1] == key


def test_walls_are_set_back_unless_the_case_says_otherwise_or_it_cannot_be_right(tiny: Path) -> None:
    auto = plan_of(tiny, dem__walls="auto")
    assert auto.set_back is not None
    assert auto.simulated.r_max == plan_of(tiny).simulated.r_max
    for changes, why in [
        ({"dem__outlet": "open"}, "open outlet"),
        ({"homogenize__fields": "[wall_pressure]"}, "wall_pressure is summed over particles"),
        (
            {"material__size": "{diameter: 9 mm}", "outline__obstacles": "{pin: [[0, 4], [0.2, 4], [0.2, 6], [0, 6]]}"},
            "nothing is left",
        ),
    ]:
        plan = plan_of(tiny, dem__walls="auto", **changes)
        assert plan.set_back is None
        (walls,) = (one for one in plan.decisions if one.name == "walls")
        assert walls.value == "as drawn"
        assert why in walls.criterion
    slab = load_case(CASES / "slot_hopper.yaml", {"model": "dem", "dem.coarse_grain_factor": "1.2"})
    assert make_plan(slab).set_back is None
    hybrid = make_plan(load_case(CASES / "reactor_hybrid.yaml"))
    assert all(plan.set_back is None for plan in hybrid.runs)


def test_the_materials_own_particles_see_the_walls_as_drawn(tiny: Path) -> None:
    plan = plan_of(tiny, dem__coarse_grain_factor="1")
    assert plan.set_back is None
    assert "walls" not in {one.name for one in plan.decisions}


def test_a_study_compares_sizes_between_walls_set_back(tiny: Path) -> None:
    case = load_case(tiny, BACK)
    made = make_study(case, 100.0, 1, {"coarse_grain_factor": ["1", "1.5"]})
    walls = {
        one.variant.name: make_plan(varied(made.case, one.variant.changes)).simulated.r_max for one in made.variants
    }
    assert walls == {
        "base": pytest.approx(0.0625),
        "coarse_grain_factor-1": 0.06,
        "coarse_grain_factor-1_5": pytest.approx(0.06125),
    }


def test_a_hybrid_refuses_it() -> None:
    for changes in ({"model": "hybrid"}, {"model": "auto"}):
        with pytest.raises(CaseError, match="model: dem"):
            make_plan(load_case(CASES / "reactor_hybrid.yaml", {"dem.walls": "set_back"} | changes))


def test_a_fluid_has_no_particles_to_set_walls_back_for() -> None:
    plan = make_plan(load_case(CASES / "hopper.yaml", {"dem.walls": "set_back", "model": "fluid"}))
    assert plan.set_back is None


def test_what_was_not_compared_with_the_materials_own_particles_is_noted(tiny: Path) -> None:
    def noted(**changes: str) -> bool:
        return any("own particles" in one for one in plan_of(tiny, **changes).warnings)

    assert not noted()
    assert noted(material__size="{diameter: 6 mm}", dem__coarse_grain_factor="2.5")
