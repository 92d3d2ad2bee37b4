"""Is this outline a vessel? Every refusal names the place, the value and the remedy."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, pairwise
from typing import Protocol

import numpy as np

from granpipe.errors import CaseError, KeyPath
from granpipe.field import Array
from granpipe.geometry.contacts import AXIS, WALL, touching_groups
from granpipe.geometry.polyline import (
    closest_approach,
    crosses,
    distance_to,
    edges_of,
    farther,
    inside_polygon,
    pieces,
    self_contact,
    signed_area,
)

WALL_KEY = ("outline", "wall")
LEFT_KEY, RIGHT_KEY = ("outline", "left"), ("outline", "right")

MOST_POINTS = 5000
"""Of one line: a curve that is drawn to a thousandth has some hundred."""

MOST_OBSTACLES = 100
"""In a vessel: a drawing with more shows something else, too."""


class ZRange(Protocol):
    """What a section of the outline is to this room: an interval of z [m]."""

    @property
    def z_top(self) -> float: ...
    @property
    def z_bottom(self) -> float: ...


def obstacle_key(name: str) -> KeyPath:
    """Where the case describes this obstacle."""
    return "outline", "obstacles", name


def check_wall(wall: Array, tolerance: float, axial: bool = True) -> None:
    """CaseError unless the wall (n, 2), beside an axis or right in a slab, runs from top to bottom without a fault."""
    key = WALL_KEY if axial else RIGHT_KEY
    _check_points(wall, key, 2, axial)
    for i, (r, z) in enumerate(wall):
        if axial and r <= tolerance:
            raise CaseError(
                f"the wall meets the axis at z = {z:g} m and closes the vessel; give it a radius above 0 there "
                "(the axis itself is not part of the wall)",
                (*key, i),
            )
    _check_course(wall, key, tolerance)


def check_left(left: Array, right: Array, tolerance: float) -> None:
    """CaseError unless the left wall of a slab runs from top to bottom beside the right one, which is whole."""
    _check_points(left, LEFT_KEY, 2, axial=False)
    _check_course(left, LEFT_KEY, tolerance)
    for end, what in ((0, "inlet"), (-1, "outlet")):
        if abs(left[end, 1] - right[end, 1]) > tolerance:
            raise CaseError(
                f"the {what} lies at z = {left[end, 1]:g} m on the left and {right[end, 1]:g} m on the right; "
                "let both walls begin at one height and end at one height",
                (*LEFT_KEY, end % len(left)),
            )
    gap, on_left, _ = closest_approach(edges_of(left), edges_of(right))
    heights = np.unique(np.concatenate([left[:, 1], right[:, 1]]))
    levels = 0.5 * (heights[1:] + heights[:-1])
    if gap <= tolerance or (_at(right, levels) <= _at(left, levels)).any():
        x, z = on_left
        raise CaseError(
            f"the left wall meets the right one at [{x:g}, {z:g}]; the left wall has the smaller x at every height: "
            "leave an opening, or exchange the two",
            LEFT_KEY,
        )


def _at(wall: Array, z: Array) -> Array:
    """x of a wall, from the top down, at heights where it has no ledge."""
    return np.interp(z, wall[::-1, 1], wall[::-1, 0])


def _check_course(wall: Array, key: KeyPath, tolerance: float) -> None:
    """CaseError unless a wall runs downwards."""
    _check_lengths(wall, edges_of(wall), key, tolerance)
    if (np.diff(wall[:, 1]) >= 0).all() and wall[-1, 1] > wall[0, 1]:
        raise CaseError(
            f"the wall runs upwards, from z = {wall[0, 1]:g} m to {wall[-1, 1]:g} m; list its points from the top down",
            key,
        )
    _check_self_crossing(wall, edges_of(wall), key, tolerance, closed=False)
    rising = np.flatnonzero(np.diff(wall[:, 1]) > 0)
    if len(rising):
        i = int(rising[0])
        raise CaseError(
            f"the wall rises here from z = {wall[i, 1]:g} m to {wall[i + 1, 1]:g} m; an overhang gives one height two "
            "wall radii, and particles cannot fill it from above: make it a horizontal ledge, or draw the part that "
            "hangs down as an obstacle",
            (*key, i + 1),
        )
    if wall[0, 1] - wall[-1, 1] <= tolerance:
        raise CaseError(f"the wall has no height: every z is {wall[0, 1]:g} m; add a lower point", key)


def check_obstacles(
    left: Array, wall: Array, obstacles: Mapping[str, Array], tolerance: float, axial: bool = True
) -> None:
    """CaseError unless the obstacles (closed polygons) lie in the vessel, apart, and leave a way through."""
    if len(obstacles) > MOST_OBSTACLES:
        raise CaseError(
            f"{len(obstacles)} obstacles, more than {MOST_OBSTACLES}; leave out what is no solid in the vessel",
            ("outline", "obstacles"),
        )
    for name, polygon in obstacles.items():
        _check_polygon(polygon, obstacle_key(name), tolerance, axial)
        _check_thickness(polygon, obstacle_key(name), tolerance)
        _check_within_walls(polygon, left, wall, obstacle_key(name), tolerance)
    for (first, a), (second, b) in combinations(obstacles.items(), 2):
        if _overlap(a, b, tolerance):
            raise CaseError(
                f"overlaps obstacle {first!r}; move one of them, or draw both as one obstacle (touching is allowed)",
                obstacle_key(second),
            )
    groups = touching_groups(left, wall, obstacles, tolerance)
    if groups.joined(AXIS, WALL):
        closing = [name for name in obstacles if groups.joined(name, WALL)]
        together = "" if len(closing) == 1 else f" (together with {', '.join(map(repr, closing[:-1]))})"
        between = "axis and wall" if axial else "the walls"
        raise CaseError(
            f"blocks the whole cross-section between {between}{together}; leave an opening for the particles",
            obstacle_key(closing[-1]),
        )


def _check_thickness(polygon: Array, key: KeyPath, tolerance: float) -> None:
    """CaseError for an obstacle that is hardly more than a line: no mesh resolves it."""
    (r, z), (next_r, next_z) = polygon.T, np.roll(polygon, -1, axis=0).T
    area = 0.5 * abs(float((r * next_z - next_r * z).sum()))
    thickness = 2 * area / float(np.hypot(next_r - r, next_z - z).sum())
    if thickness <= tolerance:
        raise CaseError(f"only {thickness:.2g} m thick on average; draw it thicker, or leave it out", key)


def check_sections(sections: Mapping[str, ZRange], z_top: float, z_bottom: float, tolerance: float) -> None:
    """CaseError unless the sections lie inside the outline's height and do not overlap."""
    for name, section in sections.items():
        if section.z_top - section.z_bottom <= tolerance:
            raise CaseError(
                f"from z = {section.z_top:g} m to {section.z_bottom:g} m: give the upper z first, and a height above 0",
                ("outline", "sections", name),
            )
        if section.z_top > z_top + tolerance or section.z_bottom < z_bottom - tolerance:
            raise CaseError(
                f"z from {section.z_top:g} m to {section.z_bottom:g} m leaves the outline, which runs from {z_top:g} m "
                f"to {z_bottom:g} m; keep it inside",
                ("outline", "sections", name),
            )
    ordered = sorted(sections.items(), key=lambda item: -item[1].z_top)
    for (upper, a), (lower, b) in pairwise(ordered):
        if b.z_top > a.z_bottom + tolerance:
            raise CaseError(
                f"begins at z = {b.z_top:g} m, inside section {upper!r}, which ends at {a.z_bottom:g} m; "
                "sections must not overlap",
                ("outline", "sections", lower),
            )


