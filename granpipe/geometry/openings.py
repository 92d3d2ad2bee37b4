"""Narrowings of the way from inlet to outlet, with the gap that a particle meets in each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from granpipe.errors import KeyPath
from granpipe.field import Array
from granpipe.geometry.contacts import AXIS, WALL
from granpipe.geometry.polyline import closest_approach, crosses, distance_to, edges_of
from granpipe.geometry.validate import RIGHT_KEY, WALL_KEY, obstacle_key

if TYPE_CHECKING:
    from granpipe.geometry.outline import Outline


@dataclass(frozen=True)
class Opening:
    """A local narrowing.

    Parameters
    ----------
    name : what users call it: "outlet", "throat", "gap between ring and wall"
    z : height [m]
    r_inner, r_outer : radii of its ends [m]; 0 where it lies round the axis; in a slab x
    gap : diameter of the largest sphere that passes between its sides [m]
    area : of the narrowest section [m²]
    required : nothing passes the vessel but through here
    key : path in the case of what makes it narrow
    length : of the slot that it is [m]; None where it lies round the axis
    walled : whether the slot ends at a front and a back wall
    """

    name: str
    z: float
    r_inner: float
    r_outer: float
    gap: float
    area: float
    required: bool
    key: KeyPath
    length: float | None = None
    walled: bool = False


@dataclass(frozen=True, eq=False)
class _Channel:
    """A piece of free space between two levels, bounded by one solid on each side.

    `lower` and `upper` are its radial intervals (r0, r1) at the two levels, `sides` the solids left and right.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    sides: tuple[str, str]


@dataclass(frozen=True, eq=False)
class _Junction:
    """Where the channel above a level meets the one below it; None: the straight pipe beyond inlet or outlet."""

    z: float
    r0: float
    r1: float
    sides: tuple[str, str]
    above: _Channel | None
    below: _Channel | None

    @property
    def width(self) -> float:
        return self.r1 - self.r0

    def ways(self) -> Iterator[tuple[_Channel, float, float]]:
        """The channels that leave from here, each with its width here and at its other end."""
        if self.above:
            yield self.above, _width(self.above.lower), _width(self.above.upper)
        if self.below:
            yield self.below, _width(self.below.upper), _width(self.below.lower)


def find_openings(outline: Outline) -> tuple[Opening, ...]:
    """Every narrowing, from the top down: the outlet, throats, and the gaps beside and between obstacles."""
    junctions = _junctions(outline)
    narrow = [o for o in _narrowest(junctions, outline.tolerance) if not outline.groups.joined(*o.sides)]
    gaps: dict[frozenset[str], float] = {}
    found = []
    for junction in narrow:
        opening = _as_opening(outline, junction)
        found.append(opening)
        pair = frozenset(junction.sides)
        gaps[pair] = min(opening.gap, gaps.get(pair, np.inf))
    return tuple(sorted([*found, *_slits(outline, gaps)], key=lambda p: (-p.z, p.r_inner)))


def _junctions(outline: Outline) -> list[_Junction]:
    """Every place where channels meet, level by level from the top."""
    heights = np.concatenate([outline.border[:, 1], *(polygon[:, 1] for polygon in outline.obstacles.values())])
    levels = _distinct(heights, outline.tolerance)
    inlet, outlet = (_pipe(*(float(chain[end, 0]) for chain in (outline.left, outline.wall))) for end in (0, -1))
    rows = [[inlet], *(_channels(outline, low, high) for high, low in pairwise(levels)), [outlet]]
    met = [
        _meet(z, a, b, None if a is inlet else a, None if b is outlet else b)
        for z, (above, below) in zip(levels, pairwise(rows), strict=True)
        for a in above
        for b in below
    ]
    return [junction for junction in met if junction.width > outline.tolerance]


