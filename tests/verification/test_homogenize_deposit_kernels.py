"""The compiled kernel against numpy's."""

import numpy as np
import pytest

from granpipe.field import Box, Grid
from granpipe.homogenize import deposit as module
from granpipe.homogenize import deposit_box as boxes

pytest.importorskip("numba")


@pytest.mark.parametrize(("cell", "points"), [(0.015, 3), (0.004, 2), (0.1, 5)])
def test_compiled_and_numpy_kernels_agree_to_rounding(cell, points):
    rng = np.random.default_rng(8)
    count = 500
    distance = 0.62 * np.sqrt(rng.random(count))
    distance[:50] = rng.uniform(0, 0.02, 50)
    distance[0] = 0
    angle = rng.uniform(0, 2 * np.pi, count)
    position = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(-0.1, 1, count)])
    spheres = module._cylindrical(position, rng.uniform(0.01, 0.05, count), rng.normal(size=(count, 3)))
    grid = Grid.covering(0.6, 0.0, 0.9, cell)
    results = []
    for add in (module._add, module._add_compiled):
        total = module.empty_deposit(grid)
        add(spheres, grid, points, total)
        results.append(total)
    for one, other in zip(*(total[:3] for total in results), strict=True):
        assert np.abs(one - other).max() < 1e-13 * np.abs(one).max()


def test_the_compiled_kernel_is_chosen_where_numba_is_installed():
    assert module._kernel() is module._add_compiled


@pytest.mark.parametrize(("flat", "cut"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize(("cell", "points"), [(0.02, 3), (0.1, 5)])
def test_compiled_and_numpy_kernels_agree_on_cartesian_cells(flat, cut, cell, points):
    rng = np.random.default_rng(9)
    position, velocity = rng.uniform(-0.1, 0.5, (300, 3)), rng.normal(size=(300, 3))
    position[0], position[1] = 0.2, 0.21  # on a corner of the cells, and in the middle of one
    radius = rng.uniform(0.01, 0.05, 300)
    radius[:2] = 0.04
    grid = Box.within((0.0, 0.4), (0.0, 0.3), (0.0, 0.4), cell, flat, cut)
    numpys, compiled = module.empty_deposit(grid), module.empty_deposit(grid)
    boxes._add(position, radius, velocity, grid, points, *numpys)
    boxes._add_compiled(position, radius, velocity, grid, points, *compiled)
    for one, other in zip(numpys[: 3 if flat else 4], compiled, strict=False):
        assert np.abs(one).max() > 0
        assert np.abs(one - other).max() < 1e-13 * np.abs(one).max()


def test_the_compiled_kernel_is_chosen_for_cartesian_cells_too():
    assert boxes._kernel() is boxes._add_compiled
