"""Walls set back: every face a distance inside the solid, corners kept; what cannot be is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.errors import CaseError
from granpipe.field import Array
from granpipe.geometry.outline import Outline
from granpipe.geometry.set_back import MOST, set_back

SHAFT = [[0.06, 0.1], [0.06, 0.0]]
D = 0.003


def moved(wall: list[list[float]], **obstacles: list[list[float]]) -> Outline:
    return set_back(Outline.of(wall, obstacles), D)


def corners(points: Array) -> list[list[float]]:
    """Corners in an order of their own."""
    return sorted(np.round(points, 7).tolist())


def test_the_reactor_is_set_back_as_by_hand() -> None:
    wall = [[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]
    ring = [[0.75, 1.85], [1.156, 1.85], [1.156, 2.1], [0.75, 2.1]]
    back = set_back(Outline.of(wall, {"ring": ring}), 0.05)
    bend = 0.05 * math.tan(0.5 * math.atan(0.5))  # the cone's ends move down as two lines at an angle meet farther on
    wanted = [[1.05, 5.9], [1.05, 4.9 - bend], [0.55, 3.9 - bend], [0.55, 3.45], [1.206, 3.45], [1.206, 0.0]]
    assert back.wall == pytest.approx(np.array(wanted), abs=1e-7)
    # the ring still stands on the wall, and is thinner from its three free sides
    assert corners(back.obstacles["ring"]) == [[0.8, 1.9], [0.8, 2.05], [1.206, 1.9], [1.206, 2.05]]
    assert back.stands_on("ring") == "wall"


def test_a_floor_goes_down_and_an_outlet_becomes_wider() -> None:
    back = moved([[0.06, 0.108], [0.06, 0.006], [0.03, 0.006], [0.03, 0.0]])
    assert back.wall == pytest.approx(np.array([[0.063, 0.108], [0.063, 0.003], [0.033, 0.003], [0.033, 0.0]]))


def test_a_cone_that_ends_at_the_outlet_moves_by_the_distance_across_its_wall() -> None:
    back = moved([[0.06, 0.1], [0.02, 0.0]])
    assert back.outlet_radius == pytest.approx(0.02 + D / math.cos(math.atan(0.4)))
    assert (back.inlet_radius, back.z_top, back.z_bottom) == (pytest.approx(0.063), 0.1, 0.0)  # a pipe stands above


def test_a_cone_on_the_axis_shrinks_to_a_similar_one() -> None:
    back = moved(SHAFT, cone=[[0, 0.03], [0.02, 0.03], [0, 0.06]])  # 33.7° from the vertical
    flank = D / math.sin(math.atan(2 / 3))
    assert back.stands_on("cone") == "axis"
    assert corners(back.obstacles["cone"])[:2] == [[0.0, 0.033], [0.0, round(0.06 - flank, 7)]]
    (radius, level) = corners(back.obstacles["cone"])[2]
    assert level == pytest.approx(0.033)
    assert radius == pytest.approx((0.06 - flank - 0.033) * 2 / 3, abs=1e-7)


def test_an_obstacle_that_stands_free_shrinks_from_every_side() -> None:
    back = moved(SHAFT, ring=[[0.02, 0.03], [0.04, 0.03], [0.04, 0.05], [0.02, 0.05]])
    assert corners(back.obstacles["ring"]) == [[0.023, 0.033], [0.023, 0.047], [0.037, 0.033], [0.037, 0.047]]


def test_obstacles_that_touch_become_one() -> None:
    outer = [[0.04, 0.03], [0.06, 0.03], [0.06, 0.05], [0.04, 0.05]]
    inner = [[0.03, 0.03], [0.04, 0.03], [0.04, 0.05], [0.03, 0.05]]
    back = moved(SHAFT, outer=outer, inner=inner)
    assert corners(back.obstacles.pop("outer")) == [[0.033, 0.033], [0.033, 0.047], [0.063, 0.033], [0.063, 0.047]]
    assert not back.obstacles


def test_a_rounded_edge_becomes_one_of_smaller_radius() -> None:
    angles = np.linspace(0, np.pi / 2, 19)
    rounding = np.column_stack([0.03 - 0.01 * np.sin(angles[::-1]), 0.04 + 0.01 * np.cos(angles[::-1])])
    wall = [[0.06, 0.1], [0.06, 0.05], [0.03, 0.05], *rounding[::-1].tolist()[1:], [0.02, 0.0]]
    back = set_back(Outline.of(wall), D)
    arc = back.wall[(back.wall[:, 1] < 0.0469) & (back.wall[:, 1] > 0.0401)]
    assert len(arc) > 10
    assert np.hypot(arc[:, 0] - 0.03, arc[:, 1] - 0.04) == pytest.approx(0.007, rel=2e-3)


@pytest.mark.parametrize(
    ("wall", "obstacles", "key", "what"),
    [
        ([[0.06, 0.1], [0.06, 0.002], [0.03, 0.002], [0.03, 0]], {}, "wall", "ledge"),  # the floor would be below
        ([[0.06, 0.1], [0.06, 0], [0.03, 0]], {}, "wall", "ledge"),
        ([[0.03, 0.1], [0.06, 0.1], [0.06, 0]], {}, "wall", "ledge"),
        ([[0.06, 0.1], [0.06, 0.05], [0.03, 0.05], [0.03, 0.046], [0.06, 0.046], [0.06, 0]], {}, "wall", "fin"),
        (SHAFT, {"ring": [[0.04, 0.03], [0.06, 0.03], [0.06, 0.035], [0.04, 0.035]]}, "ring", "thinner than 0.006 m"),
        (SHAFT, {"knife": [[0.03, 0.03], [0.06, 0.025], [0.06, 0.035]]}, "knife", "sharper than 39°"),
        (
            SHAFT,
            {"dumbbell": [[0.01, 0.02], [0.02, 0.02], [0.02, 0.028], [0.03, 0.028], [0.03, 0.02], [0.04, 0.02],
                          [0.04, 0.04], [0.03, 0.04], [0.03, 0.032], [0.02, 0.032], [0.02, 0.04], [0.01, 0.04]]},
            "dumbbell",
            "2 parts",
        ),
    ],
)  # fmt: skip
def test_what_would_vanish_or_move_too_far_is_refused_with_its_place(wall, obstacles, key: str, what: str) -> None:
    with pytest.raises(CaseError, match=what) as refused:
        moved(wall, **obstacles)
    assert refused.value.key[-1] == key
    assert "as_drawn" in refused.value.message


@st.composite
def walls(draw: st.DrawFn) -> list[list[float]]:
    """A wall of some straight, sloping and level edges, the last of them an upright outlet."""
    radius, z = draw(st.floats(0.1, 1.0)), 0.0
    points = [[radius, z]]
    for _ in range(draw(st.integers(1, 5))):
        z += draw(st.floats(0.1, 1.0))
        points.append([radius, z])
        slope = draw(st.sampled_from([0.0, 0.1, 0.4]))
        radius, z = draw(st.floats(0.1, 1.0)), z + slope
        if abs(radius - points[-1][0]) > 0.02:
            points.append([radius, z])
        radius = points[-1][0]
        z = points[-1][1]
    return [*points, [radius, z + 0.3]][::-1]


@settings(max_examples=60, deadline=None)
@given(walls(), st.floats(0.001, 0.03))
def test_no_point_of_the_walls_is_nearer_than_the_distance_nor_much_farther(wall, distance: float) -> None:
    drawn = Outline.of(wall)
    try:
        back = set_back(drawn, distance)
    except CaseError:
        return
    beyond = np.array([0, 9.0])
    pipe = np.vstack([drawn.wall[0] + beyond, drawn.wall, drawn.wall[-1] - beyond])
    vessel = shapely.Polygon(np.vstack([pipe, pipe[::-1] * [-1, 1]]))
    places = shapely.points(shapely.get_coordinates(shapely.segmentize(shapely.LineString(back.wall), distance)))
    assert shapely.distance(places, vessel).min() > distance - 2 * drawn.tolerance
    assert (np.diff(back.wall[:, 1]) <= 0).all()
    there = shapely.points(shapely.get_coordinates(shapely.segmentize(shapely.LineString(drawn.wall), distance)))
    assert shapely.distance(there, shapely.LineString(back.wall)).max() < MOST * distance + 2 * drawn.tolerance
    assert back.volume() > drawn.volume()


def test_a_distance_that_the_drawing_does_not_resolve_moves_nothing() -> None:
    drawn = Outline.of(SHAFT)
    assert set_back(drawn, 1e-8) is drawn
    assert set_back(drawn, 1e-5).wall[:, 0] == pytest.approx(0.06001)
