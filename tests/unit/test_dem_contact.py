"""Contact formulas against published numbers and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate

from granpipe.dem import contact
from granpipe.dem.stress import bed_stress


def test_the_papers_time_step_is_13_percent_of_the_rayleigh_time_at_its_mean_radius() -> None:
    mean = contact.rayleigh_time(0.03, 1000, 4.7e9, 0.35)
    assert 1e-5 / mean == pytest.approx(0.13, abs=0.005)
    smallest = contact.rayleigh_time(0.01, 1000, 4.7e9, 0.35)
    assert 1e-5 / smallest == pytest.approx(0.39, abs=0.01)


def test_a_hundred_times_softer_allows_ten_times_the_step() -> None:
    stiff, soft = (contact.rayleigh_time(0.03, 1000, e, 0.35) for e in (1e9, 1e7))
    assert soft / stiff == pytest.approx(10)


def test_hertz_time_falls_with_the_fifth_root_of_the_speed() -> None:
    slow, fast = (contact.hertz_time(0.03, 1000, 1e7, 0.35, v) for v in (0.01, 0.32))
    assert slow / fast == pytest.approx(2)


def test_a_collision_lasts_as_long_as_hertzs_equation_of_motion_says() -> None:
    """m* δ'' = −(4/3) E* √R* δ^1.5, from its energy: T = 2 (δ_max/v) ∫₀¹ dx/√(1 − x^2.5)."""
    radius, density, youngs, poisson, speed = 0.03, 2500.0, 1e7, 0.35, 0.4
    mass, curved = 4 / 3 * math.pi * radius**3 * density / 2, radius / 2
    modulus = 1 / (2 * (1 - poisson**2) / youngs)
    deepest = (15 * mass * speed**2 / (16 * math.sqrt(curved) * modulus)) ** 0.4
    time = 2 * deepest / speed * integrate.quad(lambda x: 1 / math.sqrt(1 - x**2.5), 0, 1)[0]
    assert contact.hertz_time(radius, density, youngs, poisson, speed) == pytest.approx(time, rel=2e-3)


def test_two_bodies_of_steel_have_an_effective_modulus_of_115_gpa() -> None:
    assert contact.effective_modulus(210e9, 0.3) == pytest.approx(115.385e9, rel=1e-4)


def test_janssen_stress_is_hydrostatic_when_shallow_and_saturates_when_deep() -> None:
    shallow = contact.janssen_step(0.0, 600, 2.0, 0.5, 1e-3)
    assert shallow == pytest.approx(600 * 9.81 * 1e-3, rel=1e-3)
    deep = contact.janssen_step(5e4, 600, 2.0, 0.5, 100.0)
    assert deep == pytest.approx(600 * 9.81 * 2.0 / (4 * 0.5 * 0.4))
    assert contact.janssen_step(1e3, 600, 2.0, 0.0, 3.0) == pytest.approx(1e3 + 600 * 9.81 * 3)


def test_two_steps_down_a_pipe_are_one_of_their_sum() -> None:
    once = contact.janssen_step(700.0, 600, 0.4, 0.5, 0.9)
    twice = contact.janssen_step(contact.janssen_step(700.0, 600, 0.4, 0.5, 0.3), 600, 0.4, 0.5, 0.6)
    assert once == pytest.approx(twice)


def test_stress_in_a_straight_vessel_is_janssens_whatever_it_is_cut_into() -> None:
    bed = bed_stress([(0.3, 2.0), (0.3, 1.2), (0.3, 0.0)], 600, 0.5)
    assert bed.stress[-1] == pytest.approx(contact.janssen_step(0.0, 600, 0.6, 0.5, 2.0))
    assert bed.peak == bed.stress[-1]
    assert bed.volume.sum() == pytest.approx(math.pi * 0.3**2 * 2)
    z = np.linspace(2, 0, 4001)
    exact = np.mean([contact.janssen_step(0.0, 600, 0.6, 0.5, 2 - x) for x in z])
    assert bed.mean == pytest.approx(exact, rel=0.02)


def test_stress_peaks_where_the_shaft_becomes_a_hopper() -> None:
    bed = bed_stress([(1.0, 9.0), (1.0, 3.0), (0.2, 1.0), (0.2, 0.0)], 600, 0.6)
    assert bed.level[bed.stress.argmax()] == pytest.approx(3.0, abs=0.3)
    assert bed.at(3.0) == pytest.approx(bed.peak, rel=0.01)
    assert bed.stress[-1] < 0.5 * bed.peak


def test_a_ledge_spreads_the_weight_above_it_over_the_wider_vessel() -> None:
    bed = bed_stress([(0.5, 3.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.9)], 600, 0.5)
    above, below = bed.stress[bed.level > 0.999][-1], bed.stress[bed.level < 0.999][0]
    assert below == pytest.approx(above / 4, rel=0.1)


def test_without_friction_a_ledge_changes_the_stress_by_the_areas_alone() -> None:
    """2 m of 600 kg/m³ in a pipe, then four times its area: 2943 Pa and 1/40 of 0.1 m more; narrowing, it stays."""
    weight = 600 * 9.81
    wider = bed_stress([(0.5, 3.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.9)], 600, 0.0)
    assert wider.at(1.0 - 0.0025) == pytest.approx(weight * (2.0 / 4 + 0.0025))
    narrower = bed_stress([(1.0, 3.0), (1.0, 1.0), (0.5, 1.0), (0.5, 0.9)], 600, 0.0)
    assert narrower.stress[-1] == pytest.approx(weight * 2.1)


def test_the_softened_modulus_keeps_the_overlap_at_its_limit_by_hertz() -> None:
    """overlap/d = 1.3 (P/E*)^(2/3), solved for E by hand: E*/P = (1.3/0.015)^1.5 = 807."""
    youngs = contact.softened_modulus(1e4, 1e4 / 3, 0.3)
    assert contact.effective_modulus(youngs, 0.3) / 1e4 == pytest.approx(807, rel=0.01)
    assert contact.softened_modulus(1e4, 3e4, 0.3) > youngs  # a high peak asks for more


def test_under_a_high_peak_the_softened_modulus_follows_its_percentile() -> None:
    """3.3 (P/E*)^(2/3) = 0.05, solved by hand: E*/P = 66^1.5 = 536.19; E = 2 (1 − 0.09) E*."""
    assert contact.softened_modulus(1e4, 3e4, 0.3) == pytest.approx(536.19 * 3e4 * 1.82, rel=1e-4)


def test_a_slot_lets_through_what_its_formula_says() -> None:
    """2 m by 24 cm, spheres of 10 cm: 1.03 √9.81 · 2 · 0.1^1.5 = 0.20403 m³/s, by hand."""
    assert contact.slot_flow(2.0, 0.24, 0.1) == pytest.approx(0.20403, rel=1e-4)


def test_a_bed_that_overlaps_twice_as_much_as_it_may_needs_almost_three_times_the_stiffness() -> None:
    assert contact.stiffening(2 * contact.MEAN_OVERLAP, 0.0) == pytest.approx(2**1.5)
    assert contact.stiffening(0.0, contact.P99_OVERLAP) == pytest.approx(1)


def test_ten_times_smaller_particles_need_six_times_the_stiffness_not_to_be_pressed_through_walls() -> None:
    """Two of radius 1 m that overlap by 5 % of 2 m bear 4/3 E* √0.5 · 0.1^1.5 N = 0.02981 E*; one of 0.1 m against a
    flat wall goes in by (0.02981 · 0.75 / (√0.1 · 6.325))^(2/3) = 0.05 m, half its radius, if that is 6.325 times
    stiffer, by hand. Up to a ratio of 3.98 the bed's own limits are enough."""
    assert contact.wall_stiffening(10) == pytest.approx(6.325, rel=1e-3)
    assert contact.wall_stiffening(3.9) == 1
    assert contact.wall_stiffening(4.1) > 1


