"""The rate of a free discharge and LIGGGHTS' own count, on segments whose rates are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.records import segment as report
from fakes.sums import NOTHING

from granpipe.homogenize.average import Sums
from granpipe.pipeline.discharge import Discharge, measure_discharge

DENSITY, STEP = 2000.0, 1e-3


def flowing(rates: list[float]) -> list[Sums]:
    """Segments of a second each, in which as many m³/s of solids leave through every level."""
    share = -NOTHING.grid.ring_area / NOTHING.grid.ring_area.sum()
    return [
        replace(NOTHING, start=float(at), stop=at + 1.0, flow_z=rate * share + np.zeros_like(NOTHING.flow_z))
        for at, rate in enumerate(rates)
    ]


def test_rate_error_and_count_are_those_of_the_segments() -> None:
    """Rates of 0.01 and 0.03 m³/s in turns, eight times: 40 ± 20/√7 kg/s. LIGGGHTS counts 39 kg a segment, of which
    the first two belong to no average: what it counted in them does not count."""
    sums = flowing([0.01, 0.03] * 5)[2:]
    steps = [1000 * (number + 1) for number in range(10)]
    masses = [500.0, 900.0, *(900.0 + 39 * number for number in range(1, 9))]
    reports = [
        report(counted_to_step=step, discharged_mass_kg=mass, wall_seconds=float(number))
        for number, (step, mass) in enumerate(zip(steps, masses, strict=True))
    ]
    found = measure_discharge(sums, (0.0, 0.1), DENSITY, {0: reports}, STEP)
    assert found.kg_per_s == pytest.approx(40)
    assert found.standard_error == pytest.approx(20 / np.sqrt(7))
    assert found.counted_kg_per_s == pytest.approx(39)


def test_a_process_that_was_started_anew_counts_from_its_own_beginning() -> None:
    sums = flowing([0.02] * 8)
    masses, seconds = [40.0, 80.0, 120.0, 40.0, 80.0, 120.0], [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]
    reports = [
        report(counted_to_step=1000 * (number + 1), discharged_mass_kg=mass, wall_seconds=second)
        for number, (mass, second) in enumerate(zip(masses, seconds, strict=True))
    ]
    assert measure_discharge(sums, (0.0, 0.1), DENSITY, {0: reports}, STEP).counted_kg_per_s == pytest.approx(40)


@pytest.mark.parametrize(
    ("rate", "error", "passed"),
    [(1.0098, 0.0, True), (1.0102, 0.0, False), (1.03, 0.0153, False), (1.03, 0.0157, True)],
)
def test_both_must_agree_within_a_percent_or_two_standard_errors(rate: float, error: float, passed: bool) -> None:
    (gate,) = Discharge(rate, error, 1.0).gates
    assert gate.passed is passed
