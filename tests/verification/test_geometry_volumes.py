"""Volumes, areas and inside fractions against closed forms and against brute force."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from granpipe.field import Grid
from granpipe.geometry.outline import Outline

REACTOR = [[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]
RING = [[0.75, 1.85], [1.156, 1.85], [1.156, 2.10], [0.75, 2.10]]


def frustum(r0, r1, height):
    return np.pi * height * (r0 * r0 + r0 * r1 + r1 * r1) / 3


def total(outline, grid):
    return float((outline.inside_fraction(grid) * grid.cell_volume).sum())


def test_volume_of_the_test_reactor_is_the_sum_of_its_cylinders_and_its_cone():
    sections = np.pi * 1 + frustum(1, 0.5, 1) + np.pi * 0.25 * 0.5 + np.pi * 1.156**2 * 3.4
    ring = np.pi * (1.156**2 - 0.75**2) * 0.25
    assert Outline.of(REACTOR, {"ring": RING}).volume() == pytest.approx(sections - ring, rel=1e-14)


@pytest.mark.parametrize("half_angle", [1, 26.6, 60, 85])
@pytest.mark.parametrize("cell", [0.1, 0.037, 0.004])
def test_inside_fraction_of_a_cone_is_exact_cell_by_cell(half_angle, cell):
    slope = np.tan(np.radians(half_angle))
    height = min(2.0, 0.9 / slope)
    outline = Outline.of([[1, height], [1 - height * slope, 0]])
    grid = Grid.covering(1.0, 0.0, height, cell)

    def within(radius):
        """Volume of the cone up to z within a radius: cone below the cut, cylinder above it (or the reverse)."""
        cut = np.clip((radius - outline.outlet_radius) / slope, 0, None)
        z = grid.z_edges[:, None]
        at = np.minimum(z, cut)
        cone = frustum(outline.outlet_radius, outline.outlet_radius + slope * at, at)
        return np.where(cut > 0, cone + np.pi * radius**2 * (z - at), np.pi * radius**2 * z)

    volume = np.diff(np.diff(within(grid.r_edges), axis=1), axis=0)
    fraction = outline.inside_fraction(grid)
    # the reference is a difference of large volumes: its own rounding grows with the number of cells across
    assert np.abs(fraction - volume / grid.cell_volume).max() < 1e-15 * (1 / cell) ** 2 + 1e-12
    assert total(outline, grid) == pytest.approx(frustum(1, outline.outlet_radius, height), rel=1e-13)


@pytest.mark.parametrize("cell", [0.5, 0.031, 0.0123])
def test_inside_fraction_of_cylinder_and_ring_is_exact_where_levels_cut_cells(cell):
    outline = Outline.of([[1.156, 2], [1.156, 0]], {"ring": [[0.75, 0.85], [1.156, 0.85], [1.156, 1.1], [0.75, 1.1]]})
    grid = Grid.covering(outline.r_max, 0, 2, cell)
    r0, r1 = grid.r_edges[:-1], grid.r_edges[1:]
    z0, z1 = grid.z_edges[:-1, None], grid.z_edges[1:, None]

    def part(a, b):
        return (np.clip(r1, a, b) ** 2 - np.clip(r0, a, b) ** 2) / (r1**2 - r0**2)

    blocked = np.clip(np.minimum(z1, 1.1) - np.maximum(z0, 0.85), 0, None) / (z1 - z0)
    expected = part(0, 1.156) - blocked * part(0.75, 1.156)
    assert np.abs(outline.inside_fraction(grid) - expected).max() < 1e-12


def test_cells_are_exactly_full_or_empty_away_from_walls():
    fraction = Outline.of(REACTOR, {"ring": RING}).inside_fraction(Grid.covering(1.156, 0, 5.9, 0.03))
    assert fraction.min() == 0
    assert fraction.max() == 1
    assert ((fraction == 0) | (fraction == 1)).mean() > 0.9


def test_inside_fraction_agrees_with_a_count_of_points():
    obstacles = {
        "insert": [[0.0, 3.4], [0.35, 2.9], [0.2, 2.5], [0.0, 2.5]],
        "free": [[0.5, 1.2], [0.7, 1.0], [0.8, 1.3], [0.62, 1.1]],
        "ring": RING,
    }
    outline = Outline.of([[1, 5], [1, 4.2], [0.6, 3], [1.156, 2.7], [1.156, 0]], obstacles)
    grid = Grid.covering(1.156, 0, 5, 0.1)
    fine = 40  # points per cell in each direction, equal volumes
    u = (np.arange(fine) + 0.5) / fine
    r = np.sqrt(grid.r_edges[:-1, None] ** 2 + u * np.diff(grid.r_edges**2)[:, None])
    z = grid.z_edges[:-1, None] + u * grid.cell
    rr, zz = np.broadcast_arrays(r[None, :, None, :], z[:, None, :, None])
    inside = rr < np.interp(zz, [0, 2.7, 3, 4.2, 5], [1.156, 1.156, 0.6, 1, 1])
    for polygon in obstacles.values():
        inside &= ~winding(rr, zz, np.array(polygon))
    # a straight edge through a cell is counted with an error of about one row of points
    assert np.abs(outline.inside_fraction(grid) - inside.mean(axis=(2, 3))).max() < 2 / fine


def winding(r, z, polygon):
    """Whether points lie inside: the winding number, summed edge by edge."""
    number = np.zeros(r.shape, dtype=int)
    for (r0, z0), (r1, z1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        left = (r1 - r0) * (z - z0) - (r - r0) * (z1 - z0)
        number += (z0 <= z) & (z < z1) & (left > 0)
        number -= (z1 <= z) & (z < z0) & (left < 0)
    return number != 0


@pytest.mark.parametrize("seed", range(10))
def test_random_vessels_volume_is_the_integral_of_their_area_and_of_their_cells(seed):
    rng = np.random.default_rng(seed)
    heights = np.sort(rng.uniform(0, 4, 8))[::-1]
    radii = rng.uniform(0.3, 1.5, 8)
    wall = np.stack([radii, heights], axis=1)
    wall = np.insert(wall, 4, [rng.uniform(0.3, 1.5), heights[3]], axis=0)  # a ledge
    turn = np.sort(rng.uniform(0, 2 * np.pi, 6))
    rod = np.stack([0.12 + 0.1 * np.cos(turn), heights[3] + 0.2 * np.sin(turn)], axis=1)
    outline = Outline.of(wall, {"rod": rod})
    levels = np.unique(np.concatenate([heights, rod[:, 1]]))
    integral = sum(quad(lambda z: float(outline.area(z)), a, b, epsrel=1e-12)[0] for a, b in pairwise(levels))
    assert outline.volume() == pytest.approx(integral, rel=1e-11)
    grid = Grid.covering(outline.r_max, outline.z_bottom, outline.z_top, 0.05)
    assert total(outline, grid) == pytest.approx(outline.volume(), rel=1e-12)
    cones = sum(frustum(a[0], b[0], a[1] - b[1]) for a, b in pairwise(wall))
    assert outline.volume() == pytest.approx(cones - ring_volume(rod), rel=1e-12)


def ring_volume(polygon):
    """Pappus: area times the way of its centroid."""
    following = np.roll(polygon, -1, axis=0)
    doubled = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    first_moment = ((polygon[:, 0] + following[:, 0]) * doubled).sum() / 6
    return abs(2 * np.pi * first_moment)
