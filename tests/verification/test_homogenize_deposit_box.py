"""Sphere–box deposit against quadrature that shares nothing with it, and its balance."""

from itertools import pairwise

import numpy as np
import pytest
from fakes.spheres import Spheres
from scipy import integrate

from granpipe.field import Box
from granpipe.homogenize.average import Collector
from granpipe.homogenize.deposit import deposit, deposit_paths

RADIUS = 0.03
CELL = RADIUS / 2  # a quarter of the diameter
VOLUME = 4 / 3 * np.pi * RADIUS**3
SIDE = (0.0, 0.24)
PLANE = Box.within(SIDE, SIDE, SIDE, CELL, flat=True, cut=True)
SPACE = Box.within(SIDE, SIDE, SIDE, CELL, flat=False, cut=True)
GRIDS = pytest.mark.parametrize("grid", [PLANE, SPACE], ids=["plane", "space"])


def cloud(count, seed, low=-0.05, high=0.29):
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (count, 3)), rng.normal(size=(count, 3)), rng.uniform(0.5, 1, count) * RADIUS


def volume_by_quadrature(low, high, centre):
    """Volume of the sphere inside a box: adaptive quadrature of its height over x and y, with the kinks given."""

    def height(y, x):
        half = np.sqrt(max(RADIUS**2 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2, 0))
        return max(0.0, min(high[2], centre[2] + half) - max(low[2], centre[2] - half))

    def circle(offset):
        """Places where the sphere passes a face `offset` off its centre."""
        return np.sqrt(max(RADIUS**2 - offset**2, 0))

    def over_y(x):
        kinks = [circle(np.hypot(x - centre[0], z - centre[2])) for z in (low[2], high[2], centre[2])]
        points = [y for k in kinks for y in (centre[1] - k, centre[1] + k) if low[1] < y < high[1]]
        return integrate.quad(height, low[1], high[1], args=(x,), points=points or None, epsabs=1e-9)[0]

    ends = max(low[0], centre[0] - RADIUS), min(high[0], centre[0] + RADIUS)
    offsets = [z - centre[2] for z in (low[2], high[2])] + [y - centre[1] for y in (low[1], high[1])]
    points = [x for d in offsets for x in (centre[0] - circle(d), centre[0] + circle(d)) if ends[0] < x < ends[1]]
    return integrate.quad(over_y, *ends, points=points or None, epsabs=1e-8)[0] if ends[0] < ends[1] else 0.0


@GRIDS
@pytest.mark.parametrize("shift", [(0, 0, 0), (0.5, 0.5, 0.5), (0.13, 0.77, 0.31), (0.01, 0.5, 0.99), (0.5, 0.02, 0)])
def test_cells_are_within_a_thousandth_of_the_sphere_of_adaptive_quadrature(grid, shift):
    centre = 0.12 + CELL * np.array(shift)
    volume = deposit(centre[None], np.array([RADIUS]), np.zeros((1, 3)), grid, points=3).volume
    assert volume.sum() == pytest.approx(VOLUME, rel=1e-12)
    cells = volume if grid is SPACE else volume[:, None]
    some = np.random.default_rng(0).permutation(np.argwhere(cells > 0))[:16]
    for iz, iy, ix in some:
        low = grid.r_edges[ix], grid.y_edges[iy], grid.z_edges[iz]
        high = grid.r_edges[ix + 1], grid.y_edges[iy + 1], grid.z_edges[iz + 1]
        assert abs(cells[iz, iy, ix] - volume_by_quadrature(low, high, centre)) < 1e-3 * VOLUME


@GRIDS
def test_the_volume_of_spheres_is_kept(grid):
    position, velocity, radius = cloud(300, 1, 0.04, 0.2)
    volume = deposit(position, radius, velocity, grid).volume
    assert volume.sum() == pytest.approx((4 / 3 * np.pi * radius**3).sum(), rel=1e-12)
    assert volume.min() > -1e-12 * VOLUME


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_only_the_part_inside_counts(axis):
    cap = np.pi * 0.01**2 * (3 * RADIUS - 0.01) / 3  # of height 0.01 m
    for grid in (PLANE, SPACE):
        for place, expected in ((-0.02, cap), (0.26, cap), (0.02, VOLUME - cap), (-0.05, 0), (5.0, 0)):
            centre = np.full((1, 3), 0.123)
            centre[0, axis] = place
            volume = deposit(centre, np.array([RADIUS]), np.zeros((1, 3)), grid, points=8).volume
            assert volume.sum() == pytest.approx(expected, rel=1e-12, abs=1e-18 if axis == 2 else 1e-3 * VOLUME)