def _distinct(heights: Array, tolerance: float) -> list[float]:
    """Levels from the top down, those closer than the tolerance taken as one."""
    levels: list[float] = []
    for z in np.sort(heights)[::-1]:
        if not levels or levels[-1] - z > tolerance:
            levels.append(float(z))
    return levels


def _pipe(left: float, right: float) -> _Channel:
    return _Channel((left, right), (left, right), (AXIS, WALL))


def _width(interval: tuple[float, float]) -> float:
    return interval[1] - interval[0]


def _meet(z: float, a: _Channel, b: _Channel, above: _Channel | None, below: _Channel | None) -> _Junction:
    (a0, a1), (b0, b1) = a.lower, b.upper
    left = a.sides[0] if a0 >= b0 else b.sides[0]
    right = a.sides[1] if a1 <= b1 else b.sides[1]
    return _Junction(z, max(a0, b0), min(a1, b1), (left, right), above, below)


def _channels(outline: Outline, low: float, high: float) -> list[_Channel]:
    """Free pieces of the slab between two neighbouring levels; their order cannot change inside it."""
    names = (WALL, *outline.obstacles, AXIS)  # the last one is that of LEFT
    spans, radii = outline.edges.at(np.array([low, 0.5 * (low + high), high]), "below")
    met = sorted(np.flatnonzero(spans[:, 1]), key=lambda i: (radii[i, 1], outline.edges.sign[i]))
    channels = []
    left, left_name = (0.0, 0.0), AXIS
    for i in met:
        at = float(radii[i, 0]), float(radii[i, 2])
        name = names[outline.edges.owner[i]]
        enters_solid = outline.edges.sign[i] > 0
        if enters_solid and max(at[0] - left[0], at[1] - left[1]) > outline.tolerance:
            channels.append(_Channel((left[0], at[0]), (left[1], at[1]), (left_name, name)))
        if name == WALL:
            break
        left, left_name = at, name
    return channels


def _narrowest(junctions: list[_Junction], tolerance: float) -> list[_Junction]:
    """The junctions from which every way leads to a wider one, the lowest of equal ones; and the outlet in any case."""
    ends: dict[_Channel, list[_Junction]] = defaultdict(list)
    for junction in junctions:
        for channel, _, _ in junction.ways():
            ends[channel].append(junction)
    chosen = []
    left = set(junctions)
    for first in reversed(junctions):
        if first in left:
            plateau = _plateau(first, ends, tolerance)
            left -= plateau
            lowest = min(plateau, key=lambda o: o.z)
            if lowest.below is None or not any(_leads_narrower(o, ends, tolerance) for o in plateau):
                chosen.append(lowest)
    return chosen


def _plateau(first: _Junction, ends: dict[_Channel, list[_Junction]], tolerance: float) -> set[_Junction]:
    """The junctions that hang together with this one through channels of the same width."""
    plateau, waiting = {first}, [first]
    while waiting:
        junction = waiting.pop()
        for channel, near, far in junction.ways():
            if max(abs(near - junction.width), abs(far - junction.width)) <= tolerance:
                new = {o for o in ends[channel] if abs(o.width - junction.width) <= tolerance} - plateau
                plateau |= new
                waiting += new
    return plateau


def _leads_narrower(junction: _Junction, ends: dict[_Channel, list[_Junction]], tolerance: float) -> bool:
    """Whether a channel from here narrows, or leads at its own width to something narrower."""
    for channel, near, far in junction.ways():
        if near > junction.width + tolerance or far > junction.width + tolerance:
            continue
        if far < junction.width - tolerance:
            return True
        if any(o.width < junction.width - tolerance for o in ends[channel]):
            return True
    return False


