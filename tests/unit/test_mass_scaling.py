"""`dem.mass_scaling`: heavier small particles at the weight of the material's bed, and where they would be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.dem.sizes import SizeClasses
from granpipe.planning.make import make_plan
from granpipe.planning.plan import Plan
from granpipe.study.points import make_study

CASES = Path(__file__).parents[2] / "cases"
WIDE = "{diameter: {sieve: {edges: [4 mm, 8 mm, 12 mm], fractions: [30 %, 70 %]}}, by: mass}"
SOFT = "5e6"  # Pa: the Rayleigh time rules the step, not the skin


def plan_of(path: Path, **changes: str) -> Plan:
    given = {"material.size": WIDE, "contact.youngs_modulus": SOFT}
    return make_plan(load_case(path, given | {key.replace("__", "."): value for key, value in changes.items()}))


def test_small_particles_get_the_inertia_of_the_sauter_diameter() -> None:
    """Four particles of radius 1 and one of 2: r₃₂ = 12/8; (3/2)² is 2.25, of a third of the mass."""
    classes = SizeClasses(np.array([1.0, 2.0]), np.array([0.8, 0.2])).scaled()
    np.testing.assert_allclose(classes.density_factor, [2.25, 1])
    assert classes.mass_factor == pytest.approx(2.25 / 3 + 2 / 3)
    np.testing.assert_allclose(classes.enlarged(3).density_factor, [2.25, 1])


def test_nothing_gets_more_than_four_times_as_heavy() -> None:
    """A thousand of radius 1 and one of 10: r₃₂ = 2000/1100; of radius 0.5 beside them more than 4 would be due."""
    assert SizeClasses(np.array([0.5, 1.0, 10.0]), np.array([10, 1000, 1])).scaled().density_factor.tolist() == [
        4,
        pytest.approx((2001.25 / 1102.5) ** 2),
        1,
    ]


def test_one_size_is_as_heavy_as_the_material_whatever_rounding_says() -> None:
    for radius in np.random.default_rng(1).uniform(1e-4, 1, 1000):
        classes = SizeClasses(np.array([radius]), np.array([1.0])).scaled()
        assert classes.mass_factor == 1
        assert classes.density_factor.tolist() == [1]


def test_the_time_step_is_that_of_the_sauter_diameter(tiny: Path) -> None:
    scaled, plain = (plan_of(tiny, dem__mass_scaling=one).dem for one in ("auto", "none"))
    ratio = 0.5 * plain.classes.sauter_diameter / plain.classes.smallest
    assert ratio > 1.3
    assert scaled.time_step / plain.time_step == pytest.approx(ratio, rel=0.05)  # two digits


def test_the_neighbour_skin_is_as_wide_as_the_step_needs_and_no_wider_than_four_tenths() -> None:
    changes = {"dem.coarse_grain_factor": "2.5"}
    wide, stiff, soft = (
        make_plan(load_case(CASES / "reactor.yaml", changes | {"contact.youngs_modulus": youngs})).dem
        for youngs in ("2e6", "1e8", "3e5")
    )
    assert stiff.particles < 1e4
    assert stiff.skin == pytest.approx(0.2 * stiff.classes.mean_diameter, rel=0.05)
    assert 0.21 < wide.skin / wide.classes.mean_diameter < 0.39
    assert wide.time_step / stiff.time_step == pytest.approx(50**0.5, rel=0.05)  # E^(−1/2), two digits: no skin in it
    assert soft.skin == pytest.approx(0.4 * soft.classes.mean_diameter, rel=0.05)  # then the skin rules the step
    assert soft.time_step < 0.9 * wide.time_step * (2e6 / 3e5) ** 0.5


def test_many_particles_whose_step_needs_more_than_the_usual_skin_have_the_widest() -> None:
    few, many, stiffer = (
        make_plan(
            load_case(CASES / "reactor.yaml", {"dem.coarse_grain_factor": factor, "contact.youngs_modulus": e})
        ).dem
        for factor, e in (("2.5", "2e6"), ("2", "2e6"), ("2", "1e8"))
    )
    assert few.particles < 1e4 < many.particles
    shares = [one.skin / one.classes.mean_diameter for one in (few, many, stiffer)]
    assert 0.21 < shares[0] < 0.39
    assert shares[1:] == pytest.approx([0.4, 0.2], rel=0.05)


def test_the_bed_weighs_what_the_material_does() -> None:
    """Σ share r³ ρ g of the decks is the same, and so is the ratio of densities to (r₃₂/r)²."""
    weights = []
    for way in ("auto", "none"):
        plan = make_plan(load_case(CASES / "reactor.yaml", {"dem.mass_scaling": way}))
        shares, radii, factors = plan.dem.classes.number_share, plan.dem.classes.radius, plan.dem.classes.density_factor
        weights.append(float(shares @ (radii**3 * factors)) * plan.dem.gravity)
    assert weights[0] == pytest.approx(weights[1])


def test_inertia_slows_the_plate_as_it_slows_free_discharge() -> None:
    scaled, plain = (
        make_plan(load_case(CASES / "reactor.yaml", {"dem.mass_scaling": one})) for one in ("auto", "none")
    )
    slower = scaled.dem.classes.mass_factor**-0.5
    assert slower < 0.95
    assert scaled.dem.plate_speed / plain.dem.plate_speed == pytest.approx(slower, rel=0.04)  # two digits
    (told,) = (one for one in scaled.decisions if one.name == "mass scaling")
    assert told.value == "up to 3.49 times"
    assert "1.87 times the time step" in told.criterion
    assert "mass scaling" not in {one.name for one in plain.decisions}


@pytest.mark.parametrize(
    "changes",
    [
        {"dem__outlet": "open"},
        {"dem__mass_scaling": "none"},
        *({"homogenize__fields": f"[{name}]"} for name in ("mixing", "size_classes", "stress", "granular_temperature")),
        {"material__size": "{diameter: 1 cm}"},
    ],
)
def test_masses_are_true_where_they_show_and_where_the_case_says_so(tiny: Path, changes: dict[str, str]) -> None:
    settings = plan_of(tiny, **changes).dem
    assert settings.classes.mass_factor == 1
    assert settings.gravity == 9.81


def test_a_study_tells_what_mass_scaling_changes() -> None:
    case = load_case(CASES / "smoke.yaml", {"material.size": WIDE})
    variants = make_study(case, 1000.0, 1).variants
    assert [one.variant.changes for one in variants if one.axis == "mass_scaling"] == [{"dem.mass_scaling": "none"}]
    plain = make_study(load_case(CASES / "smoke.yaml"), 1000.0, 1).variants
    assert "mass_scaling" not in {one.axis for one in plain}
