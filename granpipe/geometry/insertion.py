"""Where particles can be put into the vessel: slabs clear of every wall, and only where a fall from above leads.

The free space between the blocked trapezoids is cut where their bounds begin, end or cross; of the pieces, those that
hang together with the top are kept and joined into few.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import inf, pi, tan
from typing import TYPE_CHECKING

import numpy as np

from granpipe.geometry.blocked import Blocked, Line, Room, blocked_space

if TYPE_CHECKING:
    from granpipe.geometry.outline import Outline

JOINING_LOSS = 0.1
"""Part of the volume that may be lost where low slabs become one: a curved wall would otherwise leave slivers only."""
_AXIS = Line(0.0, 0.0, 0.0)


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


def insertion_frusta(
    outline: Outline, top: float, bottom: float, margin: float, angle: float, min_size: float = 0.0
) -> tuple[Frustum, ...]:
    """Slabs in which particles can be put, from the top down.

    The vessel goes on straight above its inlet up to `top` and below its outlet down to `bottom`; those two heights
    are taken as they are.

    Parameters
    ----------
    top, bottom : height range [m]
    margin : distance kept from walls and obstacles [m], perpendicular to them
    angle : angle from the horizontal under an edge above which nothing is inserted [rad]
    min_size : slabs lower or narrower than this [m] are joined with their neighbours if that loses little, or left out
    """
    blocked = blocked_space(outline, top, bottom, Room(margin, 1 / tan(angle), outline.r_max))
    levels = _levels(blocked, top, bottom, outline.tolerance)
    rows = [_free(blocked, low, high, outline.tolerance) for high, low in pairwise(levels)]
    slabs = [slab for chain in _chains(_reached(rows)) for slab in _joined(chain, min_size, outline.tolerance)]
    useful = [slab for slab in slabs if min(slab.height, slab.width) >= min_size]
    return tuple(sorted(useful, key=lambda f: (-f.z_high, f.inner_high)))


def _levels(blocked: list[Blocked], top: float, bottom: float, tolerance: float) -> list[float]:
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


def _free(blocked: list[Blocked], low: float, high: float, tolerance: float) -> list[Frustum]:
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


def _chains(rows: list[list[Frustum]]) -> list[list[Frustum]]:
    """The slabs strung from the top down, each string without branches."""
    strings: list[list[Frustum]] = []
    growing: list[list[Frustum]] = []
    for row in rows:
        grown = []
        for slab in row:
            above = [string for string in growing if _under(slab, string[-1])]
            if len(above) == 1 and sum(_under(other, above[0][-1]) for other in row) == 1:
                above[0].append(slab)
                grown.append(above[0])
            else:
                grown.append([slab])
                strings.append(grown[-1])
        growing = grown
    return strings


def _joined(chain: list[Frustum], min_size: float, tolerance: float) -> Iterator[Frustum]:
    """The slabs of a chain made fewer: straight ones joined, and low ones where that loses little of their volume."""
    straight: list[Frustum] = []
    for slab in chain:
        both = _largest_within([*straight[-1:], slab])
        if straight and _bend(straight[-1], slab) <= tolerance:
            straight[-1] = both
        else:
            straight.append(slab)
    group: list[Frustum] = []
    for slab in straight:
        low = min(slab.height, sum(f.height for f in group)) < min_size
        volume = sum(f.volume for f in [*group, slab])
        if group and not (low and _largest_within([*group, slab]).volume >= (1 - JOINING_LOSS) * volume):
            yield _largest_within(group)
            group = []
        group.append(slab)
    yield _largest_within(group)


def _bend(above: Frustum, below: Frustum) -> float:
    """How far one slab that spans both misses the bounds where they meet."""
    part = below.height / (below.height + above.height)
    inner = below.inner_low + part * (above.inner_high - below.inner_low)
    outer = below.outer_low + part * (above.outer_high - below.outer_low)
    off = (inner - below.inner_high, inner - above.inner_low, outer - below.outer_high, outer - above.outer_low)
    return max(map(abs, off))


def _largest_within(slabs: list[Frustum]) -> Frustum:
    """One slab inside a chain of them: their end points joined, and the bounds moved until they are within all."""
    z = np.array([[f.z_high, f.z_low] for f in slabs]).ravel()
    inner = np.array([[f.inner_high, f.inner_low] for f in slabs]).ravel()
    outer = np.array([[f.outer_high, f.outer_low] for f in slabs]).ravel()
    part = (z - z[-1]) / (z[0] - z[-1])
    step_in = float(np.max(inner - inner[-1] - part * (inner[0] - inner[-1])))
    step_out = float(np.min(outer - outer[-1] - part * (outer[0] - outer[-1])))
    ends = [(float(inner[i]) + step_in, float(outer[i]) + step_out) for i in (-1, 0)]
    (inner_low, outer_low), (inner_high, outer_high) = ((i if i > 1e-9 * o else 0.0, max(i, o)) for i, o in ends)
    return Frustum(float(z[-1]), float(z[0]), inner_low, inner_high, outer_low, outer_high)
