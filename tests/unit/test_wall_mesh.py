"""Walls from triangles: openings, the part of each cell inside, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from granpipe.errors import DataError
from granpipe.field import Box
from granpipe.geometry.wall_mesh import WallMesh

Mesh = tuple[np.ndarray, np.ndarray]


def tube(radii: list[float], heights: list[float], facets: int = 48, centre: tuple[float, float] = (0.0, 0.0)) -> Mesh:
    """Rings of these radii and heights joined by triangles, open at both ends."""
    angle = 2 * np.pi * np.arange(facets) / facets
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate(
        [
            np.column_stack([np.array(centre) + r * ring, np.full(facets, z)])
            for r, z in zip(radii, heights, strict=True)
        ]
    )
    here = np.arange(facets)
    following = (here + 1) % facets
    triangles = []
    for k in range(len(radii) - 1):
        low, high = k * facets, (k + 1) * facets
        triangles += [np.stack([low + here, low + following, high + here], axis=1)]
        triangles += [np.stack([low + following, high + following, high + here], axis=1)]
    return points, np.concatenate(triangles)


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    """A closed box."""
    points = np.array([[(low, high)[k >> axis & 1][axis] for axis in range(3)] for k in range(8)], dtype=float)
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return points, np.array([one for a, b, c, d in sides for one in ((a, b, c), (a, c, d))])


def joined(*meshes: Mesh) -> Mesh:
    points, triangles, count = [], [], 0
    for own, corners in meshes:
        points.append(own)
        triangles.append(corners + count)
        count += len(own)
    return np.concatenate(points), np.concatenate(triangles)


def polygon_area(radius: float, facets: int = 48) -> float:
    return 0.5 * facets * np.sin(2 * np.pi / facets) * radius**2


def grid_of(walls: WallMesh, cell: float) -> Box:
    x, y, z = ((float(low), float(high)) for low, high in walls.ends)
    return Box.within(x, y, z, cell, flat=False, cut=True)


def volume_in(walls: WallMesh, cell: float) -> float:
    grid = grid_of(walls, cell)
    edges = grid.r_edges, grid.y_edges, grid.z_edges
    return float(walls.inside_fraction(grid).sum() * np.prod([one[1] - one[0] for one in edges]))


def test_a_tube_has_one_opening_at_either_end() -> None:
    walls = WallMesh.of(*tube([0.2, 0.3], [0.0, 1.0], centre=(0.5, -0.2)))
    (inlet,), (outlet,) = walls.inlets, walls.outlets
    assert (inlet.z, outlet.z) == (1.0, 0.0)
    assert inlet.area == pytest.approx(polygon_area(0.3))
    assert outlet.area == pytest.approx(polygon_area(0.2))
    assert outlet.centre == pytest.approx((0.5, -0.2))


def test_the_cells_inside_add_up_to_the_volume() -> None:
    """A cone frustum of 48 facets, and one with a box in it."""
    mesh = tube([0.2, 0.2, 0.3], [0.0, 0.4, 1.0])
    exact = polygon_area(1.0) * (0.4 * 0.2**2 + 0.6 * (0.2**2 + 0.2 * 0.3 + 0.3**2) / 3)
    assert volume_in(WallMesh.of(*mesh), 0.02) == pytest.approx(exact, rel=2e-3)
    within = joined(mesh, box((-0.1, -0.05, 0.5), (0.1, 0.05, 0.6)))
    assert volume_in(WallMesh.of(*within), 0.02) == pytest.approx(exact - 0.2 * 0.1 * 0.1, rel=2e-3)


def test_along_z_the_part_inside_is_exact() -> None:
    walls = WallMesh.of(*tube([0.3, 0.3], [0.03, 0.97]))
    grid = Box.within((-0.05, 0.05), (-0.05, 0.05), (0.0, 1.0), 0.1, flat=False, cut=True)
    assert walls.inside_fraction(grid)[:, 0, 0] == pytest.approx([0.7, *[1.0] * 8, 0.7], abs=1e-12)


def test_triangles_each_with_corners_of_their_own_and_drawn_twice_are_one_wall() -> None:
    """As STL stores them."""
    points, triangles = tube([0.2, 0.3], [0.0, 1.0])
    single = points[triangles].reshape(-1, 3)
    single = np.concatenate([single, single[:30]])
    walls = WallMesh.of(single, np.arange(len(single)).reshape(-1, 3))
    assert volume_in(walls, 0.05) == pytest.approx(volume_in(WallMesh.of(points, triangles), 0.05), rel=1e-6)


def test_two_outlets_are_two_openings() -> None:
    """A trough with two holes in its floor, beside each other."""
    walls = WallMesh.of(*trough())
    assert len(walls.inlets) == 1
    assert sorted(round(one.centre[0], 6) for one in walls.outlets) == [0.25, 0.75]
    assert [one.area for one in walls.outlets] == pytest.approx([0.08, 0.08])


def trough() -> Mesh:
    """Walls of a box 1 × 0.4 × 1 m; its floor holds two square-edged holes of 0.4 × 0.2 m."""
    xs, ys = [0.0, 0.05, 0.45, 0.55, 0.95, 1.0], [0.0, 0.1, 0.3, 0.4]
    points = [(x, y, 0.0) for y in ys for x in xs]
    quads = []
    for j in range(3):
        for i in range(5):
            if not (j == 1 and i in (1, 3)):
                a = j * 6 + i
                quads.append((a, a + 1, a + 7, a + 6))
    border = [*range(6), 11, 17, *range(23, 17, -1), 12, 6]
    top = len(points)
    points += [(points[k][0], points[k][1], 1.0) for k in border]
    for k in range(len(border)):
        m = (k + 1) % len(border)
        quads.append((border[k], border[m], top + m, top + k))
    triangles = [one for a, b, c, d in quads for one in ((a, b, c), (a, c, d))]
    return np.array(points, dtype=float), np.array(triangles)


def without(mesh: Mesh, number: int) -> Mesh:
    return mesh[0], np.delete(mesh[1], number, axis=0)


TUBE = tube([0.2, 0.3], [0.0, 1.0])


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (
            box((0, 0, 0), (1, 1, 1)),
            "no opening at all",
        ),
        (without(box((0, 0, 0), (1, 1, 1)), 10), "no level opening at the top"),
        (without(TUBE, 5), r"is not flat|branches"),
        (joined(TUBE, (np.array([[0.2, 0, 0], [0.3, 0, 1], [0, 0, 0.5]]), np.array([[0, 1, 2]]))), "three triangles"),
    ],
    ids=["closed", "side open", "hole", "fin"],
)
def test_walls_that_are_none_are_refused(mesh: Mesh, words: str) -> None:
    with pytest.raises(DataError, match=words):
        WallMesh.of(*mesh)


def test_an_inlet_that_leans_is_told_with_its_slope() -> None:
    points, triangles = tube([0.2, 0.3], [0.0, 1.0])
    lean = np.radians(20)
    turn = np.array([[np.cos(lean), 0, np.sin(lean)], [0, 1, 0], [-np.sin(lean), 0, np.cos(lean)]])
    with pytest.raises(DataError, match=r"no level opening at the top.* faces upwards and leans by 20°"):
        WallMesh.of(points @ turn.T, triangles)
    with pytest.raises(DataError, match=r"no level opening at the top.* faces sideways"):
        WallMesh.of(points[:, [0, 2, 1]], triangles)


def test_a_baffle_that_is_a_sheet_is_to_be_closed() -> None:
    """A tube within a tube: two pieces with openings, and what is inside depends on where one looks."""
    with pytest.raises(DataError, match="2 pieces have openings; join them to one, and close obstacles"):
        WallMesh.of(*joined(tube([0.3, 0.3], [0.0, 1.0]), tube([0.1, 0.1], [0.0, 1.0])))
