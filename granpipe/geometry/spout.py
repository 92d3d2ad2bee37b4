"""Where solids go beyond an outlet of a vessel in space: straight down, from an opening in a side wall below a hood.

A plate that is drawn back along a level tube does not set the flow: solids come to rest in it at their angle of
repose, and the plate leaves them behind. So every tube leads straight down, and its plate sinks. Solids that leave
sidewise pass a sill and come below a hood as deep as the opening is high; its floor is the upper end of the tube.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from granpipe.errors import DataError
from granpipe.field import Array, Mask
from granpipe.geometry.wall_mesh import WallOpening

STEEPEST = 0.7
"""Vertical part of an opening's unit normal, from which on solids leave straight down through it: 45°."""

UPWARDS = 0.05
"""The same of an outlet, at most: solids do not leave upwards; 3°."""

SILL = 0.25
"""Thickness of the wall below a hood over the height of the opening: a particle does not touch it from both sides."""

_OVERLAP = 1e-4  # of an opening's size: so far before it begins what lies beyond, lest a point in it be in neither
_SAME = 1e-6  # of an opening's width: two of its corners are as far along the wall, or three on one line


@dataclass(frozen=True, eq=False)
class Spout:
    """What lies beyond an outlet.

    Parameters
    ----------
    surface : (n, 3, 3) walls from the edge of the opening to that of the tube; none where the tube begins there [m]
    ring : (m, 3) corners of the upper edge of the tube, in order [m]
    fall : height through which solids may fall below a hood [m]; 0 without one
    within : points (n, 3) → which of them lie beyond the opening
    """

    surface: Array
    ring: Array
    fall: float
    within: Callable[[Array], Mask]

    @classmethod
    def of(cls, opening: WallOpening) -> Spout:
        """That of an opening.

        Raises
        ------
        DataError : the opening faces upwards, or is in a side wall and not convex
        """
        if opening.normal[2] > UPWARDS:
            raise DataError("faces upwards: solids leave downwards or sidewise")
        return _straight(opening) if opening.normal[2] <= -STEEPEST else _hood(opening)

    @property
    def border(self) -> Array:
        """(m, 2) corners of the tube's section [m]."""
        return self.ring[:, :2]

    @property
    def z(self) -> float:
        """Lowest point of the tube's upper edge [m]."""
        return float(self.ring[:, 2].min())

    @property
    def area(self) -> float:
        """Of the tube's section [m²]."""
        x, y = self.border.T
        return float(0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _straight(opening: WallOpening) -> Spout:
    """A tube from the opening straight down."""
    from shapely import Polygon, contains_xy, prepare

    tube = Polygon(opening.border)
    prepare(tube)
    middle, normal, slack = opening.corners.mean(axis=0), opening.normal, _OVERLAP * math.sqrt(opening.area)

    def within(points: Array) -> Mask:
        found = (points - middle) @ normal >= -slack
        found[found] = contains_xy(tube, points[found, 0], points[found, 1])
        return np.asarray(found)

    return Spout(np.zeros((0, 3, 3)), opening.corners, 0.0, within)


def _hood(opening: WallOpening) -> Spout:
    """A sill, a hood and a tube beyond an opening in a side wall."""
    from shapely import Polygon, contains_xy, prepare

    normal = opening.normal
    out = np.array([normal[0], normal[1], 0.0]) / math.hypot(normal[0], normal[1])
    along = np.array([-out[1], out[0], 0.0])
    s, t, z = opening.corners @ along, opening.corners @ out, opening.corners[:, 2]
    height = float(np.ptp(z))
    seen = Polygon(np.column_stack([s, z]))
    if seen.convex_hull.area > seen.area * (1 + 1e-6):
        raise DataError("is in a side wall and not convex: close it, and open a convex one")
    prepare(seen)
    begin = float(t.max()) + SILL * height
    end = begin + height
    lower, upper = (_chain(np.column_stack([s, z]), side) for side in (-1, 1))

    def placed(chain: Array, at: float) -> Array:
        points: Array = chain[:, :1] * along + at * out + chain[:, 1:] * np.array([0.0, 0.0, 1.0])
        return points

    rim = opening.corners + (begin - t)[:, None] * out
    front, roof, back = placed(lower, begin), placed(upper, begin), placed(upper, end)
    sides = []
    for at, corner in ((s.min(), back[0]), (s.max(), back[-1])):  # upright edges of the opening, if it has any
        edge = rim[np.abs(s - at) <= _SAME * np.ptp(s)]
        edge = edge[np.argsort(edge[:, 2])]
        sides += [np.stack([one, other, corner]) for one, other in pairwise(edge)]
    surface = np.concatenate(
        [_strip(_closed(opening.corners), _closed(rim)), _strip(roof, back), np.array(sides).reshape(-1, 3, 3)]
    )
    low, high = float(s.min()), float(s.max())
    middle, slack = opening.corners.mean(axis=0), _OVERLAP * math.sqrt(opening.area)

    def within(points: Array) -> Mask:
        side, away = points @ along, points @ out
        found = (away <= end) & ((points - middle) @ normal >= -slack) & (side > low) & (side < high)
        below = found & (away >= begin) & (points[:, 2] <= np.interp(side, *upper.T))
        found[found] = contains_xy(seen, side[found], points[found, 2])
        return np.asarray(found | below)

    return Spout(surface, np.concatenate([front, back[::-1]]), height, within)


def _chain(corners: Array, side: int) -> Array:
    """(k, 2) lower (−1) or upper (1) corners of a convex polygon, from the left to the right."""
    width = np.ptp(corners[:, 0])
    ends = [corners[np.abs(corners[:, 0] - at) <= _SAME * width] for at in (corners[:, 0].min(), corners[:, 0].max())]
    first, last = (end[np.argmax(side * end[:, 1])] for end in ends)
    between = corners[(corners[:, 0] > first[0] + _SAME * width) & (corners[:, 0] < last[0] - _SAME * width)]
    level = first[1] + (between[:, 0] - first[0]) / (last[0] - first[0]) * (last[1] - first[1])
    beyond = between[side * (between[:, 1] - level) >= -_SAME * width]
    return np.concatenate([first[None], beyond[np.argsort(beyond[:, 0])], last[None]])


def _closed(ring: Array) -> Array:
    return np.concatenate([ring, ring[:1]])


def _strip(one: Array, other: Array) -> Array:
    """(n, 3, 3) triangles between two lines of equally many points."""
    halves = (np.stack([one[:-1], one[1:], other[1:]], axis=1), np.stack([one[:-1], other[1:], other[:-1]], axis=1))
    return np.concatenate(halves)
