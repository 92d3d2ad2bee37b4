"""Sphere–ring deposit against quadrature and sampling that share nothing with it."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate

from granpipe.field import Grid
from granpipe.homogenize.deposit import deposit

RADIUS = 0.03
CELL = RADIUS / 2  # a quarter of the diameter
GRID = Grid.covering(0.3, 0.0, 0.24, CELL)


def covered_angle(r, offset, distance):
    """Angle of the circle of radius r about the axis inside the sphere, `offset` above the sphere's centre."""
    disc = RADIUS**2 - offset**2
    if r * distance == 0:
        return 2 * np.pi * (r**2 + distance**2 < disc)
    return 2 * np.arccos(np.clip((r**2 + distance**2 - disc) / (2 * r * distance), -1, 1))


def cell_volume_by_quadrature(r_range, z_range, distance, height):
    """Volume of a sphere in a ring: adaptive quadrature of the covered angle, with the kinks given."""

    def over_r(z):
        s = np.sqrt(max(RADIUS**2 - (z - height) ** 2, 0))
        kinks = [r for r in (abs(distance - s), distance + s) if r_range[0] < r < r_range[1]]
        return integrate.quad(
            lambda r: r * covered_angle(r, z - height, distance),
            *r_range,
            points=kinks or None,
            epsabs=1e-12,
            limit=200,
        )[0]

    low, high = max(z_range[0], height - RADIUS), min(z_range[1], height + RADIUS)
    if low >= high:
        return 0.0
    touching = [abs(r - distance) for r in r_range if abs(r - distance) < RADIUS]
    kinks = {height + sign * np.sqrt(RADIUS**2 - d**2) for d in touching for sign in (-1, 1)}
    inner = sorted(z for z in kinks if low < z < high)
    return integrate.quad(over_r, low, high, points=inner or None, epsabs=1e-9)[0]


@pytest.mark.parametrize("distance", [0, 0.1, 0.5, 0.9, 1.0, 1.1, 2.3, 5.05])
def test_every_cell_is_within_a_thousandth_of_the_sphere_of_adaptive_quadrature(distance):
    distance *= RADIUS
    height = 0.1234
    volume = deposit(np.array([[0, distance, height]]), np.array([RADIUS]), np.zeros((1, 3)), GRID, points=3).volume
    worst = 0.0
    for row, column in np.argwhere(volume > 0):
        exact = cell_volume_by_quadrature(
            GRID.r_edges[column : column + 2], GRID.z_edges[row : row + 2], distance, height
        )
        worst = max(worst, abs(volume[row, column] - exact))
    assert worst < 1e-3 * 4 / 3 * np.pi * RADIUS**3


def test_cells_agree_with_random_points_in_the_spheres():
    rng = np.random.default_rng(11)
    count, samples = 40, 50_000
    position = np.column_stack([rng.uniform(-0.15, 0.15, (count, 2)), rng.uniform(0.04, 0.2, count)])
    position[:5, :2] *= 0.05
    volume = deposit(position, np.full(count, RADIUS), np.zeros((count, 3)), GRID, points=8).volume
    direction = rng.normal(size=(count, samples, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    points = position[:, None] + RADIUS * rng.random((count, samples, 1)) ** (1 / 3) * direction
    r, z = np.hypot(points[..., 0], points[..., 1]).ravel(), points[..., 2].ravel()
    hits = np.histogram2d(z, r, [GRID.z_edges, GRID.r_edges])[0]
    share = 4 / 3 * np.pi * RADIUS**3 / samples
    spread = share * np.sqrt(np.maximum(hits, 1))
    deviation = (volume - hits * share) / spread
    assert np.abs(deviation).max() < 5
    assert np.sqrt(np.mean(deviation[hits > 0] ** 2)) < 1.1


@pytest.mark.parametrize("distance", [0.05, 0.5, 1.4, 4])
def test_ring_flow_is_the_local_radial_velocity_over_the_sphere_section(distance):
    # brute force on the cylinders r = R: cells of angle and height, inside the sphere or not
    distance *= RADIUS
    velocity = np.array([0.7, 0.2, 0.0])
    flow = deposit(np.array([[distance, 0, 0.12]]), np.array([RADIUS]), velocity[None], GRID, 24).flow_r.sum(axis=0)
    turn, heights = 2 * np.pi / 3000, 0.06 / 400
    angle, z = np.meshgrid((np.arange(3000) + 0.5) * turn, 0.09 + (np.arange(400) + 0.5) * heights)
    outward = velocity[0] * np.cos(angle) + velocity[1] * np.sin(angle)
    for R, edge_flow in zip(GRID.r_edges, flow, strict=True):
        inside = R**2 + distance**2 - 2 * R * distance * np.cos(angle) + (z - 0.12) ** 2 < RADIUS**2
        brute = (inside * outward).sum() * R * turn * heights
        assert edge_flow == pytest.approx(brute, abs=4e-3 * 0.7 * np.pi * RADIUS**2)


def balance_residual(points, dt, seed=2):
    """Norm of ΔV/Δt + ∇·flow over its own terms, for free flight of random spheres, flow taken at mid-time."""
    rng = np.random.default_rng(seed)
    count = 200
    position = np.column_stack([rng.uniform(-0.17, 0.17, (count, 2)), rng.uniform(0, 0.24, count)])
    velocity = rng.normal(size=(count, 3))
    radius = rng.uniform(0.5, 1, count) * RADIUS
    before, after = (deposit(position + s * dt * velocity, radius, velocity, GRID, points).volume for s in (-0.5, 0.5))
    middle = deposit(position, radius, velocity, GRID, points)
    change = (after - before) / dt
    outflow = np.diff(middle.flow_r, axis=1) + np.diff(middle.flow_z, axis=0)
    return np.linalg.norm(change + outflow) / np.linalg.norm(change)


def test_the_balance_of_every_cell_closes_with_the_order_of_quadrature():
    residual = [balance_residual(points, 1e-6) for points in (2, 4, 8, 16, 32)]
    assert all(later < 0.75 * earlier for earlier, later in pairwise(residual))
    assert residual[-1] < 0.1 * residual[0]


def test_the_balance_of_every_cell_closes_with_the_time_step():
    residual = [balance_residual(48, dt) for dt in (0.016, 0.008, 0.004, 0.002)]
    assert all(later < 0.5 * earlier for earlier, later in pairwise(residual))


def test_packing_of_random_overlapping_spheres_is_flat_up_to_the_axis():
    # a bias of the rings near the axis would show here: the expected deposit is uniform
    rng = np.random.default_rng(5)
    count = 60_000
    distance = 0.34 * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * np.pi, count)
    position = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(-0.04, 0.28, count)])
    volume = deposit(position, np.full(count, RADIUS), np.zeros((count, 3)), GRID).volume
    density = count * 4 / 3 * np.pi * RADIUS**3 / (np.pi * 0.34**2 * 0.32)
    ring = volume.sum(axis=0) / (GRID.ring_area * 0.24) / density
    # rings further in see fewer spheres: allow five standard deviations of the number that touch them; the outermost
    # ring also holds what reaches beyond it
    touching = count * ((GRID.r_centres + RADIUS) / 0.34) ** 2 * 0.24 / 0.32
    assert (np.abs(ring - 1) < 5 / np.sqrt(touching))[:-1].all()
