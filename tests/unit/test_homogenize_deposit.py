"""Sphere–ring deposit: conservation, projection, edges of the grid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.field import Grid
from granpipe.homogenize.deposit import deposit

GRID = Grid.covering(0.6, 0.0, 0.9, 0.015)


def sphere_volume(radius):
    return 4 / 3 * np.pi * np.asarray(radius) ** 3


def random_spheres(count, seed=0, clearance=0.05):
    """Spheres wholly inside the grid; a third of them on or astride the axis."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.01, clearance, count)
    distance = (0.6 - clearance) * np.sqrt(rng.random(count))
    distance[: count // 3] = rng.uniform(0, 1, count // 3) * radius[: count // 3]
    distance[0] = 0
    angle = rng.uniform(0, 2 * np.pi, count)
    height = rng.uniform(clearance, 0.9 - clearance, count)
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle), height]), radius


@pytest.mark.parametrize("points", [2, 3, 5])
def test_the_volume_of_spheres_is_kept_also_astride_the_axis(points):
    position, radius = random_spheres(400)
    volume = deposit(position, radius, np.zeros_like(position), GRID, points).volume
    assert volume.sum() == pytest.approx(sphere_volume(radius).sum(), rel=1e-12)


@settings(deadline=None, max_examples=200)
@given(
    distance=st.floats(0, 0.5),
    height=st.floats(0.1, 0.8),
    radius=st.floats(1e-4, 0.1),
    cell=st.sampled_from([0.005, 0.015, 0.05, 0.3]),
)
def test_the_volume_of_any_single_sphere_is_kept(distance, height, radius, cell):
    grid = Grid.covering(0.6, 0.0, 0.9, cell)
    volume = deposit(np.array([[0, distance, height]]), np.array([radius]), np.zeros((1, 3)), grid).volume
    assert volume.sum() == pytest.approx(sphere_volume(radius), rel=1e-12)
    assert volume.min() > -1e-12 * sphere_volume(radius)


@pytest.mark.parametrize("multiple", [1, 2, 3, 4])
@pytest.mark.parametrize("distance", [0, 0.03, 0.3])
def test_spheres_that_touch_cell_edges_exactly_are_kept(multiple, distance):
    radius = multiple * GRID.cell
    volume = deposit(np.array([[distance, 0, 0.45]]), np.array([radius]), np.zeros((1, 3)), GRID).volume
    assert volume.sum() == pytest.approx(sphere_volume(radius), rel=1e-12)


def test_no_cell_beyond_the_spheres_receives_anything():
    volume = deposit(np.array([[0.31, 0, 0.45]]), np.array([0.04]), np.ones((1, 3)), GRID)
    r, z = GRID.r_edges, GRID.z_edges
    apart = (r[None, 1:] < 0.27) | (r[None, :-1] > 0.35) | (z[1:, None] < 0.41) | (z[:-1, None] > 0.49)
    assert not volume.volume[apart].any()


def test_a_sphere_in_one_cell_fills_only_that():
    grid = Grid.covering(0.6, 0.0, 0.9, 0.3)
    volume = deposit(np.array([[0.3, 0.33, 0.4]]), np.array([0.05]), np.ones((1, 3)), grid)
    assert volume.volume[1, 1] == pytest.approx(sphere_volume(0.05), rel=1e-12)
    assert np.count_nonzero(volume.volume) == 1
    assert not volume.flow_r.any()
    assert not volume.flow_z.any()


def test_only_the_part_between_bottom_and_top_counts():
    cap = np.pi * 0.01**2 * (3 * 0.04 - 0.01) / 3  # cap of height 0.01 m
    for height, expected in ((-0.03, cap), (0.93, cap), (0.03, sphere_volume(0.04) - cap), (-0.05, 0), (5.0, 0)):
        volume = deposit(np.array([[0.2, 0, height]]), np.array([0.04]), np.zeros((1, 3)), GRID).volume
        assert volume.sum() == pytest.approx(expected, rel=1e-12)


