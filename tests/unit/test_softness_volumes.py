"""Volumes and flows as of rigid particles: packing falls, velocities stay."""

from dataclasses import replace

import numpy as np
import pytest

from granpipe.field import Grid
from granpipe.homogenize.average import Sums
from granpipe.pipeline.softness import as_rigid, rigid_share


def average() -> Sums:
    """Sums of a column that sinks."""
    grid, ones = Grid.covering(0.1, 0.0, 0.2, 0.02), np.ones(1)
    return Sums(
        grid=grid,
        sampling="velocity",
        start=0.0,
        stop=1.0,
        duration=1.0,
        weight=1.0,
        volume=0.6 * np.ones(grid.shape) * grid.cell_volume,
        flow_r=1e-3 * np.ones((grid.shape[0], grid.shape[1] + 1)),
        flow_z=-0.01 * np.ones((grid.shape[0] + 1, grid.shape[1])) * grid.ring_area,
        gain=1e-4 * np.ones(grid.shape),
        time=ones,
        level_flow=np.ones((1, grid.shape[0] + 1)),
        solids=ones,
        kinetic=ones,
        count=ones,
    )


def test_a_bed_compressed_affinely_has_the_packing_of_the_rigid_one_after_correction():
    """All lengths times 1 − δ, radii as they were: the packing rises by (1 − δ)⁻³, and every contact overlaps by δ."""
    overlap, rigid = 0.011, 0.58
    assert rigid * (1 - overlap) ** -3 * rigid_share(overlap) == pytest.approx(rigid)


def test_velocities_stay_and_packing_falls():
    sums = replace(average(), extra={"class_volume": np.ones(3), "wall_slide": np.ones(2)})
    (rigid,) = as_rigid([sums], 0.01)
    assert rigid.volume.sum() == pytest.approx(0.970299 * sums.volume.sum())
    np.testing.assert_allclose(rigid.flow_z[:-1] / rigid.volume, sums.flow_z[:-1] / sums.volume)
    for name in ("flow_r", "gain", "level_flow", "solids"):
        np.testing.assert_allclose(getattr(rigid, name), 0.970299 * getattr(sums, name))
    np.testing.assert_allclose(rigid.extra["class_volume"], 0.970299)
    np.testing.assert_array_equal(rigid.extra["wall_slide"], sums.extra["wall_slide"])


def test_particles_that_do_not_overlap_are_left_alone():
    sums = average()
    np.testing.assert_array_equal(as_rigid([sums], 0.0)[0].volume, sums.volume)
