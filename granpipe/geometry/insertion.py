"""Where particles can be put into the vessel: slabs clear of every wall, and only where a fall from above leads.

Everything is a blocked trapezoid, a height range with straight left and right bounds: the solids grown by the margin,
and the shadow under each of them, which narrows downwards as the particles that run in below an edge lie at their
angle of repose. The free space between the trapezoids is cut where bounds begin, end or cross.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot, inf, pi, tan
from typing import TYPE_CHECKING

import numpy as np

from granpipe.geometry.contacts import AXIS, WALL

if TYPE_CHECKING:
    from granpipe.geometry.outline import Outline


@dataclass(frozen=True)
class Frustum:
    """A slab between two levels with straight inner and outer bounds: radii at z_low and z_high [m]."""

    z_low: float
    z_high: float
    inner_low: float
    inner_high: float
    outer_low: float
    outer_high: float

    @property
    def height(self) -> float:
        """[m]."""
        return self.z_high - self.z_low

    @property
    def width(self) -> float:
        """Larger of the widths at its two ends [m]; the diameter where it lies round the axis."""
        low, high = (
            outer - inner if inner > 0 else 2 * outer
            for inner, outer in ((self.inner_low, self.outer_low), (self.inner_high, self.outer_high))
        )
        return max(low, high)

    @property
    def volume(self) -> float:
        """[m³]."""
        outer = self.outer_low**2 + self.outer_low * self.outer_high + self.outer_high**2
        inner = self.inner_low**2 + self.inner_low * self.inner_high + self.inner_high**2
        return pi / 3 * self.height * (outer - inner)


@dataclass(frozen=True)
class _Line:
    """r(z) = r0 + slope (z − z0); r0 may be infinite."""

    r0: float
    z0: float
    slope: float

    @classmethod
    def through(cls, low: Sequence[float], high: Sequence[float]) -> _Line:
        """The line through two points (r, z)."""
        return cls(low[0], low[1], (high[0] - low[0]) / (high[1] - low[1]))

    def moved(self, distance: float) -> tuple[_Line, float]:
        """The line moved outwards by a distance perpendicular to itself, and how much each of its points rises."""
        steep = hypot(1.0, self.slope)
        return _Line(self.r0 + distance * steep, self.z0, self.slope), -distance * self.slope / steep

    def at(self, z: float) -> float:
        return self.r0 + self.slope * (z - self.z0)


@dataclass(frozen=True)
class _Blocked:
    """No place for a particle: left(z) < r < right(z) for z_low < z < z_high."""

    z_low: float
    z_high: float
    left: _Line
    right: _Line


_AXIS = _Line(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Room:
    """What a particle's centre needs: distance to solids [m]; reach outwards per depth under an edge; outer radius."""

    margin: float
    spread: float
    r_max: float

    def shadow(self, z: float, left: float, right: float) -> _Blocked:
        """What cannot be reached below a solid whose underside spans left < r < right at z."""
        inwards = self.spread if left > -inf else 0.0
        outwards = self.spread if right < inf else 0.0
        closing = inwards + outwards
        span = min(right, self.r_max) - max(left, 0.0) if closing != 2 * self.spread else right - left
        depth = max(span, 0.0) / closing if closing else inf
        return _Blocked(z - depth, z, _Line(left, z, -inwards), _Line(right, z, outwards))

    def cap(self, z: float, left: float, right: float) -> Iterator[_Blocked]:
        """The margin above and below a level at which a solid has corners, and the shadow under it."""
        grown = left - self.margin, right + self.margin
        yield _Blocked(z - self.margin, z + self.margin, _Line(grown[0], 0.0, 0.0), _Line(grown[1], 0.0, 0.0))
        yield self.shadow(z - self.margin, *grown)


def insertion_frusta(
    outline: Outline, top: float, bottom: float, margin: float, repose: float, min_size: float
) -> tuple[Frustum, ...]:
    """Slabs in which particles can be put, from the top down.

    The vessel goes on straight above its inlet up to `top` and below its outlet down to `bottom`; those two heights
    are taken as they are.

    Parameters
    ----------
    top, bottom : height range [m]
    margin : distance kept from walls and obstacles [m], perpendicular to them
    repose : angle from the horizontal at which particles lie under an edge [rad]
    min_size : slabs lower or narrower than this [m] are left out
    """
    room = _Room(margin, 1 / tan(repose), outline.r_max)
    blocked = [*_wall(outline, top, bottom, room), *_obstacles(outline, room)]
    levels = _levels(blocked, top, bottom, outline.tolerance)
    rows = [_free(blocked, low, high, outline.tolerance) for high, low in pairwise(levels)]
    return tuple(f for f in _merged(_reached(rows), outline.tolerance) if min(f.height, f.width) >= min_size)


def _wall(outline: Outline, top: float, bottom: float, room: _Room) -> Iterator[_Blocked]:
    """The wall moved inwards, the margin about its corners, and their shadows."""
    corners = outline.wall.tolist()
    for high, low in pairwise([[outline.inlet_radius, top], *corners, [outline.outlet_radius, bottom]]):
        if high[1] > low[1]:
            edge, rise = _Line.through(low, high).moved(-room.margin)
            yield _Blocked(low[1] + rise, high[1] + rise, edge, _Line(inf, 0.0, 0.0))
            yield from (room.shadow(z + rise, edge.at(z + rise), inf) for z in (high[1], low[1]))
    for r, z in corners:
        yield from room.cap(z, r, inf)