def test_overlap_with_the_wall_counts_in_the_outermost_ring():
    radius, centre = 0.04, 0.57
    result = deposit(np.array([[centre, 0, 0.45]]), np.array([radius]), np.array([[1.0, 0, 1.0]]), GRID)
    assert result.volume.sum() == pytest.approx(sphere_volume(radius), rel=1e-12)
    wider = deposit(
        np.array([[centre, 0, 0.45]]), np.array([radius]), np.array([[1.0, 0, 1.0]]), Grid.covering(0.63, 0, 0.9, 0.015)
    )
    assert np.allclose(result.volume[:, :-1], wider.volume[:, :39], rtol=1e-12, atol=1e-20)
    assert np.allclose(result.volume[:, -1], wider.volume[:, 39:].sum(axis=1), rtol=1e-12, atol=1e-20)
    assert np.allclose(result.flow_z[:, -1], wider.flow_z[:, 39:].sum(axis=1), rtol=1e-12, atol=1e-20)
    assert not result.flow_r[:, -1].any()


def test_of_a_sphere_centred_outside_only_the_inner_part_counts():
    position, radius = np.array([[0.62, 0, 0.45]]), np.array([0.04])
    result = deposit(position, radius, np.array([[-1.0, 0, 0]]), GRID)
    wider = deposit(position, radius, np.array([[-1.0, 0, 0]]), Grid.covering(0.75, 0, 0.9, 0.015))
    assert 0 < result.volume.sum() < sphere_volume(0.04)
    assert np.allclose(result.volume, wider.volume[:, :40], rtol=1e-12, atol=1e-20)
    assert np.allclose(result.flow_r, wider.flow_r[:, :41], rtol=1e-12, atol=1e-20)


def test_rigid_vertical_motion_is_reproduced():
    # through every level: speed times the area that the spheres cut out of it, counted sphere by sphere
    position, radius = random_spheres(300, seed=3)
    result = deposit(position, radius, np.tile([0, 0, -0.2], (300, 1)), GRID)
    cut = np.maximum(radius[:, None] ** 2 - (GRID.z_edges - position[:, 2:]) ** 2, 0)
    assert np.allclose(result.flow_z.sum(axis=1), -0.2 * np.pi * cut.sum(axis=0), rtol=1e-12, atol=1e-16)
    assert not result.flow_r.any()


def test_rigid_sideways_motion_carries_nothing_on_balance_through_rings_that_hold_whole_spheres():
    position, radius = random_spheres(300, seed=4)
    position[:, :2] *= 0.4
    result = deposit(position, radius, np.tile([0.3, -0.1, 0], (300, 1)), GRID)
    assert not result.flow_z.any()
    assert not result.flow_r[:, 30:].any()


def test_solid_body_spin_about_the_axis_crosses_no_ring():
    position, radius = random_spheres(200, seed=5)
    spin = np.column_stack([-position[:, 1], position[:, 0], np.zeros(200)])
    result = deposit(position, radius, spin, GRID)
    reference = deposit(position, radius, np.column_stack([position[:, :2], np.zeros(200)]), GRID)
    assert np.abs(result.flow_r).max() < 1e-14 * np.abs(reference.flow_r).max()


def test_result_does_not_depend_on_order():
    position, radius = random_spheres(200, seed=6)
    velocity = np.random.default_rng(1).normal(size=(200, 3))
    whole = deposit(position, radius, velocity, GRID)
    order = np.random.default_rng(2).permutation(200)
    for one, other in zip(whole, deposit(position[order], radius[order], velocity[order], GRID), strict=True):
        assert np.allclose(one, other, rtol=1e-11, atol=1e-18)


def test_deposit_is_linear_in_the_velocity():
    position, radius = random_spheres(100, seed=7)
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 100, 3))
    one, two, both = (deposit(position, radius, v, GRID) for v in (a, b, 2 * a - b))
    assert np.allclose(both.flow_r, 2 * one.flow_r - two.flow_r, atol=1e-16)
    assert np.allclose(both.flow_z, 2 * one.flow_z - two.flow_z, atol=1e-16)


def test_no_particles_give_an_empty_deposit():
    result = deposit(np.empty((0, 3)), np.empty(0), np.empty((0, 3)), GRID)
    assert [array.shape for array in result] == [(60, 40), (60, 41), (61, 40), (0,)]
    assert not any(array.any() for array in result)


def test_loops_are_compiled_where_no_folder_keeps_them(monkeypatch):
    import numba

    from granpipe.homogenize.compiled_numba import compiled

    real = numba.njit

    def without_folder(*arguments, **options):
        if options.pop("cache", False):
            raise RuntimeError("cannot cache function: no locator available")
        return real(*arguments, **options)

    monkeypatch.setattr(numba, "njit", without_folder)
    assert compiled(lambda x: x / 2)(3.0) == 1.5
