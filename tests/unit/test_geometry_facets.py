"""The rule for facets and rows, without gmsh."""

from itertools import pairwise

import numpy as np
import pytest

from granpipe.errors import MeshError
from granpipe.geometry.revolve import Turn, generatrix


def test_corners_stand_outside_the_circle_so_that_areas_agree():
    for facets in (12, 24, 100):
        turn = Turn(facets, 0.01)
        polygon = facets / 2 * np.sin(2 * np.pi / facets) * turn.scale**2
        assert polygon == pytest.approx(np.pi, rel=1e-14)
        assert turn.inward == pytest.approx((np.pi / facets) ** 2 / 6, rel=0.05)


def test_facets_are_as_few_as_the_chord_error_allows():
    assert Turn.within(1.156, 0.12).facets == 24  # π/acos(1 − 0.012/1.156) = 21.8
    assert Turn.within(1.156, 0.06).facets == 32  # 30.8
    assert Turn.within(0.1, 0.12).facets == 12


def test_particles_far_too_small_for_the_vessel_are_refused():
    with pytest.raises(MeshError, match="coarse_grain_factor"):
        Turn.within(2.0, 0.0005)


def test_long_rows_are_cut_and_short_ones_are_not():
    turn = Turn(24, 0.01)
    assert len(generatrix(np.array([[1.0, 2], [1, 0]]), turn, "wall")) == 2
    tall = generatrix(np.array([[1.0, 9], [1, 0]]), turn, "wall")
    assert np.diff(tall[:, 1]) == pytest.approx(-9 / (len(tall) - 1))
    cone = generatrix(np.array([[1.0, 1], [0.01, 0]]), turn, "wall")
    ratios = cone[1:, 0] / cone[:-1, 0]
    assert ratios == pytest.approx(ratios[0])  # all rows have one shape
    assert all(np.degrees(turn.smallest_angle(a, b)) >= 5 for a, b in pairwise(cone))


def test_a_needle_becomes_blunt_by_no_more_than_the_allowance():
    line = generatrix(np.array([[0.0, 3], [0.05, 0], [0, 0]]), Turn(24, 0.01), "needle")
    assert line[0, 0] == 0
    assert line[1] == pytest.approx([0.01, 2.4])
    assert line[0, 1] == pytest.approx(2.4)
    assert line[-1] == pytest.approx([0, 0])


def test_a_tiny_step_is_left_out_only_where_particles_cannot_tell():
    step = np.array([[1.0, 2], [1, 1], [1.002, 1], [1.002, 0]])
    assert len(generatrix(step, Turn(24, 0.003), "wall")) == 3
    with pytest.raises(MeshError, match="leave it out"):
        generatrix(step, Turn(24, 0.001), "wall")


def test_the_chord_error_is_the_height_of_the_circle_above_the_chord() -> None:
    turn = Turn.of(8, 0.02)
    assert turn.facets == 8
    assert turn.chord_error(0.06) == pytest.approx(0.06 * (1 - np.cos(np.pi / 8)))
