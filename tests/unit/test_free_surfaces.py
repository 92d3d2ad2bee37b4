"""Voids below overhangs and the surfaces that bound them, against their corners by hand."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.errors import CaseError
from granpipe.field import Array
from granpipe.geometry.free_surfaces import free_surfaces, voids
from granpipe.geometry.outline import Outline

ANGLE = np.radians(45)
PIPE = [[1.0, 4.0], [1.0, 0.0]]


def corners(polygon: Array) -> set[tuple[float, float]]:
    return {(round(float(r), 9), round(float(z), 9)) for r, z in polygon}


def box(r0: float, r1: float) -> list[list[float]]:
    return [[r0, 2.0], [r1, 2.0], [r1, 2.5], [r0, 2.5]]


def test_a_hopper_has_no_void() -> None:
    assert voids(Outline.of([[1, 3], [1, 2], [0.5, 1], [0.5, 0]]), ANGLE) == []


def test_below_a_ledge_the_surface_falls_to_the_wall() -> None:
    (void,) = voids(Outline.of([[0.5, 4], [0.5, 3], [1, 3], [1, 0]]), ANGLE)
    assert corners(void) == {(0.5, 3.0), (1.0, 3.0), (1.0, 2.5)}


def test_a_widening_steeper_than_the_surface_is_filled_and_a_flatter_one_is_not() -> None:
    steep, flat = [[0.5, 4], [0.5, 3], [1, 2], [1, 0]], [[0.5, 4], [0.5, 3], [1, 2.8], [1, 0]]
    assert voids(Outline.of(steep), ANGLE) == []
    (void,) = voids(Outline.of(flat), ANGLE)
    assert corners(void) == {(0.5, 3.0), (1.0, 2.8), (1.0, 2.5)}


@pytest.mark.parametrize(
    ("span", "expected"),
    [
        ((0.6, 1.0), {(0.6, 2.0), (1.0, 2.0), (1.0, 1.6)}),
        ((0.0, 0.5), {(0.0, 2.0), (0.5, 2.0), (0.0, 1.5)}),
        ((0.4, 0.8), {(0.4, 2.0), (0.8, 2.0), (0.6, 1.8)}),
    ],
    ids=["on the wall", "on the axis", "free ring"],
)
def test_below_an_obstacle_stays_a_cavity(span: tuple[float, float], expected: set[tuple[float, float]]) -> None:
    (void,) = voids(Outline.of(PIPE, {"block": box(*span)}), ANGLE)
    assert corners(void) == expected


def test_a_surface_ends_where_it_meets_an_obstacle() -> None:
    wall = [[0.5, 4], [0.5, 3], [1, 3], [1, 0]]
    found = voids(Outline.of(wall, {"block": [[0.7, 2.6], [1, 2.6], [1, 2.9], [0.7, 2.9]]}), ANGLE)
    assert (0.7, 2.8) in set.union(*(corners(one) for one in found))


def test_in_a_slab_surfaces_fall_from_both_walls_and_from_what_stands_on_them() -> None:
    left = [[-0.25, 4.0], [-0.25, 3.5], [-1.0, 3.5], [-1.0, 0.0]]
    right = [[0.5, 4.0], [0.5, 3.0], [1.0, 3.0], [1.0, 0.0]]
    bars = {"shelf": [[-1, 1], [-0.8, 1], [-0.8, 1.2], [-1, 1.2]], "bar": [[-0.2, 1], [0, 1], [0, 1.2], [-0.2, 1.2]]}
    slab = Outline.of(right, bars, left=left, depth=2.0)
    expected = [
        {(0.5, 3.0), (1.0, 3.0), (1.0, 2.5)},
        {(-0.25, 3.5), (-1.0, 3.5), (-1.0, 2.75)},
        {(-0.8, 1.0), (-1.0, 1.0), (-1.0, 0.8)},
        {(-0.2, 1.0), (0.0, 1.0), (-0.1, 0.9)},
    ]
    found = [corners(one) for one in voids(slab, ANGLE)]
    assert sorted(map(sorted, found)) == sorted(map(sorted, expected))
    mirrored = [{(-x, z) for x, z in corners(one)} for one in voids(slab.mirrored(), ANGLE)]
    assert sorted(map(sorted, mirrored)) == sorted(map(sorted, expected))
    lines = [corners(np.round(line, 4)) for line in free_surfaces(slab, ANGLE)]
    assert {(-0.25, 3.5), (-1.0, 2.75)} in lines
    assert len(lines) == 4


def test_a_surface_that_reaches_the_outlet_is_refused() -> None:
    with pytest.raises(CaseError, match="reaches the outlet"):
        voids(Outline.of([[0.5, 4], [0.5, 3], [1, 3], [1, 2.7]]), ANGLE)


def test_the_surfaces_of_a_void_are_its_edges_within_the_vessel() -> None:
    (line,) = free_surfaces(Outline.of([[0.5, 4], [0.5, 3], [1, 3], [1, 0]]), ANGLE)
    assert corners(np.round(line, 4)) == {(0.5, 3.0), (1.0, 2.5)}
    (ring,) = free_surfaces(Outline.of(PIPE, {"block": box(0.4, 0.8)}), ANGLE)
    assert corners(np.round(ring, 4)) == {(0.4, 2.0), (0.6, 1.8), (0.8, 2.0)}
    (cone,) = free_surfaces(Outline.of(PIPE, {"block": box(0.0, 0.5)}), ANGLE)
    assert corners(np.round(cone, 4)) == {(0.5, 2.0), (0.0, 1.5)}


def test_a_surface_that_reaches_the_outlet_is_still_drawn() -> None:
    (line,) = free_surfaces(Outline.of([[0.5, 4], [0.5, 3], [1, 3], [1, 2.7]]), ANGLE)
    assert corners(np.round(line, 4)) == {(0.5, 3.0), (0.8, 2.7)}


POCKETS = {
    "notch": ([[0.3, 2], [0.4, 2], [0.5, 2.2], [0.6, 2], [0.7, 2], [0.7, 3], [0.3, 3]], (0.5, 2.2)),
    "square notch": ([[0.3, 2], [0.4, 2], [0.4, 2.2], [0.6, 2.2], [0.6, 2], [0.7, 2], [0.7, 3], [0.3, 3]], (0.6, 2.2)),
    "steep roof at the wall": ([[0.7, 2], [1, 2.5], [1, 3], [0.7, 3]], (1, 2.5)),
    "bell on the axis": ([[0, 2.6], [0.5, 2], [0.6, 2], [0, 3.4]], (0, 2.6)),
}


@pytest.mark.parametrize("name", POCKETS)
def test_a_pocket_that_is_open_below_only_is_refused(name: str) -> None:
    polygon, (r, z) = POCKETS[name]
    with pytest.raises(CaseError, match=f"at r = {r:g}, z = {z:g} m there is a pocket") as refused:
        voids(Outline.of(PIPE, {"body": polygon}), ANGLE)
    assert refused.value.key == ("outline", "obstacles")


@pytest.mark.parametrize(
    ("polygon", "expected"),
    [
        ([[0.5, 2], [0.65, 2.3], [0.5, 2.6], [0.35, 2.3]], 0),
        ([[0.3, 2], [0.5, 2.1], [0.7, 2], [0.7, 3], [0.3, 3]], 1),
        ([[0.3, 2], [0.7, 2], [0.7, 3], [0.5, 2.5], [0.3, 3]], 1),
        ([[0.7, 2], [1, 2.2], [1, 3], [0.7, 3]], 1),
        ([[0, 2], [0.5, 2], [0, 3]], 1),
    ],
    ids=["diamond", "shallow notch", "cup", "slight roof at the wall", "cone on the axis"],
)
def test_what_solids_reach_or_a_surface_closes_is_no_pocket(polygon: list[list[float]], expected: int) -> None:
    assert len(voids(Outline.of(PIPE, {"body": polygon}), ANGLE)) == expected
