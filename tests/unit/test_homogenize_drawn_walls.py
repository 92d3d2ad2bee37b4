"""Sums of particles between walls that are set back, cut at the walls as drawn: nothing of a level's flow is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fakes.sums import NOTHING

from granpipe.field import Grid, level_flow
from granpipe.geometry.outline import Outline
from granpipe.homogenize.average import Sums, merge
from granpipe.homogenize.drawn_walls import share_in_solid, within_drawn

GRID, WIDE = Grid.covering(0.1, 0.0, 0.4, 0.01), Grid.covering(0.13, 0.0, 0.4, 0.01)
FUNNEL = Outline.of([[0.1, 0.4], [0.1, 0.2], [0.05, 0.1], [0.05, 0.0]])
INSIDE = FUNNEL.inside_fraction(GRID)


def plug(speed: float, start: float = 0.0) -> Sums:
    """Solids that sink everywhere alike; what they fill grows with the speed."""
    rows, columns = WIDE.shape
    return replace(
        NOTHING,
        grid=WIDE, start=start, stop=start + 1,
        volume=0.5 * np.broadcast_to(WIDE.cell_volume, WIDE.shape).copy(),
        flow_r=0.01 * np.ones((rows, columns + 1)),
        flow_z=-speed * np.broadcast_to(WIDE.ring_area, (rows + 1, columns)).copy(),
        gain=speed * np.ones((rows, columns)),
        level_flow=np.zeros((1, rows + 1)),
    )  # fmt: skip


def test_flow_and_storage_of_a_level_stay_and_the_solid_is_empty() -> None:
    (cut,) = within_drawn([plug(2.0)], GRID, INSIDE)
    carried = 2.0 * np.pi * 0.13**2
    assert level_flow(cut.mean_flux[1], GRID) == pytest.approx(np.full(41, carried))
    assert cut.gain.sum(axis=1) == pytest.approx(2.0 * WIDE.shape[1])
    solid = INSIDE <= 0.5
    assert not cut.flow_z[1:][solid].any()
    assert not cut.flow_z[:-1][solid].any()
    assert not cut.flow_r[:, -1].any()
    free = INSIDE > 1 - 1e-9
    assert cut.mean_volume[free] == pytest.approx(0.5 * np.broadcast_to(GRID.cell_volume, GRID.shape)[free])


def test_solids_in_a_cell_that_a_wall_cuts_are_those_of_its_free_part() -> None:
    (cut,) = within_drawn([plug(2.0)], GRID, INSIDE)
    assert cut.mean_volume.sum() == pytest.approx(0.5 * FUNNEL.volume())


def test_one_factor_for_all_segments_so_that_their_mean_is_the_mean_cut() -> None:
    several = [plug(1.0), plug(0.0, 1.0), plug(3.0, 2.0)]
    parts = merge(within_drawn(several, GRID, INSIDE))
    (whole,) = within_drawn([merge(several)], GRID, INSIDE)
    for name in ("volume", "flow_r", "flow_z", "gain"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name)), name


def test_a_level_without_flow_stays_without() -> None:
    still = plug(0.0)
    (cut,) = within_drawn([still], GRID, INSIDE)
    assert not cut.flow_z.any()
    assert share_in_solid([still], INSIDE) == 1  # nothing passes: no level tells a share, and no gate lets it pass


def test_the_share_in_the_solid_is_that_of_the_narrowest_level() -> None:
    assert share_in_solid([plug(2.0)], INSIDE) == pytest.approx(1 - (0.05 / 0.13) ** 2)
