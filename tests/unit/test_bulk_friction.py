"""From contact to bulk: the law against its shear cells, and where a case's own angles take its place."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import granpipe.fluid.bulk_friction as room
from granpipe.case.schema import Case
from granpipe.errors import CaseError
from granpipe.fluid.bulk_friction import bulk_friction_law
from granpipe.planning.bulk_friction import bulk_friction
from granpipe.planning.make import make_plan

RUNS = json.loads(Path(room.__file__).with_name("bulk_friction.json").read_text())["runs"]


def case(**parts: object) -> Case:
    material = {"density": 2500, "bulk_density": 1450, "size": {"diameter": {"mono": 0.006}}}
    return Case.model_validate(
        {
            "name": "silo",
            "outline": {"wall": [[0.1, 0.4], [0.1, 0.1], [0.04, 0.1], [0.04, 0.0]]},
            "material": material | dict(parts.pop("material", {})),  # type: ignore[call-overload]
            "flow_rate": "0.2 kg/s",
            "model": "fluid",
            "fluid": {"rheology": "frictional"},
        }
        | parts
    )


@pytest.mark.parametrize(
    "run", [run for run in RUNS if run["wall"] is None], ids=lambda r: f"{r['friction']}-{r['rolling']}"
)
def test_the_law_meets_the_shear_cells(run: dict[str, float]) -> None:
    assert bulk_friction_law().internal(run["friction"], run["rolling"]) == pytest.approx(run["ratio"], abs=0.03)


def test_a_smooth_wall_slides_at_its_own_friction_and_no_wall_rubs_more_than_the_bulk() -> None:
    law = bulk_friction_law()
    assert law.wall(0.1, 0.5, 0.1) == 0.1
    assert law.wall(5.0, 0.5, 5.0) == law.internal(0.5, 5.0)


def test_friction_of_the_bulk_grows_with_that_of_the_contacts() -> None:
    law = bulk_friction_law()
    values = [law.internal(mu, 0.1) for mu in (0.0, 0.05, 0.3, 1.0, 10.0)]
    assert values == sorted(values)
    assert law.internal(0.5, 0.0) < law.internal(0.5, 0.1) < law.internal(0.5, 0.5) < 1


def test_angles_of_shear_tests_take_the_place_of_the_law() -> None:
    angles = {"internal_friction_angle": "0.5 rad", "wall_friction_angle": "0.3 rad", "repose_angle": "0.6 rad"}
    found = bulk_friction(case(material=angles))
    assert (found.internal, found.wall, found.repose) == pytest.approx((math.sin(0.5), math.tan(0.3), 0.6))


def test_a_flat_bottomed_silo_marks_a_frictional_fluid_and_is_no_viscous_one() -> None:
    plan = make_plan(case())
    assert plan.friction is not None
    assert any("solids rest on the ledge at z = 0.1 m" in breach and "too wide" in breach for breach in plan.breaches)
    hopper = {"wall": [[0.1, 0.4], [0.1, 0.2], [0.04, 0.1], [0.04, 0.0]]}
    assert make_plan(case(outline=hopper)).breaches == ()
    with pytest.raises(CaseError, match="cannot be a fluid"):
        make_plan(case(fluid={"rheology": "viscous"}))


def test_keys_of_the_viscous_fluid_are_refused_beside_it() -> None:
    with pytest.raises(ValueError, match="belongs to rheology: viscous"):
        case(fluid={"rheology": "frictional", "walls": "slip"})
