"""Walls of vessels in space, as triangles and as STL files; lengths in mm where a file is made for `unit: mm`."""

from __future__ import annotations

from collections.abc import Sequence
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
