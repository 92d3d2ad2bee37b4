"""Walls of vessels in space, as triangles and as STL files; lengths in mm where a file is made for `unit: mm`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

Triangles = np.ndarray


def rectangle(width: float, depth: float, z: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """(4, 3) corners of a level rectangle about (x, y), anticlockwise."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.column_stack([np.array([x, y]) + 0.5 * signs * [width, depth], np.full(4, z)])


def circle(radius: float, z: float, facets: int = 32, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """(facets, 3) corners of a polygon with the area of a circle."""
    angle = 2 * np.pi * np.arange(facets) / facets
    own = radius * np.sqrt(2 * np.pi / facets / np.sin(2 * np.pi / facets))
    return np.column_stack([x + own * np.cos(angle), y + own * np.sin(angle), np.full(facets, z)])


def between(rings: Sequence[np.ndarray]) -> Triangles:
    """(n, 3, 3) the walls between rings of equally many corners, open at both ends."""
    found = []
    for one, other in pairwise(rings):
        next_one, next_other = np.roll(one, -1, axis=0), np.roll(other, -1, axis=0)
        found += [np.stack([one, next_one, next_other], axis=1), np.stack([one, next_other, other], axis=1)]
    return np.concatenate(found)


def square_hopper() -> Triangles:
    """A square bin above a square hopper, mm: 16 triangles."""
    return between([rectangle(60, 60, 80), rectangle(60, 60, 55), rectangle(35, 35, 0)])


def two_outlets(ridge: float = 40.0, height: float = 90.0) -> Triangles:
    """A bin above two hoppers that meet in a ridge, mm; outlets of 32 mm at x = ±25 mm."""
    top, ends = rectangle(100, 40, height), {side: rectangle(50, 40, ridge, x=25 * side) for side in (-1, 1)}
    hoppers = [between([ends[side], rectangle(32, 32, 0, x=25 * side)]) for side in (-1, 1)]
    (a, b, c, d), front, back = top, np.array([0, -20, ridge]), np.array([0, 20, ridge])
    p, q, r, s = ends[-1][0], ends[1][1], ends[1][2], ends[-1][3]
    bin_walls = [(a, p, front), (a, front, b), (b, front, q), (c, r, back), (c, back, d), (d, back, s)]
    bin_walls += [(b, q, r), (b, r, c), (d, s, p), (d, p, a)]
    return np.concatenate([np.array(bin_walls), *hoppers])


def write_stl(path: Path, triangles: Triangles) -> Path:
    """Write an STL file as text."""
    lines = ["solid walls"]
    for triangle in triangles:
        corners = [f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangle + 0.0]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid walls", ""]))
    return path


def blocks(solid: np.ndarray, size: float, opened: Callable[[int, np.ndarray], bool]) -> Triangles:
    """Walls round cubes of one size that stand at 0, open where `opened` says so.

    Parameters
    ----------
    solid : (nx, ny, nz) which cubes the vessel is made of
    opened : axis across a face and its middle → whether it is left out
    """
    padded, found = np.pad(solid, 1), []
    for axis in range(3):
        low, high = (np.delete(padded, end, axis) for end in (-1, 0))
        for at in np.argwhere(low != high):
            corner = at - 1.0
            corner[axis] += 1
            one, other = np.delete(np.eye(3), axis, axis=0)
            if not opened(axis, size * (corner + 0.5 * (one + other))):
                a, b, c, d = (size * (corner + s * one + t * other) for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)))
                found += [np.array([a, b, c]), np.array([a, c, d])]
    return np.array(found)


def two_levels(size: float = 8.0, step: int = 4, height: int = 11) -> Triangles:
    """A bin of 12 × 6 cubes whose floor has a step, mm: an outlet of 4 × 4 cubes in either part of the floor."""
    solid = np.ones((12, 6, height), bool)
    solid[6:, :, :step] = False

    def opened(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / size
        floor = (z < 0.1 and 1 < x < 5) or (abs(z - step) < 0.1 and 7 < x < 11)
        return axis == 2 and (z > height - 0.1 or (floor and 1 < y < 5))

    return blocks(solid, size, opened)


def two_taps(size: float = 8.0, height: int = 12, high: int = 4) -> Triangles:
    """A bin of 8 × 6 cubes with two openings of 4 × 4 cubes in opposite walls, mm: one at the floor, one higher."""

    def opened(axis: int, at: np.ndarray) -> bool:
        x, y, z = at / size
        tap = (x < 0.1 and 0 < z < 4) or (x > 7.9 and high < z < high + 4)
        return (axis == 2 and z > height - 0.1) or (axis == 0 and tap and 1 < y < 5)

    return blocks(np.ones((8, 6, height), bool), size, opened)