def test_strong_damping_shortens_the_step() -> None:
    shares = [contact.step_share("epsd2", e) for e in (0.06, 0.2, 0.43, 0.9, 1.0)]
    assert shares == sorted(shares)
    assert shares[-1] == contact.LONGEST_STEP
    assert shares[0] < 0.1  # measured: at rest with 0.1, never with 0.13


def test_inertial_numbers_of_a_sheared_layer_are_those_of_the_definition() -> None:
    """0.1 m/s over 7.5 diameters of 2 cm at 1000 Pa vertical, 600 Pa mean: I = (0.1/0.15) 0.02 √(1000/600)."""
    wide = contact.inertial_number(0.1, 1.0, 0.02, 1000, 1000.0)
    assert wide == pytest.approx(0.1 / 0.15 * 0.02 * math.sqrt(1000 / 600))
    assert contact.inertial_number(0.1, 0.15, 0.02, 1000, 1000.0) == pytest.approx(2 * wide)  # no room for the layer


def test_nothing_flows_through_an_opening_of_a_particles_width() -> None:
    assert contact.beverloo_flow(0.1, 0.1) == 0
    assert contact.slot_flow(1.0, 0.1, 0.1) == 0


def test_beverloo_flow_of_a_wide_opening_grows_with_the_power_five_halves() -> None:
    assert contact.beverloo_flow(4.0, 0.0) / contact.beverloo_flow(1.0, 0.0) == pytest.approx(32)
    assert contact.beverloo_flow(1.0, 0.0) == pytest.approx(0.58 * math.sqrt(9.81))


@pytest.mark.parametrize(("value", "rounded"), [(0.000291, 0.0003), (1.0e7, 1.0e7), (0.0951, 0.096), (991.0, 1000.0)])
def test_two_digits_round_up(value: float, rounded: float) -> None:
    assert contact.two_digits_up(value) == rounded


@pytest.mark.parametrize(("value", "rounded"), [(0.000298, 0.00029), (1.0e7, 1.0e7), (0.0259, 0.025), (999.0, 990.0)])
def test_two_digits_round_down(value: float, rounded: float) -> None:
    assert contact.two_digits(value) == rounded
