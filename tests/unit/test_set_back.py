"""Walls set back by a distance, against hand-made outlines."""

from __future__ import annotations

import numpy as np
import pytest
from set_back import set_back

RING = np.array([[0.75, 1.85], [1.156, 1.85], [1.156, 2.10], [0.75, 2.10]])
REACTOR = np.array([[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]])


def same_corners(found: np.ndarray, expected: list[tuple[float, float]]) -> bool:
    """Whether the points are these corners, wherever the polygon begins."""
    return len(found) == len(expected) and np.allclose(sorted(found.round(9).tolist()), sorted(expected), atol=1e-9)


def test_a_shaft_becomes_wider_and_no_longer() -> None:
    wall, _ = set_back(np.array([[1.0, 2.0], [1.0, 0.0]]), {}, 0.1)
    assert wall == pytest.approx(np.array([[1.1, 2.0], [1.1, 0.0]]))


def test_every_face_of_the_reactor_moves_by_the_distance_and_corners_stay_corners() -> None:
    wall, _ = set_back(REACTOR, {}, 0.03)
    down = 0.03 * (np.sqrt(1.25) - 0.5) / 0.5 - 0.03  # where the cone's face, r + 0.03·√1.25 wider, meets the shaft's
    corners = [(1.03, 5.9), (1.03, 4.9 - down), (0.53, 3.9 - down), (0.53, 3.43), (1.186, 3.43), (1.186, 0)]
    assert wall == pytest.approx(np.array(corners))


def test_a_ring_on_the_wall_stays_on_it_and_becomes_thinner() -> None:
    _, obstacles = set_back(REACTOR, {"ring": RING}, 0.03)
    assert same_corners(obstacles["ring"], [(0.78, 1.88), (1.186, 1.88), (1.186, 2.07), (0.78, 2.07)])


def test_a_cone_on_the_axis_stays_on_it() -> None:
    cone = np.array([[0.0, 1.5], [0.0, 1.0], [0.5, 1.0]])  # 45 degrees, standing on a level face
    _, obstacles = set_back(np.array([[1.0, 2.0], [1.0, 0.0]]), {"cone": cone}, 0.1)
    tip = 1.5 - 0.1 * np.sqrt(2)
    assert same_corners(obstacles["cone"], [(0.0, tip), (0.0, 1.1), (tip - 1.1, 1.1)])


def test_a_free_ring_shrinks_on_all_sides() -> None:
    ring = np.array([[0.4, 0.8], [0.7, 0.8], [0.7, 1.2], [0.4, 1.2]])
    _, obstacles = set_back(np.array([[1.0, 2.0], [1.0, 0.0]]), {"ring": ring}, 0.05)
    assert same_corners(obstacles["ring"], [(0.45, 0.85), (0.65, 0.85), (0.65, 1.15), (0.45, 1.15)])


def test_an_obstacle_of_which_nothing_is_left_is_refused() -> None:
    plate = np.array([[0.4, 1.0], [0.7, 1.0], [0.7, 1.1], [0.4, 1.1]])
    with pytest.raises(ValueError, match="plate is thinner"):
        set_back(np.array([[1.0, 2.0], [1.0, 0.0]]), {"plate": plate}, 0.06)
