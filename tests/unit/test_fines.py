"""`dem.fines: left_out`: what is left out, what that saves, and where it would be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.dem.sizes import SizeClasses, simulated_classes
from granpipe.errors import CaseError
from granpipe.planning.plan import Plan, make_plan
from granpipe.study.points import make_study

CASES = Path(__file__).parents[2] / "cases"
WIDE = "{diameter: {sieve: {edges: [4 mm, 8 mm, 12 mm], fractions: [5 %, 95 %]}}, by: mass}"


def plan_of(path: Path, **changes: str) -> Plan:
    given = {"material.size": WIDE, "dem.fines": "left_out"}
    return make_plan(load_case(path, given | {key.replace("__", "."): value for key, value in changes.items()}))


def test_the_finest_classes_go_as_long_as_they_are_a_tenth_of_the_mass() -> None:
    """Of volumes 1, 8, 27 and 64 in numbers 4, 1, 1, 1 the first two are 4 and 12 of 103 parts, the first alone 4."""
    classes = SizeClasses(np.array([1.0, 2.0, 3.0, 4.0]), np.array([4, 1, 1, 1]) / 7)
    coarse = classes.without_fines()
    assert coarse.radius.tolist() == [2, 3, 4]
    np.testing.assert_allclose(coarse.number_share, 1 / 3)


def test_a_tenth_of_the_mass_is_fines(tiny: Path) -> None:
    plan = plan_of(tiny, material__size=WIDE.replace("[5 %, 95 %]", "[10 %, 90 %]"))
    assert len(plan.dem.classes.radius) == 1


def test_the_test_reactor_loses_its_two_smallest_classes() -> None:
    """Of a normal distribution between 1.5 and 4.5 cm in six classes: those up to 2.5 cm."""
    classes = simulated_classes(load_case(CASES / "reactor.yaml", {"dem.fines": "left_out"}))
    assert len(classes.radius) == 4
    assert 2 * 2.5e-2 < classes.smallest < 2 * 3e-2  # enlarged twice


def test_the_time_step_grows_with_the_smallest_particle(tiny: Path) -> None:
    coarse, given = (
        plan_of(tiny, dem__fines=fines, contact__youngs_modulus="5e6") for fines in ("left_out", "simulated")
    )
    smallest = coarse.dem.classes.smallest / given.dem.classes.smallest
    assert smallest > 1.4
    assert coarse.dem.time_step / given.dem.time_step == pytest.approx(smallest, rel=0.05)  # two digits
    assert coarse.dem.particles < given.dem.particles
    (told,) = (one for one in coarse.decisions if one.name == "fines left out")
    assert told.criterion.startswith("5.0% of the mass")
    assert f"{smallest:.2g} times the time step" in told.criterion
    assert any("docs/validation/fines.md" in note for note in coarse.warnings)
    assert "fines left out" not in {one.name for one in given.decisions}


def test_openings_are_held_against_all_sizes_of_the_material(tiny: Path) -> None:
    gaps = [{one.name: one for one in plan_of(tiny, dem__fines=fines).decisions} for fines in ("left_out", "simulated")]
    assert gaps[0]["gap/d90 at the outlet"] == gaps[1]["gap/d90 at the outlet"]


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"material__size": "{diameter: 1 cm}"}, "fines", r"has 100\.0% of the mass"),
        (
            {"material__size": WIDE.replace("[5 %, 95 %]", "[20 %, 80 %]")},
            "fines",
            r"has 20\.0% of the mass, and fines are at most 10%",
        ),
        ({"dem__outlet": "open"}, "fines", "free discharge"),
        ({"homogenize__fields": "[size_classes]"}, "fields", "size_classes"),
        ({"homogenize__fields": "[mixing]"}, "fields", "mixing tells of sizes, some"),
    ],
)
def test_what_cannot_be_right_is_refused(tiny: Path, changes: dict[str, str], key: str, what: str) -> None:
    with pytest.raises(CaseError, match=what) as refused:
        plan_of(tiny, **changes)
    assert refused.value.key[-1] == key


def test_a_study_tells_what_fines_change() -> None:
    case = load_case(CASES / "smoke.yaml", {"material.size": WIDE})
    variants = make_study(case, 1000.0, 1).variants
    assert [one.variant.changes for one in variants if one.axis == "fines"] == [{"dem.fines": "left_out"}]


def test_a_study_without_fines_needs_a_reference_that_has_them() -> None:
    case = load_case(CASES / "smoke.yaml", {"material.size": WIDE, "dem.fines": "left_out"})
    with pytest.raises(CaseError, match="--reference") as refused:
        make_study(case, 1.0, 1)
    assert refused.value.key == ("dem", "fines")
    assert any(one.axis == "fines" for one in make_study(case, 10.0, 1, referred=True).variants)
