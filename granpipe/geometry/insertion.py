"""Where particles can be inserted: slabs clear of every wall that particles falling from above can reach.

The space outside the excluded regions is cut at the heights where their sides begin, end or cross; the pieces that are
connected with the top are kept and merged into few.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import inf, tan
from typing import TYPE_CHECKING

import numpy as np

from granpipe.field import Frustum, Measure
from granpipe.geometry.excluded import Clearance, ExcludedRegion, Side, excluded_regions

if TYPE_CHECKING:
    from granpipe.geometry.outline import Outline

JOINING_LOSS = 0.1
"""Part of the volume that may be lost where low slabs become one: a curved wall would otherwise leave slivers only."""
_AXIS, _FAR_LEFT = Side(0.0, 0.0, 0.0), Side(-inf, 0.0, 0.0)


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
    free = _free_depth(outline.measure, margin)
    if free.turn <= min_size:
        return ()
    excluded = excluded_regions(outline, top, bottom, Clearance(margin, 1 / tan(angle), outline.r_min, outline.r_max))
    levels = _levels(excluded, top, bottom, outline.tolerance)
    rows = [_free(excluded, low, high, outline, free) for high, low in pairwise(levels)]
    slabs = [slab for chain in _chains(_reached(rows)) for slab in _joined(chain, min_size, outline.tolerance)]
    useful = [slab for slab in slabs if min(slab.height, slab.width) >= min_size]
    return tuple(sorted(useful, key=lambda f: (-f.z_high, f.inner_high)))


def _levels(excluded: list[ExcludedRegion], top: float, bottom: float, tolerance: float) -> list[float]:
    """Heights from the top down between which no side begins, ends or crosses another."""
    sides = [(side, b) for b in excluded for side in (b.left, b.right) if abs(side.r0) < inf]
    start = np.array([side.at(0.0) for side, _ in sides] + [0.0])
    slope = np.array([side.slope for side, _ in sides] + [0.0])
    low = np.array([b.z_low for _, b in sides] + [-inf])
    high = np.array([b.z_high for _, b in sides] + [inf])
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


def _free_depth(measure: Measure, margin: float) -> Measure:
    """What stands between a margin [m] from the front wall and one from the back wall, where a slab has them."""
    return replace(measure, turn=measure.turn - 2 * margin) if measure.walled else measure


def _free(excluded: list[ExcludedRegion], low: float, high: float, outline: Outline, measure: Measure) -> list[Frustum]:
    """What the excluded regions leave free between two levels, of a depth by this measure."""
    middle, tolerance, axial = 0.5 * (low + high), outline.tolerance, outline.measure.axial
    active = [b for b in excluded if b.z_low < middle < b.z_high and b.left.at(middle) < b.right.at(middle)]
    active.sort(key=lambda b: b.left.at(middle))
    free, inner = [], _AXIS if axial else _FAR_LEFT
    for b in active:
        if b.left.at(middle) - inner.at(middle) > tolerance:
            radii = [side.at(z) for side in (inner, b.left) for z in (low, high)]
            r0, r1, r2, r3 = (r if r > tolerance or not axial else 0.0 for r in radii)
            front = 0.5 * (outline.measure.turn - measure.turn)
            free.append(Frustum(low, high, r0, r1, r2, r3, measure, front))
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
    """The slabs in chains from the top down, each chain without branches."""
    chains: list[list[Frustum]] = []
    growing: list[list[Frustum]] = []
    for row in rows:
        grown = []
        for slab in row:
            above = [chain for chain in growing if _under(slab, chain[-1])]
            if len(above) == 1 and sum(_under(other, above[0][-1]) for other in row) == 1:
                above[0].append(slab)
                grown.append(above[0])
            else:
                grown.append([slab])
                chains.append(grown[-1])
        growing = grown
    return chains


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
    measure, front = slabs[0].measure, slabs[0].front
    (inner_low, outer_low), (inner_high, outer_high) = (
        (i if i > 1e-9 * o or not measure.axial else 0.0, max(i, o)) for i, o in ends
    )
    return Frustum(float(z[-1]), float(z[0]), inner_low, inner_high, outer_low, outer_high, measure, front)