def _check_points(points: Array, key: KeyPath, least: int, axial: bool) -> None:
    pair = "[r, z]" if axial else "[x, z]"
    if len(points) < least:
        raise CaseError(f"has {len(points)} point{'s' * (len(points) != 1)}; give at least {least} as {pair}", key)
    if len(points) > MOST_POINTS:
        raise CaseError(
            f"has {len(points)} points, more than {MOST_POINTS}; leave out those that lie on straight lines", key
        )
    for i, (r, z) in enumerate(points):
        if not (np.isfinite(r) and np.isfinite(z)):
            raise CaseError(f"[{r:g}, {z:g}] is not a point; give finite numbers {pair}", (*key, i))
        if axial and r < 0:
            raise CaseError(
                f"r = {r:g} m lies beyond the axis; the outline is one half of the vessel, r ≥ 0 (points are [r, z])",
                (*key, i),
            )


def _check_lengths(points: Array, edges: Array, key: KeyPath, tolerance: float) -> None:
    short = np.flatnonzero(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) <= tolerance)
    if len(short):
        i = (int(short[0]) + 1) % len(points)
        r, z = points[i]
        raise CaseError(
            f"[{r:g}, {z:g}] repeats the point before it (closer than {tolerance:.1g} m); leave one of them out",
            (*key, i or len(points) - 1),
        )


