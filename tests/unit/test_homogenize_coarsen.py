"""Joined cells: they hold what the small ones held, as if it had been deposited on them."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.errors import DataError
from granpipe.field import Grid
from granpipe.homogenize.average import Collector
from granpipe.homogenize.coarsen import coarsened


class Spheres:
    def __init__(self, z: float) -> None:
        rng = np.random.default_rng(3)
        n = 40
        self.id = np.arange(n)
        self.position = np.column_stack([rng.uniform(-0.3, 0.3, (n, 2)), rng.uniform(0.2, 0.8, n)]) - [0.6 * z, 0, z]
        self.velocity = np.tile([0.0, 0.0, -1.0], (n, 1))
        self.radius = np.full(n, 0.05)


def sums(cell: float):
    collector = Collector(Grid.covering(0.5, 0.0, 1.0, cell), "displacement")
    for step in range(3):
        collector.add(float(step), Spheres(0.05 * step))
    return collector.take()


@pytest.mark.parametrize("factor", [2, 4])
def test_joined_cells_hold_what_is_deposited_on_large_ones(factor: int) -> None:
    joined, direct = coarsened(sums(0.025), factor), sums(0.025 * factor)
    assert joined.grid.shape == direct.grid.shape
    for name in ("volume", "gain", "flow_r", "flow_z", "level_flow"):
        one, other = getattr(joined, name), getattr(direct, name)
        quadrature = 5e-2 if "flow" in name else 5e-3  # which is finer on smaller cells
        assert np.abs(one - other).max() < quadrature * np.abs(other).max(), name


def test_a_column_too_few_is_filled_up() -> None:
    collector = Collector(Grid.covering(0.475, 0.0, 1.0, 0.025), "displacement")
    for step in range(3):
        collector.add(float(step), Spheres(0.05 * step))
    fine = collector.take()
    joined = coarsened(fine, 2)
    assert joined.grid.shape == (20, 10)
    assert joined.volume.sum() == pytest.approx(fine.volume.sum())
    assert np.allclose(joined.mean_flux[1] @ joined.grid.ring_area, (fine.mean_flux[1] @ fine.grid.ring_area)[::2])


def test_rows_that_cannot_be_joined_are_refused() -> None:
    with pytest.raises(DataError, match=r"homogenize\.cell"):
        coarsened(sums(0.025), 3)
