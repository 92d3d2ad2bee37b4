"""Walls that pass through each other, or lie within one another, leave it open what is inside: they are refused."""

from __future__ import annotations

import numpy as np
import pytest
from fakes.space_walls import between, rectangle

from granpipe.errors import CaseError
from granpipe.geometry.crossings import crossing
from granpipe.geometry.space_vessel import SpaceVessel


def block(width: float, depth: float, low: float, high: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """Triangles (12, 3, 3) of a closed block [mm]."""
    rings = [rectangle(width, depth, z, x=x) + np.array([0, y, 0]) for z in (low, high)]
    return np.concatenate([between(rings), *(np.array([one[[0, 1, 2]], one[[0, 2, 3]]]) for one in rings)])


def bin_with(*obstacles: np.ndarray) -> SpaceVessel:
    """A square bin, 120 mm wide and high, open at both ends, with closed surfaces in it."""
    triangles = np.concatenate([between([rectangle(120, 120, 120), rectangle(120, 120, 0)]), *obstacles])
    return SpaceVessel.of(1e-3 * triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), {})


def first_crossing(*surfaces: np.ndarray) -> np.ndarray | None:
    triangles = np.concatenate(surfaces)
    return crossing(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), 0.01)


def test_bars_that_cross_are_refused_with_a_place_in_both() -> None:
    with pytest.raises(CaseError, match=r"pass through each other at \((.*), (.*), (.*)\) m") as error:
        bin_with(block(80, 16, 70, 90), block(16.2, 80, 70.3, 90.2))
    place = [float(one) for one in str(error.value).split("(")[1].split(")")[0].split(",")]
    assert (np.abs(place[:2]) <= 8.11e-3).all()
    assert 70e-3 <= place[2] <= 90.3e-3


def test_a_bar_through_the_walls_is_refused_though_its_corners_lie_inside() -> None:
    """In an L-shaped bin, from one arm to the other, across the corner that is outside."""
    corner = np.array([(0, 0), (120, 0), (120, 50), (50, 50), (50, 120), (0, 120)], dtype=float)
    walls = between([np.column_stack([corner, np.full(6, z)]) for z in (100.0, 0.0)])
    begin, end, aside = np.array([100, 25]), np.array([25, 100]), np.array([3.5, 3.5])
    side = np.array([begin + aside, begin - aside, end - aside, end + aside])
    rings = [np.column_stack([side, np.full(4, z)]) for z in (40.0, 60.0)]
    bar = np.concatenate([between(rings), *(np.array([one[[0, 1, 2]], one[[0, 2, 3]]]) for one in rings)])
    triangles = np.concatenate([walls, bar])
    with pytest.raises(CaseError, match="pass through each other"):
        SpaceVessel.of(1e-3 * triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), {})


def test_surfaces_that_touch_do_not_cross() -> None:
    """Blocks beside each other with a common face of other corners, and one whose edge stands on another's face."""
    assert first_crossing(block(20, 20, 0, 20), block(20, 20, 0, 20, x=20)) is None
    assert first_crossing(block(40, 40, 0, 20), block(10, 10, 20, 30, x=3, y=5)) is None
    assert first_crossing(block(20, 20, 0, 20), block(20, 20, 0, 20, x=19.995)) is None
    assert first_crossing(block(20, 20, 0, 20), block(10, 30, 5, 15, x=14)) is not None


def test_of_many_triangles_the_one_pair_that_crosses_is_found() -> None:
    """5000 small triangles on a lattice of their own places, one of them pierced by a needle."""
    place = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)[:5000]
    flat = place[:, None] + 0.4 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    needle = place[1234] + np.array([[(0.1, 0.1, -0.3), (0.1, 0.12, 0.3), (0.12, 0.1, 0.3)]])
    assert first_crossing(flat) is None
    found = first_crossing(flat, needle)
    assert found is not None
    np.testing.assert_allclose(found, place[1234] + (0.1, 0.1, 0), atol=0.02)


def test_a_cavity_in_an_obstacle_is_no_part_of_the_vessel() -> None:
    with pytest.raises(CaseError, match=r"not one piece: .* within an obstacle"):
        bin_with(block(50, 50, 60, 100), block(40, 40, 65, 95))


def test_obstacles_may_touch_walls_and_each_other() -> None:
    made = bin_with(block(20, 20, 30, 50), block(20, 16, 32, 48, x=20), block(20, 100, 70, 90, x=-50))
    assert made.outline.volume() == pytest.approx(1e-9 * (120**3 - 20**3 - 20 * 16 * 16 - 20 * 100 * 20), rel=2e-3)


def test_walls_far_from_the_origin_are_refused() -> None:
    """In single precision a vessel of 0.12 m that lies 10 km away has lost a hundredth of its width."""
    triangles = 1e-3 * between([rectangle(120, 120, 120), rectangle(120, 120, 0)]) + np.array([1e4, 0, 0])
    with pytest.raises(CaseError, match="move them to the origin"):
        SpaceVessel.of(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), {})