def _as_opening(outline: Outline, junction: _Junction) -> Opening:
    left, right = junction.sides
    required = outline.groups.bridged_by(left, right)
    name, key = _describe(outline, junction)
    if left == AXIS and outline.measure.axial:
        area = float(np.pi * junction.r1**2)
        return Opening(name, junction.z, 0.0, junction.r1, 2 * junction.r1, area, required, key)
    ends = np.array([[junction.r0, junction.z], [junction.r1, junction.z]])
    across = [
        junction.width,
        float(distance_to(ends[:1], _border(outline, right))[0]),
        float(distance_to(ends[1:], _border(outline, left))[0]),
    ]
    gap = min(across)
    length = _length(outline, junction.r0, junction.r1)
    walled = outline.measure.walled
    return Opening(name, junction.z, junction.r0, junction.r1, gap, length * gap, required, key, length, walled)


def _length(outline: Outline, r0: float, r1: float) -> float:
    """Of the slot between two r: round the axis at their mean, or along the depth [m]."""
    return float(np.pi * (r0 + r1)) if outline.measure.axial else outline.measure.turn


def _describe(outline: Outline, junction: _Junction) -> tuple[str, KeyPath]:
    """What users call the opening, and the key that makes it narrow."""
    left, right = junction.sides
    blame = next((side for side in (right, left) if side in outline.obstacles), None)
    if blame is None:
        offset = np.abs(outline.wall - [junction.r1, junction.z]).sum(axis=1)
        key: KeyPath = (*(WALL_KEY if outline.measure.axial else RIGHT_KEY), int(offset.argmin()))
        name = "outlet" if junction.below is None else "inlet" if junction.above is None else "throat"
        return name, key
    if junction.below is None:
        return f"outlet beside {blame}", obstacle_key(blame)
    inside = left == AXIS and outline.measure.axial
    return (f"opening inside {right}" if inside else _gap_name(left, right)), obstacle_key(blame)


def _gap_name(a: str, b: str) -> str:
    names = {WALL: "the wall", AXIS: "the left wall"}
    first, second = sorted((a, b), key=lambda side: side in names)
    return f"gap between {first} and {names.get(second, second)}"


def _border(outline: Outline, side: str) -> Array:
    chains = {WALL: outline.wall, AXIS: outline.left}
    return edges_of(chains[side]) if side in chains else edges_of(outline.obstacles[side], closed=True)


def _slits(outline: Outline, known: dict[frozenset[str], float]) -> Iterator[Opening]:
    """Gaps that no horizontal cut shows: between solids of which one hangs over the other."""
    walls = (WALL,) if outline.measure.axial else (WALL, AXIS)
    for a, b in combinations((*outline.obstacles, *walls), 2):
        if outline.groups.joined(a, b):
            continue
        gap, on_a, on_b = closest_approach(_border(outline, a), _border(outline, b))
        ends = np.array([on_a, on_b])
        if gap < known.get(frozenset((a, b)), np.inf) * (1 - 1e-6) and _is_slit(outline, ends, gap, {a, b}):
            r_inner, r_outer = sorted(ends[:, 0])
            length = _length(outline, float(r_inner), float(r_outer))
            required = outline.groups.bridged_by(a, b)
            z = float(ends[:, 1].mean())
            name, key = ("gap between the walls", RIGHT_KEY) if a == WALL else (_gap_name(a, b), obstacle_key(a))
            walled = outline.measure.walled
            yield Opening(name, z, float(r_inner), float(r_outer), gap, length * gap, required, key, length, walled)


def _is_slit(outline: Outline, ends: Array, gap: float, pair: set[str]) -> bool:
    """Whether nothing else stands between the ends and the free space about them is wider than the gap."""
    others = {WALL, *outline.obstacles, *(() if outline.measure.axial else (AXIS,))} - pair
    if any(crosses(ends[None], _border(outline, other)).any() for other in others):
        return False
    r, z = ends.mean(axis=0)
    axial = outline.measure.axial
    widths = [(2 * r1 if axial and r0 == 0 else r1 - r0) for r0, r1 in outline.intervals(z) if r0 <= r <= r1]
    return bool(widths) and gap < widths[0]
