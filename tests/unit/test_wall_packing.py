"""The packing of spheres along a wall, and a fluid's field that has it."""

from __future__ import annotations

import numpy as np

from granpipe.field import Field, Grid, flux_from_psi
from granpipe.fluid.wall_packing import BULK, mean_wall_packing, packed_along_walls, wall_packing

ONE = np.array([1.0])


def plug(cells: int = 20, levels: int = 4) -> Field:
    """A plug of speed 1 and packing 0.6 in a pipe of radius 1."""
    grid = Grid(np.linspace(0, 1, cells + 1), np.linspace(0, levels / cells, levels + 1))
    psi = np.tile(-0.3 * grid.r_edges**2, (levels + 1, 1))
    flux_r, flux_z = flux_from_psi(psi, grid)
    one = np.ones(grid.shape)
    return Field(grid, one, one > 0, flux_r, flux_z, np.pi, 0.6, 1.0, psi=psi)


def from_wall(field: Field) -> np.ndarray:
    return np.tile(1 - field.grid.r_centres, (field.grid.shape[0] + 1, 1))


def test_nothing_touches_the_wall_the_first_layer_is_dense_and_the_bulk_is_even() -> None:
    assert wall_packing(np.array([-1.0, 0.0])).tolist() == [0.0, 0.0]
    # a layer of touching spheres on a triangular lattice covers π/√12 of its middle plane: no real layer does
    assert 1 < wall_packing(np.array(0.5)) < np.pi / np.sqrt(12) / BULK
    np.testing.assert_allclose(wall_packing(np.linspace(6, 12, 50)), 1.0, atol=0.01)


def test_the_average_over_a_width_is_that_of_a_fine_sum() -> None:
    width, place = 0.4, np.array([0.1, 0.3, 0.7, 2.0, 30.0])
    fine = place[:, None] + width * (np.arange(20000) + 0.5 - 10000) / 20000
    expected = wall_packing(fine).mean(axis=1)
    np.testing.assert_allclose(mean_wall_packing(place, width, ONE, ONE), expected, atol=2e-3)


def test_sizes_scale_the_distance_and_shares_weigh_them() -> None:
    place = np.array([0.2, 0.5, 1.1])
    mixed = mean_wall_packing(place, 0.1, np.array([1.0, 2.0]), np.array([0.25, 0.75]))
    alone = [mean_wall_packing(place / d, 0.1 / d, ONE, ONE) for d in (1.0, 2.0)]
    np.testing.assert_allclose(mixed, 0.25 * alone[0] + 0.75 * alone[1], rtol=1e-9)


def test_the_whole_flow_still_passes_every_level_and_the_core_is_faster() -> None:
    field = plug()
    made = packed_along_walls(field, from_wall(field), np.array([0.2]), ONE)
    grid = field.grid
    np.testing.assert_allclose(made.flux_z @ grid.ring_area, field.flux_z @ grid.ring_area, rtol=1e-12)
    assert made.flux_z[2, 0] / field.flux_z[2, 0] > 1.01
    gained = made.flux_z[2] / field.flux_z[2] / mean_wall_packing(1 - grid.r_centres, grid.cell, np.array([0.2]), ONE)
    np.testing.assert_allclose(gained, gained[0], rtol=1e-9)


def test_fine_particles_leave_the_field_as_it_is() -> None:
    field = plug()
    made = packed_along_walls(field, from_wall(field), np.array([1e-4]), ONE)
    np.testing.assert_allclose(made.flux_z, field.flux_z, rtol=1e-2)