def test_in_the_plane_is_the_sum_over_y_of_that_in_space():
    position, velocity, radius = cloud(200, 2)
    plane, space = (deposit(position, radius, velocity, grid) for grid in (PLANE, SPACE))
    for name in ("volume", "flow_r", "flow_z"):
        assert np.allclose(getattr(plane, name), getattr(space, name).sum(axis=1), rtol=1e-11, atol=1e-18)


def test_without_a_cut_spheres_count_wholly_wherever_they_are_in_the_depth():
    whole = Box.within(SIDE, SIDE, SIDE, CELL, flat=True, cut=False)
    position, velocity, radius = cloud(200, 3)
    moved = position * [1, 0, 1] + [0, 0.12, 0]
    for one, other in zip(
        deposit(position, radius, velocity, whole), deposit(moved, radius, velocity, PLANE), strict=True
    ):
        assert np.allclose(one, other, rtol=1e-11, atol=1e-18)


@pytest.mark.parametrize(("axis", "name"), [(0, "flow_r"), (1, "flow_y"), (2, "flow_z")])
def test_rigid_motion_carries_the_cut_area_through_every_plane(axis, name):
    position, _, radius = cloud(150, 4, 0.04, 0.2)
    flow = getattr(deposit(position, radius, np.tile(0.3 * np.eye(3)[axis], (150, 1)), SPACE, points=24), name)
    array_axis = {"flow_r": 2, "flow_y": 1, "flow_z": 0}[name]
    through = flow.sum(axis=tuple({0, 1, 2} - {array_axis}))
    edges = np.linspace(*SIDE, len(through))
    cut = np.maximum(radius[:, None] ** 2 - (edges - position[:, axis, None]) ** 2, 0)
    assert np.allclose(through, 0.3 * np.pi * cut.sum(axis=0), rtol=2e-3, atol=1e-6)


def outflow(result, grid):
    net = np.diff(result.flow_r, axis=-1) + np.diff(result.flow_z, axis=0)
    return net + np.diff(result.flow_y, axis=1) if grid is SPACE else net


def balance_residual(grid, points, dt):
    """Norm of ΔV/Δt + ∇·flow over its own terms, for free flight of random spheres, flow taken at mid-time."""
    position, velocity, radius = cloud(60, 5)
    if grid is PLANE:  # its front and back carry what leaves along y
        position[:, 1] = 0.12
        velocity[:, 1] = 0
    before, after = (deposit(position + s * dt * velocity, radius, velocity, grid, points).volume for s in (-0.5, 0.5))
    change = (after - before) / dt
    return np.linalg.norm(change + outflow(deposit(position, radius, velocity, grid, points), grid)) / np.linalg.norm(
        change
    )


@GRIDS
def test_the_balance_of_every_cell_closes_with_the_order_of_quadrature(grid):
    residual = [balance_residual(grid, points, 1e-6) for points in (2, 4, 8, 16)]
    assert all(later < 0.75 * earlier for earlier, later in pairwise(residual))
    assert residual[-1] < 0.15 * residual[0]


@GRIDS
def test_the_balance_of_every_cell_closes_with_the_time_step(grid):
    residual = [balance_residual(grid, 32, dt) for dt in (0.016, 0.008, 0.004)]
    assert all(later < 0.5 * earlier for earlier, later in pairwise(residual))


def test_displacement_closes_the_balance_in_space_of_particles_that_stop_at_every_snapshot():
    position, velocity, radius = cloud(60, 6)
    collector = Collector(SPACE, "displacement", points=6)
    for step in range(3):
        place = position + 0.01 * step * velocity
        collector.add(0.01 * step, Spheres(np.arange(1, 61), place, 0 * velocity, radius))
    sums = collector.take()
    flow = np.diff(sums.flow_r, axis=2) + np.diff(sums.flow_z, axis=0) + np.diff(sums.flow_y, axis=1)
    assert np.abs(flow / sums.weight + sums.storage).sum() < 0.05 * np.abs(sums.storage).sum()


def test_paths_in_the_plane_carry_what_the_ends_differ_by():
    position, velocity, radius = cloud(40, 7)
    position[:, 1], velocity[:, 1] = 0.12, 0
    before, after = (deposit(position + t * velocity, radius, velocity, PLANE, 8).volume for t in (0, 0.02))
    mean = deposit_paths(position, 0.02 * velocity, radius, 0.02, PLANE, 8)
    change = (after - before) / 0.02
    assert np.linalg.norm(change + outflow(mean, PLANE)) < 0.05 * np.linalg.norm(change)
