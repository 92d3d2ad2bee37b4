"""Surfaces, voids and zones at rest of fields that are drawn by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granpipe.analysis.surfaces import (
    bulk_edge,
    crossings,
    displacement,
    stagnant_area,
    surface_angle,
    surface_halves,
    void_area,
)
from granpipe.errors import DataError
from granpipe.field import Field, Grid

GRID = Grid.covering(1.0, 0.0, 2.0, 0.02)
R, Z = np.meshgrid(GRID.r_centres, GRID.z_centres)
INSIDE = (R < 0.8).astype(float)


def filled_to(surface, flux=0.0):
    """A vessel of radius 0.8 m filled to a height; the flow down through every level is that of its mean speed, 1."""
    rows, columns = GRID.shape
    flux_z = np.zeros((rows + 1, columns)) - flux
    return Field(
        grid=GRID,
        inside_fraction=INSIDE,
        bulk=(surface > Z) & (INSIDE > 0),
        flux_r=np.zeros((rows, columns + 1)),
        flux_z=flux_z,
        bulk_flow=np.pi * 0.8**2,
        bulk_packing=0.6,
        flow_scale=1.0,
    )


def test_a_circle_is_found_where_it_is():
    points = crossings(np.hypot(R, Z - 1), 0.6, GRID, np.ones(GRID.shape, dtype=bool))
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1] - 1), 0.6, atol=2e-4)
    assert displacement(np.array([[0.6, 1.0], [0.0, 1.6]]), points) < 0.51 * GRID.cell


def test_lines_are_as_far_apart_as_they_were_drawn():
    """Heaps of one slope, one 0.1 m above the other."""
    slope = 0.5
    low, high = (bulk_edge(filled_to(height - slope * R)) for height in (1.2, 1.3))
    assert displacement(low, high) == pytest.approx(0.1 / np.sqrt(1 + slope**2), abs=0.3 * GRID.cell)
    assert displacement(low, low) == 0


@pytest.mark.parametrize("degrees", [-20, 0, 12, 35])
def test_the_angle_of_a_heap_is_that_with_which_it_was_drawn(degrees):
    found = surface_angle(filled_to(1.2 - np.tan(np.radians(degrees)) * R), (0.2, 2.0), diameter=0.1)
    assert np.degrees(found.angle) == pytest.approx(degrees, abs=0.4)
    assert np.degrees(found.error) < 1


def test_a_curved_surface_has_an_angle_of_large_error():
    """1.2 − r² in a radius of 0.8: a straight line through it has a slope of −0.8 and misses it by 0.05 m."""
    found = surface_angle(filled_to(1.2 - R**2), (0.2, 2.0), diameter=0.1)
    assert np.tan(found.angle) == pytest.approx(0.8, abs=0.02)
    assert 2 < np.degrees(found.error) < 8


def test_the_halves_of_a_straight_surface_are_equally_steep_whichever_way_they_fall():
    slope = np.tan(np.radians(30))
    for height in (1.2 - slope * R, 1.2 - slope * np.abs(R - 0.4), 0.8 + slope * np.abs(R - 0.4)):
        halves = surface_halves(filled_to(height), (0.2, 2.0), diameter=0.1)
        assert halves.radius == pytest.approx(0.4, abs=GRID.cell)
        for half in (halves.inner, halves.outer):
            assert abs(np.degrees(half.angle)) == pytest.approx(30, abs=0.8)
        assert np.degrees(halves.apart.angle) < 1


def test_a_bent_surface_has_halves_that_differ_beyond_their_errors():
    """34° inside, 15° beyond."""
    inner, outer = (np.tan(np.radians(angle)) for angle in (34, 15))
    bent = filled_to(1.2 - inner * np.minimum(R, 0.4) - outer * np.maximum(R - 0.4, 0))
    halves = surface_halves(bent, (0.2, 2.0), diameter=0.1)
    assert np.degrees(halves.apart.angle) == pytest.approx(19, abs=0.8)
    assert halves.apart.angle > 3 * halves.apart.error
    assert surface_halves(bent, (0.2, 2.0), diameter=0.21) is None  # too short for its particles


@pytest.mark.parametrize(("inside", "beyond"), [(4.0, 1.0), (1.0, 1.0)])
def test_a_bend_counts_by_the_flow_between_it_and_a_surface_of_one_slope(inside, beyond):
    """34° inside r = 0.4 m, 15° beyond; by far the most flows inside, or beyond, where the area is larger."""
    steep, flat = (np.tan(np.radians(angle)) for angle in (34, 15))
    bent = filled_to(
        1.2 - steep * np.minimum(R, 0.4) - flat * np.maximum(R - 0.4, 0), np.where(R[:1] < 0.4, inside, beyond)
    )
    r = np.linspace(0, 0.8, 100_001)
    speed, height = np.where(r < 0.4, inside, beyond), 1.2 - steep * np.minimum(r, 0.4) - flat * np.maximum(r - 0.4, 0)
    slower = r > 0.4 if inside > beyond else r < 0.4
    between = np.where(slower, (steep - flat) * np.abs(r - 0.4), 0.0)
    expected = np.sqrt((r * speed**2 * between).sum() / (r * speed**2 * (height - 0.2)).sum())
    assert surface_halves(bent, (0.2, 2.0), diameter=0.1).change == pytest.approx(expected, rel=0.05)


def test_a_straight_surface_or_a_ridge_leaves_the_field_as_it_is():
    slope = np.tan(np.radians(30))
    for height in (1.2 - slope * R, 1.2 - slope * np.abs(R - 0.4)):
        assert surface_halves(filled_to(height, 1.0), (0.2, 2.0), diameter=0.1).change < 0.06


def test_no_free_surface_or_a_short_one_has_no_angle():
    full, heap = filled_to(3.0), filled_to(1.2 - 0.5 * R)
    assert surface_angle(full, (0.0, 2.0), diameter=0.1) is None
    assert surface_angle(heap, (0.0, 0.7), diameter=0.1) is None  # solids throughout
    assert surface_angle(heap, (0.0, 2.0), diameter=0.3) is None


@pytest.mark.parametrize("thickness", [0.0, 0.5, 1.0])
def test_a_section_of_less_than_two_rows_of_cells_has_no_surface(thickness):
    """As the rim of an orifice, a millimetre high."""
    section, heap = (1.0, 1.0 + thickness * GRID.cell), filled_to(1.2 - 0.5 * R)
    assert surface_angle(heap, section, diameter=0.1) is None
    assert surface_halves(heap, section, diameter=0.1) is None


def test_walls_are_no_surface():
    assert bulk_edge(filled_to(1.0))[:, 0].max() < 0.8
    with pytest.raises(DataError, match="no free surface"):
        displacement(bulk_edge(filled_to(3.0)), np.zeros((1, 2)))


def test_voids_are_measured_inside_the_outline_and_between_the_levels():
    field = filled_to(1.2)
    assert void_area(field, (0.0, 2.0)) == pytest.approx(0.8 * 0.8)
    assert void_area(field, (1.0, 1.5)) == pytest.approx(0.8 * 0.3)
    assert void_area(field, (0.0, 1.0)) == 0


def test_at_rest_is_what_is_slower_than_a_fiftieth_of_the_mean():
    flux = np.where(GRID.r_centres < 0.5, 0.6 * 0.021, 0.6 * 0.019)
    assert stagnant_area(filled_to(1.2, flux), (0.0, 2.0)) == pytest.approx(0.3 * 1.2)
    assert stagnant_area(filled_to(1.2, flux), (0.0, 2.0), part=0.018) == 0


def test_what_is_at_rest_does_not_depend_on_the_flow_rate_of_the_process():
    flux = np.where(GRID.r_centres < 0.5, 0.6 * 0.021, 0.6 * 0.019)
    slower = replace(filled_to(1.2, flux), flow_scale=0.01)
    assert stagnant_area(slower, (0.0, 2.0)) == pytest.approx(0.3 * 1.2)
    assert stagnant_area(slower, (0.0, 2.0), part=0.018) == 0
