"""Gates and notes: when they speak, and the page that tells of them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from granpipe.field import Field, Grid, flux_from_psi
from granpipe.pipeline.gates import (
    GATES,
    NOTES,
    PACKING,
    SMOOTHING,
    asymmetry_gate,
    level_flow_gates,
    run_notes,
    surface_gates,
    upward_gate,
)
from granpipe.pipeline.gates_page import gates_page
from granpipe.repose import search

ROOT = Path(__file__).parents[2]


def test_the_page_of_the_gates_is_current():
    assert (ROOT / "docs" / "reference" / "gates.md").read_text() == gates_page(search.GATES), "run `make docs`"


def test_every_gate_and_note_has_a_name_of_its_own_and_a_reason():
    names = [one.name for one in (*GATES, *search.GATES, *NOTES)]
    assert len(set(names)) == len(names)
    assert all(len(one.why) > 20 for one in (*GATES, *search.GATES, *NOTES))


@pytest.mark.parametrize(
    ("value", "passed"),
    [
        (0.49, False),
        (0.5, True),
        (0.5 - 1e-12, True),
        (0.68, True),
        (0.69, False),
        (math.nan, False),
        (math.inf, False),
    ],
)
def test_a_figure_passes_between_its_limits(value, passed):
    gate = PACKING.gate(value)
    assert gate.passed == passed
    assert gate.limit == "0.5 to 0.68"


def test_a_part_is_given_in_percent_with_the_remedy():
    assert SMOOTHING.gate(0.2).limit.startswith("at most 10% (fewer homogenize.smoothing_passes")
    assert str(SMOOTHING.gate(0.2, ", hopper")).startswith(
        "change of the field by smoothing, beyond noise, hopper: 0.2, must"
    )


def surface(inner: float, outer: float, error: float = 0.01, change: float = 0.03) -> dict[str, object]:
    """Angles in degrees, errors in radians."""
    one, other = ({"angle": math.radians(angle), "error": error} for angle in (inner, outer))
    apart = {"angle": abs(abs(one["angle"]) - abs(other["angle"])), "error": math.sqrt(2) * error}
    return {"angle": 0.4, "error": 0.05, "inner": one, "outer": other, "apart": apart, "radius": 0.85, "change": change}


@pytest.mark.parametrize(
    ("found", "turnovers", "passed"),
    [
        (surface(34, 15), 0.2, False),
        (surface(34, 15), 1.2, True),  # what flows makes its own surface
        (surface(34, 15, error=0.1), 0.2, True),  # within the noise
        (surface(34, 15, change=0.01), 0.2, True),  # little flows there
        (surface(30, -30), 0.2, True),  # a ridge
    ],
)
def test_a_bent_free_surface_that_may_be_left_from_the_filling_marks_the_result(found, turnovers, passed):
    figures = {"surface_angles": {"c": surface(30, 29), "d": found}, "turnovers": {"c": 0.1, "d": turnovers}}
    (gate,) = surface_gates(figures)
    assert gate.passed is passed
    assert passed or (gate.value == pytest.approx(0.03) and "section d" in gate.name)


def test_a_surface_without_halves_has_no_gate_and_a_bent_one_is_told_with_both_slopes():
    short = {"surface_angles": {"d": {"angle": 0.4, "error": 0.05}}, "turnovers": {"d": 0.2}}
    assert surface_gates(short) == surface_gates({}) == []
    figures = {"surface_angles": {"d": surface(34, 15, error=0.1)}, "turnovers": {"d": 2.0}}
    assert run_notes(figures) == [
        "section d: free surface at 23 ± 3° below the horizontal (34 ± 6° inside r = 0.85 m, 15 ± 6° beyond)"
    ]


def off_centre(first: float, error: float, second: float = 0.0, swirl: float = 0.0) -> dict[str, object]:
    return {"amplitudes": [first, second], "amplitudes_se": [error, error], "swirl": swirl, "swirl_se": error}


@pytest.mark.parametrize(
    ("amplitude", "error", "passed"),
    [(0.25, 0.05, False), (0.22, 0.05, False), (0.18, 0.05, True), (0.08, 0.01, True), (0.02, 0.03, True)],
)
def test_an_asymmetry_is_marked_where_it_is_large_and_beyond_doubt(amplitude, error, passed):
    gate = asymmetry_gate({"shaft": off_centre(0.01, 0.02), "cone": off_centre(amplitude, error)})
    assert gate.passed == passed
    assert passed or gate.name.endswith(", to one side in section cone")


def test_a_flow_with_two_lobes_is_marked_too():
    gate = asymmetry_gate({"cone": off_centre(0.11, 0.02, second=0.2)})
    assert (gate.value, gate.passed) == (0.2, False)
    assert gate.name.endswith(", to two sides in section cone")


def test_an_asymmetry_is_noted_from_three_standard_errors_on():
    figures = {"off_centre": {"shaft": off_centre(0.05, 0.02), "cone": off_centre(0.08, 0.02, swirl=-0.07)}}
    assert run_notes(figures) == [
        "section cone: 8% ± 2% of the flow lean to one side",
        "section cone: turns at -7% ± 2% of its downward speed",
    ]


def test_sections_that_turned_over_less_than_once_depend_on_the_filling():
    (note,) = run_notes({"turnovers": {"a": 3.0, "ring": 0.31, "e": 0.2}})
    assert note == "turned over less than once during the average, so it may depend on the filling: ring 0.31, e 0.2"


def test_an_error_of_a_bed_that_hardly_moved_is_noted():
    figures = {"statistical_error": {"whole": 0.03}, "widest_level_travel_diameters": 1.2}
    (note,) = run_notes(figures)
    assert "moved by 1.2 particle diameters" in note
    assert run_notes(figures | {"widest_level_travel_diameters": 2.0}) == []
    assert run_notes({"widest_level_travel_diameters": 1.2}) == []  # no error is told


def test_a_trend_is_noted_where_chance_does_not_explain_it():
    figures = {
        "trend_of_solids": {"relative_change": 0.04, "p_value": 0.002},
        "trend_of_kinetic_energy": {"relative_change": 0.4, "p_value": 0.3},
    }
    assert run_notes(figures) == ["solids: changes by +4.0% over the average (p = 0.002)"]


def test_replicas_that_scatter_are_noted():
    assert run_notes({"scatter_of_runs_over_error": 1.9}) == []
    assert "scatter 2.5 times" in run_notes({"scatter_of_runs_over_error": 2.5})[0]


def test_a_quiet_run_has_no_notes():
    assert run_notes({"turnovers": {"a": 1.0}, "off_centre": {"a": off_centre(0.01, 0.02)}}) == []


@pytest.mark.parametrize(("eddy", "passed"), [(0.0, True), (0.005, True), (0.05, False)])
def test_upward_flow_is_that_of_the_worst_level(eddy, passed):
    """Plug flow, and a ring at the wall where as much flows up as down beside it: the part `eddy` of the flow."""
    grid = Grid.covering(1.0, 0.0, 2.0, 0.1)
    psi = np.tile(-(grid.r_edges**2) / (2 * np.pi), (len(grid.z_edges), 1))
    psi[:, -2] = -(1 + eddy) / (2 * np.pi)  # beyond it flows back what is too much here
    flux_r, flux_z = flux_from_psi(0.6 * psi, grid)
    inside = np.ones(grid.shape)
    gate = upward_gate(Field(grid, inside, inside > 0, flux_r, flux_z, 1.0, 0.6, 1.0))
    assert gate.value == pytest.approx(eddy, abs=1e-12)
    assert gate.passed == passed


def test_a_bulk_density_that_the_simulated_bed_does_not_have_is_told() -> None:
    (note,) = run_notes({"bulk_packing": 0.45, "measured_packing": 0.586})
    assert "0.450, the simulated bed has 0.586" in note
    assert run_notes({"bulk_packing": 0.58, "measured_packing": 0.586}) == []
    assert run_notes({"bulk_packing": 0.58, "measured_packing": None}) == []


def test_the_time_that_is_advised_dilutes_a_volume_that_is_filled_once_to_the_limit() -> None:
    flow, filled, time = 2e-3, 3.6e-3, 10.0  # m³/s, m³, s: 18 % of the flow of 10 s
    gathered = np.array([0.0, filled / time, 0.0])
    gate = level_flow_gates(flow + gathered, gathered, flow, time)[1]
    assert (gate.value, gate.passed) == (pytest.approx(0.18), False)
    more = float(re.search(r"about ([\d.]+) s more", gate.limit)[1])
    assert filled / (time + more) / flow == pytest.approx(0.1, rel=0.02)
    assert level_flow_gates(flow + gathered / 2, gathered / 2, flow, time)[1].passed
    for empty in (np.zeros(3), -gathered):  # emptying counts as filling does
        gate = level_flow_gates(flow + empty, empty, flow, time)[1]
        assert ("s more" in gate.limit) == (not gate.passed)