def _check_self_crossing(points: Array, edges: Array, key: KeyPath, tolerance: float, closed: bool) -> None:
    met = self_contact(edges, tolerance, closed)
    if met:
        (r0, z0), (r1, z1) = points[met[0]], points[met[1]]
        raise CaseError(
            f"the edge that starts at [{r1:g}, {z1:g}] crosses or touches the one that starts at [{r0:g}, {z0:g}]; "
            "the outline must not cross itself: check the order of the points",
            (*key, met[1]),
        )


def _check_polygon(polygon: Array, key: KeyPath, tolerance: float, axial: bool) -> None:
    _check_points(polygon, key, 3, axial)
    edges = edges_of(polygon, closed=True)
    _check_lengths(polygon, edges, key, tolerance)
    _check_self_crossing(polygon, edges, key, tolerance, closed=True)
    if abs(signed_area(polygon)) <= tolerance**2:
        raise CaseError("encloses no area; give at least three points that are not on one line", key)
    if axial and polygon[:, 0].max() <= tolerance:
        raise CaseError("lies on the axis and has no radius; move its points outwards", key)


def _check_within_walls(polygon: Array, left: Array, wall: Array, key: KeyPath, tolerance: float) -> None:
    vessel = np.concatenate([wall, left[::-1]])
    edges = edges_of(polygon, closed=True)
    bounds = edges_of(vessel, closed=True)
    if not _strays(polygon, vessel, tolerance).any():
        if not _strays(pieces(edges, bounds).mean(axis=1), vessel, tolerance).any():
            return
        i = int(np.flatnonzero(crosses(edges, bounds).any(axis=1))[0])
        r, z = polygon[i]
        raise CaseError(
            f"the edge that starts at [{r:g}, {z:g}] crosses the wall; keep it inside (touching is allowed)",
            (*key, i),
        )
    i = int(np.flatnonzero(_strays(polygon, vessel, tolerance))[0])
    r, z = polygon[i]
    by = distance_to(polygon[i : i + 1], bounds)[0]
    raise CaseError(
        f"[{r:g}, {z:g}] lies {by:.3g} m outside the vessel; move it inside or onto the wall, between "
        f"z = {wall[0, 1]:g} m and {wall[-1, 1]:g} m",
        (*key, i),
    )


def _strays(points: Array, polygon: Array, tolerance: float) -> Array:
    """(n,) whether each point lies outside the polygon by more than the tolerance."""
    far = distance_to(points, edges_of(polygon, closed=True)) > tolerance
    return np.asarray(far & ~inside_polygon(points, polygon))


def _overlap(a: Array, b: Array, tolerance: float) -> bool:
    """Whether two polygons share area: a piece of one border, or a point inside one, lies within the other."""
    if farther(a, b, tolerance):
        return False
    return _reaches_into(a, b, tolerance) or _reaches_into(b, a, tolerance)


def _reaches_into(a: Array, b: Array, tolerance: float) -> bool:
    edges = edges_of(b, closed=True)
    probes = np.concatenate([pieces(edges_of(a, closed=True), edges).mean(axis=1), [_interior_point(a)]])
    return bool((inside_polygon(probes, b) & (distance_to(probes, edges) > tolerance)).any())


def _interior_point(polygon: Array) -> Array:
    """A point inside: the middle of the widest chord at the height midway between the two most distant levels."""
    levels = np.unique(polygon[:, 1])
    k = int(np.diff(levels).argmax())
    z = 0.5 * (levels[k] + levels[k + 1])
    edges = edges_of(polygon, closed=True)
    spans = (edges[:, 0, 1] > z) != (edges[:, 1, 1] > z)
    (r0, z0), (r1, z1) = edges[spans, 0].T, edges[spans, 1].T
    radii = np.sort(r0 + (z - z0) * (r1 - r0) / (z1 - z0))
    i = 2 * int(np.diff(radii)[::2].argmax())
    return np.array([0.5 * (radii[i] + radii[i + 1]), z])
