"""Regions in which no particle is inserted: solids grown by a margin, and the unreachable space below each.

All are trapezoids. The unreachable space narrows downwards at the filling angle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot, inf
from typing import TYPE_CHECKING

import numpy as np

from granpipe.geometry.contacts import AXIS, WALL

if TYPE_CHECKING:
    from granpipe.geometry.outline import Outline


@dataclass(frozen=True)
class Side:
    """r(z) = r0 + slope (z − z0); r0 may be infinite."""

    r0: float
    z0: float
    slope: float

    @classmethod
    def through(cls, low: Sequence[float], high: Sequence[float]) -> Side:
        """The line through two points (r, z)."""
        return cls(low[0], low[1], (high[0] - low[0]) / (high[1] - low[1]))

    def moved(self, distance: float) -> tuple[Side, float]:
        """The line moved outwards by a distance perpendicular to itself, and how much each of its points rises."""
        steep = hypot(1.0, self.slope)
        return Side(self.r0 + distance * steep, self.z0, self.slope), -distance * self.slope / steep

    def at(self, z: float) -> float:
        return self.r0 + self.slope * (z - self.z0)

    def mirrored(self) -> Side:
        return Side(-self.r0, self.z0, -self.slope)


@dataclass(frozen=True)
class _Flank:
    """One side of a slab of an obstacle, and the margin beside it: the rectangle between itself and itself moved."""

    line: Side
    z0: float
    z1: float
    distance: float

    @property
    def grown(self) -> Side:
        return self.line.moved(self.distance)[0]

    @property
    def rise(self) -> float:
        return self.line.moved(self.distance)[1]

    def grown_at(self, z: float) -> float:
        """Radius of the moved side, which ends where the side ends."""
        return self.grown.at(min(max(z, self.z0 + self.rise), self.z1 + self.rise))

    def margin(self) -> Iterator[tuple[tuple[float, float], Side, Side]]:
        """Height ranges of the rectangle, each with its bound on the solid's side and the moved side.

        Beyond the side's own heights it starts at the side's end. The corner that is missing lies in the corner's cap.
        """
        low, high = self.z0 + self.rise, self.z1 + self.rise
        yield (max(low, self.z0), min(high, self.z1)), self.line, self.grown
        yield (low, min(self.z0, high)), Side(self.line.at(self.z0), 0.0, 0.0), self.grown
        yield (max(self.z1, low), high), Side(self.line.at(self.z1), 0.0, 0.0), self.grown


@dataclass(frozen=True)
class ExcludedRegion:
    """The region left(z) < r < right(z), z_low < z < z_high."""

    z_low: float
    z_high: float
    left: Side
    right: Side

    def mirrored(self) -> ExcludedRegion:
        """The same on the other side of r = 0."""
        return ExcludedRegion(self.z_low, self.z_high, self.right.mirrored(), self.left.mirrored())


_FAR_LEFT, _FAR_RIGHT = Side(-inf, 0.0, 0.0), Side(inf, 0.0, 0.0)


@dataclass(frozen=True)
class Clearance:
    """Distance of a particle's centre to solids [m]; its horizontal reach per depth below an edge; ends of r [m]."""

    margin: float
    spread: float
    r_min: float
    r_max: float

    def unreachable(self, z: float, left: float, right: float) -> ExcludedRegion:
        """The space below a solid whose underside spans left < r < right at z."""
        inwards = self.spread if left > -inf else 0.0
        outwards = self.spread if right < inf else 0.0
        closing = inwards + outwards
        span = min(right, self.r_max) - max(left, self.r_min) if closing != 2 * self.spread else right - left
        depth = max(span, 0.0) / closing if closing else inf
        return ExcludedRegion(z - depth, z, Side(left, z, -inwards), Side(right, z, outwards))

    def cap(self, z: float, left: float, right: float) -> Iterator[ExcludedRegion]:
        """The margin above and below a level at which a solid has corners, and the unreachable space below it."""
        grown = left - self.margin, right + self.margin
        yield ExcludedRegion(z - self.margin, z + self.margin, Side(grown[0], 0.0, 0.0), Side(grown[1], 0.0, 0.0))
        yield self.unreachable(z - self.margin, *grown)