def _obstacles(outline: Outline, room: _Room) -> Iterator[_Blocked]:
    """Every obstacle in slabs between its corners, grown by the margin, and their shadows.

    Under an obstacle that stands on the axis or on the wall, nothing falls between itself and that.
    """
    for name, left, right in _slabs(outline):
        (left0, z0), (left1, z1) = left
        right0, right1 = right[0][0], right[1][0]
        at_axis = max(left0, left1) <= outline.tolerance
        at_wall = 0.5 * (right0 + right1) >= outline.wall_radius(0.5 * (z0 + z1)) - outline.tolerance
        near = _Line(-inf, 0.0, 0.0) if at_axis else _Line.through(*left)
        far = _Line(inf, 0.0, 0.0) if at_wall else _Line.through(*right)
        yield _Blocked(z0, z1, near, far)
        near_grown, near_rise = near.moved(-room.margin)
        far_grown, far_rise = far.moved(room.margin)
        yield _Blocked(z0 + near_rise, z1 + near_rise, near_grown, near)
        yield _Blocked(z0 + far_rise, z1 + far_rise, far, far_grown)
        yield from room.cap(z1, -inf if at_axis else left1, inf if at_wall else right1)
        on_axis, on_wall = outline.groups.joined(name, AXIS), outline.groups.joined(name, WALL)
        yield from room.cap(z0, -inf if on_axis else left0, inf if on_wall else right0)
        for rise in (near_rise, far_rise):
            z = z1 + rise
            yield room.shadow(z, near_grown.at(z), far_grown.at(z))
            z = z0 + rise
            yield room.shadow(z, -inf if on_axis else near_grown.at(z), inf if on_wall else far_grown.at(z))


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


def _levels(blocked: list[_Blocked], top: float, bottom: float, tolerance: float) -> list[float]:
    """Heights from the top down between which no bound begins, ends or crosses another."""
    lines = [(line, b) for b in blocked for line in (b.left, b.right) if abs(line.r0) < inf]
    start = np.array([line.at(0.0) for line, _ in lines] + [0.0])
    slope = np.array([line.slope for line, _ in lines] + [0.0])
    low = np.array([b.z_low for _, b in lines] + [-inf])
    high = np.array([b.z_high for _, b in lines] + [inf])
    with np.errstate(divide="ignore", invalid="ignore"):
        met = (start[None] - start[:, None]) / (slope[:, None] - slope[None])
    shared = (met > np.maximum(low[:, None], low)) & (met < np.minimum(high[:, None], high))
    heights = np.concatenate([met[shared], low, high, [top, bottom]])
    heights = np.sort(heights[(heights >= bottom) & (heights <= top)])[::-1]
    levels = [float(heights[0])]
    for z in heights[1:]:
        if levels[-1] - z > tolerance:
            levels.append(float(z))
    return levels


def _free(blocked: list[_Blocked], low: float, high: float, tolerance: float) -> list[Frustum]:
    """What the blocked trapezoids leave free between two levels."""
    middle = 0.5 * (low + high)
    active = [b for b in blocked if b.z_low < middle < b.z_high and b.left.at(middle) < b.right.at(middle)]
    active.sort(key=lambda b: b.left.at(middle))
    free, inner = [], _AXIS
    for b in active:
        if b.left.at(middle) - inner.at(middle) > tolerance:
            radii = [line.at(z) for line in (inner, b.left) for z in (low, high)]
            free.append(Frustum(low, high, *(r if r > tolerance else 0.0 for r in radii)))
        if b.right.at(middle) > inner.at(middle):
            inner = b.right
    return free


def _reached(rows: list[list[Frustum]]) -> list[list[Frustum]]:
    """Of every row from the top down, the slabs that lie under a reached one."""
    reached = rows[:1]
    for row in rows[1:]:
        reached.append([f for f in row if any(_under(f, above) for above in reached[-1])])
    return reached


def _under(below: Frustum, above: Frustum) -> bool:
    return min(below.outer_high, above.outer_low) > max(below.inner_high, above.inner_low)


def _merged(rows: list[list[Frustum]], tolerance: float) -> list[Frustum]:
    """The slabs from the top down, those that go on straight into one another made one."""
    done: list[Frustum] = []
    growing: list[Frustum] = []
    for row in rows:
        grown = []
        for slab in row:
            above = next((f for f in growing if _goes_on(f, slab, tolerance)), None)
            if above:
                growing.remove(above)
                slab = replace(above, z_low=slab.z_low, inner_low=slab.inner_low, outer_low=slab.outer_low)
            grown.append(slab)
        done += growing
        growing = grown
    return sorted([*done, *growing], key=lambda f: (-f.z_high, f.inner_high))


def _goes_on(above: Frustum, below: Frustum, tolerance: float) -> bool:
    """Whether both bounds run straight through the level between the two slabs."""
    joined = Frustum(below.z_low, above.z_high, below.inner_low, above.inner_high, below.outer_low, above.outer_high)
    part = below.height / joined.height
    inner = joined.inner_low + part * (joined.inner_high - joined.inner_low)
    outer = joined.outer_low + part * (joined.outer_high - joined.outer_low)
    off = (inner - below.inner_high, inner - above.inner_low, outer - below.outer_high, outer - above.outer_low)
    return max(map(abs, off)) <= tolerance
