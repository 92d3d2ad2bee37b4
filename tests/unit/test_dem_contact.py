"""Contact formulas against published numbers and limits."""

from __future__ import annotations

import math

import pytest

from granpipe.dem import contact


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


def test_janssen_stress_is_hydrostatic_when_shallow_and_saturates_when_deep() -> None:
    shallow = contact.janssen_stress(600, 2.0, 0.5, 1e-3)
    assert shallow == pytest.approx(600 * 9.81 * 1e-3, rel=1e-3)
    deep = contact.janssen_stress(600, 2.0, 0.5, 100.0)
    assert deep == pytest.approx(600 * 9.81 * 2.0 / (4 * 0.5 * 0.4))
    assert contact.janssen_stress(600, 2.0, 0.0, 3.0) == pytest.approx(600 * 9.81 * 3)


def test_the_softened_modulus_keeps_its_ratio_to_the_stress_and_liggghts_limit() -> None:
    youngs = contact.softened_modulus(1e4, 0.3)
    assert contact.effective_modulus(youngs, 0.3) / 1e4 == pytest.approx(contact.STIFFNESS_RATIO, rel=0.05)
    assert contact.softened_modulus(1.0, 0.3) == 5e6


def test_nothing_flows_through_an_opening_of_a_particles_width() -> None:
    assert contact.beverloo_flow(0.1, 0.1) == 0
    assert contact.slot_flow(1.0, 0.1, 0.1) == 0


def test_beverloo_flow_of_a_wide_opening_grows_with_the_power_five_halves() -> None:
    assert contact.beverloo_flow(4.0, 0.0) / contact.beverloo_flow(1.0, 0.0) == pytest.approx(32)
    assert contact.beverloo_flow(1.0, 0.0) == pytest.approx(0.58 * math.sqrt(9.81))


@pytest.mark.parametrize(("value", "rounded"), [(0.000298, 0.00029), (1.0e7, 1.0e7), (0.0259, 0.025), (999.0, 990.0)])
def test_two_digits_round_down(value: float, rounded: float) -> None:
    assert contact.two_digits(value) == rounded
