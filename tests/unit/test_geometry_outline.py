"""Outline: what it refuses and says, areas, intervals, openings."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from granpipe.case.reader import load_case
from granpipe.errors import CaseError
from granpipe.geometry.openings import find_openings
from granpipe.geometry.outline import Outline


@dataclass(frozen=True)
class Levels:
    z_top: float
    z_bottom: float


REACTOR = [[1.0, 5.9], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]
RING = [[0.75, 1.85], [1.156, 1.85], [1.156, 2.10], [0.75, 2.10]]
PIPE = [[1, 2], [1, 0]]
HOPPER = [[1, 3], [1, 2], [0.4, 1], [0.4, 0]]


def box(r0, r1, z0, z1):
    return [[r0, z0], [r1, z0], [r1, z1], [r0, z1]]


@pytest.mark.parametrize(
    ("wall", "key", "words"),
    [
        ([[1, 2]], (), "at least 2"),
        ([], (), "at least 2"),
        ([[1, 2], [-0.1, 0]], (1,), "-0.1"),
        ([[1, 2], [0, 0]], (1,), "radius above 0"),
        ([[1, 2], [1, np.nan]], (1,), "finite"),
        ([[1, 2], [1, 2], [1, 0]], (1,), "repeats"),
        ([[1, 0], [1, 2]], (), "top down"),
        ([[1, 3], [1, 2], [0.5, 2.5], [0.5, 0]], (2,), "overhang"),
        ([[1, 2], [0.5, 2]], (), "no height"),
        ([[1, 2], [1, 1], [0.3, 1], [0.6, 1], [0.6, 0]], (2,), "cross"),
        ([[1, 3], [0.4, 1], [0.4, 2], [0.9, 1.5], [0.9, 0]], (2,), "cross"),
    ],
)
def test_bad_walls_are_refused_with_place_and_reason(wall, key, words):
    with pytest.raises(CaseError) as caught:
        Outline.of(wall)
    assert caught.value.key == ("outline", "wall", *key)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("polygon", "key", "words"),
    [
        ([[0.2, 1], [0.4, 1]], (), "at least 3"),
        ([[0.2, 1], [0.4, 1], [0.4, 1.2], [0.2, 1]], (3,), "repeats"),
        ([[0.2, 1], [-0.4, 1], [0.4, 1.2]], (1,), "axis"),
        ([[0.2, 1], [0.4, 1.2], [0.4, 1], [0.2, 1.2]], (2,), "cross"),
        ([[0.2, 1], [0.4, 1], [0.3, 1]], (1,), "cross"),
        ([[0, 1], [0, 1.2], [1e-9, 1.1]], (), "no radius"),
        ([[0.2, 1], [0.4, 1], [0.3, 1.000001]], (), "thick on average"),
        (box(1.2, 1.4, 1, 1.5), (0,), "0.2 m outside"),
        (box(0.5, 1.1, 1, 1.5), (1,), "outside"),
        (box(0.2, 0.4, 1.5, 2.5), (2,), "outside"),
        (box(0, 1, 1, 1.5), (), "blocks"),
    ],
)
def test_bad_obstacles_are_refused_with_place_and_reason(polygon, key, words):
    with pytest.raises(CaseError) as caught:
        Outline.of(PIPE, {"thing": polygon})
    assert caught.value.key == ("outline", "obstacles", "thing", *key)
    assert words in str(caught.value)


def test_an_obstacle_that_cuts_through_a_lip_is_refused_although_its_corners_lie_inside():
    with pytest.raises(CaseError, match="crosses the wall"):
        Outline.of(REACTOR, {"bar": [[0.2, 3.8], [0.9, 3.2], [0.2, 3.7]]})


def test_overlapping_obstacles_are_refused_and_touching_ones_are_not():
    for other in (box(0.3, 0.5, 1.1, 1.3), box(0.25, 0.35, 1.05, 1.15), box(0.2, 0.4, 1, 1.2), box(0.1, 0.6, 0.5, 1.9)):
        with pytest.raises(CaseError, match="overlaps obstacle 'a'"):
            Outline.of(PIPE, {"a": box(0.2, 0.4, 1, 1.2), "b": other})
    assert Outline.of(PIPE, {"a": box(0.2, 0.4, 1, 1.2), "b": box(0.4, 0.6, 1.1, 1.3)}).stands_on("b") == "nothing"


def test_obstacles_that_only_together_close_the_vessel_are_refused():
    disc, ring = box(0, 0.5, 1, 1.2), box(0.5, 1, 1.2, 1.4)
    with pytest.raises(CaseError, match="together with 'disc'"):
        Outline.of(PIPE, {"disc": disc, "ring": ring})
    Outline.of(PIPE, {"disc": disc, "ring": box(0.5, 1, 1.25, 1.4)})


@pytest.mark.parametrize(
    ("sections", "name", "words"),
    [
        ({"a": Levels(2, 2)}, "a", "above 0"),
        ({"a": Levels(1, 2)}, "a", "upper z first"),
        ({"a": Levels(2.5, 1)}, "a", "leaves the outline"),
        ({"a": Levels(2, 1), "b": Levels(1.2, 0)}, "b", "inside section 'a'"),
    ],
)
def test_bad_sections_are_refused_with_place_and_reason(sections, name, words):
    with pytest.raises(CaseError) as caught:
        Outline.of(PIPE, sections=sections)
    assert caught.value.key == ("outline", "sections", name)
    assert words in str(caught.value)


def test_area_and_slope_at_a_corner_depend_on_the_side():
    reactor = Outline.of(REACTOR, {"ring": RING})
    assert reactor.area(3.4, "above") == pytest.approx(np.pi * 0.25, rel=1e-14)
    assert reactor.area(3.4) == pytest.approx(np.pi * 1.156**2, rel=1e-14)
    assert reactor.area([2.10, 1.85], "above") == pytest.approx(np.pi * np.array([1.156**2, 0.5625]), rel=1e-14)
    assert reactor.area([2.10, 1.85]) == pytest.approx(np.pi * np.array([0.5625, 1.156**2]), rel=1e-14)
    assert reactor.wall_slope([4.9, 3.9]) == pytest.approx([0.5, 0])
    assert reactor.wall_slope([4.9, 3.9], "above") == pytest.approx([0, 0.5])


def test_the_vessel_goes_on_straight_beyond_its_ends():
    flat_bottom = Outline.of([[0.3, 2], [1, 2], [1, 0], [0.2, 0]])
    assert flat_bottom.wall_radius([3, 2, 1, 0, -1], "above") == pytest.approx([0.3, 0.3, 1, 1, 0.2])
    assert flat_bottom.wall_radius([3, 2, 1, 0, -1]) == pytest.approx([0.3, 1, 1, 0.2, 0.2])
    assert flat_bottom.area(-1) == pytest.approx(np.pi * 0.04)


def test_intervals_are_what_the_obstacles_leave_free():
    vessel = Outline.of(
        PIPE, {"cone": [[0, 1], [0.3, 0.7], [0, 0.7]], "free": box(0.5, 0.6, 0.5, 1.5), "ring": box(0.9, 1, 0.5, 1.5)}
    )
    assert np.array(vessel.intervals(0.8)) == pytest.approx(np.array([[0.2, 0.5], [0.6, 0.9]]))
    assert vessel.intervals(0.5) == [(0, 1)]
    assert len(vessel.intervals(0.5, "above")) == 2


def test_what_an_obstacle_stands_on():
    vessel = Outline.of(
        HOPPER,
        {
            "cone": [[0, 2.5], [0.3, 2.2], [0, 2.2]],
            "on cone": box(0.1, 0.15, 2.4, 2.45),
            "point": [[0.7, 1.5], [0.6, 1.45], [0.6, 1.55]],
            "ring": box(0.8, 0.9, 2.5, 2.6),
        },
    )
    found = {name: vessel.stands_on(name) for name in vessel.obstacles}
    assert found == {"cone": "axis", "on cone": "axis", "point": "wall", "ring": "nothing"}


def test_direction_of_a_polygon_does_not_matter():
    there, back = (Outline.of(REACTOR, {"ring": ring}) for ring in (RING, RING[::-1]))
    assert there.volume() == back.volume() > 0
    assert there.area(2.0) == back.area(2.0)


def named(outline):
    return {opening.name: opening for opening in find_openings(outline)}


def test_openings_of_the_test_reactor():
    found = named(Outline.of(REACTOR, {"ring": RING}))
    assert list(found) == ["throat", "opening inside ring", "outlet"]
    assert [p.gap for p in found.values()] == pytest.approx([1.0, 1.5, 2.312])
    assert [p.area for p in found.values()] == pytest.approx([np.pi * r**2 for r in (0.5, 0.75, 1.156)])
    assert all(p.required for p in found.values())
    assert found["throat"].key[:2] == ("outline", "wall")
    assert found["opening inside ring"].key == ("outline", "obstacles", "ring")


def test_a_straight_pipe_has_one_opening_and_a_widening_one_two():
    assert list(named(Outline.of(PIPE))) == ["outlet"]
    found = named(Outline.of([[0.3, 2], [1, 0]]))
    assert list(found) == ["inlet", "outlet"]
    assert found["inlet"].gap == pytest.approx(0.6)


def test_gap_beside_a_cone_in_a_hopper_is_measured_across_the_flow():
    # hopper wall and insert both at 45°: horizontal width 0.3, so 0.3/√2 across
    vessel = Outline.of([[2, 4], [1, 3], [1, 0]], {"insert": [[0.7, 3], [1.2, 3.5], [0, 3.5], [0, 3]]})
    gap = named(vessel)["gap between insert and the wall"]
    assert gap.gap == pytest.approx(0.3 / np.sqrt(2))
    assert gap.required


def test_ways_round_a_free_ring_are_not_required_but_round_a_disc_are():
    ring = named(Outline.of(PIPE, {"ring": box(0.6, 0.7, 1, 1.2)}))
    assert ring["opening inside ring"].gap == pytest.approx(1.2)
    assert ring["gap between ring and the wall"].gap == pytest.approx(0.3)
    assert not ring["opening inside ring"].required
    assert not ring["gap between ring and the wall"].required
    disc = named(Outline.of(PIPE, {"disc": box(0, 0.9, 1, 1.2)}))
    assert disc["gap between disc and the wall"].required
    assert disc["gap between disc and the wall"].area == pytest.approx(np.pi * (1 - 0.81))


def test_a_slit_between_two_baffles_is_found_though_no_level_is_narrow():
    found = named(Outline.of(PIPE, {"ring": box(0.4, 1, 1.2, 1.3), "disc": box(0, 0.7, 1, 1.15)}))
    slit = found["gap between ring and disc"]
    assert slit.gap == pytest.approx(0.05)
    assert slit.required


def test_a_pocket_is_no_opening():
    cup = [[0.3, 1], [0.9, 1], [0.9, 1.5], [0.8, 1.5], [0.8, 1.1], [0.4, 1.1], [0.4, 1.5], [0.3, 1.5]]
    found = named(Outline.of(PIPE, {"cup": cup}))
    assert set(found) == {"opening inside cup", "gap between cup and the wall", "outlet"}


def test_the_test_reactor_of_the_cases_is_as_described():
    case = load_case(Path(__file__).parents[2] / "cases" / "reactor.yaml")
    reactor = Outline.from_case(case)
    assert reactor.volume() == pytest.approx(19, abs=0.1)
    assert reactor.area(reactor.z_bottom) == pytest.approx(4.2, abs=0.01)
    assert reactor.stands_on("ring") == "wall"


@pytest.mark.parametrize(
    ("wall", "obstacles", "ends"),
    [
        ([[1, 3], [1, 0]], {}, (3, 3)),
        ([[1, 3], [0.5, 0]], {}, (0, 0)),
        ([[1, 3], [1, 1], [0.5, 0.5], [0.5, 0.25], [0.5, 0]], {}, (2, 0.5)),
        ([[1, 3], [1, 1], [0.5, 1], [0.5, 0]], {}, (2, 1)),  # a ledge
        ([[1, 3], [1, 0]], {"ring": [[0.7, 1], [1, 1], [1, 1.5], [0.7, 1.5]]}, (1.5, 1)),
    ],
)
def test_the_ends_of_a_vessel_are_straight_up_to_the_first_bend_or_obstacle(wall, obstacles, ends):
    assert Outline.of(wall, obstacles).straight_ends == pytest.approx(ends)


def test_both_walls_of_a_slab_are_straight_at_its_ends():
    slab = Outline.of([[1, 3], [1, 0]], left=[[0, 3], [0, 2], [0.5, 1], [0.5, 0]], depth=0.1)
    assert slab.straight_ends == pytest.approx((1, 1))