def excluded_regions(outline: Outline, top: float, bottom: float, clearance: Clearance) -> list[ExcludedRegion]:
    """All regions in which no particle's centre can be, for the vessel from `top` down to `bottom` [m]."""
    walls = [*_wall(outline, top, bottom, clearance)]
    if not outline.measure.axial:
        turned = Clearance(clearance.margin, clearance.spread, -clearance.r_max, -clearance.r_min)
        walls += [region.mirrored() for region in _wall(outline.mirrored(), top, bottom, turned)]
    return [*walls, *_obstacles(outline, clearance)]


def _wall(outline: Outline, top: float, bottom: float, clearance: Clearance) -> Iterator[ExcludedRegion]:
    """The wall moved inwards, the margin about its corners, and the unreachable space below them."""
    corners = outline.wall.tolist()
    for high, low in pairwise([[outline.inlet_radius, top], *corners, [outline.outlet_radius, bottom]]):
        if high[1] > low[1]:
            edge, rise = Side.through(low, high).moved(-clearance.margin)
            yield ExcludedRegion(low[1] + rise, high[1] + rise, edge, _FAR_RIGHT)
            yield from (clearance.unreachable(z + rise, edge.at(z + rise), inf) for z in (high[1], low[1]))
    for r, z in corners:
        yield from clearance.cap(z, r, inf)


def _obstacles(outline: Outline, clearance: Clearance) -> Iterator[ExcludedRegion]:
    """Every obstacle in slabs between its corners, grown by the margin, and the unreachable space below them.

    Under an obstacle that stands on the axis or on the wall, nothing falls between itself and that.
    """
    for name, left, right in _slabs(outline):
        (left0, z0), (left1, z1) = left
        right0, right1 = right[0][0], right[1][0]
        middle = 0.5 * (z0 + z1)
        at_axis = (
            max(left0, left1) <= outline.tolerance
            if outline.measure.axial
            else 0.5 * (left0 + left1) <= outline.left_end(middle) + outline.tolerance
        )
        at_wall = 0.5 * (right0 + right1) >= outline.wall_radius(middle) - outline.tolerance
        near = _Flank(_FAR_LEFT if at_axis else Side.through(*left), z0, z1, -clearance.margin)
        far = _Flank(_FAR_RIGHT if at_wall else Side.through(*right), z0, z1, clearance.margin)
        yield ExcludedRegion(z0, z1, near.line, far.line)
        yield from (ExcludedRegion(*heights, grown, own) for heights, own, grown in near.margin())
        yield from (ExcludedRegion(*heights, own, grown) for heights, own, grown in far.margin())
        yield from clearance.cap(z1, -inf if at_axis else left1, inf if at_wall else right1)
        on_axis, on_wall = outline.groups.joined(name, AXIS), outline.groups.joined(name, WALL)
        yield from clearance.cap(z0, -inf if on_axis else left0, inf if on_wall else right0)
        for z in (z1 + near.rise, z1 + far.rise):
            yield clearance.unreachable(z, near.grown_at(z), far.grown_at(z))
        for z in (z0 + near.rise, z0 + far.rise):
            yield clearance.unreachable(z, -inf if on_axis else near.grown_at(z), inf if on_wall else far.grown_at(z))


_Side = tuple[list[float], list[float]]


def _slabs(outline: Outline) -> Iterator[tuple[str, _Side, _Side]]:
    """The obstacles cut at their corners' heights: name, left side and right side, each [low, high] × (r, z)."""
    for owner, (name, polygon) in enumerate(outline.obstacles.items(), start=1):
        mine = outline.edges.owner == owner
        for z0, z1 in pairwise(np.unique(polygon[:, 1]).tolist()):
            spans, radii = outline.edges.at(np.array([z0, 0.5 * (z0 + z1), z1]), "below")
            met = np.flatnonzero(spans[:, 1] & mine)
            sides = radii[met[np.argsort(radii[met, 1])]].tolist()
            for (left0, _, left1), (right0, _, right1) in zip(sides[::2], sides[1::2], strict=True):
                yield name, ([left0, z0], [left1, z1]), ([right0, z0], [right1, z1])
