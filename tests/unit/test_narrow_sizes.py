"""`dem.sizes: narrow`: what stands for many sizes, what it saves, and where it would be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.dem.sizes import SizeClasses, simulated_classes
from granpipe.errors import CaseError
from granpipe.planning.plan import Plan, make_plan
from granpipe.study.axes import study_variants
from granpipe.study.points import make_study
from tests.unit.test_study_axes import BASIS, every

CASES = Path(__file__).parents[2] / "cases"
WIDE = "{diameter: {sieve: {edges: [4 mm, 8 mm, 12 mm], fractions: [50 %, 50 %]}}, by: mass}"


def plan_of(path: Path, **changes: str) -> Plan:
    given = {"material.size": WIDE, "dem.sizes": "narrow"}
    return make_plan(load_case(path, given | {key.replace("__", "."): value for key, value in changes.items()}))


def test_narrow_sizes_keep_the_volume_over_surface_of_all_sizes() -> None:
    """Spheres of radius 1 and 2, eight to one: Σ r³ / Σ r² = 16 / 12."""
    narrow = SizeClasses(np.array([1.0, 2.0]), np.array([8 / 9, 1 / 9])).narrow()
    volume, surface = narrow.number_share @ narrow.radius**3, narrow.number_share @ narrow.radius**2
    assert volume / surface == pytest.approx(4 / 3, rel=1e-12)
    assert narrow.number_share.sum() == pytest.approx(1)
    np.testing.assert_allclose(narrow.radius / narrow.radius[1], [0.93, 1, 1.07])


def test_narrow_sizes_are_enlarged_as_all_sizes_are(tiny: Path) -> None:
    case = load_case(tiny, {"material.size": WIDE, "dem.sizes": "narrow", "dem.coarse_grain_factor": "1.5"})
    own = load_case(tiny, {"material.size": WIDE})
    assert simulated_classes(case).sauter_diameter == pytest.approx(1.5 * simulated_classes(own).sauter_diameter)


def test_the_time_step_grows_with_the_smallest_particle(tiny: Path) -> None:
    narrow, given = (plan_of(tiny, dem__sizes=sizes, contact__youngs_modulus="5e6") for sizes in ("narrow", "as_given"))
    smallest = narrow.dem.classes.smallest / given.dem.classes.smallest
    assert smallest > 1.15
    assert narrow.dem.time_step / given.dem.time_step == pytest.approx(smallest, rel=0.05)  # two digits
    (told,) = (one for one in narrow.decisions if one.name == "sizes")
    assert f"{smallest:.2g} times the time step" in told.criterion
    assert "sizes" not in {one.name for one in given.decisions}


def test_openings_are_held_against_the_largest_particles_of_the_material(tiny: Path) -> None:
    gaps = [{one.name: one for one in plan_of(tiny, dem__sizes=sizes).decisions} for sizes in ("narrow", "as_given")]
    assert gaps[0]["gap/d90 at the outlet"] == gaps[1]["gap/d90 at the outlet"]


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"material__size": "{diameter: 1 cm}"}, "sizes", "as narrow already, 0.01 … 0.01 m"),
        ({"dem__outlet": "open"}, "sizes", "free discharge"),
        ({"homogenize__fields": "[size_classes]"}, "fields", "size_classes"),
        ({"homogenize__fields": "[mixing]"}, "fields", "mixing"),
    ],
)
def test_what_cannot_be_right_is_refused(tiny: Path, changes: dict[str, str], key: str, what: str) -> None:
    with pytest.raises(CaseError, match=what) as refused:
        plan_of(tiny, **changes)
    assert refused.value.key[-1] == key


def test_a_study_tells_what_narrow_sizes_change() -> None:
    case = load_case(CASES / "smoke.yaml", {"material.size": WIDE})
    variants = study_variants(case, BASIS, every)
    assert [one.variant.changes for one in variants if one.axis == "sizes"] == [{"dem.sizes": "narrow"}]


def test_a_study_of_narrow_sizes_needs_a_reference_that_has_all() -> None:
    case = load_case(CASES / "smoke.yaml", {"material.size": WIDE, "dem.sizes": "narrow"})
    with pytest.raises(CaseError, match="--reference") as refused:
        make_study(case, 1.0, 1)
    assert refused.value.key == ("dem", "sizes")
    assert any(one.axis == "sizes" for one in make_study(case, 10.0, 1, referred=True).variants)
